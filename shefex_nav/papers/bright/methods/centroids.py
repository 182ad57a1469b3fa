"""The published centroids, to set the fit against: centre of mass and Gaussian interpolation.

In: the frame and its objects. Out: place, flux and covariance of each. Both look at a square region of
interest around the brightest pixel of an object (Liebe 2002, IEEE Trans. AES 38, 587; section 3 of the
brightness reference paper, 2014).
"""

from math import erf, exp, pi, sqrt

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.scan import BACKGROUND, CLIPPED_PX, FLUX, NOISE, SATURATED, X, Y

ROI_PX = 7  # side of the region of interest, odd
FARTHEST_PX = 1.0  # of an interpolated centroid from the middle of the brightest column
SERIES_PX = 0.02  # RMS of what the second order of an interpolation leaves out [E]
CLIPPED = 1.0 / 12.0  # px^2, of one whose columns end at the largest grey value: anywhere in a pixel


def by_mass(settings, camera, image_dn, table, roi_px=ROI_PX):
    """Place, flux and covariance of the objects by centre of mass."""
    return centre_of_mass(image_dn, table, roi_px, 1.0 / camera.electrons_per_dn)


def by_interpolation(settings, camera, image_dn, table, roi_px=ROI_PX):
    """... by Gaussian interpolation."""
    electron, sigma = 1.0 / camera.electrons_per_dn, float(camera.psf_sigma)
    return gaussian_interpolation(image_dn, table, roi_px, sigma, electron)


@kernel
def centre_of_mass(image_dn, table, roi_px, dn_per_electron):
    """Centre of mass of the light above the background in the region of interest; equations (1) to (3).

    Parameters
    ----------
    image_dn : (rows, columns) uint8 or uint16
    table : (n, scan.COLUMNS) objects
    roi_px : int, side of the region, odd
    dn_per_electron : float, 0 where the shot noise of the stars is not known

    Returns
    -------
    xy_px (n, 2), flux_dn (n,), P_px (n, 2, 2)
    """
    n, half = table.shape[0], roi_px // 2
    xy_px, fluxes, P_px = np.empty((n, 2)), np.empty(n), np.empty((n, 2, 2))
    for k in range(n):
        row, column = _brightest(image_dn, table[k])
        top, bottom = max(0, row - half), min(image_dn.shape[0] - 1, row + half)
        left, right = max(0, column - half), min(image_dn.shape[1] - 1, column + half)
        sums = np.zeros(3)
        for r in range(top, bottom + 1):
            for c in range(left, right + 1):
                light = image_dn[r, c] - table[k, BACKGROUND]
                sums[0] += light
                sums[1] += light * c
                sums[2] += light * r
        flux = sums[0]
        if flux <= 0.0:
            flux, x, y = table[k, FLUX], table[k, X], table[k, Y]
        else:
            x, y = sums[1] / flux, sums[2] / flux
        covariance = np.zeros((2, 2))
        for r in range(top, bottom + 1):
            for c in range(left, right + 1):
                light = max(image_dn[r, c] - table[k, BACKGROUND], 0.0)
                variance = (table[k, NOISE] ** 2 + light * dn_per_electron) / flux**2
                covariance[0, 0] += variance * (c - x) ** 2
                covariance[0, 1] += variance * (c - x) * (r - y)
                covariance[1, 1] += variance * (r - y) ** 2
        covariance[1, 0] = covariance[0, 1]
        if table[k, SATURATED] > 0.0:
            covariance[0, 0] += CLIPPED_PX**2
            covariance[1, 1] += CLIPPED_PX**2
        xy_px[k, 0], xy_px[k, 1], fluxes[k], P_px[k] = x, y, flux, covariance
    return xy_px, fluxes, P_px


@inner
def _brightest(image_dn, star):
    """Row and column of the brightest pixel within 2 pixels of an object's centroid."""
    row, column = int(np.rint(star[Y])), int(np.rint(star[X]))
    best_r, best_c = row, column
    for r in range(max(0, row - 2), min(image_dn.shape[0], row + 3)):
        for c in range(max(0, column - 2), min(image_dn.shape[1], column + 3)):
            if image_dn[r, c] > image_dn[best_r, best_c]:
                best_r, best_c = r, c
    return best_r, best_c


@kernel
def gaussian_interpolation(image_dn, table, roi_px, sigma_px, dn_per_electron):
    """Interpolation between the two brightest columns, then rows, of the region; equations (4) to (6).

    After Quine et al. 2007 (Comput. Phys. Commun. 177, 700). Parameters and results as `centre_of_mass`,
    with the known width of the spot.
    """
    n, half = table.shape[0], roi_px // 2
    xy_px, fluxes, P_px = np.empty((n, 2)), np.empty(n), np.zeros((n, 2, 2))
    for k in range(n):
        row, column = _brightest(image_dn, table[k])
        top, bottom = max(0, row - half), min(image_dn.shape[0] - 1, row + half)
        left, right = max(0, column - half), min(image_dn.shape[1] - 1, column + half)
        in_column, in_row = np.zeros(right - left + 1), np.zeros(bottom - top + 1)
        for r in range(top, bottom + 1):
            for c in range(left, right + 1):
                light = image_dn[r, c] - table[k, BACKGROUND]
                in_column[c - left] += light
                in_row[r - top] += light
        x, variance_x = _between(in_column, sigma_px, len(in_row) * table[k, NOISE] ** 2, dn_per_electron)
        y, variance_y = _between(in_row, sigma_px, len(in_column) * table[k, NOISE] ** 2, dn_per_electron)
        xy_px[k, 0], xy_px[k, 1] = left + x, top + y
        fluxes[k] = max(in_row.sum(), 1e-9)
        more = SERIES_PX**2 + (CLIPPED if table[k, SATURATED] > 0.0 else 0.0)
        P_px[k, 0, 0], P_px[k, 1, 1] = variance_x + more, variance_y + more
    return xy_px, fluxes, P_px


@inner
def _between(light, sigma_px, noise2, dn_per_electron):
    """Place of a spot from the light of its brightest pixel and the brighter neighbour: place, variance.

    I_1 = A g_1(u), I_2 = A g_2(u), u from the middle of the brightest towards its neighbour, g the share of a
    pixel. Without A: I_1 g_2(u) = I_2 g_1(u), and with g to the second order in u a quadratic equation. Its
    root next to the middle of the brightest pixel is the place. The series is off by 0.03 px at u = 1/2 for
    a spot of 1 px; that error repeats with the pixels.
    """
    middle = np.argmax(light[1:-1]) + 1
    side = 1 if light[middle + 1] >= light[middle - 1] else -1
    I_1, I_2 = light[middle], max(light[middle + side], 0.0)
    g_1, d_1, dd_1 = _share(-0.5, 0.5, sigma_px)
    g_2, d_2, dd_2 = _share(0.5, 1.5, sigma_px)
    c, b, a = I_1 * g_2 - I_2 * g_1, I_1 * d_2 - I_2 * d_1, 0.5 * (I_1 * dd_2 - I_2 * dd_1)
    inner = b * b - 4.0 * a * c
    u = -2.0 * c / (b + np.sqrt(inner)) if inner > 0.0 and b > 0.0 else 0.5
    u = min(max(u, -FARTHEST_PX), FARTHEST_PX)
    slope = max(abs(2.0 * a * u + b), 1e-9)
    variance_1 = noise2 + max(I_1, 0.0) * dn_per_electron
    variance_2 = noise2 + I_2 * dn_per_electron
    weight_1 = g_2 + d_2 * u + 0.5 * dd_2 * u * u
    weight_2 = g_1 + d_1 * u + 0.5 * dd_1 * u * u
    return middle + side * u, (weight_1**2 * variance_1 + weight_2**2 * variance_2) / slope**2


@inner
def _share(low, high, sigma):
    """Light of a spot at 0 between two edges, and its first two derivatives to the place of the spot."""
    z_low, z_high = low / sigma, high / sigma
    f_low = exp(-0.5 * z_low * z_low) / (sqrt(2.0 * pi) * sigma)
    f_high = exp(-0.5 * z_high * z_high) / (sqrt(2.0 * pi) * sigma)
    share = 0.5 * (erf(z_high / sqrt(2.0)) - erf(z_low / sqrt(2.0)))
    return share, f_low - f_high, (f_low * z_low - f_high * z_high) / sigma
