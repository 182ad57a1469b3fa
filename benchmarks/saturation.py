"""Rockets that spin faster than their gyros can show: is the solution honest during and after it?

uv run python benchmarks/saturation.py [--flights 30] [--first 0] [--jobs 2] [--json FILE]

For each flight the range of the gyros is drawn, so that the greatest spin is 0.5 to 3 times it (evenly by its
logarithm), and all errors of the sensors. Rockets: the default mission with and without its star tracker,
a student rocket, and the same without its yo-yo. Prints a row for every flight: for how long the attitude is
wrong by more than its protection level for over a second while it may be used, the greatest such ratio, and
the NEES of position, velocity and attitude (9 degrees of freedom) at entry, or at the end of the flight. Exit
code 1 if a flight misleads, or if the mean NEES is outside the 99 % bounds of chi-square: both where the
attitude is known in the end (to `KNOWN_DEG`); elsewhere the upper one, for an angle of which nothing is known
has no normal error.
"""

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from scipy.stats import chi2

ROCKETS = {  # scenario, settings, greatest spin in deg/s
    "shefex2": ("shefex2_andoya", ("star_tracker.frames=statistical",), 540.0),
    "shefex2, no stars": ("no_star_tracker", (), 540.0),
    "rexus": ("rexus_like", (), 1440.0),
    "rexus, no yo-yo": ("rexus_like", ("vehicle.yo_yo=null",), 1440.0),
}
ALERT_S = 1.0  # for so long an error may be beyond its level
RATIOS = 0.5, 3.0
KNOWN_DEG = 5.0  # sigma of the attitude


def fly(rocket, seed):
    """One flight: a row."""
    import shefex_nav as sn

    name, settings, spin = ROCKETS[rocket]
    low, high = np.log(RATIOS)
    ratio = float(np.exp(np.random.default_rng([seed, 24]).uniform(low, high)))
    scenario = sn.Scenario.load(name, [f"imu.gyro.range={spin / ratio:.2f} deg/s", *settings])
    run = sn.fly(scenario, seed=seed)
    errors, solution, covariance = run.errors(), run.solution, run.data.covariance
    t_s, usable = solution.t_s, ~solution.do_not_use_attitude
    over = usable & (np.abs(errors.attitude_b) > solution.protection_attitude).any(axis=1)
    share = np.where(usable, (np.abs(errors.attitude_b) / solution.protection_attitude).max(axis=1), 0.0)
    times = {event.name: event.t_s for event in run.events}
    end_s = min(times.get("entry", t_s[-1]), t_s[-1])
    k = int(np.searchsorted(covariance.t_s, end_s + 1e-6)) - 1
    j = int(np.argmin(np.abs(t_s - covariance.t_s[k])))
    error = np.concatenate([errors.position_i[j], errors.velocity_i[j], errors.attitude_b[j]])
    return {
        "rocket": rocket,
        "seed": seed,
        "ratio": round(ratio, 3),
        "misleading_s": stretches(over),
        "largest_share": float(share.max()),
        "usable": float(usable.mean()),
        "nees": nees(covariance.P[k], error),
        "attitude_deg": float(np.degrees(np.linalg.norm(errors.attitude_b[j]))),
        "sigma_deg": float(np.degrees(np.sqrt(np.trace(covariance.P[k][6:, 6:])))),
    }


def stretches(over, rate_hz=100.0):
    """Seconds in stretches of ticks that are longer than `ALERT_S`. (N,) bool"""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], over.astype(int), [0]])))
    lengths = (edges[1::2] - edges[::2]) / rate_hz
    return float(lengths[lengths > ALERT_S].sum())


def nees(P, error):
    """Normalised error squared. (9, 9), (9,)"""
    sigma = np.sqrt(np.diag(P))
    return float((error / sigma) @ np.linalg.solve(P / np.outer(sigma, sigma), error / sigma))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=30, help="of each rocket")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--rocket", choices=ROCKETS, action="append")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    seeds, bad, rows = range(given.first, given.first + given.flights), False, []
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        for rocket in given.rocket or ROCKETS:
            found = list(pool.map(fly, [rocket] * len(seeds), seeds))
            rows += found
            misled = [row for row in found if row["misleading_s"] > 0.0]
            bad |= bool(misled)
            for row in found:
                print(
                    "   ", *(f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in row.items())
                )
            print(f"{rocket}: {len(misled)} of {len(found)} mislead")
            for words, is_known in (("known", True), ("unknown", False)):
                values = [row["nees"] for row in found if (row["sigma_deg"] < KNOWN_DEG) == is_known]
                if not values:
                    continue
                low, high = chi2.ppf([0.005, 0.995], 9 * len(values)) / len(values)
                mean = float(np.mean(values))
                bad |= mean > high or (is_known and mean < low)
                bounds = f"{low:.2f} to {high:.2f}" if is_known else f"at most {high:.2f}"
                print(f"    attitude {words} in {len(values)}: mean NEES {mean:.2f} ({bounds})")
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
