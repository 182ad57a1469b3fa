"""The centroid that the scan itself takes, with its covariance."""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.scan import FLUX, NOISE, PIXELS, XX, XY, YY, X, Y

LEAST_VARIANCE = 1.0 / 12.0  # px^2, of one pixel


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
