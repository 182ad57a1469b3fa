"""What campaigns cost: one worker against two, what the engine itself takes, memory, size of the results.

uv run python benchmarks/campaign.py [SCENARIO] [--runs 20] [--set KEY=VALUE] [--json]

Flies the same campaign twice, with one worker and with two, in fresh folders; the results have to be the same
to the byte. Run it on a quiet machine: it measures wall time.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

from missions import SCENARIOS

WANTED = {  # what is asked of a machine with two cores; `most` or `least`
    "speed_up": ("least", 1.7),
    "overhead_percent": ("most", 2.0),
    "missions_per_hour": ("least", 900.0),
    "memory_mb": ("most", 600.0),
    "size_kb": ("most", 1000.0),
}


def fly(scenario, runs, workers, folder):
    """One campaign: dict of figures."""
    from shefex_nav.campaign import engine, running
    from shefex_nav.campaign.progress import Show
    from shefex_nav.campaign.store import Store

    request = running.Request(scenario, runs, 1, workers, None, ())
    began = time.perf_counter()
    with Store(folder) as store:
        ended = running.fly(
            request, store, Show(lambda text: None),
            crew=lambda plan, count: [engine.ProcessLane(plan) for _ in range(workers)],
        )  # fmt: skip
    wall_s = time.perf_counter() - began
    rows = ended.rows
    in_runs_s = sum(row["timing.wall_s"] for row in rows)
    start_s = max(row["timing.start_s"] for row in rows)  # imports of a worker, which happen once
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {
        "workers": workers,
        "wall_s": wall_s,
        "in_runs_s": in_runs_s,
        "cpu_s_per_run": sum(row["timing.cpu_s"] for row in rows) / runs,
        "overhead_percent": 100.0 * (1.0 - in_runs_s / workers / (wall_s - start_s)),
        "start_s": start_s,
        "missions_per_hour": 3600.0 * runs / wall_s,
        "memory_mb": max(row["timing.peak_memory_mb"] for row in rows),
        "size_kb": sum(path.stat().st_size for path in files) / 1e3 / runs,
        "failed": sum(row["status"] == "failed" for row in rows),
        "digest": ended.digest,
    }


def main():
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default=str(SCENARIOS / "campaign.yaml"))
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--json", action="store_true")
    wanted = parser.parse_args()
    from shefex_nav import simulate
    from shefex_nav.scenario import load

    scenario = load.load(wanted.scenario, wanted.overrides)
    simulate.warm_up(scenario)
    with tempfile.TemporaryDirectory() as folder:
        one, two = (fly(scenario, wanted.runs, n, Path(folder) / str(n)) for n in (1, 2))
    result = {
        "scenario": scenario.mission.name,
        "runs": wanted.runs,
        "same_results": one["digest"] == two["digest"],
        "speed_up": one["wall_s"] / two["wall_s"],
        "campaigns": [one, two],
    }
    if wanted.json:
        print(json.dumps(result))
        return
    print(f"{result['scenario']}, {wanted.runs} runs each, results the same: {result['same_results']}")
    figures = two | {"speed_up": result["speed_up"]}
    for name, (how, limit) in WANTED.items():
        print(f"{name:<20} {figures[name]:10.1f}   wanted: at {how} {limit:g}")
    for name in ("wall_s", "in_runs_s", "cpu_s_per_run", "start_s", "failed"):
        print(f"{name:<20} {one[name]:10.2f} {two[name]:10.2f}   with one and with two workers")


if __name__ == "__main__":
    main()
