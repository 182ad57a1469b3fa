"""Star fields of the brightness-referenced paper (BRIGHT, sections 4.1 and 5.1), as lists of centroids.

The camera is the ZY-3 star tracker's, 20 x 20 deg, the catalogue Hipparcos with Hp < 5. What the text leaves
open: a false star has the magnitude of a random star of the catalogue; stars closer than 2 px are one, as no
camera would see two (7 of the 1471). The text says 20 x 20 deg, but its counts of images with few stars are
far from those of a square field and near those of a round one 20 deg across, so both shapes are drawn.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import pinhole, pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.papers.bright.published import BRIGHT
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.stills import random_attitude

ARCSEC = np.pi / 180.0 / 3600.0
EPOCH = 2012.5  # the flight of ZY-3
CAMERA = pinhole(
    BRIGHT["camera"]["width_px"],
    BRIGHT["camera"]["height_px"],
    1e3 * BRIGHT["camera"]["focal_length_mm"] / BRIGHT["camera"]["pixel_um"],
)
COS_ROUND = np.cos(np.radians(0.5 * BRIGHT["camera"]["fov_deg"][0]))
MERGE_PX = 2.0
SIGMA_PX = BRIGHT["camera"]["centroid_error_arcsec_3sigma"] / 3.0 * ARCSEC * CAMERA.focal_length_px
# Three standard deviations of an angle. Voting takes 3 epsilon (section 2.2), epsilon the paper's 5 arcsec.
TOLERANCE = 3.0 * np.sqrt(2.0) * SIGMA_PX / CAMERA.focal_length_px
VOTING_TOLERANCE = 3.0 * BRIGHT["camera"]["centroid_error_arcsec_3sigma"] * ARCSEC
MAGNITUDE_SIGMA = BRIGHT["protocol"]["magnitude_sigma"]
# A star that looks brighter than this is brighter than magnitude 3 beyond three standard deviations.
REFERENCE = BRIGHT["protocol"]["reference_star_mag"] - 3.0 * MAGNITUDE_SIGMA

IDENTIFY = replace(
    STAR_TRACKER.identification,
    tolerance=TOLERANCE,
    most_centroids=BRIGHT["protocol"]["brightest_used"],
    centroid_error=SIGMA_PX,
    magnitude_error=MAGNITUDE_SIGMA,
)
MODEL = CameraModel(CAMERA)
REFERENCE_FLUX = 10.0 ** (-0.4 * REFERENCE)


class Field(NamedTuple):
    """What one frame shows, brightest first."""

    u_c: np.ndarray  # (n, 3)
    flux: np.ndarray  # (n,) 1 at magnitude 0
    star: np.ndarray  # (n,) row of the catalogue, -1 for a false star


def on_board(system="Hp", limit=BRIGHT["camera"]["catalogue_mag"], merge_px=MERGE_PX):
    """Stars brighter than the limit, as the paper counts them. -> OnboardCatalogue."""
    merge = merge_px / CAMERA.focal_length_px
    settings = replace(STAR_TRACKER.catalogue, system=system, faintest=limit, merge_radius=merge)
    return catalogue.build(settings, load_catalogue(99.0), EPOCH, inclusive=False)


@lru_cache(maxsize=1)
def pairs():
    """Tables of pairs: StarPairs to 20 deg, as in the paper, and to the diagonal of the detector for ours."""
    stars = on_board()
    half_diagonal = 0.5 * np.hypot(CAMERA.width_px, CAMERA.height_px)
    diagonal = 2.0 * np.arctan(half_diagonal / CAMERA.focal_length_px)
    side = np.radians(BRIGHT["camera"]["fov_deg"][0])
    return catalogue.pair_table(stars, side), catalogue.pair_table(stars, diagonal)


def in_view(stars, q_ic, is_round):
    """Stars that an attitude shows: rows, (n, 2) px."""
    u_c = np.ascontiguousarray(stars.u_i @ dcm_from_quat(q_ic))
    near = np.flatnonzero(u_c[:, 2] > (COS_ROUND if is_round else 0.9))  # the corners are 14.2 deg away
    xy_px = pixels(CAMERA, u_c[near])
    if is_round:
        return near, xy_px
    inside = ((xy_px >= -0.5) & (xy_px <= [CAMERA.width_px - 0.5, CAMERA.height_px - 0.5])).all(axis=1)
    return near[inside], xy_px[inside]


def false_place(rng, is_round):
    """Somewhere on the detector, or in the round part of it: (2,) px."""
    while True:
        xy_px = rng.uniform(-0.5, [CAMERA.width_px - 0.5, CAMERA.height_px - 0.5])
        if not is_round or unit_vectors(CAMERA, xy_px[None])[0, 2] > COS_ROUND:
            return xy_px


def draw_field(rng, stars, *, least, n_false, is_round):
    """A field with at least `least` stars of the catalogue at a random attitude.

    Parameters
    ----------
    rng : numpy Generator
    stars : OnboardCatalogue
    least : int
    n_false : int
    is_round : bool

    Returns
    -------
    Field
    """
    rows, xy_px = in_view(stars, random_attitude(rng), is_round)
    while len(rows) < least:
        rows, xy_px = in_view(stars, random_attitude(rng), is_round)
    false_xy = np.array([false_place(rng, is_round) for _ in range(n_false)]).reshape(-1, 2)
    xy_px = np.vstack([xy_px + rng.normal(0.0, SIGMA_PX, xy_px.shape), false_xy])
    true_magnitude = np.concatenate([stars.vmag[rows], rng.choice(stars.vmag, n_false)])
    magnitude = true_magnitude + rng.normal(0.0, MAGNITUDE_SIGMA, len(true_magnitude))
    order = np.argsort(magnitude)
    star = np.concatenate([rows, np.full(n_false, -1)])[order]
    return Field(unit_vectors(CAMERA, xy_px[order]), 10.0 ** (-0.4 * magnitude[order]), star)
