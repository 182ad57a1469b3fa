"""Smoother against its filter: errors by part and axis, whether its covariance is right, and its time.

uv run python benchmarks/smoother.py FOLDER [--scenario shefex2_andoya] [--seeds 30] [--first 0]
    [--set KEY=VALUE] [--navego DATA [--as-recorded]] [--json FILE]

FOLDER keeps the logs of the flights, <scenario>-<seed>.mcap; one that is there is not flown again.
With --navego the runs are the drive of NaveGo in the folder DATA, one fix a second, with errors of IMU, GNSS
and start that are drawn for each seed from what the scenario states (`navego_drawn`): independent of each
other, on one road. With --as-recorded they are the five disjoint sets of the fixes in the files (5 Hz) with
the one IMU of the files: not independent, so that neither interval below is exact.

Printed for each part of the flight and each axis (position and velocity inertial, attitude in body axes):
RMS over all seeds and instants of filter and smoother, their ratio and its 99.9 % interval (bootstrap over
seeds, both of a seed together), `worse` where all of it is above 1. Then the mean NEES over seeds in the
middle of each part, of three errors and of all nine, with the two-sided 99.9 % bounds of chi-square, as many
comparisons as there are taken into account, and the processor time of the smoother against that of a filter
with the same states that says the same. Exit code 1 if the smoother is worse anywhere, outside the bounds
below (above them: too sure; below: more modest than it need be), or slower than 4 times the filter.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from missions import SCENARIOS

from shefex_nav.report.navigation_errors import navigation_errors

BLOCKS = {"position": slice(0, 3), "velocity": slice(3, 6), "attitude": slice(6, 9), "all": slice(0, 9)}
AXES = ("r x", "r y", "r z", "v x", "v y", "v z", "att x", "att y", "att z")
CONFIDENCE, DRAWS, TIMES = 0.999, 20_000, 4.0
SETS = 5  # of the fixes in NaveGo's files


def flown(folder, name, seed, overrides):
    """Recording of a flight, which is flown unless it is kept."""
    from shefex_nav.replay import rerun

    log = folder / f"{name}-{seed}.mcap"
    if not log.exists():
        settings = ["log.frames.otherwise=none", "log.frames.full_every=0", *overrides]
        words = [word for setting in settings for word in ("--set", setting)]
        command = [sys.executable, "-m", "shefex_nav", "run", str(SCENARIOS / f"{name}.yaml"), "--seed"]
        done = subprocess.run(
            [*command, str(seed), *words, "--out", str(log)], capture_output=True, text=True
        )
        if not log.exists():
            raise SystemExit(f"seed {seed} was not flown: {done.stderr}")
    return rerun.open_log(log)


def driven(folder, k, recorded):
    """Recording of NaveGo's drive: fixes k, k + 5, ... of the files, or the errors of seed k."""
    import navego_drawn

    from shefex_nav.log.run_data import RunDataBuilder
    from shefex_nav.replay import external, load, rerun

    if recorded:
        setting = [f"gnss.first={0.2 * k:.1f} s"]
        ready = external.prepare(*load.load(SCENARIOS / "replay" / "navego.yaml", setting, folder))
    else:
        ready = navego_drawn.drawn(folder, k)
    kept = RunDataBuilder(external.mission(ready))
    for record in external.run(ready, external.Clock()):
        kept.add(record)
    return rerun.of_data(kept.build(), f"navego {k}")


def measure(recording):
    """One run: parts with mean squares by axis, and NEES in their middle; seconds."""
    from shefex_nav.replay import smooth, smoothed

    began = time.process_time()
    result = smooth.run(recording)
    smoother_s = time.process_time() - began
    alike = smooth.after_the_flight(recording)._replace(field=None)
    began = time.process_time()
    smooth.forward(alike)
    filter_s = time.process_time() - began
    found = {part.name: {} for part in smoothed.parts(result.filtered) if part.to_s > part.from_s}
    for which, data in zip(("filtered", "smoothed"), result, strict=True):
        for part in smoothed.parts(result.filtered):
            if part.name in found:
                found[part.name][which] = _in(part, data)
    return {
        "parts": found,
        "smoother_s": smoother_s,
        "filter_s": filter_s,
        "states": len(alike.params.states),
    }


def _in(part, data):
    """Mean squares of nine errors in a part, and NEES of the blocks in its middle."""
    from shefex_nav.report.pairing import same_times

    errors = navigation_errors(data)
    x = np.hstack([errors.position_i, errors.velocity_i, errors.attitude_b])
    inside = (errors.t_s >= part.from_s) & (errors.t_s <= part.to_s)
    i, j = same_times(errors.t_s, data.covariance.t_s)
    k = int(np.argmin(np.abs(errors.t_s[i] - 0.5 * (part.from_s + part.to_s))))
    return {
        "squares": (x[inside] ** 2).mean(axis=0).tolist(),
        "nees": {
            name: _nees(x[i][k, block], data.covariance.P[j[k]][block, block])
            for name, block in BLOCKS.items()
        },
    }


def _nees(x, P):
    scale = np.sqrt(np.diag(P))
    z = x / scale
    return float(z @ np.linalg.solve(P / np.outer(scale, scale), z))


def of_errors(runs, name, rng):
    """Rows of a part: axis, RMS of both, ratio, its interval, whether the smoother is worse."""
    before, after = (
        np.array([run["parts"][name][which]["squares"] for run in runs]) for which in ("filtered", "smoothed")
    )
    drawn = rng.integers(0, len(runs), (DRAWS, len(runs)))
    ratios = np.sqrt(after[drawn].mean(axis=1) / before[drawn].mean(axis=1))
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(ratios, [tail, 100.0 - tail], axis=0)
    rms = np.sqrt([before.mean(axis=0), after.mean(axis=0)])
    return [
        {
            "part": name, "axis": axis, "filtered": rms[0, k], "smoothed": rms[1, k],
            "ratio": rms[1, k] / rms[0, k], "low": low[k], "high": high[k], "worse": bool(low[k] > 1.0),
        }
        for k, axis in enumerate(AXES)
    ]  # fmt: skip


def of_nees(runs, name, comparisons):
    """Rows of a part: block, mean NEES per degree of freedom of both, bounds, whether inside."""
    from scipy.stats import chi2

    rows, n = [], len(runs)
    for block, place in BLOCKS.items():
        dof = (place.stop - place.start) * n
        tail = 0.5 * (1.0 - CONFIDENCE) / comparisons
        low, high = chi2.ppf([tail, 1.0 - tail], dof) / dof
        both = [
            float(np.sum([run["parts"][name][which]["nees"][block] for run in runs])) / dof
            for which in ("filtered", "smoothed")
        ]
        inside = bool(low < both[1] < high)
        rows.append({"part": name, "block": block, "filtered": both[0], "smoothed": both[1],
                     "low": low, "high": high, "inside": inside})  # fmt: skip
    return rows


def judge(runs):
    """What all runs say: rows of errors, rows of NEES, times."""
    rng = np.random.default_rng(0)
    names = [name for name in runs[0]["parts"] if all(name in run["parts"] for run in runs)]
    times = np.array([(run["smoother_s"], run["filter_s"]) for run in runs])
    return {
        "errors": [row for name in names for row in of_errors(runs, name, rng)],
        "nees": [row for name in names for row in of_nees(runs, name, len(BLOCKS) * len(names))],
        "smoother_s": float(np.median(times[:, 0])),
        "filter_s": float(np.median(times[:, 1])),
        "times": float(np.median(times[:, 0] / times[:, 1])),
    }


def show(found, n):
    """Print the tables. -> whether everything is as it must be"""
    print(f"{n} runs; RMS in m, m/s, deg, filtered -> smoothed, ratio [99.9 %]")
    for row in found["errors"]:
        unit = 180.0 / np.pi if row["axis"].startswith("att") else 1.0
        pair = f"{unit * row['filtered']:9.5f} -> {unit * row['smoothed']:9.5f}"
        verdict = "  worse" if row["worse"] else ""
        print(f"  {row['part']:20s} {row['axis']:6s} {pair}   {row['ratio']:.2f} "
              f"[{row['low']:.2f}, {row['high']:.2f}]{verdict}")  # fmt: skip
    print("NEES per degree of freedom in the middle of the part, filtered -> smoothed (bounds)")
    for row in found["nees"]:
        verdict = "" if row["inside"] else "  outside"
        print(f"  {row['part']:20s} {row['block']:9s} {row['filtered']:.2f} -> {row['smoothed']:.2f} "
              f"({row['low']:.2f} to {row['high']:.2f}){verdict}")  # fmt: skip
    print(f"processor time: smoother {found['smoother_s']:.2f} s, filter with the same states "
          f"{found['filter_s']:.2f} s, {found['times']:.1f} times")  # fmt: skip
    worse = sum(row["worse"] for row in found["errors"])
    outside = sum(not row["inside"] for row in found["nees"])
    print(f"worse: {worse} of {len(found['errors'])}; outside: {outside} of {len(found['nees'])}")
    return not worse and not outside and found["times"] <= TIMES


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scenario", default="shefex2_andoya", help="name of a shipped scenario")
    parser.add_argument("--seeds", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE")
    parser.add_argument("--navego", type=Path, metavar="DATA", help="folder of NaveGo's files")
    parser.add_argument("--as-recorded", action="store_true", help="NaveGo's files as they are, five sets")
    parser.add_argument("--json", type=Path, help="what was measured of each run, and what they say")
    given = parser.parse_args()
    from shefex_nav import warmup

    warmup.get_ready({"command=smooth"})
    runs = []
    for k in range(SETS if given.as_recorded else given.seeds):
        if given.navego:
            recording = driven(given.navego, k if given.as_recorded else given.first + k, given.as_recorded)
        else:
            given.folder.mkdir(parents=True, exist_ok=True)
            recording = flown(given.folder, given.scenario, given.first + k, given.overrides)
        runs.append(measure(recording))
        print(f"{k + 1} done", file=sys.stderr, flush=True)
    found = judge(runs)
    if given.json:
        given.json.write_text(json.dumps({"runs": runs, **found}), encoding="utf-8")
    raise SystemExit(0 if show(found, len(runs)) else 1)


if __name__ == "__main__":
    main()
