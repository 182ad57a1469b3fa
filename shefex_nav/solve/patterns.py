"""Triangles of bright stars, by shape: what finds a field whose scale is not known.

In: the star catalogue. Out: for each range of field sizes (a band) the triangles that its brightest stars
form, sorted by shape, and the stars that should be seen around them. A band is described by its size
S = sqrt(width x height) / focal length. In each neighbourhood the same number of stars is chosen, so that
they are the brightest ones of a picture in the Milky Way and at its poles alike.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.environment.stars import (
    BV_UNKNOWN,
    StarCatalogue,
    at_epoch,
    load_catalogue,
    silicon_magnitude,
)
from shefex_nav.geometry.pinhole import solid_angle
from shefex_nav.onboard.startracker import tables

MAX_MAGNITUDE = 8.0
SMALLEST, RATIO = np.radians(4.5), 1.34  # of S; a band reaches over RATIO
CHOSEN = 16.0  # stars in a square picture of a band that form triangles
SHOWN = 26.0  # likewise, that a proposal is compared with
LONGEST, SHORTEST = 0.5, 0.12  # longest side of a triangle, in S: limits
SLIVER = 0.2  # shortest over longest side: thinner ones say little
CELL = 0.02  # of the two side ratios
COLUMNS = round(1.0 / CELL)  # ratios from 0 to 1
REACH = 0.80  # radius of a field of 16 : 9, in S
BLEND = 0.002  # closer stars are one, in S: two pixels of a thousand
DECADE = 10.0  # years; the triangles of an epoch serve that long


class Band(NamedTuple):
    """Triangles and stars for one range of field sizes."""

    low: float  # S [rad]
    high: float
    u_i: np.ndarray  # (n, 3) stars, brightest first
    vmag: np.ndarray  # (n,)
    start: np.ndarray  # lists of stars by direction, see SkyGrid
    listed_i: np.ndarray  # (m, 3) float32, directions of the stars in the order of the lists
    corner: (
        np.ndarray
    )  # (m, 3) int32 rows of the stars of each triangle: opposite its long, middle, short side
    shape: np.ndarray  # (m, 3) longest side [rad, chord], middle / longest, shortest / longest
    cell: np.ndarray  # (2 COLUMNS^2 + 1,) int64, triangles of cell c are cell[c]:cell[c + 1]


def bands(low, high):
    """Numbers of the bands that cover the field sizes low ... high [rad], coarse ones first."""
    first = int(np.floor(np.log(low / SMALLEST) / np.log(RATIO)))
    last = int(np.floor(np.log(high / SMALLEST) / np.log(RATIO)))
    return list(range(last, first - 1, -1))


@lru_cache(maxsize=4)
def catalogue(julian_year):
    """All stars of the shipped table at an epoch."""
    return at_epoch(load_catalogue(MAX_MAGNITUDE), julian_year)


def merged(stars, max_magnitude, radius):
    """Stars to a magnitude with close neighbours merged into one, brightest first.

    The same as `photocentres`, in compiled code.
    """
    flux = 10.0 ** (-0.4 * silicon_magnitude(stars.vmag, stars.bv))
    order, by_z = (np.argsort(column, kind="stable") for column in (stars.vmag, stars.u_i[:, 2]))
    bright = order[: np.searchsorted(stars.vmag[order], max_magnitude, side="right")]
    *columns, stays, alone = _centres(stars[1:-1], flux, bright, by_z, radius)
    rows = np.flatnonzero(stays)
    rows = rows[np.lexsort((alone[rows], columns[2][rows]))]  # vmag
    return StarCatalogue(stars.hip[rows], *(column[rows] for column in columns), stars.epoch)


@kernel
def _centres(columns, flux, bright, by_z, radius):
    """u_i, pm_i, vmag, hpmag, bv of stars with their neighbours in them; which stay, which have none: (n,).

    columns : u_i, pm_i, vmag, hpmag, bv of n stars;  flux : (n,), weights
    bright : rows that take others, brightest first;  by_z : (n,) rows in the order of z;  radius : rad
    """
    at_i, moves_i, v, hp, colours = columns
    u_i, pm_i, vmag, hpmag, bv = at_i.copy(), moves_i.copy(), v.copy(), hp.copy(), colours.copy()
    n, cosine = len(flux), np.cos(radius)
    place, x, y, z = np.empty(n, dtype=np.int64), np.empty(n), np.empty(n), np.empty(n)
    for p in range(n):
        t = by_z[p]
        place[t], x[p], y[p], z[p] = p, at_i[t, 0], at_i[t, 1], at_i[t, 2]
    taken, stays, alone = np.zeros(n, dtype=np.bool_), np.zeros(n, dtype=np.bool_), np.ones(n, dtype=np.bool_)
    near = np.empty(n, dtype=np.int64)
    for s in bright:
        if taken[s]:
            continue
        own, near[0], m = place[s], s, 1
        for way in (-1, 1):
            p = own + way
            while 0 <= p < n and abs(z[p] - z[own]) <= radius:
                if x[own] * x[p] + y[own] * y[p] + z[own] * z[p] >= cosine:
                    alone[s] = False
                    if not taken[by_z[p]]:
                        near[m] = by_z[p]
                        m += 1
                p += way
        taken[near[:m]] = True
        stays[s] = True
        if m == 1:
            continue
        group = near[:m]
        total, light, hp_light, b_light = 0.0, 0.0, 0.0, 0.0
        u_i[s], pm_i[s] = 0.0, 0.0
        for t in group:
            total += flux[t]
            u_i[s] += flux[t] * at_i[t]
            pm_i[s] += flux[t] * moves_i[t]
            light += 10.0 ** (-0.4 * v[t])
            hp_light += 10.0 ** (-0.4 * hp[t])
            b_light += 10.0 ** (-0.4 * (v[t] + (BV_UNKNOWN if np.isnan(colours[t]) else colours[t])))
        u_i[s] /= np.sqrt((u_i[s] ** 2).sum())
        pm_i[s] /= total
        vmag[s], hpmag[s] = -2.5 * np.log10(light), -2.5 * np.log10(hp_light)
        bv[s] = -2.5 * np.log10(b_light) - vmag[s]
    return u_i, pm_i, vmag, hpmag, bv, stays, alone


@lru_cache(maxsize=1)
def magnitudes():
    """V of all stars, ascending."""
    return np.sort(load_catalogue(MAX_MAGNITUDE).vmag)


def magnitude_of(density):
    """V to which the sky has this many stars per steradian in the mean, at most MAX_MAGNITUDE."""
    vmag = magnitudes()
    n = int(4.0 * np.pi * density)
    return float(vmag[n]) if n < len(vmag) else MAX_MAGNITUDE


def band(number, julian_year):
    """Band by its number, for an epoch."""
    return _band(number, DECADE * round(julian_year / DECADE))


@lru_cache(maxsize=32)
def _band(number, julian_year):
    low = SMALLEST * RATIO**number
    high = low * RATIO
    size = np.sqrt(low * high)
    sky = solid_angle(size, size, 1.0)
    shown = magnitude_of(SHOWN / sky)
    stars = merged(catalogue(julian_year), shown, BLEND * size)
    start, row = sky_lists(stars.u_i, REACH * high)
    order = np.argsort(stars.u_i[:, 2], kind="stable")
    chosen = choose(stars.u_i, order, 0.5 * np.sqrt(sky), int(0.25 * np.pi * CHOSEN + 0.5))
    corner, shape, key = _triangles(stars.u_i, np.flatnonzero(chosen), SHORTEST * low, LONGEST * high)
    order = np.argsort(key, kind="stable")
    cell = np.searchsorted(key[order], np.arange(2 * COLUMNS**2 + 1))
    corner, shape = np.ascontiguousarray(corner[order]), np.ascontiguousarray(shape[order])
    # looked up by number, each star would be a wait for the memory
    listed_i = stars.u_i.astype(np.float32)[row]
    return Band(low, high, stars.u_i, stars.vmag, start, listed_i, corner, shape, cell.astype(np.int64))


@kernel
def choose(u_i, order, radius, limit):
    """Stars with fewer than `limit` brighter ones within the radius. (n, 3), order by z -> (n,) bool."""
    n = u_i.shape[0]
    chosen = np.zeros(n, dtype=np.bool_)
    cosine = np.cos(radius)
    first = 0
    for p in range(n):
        s = order[p]
        while u_i[order[first], 2] < u_i[s, 2] - radius:
            first += 1
        brighter = 0
        for q in range(first, n):
            t = order[q]
            if u_i[t, 2] > u_i[s, 2] + radius or brighter == limit:
                break
            if t < s and u_i[s, 0] * u_i[t, 0] + u_i[s, 1] * u_i[t, 1] + u_i[s, 2] * u_i[t, 2] > cosine:
                brighter += 1
        chosen[s] = brighter < limit
    return chosen


@inner
def side(u, i, j):
    """Chord between two unit vectors."""
    return np.sqrt((u[i, 0] - u[j, 0]) ** 2 + (u[i, 1] - u[j, 1]) ** 2 + (u[i, 2] - u[j, 2]) ** 2)


@inner
def volume(u, i, j, k):
    """Triple product: its sign is the handedness of the corners i, j, k."""
    return (
        u[i, 0] * (u[j, 1] * u[k, 2] - u[j, 2] * u[k, 1])
        + u[i, 1] * (u[j, 2] * u[k, 0] - u[j, 0] * u[k, 2])
        + u[i, 2] * (u[j, 0] * u[k, 1] - u[j, 1] * u[k, 0])
    )


@inner
def cell_of_shape(middle, short, left_handed):
    """Cell of a triangle with these side ratios."""
    a, b = min(int(middle / CELL), COLUMNS - 1), min(int(short / CELL), COLUMNS - 1)
    return (COLUMNS if left_handed else 0) * COLUMNS + a * COLUMNS + b


@kernel
def _triangles(u_i, chosen, shortest, longest):
    """All triangles of the chosen stars: corners, shape, cell of each."""
    by_z = chosen[np.argsort(u_i[chosen, 2])]
    n, size = 0, 4096
    corner, shape = np.empty((size, 3), dtype=np.int32), np.empty((size, 3))
    key = np.empty(size, dtype=np.int64)
    near, reach = np.empty(4096, dtype=np.int64), np.empty(4096)
    for p in range(len(by_z)):
        s, m = by_z[p], 0  # s has the smallest z of its triangles
        for q in range(p + 1, len(by_z)):
            t = by_z[q]
            if u_i[t, 2] > u_i[s, 2] + longest or m == len(near):
                break
            distance = side(u_i, s, t)
            if distance < longest:
                near[m], reach[m] = t, distance
                m += 1
        for x in range(m):
            for y in range(x):
                # opposite of s, of x and of y, put in order
                i, j, k, a, b, c = s, near[x], near[y], side(u_i, near[x], near[y]), reach[y], reach[x]
                if a < b:
                    i, j, a, b = j, i, b, a
                if b < c:
                    j, k, b, c = k, j, c, b
                if a < b:
                    i, j, a, b = j, i, b, a
                if a > longest or a < shortest or c < SLIVER * a:
                    continue
                if n == size:
                    size *= 2
                    corner = np.concatenate((corner, np.empty((n, 3), dtype=np.int32)))
                    shape = np.concatenate((shape, np.empty((n, 3))))
                    key = np.concatenate((key, np.empty(n, dtype=np.int64)))
                corner[n, 0], corner[n, 1], corner[n, 2] = i, j, k
                shape[n, 0], shape[n, 1], shape[n, 2] = a, b / a, c / a
                key[n] = cell_of_shape(b / a, c / a, volume(u_i, i, j, k) < 0.0)
                n += 1
    return corner[:n], shape[:n], key[:n]


@lru_cache(maxsize=1)
def directions_of_cells():
    """Middle of each cell of the sky grid (n, 3), and the angle from there to its furthest corner (n,)."""
    c = tables.CELLS
    middle, reach = np.empty((6 * c * c, 3)), np.empty(6 * c * c)
    at = (2.0 * np.arange(c) + 1.0) / c - 1.0
    a, b = (v.ravel() for v in np.meshgrid(at, at, indexing="ij"))
    one = np.ones_like(a)
    for face in range(6):
        part = slice(face * c * c, (face + 1) * c * c)
        sign = 1.0 if face % 2 == 0 else -1.0

        def on_face(x, y, face=face, sign=sign):
            columns = ((sign * one, x, y), (x, sign * one, y), (x, y, sign * one))[face // 2]
            v = np.column_stack(columns)
            return v / np.linalg.norm(v, axis=1, keepdims=True)

        middle[part] = on_face(a, b)
        corners = [
            (middle[part] * on_face(a + i / c, b + j / c)).sum(axis=1) for i in (-1, 1) for j in (-1, 1)
        ]
        reach[part] = np.arccos(np.min(corners, axis=0))
    return middle, reach


def sky_lists(u_i, radius):
    """Lists of all stars within the radius of any direction, as SkyGrid has them: start, row."""
    middle, reach = directions_of_cells()
    order = np.argsort(middle[:, 2], kind="stable")
    return _lists(u_i, radius, middle[order], reach[order], order)


@kernel
def _lists(u_i, radius, middle, reach, order):
    """The cells near each star, twice: to count, and to fill. Cells are ordered by their z."""
    cells, z = len(order), middle[:, 2]
    cosine, widest = np.cos(reach + radius), radius + reach.max()
    start, fill = np.zeros(cells + 1, dtype=np.int64), np.zeros(cells, dtype=np.int64)
    row = np.empty(0, dtype=np.uint16)
    for final in range(2):
        for s in range(u_i.shape[0]):
            first = np.searchsorted(z, u_i[s, 2] - widest)
            last = np.searchsorted(z, u_i[s, 2] + widest, side="right")
            for k in range(first, last):
                if middle[k, 0] * u_i[s, 0] + middle[k, 1] * u_i[s, 1] + z[k] * u_i[s, 2] >= cosine[k]:
                    if final:
                        row[fill[order[k]]] = s
                    fill[order[k]] += 1
        if not final:
            start[1:] = np.cumsum(fill)
            fill[:] = start[:-1]
            row = np.empty(start[-1], dtype=np.uint16)
    return start, row
