"""What the methods that compare angles share: tolerances, look-ups, and the star that fits a triangle.

In: the table of catalogue pairs and the directions of the detections. A pair of detections is looked up when
it is first needed and never again. At the end: identifications that are believed as their papers do.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker import tables
from shefex_nav.onboard.startracker.identify.verify import nothing, verify
from shefex_nav.records import Reason


class Table(NamedTuple):
    """StarPairs as compiled code takes them."""

    u_i: np.ndarray  # (n_stars, 3)
    cosine: np.ndarray  # (m,) ascending
    first: np.ndarray  # (m,) row of the brighter star
    second: np.ndarray  # (m,) row of the fainter star
    count: np.ndarray  # (m,) the k-vector
    slope: float
    intercept: float


class Sides(NamedTuple):
    """Angles between n detections: what is allowed and which catalogue pairs have it."""

    u_c: np.ndarray  # (n, 3)
    low: np.ndarray  # (n, n) least cosine
    high: np.ndarray  # (n, n) greatest cosine
    begin: np.ndarray  # (n, n) catalogue pairs begin ... end - 1 have the angle; -1: not looked up yet
    end: np.ndarray  # (n, n)


def table(pairs):
    """StarPairs -> Table."""
    index = pairs.index
    return Table(
        pairs.stars.u_i, pairs.cosine, pairs.first, pairs.second, index.count, index.slope, index.intercept
    )


@inner
def dot(a, i, b, j):
    """Scalar product of row i of a and row j of b."""
    return a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@inner
def cosine_limits(cosine, tolerance, cos_error):
    """Limits of a measured cosine: (low, high).

    With cos_error > 0 it is the same for all angles, as on SHEFEX-2: a wide window for near stars and a
    narrow one for far ones. Otherwise the angle has a tolerance [rad]: cos(a +- t) by the addition theorem.
    """
    if cos_error > 0.0:
        return cosine - cos_error, min(cosine + cos_error, 1.0)
    cosine = min(max(cosine, -1.0), 1.0)
    sine = np.sqrt(1.0 - cosine * cosine)
    cos_t, sin_t = np.cos(tolerance), np.sin(tolerance)
    low = cosine * cos_t - sine * sin_t
    return low, (cosine * cos_t + sine * sin_t if cosine < cos_t else 1.0)


@kernel
def new_sides(u_c, tolerance, cos_error):
    """Limits of all angles between the detections; nothing looked up."""
    n = u_c.shape[0]
    low, high = np.ones((n, n)), np.ones((n, n))
    for i in range(n):
        for j in range(i + 1, n):
            least, greatest = cosine_limits(dot(u_c, i, u_c, j), tolerance, cos_error)
            low[i, j] = low[j, i] = least
            high[i, j] = high[j, i] = greatest
    begin = np.full((n, n), -1, dtype=np.int64)
    return Sides(u_c, low, high, begin, np.empty((n, n), dtype=np.int64))


@inner
def look_up(table, sides, i, j):
    """Catalogue pairs with the angle between detections i and j: (begin, end)."""
    if sides.begin[i, j] < 0:
        begin, end = tables.span(
            table.count, table.slope, table.intercept, table.cosine, sides.low[i, j], sides.high[i, j]
        )
        sides.begin[i, j] = sides.begin[j, i] = begin
        sides.end[i, j] = sides.end[j, i] = end
    return sides.begin[i, j], sides.end[i, j]


@inner
def fits(table, sides, i, j, a, b):
    """Whether stars a and b are as far apart as detections i and j."""
    return sides.low[i, j] <= dot(table.u_i, a, table.u_i, b) <= sides.high[i, j]


@inner
def further_star(table, sides, triad, abc, d):
    """The one star that fits detection d on the base (triad, abc); -1 if there is none or more than one."""
    i, j, k = triad
    a, b, c = abc
    begin, end = look_up(table, sides, i, d)
    found = -1
    for p in range(begin, end):
        if table.first[p] == a:
            s = table.second[p]
        elif table.second[p] == a:
            s = table.first[p]
        else:
            continue
        if s == b or s == c:
            continue
        if fits(table, sides, j, d, b, s) and fits(table, sides, k, d, c, s):
            if found >= 0:
                return -1
            found = s
    return found


@inner
def extend(table, sides, triad, abc, row):
    """Fill `row` with the stars of all detections that fit the base; number of them beyond the base.

    Two detections that claim one star lose it both but for the base: one of them is false.
    """
    row[:] = -1
    confirmed = 0
    for d in range(sides.u_c.shape[0]):
        if d != triad[0] and d != triad[1] and d != triad[2]:
            s = further_star(table, sides, triad, abc, d)
            row[d] = s
            confirmed += s >= 0
    for d in range(row.shape[0]):
        if row[d] >= 0:
            rivals = 0
            for e in range(d + 1, row.shape[0]):
                if row[e] == row[d]:
                    row[e] = -1
                    rivals += 1
            if rivals > 0:
                row[d] = -1
                confirmed -= 1 + rivals
    row[triad[0]], row[triad[1]], row[triad[2]] = abc
    return confirmed


# --- acceptance: verified, or published ---


def first_verified(settings, camera, stars, u_c, flux, candidates):
    """The first of some candidates that holds against the whole field; else why the best of them did not.

    candidates : iterator of (len(flux),) int64 rows of the catalogue, -1; the others as of `verify`
    """
    best = nothing(len(flux), Reason.NO_MATCH)
    for star in candidates:
        found = verify(settings, camera, stars, u_c, flux, star)
        if found.reason == Reason.NONE:
            return found
        if best.reason != Reason.AMBIGUOUS:
            best = nothing(len(flux), found.reason)
    return best


def is_published(settings):
    """Whether a method's own acceptance is the last word. Identification settings -> bool"""
    return settings.acceptance == "published"


def believed(settings, found):
    """What a method has found as it is, where there are stars enough for an attitude.

    Parameters
    ----------
    settings : Identification, of it `fewest_stars`
    found : identify.verify.Identification, of the method's `match`

    Returns
    -------
    identify.verify.Identification
    """
    if found.reason == Reason.NONE and (found.star >= 0).sum() < settings.fewest_stars:
        return nothing(len(found.star), Reason.NO_MATCH)
    return found
