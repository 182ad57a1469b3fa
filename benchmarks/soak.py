"""Missions one after the other in one process: what grows?

uv run python benchmarks/soak.py [--missions 200] [--seed 1] [--scenarios shefex2_andoya rexus_like ...]
                                 [--minutes M] [--keep FILE] [--json]

Each mission is flown with its log, read again, summed up and thrown away; scenarios take turns, seeds count
up. Memory that the process holds, open file descriptors, threads and files in the temporary folder are taken
after each. Growth is the slope of a line through the missions after the tenth (Theil and Sen: the median of
the slopes of all pairs, with its 95 % interval), so that one large mission does not decide. `--keep` appends
a line of JSON a mission. Exit code 1 if memory grows by a MB a mission or more, or descriptors, threads or
files do.
"""

import argparse
import gc
import json
import os
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import NamedTuple

WARM = 10  # missions that may load and keep what they like
MOST_MB = 1.0  # a mission
MEMORY = "memory_mb"
OBSERVED = MEMORY, "descriptors", "threads", "files"
SCENARIOS = ("shefex2_andoya", "rexus_like", "night_sky", "imu_faults", "shefex2_aps_rolling")


def memory_mb():
    """Resident memory of this process, MB (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def state(folder):
    """What could grow: {name: number}."""
    gc.collect()
    return {
        "memory_mb": memory_mb(),
        "descriptors": len(os.listdir("/proc/self/fd")),
        "threads": threading.active_count(),
        "files": sum(1 for _ in Path(folder).rglob("*")),
    }


def fly(name, seed):
    """Fly a mission, sum it up, forget it. -> mission time flown, s"""
    from shefex_nav import runs
    from shefex_nav.scenario import load

    run = runs.fly(load.load(name), seed)
    run.summary()
    return run.data.last_t_s - run.data.mission.start_s


class Growth(NamedTuple):
    """Change a mission: the median of the slopes of all pairs with its 95 % interval (Sen, 1968)."""

    slope: float
    low: float
    high: float
    grows: bool


def growth(values, name):
    """Growth of one of OBSERVED over the missions."""
    from scipy.stats import theilslopes

    found = theilslopes(values)
    more = found.slope >= MOST_MB if name == MEMORY else values[-1] > values[0] and found.slope > 0.0
    return Growth(*map(float, (found.slope, found.low_slope, found.high_slope)), bool(more))


def report(rows, growths):
    """Table of what grows."""
    for name, one in growths.items():
        values, word = [float(row[name]) for row in rows], "   GROWS" if one.grows else ""
        print(
            f"  {name:12} {values[0]:8.1f} -> {values[-1]:8.1f}   most {max(values):8.1f}   "
            f"{one.slope:+8.4f} a mission ({one.low:+.4f} to {one.high:+.4f}){word}"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no mission after them")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.missions < 2 * WARM:
        parser.error(f"--missions {given.missions}: at least {2 * WARM}, of which {WARM} are not counted")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        tempfile.tempdir = folder  # where runs put logs that nobody named
        until_s = time.monotonic() + 60.0 * given.minutes
        for k in range(given.missions):
            if time.monotonic() > until_s and len(rows) >= 2 * WARM:
                break
            name = given.scenarios[k % len(given.scenarios)]
            began = time.process_time()
            flown_s = fly(name, given.seed + k)
            rows.append({"scenario": name, "seed": given.seed + k, "flown_s": flown_s} | state(folder))
            rows[-1]["processor_s"] = time.process_time() - began
            print(f"{k + 1} of {given.missions}: {name}, {rows[-1]['memory_mb']:.0f} MB", file=sys.stderr)
            if given.keep:
                with given.keep.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
    growths = {name: growth([row[name] for row in rows[WARM:]], name) for name in OBSERVED}
    if given.json:
        print(
            json.dumps({"missions": rows, "growth": {name: one._asdict() for name, one in growths.items()}})
        )
    else:
        print(f"{len(rows)} missions, {', '.join(given.scenarios)}, seeds {given.seed} on")
        report(rows[WARM:], growths)
    sys.exit(any(one.grows for one in growths.values()))


if __name__ == "__main__":
    main()
