"""All streaks of a frame together: each is fitted without the light of the others, and judged.

In: the frame, the motion, level and noise in tiles, candidates. Out: the stars among them.

    candidates, brightest first -> fit without the light of those before it; what it is (`streak_shape`)
          -> width of the spot as the bright stars show it
          -> again, where another streak touches that was not taken away, or the width is another one
          -> two parts of one longer streak are no stars
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.binned import BIN, Level, interpolated
from shefex_nav.onboard.startracker.matched import MIDDLE_X, MIDDLE_Y
from shefex_nav.onboard.startracker.streak_fit import fit_one
from shefex_nav.onboard.startracker.streak_light import (
    Ground,
    Picture,
    Pixels,
    Spot,
    first_of,
    take_away,
    width2,
    window_of,
)
from shefex_nav.onboard.startracker.streak_path import (
    LENGTH,
    NUMBERS,
    X0,
    X1,
    Y0,
    Y1,
    Turning,
    between_middles,
    place_of_middle,
    touching,
)
from shefex_nav.onboard.startracker.streak_search import (
    COLUMNS,
    FLUX,
    LEVEL,
    N_SATURATED,
    PLACE_X,
    PLACE_Y,
    RATIO,
    Search,
    reach_px,
)
from shefex_nav.onboard.startracker.streak_shape import MISFIT, SHORT_SIGMAS, STAR, judge

LEVEL_SIGMA = 0.05  # of the noise of a pixel: error of the level between tiles [E]
ACROSS_PX = 1.5  # that a candidate may be off its line
BRIGHT = 25.0  # signal-to-noise ratio of the stars that show their width
WIDTH_PART = 0.02  # stars are fitted again if their width is off by more
WIDTHS = (0.7, 1.5)  # of the expected one, that are believed
IN_LINE_RATIO = 1.6  # of the light of two parts of a longer streak
IN_LINE_SIGMAS = 1.0  # they lie so close to one line
IN_LINE_PART = 1.25  # and the middles are at most so many lengths apart
GROWN = 1.6  # by more light than that no star grows when others are no longer taken away


class Field(NamedTuple):
    """What the fits of a frame share."""

    picture: Picture
    turning: Turning
    level: Level
    least: float  # signal-to-noise ratio of a star
    memory: Pixels  # of one window


class Fits(NamedTuple):
    """Fitted streaks, one a row."""

    fitted: np.ndarray  # (n, streak_search.COLUMNS)
    paths: np.ndarray  # (n, streak_path.NUMBERS)
    verdict: np.ndarray  # (n,) of `streak_shape.judge`
    width2: np.ndarray  # (n,) px^2, width of the spot squared; NaN for one that does not show it


@kernel
def fit_field(field, spot, found):
    """Fit the candidates and judge them.

    Parameters
    ----------
    field : Field
    spot : Spot
    found : (n, 3) candidates of `matched.candidates`, best first

    Returns
    -------
    (stars, COLUMNS)
    """
    fits = _fit_each(field, spot, found)
    return _stars(field.least, *_fit_again(field, spot, fits))


@inner
def _fit_each(field, spot, found):
    """Fit the candidates, each without the light of those before it."""
    n, n_fits = found.shape[0], 0
    fitted, paths = np.empty((n, COLUMNS)), np.empty((n, NUMBERS))
    fits = Fits(fitted, paths, np.empty(n, dtype=np.int64), np.full(n, np.nan))
    subtract = np.zeros(n, dtype=np.bool_)
    for k in range(n):
        row, path = fitted[n_fits], paths[n_fits]
        x, y = found[k, MIDDLE_X], found[k, MIDDLE_Y]
        row[PLACE_X], row[PLACE_Y] = place_of_middle(field.turning, x, y, path)
        if not np.isfinite(row[PLACE_X]):
            continue
        n_near, pixels = _fit(field, spot, fits, subtract, path, row)
        if n_near == 0 or row[RATIO] < field.least:
            continue
        verdict = judge(field.turning, spot, pixels, n_near, path, row)
        if verdict == STAR and row[RATIO] > BRIGHT and row[N_SATURATED] == 0:
            fits.width2[n_fits] = width2(spot.s, row[LEVEL], first_of(pixels, n_near))
        fits.verdict[n_fits], subtract[n_fits] = verdict, True
        n_fits += 1
    return Fits(fitted[:n_fits], paths[:n_fits], fits.verdict[:n_fits], fits.width2[:n_fits])


@inner
def _fit_again(field, spot, fits):
    """Fit again what another streak touches, and all if the spots have another width than expected.

    Returns
    -------
    s : px, the width
    fits : Fits, overwritten
    """
    fitted, paths, verdict, _ = fits
    first_verdict, first_flux = verdict.copy(), fitted[:, FLUX].copy()
    seen = _spot_seen(spot, fits)
    n = fitted.shape[0]
    row, path, subtract = np.empty(COLUMNS), np.empty(NUMBERS), np.empty(n, dtype=np.bool_)
    for k in range(n):
        was_star = first_verdict[k] == STAR
        for j in range(n):
            subtract[j] = j != k and first_verdict[j] == STAR
            if subtract[j] and not was_star and _end_to_end(paths[k], paths[j], seen.s):
                subtract[j] = False  # what goes on past its ends is not excused by what goes on there
        first = k + 1 if was_star else 0
        if seen.s == spot.s and not _has_neighbour(paths, subtract, k, first, seen.s):
            continue
        row[:], path[:] = fitted[k], paths[k]
        n_near, pixels = _fit(field, seen, fits, subtract, path, row)
        if n_near > 0:
            fitted[k], paths[k] = row, path
            verdict[k] = judge(field.turning, seen, pixels, n_near, path, row)
            if row[FLUX] > GROWN * first_flux[k]:
                verdict[k] = MISFIT  # it was a part of something that is no star
    return seen.s, fits


@inner
def _fit(field, spot, fits, subtract, path, row):
    """Fit one streak without the light of those that are to be subtracted.

    Returns
    -------
    n_near : of `streak_fit.fit_one`, 0: no fit
    pixels : Pixels
    """
    ground = _ground(field.level, path)
    reach = reach_px(path[LENGTH], spot.s)
    pixels, row[N_SATURATED] = window_of(
        field.picture, path, spot.s, (reach, ACROSS_PX), ground, field.memory
    )
    for j in range(subtract.shape[0]):
        if subtract[j] and touching(path, fits.paths[j], spot.s, reach):
            take_away(fits.paths[j], spot, fits.fitted[j, FLUX], pixels)
    search = Search(0.0, 0.0, field.least, LEVEL_SIGMA * ground.noise_dn)
    if pixels.x.shape[0] == 0:
        return 0, pixels
    return fit_one(field.turning, spot, search, pixels, path, row), pixels


@inner
def _ground(level, path):
    """Background and noise of a pixel in the middle of a streak."""
    row = (0.5 * (path[Y0] + path[Y1]) - 0.5) / BIN
    column = (0.5 * (path[X0] + path[X1]) - 0.5) / BIN
    background = interpolated(level.background, level.tile, row, column)
    return Ground(background, interpolated(level.noise, level.tile, row, column))


@inner
def _spot_seen(spot, fits):
    """Spot as wide as the bright stars show it, if that differs from the expected one and can be believed."""
    widths = fits.width2[np.isfinite(fits.width2)]
    if widths.shape[0] == 0:
        return spot
    seen = np.sqrt(np.median(widths))
    if WIDTHS[0] * spot.s < seen < WIDTHS[1] * spot.s and abs(seen - spot.s) > WIDTH_PART * spot.s:
        return Spot(seen, spot.dn_per_electron)
    return spot


@inner
def _has_neighbour(paths, subtract, k, first, s):
    """Whether a streak from `first` on that is subtracted is near streak k."""
    for j in range(first, paths.shape[0]):
        if subtract[j] and touching(paths[k], paths[j], s, reach_px(paths[k, LENGTH], s)):
            return True
    return False


@inner
def _stars(least, s, fits):
    """The fits that are stars."""
    fitted, paths, verdict, _ = fits
    n = fitted.shape[0]
    is_star, is_part = np.empty(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_)
    for k in range(n):
        is_star[k] = verdict[k] == STAR and fitted[k, RATIO] >= least
    for k in range(n):
        for j in range(n):
            if j != k and is_star[j]:
                is_part[k] |= _is_in_line(fitted[k], paths[k], fitted[j], paths[j], s)
    return fitted[is_star & ~is_part]


@inner
def _is_in_line(fitted, path, other_fitted, other, s):
    """Whether two streaks look like one that is longer: end to end, on one line and as bright.

    Of true stars, about one in 500 has another one there by chance.
    """
    ratio = fitted[FLUX] / other_fitted[FLUX]
    return ratio < IN_LINE_RATIO and ratio * IN_LINE_RATIO > 1.0 and _end_to_end(path, other, s)


@inner
def _end_to_end(path, other, s):
    """Whether two streaks touch or overlap on the same line."""
    if path[LENGTH] < SHORT_SIGMAS * s:
        return False
    along, across = between_middles(path, other)
    return across < IN_LINE_SIGMAS * s and along / path[LENGTH] < IN_LINE_PART
