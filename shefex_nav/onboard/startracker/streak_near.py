"""Streaks near predicted places: the fit of `streaks` without the search through the frame.

In: the frame, the motion, predicted places with covariances. Out: the stars found there. Level and noise come
from two strips beside each streak, the noise as the median of all: 200 pixels tell it to 10 per cent only.
"""

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.background import SIGMA_QUANTILE
from shefex_nav.onboard.startracker.matched import looks, threshold
from shefex_nav.onboard.startracker.streak_fit import (
    COLUMNS,
    FLUX,
    N_SATURATED,
    PLACE_X,
    PLACE_Y,
    RATIO,
    fit_one,
    reach_px,
)
from shefex_nav.onboard.startracker.streak_light import (
    MOST_PIXELS,
    PIXEL_VARIANCE,
    ROWS,
    collect,
    take_away,
)
from shefex_nav.onboard.startracker.streak_path import (
    LENGTH,
    NUMBERS,
    TX,
    TY,
    X0,
    X1,
    Y0,
    Y1,
    path_of,
    touching,
)
from shefex_nav.onboard.startracker.streak_shape import STAR, judge

SEARCH_SIGMAS = 3.0  # around a predicted place
LEAST_SEARCH_PX = 0.5
MOST_SEARCH_PX = 20.0
STRIP_SIGMAS = 4.0  # from the line of the streak to the strips beside it
STRIP_PX = 5.0  # their width
STRIP_ENDS_PX = 8.0  # beyond the ends of the streak
MOST_STRIP = 256  # pixels of a strip that are looked at
LEAST_STRIP = 60
LEVEL_SIGMA = 0.1  # of the noise of a pixel: error of the level of a strip
LEAST_INSIDE = 0.5  # of a streak in the frame: its middle, then
LEAST_NOISE = np.sqrt(1.0 / 12.0)  # DN, quantisation


@njit(cache=True)
def fit_near(
    image_dn,
    bad,
    camera,
    motion,
    P_omega_c,
    xy_px,
    P_px,
    sigma_px,
    dn_per_electron,
    saturation_dn,
    false_objects,
):
    """Fit the streaks near predictions.

    Parameters
    ----------
    image_dn : (rows, columns)
    bad : bit map of `binned.bad_map`
    camera : Pinhole
    motion : (omega_c, RowTimes)
    P_omega_c : (3, 3)
    xy_px, P_px : (m, 2), (m, 2, 2) predictions
    sigma_px : float, width of a spot
    dn_per_electron : float
    saturation_dn : int
    false_objects : float, wanted in all

    Returns
    -------
    fitted : (m, streak_fit.COLUMNS), of which the first n rows are stars
    n : int
    level, noise : DN, medians of the strips; NaN without one
    """
    m = xy_px.shape[0]
    paths, search = np.empty((m, NUMBERS)), np.empty((m, 2))
    around, known = np.empty((m, 2)), np.zeros(m, dtype=np.bool_)
    s, area = np.sqrt(sigma_px**2 + PIXEL_VARIANCE), 0.0
    values = np.empty(MOST_STRIP)
    for k in range(m):
        known[k] = _predicted(camera, motion, xy_px[k], P_px[k], paths[k], search[k])
        if known[k]:
            known[k] = _strips(image_dn, bad, paths[k], s, search[k, 1], values, around[k])
        if known[k]:
            area += 4.0 * (search[k, 0] + s) * (search[k, 1] + s)
    fitted = np.empty((m, COLUMNS))
    if not known.any():
        return fitted, 0, np.nan, np.nan
    level, noise = np.median(around[known, 0]), np.median(around[known, 1])
    density, _, _ = looks(camera, motion[1], motion[0], sigma_px)
    least = threshold(density, area, false_objects)
    found = np.empty((m, NUMBERS))
    work, n_stars = np.empty((ROWS, MOST_PIXELS)), 0
    for k in range(m):
        if not known[k]:
            continue
        row, path = fitted[n_stars], found[n_stars]
        path[:], row[PLACE_X], row[PLACE_Y] = paths[k], xy_px[k, 0], xy_px[k, 1]
        along = max(search[k, 0], reach_px(path[LENGTH], s))
        shot = (around[k, 0] - level) * dn_per_electron  # a brighter background is noisier
        own = np.sqrt(max(noise**2 + shot, 0.25 * noise**2))
        n, row[N_SATURATED] = collect(
            image_dn, bad, path, s, (along, search[k, 1]), around[k, 0], own, saturation_dn, work
        )
        for j in range(n_stars):
            if touching(path, found[j], s, along):
                take_away(found[j], s, fitted[j, FLUX], dn_per_electron, n, work)
        reach = (search[k, 0], search[k, 1])
        if n == 0 or not fit_one(
            camera, motion, P_omega_c, s, dn_per_electron, own, LEVEL_SIGMA, reach, least, n, path, work, row
        ):
            continue
        if row[RATIO] < least or judge(camera, P_omega_c, s, dn_per_electron, n, path, work, row) != STAR:
            continue
        n_stars += 1
    return fitted, n_stars, level, noise


@njit(cache=True)
def _predicted(camera, motion, xy_px, P_px, path, search):
    """Path of a predicted star and how far along and across it is searched; False if it is not in view."""
    omega_c, times = motion
    if not path_of(camera, times, omega_c, xy_px[0], xy_px[1], path):
        return False
    x, y = 0.5 * (path[X0] + path[X1]), 0.5 * (path[Y0] + path[Y1])
    if not (0.0 <= x <= camera.width_px - 1.0 and 0.0 <= y <= camera.height_px - 1.0):
        return False
    tx, ty = path[TX], path[TY]
    along = P_px[0, 0] * tx * tx + (P_px[0, 1] + P_px[1, 0]) * tx * ty + P_px[1, 1] * ty * ty
    across = P_px[0, 0] * ty * ty - (P_px[0, 1] + P_px[1, 0]) * tx * ty + P_px[1, 1] * tx * tx
    search[0] = min(max(SEARCH_SIGMAS * np.sqrt(max(along, 0.0)), LEAST_SEARCH_PX), MOST_SEARCH_PX)
    search[1] = min(max(SEARCH_SIGMAS * np.sqrt(max(across, 0.0)), LEAST_SEARCH_PX), MOST_SEARCH_PX)
    return True


@njit(cache=True)
def _strips(image_dn, bad, path, s, search_px, values, around):
    """Level and noise of the pixels beside a streak, to around; False if too few are in the frame."""
    rows, columns = image_dn.shape
    n_along = int(path[LENGTH] + 2.0 * STRIP_ENDS_PX) + 1
    n_across = int(STRIP_PX)
    first = STRIP_SIGMAS * s + search_px
    every = max(1, (2 * n_across * n_along) // MOST_STRIP + 1)
    n = 0
    for i in range(0, n_along, every):
        along = i - STRIP_ENDS_PX
        for j in range(2 * n_across):
            across = first + (j >> 1) if j & 1 else -first - (j >> 1)
            c = int(np.rint(path[X0] + along * path[TX] - across * path[TY]))
            r = int(np.rint(path[Y0] + along * path[TY] + across * path[TX]))
            if 0 <= c < columns and 0 <= r < rows and n < values.shape[0]:
                p = r * columns + c
                if not bad[p >> 3] >> (p & 7) & 1:
                    values[n] = image_dn[r, c]
                    n += 1
    if n < LEAST_STRIP:
        return False
    part = values[:n]
    part.sort()
    around[0], low = _quantile(part, 0.5), _quantile(part, SIGMA_QUANTILE)
    around[1] = max(around[0] - low, LEAST_NOISE)
    return True


@njit(cache=True)
def _quantile(ordered, fraction):
    """Quantile of ordered whole numbers k, each standing for an even spread over k - 1/2 ... k + 1/2."""
    target = fraction * ordered.shape[0]
    value = ordered[min(int(np.ceil(target)), ordered.shape[0]) - 1]
    below = np.searchsorted(ordered, value)
    equal = np.searchsorted(ordered, value, side="right") - below
    return value - 0.5 + (target - below) / equal
