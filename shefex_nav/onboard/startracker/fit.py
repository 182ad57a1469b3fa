"""Centroids by fitting the frame's own star shape: as good as the noise allows, and with a covariance.

In: the frame, its objects and their `Shape`. Out: place, flux and covariance of each. The model is the
Gaussian spot, drawn along the streak and integrated over each pixel, on a background that is known; place and
flux follow by weighted least squares. The weights are the inverse variances of the pixels: the noise that the
frame shows without stars (read noise, shot noise of the background, quantisation) and the shot noise of the
model's own light. Saturated pixels have no weight: of the brightest stars the slopes are fitted.

A star whose neighbour is an object too is fitted again with the neighbour's light taken away. Where the
pixels do not look like one star (an unresolved neighbour, a particle hit), the misfit makes the covariance
larger.
"""

from math import erf, exp, pi, sqrt

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.centroid import weighted
from shefex_nav.onboard.startracker.scan import BACKGROUND, FLUX, NOISE, X, Y
from shefex_nav.onboard.startracker.shape import STEP_SIGMAS, measure

PER_SIGMA = 128  # steps of the tables below; linear interpolation is good to 2e-6
REACH = 6  # sigmas
_Z = np.arange(-REACH * PER_SIGMA, REACH * PER_SIGMA + 2) / PER_SIGMA
CDF = np.array([0.5 * (1.0 + erf(z / sqrt(2.0))) for z in _Z])
DENSITY = np.array([exp(-0.5 * z * z) / sqrt(2.0 * pi) for z in _Z])

MOST_STEPS = 8
SMALL_STEP_PX = 0.02  # the next step of Gauss and Newton would be the square of that
FARTHEST_PX = 2.0  # from the first centroid; further away it is not this star that is fitted
WINDOW = (2.5, 5.0)  # sigmas, least and greatest radius of the pixels that are used
WINDOW_NOISE = 0.5  # the window reaches to where the star's light is this fraction of the noise
LARGEST_REACH = 31  # px
LEAST_PIXELS = 6  # with light, that are not saturated
PRIOR_DOF = 30.0  # weight of the expected misfit against the one seen [E]
UNFITTED_PX = 0.3  # error of what no star shape fits, per axis [E]

# columns of the result
COLUMNS = 6  # x, y, flux, xx, xy, yy
FITTED_FLUX = 2


@njit(cache=True)
def centroids(image_dn, table, saturation_dn, dn_per_electron, default_sigma_px):
    """Place, flux and covariance of all objects of a frame.

    What cannot be fitted keeps the centroid of the scan, with a covariance that does not trust it.

    Parameters
    ----------
    image_dn : (rows, columns)
    table : (n, scan.COLUMNS) objects
    saturation_dn : grey value of a saturated pixel
    dn_per_electron : float, 0 where it is not known: the shot noise of the stars is left out
    default_sigma_px : float, width of a spot where the frame does not show it

    Returns
    -------
    xy_px (n, 2), flux_dn (n,), P_px (n, 2, 2)
    """
    shape = measure(image_dn, table, saturation_dn, default_sigma_px)
    fitted, good = fit(image_dn, table, shape, saturation_dn, dn_per_electron)
    xy_px, flux, P_px = weighted(table, dn_per_electron)
    for k in range(table.shape[0]):
        if good[k]:
            xy_px[k, 0], xy_px[k, 1], flux[k] = fitted[k, 0], fitted[k, 1], fitted[k, 2]
            P_px[k, 0, 0], P_px[k, 1, 1] = fitted[k, 3], fitted[k, 5]
            P_px[k, 0, 1] = P_px[k, 1, 0] = fitted[k, 4]
        else:
            P_px[k, 0, 0] += UNFITTED_PX**2
            P_px[k, 1, 1] += UNFITTED_PX**2
    return xy_px, flux, P_px


@njit(cache=True)
def fit(image_dn, table, shape, saturation_dn, dn_per_electron):
    """Fit all objects of a frame.

    Parameters
    ----------
    image_dn : (rows, columns)
    table : (n, scan.COLUMNS) objects
    shape : Shape
    saturation_dn : grey value of a saturated pixel
    dn_per_electron : float, 0 where it is not known: the shot noise of the stars is left out

    Returns
    -------
    fitted : (n, 6) x, y, flux, and xx, xy, yy of the covariance [px^2]
    good : (n,) bool; where it is False no fit was possible and the row is not to be used
    """
    n = table.shape[0]
    spots = _spots(shape)
    fitted, good = np.empty((n, COLUMNS)), np.zeros(n, dtype=np.bool_)
    # a neighbour's light counts over the greatest window of both
    spread = shape.sigma_px + 0.3 * max(abs(shape.streak_x), abs(shape.streak_y))
    near_px = 2.0 * min(WINDOW[0] * spread + 1.0, LARGEST_REACH)
    work = np.empty((3, 2 * LARGEST_REACH + 1, 2 * LARGEST_REACH + 1))
    others = np.empty((n, COLUMNS))
    for turn in range(2):
        for k in range(n):
            n_others = 0
            if turn == 1:
                for j in range(n):
                    is_near = abs(fitted[j, 0] - fitted[k, 0]) < near_px
                    if j != k and good[j] and is_near and abs(fitted[j, 1] - fitted[k, 1]) < near_px:
                        others[n_others] = fitted[j]
                        n_others += 1
                if n_others == 0:
                    continue
            good[k] = _fit_one(
                image_dn,
                table[k],
                spots,
                others[:n_others],
                saturation_dn,
                dn_per_electron,
                work,
                fitted[k],
            )
    return fitted, good


@njit(cache=True)
def _spots(shape):
    """Gaussian spots that together are a streak: (n, 3) x, y from its middle, sigma; equal shares of light.

    n points at equal steps d have the variance d^2 (n^2 - 1) / 12, a line of length L has L^2 / 12.
    """
    length = np.hypot(shape.streak_x, shape.streak_y)
    n = int(np.ceil(length / (STEP_SIGMAS * shape.sigma_px))) + 1 if length > 0.2 * shape.sigma_px else 1
    spots = np.zeros((n, 3))
    step = 1.0 / np.sqrt(n * n - 1.0) if n > 1 else 0.0
    for k in range(n):
        along = (k - 0.5 * (n - 1)) * step
        spots[k, 0], spots[k, 1], spots[k, 2] = along * shape.streak_x, along * shape.streak_y, shape.sigma_px
    return spots


@njit(cache=True)
def _edges(centre, first, n, sigma, share, slope):
    """Share of a spot's light in each of n pixels from `first` on, and its derivative to the centre."""
    inverse = 1.0 / sigma
    below_c, below_d = 0.0, 0.0
    for k in range(n + 1):
        place = ((first + k - 0.5 - centre) * inverse + REACH) * PER_SIGMA
        place = min(max(place, 0.0), 2.0 * REACH * PER_SIGMA)
        index = int(place)
        part = place - index
        above_c = CDF[index] + part * (CDF[index + 1] - CDF[index])
        above_d = (DENSITY[index] + part * (DENSITY[index + 1] - DENSITY[index])) * inverse
        if k > 0:
            share[k - 1], slope[k - 1] = above_c - below_c, below_d - above_d
        below_c, below_d = above_c, above_d


@njit(cache=True)
def _model(spots, x, y, left, top, width, height, work):
    """Write the light of a star of flux one, and its derivatives to x and y, to work[:, :height, :width]."""
    columns, slopes = np.empty(width), np.empty(width)
    rows, row_slopes = np.empty(height), np.empty(height)
    n = spots.shape[0]
    work[:, :height, :width] = 0.0
    for k in range(n):
        _edges(x + spots[k, 0], left, width, spots[k, 2], columns, slopes)
        _edges(y + spots[k, 1], top, height, spots[k, 2], rows, row_slopes)
        for r in range(height):
            light, to_y = rows[r] / n, row_slopes[r] / n
            for c in range(width):
                work[0, r, c] += light * columns[c]
                work[1, r, c] += light * slopes[c]
                work[2, r, c] += to_y * columns[c]


@njit(cache=True)
def _fit_one(image_dn, star, spots, others, saturation_dn, dn_per_electron, work, fitted):
    """Fit one object, less the light of the others; write to `fitted`, returns whether it succeeded."""
    n_rows, n_columns = image_dn.shape
    x, y, flux = star[X], star[Y], star[FLUX]
    noise2 = star[NOISE] ** 2
    sigma = spots[0, 2]
    half_x, half_y = abs(spots[0, 0]), abs(spots[0, 1])
    peak = flux / (2.0 * pi * sigma * (sigma + 0.8 * np.hypot(half_x, half_y)))
    radius = np.sqrt(2.0 * np.log(max(peak / (WINDOW_NOISE * star[NOISE]), 1.0)))
    radius = min(max(radius, WINDOW[0]), WINDOW[1]) * sigma
    reach_x = min(int(radius + half_x + 0.5), LARGEST_REACH)
    reach_y = min(int(radius + half_y + 0.5), LARGEST_REACH)
    left, right = max(0, int(np.rint(x)) - reach_x), min(n_columns - 1, int(np.rint(x)) + reach_x)
    top, bottom = max(0, int(np.rint(y)) - reach_y), min(n_rows - 1, int(np.rint(y)) + reach_y)
    width, height = right - left + 1, bottom - top + 1
    if width < 3 or height < 3:
        return False

    data = np.empty((height, width))
    for r in range(height):
        for c in range(width):
            data[r, c] = image_dn[top + r, left + c] - star[BACKGROUND]
    shot = np.zeros((height, width))  # variance that the others bring
    for j in range(others.shape[0]):
        _model(spots, others[j, 0], others[j, 1], left, top, width, height, work)
        for r in range(height):
            for c in range(width):
                light = others[j, FITTED_FLUX] * work[0, r, c]
                data[r, c] -= light
                shot[r, c] += light * dn_per_electron

    normal, right_side = np.empty(6), np.empty(3)
    for _ in range(MOST_STEPS):
        _model(spots, x, y, left, top, width, height, work)
        normal[:], right_side[:] = 0.0, 0.0
        chi2, n_used = 0.0, 0
        for r in range(height):
            for c in range(width):
                if image_dn[top + r, left + c] >= saturation_dn:
                    continue
                light = work[0, r, c]
                to_x, to_y = flux * work[1, r, c], flux * work[2, r, c]
                weight = 1.0 / (noise2 + shot[r, c] + flux * light * dn_per_electron)
                rest = data[r, c] - flux * light
                normal[0] += weight * to_x * to_x
                normal[1] += weight * to_x * to_y
                normal[2] += weight * to_y * to_y
                normal[3] += weight * to_x * light
                normal[4] += weight * to_y * light
                normal[5] += weight * light * light
                right_side[0] += weight * to_x * rest
                right_side[1] += weight * to_y * rest
                right_side[2] += weight * light * rest
                chi2 += weight * rest * rest
                n_used += 1
        if n_used < LEAST_PIXELS or normal[5] <= 0.0:
            return False
        # flux eliminated: 2x2 equations of the place
        a = normal[0] - normal[3] * normal[3] / normal[5]
        b = normal[1] - normal[3] * normal[4] / normal[5]
        d = normal[2] - normal[4] * normal[4] / normal[5]
        det = a * d - b * b
        if not (a > 0.0 and det > 1e-12 * a * a):
            return False
        e = right_side[0] - normal[3] * right_side[2] / normal[5]
        f = right_side[1] - normal[4] * right_side[2] / normal[5]
        dx, dy = (d * e - b * f) / det, (a * f - b * e) / det
        d_flux = (right_side[2] - normal[3] * dx - normal[4] * dy) / normal[5]
        step = np.hypot(dx, dy)
        scale = min(1.0, sigma / step) if step > 0.0 else 1.0
        x += scale * dx
        y += scale * dy
        flux = max(flux + scale * d_flux, 0.3 * flux)
        if np.hypot(x - star[X], y - star[Y]) > FARTHEST_PX + 0.5 * sigma:
            return False
        if step < SMALL_STEP_PX and abs(d_flux) < 0.1 * flux:
            break
    else:
        return False
    chi2 -= right_side[0] * dx + right_side[1] * dy + right_side[2] * d_flux  # after the last step
    factor = max(1.0, (PRIOR_DOF + chi2) / (PRIOR_DOF + n_used - 3.0))
    fitted[0], fitted[1], fitted[2] = x, y, flux
    fitted[3], fitted[4], fitted[5] = factor * d / det, -factor * b / det, factor * a / det
    return True
