"""Processor seconds of a flight, by the paths that fly many: and how many times faster than another checkout.

    uv run python benchmarks/flight_time.py [--flights 8] [matrix statistical rendered run] [--json]
    uv run python benchmarks/flight_time.py --against /path/to/another/checkout

matrix       cells of `verify robustness`, the default scenario, spread over its design: flight, twin, judged
statistical  the default mission as a campaign flies it, `star_tracker.frames=statistical`
rendered     the same with pictures
run          the default mission as `run` flies it, with a log

Each checkout has a warm process of its own, and they take turns, flight by flight: so a machine that others
use as well slows both alike. Told are the median of the seconds, and of the ratios of two flights that
followed each other. Of the seconds, those spent in parts: building the world, writing the log, keeping
records. Where both fly, `results` says whether they have given the same figures.
"""

import argparse
import gc
import hashlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

KINDS = "matrix", "statistical", "rendered", "run"
SCENARIO = "shefex2_andoya"
STATISTICAL = ("star_tracker.frames=statistical",)
SEED = 5
ROOT = Path(__file__).resolve().parent.parent
PARTS = {  # what is timed in a flight, where a checkout has it: name -> (module, class or None, function)
    "world": tuple(("prepare", None, name) for name in ("build_world", "measure", "with_faults")),
    "log": (("log.writer", "LogWriter", "write"), ("log.writer", "LogWriter", "__exit__")),
    "keeping": (("log.run_data", "RunDataBuilder", "add"), ("log.run_data", "RunDataBuilder", "build")),
}


def flights(kind):
    """Function of a number that flies flight k of a kind. -> its figures, for JSON"""
    return {"matrix": _matrix, "statistical": _statistical, "rendered": _rendered, "run": _run}[kind]()


def _matrix():
    from shefex_nav.verify.robustness import flight, running

    jobs = running.jobs(running.request([SCENARIO], (), 1, None, SEED, 0))

    def fly(k):
        record = flight.fly(jobs[(7 + 29 * k) % len(jobs)])
        return {name: value for name, value in record.items() if name != "cpu_s"}

    return fly


def _statistical():
    return _of_campaign(STATISTICAL)


def _rendered():
    return _of_campaign(())


def _of_campaign(overrides):
    from shefex_nav import prepare
    from shefex_nav.campaign import flight
    from shefex_nav.report import metrics
    from shefex_nav.scenario import load

    scenario = prepare.settled(load.load(SCENARIO, overrides))
    gc.disable()

    def fly(k):
        world = prepare.build_world(scenario, k, biases=True)
        return _unmeasured(metrics.summarise(flight._records(scenario, k, world, None), scenario=scenario))

    return fly


def _run():
    from shefex_nav import runs
    from shefex_nav.scenario import load

    scenario = load.load(SCENARIO)

    def fly(k):
        with tempfile.TemporaryDirectory() as folder:
            summary = runs.fly(scenario, k, log=Path(folder) / "run.mcap").summary()
        return _unmeasured(summary)

    return fly


def _unmeasured(summary):
    """Summary of a flight without what differs from one time to the next."""
    measured = "log", "wall_s", "setup_s", "real_time_factor"
    results = {name: value for name, value in summary.items() if name not in measured}
    tracker = {name: value for name, value in summary["star_tracker"].items() if name != "chain_ms"}
    return results | {"star_tracker": tracker}


def serve(kind):
    """Fly what standard input asks for, a number a line; a line of JSON for each."""
    import importlib

    spent, inside = dict.fromkeys(PARTS, 0.0), set()
    fly = flights(kind)
    for part, functions in PARTS.items():
        for module, owner, name in functions:
            holder = importlib.import_module(f"shefex_nav.{module}")
            holder = getattr(holder, owner) if owner else holder
            if hasattr(holder, name):
                setattr(holder, name, _timed(getattr(holder, name), part, spent, inside))
    for line in sys.stdin:
        spent.update(dict.fromkeys(PARTS, 0.0))
        began = time.process_time()
        figures = fly(int(line))
        cpu_s = time.process_time() - began
        digest = hashlib.sha256(json.dumps(figures, sort_keys=True, default=str).encode()).hexdigest()[:16]
        print(json.dumps({"cpu_s": cpu_s, "parts": spent, "digest": digest}), flush=True)


def _timed(function, part, spent, inside):
    """The function, whose time is added to a part unless it is called from another one of it."""

    def timed(*arguments, **named):
        if part in inside:
            return function(*arguments, **named)
        inside.add(part)
        began = time.process_time()
        try:
            return function(*arguments, **named)
        finally:
            inside.remove(part)
            spent[part] += time.process_time() - began

    return timed


class Checkout:
    """A warm process of one checkout."""

    def __init__(self, folder, kind):
        paths = os.pathsep.join([str(folder), str(ROOT / "benchmarks")])
        self._process = subprocess.Popen(
            [sys.executable, "-P", __file__, "--serve", kind],
            env=os.environ | {"PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def fly(self, k):
        """Flight k: dict, as `serve` prints it."""
        self._process.stdin.write(f"{k}\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def close(self):
        """End the process."""
        self._process.stdin.close()
        self._process.wait()


def measure(kind, count, folders):
    """Seconds and parts of each checkout, ratios, and whether the figures are the same: dict."""
    checkouts = [Checkout(folder, kind) for folder in folders]
    try:
        for one in checkouts:
            one.fly(0)  # loads and compiles
        flown = [[one.fly(k) for one in checkouts] for k in range(1, count + 1)]
    finally:
        for one in checkouts:
            one.close()
    found = {"cpu_s": [statistics.median(row[k]["cpu_s"] for row in flown) for k in range(len(folders))]}
    found["mean_s"] = [statistics.mean(row[k]["cpu_s"] for row in flown) for k in range(len(folders))]
    found["parts"] = {
        name: [statistics.median(row[k]["parts"][name] for row in flown) for k in range(len(folders))]
        for name in PARTS
    }
    if len(folders) > 1:
        found["ratio"] = statistics.median(row[1]["cpu_s"] / row[0]["cpu_s"] for row in flown)
        found["results"] = "same" if all(row[0]["digest"] == row[1]["digest"] for row in flown) else "other"
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"{', '.join(KINDS)} (default: all)")
    parser.add_argument("--flights", type=int, default=8, help="of each kind, after one that is not counted")
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="another checkout, to compare with")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--serve", metavar="KIND", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.serve:
        serve(asked.serve)
        return
    if unknown := set(asked.kinds) - set(KINDS):
        parser.error(f"{', '.join(sorted(unknown))}: expected some of {', '.join(KINDS)}")
    folders = [ROOT] if asked.against is None else [ROOT, asked.against.resolve()]
    result = {kind: measure(kind, asked.flights, folders) for kind in asked.kinds or KINDS}
    if asked.json:
        print(json.dumps(result, indent=1))
        return
    for kind, found in result.items():
        for k, name in enumerate((kind, "  other")[: len(folders)]):
            parts = ", ".join(f"{part} {values[k]:.2f}" for part, values in found["parts"].items())
            print(
                f"{name:12s} {found['cpu_s'][k]:.2f} s median, {found['mean_s'][k]:.2f} mean; of it {parts}"
            )
        if asked.against:
            print(f"{'':12s} {found['ratio']:.2f} times faster; results: {found['results']}")


if __name__ == "__main__":
    main()
