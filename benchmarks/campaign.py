"""What campaigns cost: one worker against two, what the engine itself takes, memory, size of the results.

uv run python benchmarks/campaign.py [SCENARIO] [--runs 24] [--statistical 100] [--set KEY=VALUE]
                                     [--quick] [--json]

Flies the same rendered campaign with one worker and with two, in fresh folders; the results have to be the
same to the byte. Then one with `frames: statistical` and two workers. Everything is compiled before. Speed-up
and missions an hour are of wall times from the first step of the command to its table, the start of the
workers and all. Overhead of the engine: share of a worker's time, from the end of its first run to the end of
its last, that none of its runs took. Run it on a quiet machine: it measures wall time. `--quick` flies four
missions of a tenth of the frames: it shows that the benchmark works and says nothing of the machine.
"""

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

from missions import SCENARIOS

SEED = 1
QUICK = ("star_tracker.off=244 s",)
QUICK_RUNS = 4
WANTED = (  # figure, what is asked of a machine with two cores, in words
    ("speed_up", "least", 1.7, "times as fast with two workers as with one"),
    ("overhead_percent", "most", 2.0, "% of two workers' time is the engine's"),
    ("rendered_per_hour", "least", 900.0, "rendered missions an hour, two workers"),
    ("statistical_per_hour", "least", 4000.0, "statistical missions an hour, two workers"),
    ("memory_mb", "most", 600.0, "MB at most in a worker"),
    ("size_kb", "most", 1000.0, "kB of results a run, without logs"),
)


def fly(scenario, runs, workers, folder):
    """One campaign: dict of figures."""
    from shefex_nav.campaign import engine, running
    from shefex_nav.campaign.progress import Show
    from shefex_nav.campaign.store import Store

    ends = []  # of each worker: [(when a run ended, wall time in the run)]

    class Watched(engine.ProcessLane):
        """A worker whose runs are noted as they end."""

        def __init__(self, plan):
            super().__init__(plan)
            self.ends = []
            ends.append(self.ends)

        def submit(self, job):
            future = super().submit(job)
            future.add_done_callback(self.note)
            return future

        def note(self, future):
            self.ends.append((time.perf_counter(), future.result().record["timing"]["wall_s"]))

    request = running.Request(scenario, runs, SEED, workers, None, ())
    began, cpu_s = time.perf_counter(), time.process_time()
    with Store(folder) as store:
        ended = running.fly(
            request, store, Show(lambda text: None),
            crew=lambda plan, count: [Watched(plan) for _ in range(workers)],
        )  # fmt: skip
    wall_s, cpu_s = time.perf_counter() - began, time.process_time() - cpu_s
    return figures(ended, ends, folder) | {
        "workers": workers,
        "runs": runs,
        "wall_s": wall_s,
        "missions_per_hour": 3600.0 * runs / wall_s,
        "cpu_of_the_campaign_itself_s_per_run": cpu_s / runs,
    }


def figures(ended, ends, folder):
    """Figures of a campaign that was flown: dict."""
    rows = ended.rows
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {
        "wall_s_per_run": sum(row["timing.wall_s"] for row in rows) / len(rows),
        "cpu_s_per_run": sum(row["timing.cpu_s"] for row in rows) / len(rows),
        "overhead_percent": overhead_percent(ends),
        "start_s": max(row["timing.start_s"] for row in rows),
        "memory_mb": max(row["timing.peak_memory_mb"] for row in rows),
        "size_kb": sum(path.stat().st_size for path in files) / 1e3 / len(rows),
        "failed": sum(row["status"] == "failed" for row in rows),
        "lost": len(ended.lost),
        "digest": ended.digest,
    }


def overhead_percent(ends):
    """Share of the workers' time that no run took, between the ends of each worker's first and last run.

    ends : of each worker a list of (when a run ended, wall time in the run) -> %; None of too few runs
    """
    later = [(one[-1][0] - one[0][0], sum(wall_s for _, wall_s in one[1:])) for one in ends if len(one) > 1]
    between_s, in_runs_s = (sum(column) for column in zip(*later, strict=True)) if later else (0.0, 0.0)
    return 100.0 * (1.0 - in_runs_s / between_s) if between_s else None


def measured(path, overrides, runs, statistical):
    """Everything: dict."""
    from shefex_nav import simulate
    from shefex_nav.scenario import load

    rendered = load.load(path, overrides)
    fast = load.load(path, [*overrides, "star_tracker.frames=statistical"])
    for one in (rendered, fast):
        simulate.warm_up(one)
    with tempfile.TemporaryDirectory() as folder:
        one, two = (fly(rendered, runs, n, Path(folder) / str(n)) for n in (1, 2))
        other = fly(fast, statistical, 2, Path(folder) / "statistical")
    return {
        "scenario": rendered.mission.name,
        "seed": SEED,
        "cores": os.cpu_count(),
        "load_before": os.getloadavg() if hasattr(os, "getloadavg") else None,
        "same_results": one["digest"] == two["digest"],
        "speed_up": one["wall_s"] / two["wall_s"],
        "overhead_percent": two["overhead_percent"],
        "rendered_per_hour": two["missions_per_hour"],
        "statistical_per_hour": other["missions_per_hour"],
        "memory_mb": max(part["memory_mb"] for part in (one, two, other)),
        "size_kb": max(part["size_kb"] for part in (one, two, other)),
        "campaigns": {"rendered, one worker": one, "rendered, two": two, "statistical, two": other},
    }


def show(result):
    """Print what was measured beside what is asked for."""
    campaigns = result["campaigns"]
    sample = "; ".join(f"{one['runs']} runs {name}" for name, one in campaigns.items())
    print(f"{result['scenario']}, seed {result['seed']}: {sample}")
    print(f"{result['cores']} cores, load before {result['load_before']}")
    print(f"results of one worker and of two the same: {result['same_results']}\n")
    for name, how, limit, words in WANTED:
        value = result[name]
        good = value is not None and (value >= limit if how == "least" else value <= limit)
        shown = "-" if value is None else f"{value:.4g}"
        print(f"{shown:>8} {words:<45} at {how} {limit:g}: {'yes' if good else 'NO'}")
    print()
    for name in next(iter(campaigns.values())):
        values = [one[name] for one in campaigns.values()]
        shown = [
            f"{value[:12] if isinstance(value, str) else format(value or 0.0, '.4g'):>14}" for value in values
        ]
        print(f"{name:<38}{''.join(shown)}")


def main():
    """Fly and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default=str(SCENARIOS / "campaign.yaml"))
    parser.add_argument("--runs", type=int, default=24, help="rendered, with one worker and again with two")
    parser.add_argument("--statistical", type=int, default=100, help="runs with statistical frames")
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    wanted = parser.parse_args()
    if wanted.quick:
        wanted.runs = wanted.statistical = QUICK_RUNS
        wanted.overrides += QUICK
    result = measured(wanted.scenario, wanted.overrides, wanted.runs, wanted.statistical)
    if wanted.json:
        print(json.dumps(result))
    else:
        show(result)


if __name__ == "__main__":
    main()
