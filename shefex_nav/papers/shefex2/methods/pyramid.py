"""Pyramid identification (Mortari et al. 2004; SHEFEX-2 star tracker, section 3.4).

Three detections form a triangle; the k-vector gives the catalogue pairs with its angles, and a triple of
stars that closes it is a candidate. A fourth detection that fits all three stars confirms it, the others are
then tried on the same base. The triads are taken in Mortari's order, which does not keep one false star in
many triads in a row. `match` believes what the papers believe; `identify`, which flies, has it verified.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing
from shefex_nav.papers.angles import (
    believed,
    extend,
    first_verified,
    fits,
    is_published,
    look_up,
    new_sides,
    table,
)
from shefex_nav.records import Reason

MAX_TRIANGLES = 64  # candidates of one triad that are followed up; 0.1 is usual
MAX_PYRAMIDS = 8  # of one triad that are handed on
NONE, NO_MATCH = int(Reason.NONE), int(Reason.NO_MATCH)


def cos_error(factor, field, centroid_error_px, rad_per_px):
    """Tolerance of the cosine, c |cos(FOV) - cos(FOV - e_c deg/px)|: SHEFEX-2 equation (3).

    Parameters
    ----------
    factor : float, c, to be tuned
    field : float [rad], the greatest angle in the field of view
    centroid_error_px : float, e_c, 0.1 ... 0.3
    rad_per_px : float
    """
    return factor * abs(np.cos(field) - np.cos(field - centroid_error_px * rad_per_px))


def match(settings, camera, pairs, u_c, flux, cos_error=0.0, accept_triangle=False):
    """The paper's own algorithm with its own acceptance; nothing is verified.

    The first triad in smart order on which exactly one pyramid stands is believed. With accept_triangle, as
    it must have been in the comparison of the brightness-referenced paper (2014), whose pyramid is reported
    right with three stars, the first triad with exactly one triangle is believed when there is no pyramid.

    Parameters
    ----------
    settings : Identification; of it `tolerance` and `most_centroids`
    camera : CameraModel, not used
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera, brightest detection first
    flux : (n,)
    cos_error : float, > 0: constant tolerance of the cosine of an angle, in place of `tolerance`
    accept_triangle : bool

    Returns
    -------
    Identification, its log_odds NaN: nobody has asked
    """
    n = min(len(flux), settings.most_centroids)
    if n < (3 if accept_triangle else 4):
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    star = np.full(len(flux), -1, dtype=np.int64)
    limits = float(settings.tolerance), float(cos_error)
    reason = _match_kernel(table(pairs), u_c[:n], *limits, bool(accept_triangle), star[:n])
    return Identification(star, reason, np.nan)


def identify(settings, camera, pairs, u_c, flux, P_px=None):
    """Identify the stars of one frame without any idea of the attitude.

    Parameters
    ----------
    settings : Identification
    camera : CameraModel
    pairs : StarPairs
    u_c : (n, 3) unit vectors in the camera
    flux : (n,) brightness, descending; the pyramid uses the order alone
    P_px : ignored; the published method knows one tolerance for all centroids

    Returns
    -------
    Identification
    """
    if is_published(settings):
        return believed(settings, match(settings, camera, pairs, u_c, flux, settings.cosine_error or 0.0))
    n = min(len(flux), settings.most_centroids)
    if n < settings.fewest_stars:
        return nothing(len(flux), Reason.TOO_FEW_STARS)
    candidates = _candidates(float(settings.tolerance), pairs, u_c[:n], len(flux))
    return first_verified(settings, camera, pairs.stars, u_c, flux, candidates)


def _candidates(tolerance, pairs, u_c, n_all):
    """Stars of each pyramid, (n_all,) int64 with -1: iterator."""
    n = len(u_c)
    begin, n_triads = 0, n * (n - 1) * (n - 2) // 6
    while begin < n_triads:
        begin, rows, n_rows = _pyramid_kernel(table(pairs), u_c, tolerance, begin)
        for row in rows[:n_rows]:
            star = np.full(n_all, -1, dtype=np.int64)
            star[:n] = row
            yield star


@kernel
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


@inner
def _volume(a, i, j, k):
    """Triple product of rows i, j, k: its sign is the handedness of the triangle."""
    return (
        a[i, 0] * (a[j, 1] * a[k, 2] - a[j, 2] * a[k, 1])
        + a[i, 1] * (a[j, 2] * a[k, 0] - a[j, 0] * a[k, 2])
        + a[i, 2] * (a[j, 0] * a[k, 1] - a[j, 1] * a[k, 0])
    )


@inner
def _hang_up(pair_first, pair_second, begin, end, head, partner, link):
    """List the partners of each star among the pairs begin ... end - 1; head[star] starts its list."""
    m = 0
    for p in range(begin, end):
        a, c = pair_first[p], pair_second[p]
        partner[m], link[m], head[a] = c, head[a], m
        partner[m + 1], link[m + 1], head[c] = a, head[c], m + 1
        m += 2


@inner
def _close_triangles(table, sides, a, b, triad, lists, triangles, n):
    """Add the triangles (a, b, c) that begin with the pair a-b to the list of n; its new length.

    Star a finds its partners c in the lists; side b-c must have its angle, and the triangle must not be a
    mirror image. (When three stars are so nearly on a line that noise decides the handedness, other triads
    of the same frame do the work.)
    """
    head, partner, link = lists
    i, j, k = triad
    handedness = _volume(sides.u_c, i, j, k)
    e = head[a]
    while e >= 0 and n < triangles.shape[0]:
        c = partner[e]
        e = link[e]
        if c != b and fits(table, sides, j, k, b, c) and handedness * _volume(table.u_i, a, b, c) > 0.0:
            triangles[n, 0], triangles[n, 1], triangles[n, 2] = a, b, c
            n += 1
    return n


@inner
def _base_triangles(table, sides, triad, head, triangles):
    """List the catalogue triangles that have the three angles of a triad; how many.

    The pairs of side i-k are hung up by their stars; each pair of side i-j then finds the partners of its
    own star i, and the cosine of side j-k closes the triangle, which is the third search done on the spot.
    """
    i, j, k = triad
    first, second = table.first, table.second
    begin, end = look_up(table, sides, i, k)
    begin_ij, end_ij = look_up(table, sides, i, j)
    if begin == end or begin_ij == end_ij:
        return 0
    partner, link = np.empty(2 * (end - begin), dtype=np.int64), np.empty(2 * (end - begin), dtype=np.int64)
    _hang_up(first, second, begin, end, head, partner, link)
    lists = (head, partner, link)
    n = 0
    for p in range(begin_ij, end_ij):
        a, b = first[p], second[p]
        if head[a] >= 0:  # most stars have no partner: not worth a call
            n = _close_triangles(table, sides, a, b, triad, lists, triangles, n)
        if head[b] >= 0:
            n = _close_triangles(table, sides, b, a, triad, lists, triangles, n)
    for p in range(begin, end):
        head[first[p]] = -1
        head[second[p]] = -1
    return n


@kernel
def _pyramid_kernel(table, u_c, tolerance, begin):
    """Go through the triads from number `begin` on until one of them carries confirmed pyramids.

    Returns
    -------
    next : int, the triad to go on with
    rows : (MAX_PYRAMIDS, n) int64, star of each detection or -1
    n_rows : int
    """
    sides = new_sides(u_c, tolerance, 0.0)
    rows = np.empty((MAX_PYRAMIDS, u_c.shape[0]), dtype=np.int64)
    triangles = np.empty((MAX_TRIANGLES, 3), dtype=np.int64)
    head = np.full(table.u_i.shape[0], -1, dtype=np.int64)
    triads = smart_triads(u_c.shape[0])
    for t in range(begin, triads.shape[0]):
        triad = (triads[t, 0], triads[t, 1], triads[t, 2])
        n = _base_triangles(table, sides, triad, head, triangles)
        n_rows = 0
        for q in range(n):
            if n_rows == MAX_PYRAMIDS:
                break
            abc = (triangles[q, 0], triangles[q, 1], triangles[q, 2])
            n_rows += 0 < extend(table, sides, triad, abc, rows[n_rows])
        if n_rows > 0:
            return t + 1, rows, n_rows
    return triads.shape[0], rows, 0


@kernel
def _match_kernel(table, u_c, tolerance, cos_error, accept_triangle, star):
    """Write the first unique pyramid, or else the first unique triangle if that will do; the reason."""
    sides = new_sides(u_c, tolerance, cos_error)
    row = np.empty(u_c.shape[0], dtype=np.int64)
    triangles = np.empty((MAX_TRIANGLES, 3), dtype=np.int64)
    head = np.full(table.u_i.shape[0], -1, dtype=np.int64)
    triads = smart_triads(u_c.shape[0])
    has_triangle, base, abc_base = False, (0, 0, 0), (0, 0, 0)
    for t in range(triads.shape[0]):
        triad = (triads[t, 0], triads[t, 1], triads[t, 2])
        n = _base_triangles(table, sides, triad, head, triangles)
        n_pyramids = 0
        for q in range(n):
            abc = (triangles[q, 0], triangles[q, 1], triangles[q, 2])
            if extend(table, sides, triad, abc, row) > 0:
                n_pyramids += 1
                if n_pyramids == 1:
                    star[:] = row
        if n_pyramids == 1:
            return NONE
        if accept_triangle and n == 1 and not has_triangle:
            has_triangle = True
            base, abc_base = triad, (triangles[0, 0], triangles[0, 1], triangles[0, 2])
    star[:] = -1
    if not has_triangle:
        return NO_MATCH
    star[base[0]], star[base[1]], star[base[2]] = abc_base
    return NONE
