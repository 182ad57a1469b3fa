"""Star identification on random fields: success against what is possible, wrong attitudes, time.

Fields are made from the Hipparcos catalogue, not from the on-board one. 'possible' is a field with at least
four catalogue stars (three with a prediction); 'wrong' is an attitude more than 0.5 deg off.

    uv run python benchmarks/star_identification.py [--samples 1000] [--methods default pyramid] [--json FILE]
"""

import argparse
import json
import time
from functools import cache

import numpy as np

from shefex_nav.environment.stars import at_epoch, load_catalogue
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply, rotvec_between
from shefex_nav.solve.camera import Camera
from shefex_nav.solve.centroids import solve_centroids

EPOCH = 2012.47
CAMERA = Camera(659, 493, 25.0e-3 / 9.9e-6)
CUT = 5.5  # V
MERGE_PX = 2.0
WRONG = np.radians(0.5)
CASES = {
    "0 false": {},
    "1 false": {"n_false": 1},
    "5 false": {"n_false": 5},
    "15 false": {"n_false": 15},
    "5 false, 0.5 px": {"n_false": 5, "noise_px": 0.5},
    "0 false, 0.5 px": {"noise_px": 0.5},
    "5 false, 30 % missing": {"n_false": 5, "missing": 0.3},
    "1 false, focal +0.5 %": {"n_false": 1, "focal": 1.005},
    "1 false, focal -0.5 %": {"n_false": 1, "focal": 0.995},
    "5 false, 1.7 noise, 1.5 mag": {"n_false": 5, "noise_px": 0.255, "scatter": 0.3},
    "15 false in a cluster": {"n_false": 15, "shape": "cluster"},
    "15 false on a line": {"n_false": 15, "shape": "line"},
    "5 false, zero point 0.3": {"n_false": 5, "zero_point": 0.3},
    "5 false, stars to 6.5": {"n_false": 5, "depth": 6.5},
    "5 false, stars to 5.0": {"n_false": 5, "depth": 5.0},
    "5 false, scatter 0.5 mag": {"n_false": 5, "scatter": 0.5},
    "5 false, doubles +-1 px": {"n_false": 5, "doubles": 0.2},
    "5 false, no flux": {"n_false": 5, "with_flux": False},
    "noise only": {"n_false": None},
    "tracking, 0.05 deg off": {"n_false": 5, "predicted": 0.05},
    "tracking, 10 deg off": {"n_false": 5, "predicted": 10.0},
}


@cache
def sky():
    """Stars to V = 8 at the epoch: directions, magnitudes; brightest first."""
    stars = at_epoch(load_catalogue(8.0), EPOCH)
    order = np.argsort(stars.vmag)
    return np.ascontiguousarray(stars.u_i[order]), stars.vmag[order]


def stars_on_detector(C_ci, depth, focal):
    """(xy_px, vmag) of the stars to V = depth, pairs closer than MERGE_PX as one, brightest first."""
    u_i, vmag = sky()
    n = np.searchsorted(vmag, depth, side="right")
    near = np.flatnonzero(u_i[:n] @ C_ci[2] > 0.98)
    u_c = u_i[near] @ C_ci.T
    xy = focal * CAMERA.focal_length_px * u_c[:, :2] / u_c[:, 2:] + CAMERA.principal_point_px
    size = np.array([CAMERA.width_px, CAMERA.height_px])
    inside = ((xy >= -0.5) & (xy <= size - 0.5)).all(axis=1)
    xy, mag = xy[inside], vmag[near][inside]
    k = 0
    while k < len(mag):
        group = np.hypot(*(xy - xy[k]).T) < MERGE_PX
        group[:k] = False
        if group.sum() > 1:
            flux = 10.0 ** (-0.4 * mag[group])
            xy[k] = flux @ xy[group] / flux.sum()
            mag[k] = -2.5 * np.log10(flux.sum())
            group[k] = False
            xy, mag = xy[~group], mag[~group]
        k += 1
    return xy, mag


def false_places(rng, n, shape):
    """(n, 2) places of false detections."""
    size = np.array([CAMERA.width_px, CAMERA.height_px]) - 1.0
    if shape == "cluster":
        return np.clip(rng.uniform([0.0, 0.0], size) + rng.normal(0.0, 25.0, (n, 2)), 0.0, size)
    if shape == "line":
        start, end = rng.uniform([0.0, 0.0], size, (2, 2))
        return start + rng.random((n, 1)) * (end - start) + rng.normal(0.0, 0.5, (n, 2))
    return rng.uniform([0.0, 0.0], size, (n, 2))


def make_field(
    rng,
    *,
    n_false=0,
    noise_px=0.15,
    scatter=0.1,
    missing=0.0,
    focal=1.0,
    shape="uniform",
    zero_point=0.0,
    depth=CUT,
    doubles=0.0,
    with_flux=True,
    predicted=None,
):
    """One frame: xy_px, flux, prediction, q_ci, catalogue stars in it, stars of the catalogue to CUT."""
    q_ci = rng.standard_normal(4)
    q_ci /= np.linalg.norm(q_ci)
    xy, mag = stars_on_detector(dcm_from_quat(q_ci), depth, focal)
    if n_false is None:
        xy, mag, n_false = xy[:0], mag[:0], int(rng.integers(6, 25))
    keep = rng.random(len(mag)) >= missing
    xy, mag = xy[keep], mag[keep]
    usable = int((mag <= CUT).sum())
    xy = xy + rng.normal(0.0, noise_px, xy.shape)
    shifted = rng.random(len(mag)) < doubles
    xy[shifted] += rng.uniform(-1.0, 1.0, (shifted.sum(), 2))
    mag = mag + rng.normal(0.0, scatter, len(mag))
    xy = np.vstack([xy, false_places(rng, n_false, shape)])
    mag = np.concatenate([mag, rng.choice(sky()[1][: np.searchsorted(sky()[1], CUT)], n_false)])
    mix = rng.permutation(len(mag))
    flux = 1000.0 * 10.0 ** (-0.4 * (mag[mix] + zero_point)) if with_flux else None
    prediction = None
    if predicted is not None:
        axis = rng.standard_normal(3)
        off = np.radians(predicted) * axis / np.linalg.norm(axis)
        prediction = (quat_multiply(quat_from_rotvec(off), q_ci), np.eye(3) * np.radians(0.05) ** 2)
    return np.ascontiguousarray(xy[mix]), flux, prediction, q_ci, usable


def run_case(case, samples, seed, method="default"):
    """Counts, times [ms] and errors of one case."""
    rng = np.random.default_rng([seed, list(CASES).index(case)])
    least = 3 if CASES[case].get("predicted") == 0.05 else 4
    rows = []
    fields = [make_field(rng, **CASES[case]) for _ in range(samples)]
    for xy, flux, prediction, q_ci, usable in fields:
        options = {} if prediction is None or method == "pyramid" else {"prediction": prediction}
        begin = time.thread_time()
        found = solve_centroids(xy, flux, camera=CAMERA, epoch=EPOCH, method=method, **options)
        elapsed = 1e3 * (time.thread_time() - begin)
        ok = found.status == "ok"
        error = np.linalg.norm(rotvec_between(found.q_ci, q_ci)) if ok else np.nan
        rows.append((usable, ok, error, elapsed))
    usable, ok, error, elapsed = (np.array(column) for column in zip(*rows, strict=True))
    right = ok & (error < WRONG)
    if CASES[case].get("n_false", 0) is None:
        right[:] = False
    four = usable == 4
    return {
        "case": case,
        "method": method,
        "samples": samples,
        "possible": int((usable >= least).sum()),
        "solved": int((right & (usable >= least)).sum()),
        "wrong": int((ok & ~right).sum()),
        "four_stars": int(four.sum()),
        "four_solved": int((right & four).sum()),
        "ms": {name: float(np.percentile(elapsed, q)) for name, q in QUANTILES.items()},
    }


QUANTILES = {"median": 50, "p95": 95, "p99": 99, "max": 100}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", nargs="*", default=list(CASES))
    parser.add_argument("--methods", nargs="*", default=["default", "pyramid"])
    parser.add_argument("--json", help="write the results there")
    args = parser.parse_args()
    results = []
    print(
        f"{'case':28s} {'method':8s} {'solved':>6s} / {'possible':8s}      % {'four stars':>11s} "
        f"{'wrong':>5s}   {'median':>6s} {'p95':>7s} {'p99':>7s} {'max ms':>7s}"
    )
    for method in args.methods:
        run_case(args.cases[0], 20, 0, method)  # compile
        for case in args.cases:
            r = run_case(case, args.samples, args.seed, method)
            results.append(r)
            share = 100.0 * r["solved"] / max(r["possible"], 1)
            print(
                f"{case:28s} {method:8s} {r['solved']:6d} / {r['possible']:<8d} {share:6.2f} "
                f"{r['four_solved']:5d}/{r['four_stars']:<5d} {r['wrong']:5d}   "
                + " ".join(f"{r['ms'][name]:7.3f}" for name in QUANTILES),
                flush=True,
            )
    if args.json:
        with open(args.json, "w", encoding="utf-8") as file:
            json.dump(results, file, indent=1)


if __name__ == "__main__":
    main()
