"""Streaks near predicted places: the fit of `streaks` without the search through the frame.

In: the frame, the motion, predicted places with covariances. Out: the stars found there. Level and noise come
from two strips beside each streak, the noise as the median of all: 200 pixels tell it to 10 per cent only.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.background import SIGMA_QUANTILE, is_bad
from shefex_nav.onboard.startracker.matched import looks, threshold
from shefex_nav.onboard.startracker.streak_fit import fit_one
from shefex_nav.onboard.startracker.streak_light import (
    MOST_PIXELS,
    PIXEL_VARIANCE,
    Ground,
    memory_of,
    take_away,
    window_of,
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
from shefex_nav.onboard.startracker.streak_search import (
    COLUMNS,
    FLUX,
    N_SATURATED,
    PLACE_X,
    PLACE_Y,
    RATIO,
    Search,
    reach_px,
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
TWO_ABOVE = 0.977250  # a normal variable is below its mean plus two sigma with this probability
LEAST_NOISE = np.sqrt(1.0 / 12.0)  # DN, quantisation


class Predicted(NamedTuple):
    """Predictions in view, one a row."""

    xy_px: np.ndarray  # (m, 2)
    paths: np.ndarray  # (m, NUMBERS)
    search_px: np.ndarray  # (m, 2) along and across
    ground: np.ndarray  # (m, 2) level and noise of the strips, DN


@kernel
def fit_near(picture, turning, spot, xy_px, P_px, false_objects):
    """Fit the streaks near predictions.

    Parameters
    ----------
    picture : Picture
    turning : Turning
    spot : Spot
    xy_px, P_px : (m, 2), (m, 2, 2) predictions
    false_objects : float, wanted in all

    Returns
    -------
    (stars, streak_search.COLUMNS)
    level, noise : DN, medians of the strips; NaN without one
    """
    predicted = _in_view(picture, turning, spot.s, xy_px, P_px)
    if predicted.xy_px.shape[0] == 0:
        return np.empty((0, COLUMNS)), np.nan, np.nan
    around = Ground(np.median(predicted.ground[:, 0]), np.median(predicted.ground[:, 1]))
    search_px = predicted.search_px
    area = (4.0 * (search_px[:, 0] + spot.s) * (search_px[:, 1] + spot.s)).sum()
    density = looks(turning, np.sqrt(spot.s**2 - PIXEL_VARIANCE)).density
    if not density > 0.0:
        return np.empty((0, COLUMNS)), around.level_dn, around.noise_dn
    least = threshold(density, area, false_objects)
    return _fit_each(picture, turning, spot, predicted, around, least), around.level_dn, around.noise_dn


@inner
def _in_view(picture, turning, s, xy_px, P_px):
    """The predictions in view whose surroundings are known."""
    m, n = xy_px.shape[0], 0
    out = Predicted(np.empty((m, 2)), np.empty((m, NUMBERS)), np.empty((m, 2)), np.empty((m, 2)))
    values = np.empty(MOST_STRIP)
    for k in range(m):
        path, search_px = out.paths[n], out.search_px[n]
        if not _predicted(turning, xy_px[k], P_px[k], path, search_px):
            continue
        if _strips(picture, path, s, search_px[1], values, out.ground[n]):
            out.xy_px[n] = xy_px[k]
            n += 1
    return Predicted(out.xy_px[:n], out.paths[:n], out.search_px[:n], out.ground[:n])


@inner
def _fit_each(picture, turning, spot, predicted, around, least):
    """Fit the predicted streaks, each without the light of those before it; the stars (n, COLUMNS)."""
    m, n = predicted.xy_px.shape[0], 0
    fitted, paths, memory = np.empty((m, COLUMNS)), np.empty((m, NUMBERS)), memory_of(MOST_PIXELS)
    for k in range(m):
        row, path = fitted[n], paths[n]
        path[:], row[PLACE_X], row[PLACE_Y] = predicted.paths[k], predicted.xy_px[k, 0], predicted.xy_px[k, 1]
        level, (along, across) = predicted.ground[k, 0], predicted.search_px[k]
        reach = max(along, reach_px(path[LENGTH], spot.s))
        shot = (level - around.level_dn) * spot.dn_per_electron  # a brighter background is noisier
        noise = np.sqrt(max(around.noise_dn**2 + shot, 0.25 * around.noise_dn**2))
        ground = Ground(level, noise)
        pixels, row[N_SATURATED] = window_of(picture, path, spot.s, (reach, across), ground, memory)
        for j in range(n):
            if touching(path, paths[j], spot.s, reach):
                take_away(paths[j], spot, fitted[j, FLUX], pixels)
        search = Search(along, across, least, LEVEL_SIGMA * noise)
        if pixels.x.shape[0] == 0:
            continue
        n_near = fit_one(turning, spot, search, pixels, path, row)
        if n_near > 0 and row[RATIO] >= least:
            n += judge(turning, spot, pixels, n_near, path, row) == STAR
    return fitted[:n]


@inner
def _predicted(turning, xy_px, P_px, path, search_px):
    """Path of a predicted star and how far along and across it is searched; False if it is not in view."""
    camera = turning.camera
    if not path_of(turning, xy_px[0], xy_px[1], path):
        return False
    x, y = 0.5 * (path[X0] + path[X1]), 0.5 * (path[Y0] + path[Y1])
    if not (0.0 <= x <= camera.width_px - 1.0 and 0.0 <= y <= camera.height_px - 1.0):
        return False
    tx, ty = path[TX], path[TY]
    along = P_px[0, 0] * tx * tx + (P_px[0, 1] + P_px[1, 0]) * tx * ty + P_px[1, 1] * ty * ty
    across = P_px[0, 0] * ty * ty - (P_px[0, 1] + P_px[1, 0]) * tx * ty + P_px[1, 1] * tx * tx
    search_px[0] = min(max(SEARCH_SIGMAS * np.sqrt(max(along, 0.0)), LEAST_SEARCH_PX), MOST_SEARCH_PX)
    search_px[1] = min(max(SEARCH_SIGMAS * np.sqrt(max(across, 0.0)), LEAST_SEARCH_PX), MOST_SEARCH_PX)
    return True


@inner
def _strips(picture, path, s, across_px, values, ground):
    """Level and noise of the pixels beside a streak, to ground; False if too few are in the frame."""
    image_dn, bad, _ = picture
    rows, columns = image_dn.shape
    n_along = int(path[LENGTH] + 2.0 * STRIP_ENDS_PX) + 1
    n_across = int(STRIP_PX)
    first = STRIP_SIGMAS * s + across_px
    every = max(1, (2 * n_across * n_along) // MOST_STRIP + 1)
    n = 0
    for i in range(0, n_along, every):
        along = i - STRIP_ENDS_PX
        for j in range(2 * n_across):
            across = first + (j >> 1) if j & 1 else -first - (j >> 1)
            c = int(np.rint(path[X0] + along * path[TX] - across * path[TY]))
            r = int(np.rint(path[Y0] + along * path[TY] + across * path[TX]))
            if 0 <= c < columns and 0 <= r < rows and n < values.shape[0]:
                if not is_bad(bad, r * columns + c):
                    values[n] = image_dn[r, c]
                    n += 1
    if n < LEAST_STRIP:
        return False
    part = values[:n]
    part.sort()
    ground[0], low = _quantile(part, 0.5), _quantile(part, SIGMA_QUANTILE)
    ground[1] = max(ground[0] - low, LEAST_NOISE)
    if low < 0.5:  # grey value 0, which cuts off what is below
        ground[1] = max(ground[1], _quantile(part, TWO_ABOVE) - _quantile(part, 1.0 - SIGMA_QUANTILE))
    return True


@inner
def _quantile(ordered, fraction):
    """Quantile of ordered whole numbers k, each standing for an even spread over k - 1/2 ... k + 1/2."""
    target = fraction * ordered.shape[0]
    value = ordered[min(int(np.ceil(target)), ordered.shape[0]) - 1]
    below = np.searchsorted(ordered, value)
    equal = np.searchsorted(ordered, value, side="right") - below
    return value - 0.5 + (target - below) / equal
