"""Search along a streak: where on its line the light of a star is, as sums at small steps.

In: the pixels around a streak and its path. Out: the signal-to-noise ratio of the streak shifted along in
steps of a quarter of a pixel; of it the best place, from which `streak_fit` starts, and the mean and variance
under the likelihood, which is what `streak_fit` ends with where the ends of a streak are faint.

    pixels -> profile: matched sums across, at steps along
           -> shifts: each shift of the streak is a sum of the profile under a box with soft ends
"""

from math import exp, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.onboard.startracker.streak_light import BEYOND_SIGMAS, bell, share_below
from shefex_nav.onboard.startracker.streak_path import LENGTH, SAG, SHARE, TX, TY, X0, Y0, path_of

SEARCH_PX = (2.5, 12.0)  # shortest and longest search along, each way
SEARCH_PART = 0.3  # of the length
PROFILE_PX = 0.5  # step of the profile along
SHIFT_PX = 0.25  # step of the search along
CAPTURE_SIGMAS = 1.3  # so far across the line the fit finds its star without a search
ACROSS_STEP = 1.5  # sigmas, of a search across
EARLY_PART = 0.8  # half a sigma beside the line a streak shows 0.94 of its ratio
NEAR_SIGMAS = 3.5  # around the streak: pixels of the fit; the others are for the search

# columns of a fit
PLACE_X, PLACE_Y, FLUX, LEVEL, RATIO, XX, XY, YY, N_PIXELS, N_SATURATED, N_MASKED, CHI2, DOF = range(13)
COLUMNS = 13


class Search(NamedTuple):
    """How far a star may be from where it is expected, and what is asked of it."""

    along_px: float  # each way; at least `reach_px`
    across_px: float  # each way; 0 for a candidate
    least: float  # signal-to-noise ratio; EARLY_PART of it before the place across is known
    level_error_dn: float  # standard deviation of the background's level


class Line(NamedTuple):
    """Sums along a streak."""

    start_px: float  # along, of the first one from the streak's first end
    sums: np.ndarray  # (2, steps of PROFILE_PX) of `profile`
    ratio: np.ndarray  # (shifts,) odd number of steps of SHIFT_PX around none


@inner
def reach_px(length_px, s):
    """How far each way the search along a streak goes."""
    return min(max(SEARCH_PART * length_px, SEARCH_PX[0]), SEARCH_PX[1]) + s


@inner
def line_of(path, s, along_px):
    """Line, not written, with room for a search along_px each way."""
    reach = max(along_px, reach_px(path[LENGTH], s))
    start = SHIFT_PX * np.floor(-(reach + BEYOND_SIGMAS * s + 1.0) / SHIFT_PX)
    sums = np.empty((2, int((path[LENGTH] - 2.0 * start) / PROFILE_PX) + 2))
    return Line(start, sums, np.empty(2 * int(reach / SHIFT_PX) + 1))


@inner(error_model="numpy", fastmath=True)
def _beside(path, s, start_px, pixels, place, height):
    """Of each pixel the place along in steps of PROFILE_PX from start_px, and the light per px of length.

    The light is 0 further than NEAR_SIGMAS from the line.
    """
    tx, ty, x_0, y_0, per_length, per_s = path[TX], path[TY], path[X0], path[Y0], 1.0 / path[LENGTH], 1.0 / s
    bend, peak, xs, ys = 4.0 * path[SAG], path[SHARE] / s, pixels.x, pixels.y
    for k in range(xs.shape[0]):
        dx, dy = xs[k] - x_0, ys[k] - y_0
        along = dx * tx + dy * ty
        u = min(max(along * per_length, 0.0), 1.0)
        z = (dy * tx - dx * ty - bend * u * (1.0 - u)) * per_s
        height[k] = peak * bell(z * z) if z * z < NEAR_SIGMAS * NEAR_SIGMAS else 0.0
        place[k] = (along - start_px) * (1.0 / PROFILE_PX)


@inner(error_model="numpy")
def profile(path, spot, flux, level, pixels, line):
    """Matched sums across at steps of PROFILE_PX along the streak.

    sums[0] = sum w d g, sums[1] = sum w g^2 over the pixels of a step, g the light per px of length of flux
    one; the weights w take the shot noise of a star of this flux where it would shine.
    """
    line.sums[:] = 0.0
    up_sums, norm_sums, last = line.sums[0], line.sums[1], line.sums.shape[1] - 1
    _, _, light, variance, model, _, _, _ = pixels
    shot, n = max(flux, 0.0) * spot.dn_per_electron, light.shape[0]
    place, height = np.empty(n), np.empty(n)
    _beside(path, spot.s, line.start_px, pixels, place, height)
    for k in range(n):
        g, at = height[k], place[k]
        if g == 0.0 or at < 0.0 or at >= last:
            continue
        w = g / (variance[k] + shot * model[k])
        index = np.uint64(at)
        after, f = index + np.uint64(1), at - index
        up, norm = w * (light[k] - level), w * g
        up_sums[index] += (1.0 - f) * up
        up_sums[after] += f * up
        norm_sums[index] += (1.0 - f) * norm
        norm_sums[after] += f * norm


@inner(error_model="numpy", fastmath=True)
def shifts(path, s, line):
    """Write the signal-to-noise ratio of the streak shifted along in steps of SHIFT_PX.

    SHIFT_PX is half of PROFILE_PX: the streak is drawn at both halves, and each shift takes one of them.
    """
    n_shifts, n_steps = line.ratio.shape[0], line.sums.shape[1]
    first = int(np.rint(line.start_px / SHIFT_PX)) - n_shifts  # of the box, in SHIFT_PX from the first end
    box = np.empty((2, n_steps + n_shifts + 1))
    for half in range(2):
        soft, per_s = box[half], 1.0 / s
        for j in range(soft.shape[0]):
            along = (2 * j + half + first) * SHIFT_PX
            soft[j] = share_below(along * per_s) - share_below((along - path[LENGTH]) * per_s)
    up_sums, norm_sums = line.sums[0], line.sums[1]
    for i in range(n_shifts):
        back = n_shifts - (i - n_shifts // 2)
        part = box[back & 1, back >> 1 : (back >> 1) + n_steps]
        up, norm = 0.0, 0.0
        for j in range(n_steps):
            up += up_sums[j] * part[j]
            norm += norm_sums[j] * part[j] * part[j]
        line.ratio[i] = up / sqrt(norm) if norm > 0.0 else 0.0


@inner
def start_of(turning, spot, search, pixels, line, path, fitted):
    """Move the start along the streak, and across if it is searched, to where its sum is highest.

    Returns False where that is too little; else path and place are those of the best.
    """
    x, y, ratio = fitted[PLACE_X], fitted[PLACE_Y], line.ratio
    pixels.model[:] = 0.0
    step = ACROSS_STEP * spot.s
    n_across = int(np.rint(max(search.across_px - CAPTURE_SIGMAS * spot.s, 0.0) / step))
    x_first, y_first, best = path[X0], path[Y0], 0.0
    for across in range(-n_across, n_across + 1):
        path[X0], path[Y0] = x_first - across * step * path[TY], y_first + across * step * path[TX]
        profile(path, spot, 0.0, 0.0, pixels, line)
        shifts(path, spot.s, line)
        i = np.argmax(ratio)
        if ratio[i] > best:
            best, shift = ratio[i], (i - ratio.shape[0] // 2) * SHIFT_PX
            fitted[PLACE_X] = x + shift * path[TX] - across * step * path[TY]
            fitted[PLACE_Y] = y + shift * path[TY] + across * step * path[TX]
    if not best > EARLY_PART * search.least:
        return False
    return path_of(turning, fitted[PLACE_X], fitted[PLACE_Y], path)


@inner
def posterior(spot, pixels, line, path, fitted):
    """Mean and variance of the shift along under the likelihood."""
    profile(path, spot, fitted[FLUX], fitted[LEVEL], pixels, line)
    shifts(path, spot.s, line)
    n_shifts, best = line.ratio.shape[0], line.ratio.max()
    total, first, second = 0.0, 0.0, 0.0
    for i in range(n_shifts):
        r = max(line.ratio[i], 0.0)
        weight = exp(0.5 * (r * r - best * best))
        shift = (i - n_shifts // 2) * SHIFT_PX
        total += weight
        first += weight * shift
        second += weight * shift * shift
    mean = first / total
    return mean, second / total - mean * mean
