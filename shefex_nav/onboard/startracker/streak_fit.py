"""Place and light of one star by maximum likelihood from the pixels of its streak.

In: the pixels around a candidate and the motion. Out: place at the frame's instant, flux, covariance.

    pixels -> streak_search: where along (and across) the light is
           -> newton: place, flux and level; pixels far from the model lose their weight, then again
           -> the place along by the mean of the likelihood where the ends are faint; covariance

The model is a Gaussian spot on the exact path (`streak_path`): across, the Gaussian; along, the difference of
two normal distributions at the ends, which are those of each row's own exposure. The square of a pixel adds
its variance 1/12 px^2 to the spot's. The weights are the inverse variances of the pixels: noise of the frame
and shot noise of the model's light; saturated and bad pixels have none. The background has the level of its
tile, known to some error, and is fitted along.

Along a streak only its ends tell where it is. Below a signal-to-noise ratio of about twenty their error is
not small against their blur, the likelihood is a ragged ridge and its maximum no sufficient answer: there the
place along is the mean of the likelihood, and the variance that of the likelihood (a posterior with even
prior), which has the smallest mean squared error and says truly how large that is.
"""

from math import sqrt

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.onboard.startracker.attitude import product
from shefex_nav.onboard.startracker.spot import FREE_SUMS
from shefex_nav.onboard.startracker.streak_light import draw, first_of
from shefex_nav.onboard.startracker.streak_path import (
    LENGTH,
    SHARE,
    TX,
    TY,
    X0,
    Y0,
    path_of,
)
from shefex_nav.onboard.startracker.streak_search import (
    CHI2,
    DOF,
    FLUX,
    LEVEL,
    N_MASKED,
    N_PIXELS,
    NEAR_SIGMAS,
    PLACE_X,
    PLACE_Y,
    RATIO,
    XX,
    XY,
    YY,
    line_of,
    posterior,
    start_of,
)

MOST_STEPS = 8
MOST_ROUNDS = 3  # of fit and outliers
SMALL_STEP_PX = 0.03
SMALL_STEP_FLUX = 0.1  # relative; the flux is linear, only the weights wait for it
FARTHEST_PX = 3.0  # from the place that the search along found, across and along
OUTLIER_SIGMA = 5.0  # pixels further from the model are not this star's light
MODEL_ERROR = 0.25  # of the light in a pixel, that the model may be off by before a pixel is an outlier [E]
WING_ERROR = 0.02  # of the peak, likewise
POSTERIOR_PX = 0.25  # standard deviation along from which the mean of the likelihood is taken
PRIOR_DOF = 30.0  # weight of the expected misfit against the one seen [E]
LEAST_PIXELS = 8
CORE_PART = 0.1  # of the brightest pixel's light: what counts as a pixel of the star


@inner
def fit_one(turning, spot, search, pixels, path, fitted):
    """Fit one streak to its pixels.

    Parameters
    ----------
    turning : Turning
    spot : Spot
    search : Search, how far the star may be from its place in `fitted`
    pixels : Pixels; overwritten: their order, the model, and the variance of outliers
    path : (NUMBERS,) at the first place; overwritten by the fitted one
    fitted : (COLUMNS,) PLACE_X, PLACE_Y at the start; overwritten

    Returns
    -------
    n : number of pixels, the first ones of `pixels` now, that can have light of the streak; 0: no fit
    """
    line = line_of(path, spot.s, search.along_px)
    if not start_of(turning, spot, search, pixels, line, path, fitted):
        return 0
    near = _nearest(path, spot.s, pixels)
    draw(path, spot.s, near)
    fitted[FLUX], fitted[LEVEL], fitted[N_MASKED] = _first_flux(near), 0.0, 0.0
    if not (fitted[FLUX] > 0.0):
        return 0
    P = np.empty((4, 4))
    for _ in range(MOST_ROUNDS):
        if not newton(turning, spot, search.level_error_dn, near, path, fitted, P):
            return 0
        draw(path, spot.s, near)
        n_masked = _mask(spot, pixels, path, fitted)
        fitted[N_MASKED] += n_masked
        if n_masked == 0:
            break
    if not _sums(near, fitted) or not _covariance(turning, spot, pixels, near, line, path, fitted, P):
        return 0
    return near.x.shape[0] if path_of(turning, fitted[PLACE_X], fitted[PLACE_Y], path) else 0


@inner
def _nearest(path, s, pixels):
    """Put the pixels that can have light of the streak first; returns them. The others have no model."""
    near_across, near_along = NEAR_SIGMAS * s + 0.5, NEAR_SIGMAS * s + 1.0
    x, y, light, variance, model, d_along, d_across, time = pixels
    n = 0
    for k in range(x.shape[0]):
        dx, dy = x[k] - path[X0], y[k] - path[Y0]
        along, across = dx * path[TX] + dy * path[TY], dy * path[TX] - dx * path[TY]
        if abs(across) < near_across and -near_along < along < path[LENGTH] + near_along:
            for values in (x, y, light, variance):
                values[k], values[n] = values[n], values[k]
            n += 1
    for values in (model, d_along, d_across, time):
        values[n:] = 0.0
    return first_of(pixels, n)


@inner(error_model="numpy", fastmath=FREE_SUMS)
def _first_flux(pixels):
    """Flux by least squares at the place of the search."""
    up, norm = 0.0, 1e-300
    for k in range(pixels.x.shape[0]):
        w = pixels.model[k] / pixels.variance[k]
        up += w * pixels.light[k]
        norm += w * pixels.model[k]
    return up / norm


@inner(error_model="numpy", fastmath=FREE_SUMS)
def _equations(flux, level, dn_per_electron, pixels, A, g):
    """Normal equations of the shift along and across, flux and level; returns chi squared.

    A (4, 4) and g (4,) are written.
    """
    aa, ac, af, ab, cc, cf, cb, ff, fb, bb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ga, gc, gf, gb, chi2 = 0.0, 0.0, 0.0, 0.0, 0.0
    _, _, light, variance, model, along, across, _ = pixels
    shot = flux * dn_per_electron
    for k in range(light.shape[0]):
        m, a, c = model[k], along[k], across[k]
        w = 1.0 / (variance[k] + shot * m)
        rest = light[k] - level - flux * m
        wa, wc, wm, wr = w * a, w * c, w * m, w * rest
        aa += wa * a
        ac += wa * c
        af += wa * m
        ab += wa
        cc += wc * c
        cf += wc * m
        cb += wc
        ff += wm * m
        fb += wm
        bb += w
        ga += wr * a
        gc += wr * c
        gf += wr * m
        gb += wr
        chi2 += wr * rest
    square = flux * flux
    A[0, 0], A[0, 1], A[0, 2], A[0, 3] = aa * square, ac * square, af * flux, ab * flux
    A[1, 1], A[1, 2], A[1, 3], A[2, 2], A[2, 3], A[3, 3] = cc * square, cf * flux, cb * flux, ff, fb, bb
    for i in range(4):
        for j in range(i):
            A[i, j] = A[j, i]
    g[0], g[1], g[2], g[3] = flux * ga, flux * gc, gf, gb
    return chi2


@inner
def _inverse(A, out):
    """Inverse of a positive definite (4, 4) matrix by Cholesky's method; False if it is none."""
    L, b = np.empty((4, 4)), np.empty(4)
    for i in range(4):
        for j in range(i + 1):
            value = A[i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            if i == j:
                if not value > 1e-12 * A[i, i] or not A[i, i] > 0.0:
                    return False
                L[i, i] = sqrt(value)
            else:
                L[i, j] = value / L[j, j]
    for c in range(4):
        for i in range(4):
            value = 1.0 if i == c else 0.0
            for k in range(i):
                value -= L[i, k] * b[k]
            b[i] = value / L[i, i]
        for i in range(3, -1, -1):
            value = b[i]
            for k in range(i + 1, 4):
                value -= L[k, i] * out[k, c]
            out[i, c] = value / L[i, i]
    return True


@inner
def newton(turning, spot, level_error_dn, pixels, path, fitted, P):
    """Gauss and Newton from the place, flux and level in `fitted`, which is overwritten.

    Where the ends are not sure enough (POSTERIOR_PX) the place along stays as it is. P (4, 4) is the
    covariance of along, across, flux, level. Returns whether it settled.
    """
    A, g = np.empty((4, 4)), np.empty(4)
    x, y, flux, level = fitted[PLACE_X], fitted[PLACE_Y], fitted[FLUX], fitted[LEVEL]
    x_start, y_start = x, y
    for _ in range(MOST_STEPS):
        if not path_of(turning, x, y, path):
            return False
        draw(path, spot.s, pixels)
        chi2 = _equations(flux, level, spot.dn_per_electron, pixels, A, g)
        A[3, 3] += 1.0 / level_error_dn**2
        g[3] -= level / level_error_dn**2
        solved, step = _step(A, g, P)
        if not solved:
            return False
        length = np.hypot(step[0], step[1])
        scale = min(1.0, spot.s / length) if length > 0.0 else 1.0
        x += scale * (step[0] * path[TX] - step[1] * path[TY])
        y += scale * (step[0] * path[TY] + step[1] * path[TX])
        level += scale * step[3]
        flux = max(flux + scale * step[2], 0.3 * flux)
        if np.hypot(x - x_start, y - y_start) > FARTHEST_PX + spot.s:
            return False
        if length < SMALL_STEP_PX and abs(step[2]) < SMALL_STEP_FLUX * flux:
            fitted[PLACE_X], fitted[PLACE_Y], fitted[FLUX], fitted[LEVEL] = x, y, flux, level
            fitted[CHI2] = chi2 - (g * step).sum()
            return path_of(turning, x, y, path)
    return False


@inner
def _step(A, g, P):
    """Solve the normal equations: whether they can be, and the step. P is written; A is spoilt."""
    if not _inverse(A, P):
        return False, g.reshape(4, 1)[:, 0]
    if P[0, 0] <= POSTERIOR_PX**2:
        return True, product(P, g.reshape(4, 1))[:, 0]
    A[0, 0] *= 1e6
    held = np.empty((4, 4))
    return _inverse(A, held), product(held, g.reshape(4, 1))[:, 0]


@inner(error_model="numpy", fastmath=FREE_SUMS)
def _mask(spot, pixels, path, fitted):
    """Take the weight from pixels that are too bright or too dark for the model; returns how many."""
    flux, level = fitted[FLUX], fitted[LEVEL]
    peak = path[SHARE] * min(1.0, path[LENGTH] / (2.5 * spot.s)) * 0.4 / spot.s
    n_masked = 0
    for k in range(pixels.x.shape[0]):
        m = pixels.model[k]
        variance = pixels.variance[k] + flux * spot.dn_per_electron * m
        variance += (MODEL_ERROR * flux * m) ** 2 + (WING_ERROR * flux * peak) ** 2
        rest = pixels.light[k] - level - flux * m
        if pixels.variance[k] < np.inf and rest * rest > OUTLIER_SIGMA**2 * variance:
            pixels.variance[k] = np.inf
            n_masked += 1
    return n_masked


@inner
def _covariance(turning, spot, pixels, near, line, path, fitted, P):
    """Covariance of a settled fit, and the mean along where it is due; False if it is none."""
    turn = np.array([[path[TX], -path[TY]], [path[TY], path[TX]]])
    cov = P[:2, :2].copy()
    if cov[0, 0] > POSTERIOR_PX**2:
        mean, spread = posterior(spot, pixels, line, path, fitted)
        wider = max(spread / cov[0, 0], 0.5)
        cov[0, 0] *= wider
        cov[0, 1] *= sqrt(wider)
        cov[1, 0] *= sqrt(wider)
        fitted[PLACE_X] += mean * path[TX]
        fitted[PLACE_Y] += mean * path[TY]
    cov *= max(1.0, (PRIOR_DOF + fitted[CHI2]) / (PRIOR_DOF + fitted[DOF]))
    P_px = product(product(turn, cov), turn.T)
    fitted[XX], fitted[XY], fitted[YY] = P_px[0, 0], P_px[0, 1], P_px[1, 1]
    return P_px[0, 0] > 0.0 and P_px[0, 0] * P_px[1, 1] > P_px[0, 1] ** 2


@inner(error_model="numpy", fastmath=FREE_SUMS)
def _sums(pixels, fitted):
    """Signal-to-noise ratio and number of pixels of a settled fit; False if it has too few."""
    n_used, n_core, up, norm, most = 0, 0, 0.0, 0.0, 0.0
    for k in range(pixels.x.shape[0]):
        m = pixels.model[k]
        most = max(most, m)
        if pixels.variance[k] < np.inf:
            n_used += 1
            up += m * (pixels.light[k] - fitted[LEVEL]) / pixels.variance[k]
            norm += m * m / pixels.variance[k]
    for k in range(pixels.x.shape[0]):
        n_core += pixels.model[k] > CORE_PART * most
    if n_used < LEAST_PIXELS or norm <= 0.0:
        return False
    fitted[RATIO], fitted[N_PIXELS], fitted[DOF] = up / sqrt(norm), n_core, n_used - 3.0
    return True
