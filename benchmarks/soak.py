"""Missions one after the other in one process, or in a campaign: what grows?

uv run python benchmarks/soak.py [--missions 200] [--seed 1] [--scenarios shefex2_andoya rexus_like ...]
                                 [--minutes M] [--keep FILE] [--json]
uv run python benchmarks/soak.py --campaign SCENARIO [--set KEY=VALUE ...] [--missions 3000] [the others]

Each mission is flown with its log, read again, summed up and thrown away; scenarios take turns, seeds count
up. Memory that the process holds, open file descriptors, threads and files in the temporary folder are taken
after each. Growth is the slope of a line through the missions after the tenth (Theil and Sen: the median of
the slopes of all pairs, with its 95 % interval), so that one large mission does not decide. `--keep` appends
a line of JSON a mission. Exit code 1 if memory grows by a MB a mission or more, or descriptors, threads or
files do.

`--campaign` flies `shefex-nav campaign` in one worker with statistical frames and looks at both processes in
/proc every few seconds: memory, descriptors and threads of each, size and number of the files of its folder.
Of memory 0.02 MB a mission are let pass, 60 MB of 3000 missions; the folder grows by what is kept of a run.
"""

import argparse
import gc
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import NamedTuple

WARM = 10  # missions that may load and keep what they like
MOST_MB = 1.0  # a mission
MOST_CAMPAIGN_MB = 0.02  # a mission, of each process of a campaign
EVERY_S = 5.0  # between two looks at a campaign
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


def of_process(pid):
    """Memory, MB, descriptors and threads of a process (Linux): (3,)."""
    process = Path("/proc", str(pid))
    pages = int((process / "statm").read_text().split()[1])
    return (
        pages * os.sysconf("SC_PAGE_SIZE") / 1e6,
        len(os.listdir(process / "fd")),
        len(os.listdir(process / "task")),
    )


def of_campaign(pid, folder):
    """What could grow of a campaign and its worker, the largest of its children: {name: number}."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    found = {"": of_process(pid), "worker_": max(of_process(child) for child in children)}
    sizes = [path.stat().st_size for path in Path(folder).iterdir()]
    names = "memory_mb", "descriptors", "threads"
    each = {
        who + name: value for who, all_of in found.items() for name, value in zip(names, all_of, strict=True)
    }
    return each | {"disk_mb": sum(sizes) / 1e6, "files": len(sizes)}


def fly_campaign(given, folder):
    """Fly a campaign in one worker and look at it until it ends, or its minutes are over: list of dict."""
    from shefex_nav.campaign.store import Store

    words = ["campaign", given.campaign, "--runs", given.missions, "--seed", given.seed, "--workers", 1]
    for one in ("star_tracker.frames=statistical", *given.set):
        words += ["--set", one]
    command = [sys.executable, "-m", "shefex_nav", *map(str, words), "--out", folder]
    rows, until_s = [], time.monotonic() + 60.0 * given.minutes
    with (
        tempfile.TemporaryFile("w+") as said,
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said) as process,
    ):
        while process.poll() is None:
            time.sleep(EVERY_S)
            done = len(Store(folder).runs.done()) if Path(folder, "runs.sqlite").exists() else 0
            if done > (rows[-1]["missions"] if rows else 0) and done < given.missions:
                rows.append({"missions": done} | of_campaign(process.pid, folder))
                print(f"{done} of {given.missions}: {rows[-1]}", file=sys.stderr)
            if time.monotonic() > until_s:
                process.send_signal(signal.SIGINT)
                until_s = float("inf")
        if process.returncode not in (0, 130):
            said.seek(0)
            sys.exit(said.read())
    return rows


class Growth(NamedTuple):
    """Change a mission: the median of the slopes of all pairs with its 95 % interval (Sen, 1968)."""

    slope: float
    low: float
    high: float
    grows: bool


def growth(values, name, missions=None, most_mb=MOST_MB):
    """Growth of one of OBSERVED over the missions. missions : that were flown by each value, None: one"""
    from scipy.stats import theilslopes

    found = theilslopes(values, missions)
    if name.endswith("_mb"):
        more = found.slope >= (MOST_MB if name == "disk_mb" else most_mb)
    else:
        more = values[-1] > values[0] and found.slope > 0.0
    return Growth(*map(float, (found.slope, found.low_slope, found.high_slope)), bool(more))


def report(rows, growths):
    """Table of what grows."""
    for name, one in growths.items():
        values, word = [float(row[name]) for row in rows], "   GROWS" if one.grows else ""
        print(
            f"  {name:12} {values[0]:8.1f} -> {values[-1]:8.1f}   most {max(values):8.1f}   "
            f"{one.slope:+8.4f} a mission ({one.low:+.4f} to {one.high:+.4f}){word}"
        )


def soak_campaign(given):
    """Rows and growths of a campaign."""
    with tempfile.TemporaryDirectory() as folder:
        rows = fly_campaign(given, folder)
    warm = [row for row in rows if row["missions"] > WARM]
    if len(warm) < WARM:
        sys.exit(
            f"{len(warm)} looks after the first {WARM} missions, {WARM} are needed: give it more minutes"
        )
    missions = [row["missions"] for row in warm]
    names = [name for name in warm[0] if name != "missions"]
    return rows, {
        name: growth([row[name] for row in warm], name, missions, MOST_CAMPAIGN_MB) for name in names
    }


def soak(given):
    """Rows and growths of missions in this process."""
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
    return rows, {name: growth([row[name] for row in rows[WARM:]], name) for name in OBSERVED}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=200, help="how many")
    parser.add_argument("--seed", type=int, default=1, help="of the first mission")
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS, help="flown in turn")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no mission after them")
    parser.add_argument("--keep", type=Path, help="file for a line of JSON a mission")
    parser.add_argument("--campaign", metavar="SCENARIO", help="fly them as one campaign of this")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the campaign")
    parser.add_argument("--json", action="store_true", help="print one object")
    given = parser.parse_args()
    if given.missions < 2 * WARM:
        parser.error(f"--missions {given.missions}: at least {2 * WARM}, of which {WARM} are not counted")
    rows, growths = soak_campaign(given) if given.campaign else soak(given)
    if given.json:
        print(
            json.dumps({"missions": rows, "growth": {name: one._asdict() for name, one in growths.items()}})
        )
    else:
        flown, of = len(rows), ", ".join(given.scenarios)
        if given.campaign:
            flown, of = rows[-1]["missions"], f"a campaign of {given.campaign}"
        print(f"{flown} missions, {of}, seeds {given.seed} on")
        report(rows if given.campaign else rows[WARM:], growths)
    sys.exit(any(one.grows for one in growths.values()))


if __name__ == "__main__":
    main()
