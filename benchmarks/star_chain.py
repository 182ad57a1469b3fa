"""The star tracker's whole chain on rendered still frames: detect, identify, attitude.

The camera is that of SHEFEX-2 with spots of 1 px, 504 electrons from a star of V 5.5, 4 electrons for a grey
value, a background of 10 grey values (of light: it has shot noise), read noise of 2, 8 bits. All stars to V 8
are drawn, at random attitudes. Prints success, wrong attitudes, times and the errors of the centroids by
magnitude beside their Cramer-Rao bound: the least error of any unbiased estimate of the place of a Gaussian
spot, integrated over pixels, whose place, light and background are unknown, from pixels with Poisson noise,
read noise and the noise of rounding; pixels that saturate count for nothing.

    uv run python benchmarks/star_chain.py [--samples 1000] [--seed 1] [--centroid fit] [--json]
"""

import argparse
import json
import sys
import time
from itertools import pairwise

import numpy as np
from scipy.special import erf

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import pinhole, pixels
from shefex_nav.geometry.rotation import dcm_from_quat, quat_normalise, rotvec_between
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.shefex2 import frames as imaging
from shefex_nav.papers.stills import StillCamera, electrons, still
from shefex_nav.records import Frame, Reason
from shefex_nav.settings import changed
from shefex_nav.world.camera.detector import Electronics

PER_DN, SIGMA_PX, READ_DN, BACKGROUND_DN = 4.0, 1.0, 2.0, 10.0
CAMERA = StillCamera(
    pinhole(659, 493, 24.95e-3 / 9.9e-6),
    SIGMA_PX,
    Electronics(READ_DN * PER_DN, 1e9, PER_DN, 0.0),
    BACKGROUND_DN * PER_DN,
    504.0 * 10.0 ** (0.4 * 5.5),
)
DEPTH = 5.5  # V of the on-board catalogue
BINS = [-2.0, 2.0, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5]
WRONG = np.radians(0.5)
MATCH_PX = 2.0  # a detection this near to a star is that star
ALONE_PX = 8.0  # no other star to V 8 is this near
BORDER_PX = 4.0  # stars nearer to the border are cut off, and what is cut off is not taken


def params(method, centroid, scan):
    """TrackerParams of the camera on the bench."""
    known = imaging.MODEL._replace(pinhole=CAMERA.pinhole, electrons_per_dn=PER_DN)
    changes = {
        "centroid_floor": 0.02,
        "outlier_sigma": 4.5,
        "exposure.gain": 0.0,
        "detection.scan": scan,
        "detection.centroid": centroid,
        "catalogue.faintest": DEPTH,
        "catalogue.merge_radius": 3.0 / CAMERA.pinhole.focal_length_px,
        "identification.method": method,
        "identification.centroid_error": 0.15,
        "identification.magnitude_error": 0.2,
    }
    return star_tracker.TrackerParams(changed(STAR_TRACKER, changes), known, np.zeros(3))


def cramer_rao(xy_px, light):
    """Lower bound of the variance of the place of a star alone: (2,) px^2. Place, electrons."""
    half = 8
    middle = np.rint(xy_px)
    edges = np.arange(-half, half + 2) - 0.5
    z = (edges[None] + middle[:, None] - xy_px[:, None]) / SIGMA_PX
    share = np.diff(0.5 * (1.0 + erf(z / np.sqrt(2.0))), axis=1)
    slope = -np.diff(np.exp(-0.5 * z**2), axis=1) / (np.sqrt(2.0 * np.pi) * SIGMA_PX)
    spot = np.outer(share[1], share[0])
    mean = light * spot + CAMERA.background_electrons
    variance = mean + (READ_DN * PER_DN) ** 2 + PER_DN**2 / 12.0
    weight = np.where(mean / PER_DN < 254.5, 1.0 / variance, 0.0)
    to_x, to_y = light * np.outer(share[1], slope[0]), light * np.outer(slope[1], share[0])
    jacobian = np.stack([to_x, to_y, spot, np.ones_like(spot)]).reshape(4, -1)
    information = (jacobian * weight.ravel()) @ jacobian.T
    return np.diag(np.linalg.inv(information))[:2]


def run(samples, seed, method, centroid, scan):
    """Frames one by one: (outcomes, stars), tables of what came of each frame and each found star."""
    tracker = star_tracker.init(params(method, centroid, scan), load_catalogue(8.0), 1991.25)
    sky = load_catalogue(8.0)
    light = electrons(CAMERA, sky.vmag)
    outcomes, stars = [], []
    for k in range(-3, samples):  # the first ones warm up
        rng = np.random.default_rng([seed, k + 3])
        q_ic = quat_normalise(rng.standard_normal(4))
        image, xy_px = still(CAMERA, sky.u_i, light, q_ic, rng)
        frame = Frame(k, 0.0, 0.0, 0.0, 0.05, 0.0, image)
        state, _ = star_tracker.start(tracker, 0.0)
        begin, cpu = time.perf_counter(), time.thread_time()
        _, fix, _ = star_tracker.step(tracker, state, frame, star_tracker.NO_CONTEXT)
        wall_s, cpu_s = time.perf_counter() - begin, time.thread_time() - cpu
        if k >= 0:
            seen = star_places(tracker.pairs.stars, q_ic)
            n_stars = int(inside(seen[0], BORDER_PX).sum())
            outcomes.append(outcome(fix, q_ic, (wall_s, cpu_s), n_stars, xy_px))
            stars += found_stars(fix.detections, *seen, xy_px)
    return np.array(outcomes), np.array(stars)


def star_places(stars, q_ic):
    """Places and magnitudes of the on-board catalogue's stars: pairs that are one spot are one star."""
    xy_px = pixels(CAMERA.pinhole, np.ascontiguousarray(stars.u_i @ dcm_from_quat(q_ic)))
    return xy_px, stars.vmag


def inside(xy_px, margin_px):
    """Which places are on the detector, and at least margin_px from its border."""
    size = np.array([CAMERA.pinhole.width_px - 1, CAMERA.pinhole.height_px - 1])
    with np.errstate(invalid="ignore"):
        return ((xy_px >= margin_px) & (xy_px <= size - margin_px)).all(axis=1)


def outcome(fix, q_ic, seconds, n_stars, drawn_px):
    """Solved, wrong, error [rad], wall and CPU time [s], catalogue stars, false detections, detections."""
    solved = fix.reason == Reason.NONE
    error = np.linalg.norm(rotvec_between(fix.q_ic, q_ic)) if solved else np.nan
    drawn = drawn_px[inside(drawn_px, -5.0)]
    found = fix.detections.xy_px
    distance = np.linalg.norm(found[:, None] - drawn[None], axis=2).min(axis=1, initial=np.inf)
    false = int((distance > 2.0 * MATCH_PX).sum())
    return solved, solved and error > WRONG, error, *seconds, n_stars, false, len(found)


def found_stars(detections, xy_px, vmag, drawn_px):
    """A row for each catalogue star well inside: V, found, alone, error x, y, NEES, bound x, y."""
    rows = []
    near = drawn_px[inside(drawn_px, -10.0)]
    for place, v in zip(xy_px[inside(xy_px, BORDER_PX)], vmag[inside(xy_px, BORDER_PX)], strict=True):
        distance = np.linalg.norm(detections.xy_px - place, axis=1)
        k = int(distance.argmin()) if len(distance) else -1
        if k < 0 or distance[k] > MATCH_PX:
            rows.append((v, 0.0, *[np.nan] * 6))
            continue
        alone = (np.linalg.norm(near - place, axis=1) < ALONE_PX).sum() <= 1
        error = detections.xy_px[k] - place
        nees = error @ np.linalg.solve(detections.P_px[k], error)
        bound = cramer_rao(place, float(electrons(CAMERA, v)))
        rows.append((v, 1.0, float(alone), *error, nees, *bound))
    return rows


def summary(outcomes, stars):
    """What is printed, as numbers."""
    solved, wrong, error, wall_s, cpu_s, n_stars, false, found = outcomes.T
    possible = n_stars >= 4
    wall_ms = 1e3 * wall_s
    result = {
        "frames": len(outcomes),
        "possible": int(possible.sum()),
        "solved": int(solved.sum()),
        "solved_of_possible": int((solved[possible] > 0).sum()),
        "wrong": int(wrong.sum()),
        "median_ms": float(np.median(wall_ms)),
        "median_cpu_ms": float(1e3 * np.median(cpu_s)),
        "p95_ms": float(np.percentile(wall_ms, 95)),
        "median_error_arcsec": float(np.degrees(np.nanmedian(error)) * 3600.0),
        "false_per_frame": float(false.mean()),
        "objects_per_frame": float(found.mean()),
    }
    seen = stars[:, 1] > 0
    result["catalogue_stars"], result["stars_found"] = len(stars), int(seen.sum())
    result["rms_px_all"] = float(np.sqrt((stars[seen, 3:5] ** 2).mean()))
    alone = seen & (stars[:, 2] > 0)
    result["rms_px_alone"] = float(np.sqrt((stars[alone, 3:5] ** 2).mean()))
    result["by_magnitude"] = [magnitude_bin(stars, low, high) for low, high in pairwise(BINS)]
    return result


def magnitude_bin(stars, low, high):
    """Errors of the stars of one bin; those that stand alone against their bound."""
    rows = stars[(stars[:, 0] > low) & (stars[:, 0] <= high)]
    alone = rows[(rows[:, 1] > 0) & (rows[:, 2] > 0)]
    rms, bound = np.sqrt((alone[:, 3:5] ** 2).mean()), np.sqrt(alone[:, 6:8].mean())
    return {
        "vmag": [low, high],
        "stars": len(rows),
        "found": int(rows[:, 1].sum()),
        "alone": len(alone),
        "rms_px": float(rms),
        "bound_px": float(bound),
        "ratio": float(rms / bound),
        "nees": float(alone[:, 5].mean()),
        "largest_px": float(np.abs(alone[:, 3:5]).max(initial=0.0)),
        "rms_px_all": float(np.sqrt(np.nanmean(rows[:, 3:5] ** 2))),
    }


def show(result):
    """Print the tables."""
    print(
        f"{result['frames']} frames, {result['possible']} with four catalogue stars clear of the border: "
        f"{result['solved_of_possible']} of these solved, {result['solved']} in all, {result['wrong']} wrong"
    )
    print(
        f"chain: median {result['median_ms']:.3f} ms (CPU {result['median_cpu_ms']:.3f} ms), 95th percentile "
        f"{result['p95_ms']:.3f} ms; attitude error, median {result['median_error_arcsec']:.1f} arcsec"
    )
    print(f"false detections: {result['false_per_frame']:.3f} of {result['objects_per_frame']:.1f} a frame")
    print(
        f"stars to V {DEPTH}: {result['stars_found']} of {result['catalogue_stars']} found; error per axis: "
        f"{result['rms_px_all']:.4f} px rms, {result['rms_px_alone']:.4f} px of those that stand alone"
    )
    print("\n    V        stars  found  alone  rms px   bound   ratio  NEES(2)  largest  rms of all")
    for row in result["by_magnitude"]:
        print(
            f"{row['vmag'][0]:4.1f} .. {row['vmag'][1]:3.1f}  {row['stars']:5d}  {row['found']:5d}"
            f"  {row['alone']:5d}  {row['rms_px']:.4f}  {row['bound_px']:.4f}  {row['ratio']:5.2f}"
            f"  {row['nees']:7.2f}  {row['largest_px']:7.3f}  {row['rms_px_all']:10.4f}"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="bayes")
    parser.add_argument("--centroid", default="fit")
    parser.add_argument("--scan", default="sequential")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    chosen = parser.parse_args()
    outcomes, stars = run(chosen.samples, chosen.seed, chosen.method, chosen.centroid, chosen.scan)
    result = {**vars(chosen), **summary(outcomes, stars)}
    if chosen.json:
        json.dump(result, sys.stdout)
        print()
    else:
        show(result)


if __name__ == "__main__":
    main()
