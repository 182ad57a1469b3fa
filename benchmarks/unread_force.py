"""Accelerometers that are not read, gyros that answer to force: is the attitude honest at any g-sensitivity?

uv run python benchmarks/unread_force.py [--flights 40] [--first 1] [--jobs 2] [--json FILE]

Each flight draws its rocket (default mission by statistics, the same without stars, `rexus_like`, `tight`),
the g-sensitivity of the gyros (0.02 to 200 deg/h/gee, evenly by the logarithm), whether they are good to
3 ppm otherwise, the accelerometer (the axial one in six of ten), whether it is stuck, dead or driven to the
end of its range, and from when on for 3 to 200 s (likewise). The limit of the attitude is 30 deg, so that all
of it is judged, until a minute after the fault. Prints each flight that misleads for over a second; then, by
g-sensitivity, the mean NEES of the attitude (3 degrees of freedom; the mean of instants 5 s apart, from a
second after the fault begins) with the upper 99.5 % bound of one instant a flight, and the share of the
fault's time in which the attitude may be used. Exit code 1 if a flight misleads or a mean exceeds its bound.
"""

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from saturation import ALERT_S, nees, stretches
from scipy.stats import chi2

ROCKETS = {  # scenario, settings, when a fault may begin and when the flight is cut, s
    "default": ("shefex2_andoya", ("star_tracker.frames=statistical",), (-5.0, 300.0), 420.0),
    "rexus": ("rexus_like", (), (-5.0, 90.0), 160.0),
    "nostars": ("no_star_tracker", (), (-5.0, 150.0), 220.0),
    "tight": ("tight", (), (-5.0, 200.0), 250.0),
}
FINE = tuple(
    f"imu.gyro.{name}=3 {unit}"
    for name, unit in (("scale_factor", "ppm"), ("scale_factor_roll", "ppm"), ("misalignment", "urad"))
)
SENSED = 0.02, 200.0  # deg/h/gee
LAST_S = 3.0, 200.0
BINS = 0.0, 0.3, 1.0, 5.0, 30.0, 201.0
EVERY_S, AFTER_S = 5.0, 60.0


def drawn(seed):
    """Rocket, deg/h/gee, axis, kind, begin, end, whether the gyros are good otherwise."""
    rng = np.random.default_rng([seed, 4242])
    name = tuple(ROCKETS)[rng.integers(len(ROCKETS))]
    sensed = float(np.exp(rng.uniform(*np.log(SENSED))))
    axis = "x" if rng.random() < 0.6 else "yz"[rng.integers(2)]
    kind = ("stuck", "dead", "range")[rng.integers(3)]
    begin_s = float(rng.uniform(*ROCKETS[name][2]))
    end_s = begin_s + float(np.exp(rng.uniform(*np.log(LAST_S))))
    return name, sensed, axis, kind, begin_s, end_s, bool(rng.integers(2))


def settings(case):
    """Overrides of the scenario."""
    name, sensed, axis, kind, begin_s, end_s, fine = case
    fault = {"axis": axis, "from": f"{begin_s:.2f} s", "until": f"{end_s:.2f} s"}
    if kind == "range":
        fault |= {"fault": "accelerometer_bias", "acceleration": "200 gee"}
    else:
        fault |= {"fault": kind, "sensor": "accelerometer"}
    told = f"imu.gyro.g_sensitivity={sensed:.5g} deg/h/gee", "requirements.attitude.limit=30 deg"
    return [*ROCKETS[name][1], *told, *(FINE if fine else ()), f"faults.imu={json.dumps([fault])}"]


def fly(seed):
    """One flight: a row."""
    import shefex_nav as sn

    case = drawn(seed)
    name, _, _, _, begin_s, end_s, _ = case
    run = sn.fly(
        sn.Scenario.load(ROCKETS[name][0], settings(case)),
        seed=seed,
        until_s=min(end_s + AFTER_S, ROCKETS[name][3]),
    )
    errors, solution, covariance = run.errors().attitude_b, run.solution, run.data.covariance
    t_s, usable = solution.t_s, ~solution.do_not_use_attitude
    share = np.where(usable, (np.abs(errors) / solution.protection_attitude).max(axis=1), 0.0)
    inside, found = (t_s >= begin_s) & (t_s <= end_s), []
    for at_s in np.arange(begin_s + 1.0, min(end_s, t_s[-1]), EVERY_S):
        k = int(np.argmin(np.abs(covariance.t_s - at_s)))
        j = int(np.argmin(np.abs(t_s - covariance.t_s[k])))
        found.append(nees(covariance.P[k][6:, 6:], errors[j]))
    return {
        "seed": seed,
        "case": case,
        "misleading_s": stretches(share > 1.0),
        "largest_share": float(share.max()),
        "usable": float(usable[inside].mean()),
        "nees": float(np.mean(found)),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        rows = list(pool.map(fly, range(given.first, given.first + given.flights)))
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))
    misled, bad = [row for row in rows if row["misleading_s"] > 0.0], False
    for row in misled:
        print(f"seed {row['seed']}, {row['case']}: {row['misleading_s']:.1f} s")
    most = max(row["largest_share"] for row in rows)
    print(f"{len(misled)} of {len(rows)} mislead for {ALERT_S:g} s, error over level at most {most:.2f}")
    for low, high in pairwise(BINS):
        some = [row for row in rows if low <= row["case"][1] < high]
        if not some:
            continue
        mean, bound = np.mean([row["nees"] for row in some]), chi2.ppf(0.995, 3 * len(some)) / len(some)
        bad |= mean > bound
        print(f"    {low:g} to {high:g} deg/h/gee, {len(some)}: NEES {mean:.2f} (at most {bound:.2f}), "
              f"usable {np.mean([row['usable'] for row in some]):.2f} of the fault")  # fmt: skip
    return int(bool(misled) or bad)


if __name__ == "__main__":
    sys.exit(main())
