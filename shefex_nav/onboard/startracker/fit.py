"""Centroids by fitting the frame's own star shape: as good as the noise allows, and with a covariance.

In: the frame, its objects and their `Shape`. Out: place, flux and covariance of each. The model is the
Gaussian spot, drawn along the streak and integrated over each pixel, on a background that is known; place and
flux follow by weighted least squares. The weights are the inverse variances of the pixels: the noise that the
frame shows without stars (read noise, shot noise of the background, quantisation) and the shot noise of the
model's own light. Bad and saturated pixels have no weight: of the brightest stars the slopes are fitted.

A star whose neighbour is an object too is fitted again with the neighbour's light taken away. Where the
pixels do not look like one star (an unresolved neighbour, a particle hit), the misfit makes the covariance
larger.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.likelihood import misfit_growth
from shefex_nav.onboard.startracker.scan import FLUX, X, Y, weighted
from shefex_nav.onboard.startracker.shape import measure
from shefex_nav.onboard.startracker.spot import (
    LARGEST_REACH,
    SEEN,
    SPOT,
    TO_X,
    TO_XX,
    TO_XY,
    TO_Y,
    TO_YY,
    VARIANCE,
    WINDOW,
    WORK,
    curves,
    model,
    pixels,
    spots_of,
    window_of,
)

MOST_STEPS = 5  # a star needs two; what needs more is none
SMALL_STEP_PX = 0.02  # the next step of Gauss and Newton would be the square of that
SMALL_STEP_FLUX = 0.3  # relative; the flux is linear, only the weights wait for it
FARTHEST_PX = 2.0  # from the first centroid; further away it is not this star that is fitted
LEAST_PIXELS = 6  # with light, that are not saturated
PRIOR_DOF = 30.0  # weight of the expected misfit against the one seen [E]
UNFITTED_PX = 0.15  # error of the scan's centroid of what the shape does not fit, per axis [E]
# chi squared per pixel of a star that lacks some, saturated or known to be bad: what is left of it, where it
# fits worse, says nothing of its place. A star that is all there keeps its place, with a greater covariance
MOST_MISFIT = 9.0

# columns of the result
COLUMNS = 6  # x, y, flux, xx, xy, yy


@kernel
def centroids(picture, table, default_sigma_px):
    """Place, flux and covariance of all objects of a frame.

    What cannot be fitted keeps the centroid of the scan, with a covariance that does not trust it.

    Parameters
    ----------
    picture : Picture
    table : (n, scan.COLUMNS) objects
    default_sigma_px : float, width of a spot where the frame does not show it

    Returns
    -------
    xy_px (n, 2), flux_dn (n,), P_px (n, 2, 2)
    """
    shape, P_S = measure(picture, table, default_sigma_px)
    fitted, good = fit(picture, table, shape, P_S)
    xy_px, flux, P_px = weighted(table, picture.dn_per_electron)
    for k in range(table.shape[0]):
        if good[k]:
            xy_px[k, 0], xy_px[k, 1], flux[k] = fitted[k, 0], fitted[k, 1], fitted[k, 2]
            P_px[k, 0, 0], P_px[k, 1, 1] = fitted[k, 3], fitted[k, 5]
            P_px[k, 0, 1] = P_px[k, 1, 0] = fitted[k, 4]
        else:
            P_px[k, 0, 0] += UNFITTED_PX**2
            P_px[k, 1, 1] += UNFITTED_PX**2
    return xy_px, flux, P_px


@inner
def fit(picture, table, shape, P_S):
    """Fit all objects of a frame.

    Parameters
    ----------
    picture : Picture
    table : (n, scan.COLUMNS) objects
    shape : Shape
    P_S : (3, 3) px^4, covariance of xx, xy, yy of the shape

    Returns
    -------
    fitted : (n, 6) x, y, flux, and xx, xy, yy of the covariance [px^2]
    good : (n,) bool; where it is False no fit was possible and the row is not to be used
    """
    n = table.shape[0]
    spots = spots_of(shape)
    fitted, good = np.empty((n, COLUMNS)), np.zeros(n, dtype=np.bool_)
    # a neighbour's light counts over the greatest window of both
    spread = shape.sigma_px + 0.3 * max(abs(shape.streak_x), abs(shape.streak_y))
    near_px = 2.0 * min(WINDOW[0] * spread + 1.0, LARGEST_REACH)
    work, others = np.empty(WORK), np.empty((n, COLUMNS))
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
            good[k] = _fit_one(picture, table[k], spots, P_S, others[:n_others], work, fitted[k])
    return fitted, good


@inner(error_model="numpy")
def _equations(flux, window, dn_per_electron, work):
    """Normal equations of place and flux: six sums of the matrix, three of the right side, chi squared."""
    _, _, width, height = window
    xx, xy, yy, xf, yf, ff, bx, by, bf, chi2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    shot = flux * dn_per_electron
    for r in range(height):
        spot, slope_x, slope_y = work[SPOT, r], work[TO_X, r], work[TO_Y, r]
        light, variance = work[SEEN, r], work[VARIANCE, r]
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


@inner
def _fit_one(picture, star, spots, P_S, others, work, fitted):
    """Fit one object, less the light of the others; write to `fitted`, returns whether it succeeded."""
    window = window_of(star, spots, picture.image_dn.shape)
    n_used = pixels(picture, star, spots, others, window, work)
    if n_used < LEAST_PIXELS:
        return False
    _, _, width, height = window
    x, y, flux = star[X], star[Y], star[FLUX]
    sigma = spots[0, 2]
    for _ in range(MOST_STEPS):
        model(spots, x, y, window, work)
        xx, xy, yy, xf, yf, ff, bx, by, bf, chi2 = _equations(flux, window, picture.dn_per_electron, work)
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
    curves(spots, x, y, window, work)
    fitted[3:] += _of_shape(old_flux, window, picture.dn_per_electron, work, (a, b, d, xf / ff, yf / ff), P_S)
    return True


@inner(error_model="numpy")
def _of_shape(flux, window, dn_per_electron, work, place, P_S):
    """What the error of the shape adds to the covariance of a place: xx, xy, yy [px^2].

    A shape that is wrong by dS moves the place by -A^-1 B dS, A of place alone with the flux eliminated, B
    between place and shape; place: A (xx, xy, yy), and of the flux xf / ff, yf / ff.
    """
    a, b, d, x_by_flux, y_by_flux = place
    _, _, width, height = window
    x_xx, x_xy, x_yy, y_xx, y_xy, y_yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for r in range(height):
        spot, slope_x, slope_y, variance = work[SPOT, r], work[TO_X, r], work[TO_Y, r], work[VARIANCE, r]
        to_xx, to_xy, to_yy = work[TO_XX, r], work[TO_XY, r], work[TO_YY, r]
        for c in range(width):
            weight = flux / (variance[c] + flux * dn_per_electron * spot[c])
            to_x = weight * (flux * slope_x[c] - x_by_flux * spot[c])
            to_y = weight * (flux * slope_y[c] - y_by_flux * spot[c])
            x_xx += to_x * to_xx[c]
            x_xy += to_x * to_xy[c]
            x_yy += to_x * to_yy[c]
            y_xx += to_y * to_xx[c]
            y_xy += to_y * to_xy[c]
            y_yy += to_y * to_yy[c]
    det = a * d - b * b
    K_x = (d * x_xx - b * y_xx) / det, (d * x_xy - b * y_xy) / det, (d * x_yy - b * y_yy) / det
    K_y = (a * y_xx - b * x_xx) / det, (a * y_xy - b * x_xy) / det, (a * y_yy - b * x_yy) / det
    P = np.zeros(3)
    for i in range(3):
        for j in range(3):
            P[0] += K_x[i] * P_S[i, j] * K_x[j]
            P[1] += K_x[i] * P_S[i, j] * K_y[j]
            P[2] += K_y[i] * P_S[i, j] * K_y[j]
    return P
