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
from shefex_nav.onboard.startracker.likelihood import misfit_growth
from shefex_nav.onboard.startracker.scan import BACKGROUND, FLUX, NOISE, X, Y
from shefex_nav.onboard.startracker.shape import STEP_SIGMAS, measure

PER_SIGMA = 128  # steps of the tables below; linear interpolation is good to 2e-6
REACH = 6  # sigmas
_Z = np.arange(-REACH * PER_SIGMA, REACH * PER_SIGMA + 2) / PER_SIGMA
NORMAL = np.array([[0.5 * (1.0 + erf(z / sqrt(2.0))), exp(-0.5 * z * z) / sqrt(2.0 * pi)] for z in _Z])

MOST_STEPS = 5  # a star needs two; what needs more is none
SMALL_STEP_PX = 0.02  # the next step of Gauss and Newton would be the square of that
SMALL_STEP_FLUX = 0.3  # relative; the flux is linear, only the weights wait for it
FARTHEST_PX = 2.0  # from the first centroid; further away it is not this star that is fitted
WINDOW = (2.5, 5.0)  # sigmas, least and greatest radius of the pixels that are used
WINDOW_NOISE = 0.5  # the window reaches to where the star's light is this fraction of the noise
LARGEST_REACH = 31  # px
LEAST_PIXELS = 6  # with light, that are not saturated
PRIOR_DOF = 30.0  # weight of the expected misfit against the one seen [E]
UNFITTED_PX = 0.15  # error of the scan's centroid of what the shape does not fit, per axis [E]
MOST_MISFIT = 9.0  # chi squared per pixel; slopes of a saturated star that fit worse say nothing of its place

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
    work = np.empty((6, 2 * LARGEST_REACH + 2, 2 * LARGEST_REACH + 2))
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
        index = np.uint64(place)
        part = place - index
        next_one = index + np.uint64(1)
        above_c = NORMAL[index, 0] + part * (NORMAL[next_one, 0] - NORMAL[index, 0])
        above_d = (NORMAL[index, 1] + part * (NORMAL[next_one, 1] - NORMAL[index, 1])) * inverse
        if k > 0:
            share[k - 1], slope[k - 1] = above_c - below_c, below_d - above_d
        below_c, below_d = above_c, above_d


@njit(cache=True)
def _model(spots, x, y, left, top, width, height, work):
    """Write the light of a star of flux one, and its derivatives to x and y, to work[:, :height, :width]."""
    edges = work[3]
    columns, column_slopes, rows, row_slopes = edges[0], edges[1], edges[2], edges[3]
    share = 1.0 / spots.shape[0]
    for k in range(spots.shape[0]):
        _edges(x + spots[k, 0], left, width, spots[k, 2], columns, column_slopes)
        _edges(y + spots[k, 1], top, height, spots[k, 2], rows, row_slopes)
        for r in range(height):
            light, slope = rows[r] * share, row_slopes[r] * share
            spot, to_x, to_y = work[0, r], work[1, r], work[2, r]
            if k == 0:
                for c in range(width):
                    spot[c] = light * columns[c]
                    to_x[c] = light * column_slopes[c]
                    to_y[c] = slope * columns[c]
            else:
                for c in range(width):
                    spot[c] += light * columns[c]
                    to_x[c] += light * column_slopes[c]
                    to_y[c] += slope * columns[c]


@njit(cache=True)
def _window(star, spots, shape):
    """First and last column and row of the pixels that are used for a star."""
    half_x, half_y = abs(spots[0, 0]), abs(spots[0, 1])
    sigma = spots[0, 2]
    peak = star[FLUX] / (2.0 * pi * sigma * (sigma + 0.8 * np.hypot(half_x, half_y)))
    radius = np.sqrt(2.0 * np.log(max(peak / (WINDOW_NOISE * star[NOISE]), 1.0)))
    radius = min(max(radius, WINDOW[0]), WINDOW[1]) * sigma
    reach_x = min(int(radius + half_x + 0.5), LARGEST_REACH)
    reach_y = min(int(radius + half_y + 0.5), LARGEST_REACH)
    column, row = int(np.rint(star[X])), int(np.rint(star[Y]))
    left, right = max(0, column - reach_x), min(shape[1] - 1, column + reach_x)
    top, bottom = max(0, row - reach_y), min(shape[0] - 1, row + reach_y)
    return left, top, right - left + 1, bottom - top + 1


@njit(cache=True)
def _pixels(image_dn, star, spots, others, window, saturation_dn, dn_per_electron, work):
    """Write the light of one star, without the others', to work[4], and its variance to work[5].

    The variance lacks the star's own shot noise; that of a saturated pixel is infinite. Returns how many are
    not.
    """
    left, top, width, height = window
    light, variance = work[4], work[5]
    noise2, n = star[NOISE] ** 2, 0
    for r in range(height):
        for c in range(width):
            value = image_dn[top + r, left + c]
            light[r, c] = value - star[BACKGROUND]
            variance[r, c] = noise2 if value < saturation_dn else np.inf
            n += value < saturation_dn
    for j in range(others.shape[0]):
        _model(spots, others[j, 0], others[j, 1], left, top, width, height, work)
        for r in range(height):
            for c in range(width):
                other = others[j, FITTED_FLUX] * work[0, r, c]
                light[r, c] -= other
                variance[r, c] += other * dn_per_electron
    return n


@njit(cache=True)
def _equations(flux, window, dn_per_electron, work):
    """Normal equations of place and flux: six sums of the matrix, three of the right side, chi squared."""
    _, _, width, height = window
    xx, xy, yy, xf, yf, ff, bx, by, bf, chi2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    shot = flux * dn_per_electron
    for r in range(height):
        spot, slope_x, slope_y, light, variance = work[0, r], work[1, r], work[2, r], work[4, r], work[5, r]
        for c in range(width):
            weight = 1.0 / (variance[c] + shot * spot[c])
            rest = light[c] - flux * spot[c]
            to_x, to_y, to_f = weight * slope_x[c], weight * slope_y[c], weight * spot[c]
            xx += to_x * slope_x[c]
            xy += to_x * slope_y[c]
            yy += to_y * slope_y[c]
            xf += to_x * spot[c]
            yf += to_y * spot[c]
            ff += to_f * spot[c]
            bx += to_x * rest
            by += to_y * rest
            bf += to_f * rest
            chi2 += weight * rest * rest
    return (
        xx * flux * flux,
        xy * flux * flux,
        yy * flux * flux,
        xf * flux,
        yf * flux,
        ff,
        bx * flux,
        by * flux,
        bf,
        chi2,
    )


@njit(cache=True)
def _fit_one(image_dn, star, spots, others, saturation_dn, dn_per_electron, work, fitted):
    """Fit one object, less the light of the others; write to `fitted`, returns whether it succeeded."""
    window = _window(star, spots, image_dn.shape)
    n_used = _pixels(image_dn, star, spots, others, window, saturation_dn, dn_per_electron, work)
    if n_used < LEAST_PIXELS:
        return False
    left, top, width, height = window
    x, y, flux = star[X], star[Y], star[FLUX]
    sigma = spots[0, 2]
    for _ in range(MOST_STEPS):
        _model(spots, x, y, left, top, width, height, work)
        xx, xy, yy, xf, yf, ff, bx, by, bf, chi2 = _equations(flux, window, dn_per_electron, work)
        if ff <= 0.0:
            return False
        # flux eliminated: 2x2 equations of the place
        a, b, d = xx - xf * xf / ff, xy - xf * yf / ff, yy - yf * yf / ff
        det = a * d - b * b
        if not (a > 0.0 and det > 1e-12 * a * a):
            return False
        e, f = bx - xf * bf / ff, by - yf * bf / ff
        dx, dy = (d * e - b * f) / det, (a * f - b * e) / det
        d_flux = (bf - xf * dx - yf * dy) / ff
        step = np.hypot(dx, dy)
        scale = min(1.0, sigma / step) if step > 0.0 else 1.0
        x, y = x + scale * dx, y + scale * dy
        old_flux, flux = flux, max(flux + scale * d_flux, 0.3 * flux)
        if np.hypot(x - star[X], y - star[Y]) > FARTHEST_PX + 0.5 * sigma:
            return False
        if step < SMALL_STEP_PX and abs(flux - old_flux) < SMALL_STEP_FLUX * flux:
            break
    else:
        return False
    chi2 -= bx * dx + by * dy + bf * d_flux  # what the last step takes away
    if n_used < width * height and chi2 > MOST_MISFIT * n_used:
        return False
    factor = misfit_growth(chi2, n_used - 3.0, PRIOR_DOF)
    factor *= (old_flux / flux) ** 2  # the derivatives to the place grow with the flux
    fitted[0], fitted[1], fitted[2] = x, y, flux
    fitted[3], fitted[4], fitted[5] = factor * d / det, -factor * b / det, factor * a / det
    return True
