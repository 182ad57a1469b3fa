"""What the SHEFEX experiments with lists of stars share: camera, catalogue, fields of stars, identification.

As in section 3.4.1 of the paper: random attitudes, the catalogue stars in the field of view, false objects,
and a centroid error on each; then the pyramid with a constant tolerance of the cosine, nothing verified.
"""

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import pinhole, pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.shefex2.methods import pyramid
from shefex_nav.papers.shefex2.published import SHEFEX
from shefex_nav.papers.stills import on_detector, random_attitude

YEAR = 2011.5  # of the paper
CAMERA = pinhole(
    SHEFEX["camera"]["width_px"],
    SHEFEX["camera"]["height_px"],
    SHEFEX["camera"]["focal_length_mm"] * 1e3 / SHEFEX["camera"]["pixel_um"],
)
FIELD = np.radians(SHEFEX["camera"]["fov_diag_deg"])  # the longest angle of the pair table
MERGE = 2.0 / CAMERA.focal_length_px  # rad, closer stars are one spot
COMBINED = replace(
    STAR_TRACKER.catalogue,
    kind="combined",
    faintest=5.75,  # the faintest that the paper mentions in its uniform catalogue
    merge_radius=MERGE,
    keep_to=SHEFEX["catalogue"]["keep_all_to_mag"],
    size=SHEFEX["catalogue"]["stars"],
)
MAX_CENTROIDS = SHEFEX["identification"]["max_centroids"]
MIN_STARS = 4
PYRAMID = replace(STAR_TRACKER.identification, method="pyramid", most_centroids=MAX_CENTROIDS)
MODEL = CameraModel(CAMERA)


class Field(NamedTuple):
    """Centroids of one attitude, brightest first."""

    q_ic: np.ndarray  # (4,)
    xy_px: np.ndarray  # (n, 2) without error
    star: np.ndarray  # (n,) row of the catalogue, -1 for a false object
    noise: np.ndarray  # (n, 2) normal, to be scaled with the centroid error


@cache
def flown():
    """Stars of a catalogue as flown: OnboardCatalogue."""
    return catalogue.build(COMBINED, load_catalogue(8.0), YEAR)


@cache
def flown_pairs():
    """Its pairs: StarPairs."""
    return catalogue.pair_table(flown(), FIELD)


@cache
def uniform_pairs():
    """Pairs of the uniform catalogue (section 3.3, figure 5), as many stars as fly: StarPairs."""
    uniform = catalogue.build(replace(COMBINED, kind="uniform"), load_catalogue(8.0), YEAR)
    return catalogue.pair_table(uniform, FIELD)


def in_view(u_i, q_ic):
    """Rows and pixels of the stars on the detector. (n, 3), (4,) -> (m,), (m, 2)."""
    xy_px = pixels(CAMERA, np.ascontiguousarray(u_i @ dcm_from_quat(q_ic)))
    rows = np.flatnonzero(on_detector(CAMERA, xy_px))
    return rows, xy_px[rows]


def draw_field(rng, n_false=0):
    """A field of the flown catalogue with false objects anywhere, as bright as any star of the catalogue."""
    stars = flown()
    q_ic = random_attitude(rng)
    rows, xy_px = in_view(stars.u_i, q_ic)
    size = np.array([CAMERA.width_px, CAMERA.height_px])
    xy_px = np.vstack([xy_px, rng.uniform(-0.5, size - 0.5, (n_false, 2))])
    star = np.concatenate([rows, np.full(n_false, -1)])
    vmag = np.concatenate([stars.vmag[rows], rng.choice(stars.vmag, n_false)])
    order = np.argsort(vmag, kind="stable")
    return Field(q_ic, xy_px[order], star[order], rng.standard_normal((len(order), 2)))


def directions(field, error_px):
    """Measured directions with a centroid error of error_px per axis. Field, px -> (n, 3)."""
    return unit_vectors(CAMERA, field.xy_px + error_px * field.noise)


def match(pairs, u_c, cos_error):
    """Rows of the catalogue, -1 where unidentified. StarPairs, (n, 3) brightest first, float -> (n,)."""
    return pyramid.match(PYRAMID, MODEL, pairs, u_c, np.ones(len(u_c)), cos_error).star
