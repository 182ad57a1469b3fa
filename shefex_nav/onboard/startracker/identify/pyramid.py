"""Pyramid identification (Mortari et al. 2004; SHEFEX-2 star tracker, section 3.4).

Three detections form a triangle; the k-vector gives the catalogue pairs with its angles, and a triple of
stars that closes it is a candidate. A fourth detection that fits all three stars confirms it, the others are
then tried on the same base. The triads are taken in Mortari's order, which does not keep one false star in
many triads in a row.
"""

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker import kvector
from shefex_nav.onboard.startracker.identify.verify import nothing, verify
from shefex_nav.records import Reason

MAX_TRIANGLES = 64  # candidates of one triad that are followed up; 0.1 is usual
MAX_PYRAMIDS = 8  # of one triad that are handed on


def identify(params, pairs, u_c, flux):
    """Identify the stars of one frame without any idea of the attitude.

    Parameters
    ----------
    params : IdentifyParams
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera
    flux : (n,) brightness, descending; the pyramid uses the order alone

    Returns
    -------
    Identification
    """
    n = min(len(flux), params.max_centroids)
    if n < params.min_stars:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    u_base = np.ascontiguousarray(u_c[:n])
    low, high = cosine_limits(u_base, params.tolerance)
    first, last = kvector.search(pairs.index, pairs.cosine, low.ravel(), high.ravel())
    first, last = first.reshape(n, n), last.reshape(n, n)
    best = nothing(len(flux), Reason.NO_MATCH)
    triads = smart_triads(n)
    begin = 0
    while begin < len(triads):
        begin, rows, n_rows = _pyramid_kernel(
            u_base, pairs.stars.u_i, pairs.first, pairs.second, low, high, first, last, triads, begin
        )
        for row in rows[:n_rows]:
            star = np.full(len(flux), -1, dtype=np.int64)
            star[:n] = row
            found = verify(params, pairs.stars, u_c, flux, star)
            if found.reason == Reason.NONE:
                return found
            if best.reason != Reason.AMBIGUOUS:
                best = nothing(len(flux), found.reason)
    return best


@njit(cache=True)
def cosine_limits(u_c, tolerance):
    """Limits of the cosine of each angle, made wider by the tolerance. (n, 3), rad -> (n, n), (n, n).

    The same angle either way, where a fixed error of the cosine (the paper's cosError) would be a wide
    window for near stars and a narrow one for far ones.
    """
    n = u_c.shape[0]
    low, high = np.ones((n, n)), np.ones((n, n))
    for i in range(n):
        for j in range(i + 1, n):
            chord2 = ((u_c[i] - u_c[j]) ** 2).sum()
            angle = 2.0 * np.arcsin(0.5 * np.sqrt(chord2))
            low[i, j] = low[j, i] = np.cos(angle + tolerance)
            high[i, j] = high[j, i] = np.cos(max(angle - tolerance, 0.0))
    return low, high


@njit(cache=True)
def smart_triads(n):
    """All triads of n detections in Mortari's order: (m, 3) int64.

    The distances between the indices grow slowly and the first index runs fastest.
    """
    triads = np.empty((n * (n - 1) * (n - 2) // 6, 3), dtype=np.int64)
    m = 0
    for dj in range(1, n - 1):
        for dk in range(1, n - dj):
            for i in range(n - dj - dk):
                triads[m, 0], triads[m, 1], triads[m, 2] = i, i + dj, i + dj + dk
                m += 1
    return triads


@njit(cache=True)
def _dot(a, i, b, j):
    return a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@njit(cache=True)
def _volume(a, i, j, k):
    """Triple product of rows i, j, k: its sign is the handedness of the triangle."""
    return (
        a[i, 0] * (a[j, 1] * a[k, 2] - a[j, 2] * a[k, 1])
        + a[i, 1] * (a[j, 2] * a[k, 0] - a[j, 0] * a[k, 2])
        + a[i, 2] * (a[j, 0] * a[k, 1] - a[j, 1] * a[k, 0])
    )


@njit(cache=True)
def _further_star(u_i, pair_first, pair_second, low, high, first, last, triad, abc, d):
    """The one star that fits detection d on the base (triad, abc); -1 if there is none or more than one."""
    i, j, k = triad[0], triad[1], triad[2]
    found = -1
    for p in range(first[i, d], last[i, d]):
        if pair_first[p] == abc[0]:
            s = pair_second[p]
        elif pair_second[p] == abc[0]:
            s = pair_first[p]
        else:
            continue
        if s == abc[1] or s == abc[2]:
            continue
        cos_b, cos_c = _dot(u_i, s, u_i, abc[1]), _dot(u_i, s, u_i, abc[2])
        if low[j, d] <= cos_b <= high[j, d] and low[k, d] <= cos_c <= high[k, d]:
            if found >= 0:
                return -1
            found = s
    return found


@njit(cache=True)
def _pyramid(u_c, u_i, pair_first, pair_second, low, high, first, last, triad, abc, row):
    """Fill `row` with the stars of all detections that fit the base; number of them beyond the base."""
    row[:] = -1
    for v in range(3):
        row[triad[v]] = abc[v]
    confirmed = 0
    for d in range(u_c.shape[0]):
        if d == triad[0] or d == triad[1] or d == triad[2]:
            continue
        s = _further_star(u_i, pair_first, pair_second, low, high, first, last, triad, abc, d)
        if s >= 0:
            row[d] = s
            confirmed += 1
    return confirmed


@njit(cache=True)
def _hang_up(pair_first, pair_second, begin, end, head, partner, link):
    """List the partners of each star among the pairs begin ... end - 1; head[star] starts its list."""
    m = 0
    for p in range(begin, end):
        a, c = pair_first[p], pair_second[p]
        partner[m], link[m], head[a] = c, head[a], m
        partner[m + 1], link[m + 1], head[c] = a, head[c], m + 1
        m += 2


@njit(cache=True)
def _close_triangles(u_c, u_i, a, b, low, high, triad, head, partner, link, triangles, n):
    """Add the triangles (a, b, c) that begin with the pair a-b to the list of n; its new length.

    Star a finds its partners c in the lists; side b-c must have its angle, and the triangle must not be a
    mirror image. (When three stars are so nearly on a line that noise decides the handedness, other triads
    of the same frame do the work.)
    """
    j, k = triad[1], triad[2]
    handedness = _volume(u_c, triad[0], j, k)
    e = head[a]
    while e >= 0 and n < triangles.shape[0]:
        c = partner[e]
        e = link[e]
        if c == b or not low[j, k] <= _dot(u_i, b, u_i, c) <= high[j, k]:
            continue
        if handedness * _volume(u_i, a, b, c) > 0.0:
            triangles[n, 0], triangles[n, 1], triangles[n, 2] = a, b, c
            n += 1
    return n


@njit(cache=True)
def _base_triangles(
    u_c, u_i, pair_first, pair_second, low, high, first, last, triad, head, partner, link, triangles
):
    """List the catalogue triangles that have the three angles of a triad; how many.

    The pairs of side i-k are hung up by their stars; each pair of side i-j then finds the partners of its
    own star i, and the cosine of side j-k closes the triangle, which is the third search done on the spot.
    """
    i, j, k = triad[0], triad[1], triad[2]
    _hang_up(pair_first, pair_second, first[i, k], last[i, k], head, partner, link)
    n = 0
    for p in range(first[i, j], last[i, j]):
        a, b = pair_first[p], pair_second[p]
        if head[a] >= 0:  # most stars have no partner: not worth a call
            n = _close_triangles(u_c, u_i, a, b, low, high, triad, head, partner, link, triangles, n)
        if head[b] >= 0:
            n = _close_triangles(u_c, u_i, b, a, low, high, triad, head, partner, link, triangles, n)
    for p in range(first[i, k], last[i, k]):
        head[pair_first[p]] = -1
        head[pair_second[p]] = -1
    return n


@njit(cache=True)
def _pyramid_kernel(u_c, u_i, pair_first, pair_second, low, high, first, last, triads, begin):
    """Go through the triads from `begin` on until one of them carries confirmed pyramids.

    Returns
    -------
    next : int, the triad to go on with
    rows : (MAX_PYRAMIDS, n) int64, star of each detection or -1
    n_rows : int
    """
    rows = np.empty((MAX_PYRAMIDS, u_c.shape[0]), dtype=np.int64)
    triangles = np.empty((MAX_TRIANGLES, 3), dtype=np.int64)
    head = np.full(u_i.shape[0], -1, dtype=np.int64)
    longest = (last - first).max()
    partner, link = np.empty(2 * longest, dtype=np.int64), np.empty(2 * longest, dtype=np.int64)
    for t in range(begin, triads.shape[0]):
        n = _base_triangles(
            u_c, u_i, pair_first, pair_second, low, high, first, last, triads[t],
            head, partner, link, triangles,
        )  # fmt: skip
        n_rows = 0
        for q in range(n):
            if n_rows == MAX_PYRAMIDS:
                break
            abc, row = triangles[q], rows[n_rows]
            n_rows += 0 < _pyramid(
                u_c, u_i, pair_first, pair_second, low, high, first, last, triads[t], abc, row
            )
        if n_rows > 0:
            return t + 1, rows, n_rows
    return triads.shape[0], rows, 0
