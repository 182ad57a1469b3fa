"""Missions with faults drawn at random, of every kind that a scenario can name: which of them mislead?

uv run python benchmarks/fault_missions.py [--first 1] [--flights 40] [--faults 1|2] [--jobs 2] [--json FILE]

The default mission, its star tracker by statistics. Mission k has one or two faults (drawn, unless --faults
says how many), each of a kind drawn evenly; sizes are 1 to 1000 times what the scenario tells of a healthy
sensor (evenly by the logarithm), a fault begins anywhere from the pad to the end of the programme and lasts
1 to 600 s (likewise). Position, velocity or attitude misleads where its error is beyond the protection level
for more than a second without a break while it may be used (`report.trust`). Prints each misleading mission
with its faults, the largest error over level, and when; then the share of all with its 95 % interval (Clopper
and Pearson), and by kind. Exit code 1 if a mission misleads.
"""

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from missions import SCENARIOS
from scipy.stats import beta

BEGIN_S = -5.0, 460.0
LAST_S = 1.0, 600.0
SIZES = 1.0, 1000.0
TOLD = {  # one sigma of a healthy sensor, by the scenario
    "gyro_bias": (0.5 / 3600.0, "deg/s"),
    "gyro_scale": (0.01, "%"),
    "accelerometer_bias": (0.5, "mgee"),
    "accelerometer_scale": (0.03, "%"),
    "jump": (3.0, "m"),  # range noise times a PDOP of 2
    "drift": (0.1, "m/s"),  # range rate noise, likewise
    "bias": (0.02, "deg"),  # of the mounting
}
IMU = ("gyro_bias", "gyro_scale", "accelerometer_bias", "accelerometer_scale", "stuck", "dead", "dropout",
       "repeat")  # fmt: skip
GPS = ("outage", "freeze", "jump", "drift")
STARS = ("bias", "wrong_fixes", "blinded")
KINDS = [*(("imu", kind) for kind in IMU), *(("gps", kind) for kind in GPS),
         *(("star_tracker", kind) for kind in STARS)]  # fmt: skip


def drawn(seed, count=None):
    """Faults of a mission: list of (device, {key: value} as a scenario has them)."""
    rng = np.random.default_rng([seed, 77])
    number = 1 + int(rng.integers(2))
    return [_fault(rng) for _ in range(count or number)]


def _fault(rng):
    device, kind = KINDS[rng.integers(len(KINDS))]
    begin_s = rng.uniform(*BEGIN_S)
    end_s = begin_s + _evenly(rng, LAST_S)
    size, sign = _evenly(rng, SIZES), rng.choice([-1.0, 1.0])
    direction, axis = rng.standard_normal(3), "xyz"[rng.integers(3)]
    triad, pick = ("gyro", "accelerometer")[rng.integers(2)], int(rng.integers(2))
    fault = {"fault": kind, "from": f"{begin_s:.2f} s", "until": f"{end_s:.2f} s"}
    told, unit = TOLD.get(kind, (0.0, ""))
    vector = [f"{told * size * x:.6g} {unit}" for x in direction / np.linalg.norm(direction)]
    if kind in IMU[:6]:
        fault["axis"] = axis
    if kind in ("stuck", "dead"):
        fault["sensor"] = triad
    names = {
        "gyro_bias": "rate", "gyro_scale": "factor",
        "accelerometer_bias": "acceleration", "accelerometer_scale": "factor",
    }  # fmt: skip
    if kind in names:
        fault[names[kind]] = f"{sign * told * size:.6g} {unit}"
    vectors = {"jump": "position", "drift": "rate", "bias": "angles"}
    if (name := vectors.get(kind)) is not None:
        fault[name] = vector
    if kind == "drift":
        fault["velocity_too"] = bool(pick)
    if kind == "freeze":
        fault["time"] = ("runs", "stands")[pick]
    if kind == "wrong_fixes":
        fault |= {"every": 1 + int(_evenly(rng, (1.0, 20.0))), "smallest": f"{0.02 * min(size, 500):.4g} deg"}
        fault["largest"] = f"{0.04 * min(size, 500):.4g} deg"
    return device, fault


def _evenly(rng, limits):
    """Drawn evenly by the logarithm."""
    return float(np.exp(rng.uniform(*np.log(limits))))


def settings(faults):
    """Overrides of the scenario."""
    by_device = {}
    for device, fault in faults:
        by_device.setdefault(device, []).append(fault)
    return [f"faults.{device}={json.dumps(some)}" for device, some in by_device.items()]


def fly(job):
    """One mission: a row."""
    import shefex_nav as sn
    from shefex_nav.report import trust

    seed, count = job
    faults = drawn(seed, count)
    overrides = ["star_tracker.frames=statistical", *settings(faults)]
    run = sn.fly(sn.Scenario.load(SCENARIOS / "shefex2_andoya.yaml", overrides), seed=seed)
    compared, entry_s = trust.compare(run.data), run.event("entry").t_s
    entry = int(np.argmin(np.abs(compared["attitude"].t_s - entry_s)))
    return {
        "seed": seed,
        "faults": faults,
        "of": {name: judged(one, trust.misleading(one)[0]) for name, one in compared.items()},
        "usable_at_entry": {name: bool(one.usable[entry]) for name, one in compared.items()},
        "attitude_at_entry_deg": float(np.degrees(compared["attitude"].error[entry].max())),
        "said": [(h.t_s, h.source, h.reason) for h in run.data.health if h.source != "gps"],
    }


def judged(one, misleads):
    """Figures of a quantity. trust.Compared, (M,) bool"""
    share, dt_s = np.where(one.usable, one.over_level, 0.0), np.median(np.diff(one.t_s))
    return {
        "misleading_s": float(misleads.sum() * dt_s),
        "from_s": float(one.t_s[misleads.argmax()]) if misleads.any() else None,
        "largest_share": float(share.max()),
        "at_s": float(one.t_s[share.argmax()]),
        "usable": float(one.usable.mean()),
    }


def misleading(row):
    """Quantities that mislead in a mission."""
    return [name for name, one in row["of"].items() if one["misleading_s"]]


def told(row):
    """A row in words."""
    what = "; ".join(" ".join(str(x) for x in fault.values()) for _, fault in row["faults"])
    for name in misleading(row):
        one = row["of"][name]
        yield (
            f"seed {row['seed']}: {name} {one['misleading_s']:.1f} s from T{one['from_s']:+.1f} s, "
            f"error over level at most {one['largest_share']:.1f} at T{one['at_s']:+.1f} s: {what}"
        )


def interval(k, n):
    """95 % of a share (Clopper and Pearson)."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    return low, beta.ppf(0.975, k + 1, n - k) if k < n else 1.0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--faults", type=int, choices=(1, 2), help="of each mission; else drawn")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    rows, jobs = [], [(given.first + k, given.faults) for k in range(given.flights)]
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        for row in pool.map(fly, jobs):
            rows.append(row)
            for line in told(row):
                print(line, flush=True)
            if given.json:
                given.json.write_text(json.dumps(rows, indent=1))
    n = len(rows)
    for name in rows[0]["of"]:
        misled, of = sum(name in misleading(row) for row in rows), [row["of"][name] for row in rows]
        low, high = interval(misled, n)
        usable, largest = np.mean([one["usable"] for one in of]), max(one["largest_share"] for one in of)
        at_entry = sum(row["usable_at_entry"][name] for row in rows)
        print(f"{name} misleads in {misled} of {n} (95 %: {100 * low:.1f} to {100 * high:.1f} %), "
              f"error over level at most {largest:.2f}, usable {100 * usable:.0f} % of the time, "
              f"at entry in {at_entry}")  # fmt: skip
    for device, kind in KINDS:
        of_kind = [row for row in rows if any(d == device and f["fault"] == kind for d, f in row["faults"])]
        bad = sum(bool(misleading(row)) for row in of_kind)
        print(f"    {device} {kind}: {bad} of {len(of_kind)}")
    return int(any(map(misleading, rows)))


if __name__ == "__main__":
    sys.exit(main())
