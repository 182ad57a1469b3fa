"""Place and light of one star by maximum likelihood from the pixels of its streak.

In: the pixels around a candidate and the motion. Out: place at the frame's instant, flux, covariance. The
model is a Gaussian spot on the exact path (`streak_path`): across, the Gaussian; along, the difference of two
normal distributions at the ends, which are those of each row's own exposure. The square of a pixel adds its
variance 1/12 px^2 to the spot's (0.2 per cent of the peak at sigma = 1, 0.7 at 0.6: tests). The weights are
the inverse variances of the pixels: noise of the frame and shot noise of the model's light; saturated and bad
pixels have none. The background has the level of its tile, known to some error, and is fitted along.

Along a streak only its ends tell where it is. Below a signal-to-noise ratio of about twenty their error is
not small against their blur, the likelihood is a ragged ridge and its maximum no sufficient answer: there the
place along is the mean of the likelihood, and the variance that of the likelihood (a posterior with even
prior), which has the smallest mean squared error and says truly how large that is.
"""

from math import exp, sqrt

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.streak_light import (
    ACROSS,
    ALONG,
    BEYOND_SIGMAS,
    LIGHT,
    MODEL,
    TIME,
    VARIANCE,
    X,
    Y,
    density,
    draw,
    normal,
)
from shefex_nav.onboard.startracker.streak_path import (
    LENGTH,
    SAG,
    SHARE,
    TX,
    TY,
    X0,
    Y0,
    path_of,
    rate_jacobian,
)

SEARCH_PX = (2.5, 12.0)  # shortest and longest search along, each way
SEARCH_PART = 0.3  # of the length
PROFILE_PX = 0.5  # step of the profile along
SHIFT_PX = 0.25  # step of the search along
MOST_STEPS = 8
SMALL_STEP_PX = 0.03
SMALL_STEP_FLUX = 0.1  # relative; the flux is linear, only the weights wait for it
FARTHEST_PX = 3.0  # from the place that the search along found, across and along
OUTLIER_SIGMA = 5.0  # pixels further from the model are not this star's light
MODEL_ERROR = 0.25  # of the light in a pixel, that the model may be off by before a pixel is an outlier [E]
WING_ERROR = 0.02  # of the peak, likewise
POSTERIOR_PX = 0.25  # standard deviation along from which the mean of the likelihood is taken
PRIOR_DOF = 30.0  # weight of the expected misfit against the one seen [E]
LEAST_PIXELS = 8
CAPTURE_SIGMAS = 1.3  # so far across the line the fit finds its star without a search
ACROSS_STEP = 1.5  # sigmas, of a search across
EARLY_PART = 0.8  # half a sigma beside the line a streak shows 0.94 of its ratio
NEAR_SIGMAS = 3.5  # around the streak: pixels of the fit; the others are for the search
CORE_PART = 0.1  # of the brightest pixel's light: what counts as a pixel of the star

# columns of a fit
PLACE_X, PLACE_Y, FLUX, LEVEL, RATIO, XX, XY, YY, N_PIXELS, N_SATURATED, N_MASKED, CHI2, DOF = range(13)
COLUMNS = 13


@njit(cache=True)
def reach_px(length_px, sigma_px):
    """How far each way the search along a streak goes."""
    return min(max(SEARCH_PART * length_px, SEARCH_PX[0]), SEARCH_PX[1]) + sigma_px


@njit(cache=True)
def profile(path, s, flux, level, dn_per_electron, n, start, sums, work):
    """Matched sums across at steps of PROFILE_PX along the streak.

    sums[0] = sum w d g, sums[1] = sum w g^2 over the pixels of a step, g the light per px of length of flux
    one; the weights w take the shot noise of a star of this flux where it would shine.
    """
    sums[:] = 0.0
    n_steps, per_s, shot = sums.shape[1], 1.0 / s, max(flux, 0.0) * dn_per_electron
    tx, ty, x_0, y_0, per_length = path[TX], path[TY], path[X0], path[Y0], 1.0 / path[LENGTH]
    bend, height = 4.0 * path[SAG], path[SHARE] / s
    for k in range(n):
        dx, dy = work[X, k] - x_0, work[Y, k] - y_0
        along = dx * tx + dy * ty
        u = min(max(along * per_length, 0.0), 1.0)
        z = (dy * tx - dx * ty - bend * u * (1.0 - u)) * per_s
        place = (along - start) * (1.0 / PROFILE_PX)
        if abs(z) > NEAR_SIGMAS or place < 0.0 or place >= n_steps - 1:
            continue
        g = height * density(z)
        w = g / (work[VARIANCE, k] + shot * work[MODEL, k])
        index = np.uint64(place)
        f = place - index
        up, norm = w * (work[LIGHT, k] - level), w * g
        sums[0, index] += (1.0 - f) * up
        sums[0, index + np.uint64(1)] += f * up
        sums[1, index] += (1.0 - f) * norm
        sums[1, index + np.uint64(1)] += f * norm


@njit(cache=True, fastmath=True)
def shifts(path, s, start, reach, sums, ratio):
    """Signal-to-noise ratio of the streak shifted along by -reach ... reach in steps of SHIFT_PX.

    SHIFT_PX is half of PROFILE_PX: the streak is drawn at both halves, and each shift takes one of them.
    Writes ratio; returns the number of steps.
    """
    n_shifts, n_steps = 2 * int(reach / SHIFT_PX) + 1, sums.shape[1]
    first = int(np.rint(start / SHIFT_PX)) - n_shifts  # of the box, in steps of SHIFT_PX from the first end
    box = np.empty((2, n_steps + n_shifts + 1))
    for j in range(box.shape[1]):
        for half in range(2):
            along = (2 * j + half + first) * SHIFT_PX
            box[half, j] = normal(along / s)[0] - normal((along - path[LENGTH]) / s)[0]
    up_sums, norm_sums = sums[0], sums[1]
    for i in range(n_shifts):
        back = n_shifts - (i - n_shifts // 2)
        part = box[back & 1, back >> 1 : (back >> 1) + n_steps]
        up, norm = 0.0, 0.0
        for j in range(n_steps):
            up += up_sums[j] * part[j]
            norm += norm_sums[j] * part[j] * part[j]
        ratio[i] = up / sqrt(norm) if norm > 0.0 else 0.0
    return n_shifts


@njit(cache=True, fastmath=True)
def _equations(flux, level, dn_per_electron, n, work, A, g):
    """Normal equations of the shift along and across, flux and level; returns chi squared.

    A (4, 4) and g (4,) are written.
    """
    aa, ac, af, ab, cc, cf, cb, ff, fb, bb = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ga, gc, gf, gb, chi2 = 0.0, 0.0, 0.0, 0.0, 0.0
    light, variance = work[LIGHT], work[VARIANCE]
    model, along, across = work[MODEL], work[ALONG], work[ACROSS]
    shot = flux * dn_per_electron
    for k in range(n):
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


@njit(cache=True)
def _rate_effect(flux, dn_per_electron, n, work, T):
    """Right sides that a motion of 1 px/s along and across, unknown to the model, would make: T (4, 2)."""
    T[:] = 0.0
    for k in range(n):
        m, t = work[MODEL, k], work[TIME, k]
        w = flux * t / (work[VARIANCE, k] + flux * dn_per_electron * m)
        a, c = work[ALONG, k], work[ACROSS, k]
        T[0, 0] += w * a * a * flux
        T[0, 1] += w * a * c * flux
        T[1, 0] += w * c * a * flux
        T[1, 1] += w * c * c * flux
        T[2, 0] += w * m * a
        T[2, 1] += w * m * c
        T[3, 0] += w * a
        T[3, 1] += w * c


@njit(cache=True)
def _inverse(A, out):
    """Inverse of a positive definite (4, 4) matrix by Cholesky's method; False if it is none."""
    L = np.zeros((4, 4))
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
        b = np.zeros(4)
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


@njit(cache=True)
def newton(camera, motion, s, dn_per_electron, level_error, n, path, work, fitted, P):
    """Gauss and Newton from the place, flux and level in `fitted`, which is overwritten.

    Where the ends are not sure enough (POSTERIOR_PX) the place along stays as it is. P (4, 4) is the
    covariance of along, across, flux, level. Returns whether it settled.
    """
    omega_c, times = motion
    A, g, held = np.empty((4, 4)), np.empty(4), np.empty((4, 4))
    x, y, flux, level = fitted[PLACE_X], fitted[PLACE_Y], fitted[FLUX], fitted[LEVEL]
    x_start, y_start = x, y
    for _ in range(MOST_STEPS):
        if not path_of(camera, times, omega_c, x, y, path):
            return False
        draw(path, s, n, work)
        chi2 = _equations(flux, level, dn_per_electron, n, work, A, g)
        A[3, 3] += 1.0 / level_error**2
        g[3] -= level / level_error**2
        if not _inverse(A, P):
            return False
        if P[0, 0] > POSTERIOR_PX**2:
            A[0, 0] *= 1e6
            if not _inverse(A, held):
                return False
            step = held @ g
        else:
            step = P @ g
        length = np.hypot(step[0], step[1])
        scale = min(1.0, s / length) if length > 0.0 else 1.0
        x += scale * (step[0] * path[TX] - step[1] * path[TY])
        y += scale * (step[0] * path[TY] + step[1] * path[TX])
        level += scale * step[3]
        flux = max(flux + scale * step[2], 0.3 * flux)
        if np.hypot(x - x_start, y - y_start) > FARTHEST_PX + s:
            return False
        if length < SMALL_STEP_PX and abs(step[2]) < SMALL_STEP_FLUX * flux:
            fitted[PLACE_X], fitted[PLACE_Y], fitted[FLUX], fitted[LEVEL] = x, y, flux, level
            fitted[CHI2] = chi2 - (g * step).sum()
            return path_of(camera, times, omega_c, x, y, path)
    return False


@njit(cache=True)
def mask(flux, level, s, path, dn_per_electron, n, work):
    """Take the weight from pixels that are too bright or too dark for the model; returns how many."""
    peak = path[SHARE] * min(1.0, path[LENGTH] / (2.5 * s)) * 0.4 / s
    n_masked = 0
    for k in range(n):
        m = work[MODEL, k]
        variance = work[VARIANCE, k] + flux * dn_per_electron * m
        variance += (MODEL_ERROR * flux * m) ** 2 + (WING_ERROR * flux * peak) ** 2
        rest = work[LIGHT, k] - level - flux * m
        if work[VARIANCE, k] < np.inf and rest * rest > OUTLIER_SIGMA**2 * variance:
            work[VARIANCE, k] = np.inf
            n_masked += 1
    return n_masked


@njit(cache=True)
def width2(s, level, n, work):
    """Variance of the spot across, px^2, that of a pixel included, by moments under the model as window.

    Spot S and window W = s^2 together have the variance m = (1/S + 1/W)^-1, near S = W: m = W/2 + (S - W)/4
    (adaptive moments: Bernstein & Jarvis 2002, AJ 123, 583).
    """
    total, second = 0.0, 0.0
    for k in range(n):
        if work[VARIANCE, k] < np.inf and work[MODEL, k] > 0.0:
            across = work[ACROSS, k] * s * s / work[MODEL, k]
            light = work[MODEL, k] * (work[LIGHT, k] - level)
            total += light
            second += light * across * across
    return max(4.0 * second / total - s * s, 0.0) if total > 0.0 else s * s


@njit(cache=True)
def posterior(path, s, fitted, dn_per_electron, n, start, sums, ratio, work):
    """Mean and variance of the shift along under the likelihood."""
    profile(path, s, fitted[FLUX], fitted[LEVEL], dn_per_electron, n, start, sums, work)
    n_shifts = shifts(path, s, start, SHIFT_PX * (ratio.shape[0] // 2), sums, ratio)
    best = ratio[:n_shifts].max()
    total, first, second = 0.0, 0.0, 0.0
    for i in range(n_shifts):
        r = max(ratio[i], 0.0)
        weight = exp(0.5 * (r * r - best * best))
        shift = (i - n_shifts // 2) * SHIFT_PX
        total += weight
        first += weight * shift
        second += weight * shift * shift
    mean = first / total
    return mean, second / total - mean * mean


@njit(cache=True)
def fit_one(
    camera, motion, P_omega_c, s, dn_per_electron, noise, level_sigma, search_px, least, n, path, work, fitted
):
    """Fit one streak to the pixels in work.

    Parameters
    ----------
    camera : Pinhole
    motion : (omega_c, RowTimes)
    P_omega_c : (3, 3) (rad/s)^2
    s : px, width with the pixel's own variance
    dn_per_electron : float, 0 where it is not known
    noise : DN, of a pixel
    level_sigma : error of the background, in units of noise
    search_px : (along, across) how far the star may be; along at least `reach_px`, across 0 for a candidate
    least : signal-to-noise ratio that is needed; EARLY_PART of it before the place across is known
    n : number of pixels in work
    path : (NUMBERS,) at the first place; overwritten by the fitted one
    work : (ROWS, MOST_PIXELS)
    fitted : (COLUMNS,) PLACE_X, PLACE_Y at the start; overwritten

    Returns
    -------
    bool
    """
    reach = max(search_px[0], reach_px(path[LENGTH], s))
    start = SHIFT_PX * np.floor(-(reach + BEYOND_SIGMAS * s + 1.0) / SHIFT_PX)
    sums = np.empty((2, int((path[LENGTH] - 2.0 * start) / PROFILE_PX) + 2))
    ratio = np.empty(2 * int(reach / SHIFT_PX) + 1)
    if not _search(
        camera, motion, s, dn_per_electron, n, search_px, least, path, start, sums, ratio, work, fitted
    ):
        return False
    n_near = _nearest(path, s, n, work)
    work[ALONG:, n_near:n] = 0.0
    draw(path, s, n_near, work)
    fitted[FLUX], fitted[LEVEL] = _first_flux(n_near, work), 0.0
    P = np.empty((4, 4))
    level_error = level_sigma * noise
    if not (fitted[FLUX] > 0.0):
        return False
    fitted[N_MASKED] = 0.0
    for _ in range(3):
        if not newton(camera, motion, s, dn_per_electron, level_error, n_near, path, work, fitted, P):
            return False
        draw(path, s, n_near, work)
        now = mask(fitted[FLUX], fitted[LEVEL], s, path, dn_per_electron, n, work)
        fitted[N_MASKED] += now
        if now == 0:
            break
    return _finish(
        camera, motion, P_omega_c, s, dn_per_electron, n, n_near, path, start, sums, ratio, work, fitted, P
    )


@njit(cache=True)
def _nearest(path, s, n, work):
    """Put the pixels that can have light of the streak first; returns how many they are."""
    near_across, near_along = NEAR_SIGMAS * s + 0.5, NEAR_SIGMAS * s + 1.0
    n_near = 0
    for k in range(n):
        dx, dy = work[X, k] - path[X0], work[Y, k] - path[Y0]
        along, across = dx * path[TX] + dy * path[TY], dy * path[TX] - dx * path[TY]
        if abs(across) < near_across and -near_along < along < path[LENGTH] + near_along:
            for i in (X, Y, LIGHT, VARIANCE):
                work[i, k], work[i, n_near] = work[i, n_near], work[i, k]
            n_near += 1
    work[MODEL, n_near:n] = 0.0
    return n_near


@njit(cache=True)
def _search(camera, motion, s, dn_per_electron, n, search_px, least, path, start, sums, ratio, work, fitted):
    """Move the start along the streak, and across if search_px says so, to where its sum is highest."""
    omega_c, times = motion
    x, y = fitted[PLACE_X], fitted[PLACE_Y]
    work[MODEL, :n] = 0.0
    n_across, step = (
        int(np.rint(max(search_px[1] - CAPTURE_SIGMAS * s, 0.0) / (ACROSS_STEP * s))),
        ACROSS_STEP * s,
    )
    x_first, y_first, best = path[X0], path[Y0], 0.0
    for across in range(-n_across, n_across + 1):
        path[X0], path[Y0] = x_first - across * step * path[TY], y_first + across * step * path[TX]
        profile(path, s, 0.0, 0.0, dn_per_electron, n, start, sums, work)
        n_shifts = shifts(path, s, start, SHIFT_PX * (ratio.shape[0] // 2), sums, ratio)
        i = np.argmax(ratio[:n_shifts])
        if ratio[i] > best:
            best, shift = ratio[i], (i - n_shifts // 2) * SHIFT_PX
            fitted[PLACE_X] = x + shift * path[TX] - across * step * path[TY]
            fitted[PLACE_Y] = y + shift * path[TY] + across * step * path[TX]
    if not best > EARLY_PART * least:
        return False
    return path_of(camera, times, omega_c, fitted[PLACE_X], fitted[PLACE_Y], path)


@njit(cache=True)
def _first_flux(n, work):
    """Flux by least squares at the place of the search."""
    up, norm = 0.0, 1e-300
    for k in range(n):
        w = work[MODEL, k] / work[VARIANCE, k]
        up += w * work[LIGHT, k]
        norm += w * work[MODEL, k]
    return up / norm


@njit(cache=True)
def _finish(
    camera, motion, P_omega_c, s, dn_per_electron, n, n_near, path, start, sums, ratio, work, fitted, P
):
    """Covariance, the mean along where it is due, and the sums of a settled fit."""
    omega_c, times = motion
    turn = np.array([[path[TX], -path[TY]], [path[TY], path[TX]]])
    T = np.empty((4, 2))
    _rate_effect(fitted[FLUX], dn_per_electron, n_near, work, T)
    # an error of the rate moves the light at time t by J domega t: what that does to the fitted place
    J = np.ascontiguousarray(P[:2]) @ T @ turn.T @ rate_jacobian(camera, fitted[PLACE_X], fitted[PLACE_Y])
    cov = P[:2, :2].copy()
    if cov[0, 0] > POSTERIOR_PX**2:
        mean, spread = posterior(path, s, fitted, dn_per_electron, n, start, sums, ratio, work)
        wider = max(spread / cov[0, 0], 0.5)
        cov[0, 0] *= wider
        cov[0, 1] *= sqrt(wider)
        cov[1, 0] *= sqrt(wider)
        fitted[PLACE_X] += mean * path[TX]
        fitted[PLACE_Y] += mean * path[TY]
    n_used, n_core, up, norm, most = 0, 0, 0.0, 0.0, 0.0
    for k in range(n_near):
        most = max(most, work[MODEL, k])
        if work[VARIANCE, k] < np.inf:
            m = work[MODEL, k]
            n_used += 1
            up += m * (work[LIGHT, k] - fitted[LEVEL]) / work[VARIANCE, k]
            norm += m * m / work[VARIANCE, k]
    for k in range(n_near):
        n_core += work[MODEL, k] > CORE_PART * most
    if n_used < LEAST_PIXELS or norm <= 0.0:
        return False
    fitted[RATIO], fitted[N_PIXELS], fitted[DOF] = up / sqrt(norm), n_core, n_used - 3.0
    cov *= max(1.0, (PRIOR_DOF + fitted[CHI2]) / (PRIOR_DOF + fitted[DOF]))
    P_px = turn @ (cov + J @ P_omega_c @ J.T) @ turn.T
    fitted[XX], fitted[XY], fitted[YY] = P_px[0, 0], P_px[0, 1], P_px[1, 1]
    return path_of(camera, times, omega_c, fitted[PLACE_X], fitted[PLACE_Y], path)
