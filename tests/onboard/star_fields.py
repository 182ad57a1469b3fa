"""Star fields of the SHEFEX-2 camera for the tests of the star tracker: lists of centroids, and frames."""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.special import erf

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import pinhole, pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_normalise
from shefex_nav.onboard.startracker import tracker
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.settings import changed

YEAR = 2012.47
CAMERA = pinhole(659, 493, 24.95e-3 / 9.9e-6)  # SHEFEX-2: calibrated focal length over pixel size
DEG = np.pi / 180.0

CATALOGUE = replace(STAR_TRACKER.catalogue, merge_radius=3.0 / CAMERA.focal_length_px)
DETECT, EXPOSURE = STAR_TRACKER.detection, STAR_TRACKER.exposure
IDENTIFY = replace(STAR_TRACKER.identification, method="pyramid", centroid_error=0.25)
MULTIPOLE = replace(
    IDENTIFY,
    method="multipole",
    fewest_stars=5,
    most_centroids=60,
    tolerance=3e-4,
    magnitude_tolerance=0.5,
)
MODEL = CameraModel(CAMERA, sun_exclusion=90.0 * DEG, earth_exclusion=45.0 * DEG)
TRACKER = tracker.TrackerParams(
    settings=replace(
        STAR_TRACKER,
        latency=0.020,
        highest_rate=2.5 * DEG,
        catalogue=CATALOGUE,
        identification=IDENTIFY,
    ),
    camera=MODEL,
    earth_velocity_i=np.array([-29000.0, 1000.0, 500.0]),
)


def tracker_with(params, **values):
    """TrackerParams with other settings: {"identification.method": ...}, keys with `__` for the dot."""
    dotted = {name.replace("__", "."): value for name, value in values.items()}
    return params._replace(settings=changed(params.settings, dotted))


@cache
def all_stars():
    return load_catalogue(8.0)


@cache
def ready_tracker():
    return tracker.init(TRACKER, all_stars(), YEAR)


def random_attitude(rng):
    return quat_normalise(rng.standard_normal(4))


def stars_in_frame(stars, q_ic, margin_px=-0.5):
    """(rows, xy_px) of the catalogue stars on the detector, at least margin_px inside its outer pixels."""
    u_c = np.ascontiguousarray(stars.u_i @ dcm_from_quat(q_ic))
    xy_px = pixels(CAMERA, u_c)
    size = np.array([CAMERA.width_px, CAMERA.height_px])
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero(((xy_px >= margin_px) & (xy_px <= size - 1 - margin_px)).all(axis=1))
    return rows, xy_px[rows]


def centroid_list(rng, stars, q_ic, n_false, noise_px=0.15, magnitude_scatter=0.1):
    """(u_c, flux, star) as a detector would give them, brightest first; star is -1 for a false object."""
    rows, xy_px = stars_in_frame(stars, q_ic)
    xy_px = xy_px + rng.normal(0.0, noise_px, xy_px.shape)
    magnitudes = stars.vmag[rows] + rng.normal(0.0, magnitude_scatter, len(rows))
    false_xy = rng.uniform([0.0, 0.0], [CAMERA.width_px - 1, CAMERA.height_px - 1], (n_false, 2))
    xy_px = np.vstack([xy_px, false_xy])
    magnitudes = np.concatenate([magnitudes, rng.uniform(1.5, 5.5, n_false)])
    star = np.concatenate([rows, np.full(n_false, -1)])
    order = np.argsort(magnitudes)
    return unit_vectors(CAMERA, xy_px[order]), 10.0 ** (-0.4 * magnitudes[order]), star[order]


def spot(image, x, y, signal, sigma_px=0.8, streak_px=0.0, angle=0.0):
    """Add a Gaussian spot, integrated over pixels and along a streak about its middle."""
    n = max(1, int(10 * streak_px))
    rows, columns = np.arange(image.shape[0]), np.arange(image.shape[1])
    scale = 1.0 / (sigma_px * np.sqrt(2.0))
    for k in range(n):
        along = ((k + 0.5) / n - 0.5) * streak_px
        dx = columns - (x + along * np.cos(angle))
        dy = rows - (y + along * np.sin(angle))
        near_x, near_y = np.abs(dx) < 8, np.abs(dy) < 8
        gx = 0.5 * (erf((dx[near_x] + 0.5) * scale) - erf((dx[near_x] - 0.5) * scale))
        gy = 0.5 * (erf((dy[near_y] + 0.5) * scale) - erf((dy[near_y] - 0.5) * scale))
        image[np.ix_(near_y, near_x)] += signal / n * np.outer(gy, gx)


def digitise(rng, light, background=60.0, read_noise=16.0, electrons_per_dn=7.4, black_level=10.0):
    """8-bit frame from electrons: Poisson and read noise, as a camera at 24 dB gain has them."""
    electrons = rng.poisson(light + background) + rng.normal(0.0, read_noise, light.shape)
    return np.clip(np.rint(electrons / electrons_per_dn + black_level), 0, 255).astype(np.uint8)


def signal(vmag, exposure_s=0.05):
    """Electrons of a star: 2.5e6 per second at magnitude zero."""
    return 2.5e6 * exposure_s * 10.0 ** (-0.4 * vmag)


def sky_frame(rng, stars, q_ic, streak_px=0.0, angle=0.0):
    """Frame of all catalogue stars in view."""
    light = np.zeros((CAMERA.height_px, CAMERA.width_px))
    rows, xy_px = stars_in_frame(stars, q_ic, margin_px=-3.0)
    for row, (x, y) in zip(rows, xy_px, strict=True):
        spot(light, x, y, signal(stars.vmag[row]), streak_px=streak_px, angle=angle)
    return digitise(rng, light)
