"""Whether a fitted streak is a star's: what does not move as the stars do looks different.

In: the pixels of a fitted streak. Out: a verdict. A star's light lies evenly along its streak, ends where the
streak ends, and on its line. A hit or a hot pixel has its light in few pixels (those have lost their weight
as outliers, and what is left is no star), a satellite or a proton trail goes on past the ends, stops before
them, or leaves the line at an angle. Each question is a normal or chi-square variable with the noise of the
pixels, to which tolerances are added for what stars really look like: a width that is a little wrong, a
path that the rate knows to P_omega_c, a neighbour too faint to be found.
"""

from math import sqrt

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry.streak import turn_jacobian
from shefex_nav.onboard.startracker.spot import FREE_SUMS, REACH
from shefex_nav.onboard.startracker.streak_light import bell, first_of
from shefex_nav.onboard.startracker.streak_path import BEGIN, END, LENGTH, TX, TY, X0, Y0
from shefex_nav.onboard.startracker.streak_search import (
    FLUX,
    LEVEL,
    N_MASKED,
    N_PIXELS,
    PLACE_X,
    PLACE_Y,
    RATIO,
)

STAR, UNEVEN, LONGER, TILTED, COMPACT, MISFIT = range(6)
SEGMENT_SIGMAS = 4.0  # least length of a part of a streak
MOST_SEGMENTS = 12
SHORT_SIGMAS = 6.0  # a shorter streak is judged as a spot
CLEAR_SIGMAS = 1.5  # light beyond the ends is looked for from here on
UNEVEN_PART = 0.15  # of the light per length, that may be uneven [E]
LIMIT_SIGMA = 3.5  # of each question: a star fails it once in 4000
CORE_PART = 0.1  # of the brightest pixel's light: pixels with light
TILT_PX = 0.4  # from end to end, besides what the rate allows [E]
MODEL_PART = 0.2  # of the light in a pixel, that a star's may differ from the model [E]
MASKED_PART = 0.25  # of the pixels with most of the light; more outliers than that is no star


@inner
def judge(turning, spot, pixels, n_near, path, fitted):
    """Verdict on a fitted streak: STAR, or why it is none.

    Parameters
    ----------
    turning : Turning
    spot : Spot
    pixels : Pixels, as `streak_fit.fit_one` left them: with the model of the fitted place
    n_near : number of the first ones, the others have no model
    path : (NUMBERS,) fitted
    fitted : (COLUMNS,)
    """
    if fitted[N_MASKED] > max(2.0, MASKED_PART * fitted[N_PIXELS]):
        return COMPACT
    if _one_pixel(pixels, fitted):
        return COMPACT
    if _misfit(spot, first_of(pixels, n_near), fitted):
        return MISFIT
    if path[LENGTH] < SHORT_SIGMAS * spot.s:
        return STAR
    return _along(turning, spot, pixels, path, fitted)


@inner
def _one_pixel(pixels, fitted):
    """Whether one pixel alone explains more than the star does."""
    n, level, ratio2 = 0, fitted[LEVEL], fitted[RATIO] * fitted[RATIO]
    for k in range(pixels.x.shape[0]):
        light = pixels.light[k] - level
        n += light * light > ratio2 * pixels.variance[k]
    return n > 0


@inner(error_model="numpy", fastmath=FREE_SUMS)
def _misfit(spot, pixels, fitted):
    """Whether the pixels with light fit worse than a star's, its model's error allowed for."""
    flux, level, least = fitted[FLUX], fitted[LEVEL], CORE_PART * pixels.model.max()
    chi2, n_core, shot = 0.0, 0, flux * spot.dn_per_electron
    for k in range(pixels.x.shape[0]):
        m = pixels.model[k]
        if m > least and pixels.variance[k] < np.inf:
            rest = pixels.light[k] - level - flux * m
            chi2 += rest * rest / (pixels.variance[k] + shot * m + (MODEL_PART * flux * m) ** 2)
            n_core += 1
    return chi2 > _largest(float(n_core))


@inner(error_model="numpy", fastmath=FREE_SUMS)
def _along(turning, spot, pixels, path, fitted):
    """Evenness, ends and direction of a long streak."""
    s, flux, level, length = spot.s, fitted[FLUX], fitted[LEVEL], path[LENGTH]
    n_parts = int(min(max(length / (SEGMENT_SIGMAS * s), 2.0), MOST_SEGMENTS))
    # of each part: sum w r m, sum w m^2; of the last four: near and far beyond the ends
    parts = np.zeros((n_parts + 4, 2))
    tilt = np.zeros(6)  # sums of w r c, w r c a, w c c, w c c a, w c c a a
    near, far = CLEAR_SIGMAS * s, (CLEAR_SIGMAS + SEGMENT_SIGMAS) * s
    for k in range(pixels.x.shape[0]):
        if not pixels.variance[k] < np.inf:
            continue
        dx, dy = pixels.x[k] - path[X0], pixels.y[k] - path[Y0]
        along, m = dx * path[TX] + dy * path[TY], pixels.model[k]
        w = 1.0 / (pixels.variance[k] + flux * spot.dn_per_electron * m)
        rest = pixels.light[k] - level - flux * m
        if along < 0.0 or along > length:
            past = -along if along < 0.0 else along - length
            if past < near or past > far + 0.35 * length:
                continue
            across = (dy * path[TX] - dx * path[TY]) / s
            m = bell(across * across) / (s * length) if abs(across) < REACH else 0.0
            part = (0 if past < far else 1) + (n_parts if along < 0.0 else n_parts + 2)
        else:
            part = min(int(along / length * n_parts), n_parts - 1)
            c, a = flux * pixels.d_across[k], along / length - 0.5
            tilt[0] += w * rest * c
            tilt[1] += w * rest * c * a
            tilt[2] += w * c * c
            tilt[3] += w * c * c * a
            tilt[4] += w * c * c * a * a
        parts[part, 0] += w * rest * m
        parts[part, 1] += w * m * m
    return _verdict(turning, path, parts, tilt, fitted)


@inner
def _verdict(turning, path, parts, tilt, fitted):
    """The verdict of the sums."""
    flux, n_parts = fitted[FLUX], parts.shape[0] - 4
    chi2, dof = 0.0, 0
    for p in range(n_parts + 4):
        if parts[p, 1] <= 0.0:
            continue
        off, variance = parts[p, 0] / parts[p, 1], 1.0 / parts[p, 1]
        if p < n_parts:
            chi2 += off * off / (variance + (UNEVEN_PART * flux) ** 2)
            dof += 1
        elif off > LIMIT_SIGMA * sqrt(variance) + UNEVEN_PART * flux:
            return LONGER
    if dof > 1 and chi2 > _largest(dof - 1.0):
        return UNEVEN
    det = tilt[2] * tilt[4] - tilt[3] * tilt[3]
    if det > 0.0:
        slope = (tilt[2] * tilt[1] - tilt[3] * tilt[0]) / det  # px from end to end
        J = turn_jacobian(turning.camera, fitted[PLACE_X], fitted[PLACE_Y]) * (path[END] - path[BEGIN])
        across = -path[TY] * J[0] + path[TX] * J[1]
        variance = tilt[2] / det + across @ turning.P_omega_c @ across
        if abs(slope) > LIMIT_SIGMA * sqrt(variance) + TILT_PX:
            return TILTED
    return STAR


@inner
def _largest(dof):
    """Chi squared that LIMIT_SIGMA stands for, by its expansion of Cornish and Fisher."""
    return dof + LIMIT_SIGMA * sqrt(2.0 * dof) + 2.0 / 3.0 * (LIMIT_SIGMA**2 - 1.0)
