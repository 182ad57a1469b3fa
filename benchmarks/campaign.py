"""What campaigns cost: one worker against two, what the engine itself takes, memory, size of the results.

uv run python benchmarks/campaign.py [SCENARIO] [--one-flight SCENARIO] [--runs 30] [--statistical 200]
                                     [--set KEY=VALUE] [--quick] [--json]

Flies the same rendered campaign with one worker and with two, in fresh folders; the results have to be the
same to the byte. Then two with `frames: statistical` and two workers: of the same scenario, and of the second
one, whose runs share their flight. Everything is compiled before, which is told and counted nowhere.
Run it on a quiet machine: it measures wall time, a quarter of an hour.

Speed-up and missions an hour are of wall times from the first step of the command to its table, start of the
workers and all. What these cost once is told too, and how many missions an hour there are in between, which
is the rate of a long campaign.

Overhead of the engine is what the campaign costs beyond its runs, between the ends of each worker's first and
last run, as share of the workers' time there: the time that none of its runs took, and the processor time of
the campaign itself, which on a machine with as many workers as cores it takes from them. What happens in both
is counted twice.

Exit code 1 if a figure is not what is asked for or the results differ. `--quick` flies four missions of a
tenth of the frames: it shows that the benchmark works and says nothing of the machine.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from missions import SCENARIOS

SEED = 1
QUICK = ("star_tracker.off=244 s",)
QUICK_RUNS = 4
SHARED_FLIGHT = "flight.npz"  # kept once, however many runs there are
WANTED = (  # figure, what is asked of a machine with two cores, in words
    ("speed_up", "least", 1.7, "times as fast with two workers as with one"),
    ("overhead_percent", "most", 2.0, "% of two workers' time is the engine's"),
    ("rendered_per_hour", "least", 900.0, "rendered missions an hour, two workers"),
    ("statistical_per_hour", "least", 4000.0, "statistical missions an hour, two workers"),
    ("one_flight_per_hour", "least", 4000.0, "statistical missions of one flight, two workers"),
    ("memory_mb", "most", 600.0, "MB at most in a worker"),
    ("size_mb", "most", 1.0, "MB of results a run, without logs"),
)


class End(NamedTuple):
    """Of a run."""

    when_s: float  # perf_counter
    wall_s: float  # in the run
    cpu_s: float  # of the campaign itself until then


def fly(scenario, runs, workers, folder):
    """One campaign: dict of figures."""
    from shefex_nav.campaign import engine, running
    from shefex_nav.campaign.progress import Show
    from shefex_nav.campaign.store import Store

    ends = []  # of each worker: list of End

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
            wall_s = future.result().record["timing"]["wall_s"]
            self.ends.append(End(time.perf_counter(), wall_s, time.process_time()))

    request = running.Request(scenario, runs, SEED, workers, None, ())
    began_s = time.perf_counter()
    with Store(folder) as store:
        ended = running.fly(
            request, store, Show(lambda text: None),
            crew=lambda plan, count: [Watched(plan) for _ in range(workers)],
        )  # fmt: skip
    over_s = time.perf_counter()
    return (
        {"runs": runs, "workers": workers}
        | times([one for one in ends if one], began_s, over_s, runs)
        | figures(ended, folder)
    )


def times(ends, began_s, over_s, runs):
    """Where the wall time of a campaign went: dict.

    ends : of each worker a list of End;  began_s, over_s : of the campaign
    """
    later = [one for one in ends if len(one) > 1]
    between_s = sum(one[-1].when_s - one[0].when_s for one in later)
    in_runs_s = sum(end.wall_s for one in later for end in one[1:])
    first, last = min(one[0] for one in ends), max(one[-1] for one in ends)
    own_s, shared_s = last.cpu_s - first.cpu_s, len(ends) * (last.when_s - first.when_s)
    idle = 1.0 - in_runs_s / between_s if between_s else None
    return {
        "wall_s": over_s - began_s,
        "until_the_first_run_s": min(one[0].when_s - one[0].wall_s for one in ends) - began_s,
        "after_the_last_run_s": over_s - last.when_s,
        "per_hour": 3600.0 * runs / (over_s - began_s),
        "per_hour_in_between": sum(
            3600.0 * (len(one) - 1) / (one[-1].when_s - one[0].when_s) for one in later
        ),
        "idle_percent": None if idle is None else 100.0 * idle,
        "own_processor_percent": 100.0 * own_s / shared_s if shared_s else None,
        "overhead_percent": None if idle is None else 100.0 * (idle + own_s / shared_s),
    }


def figures(ended, folder):
    """Figures of the runs of a campaign that was flown: dict."""
    from shefex_nav.campaign.results import open_campaign

    campaign = open_campaign(folder)
    files = [path for path in folder.rglob("*") if path.is_file() and path.name != SHARED_FLIGHT]
    return {
        "wall_s_of_a_run": campaign["timing.wall_s"].mean(),
        "processor_s_of_a_run": campaign["timing.cpu_s"].mean(),
        "start_of_a_worker_s": campaign["timing.start_s"].max(),
        "memory_mb": campaign["timing.peak_memory_mb"].max(),
        "size_mb": sum(path.stat().st_size for path in files) / 1e6 / ended.done,
        "failed": ended.failed,
        "lost": len(ended.lost),
        "digest": ended.digest,
    }


def measured(path, one_flight, overrides, runs, statistical):
    """Everything: dict."""
    from shefex_nav import simulate
    from shefex_nav.campaign import flight, running
    from shefex_nav.scenario import load

    began_s, load_before = time.perf_counter(), os.getloadavg() if hasattr(os, "getloadavg") else None
    rendered = load.load(path, overrides)
    fast, shared = (
        load.load(one, [*overrides, "star_tracker.frames=statistical"]) for one in (path, one_flight)
    )
    for one in (rendered, fast):
        simulate.warm_up(one)
        plan, sampler = running.prepared(one, runs, SEED)
        flight.Pilot(plan).fly(sampler.job(0))  # what a brief flight does not meet
    found = {"scenario": rendered.mission.name, "seed": SEED, "cores": os.cpu_count()}
    found |= {"load_before": load_before, "compiled_or_read_s": time.perf_counter() - began_s}
    campaigns = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, scenario, count, workers in (
            ("rendered, one worker", rendered, runs, 1),
            ("rendered, two", rendered, runs, 2),
            ("statistical, two", fast, statistical, 2),
            ("one flight, two", shared, statistical, 2),
        ):
            print(f"{name}: {count} runs", file=sys.stderr)
            campaigns[name] = fly(scenario, count, workers, Path(folder) / name)
    one, two, other, together = campaigns.values()
    return found | {
        "same_results": one["digest"] == two["digest"],
        "speed_up": one["wall_s"] / two["wall_s"],
        "overhead_percent": two["overhead_percent"],
        "rendered_per_hour": two["per_hour"],
        "statistical_per_hour": other["per_hour"],
        "one_flight_per_hour": together["per_hour"],
        "memory_mb": max(part["memory_mb"] for part in campaigns.values()),
        "size_mb": max(part["size_mb"] for part in campaigns.values()),
        "campaigns": campaigns,
    }


def met(result):
    """Whether each figure is what is asked for: list of bool."""
    values = [(result[name], how, limit) for name, how, limit, _ in WANTED]
    return [
        value is not None and (value >= limit if how == "least" else value <= limit)
        for value, how, limit in values
    ]


def show(result):
    """Print what was measured beside what is asked for."""
    campaigns = result["campaigns"]
    sample = "; ".join(f"{one['runs']} runs {name}" for name, one in campaigns.items())
    print(f"{result['scenario']}, seed {result['seed']}: {sample}")
    print(f"{result['cores']} cores, load before {result['load_before']}")
    before_s = result["compiled_or_read_s"]
    print(f"before that {before_s:.1f} s: compiled or read what is compiled, flew a mission of each kind")
    print(f"results of one worker and of two the same: {result['same_results']}\n")
    for (name, how, limit, words), good in zip(WANTED, met(result), strict=True):
        shown = "-" if result[name] is None else f"{result[name]:.4g}"
        print(f"{shown:>8} {words:<45} at {how} {limit:g}: {'yes' if good else 'NO'}")
    print()
    print(f"{'':<26}{''.join(f'{name:>22}' for name in campaigns)}")
    for name in next(iter(campaigns.values())):
        values = [one[name] for one in campaigns.values()]
        print(f"{name:<26}{''.join(f'{_shown(value):>22}' for value in values)}")


def _shown(value):
    if isinstance(value, str):
        return value[:12]
    return "-" if value is None else f"{value:.4g}"


def main():
    """Fly and print. -> exit code"""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default=str(SCENARIOS / "shefex2_dispersed.yaml"))
    one_flight = str(SCENARIOS / "shefex2_dispersed_sensors.yaml")
    parser.add_argument("--one-flight", default=one_flight, metavar="SCENARIO")
    parser.add_argument("--runs", type=int, default=30, help="rendered, with one worker and again with two")
    parser.add_argument("--statistical", type=int, default=200, help="runs with statistical frames")
    parser.add_argument("--set", action="append", default=[], dest="overrides")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--json", action="store_true")
    wanted = parser.parse_args()
    if wanted.quick:
        wanted.runs = wanted.statistical = QUICK_RUNS
        wanted.overrides += QUICK
    result = measured(wanted.scenario, wanted.one_flight, wanted.overrides, wanted.runs, wanted.statistical)
    if wanted.json:
        print(json.dumps(result))
    else:
        show(result)
    return 0 if result["same_results"] and (wanted.quick or all(met(result))) else 1


if __name__ == "__main__":
    sys.exit(main())
