"""The centroid that the scan itself takes, with its covariance."""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.scan import COLUMNS, CUT, FLUX, NOISE, PIXELS, SATURATED, XX, XY, YY, X, Y

LEAST_VARIANCE = 1.0 / 12.0  # px^2, of one pixel
CLIPPED_PX = 0.04  # by which saturation draws a centre of mass to the grid; spots of 0.6 to 1.2 px [E]


@kernel
def weighted(table, dn_per_electron):
    """Centroids of the scan as they are.

    Parameters
    ----------
    table : (n, scan.COLUMNS) objects
    dn_per_electron : float, 0 where the shot noise of the stars is not known

    Returns
    -------
    xy_px (n, 2), flux_dn (n,), P_px (n, 2, 2)
    """
    n = table.shape[0]
    xy_px, flux, P_px = np.empty((n, 2)), np.empty(n), np.empty((n, 2, 2))
    for k in range(n):
        xy_px[k, 0], xy_px[k, 1], flux[k] = table[k, X], table[k, Y], table[k, FLUX]
        P_px[k] = weighted_covariance(table[k], dn_per_electron)
    return xy_px, flux, P_px


def lost_covariance(table):
    """What light that is missing adds to the covariance of `weighted`: (n, 2, 2) px^2.

    That of saturated pixels, and of a scan whose objects end at a threshold that of the pixels below it.
    """
    P_px = np.where(table[:, SATURATED] > 0.0, CLIPPED_PX**2, 0.0)[:, None, None] * np.eye(2)
    if table.shape[1] > COLUMNS:  # else the weight of the pixels goes to zero there
        P_px += table[:, CUT][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    return P_px


def few_pixels(table, psf_sigma):
    """By how much `weighted_covariance` is too small for faint objects, (n,): at least 1.

    Of a star that hardly stands out only its middle is above the threshold: its pixels are too few and its
    moments too small, and it would be known better than all the light of its spot allows. That bound, in
    even noise, is 8 pi sigma^4 noise^2 / flux^2; for a streak it is only less than it might be.

    psf_sigma : px, of the spots
    """
    if table.shape[1] > COLUMNS:  # what the threshold cuts off is counted: `lost_covariance`
        return np.ones(len(table))
    whole = 8.0 * np.pi * (psf_sigma**2 + LEAST_VARIANCE) ** 2
    xx, yy = np.maximum(2.0 * table[:, [XX, YY]], LEAST_VARIANCE).T
    return np.maximum(whole / (table[:, PIXELS] * np.sqrt(xx * yy)), 1.0)


@inner
def weighted_covariance(star, dn_per_electron):
    """Covariance of a centroid of the scan: 2 (2 M) / SNR^2, M the moments of spot times weight, about S/2.

    For a Gaussian spot in even noise the matched filter has 8 pi sigma^4 noise^2 / flux^2; the grown pixels
    are about 8 pi sigma^2 of them.
    """
    noise_to_signal = (star[NOISE] ** 2 * star[PIXELS] + star[FLUX] * dn_per_electron) / star[FLUX] ** 2
    xx, yy = max(2.0 * star[XX], LEAST_VARIANCE), max(2.0 * star[YY], LEAST_VARIANCE)
    most = 0.9 * np.sqrt(xx * yy)  # the moments of a faint object may be anything
    xy = min(max(2.0 * star[XY], -most), most)
    return noise_to_signal * np.array([[xx, xy], [xy, yy]])
