"""The SHEFEX-2 chain on one frame, picture to attitude, with what its text leaves open as switches.

As printed: an object begins at a pixel above a threshold (section 3.2); nothing is said of a least number of
pixels, or of how much of the light the brightest may hold, so one pixel is enough. The pictures of the night
sky were "processed using the uniform Hipparcos catalog" (section 4); the flight has the combined one (3.3).
The threshold is not given. [E] 6 sigma, 13 grey values: of whole sigmas from 4 to 8 the one with which the
sentence of section 4 on smeared pictures comes out as `rates` reads it (`shefex-readings`).
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.onboard.startracker.objects import detect
from shefex_nav.onboard.startracker.settings import Detection
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.shefex2.field import CAMERA, PYRAMID, flown_pairs, uniform_pairs
from shefex_nav.papers.shefex2.frames import DETECT, MODEL
from shefex_nav.papers.shefex2.methods import pyramid
from shefex_nav.papers.shefex2.published import SHEFEX
from shefex_nav.records import Reason

IDENTIFY = STAR_TRACKER.identification
COS_ERROR = SHEFEX["identification"]["cos_error"]
SINGLE_PIXELS = replace(
    DETECT, scan="single_pixels", centroid="weighted", seed_sigma=6.0, fewest_pixels=1, largest_peak=1.0
)
# of the scenario shefex2_as_flown: in space its success against the rate is what the paper saw on the ground
FLOWN = replace(SINGLE_PIXELS, seed_sigma=8.0, fewest_pixels=3, largest_peak=DETECT.largest_peak)
BLOCKS = replace(DETECT, centroid="weighted")  # sums of 3x3 pixels, as our tracker reads the scan


class Reading(NamedTuple):
    """One way to read the chain."""

    detection: Detection
    pairs: Callable  # () -> StarPairs
    verified: bool = False  # whether an identification is held against the whole field before it is believed


NIGHT_SKY = Reading(SINGLE_PIXELS, uniform_pairs)  # section 4, as printed
COMBINED = Reading(SINGLE_PIXELS, flown_pairs)  # section 3.3; the scenario as flown detects less (FLOWN)


def attitude(reading, found):
    """Attitude of the objects of a frame by the pyramid and ESOQ2: q_ic, or None. found : Detections"""
    u_c, pairs = unit_vectors(CAMERA, found.xy_px), reading.pairs()
    if reading.verified:
        result = pyramid.identify(PYRAMID, MODEL, pairs, u_c, found.flux_dn)
    else:
        result = pyramid.match(IDENTIFY, MODEL, pairs, u_c, found.flux_dn, COS_ERROR)
    known = result.star >= 0
    if result.reason != Reason.NONE or known.sum() < IDENTIFY.fewest_stars:
        return None
    return of_stars(found, known, u_c, pairs.stars.u_i[result.star[known]])


def of_stars(found, known, u_c, u_i):
    """ESOQ2 with the weights of the centroids. Detections, (n,) bool, (n, 3), (m, 3) -> q_ic"""
    variance = 0.5 * np.trace(found.P_px[known], axis1=1, axis2=2)
    return esoq2(u_c[known], u_i, np.sqrt(variance + STAR_TRACKER.centroid_floor**2))


def solve(reading, image):
    """Attitude of a frame: q_ic, or None."""
    return attitude(reading, detect(reading.detection, MODEL, image)[0])
