"""From the grey values of a frame to a table of point objects.

In: one frame. Out: `Detections`, brightest first, and the statistics of the frame. The route of the data is
that of the SHEFEX-2 star tracker (section 3.2), one file a step:

    frame -> background: bad pixels out, sums of 3x3 pixels, level and noise in tiles
          -> scan: objects above the threshold, in one pass or by searching the maximum
          -> centroid (published methods) or shape and fit (default): place and covariance of each
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.onboard.startracker import centroid, fit, scan
from shefex_nav.onboard.startracker.background import block_sums, medians, repair, tile_statistics
from shefex_nav.onboard.startracker.spot import Picture
from shefex_nav.records import Detections

SCANS = {"sequential": scan.sequential, "maximum": scan.maximum_search}


class DetectParams(NamedTuple):
    """Settings of the detection."""

    bad_pixels: np.ndarray  # (n, 2) int64 row, column of pixels known to be bad
    tile_px: int  # background and noise are taken in square tiles of this side
    seed_sigma: float  # an object starts where a block is this far above the background
    grow_sigma: float  # and grows while blocks are this far above it
    min_pixels: int  # smaller objects are noise
    max_pixels: int  # larger ones are no stars
    max_peak_fraction: float  # of the light in one pixel; more is a hot pixel, the lens cannot do it
    max_objects: int  # length of the table
    saturation_dn: int  # grey value of a saturated pixel
    scan: str = "sequential"  # or "maximum"; "streaks" and "run_length" are ways of `objects`
    centroid: str = "fit"  # or "weighted", "centre_of_mass", "gaussian_interpolation"
    electrons_per_dn: float = np.inf  # of camera and gain; infinite: not known, no shot noise of the stars
    psf_sigma_px: float = 1.0  # width of a spot, where the frame does not show it (interpolation: anywhere)
    roi_px: int = 7  # side of the region of interest of centre of mass and interpolation, odd


class FrameStatistics(NamedTuple):
    """What a frame looks like as a whole."""

    mean_dn: float
    background_dn: float  # median over the tiles
    noise_dn: float  # standard deviation of one pixel, median over the tiles


def detect(params, image_dn):
    """Objects in a frame.

    Parameters
    ----------
    params : DetectParams
    image_dn : (rows, columns) uint8 or uint16; saturation_dn in the same grey values

    Returns
    -------
    Detections, brightest first, at most params.max_objects
    FrameStatistics
    """
    image_dn = np.ascontiguousarray(image_dn)
    if image_dn.ndim != 2 or image_dn.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"image: expected grey values of shape (rows, columns), uint8 or uint16, "
            f"got {image_dn.dtype} of shape {image_dn.shape}"
        )
    image_dn = repair(image_dn, params.bad_pixels)
    blocks = block_sums(image_dn)
    background, sigma, mean_dn = tile_statistics(blocks, params.tile_px)
    table = _named("scan", SCANS, params.scan)(image_dn, blocks, background, sigma, rules(params))
    xy_px, flux_dn, P_px = _named("centroid", CENTROIDS, params.centroid)(params, image_dn, table)
    statistics = FrameStatistics(mean_dn, *medians(background, sigma))
    detections = Detections(*_brightest_first(table, xy_px, flux_dn, P_px))
    return detections, statistics


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


def rules(params):
    """The settings of a scan."""
    return (
        int(params.tile_px),
        float(params.seed_sigma),
        float(params.grow_sigma),
        int(params.min_pixels),
        int(params.max_pixels),
        float(params.max_peak_fraction),
        int(params.saturation_dn),
        int(params.max_objects),
    )


def _named(what, methods, name):
    """A method by its name."""
    if name not in methods:
        raise ValueError(f"{what}: {name!r} is not known; choose from: {', '.join(methods)}")
    return methods[name]


def _by_fit(params, image_dn, table):
    """Place, flux and covariance of the objects by fitting the star shape of the frame."""
    bad_pixels = np.ascontiguousarray(params.bad_pixels, dtype=np.int64)
    picture = Picture(image_dn, bad_pixels, int(params.saturation_dn), 1.0 / params.electrons_per_dn)
    return fit.centroids(picture, table, float(params.psf_sigma_px))


def _by_scan(params, image_dn, table):
    """... as the scan found them."""
    return centroid.weighted(table, 1.0 / params.electrons_per_dn)


def _by_mass(params, image_dn, table):
    """... by centre of mass."""
    return centroid.centre_of_mass(image_dn, table, int(params.roi_px), 1.0 / params.electrons_per_dn)


def _by_interpolation(params, image_dn, table):
    """... by Gaussian interpolation."""
    electron, sigma = 1.0 / params.electrons_per_dn, float(params.psf_sigma_px)
    return centroid.gaussian_interpolation(image_dn, table, int(params.roi_px), sigma, electron)


CENTROIDS = {
    "fit": _by_fit,
    "weighted": _by_scan,
    "centre_of_mass": _by_mass,
    "gaussian_interpolation": _by_interpolation,
}
