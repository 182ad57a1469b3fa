"""What deep matching buys: attitudes of rendered SHEFEX-2 pictures with and without it, against the bound.

Each picture is of a drawn attitude, with all stars to V 8 and 0.1 mag of scatter. The bound is that of
Cramer and Rao for the pixels of all these stars, whose light and spot are known. --told multiplies the noise
that the centroids are said to have. The sigma of the focal length is zero, as in the pictures.

    uv run python benchmarks/deep_matching.py [--seed 62077] [--each 320] [--told 1] [--deepest 7]
"""

import argparse
from time import process_time

import numpy as np
from scipy.stats import chi2

from shefex_nav.environment.stars import aberrate, at_epoch, load_catalogue
from shefex_nav.frames import camera_file
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, rotvec_between
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.onboard.startracker import objects
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.papers.stills import StillCamera, electrons, random_attitude, still
from shefex_nav.records import Reason
from shefex_nav.settings import changed
from shefex_nav.world.camera.detector import Electronics

YEAR, V_I = 2012.47, np.array([-29000.0, 1000.0, 500.0])
PSF_PX, READ_NOISE, SKY, SCATTER_MAG = 0.8, 16.0, 20.0, 0.1  # electrons
WRONG_DEG, ARCSEC = 0.05, np.degrees(1.0) * 3600.0
SPOT = np.arange(-6, 7)  # px


def trackers(deepest):
    """Trackers without and with deep matching, and the camera that makes the pictures."""
    params = camera_file.read("shefex2_andoya").params
    params = params._replace(earth_velocity_i=V_I, camera=params.camera._replace(focal_length_error=0.0))
    settings, model = params.settings, params.camera
    zero = model.zero_flux * model.electrons_per_dn
    body = StillCamera(
        model.pinhole, PSF_PX, Electronics(READ_NOISE, 30000.0, model.electrons_per_dn, 16.0), SKY, zero
    )
    made = [
        star_tracker.init(
            params._replace(settings=changed(settings, {"identification.deepest": depth})),
            load_catalogue(8.0),
            YEAR,
        )
        for depth in (None, deepest)
    ]
    return made, body


def bound(body, seen_i, light, q_ic):
    """Variances (3,) [rad^2] that no attitude from the pixels of a picture falls below."""
    hole = body.pinhole
    xy_px = pixels(hole, np.ascontiguousarray(seen_i @ dcm_from_quat(q_ic)))
    with np.errstate(invalid="ignore"):
        on = ((xy_px > 0.0) & (xy_px < [hole.width_px - 1, hole.height_px - 1])).all(axis=1)
    along = np.exp(-0.5 * (SPOT / PSF_PX) ** 2) / np.sqrt(2.0 * np.pi) / PSF_PX
    spot, information = along[:, None] * along, np.zeros((3, 3))
    slope = spot * SPOT / PSF_PX**2
    for one, G in zip(light[on], turn_jacobians(hole, np.ascontiguousarray(xy_px[on])), strict=True):
        told = (one**2 * slope**2 / (READ_NOISE**2 + SKY + one * spot)).sum()
        information += told * G.T @ G
    return np.diag(np.linalg.inv(information))


def answers(made, body, args):
    """Rows (error (3,), sigma (3,), NEES, stars, ms) per tracker and picture, NaN unsolved; bounds (n, 3)."""
    sky = at_epoch(load_catalogue(8.0), YEAR)
    seen_i, rows, bounds = aberrate(sky.u_i, V_I), np.full((2, args.each, 9), np.nan), []
    context = star_tracker.NO_CONTEXT._replace(velocity_i=V_I)
    settings, model = made[0].params.settings, made[0].params.camera
    for k in range(args.each):
        rng = np.random.default_rng([args.seed, k])
        q_ic = random_attitude(rng)
        light = electrons(body, sky.vmag + rng.normal(0.0, SCATTER_MAG, len(sky.vmag)))
        image, _ = still(body, seen_i, light, q_ic, rng)
        found, _ = objects.detect(settings.detection, model, image)
        found = found._replace(P_px=found.P_px * args.told**2)
        bounds.append(bound(body, seen_i, light, q_ic))
        for n, one in enumerate(made):
            began = process_time()
            _, reason, solution, stars = star_tracker.attitude_with_stars(one, found, context)
            ms = 1e3 * (process_time() - began)
            if reason == Reason.NONE:
                d, P_c = rotvec_between(solution[0], q_ic), solution[1]
                nees = d @ np.linalg.solve(P_c, d)
                rows[n, k] = *d, *np.sqrt(np.diag(P_c)), nees, len(stars.hip), ms
    return rows, np.array(bounds)


def main():
    """Print a line without and one with deep matching, of the pictures that both solve."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=62077)
    parser.add_argument("--each", type=int, default=320)
    parser.add_argument("--told", type=float, default=1.0, help="factor of the noise that is said")
    parser.add_argument("--deepest", type=float, default=7.0, help="V")
    args = parser.parse_args()
    rows, bounds = answers(*trackers(args.deepest), args)
    both = np.isfinite(rows[:, :, 0]).all(axis=0)
    n, least = both.sum(), np.sqrt(bounds[both].mean(axis=0))
    low, high = chi2.ppf([0.0005, 0.9995], 3 * n) / (3 * n)
    print(f"{n} of {args.each} pictures solved, bound {np.round(least * ARCSEC, 2)} arcsec rms")
    for words, one in zip(("without", "with"), rows, strict=True):
        wrong = np.linalg.norm(one[both, :2], axis=1) > np.radians(WRONG_DEG)
        rms = np.sqrt((one[both, :3] ** 2).mean(axis=0))
        sigma = np.median(one[both, 3:6] / np.sqrt(bounds[both]), axis=0)
        print(
            f"{words:8s} stars {one[both, 7].mean():.1f}, wrong {wrong.sum()}, rms over bound "
            f"{np.round(rms / least, 2)}, sigma over bound {np.round(sigma, 2)}, "
            f"NEES {one[both, 6].mean() / 3.0:.2f} ({low:.2f} to {high:.2f}), "
            f"{np.median(one[both, 8]):.2f} ms"
        )


if __name__ == "__main__":
    main()
