"""From the grey values of a frame to a table of point objects.

In: one frame. Out: `Detections`, brightest first, and the statistics of the frame. The route of the data is
that of the SHEFEX-2 star tracker (section 3.2), one file a step:

    frame -> background: bad pixels out, sums of 3x3 pixels, level and noise in tiles
          -> scan: objects above the threshold, in one pass or by searching the maximum
          -> shape and fit, or centroid of the scan: place and covariance of each
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.onboard.startracker import centroid, fit, scan
from shefex_nav.onboard.startracker.background import survey
from shefex_nav.onboard.startracker.methods import STEPS
from shefex_nav.onboard.startracker.spot import Picture
from shefex_nav.records import Detections

SCANS = {"sequential": scan.sequential, "maximum": scan.maximum_search}


class FrameStatistics(NamedTuple):
    """What a frame looks like as a whole."""

    mean_dn: float
    background_dn: float  # median over the tiles
    noise_dn: float  # standard deviation of one pixel, median over the tiles


def detect(settings, camera, image_dn, centres=None):
    """Objects in a frame.

    Parameters
    ----------
    settings : Detection
    camera : CameraModel
    image_dn : (rows, columns) uint8 or uint16; settings.saturation in the same grey values
    centres : function in the place of the one that the settings name

    Returns
    -------
    Detections, brightest first, at most settings.most_objects
    FrameStatistics
    """
    image_dn = np.ascontiguousarray(image_dn)
    if image_dn.ndim != 2 or image_dn.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"image: expected grey values of shape (rows, columns), uint8 or uint16, "
            f"got {image_dn.dtype} of shape {image_dn.shape}"
        )
    image_dn, blocks, background, sigma, *levels = survey(image_dn, camera.bad_pixels, settings.tile)
    table = _named("scan", settings.scan)(image_dn, blocks, background, sigma, rules(settings))
    centres = centres or _named("centroid", settings.centroid)
    xy_px, flux_dn, P_px = centres(settings, camera, image_dn, table)
    detections = Detections(*_brightest_first(table, xy_px, flux_dn, P_px))
    return detections, FrameStatistics(*levels)


@kernel
def _brightest_first(table, xy_px, flux_dn, P_px):
    """The columns of Detections, sorted by the light that the centroid found."""
    n = len(flux_dn)
    order = np.argsort(-flux_dn, kind="mergesort")
    xy_sorted, P_sorted = np.empty((n, 2)), np.empty((n, 2, 2))
    n_pixels, n_saturated = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    for k in range(n):
        row = order[k]
        xy_sorted[k], P_sorted[k] = xy_px[row], P_px[row]
        n_pixels[k], n_saturated[k] = int(table[row, scan.PIXELS]), int(table[row, scan.SATURATED])
    return xy_sorted, flux_dn[order], n_pixels, n_saturated, P_sorted


def rules(settings):
    """The settings of a scan, in the types of its kernel. Detection -> scan.Rules"""
    return scan.Rules(
        int(settings.tile),
        float(settings.seed_sigma),
        float(settings.grow_sigma),
        int(settings.fewest_pixels),
        int(settings.most_pixels),
        float(settings.largest_peak),
        int(settings.saturation),
        int(settings.most_objects),
    )


def _named(step, name):
    """A way of a step by its name."""
    known = STEPS[step].ways()
    if name not in known:
        raise ValueError(f"{step}: {name!r} is not known; choose from: {', '.join(known)}")
    return known[name]


def by_fit(settings, camera, image_dn, table):
    """Place, flux and covariance of the objects by fitting the star shape of the frame."""
    bad_pixels = np.ascontiguousarray(camera.bad_pixels, dtype=np.int64)
    picture = Picture(image_dn, bad_pixels, int(settings.saturation), 1.0 / camera.electrons_per_dn)
    return fit.centroids(picture, table, float(camera.psf_sigma))


def by_scan(settings, camera, image_dn, table):
    """... as the scan found them."""
    return centroid.weighted(table, 1.0 / camera.electrons_per_dn)


CENTROIDS = {"fit": by_fit, "weighted": by_scan}
