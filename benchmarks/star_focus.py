"""Centroids and attitudes of the default camera in and out of focus: are the errors those that are reported?

Rendered still frames at random attitudes, without a flight: the star camera and the star tracker of a
scenario, the spot of another width than the tracker is told. For each width: error over reported sigma of
the centroids of stars that stand alone, by magnitude; the error that repeats with the pixels (the mean error
along an axis by the place within the pixel); and the attitude's normalised squared error, expectation 3.

    uv run python benchmarks/star_focus.py [--samples 400] [--seed 1] [--widths 0.4 0.5 ...] [--rate 0]
"""

import argparse
import time
from itertools import pairwise

import numpy as np

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, quat_normalise, rotvec_between
from shefex_nav.geometry.shutter import row_times
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.onboard.startracker.fit import UNFITTED_PX
from shefex_nav.papers.stills import StillCamera, electrons, still
from shefex_nav.records import Frame, Reason
from shefex_nav.scenario.load import load
from shefex_nav.scenario.params_onboard import nominal_camera, tracker_params
from shefex_nav.world.camera.detector import electronics as electronics_at

WIDTHS = (0.40, 0.45, 0.50, 0.55, 0.60, 0.70, 0.80, 0.90)
BINS = (-2.0, 2.0, 3.0, 4.0, 5.0, 5.5)
ALONE_PX = 8.0  # no other star that is drawn is this near
BORDER_PX = 6.0
MATCH_PX = 2.0


def still_camera(scenario, sigma_psf_px):
    """The scenario's camera on a bench, its spots of the given width."""
    detector, optics = scenario.star_camera.detector, scenario.star_camera.optics
    exposure_s = scenario.star_tracker.exposure.longest
    return StillCamera(
        nominal_camera(scenario),
        sigma_psf_px,
        electronics_at(detector, scenario.star_tracker.exposure.gain),
        detector.background * exposure_s,
        optics.zero_magnitude_flux * exposure_s,
        row_times(exposure_s, 0.0, detector.rows),
    )


def fly(scenario, tracker, width, samples, seed, rate):
    """Frames of one width: stars (n, 8), attitudes (m, 3), seconds (m,)."""
    camera = still_camera(scenario, width)
    sky = load_catalogue(scenario.star_camera.stars.faintest)
    light = electrons(camera, sky.vmag)
    stars, attitudes, seconds = [], [], []
    for k in range(samples):
        rng = np.random.default_rng([seed, k])
        q_ic = quat_normalise(rng.standard_normal(4))
        axis = rng.standard_normal(3)
        omega_c = rate * axis / np.linalg.norm(axis)
        image, xy_px = still(camera, sky.u_i, light, q_ic, rng, omega_c=omega_c)
        frame = Frame(k, 0.0, 0.0, 0.0, scenario.star_tracker.exposure.longest, 0.0, image)
        state, _ = star_tracker.start(tracker, 0.0)
        begin = time.thread_time()
        _, fix, _ = star_tracker.step(tracker, state, frame, star_tracker.NO_CONTEXT)
        seconds.append(time.thread_time() - begin)
        stars += found(fix.detections, xy_px, sky.vmag, camera.pinhole)
        attitudes.append(attitude(fix, q_ic, tracker, camera))
    return np.array(stars), np.array(attitudes), np.array(seconds)


def attitude(fix, q_ic, tracker, camera):
    """(possible, reason, normalised squared error, error [rad])."""
    seen = pixels(camera.pinhole, np.ascontiguousarray(tracker.pairs.stars.u_i @ dcm_from_quat(q_ic)))
    size = np.array([camera.pinhole.width_px, camera.pinhole.height_px])
    with np.errstate(invalid="ignore"):
        n = ((seen > BORDER_PX) & (seen < size - 1 - BORDER_PX)).all(axis=1).sum()
    if fix.reason != Reason.NONE:
        return n >= 4, fix.reason, np.nan, np.nan
    d = rotvec_between(fix.q_ic, q_ic)
    return n >= 4, 0, d @ np.linalg.solve(fix.P_c, d), np.linalg.norm(d)


def found(detections, xy_px, vmag, hole):
    """A row for each star alone: V, found or not, error x, y, NEES, place in the pixel x, y, unfitted."""
    rows = []
    size = np.array([hole.width_px, hole.height_px])
    with np.errstate(invalid="ignore"):
        near = ((xy_px > -10.0) & (xy_px < size + 10.0)).all(axis=1)
        well = ((xy_px > BORDER_PX) & (xy_px < size - BORDER_PX)).all(axis=1) & (vmag < BINS[-1])
    drawn = xy_px[near]
    for place, v in zip(xy_px[well], vmag[well], strict=True):
        if (np.linalg.norm(drawn - place, axis=1) < ALONE_PX).sum() > 1:
            continue
        distance = np.linalg.norm(detections.xy_px - place, axis=1)
        k = int(distance.argmin()) if len(distance) else -1
        if k < 0 or distance[k] > MATCH_PX:
            rows.append((v, 0.0, *[np.nan] * 6))
            continue
        error, P = detections.xy_px[k] - place, detections.P_px[k]
        phase = place - np.rint(place)
        unfitted = min(P[0, 0], P[1, 1]) > UNFITTED_PX**2
        rows.append((v, 1.0, *error, error @ np.linalg.solve(P, error), *phase, unfitted))
    return rows


def swing(stars):
    """Amplitude of the error that repeats with the pixels, sin(2 pi phase), over both axes [px]."""
    error, phase = stars[:, 2:4].ravel(), stars[:, 5:7].ravel()
    a = np.sin(2.0 * np.pi * phase)
    return float(error @ a / (a @ a)), float(np.std(error) / np.sqrt(a @ a))


def show(width, stars, attitudes, seconds):
    """Print one width."""
    seen = stars[stars[:, 1] > 0]
    amplitude, sigma = swing(seen)
    possible = attitudes[:, 0] > 0
    good = np.isfinite(attitudes[:, 2])
    nees = attitudes[good, 2]
    print(
        f"psf {width:.2f} px: {len(seen)} of {len(stars)} stars, unfitted {int(seen[:, 7].sum())}, "
        f"NEES(2) {seen[:, 4].mean():.3f} +- {2 * seen[:, 4].std() / np.sqrt(len(seen)):.3f}, "
        f"rms {np.sqrt((seen[:, 2:4] ** 2).mean()):.4f} px, S-curve {amplitude:+.4f} +- {2 * sigma:.4f} px; "
        f"solved {int((good & possible).sum())} of {int(possible.sum())}, "
        f"refused {int((attitudes[:, 1] == Reason.RESIDUALS).sum())}, "
        f"attitude NEES(3) {nees.mean():.2f} +- {2 * nees.std() / np.sqrt(len(nees)):.2f}, "
        f"rms {np.degrees(np.sqrt((attitudes[good, 3] ** 2).mean())) * 3600:.1f} arcsec, "
        f"median {1e3 * np.median(seconds):.3f} ms"
    )
    for low, high in pairwise(BINS):
        rows = seen[(seen[:, 0] > low) & (seen[:, 0] <= high)]
        if len(rows):
            rms = np.sqrt((rows[:, 2:4] ** 2).mean())
            print(
                f"   V {low:4.1f} .. {high:3.1f}: {len(rows):5d}  rms {rms:.4f}"
                f"  NEES {rows[:, 4].mean():6.3f}  S-curve {swing(rows)[0]:+.4f}  "
                f"unfitted {int(rows[:, 7].sum())}"
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--widths", type=float, nargs="+", default=WIDTHS)
    parser.add_argument("--rate", type=float, default=0.0, help="deg/s, about any axis")
    parser.add_argument("--scenario", default="scenarios/shefex2_andoya.yaml")
    chosen = parser.parse_args()
    scenario = load(chosen.scenario)
    params = tracker_params(scenario, np.zeros(3), np.zeros((0, 2), dtype=np.int64))
    tracker = star_tracker.init(params, load_catalogue(8.0), 1991.25)
    fly(scenario, tracker, 0.8, 3, 99, 0.0)  # warms up
    for width in chosen.widths:
        show(width, *fly(scenario, tracker, width, chosen.samples, chosen.seed, np.radians(chosen.rate)))


if __name__ == "__main__":
    main()
