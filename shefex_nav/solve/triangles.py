"""Attitude and focal length from the shape of triangles: proposals, to be proven by others.

In: detections of one picture and a band of triangles. Out: the few attitudes, each with its focal length,
that put the most stars onto detections. Three stars fix the attitude and the focal length and leave two
numbers to check; the stars around them decide.

The lens is that of a sphere seen from xi behind its centre, x = f (1 + xi) X / (Z + xi): xi = 0 is a pinhole,
1 stereographic, 2 nearly r = f theta, 3 nearly equisolid. It stands for distortions that are too large to be
left to the adjustment.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.startracker.identify.screen import join, triad
from shefex_nav.onboard.startracker.tables import cell_of
from shefex_nav.solve.patterns import (
    CELL,
    COLUMNS,
    LONGEST,
    SHORTEST,
    SLIVER,
    cell_of_shape,
    side,
    volume,
)

CENTROID_PX = 1.0  # error of a side, at most
LENS = 0.004  # error of a side that a lens may make, relative
MAGNITUDES = 2.2  # of a difference of brightness; saturated stars are compared, too
GATE_PX, GATE_SHARE = 1.5, 0.006  # of a predicted star: at the triangle, and per pixel of distance from it
COMPARED = 24  # brightest predicted stars that are looked for
PATIENCE, PER_HIT = 9, 4  # stars that may be missing, and more for each that is found
CELL_PX = 32  # of the table of detections
PER_CELL = 8  # detections that it holds
OVERLAP = 1.01  # factor beyond the focal lengths of a band: what three stars say is wrong by a little
KEPT = 24  # proposals
MISSED = 0.25  # ln of the odds that each predicted star costs which is not there


class Spots(NamedTuple):
    """The n detections of one picture, brightest first."""

    xy_px: np.ndarray  # (n, 2)
    mag: np.ndarray  # (n,) -2.5 log10 flux
    size_px: tuple  # (width, height) of the picture
    cells: np.ndarray  # of `detection_cells`
    xi: float  # of the lens


class Guess(NamedTuple):
    """Focal lengths of a band, and what the detections are for the one in the middle of them."""

    shortest_px: float
    longest_px: float
    focal_px: float  # the geometric mean
    bend: float  # by how much a shape may be wrong for it, relative
    u_c: np.ndarray  # (m, 3) directions of the brightest detections


@kernel
def detection_cells(xy_px, width_px, height_px):
    """Detections near each cell of the detector: (rows, columns, PER_CELL) int64, -1 where none."""
    rows, columns = int(height_px) // CELL_PX + 1, int(width_px) // CELL_PX + 1
    table = np.full((rows, columns, PER_CELL), -1, dtype=np.int64)
    for k in range(xy_px.shape[0]):
        x, y = xy_px[k, 0] / CELL_PX, xy_px[k, 1] / CELL_PX
        for r in range(max(int(y - 0.5), 0), min(int(y + 0.5), rows - 1) + 1):
            for c in range(max(int(x - 0.5), 0), min(int(x + 0.5), columns - 1) + 1):
                for m in range(PER_CELL):
                    if table[r, c, m] < 0:
                        table[r, c, m] = k
                        break
    return table


@inner
def compare(band, spots, C, focal_px, middle):
    """How well an attitude explains the detections: logarithm of the odds against chance.

    Each predicted star that is found counts ln(1 / probability that a detection is there by chance).

    Parameters
    ----------
    band : Band
    spots : Spots
    C : 9 numbers, C_ci row by row
    focal_px : float
    middle : (x, y) of the triangle
    """
    listed_i, start, xy_px, cells = band.listed_i, band.start, spots.xy_px, spots.cells
    width, height = spots.size_px
    cx, cy = 0.5 * (width - 1.0), 0.5 * (height - 1.0)
    farthest = _axial(spots.xi, (cx * cx + cy * cy) / (focal_px * (1.0 + spots.xi)) ** 2)
    per_area = np.pi * xy_px.shape[0] / (width * height)
    patience, odds, compared = PATIENCE, 0.0, 0
    cell = cell_of(C[6], C[7], C[8])
    for e in range(start[cell], start[cell + 1]):
        p, q, r = listed_i[e, 0], listed_i[e, 1], listed_i[e, 2]
        Z = C[6] * p + C[7] * q + C[8] * r
        if Z < farthest:  # most stars of a list are beyond the corners: no more is computed of them
            continue
        scale = focal_px * (1.0 + spots.xi) / (Z + spots.xi)
        x = cx + scale * (C[0] * p + C[1] * q + C[2] * r)
        y = cy + scale * (C[3] * p + C[4] * q + C[5] * r)
        if x < 0.0 or y < 0.0 or x > width - 1.0 or y > height - 1.0:
            continue
        gate = GATE_PX + GATE_SHARE * np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2)
        found = False
        for k in cells[int(y) // CELL_PX, int(x) // CELL_PX]:
            if k < 0:
                break
            if (xy_px[k, 0] - x) ** 2 + (xy_px[k, 1] - y) ** 2 < gate * gate:
                found = True
                break
        compared += 1
        if found:
            odds -= np.log(min(per_area * gate * gate, 0.9))
            patience += PER_HIT
        else:
            odds -= MISSED
            patience -= 1
        if patience < 0 or compared == COMPARED:
            break
    return odds


@inner
def _axial(xi, m2):
    """Third component of the direction of a pixel, at least 0.1; m2 as of `directions`, squared."""
    s = (xi + np.sqrt(max(1.0 + (1.0 - xi * xi) * m2, 0.0))) / (1.0 + m2)
    return max(s - xi - 1e-9, 0.1)


@inner
def keep(kept, n, odds, C, focal_px, xi):
    """Put a proposal into the list of the best, sorted; how many there are."""
    for k in range(n):  # the same attitude again: the better one stays
        same = 0.0
        for a in range(9):
            same += kept[k, 2 + a] * C[a]
        if same > 2.9995 and abs(kept[k, 1] / focal_px - 1.0) < 0.02:
            if odds > kept[k, 0]:
                kept[k, 0], kept[k, 1] = odds, focal_px
                for a in range(9):
                    kept[k, 2 + a] = C[a]
            return n
    if n == KEPT:
        k = np.argmin(kept[:, 0])
        if kept[k, 0] >= odds:
            return n
    else:
        k, n = n, n + 1
    kept[k, 0], kept[k, 1], kept[k, 11] = odds, focal_px, xi
    for a in range(9):
        kept[k, 2 + a] = C[a]
    return n


@inner
def directions(xy_px, size_px, focal_px, xi):
    """Unit vectors of pixels for a focal length and a lens: (n, 3).

    With m = x / (f (1 + xi)) the direction is s (m, 1) - (0, 0, xi), whose length is one for
    s = (xi + sqrt(1 + (1 - xi^2) m^2)) / (1 + m^2).
    """
    u_c = np.empty((xy_px.shape[0], 3))
    for k in range(xy_px.shape[0]):
        u_c[k, 0], u_c[k, 1], u_c[k, 2] = _direction(xy_px, k, size_px, focal_px, xi)
    return u_c


@inner
def _direction(xy_px, k, size_px, focal_px, xi):
    """`directions` of number k: x, y, z."""
    unit = focal_px * (1.0 + xi)
    x = (xy_px[k, 0] - 0.5 * (size_px[0] - 1.0)) / unit
    y = (xy_px[k, 1] - 0.5 * (size_px[1] - 1.0)) / unit
    m2 = x * x + y * y
    s = (xi + np.sqrt(max(1.0 + (1.0 - xi * xi) * m2, 0.0))) / (1.0 + m2)
    return s * x, s * y, s - xi


@inner
def _chord(u, v):
    """Chord between two unit vectors, three numbers each."""
    return np.sqrt((u[0] - v[0]) ** 2 + (u[1] - v[1]) ** 2 + (u[2] - v[2]) ** 2)


@inner
def fit_three(xy_px, size_px, xi, corner, sides, focal_px):
    """Focal length that gives three detections the sides of a catalogue triangle, and the largest misfit.

    sides: chords opposite the three corners. The misfit is relative to the tolerance; beyond 1 it is none.
    Third: their directions, three numbers each. Tuples, as arrays would cost more than what is done here.
    """
    a, b, c = corner
    for _ in range(2):
        p, q, r = (
            _direction(xy_px, a, size_px, focal_px, xi),
            _direction(xy_px, b, size_px, focal_px, xi),
            _direction(xy_px, c, size_px, focal_px, xi),
        )
        focal_px *= (_chord(q, r) + _chord(r, p) + _chord(p, q)) / (sides[0] + sides[1] + sides[2])
    p, q, r = (
        _direction(xy_px, a, size_px, focal_px, xi),
        _direction(xy_px, b, size_px, focal_px, xi),
        _direction(xy_px, c, size_px, focal_px, xi),
    )
    worst = max(
        abs(_chord(q, r) - sides[0]) / (CENTROID_PX / focal_px + LENS * sides[0]),
        abs(_chord(r, p) - sides[1]) / (CENTROID_PX / focal_px + LENS * sides[1]),
        abs(_chord(p, q) - sides[2]) / (CENTROID_PX / focal_px + LENS * sides[2]),
    )
    return focal_px, worst, (p, q, r)


@kernel
def propose(spots, focal_range, first, last, band, kept, n):
    """Try all triangles of detections whose faintest is number first ... last - 1.

    Parameters
    ----------
    spots : Spots
    focal_range : (shortest, longest) focal length [px]
    first, last : int
    band : Band
    kept : (KEPT, 12) proposals: ln odds, focal length, C_ci row by row, xi; filled in place
    n : int, proposals in `kept` so far

    Returns
    -------
    n : int, proposals
    tried : int, catalogue triangles compared
    """
    size = np.sqrt(spots.size_px[0] * spots.size_px[1])
    low, high = max(focal_range[0], size / band.high), min(focal_range[1], size / band.low)
    tried = 0
    if low > high:
        return n, tried
    focal_px = np.sqrt(low * high)
    u_c = directions(spots.xy_px[:last], spots.size_px, focal_px, spots.xi)
    unit = size / focal_px
    # the shape of a triangle off the axis depends on the focal length: half the band, at the corner
    guess = Guess(low, high, focal_px, 0.5 * np.log(high / low) * (0.5 * unit) ** 2, u_c)
    for i in range(first, last):
        for j in range(i):
            for k in range(j):
                sides = side(u_c, j, k), side(u_c, i, k), side(u_c, i, j)
                longest = max(sides[0], sides[1], sides[2])
                if longest > LONGEST * unit or longest < SHORTEST * unit:
                    continue
                n, more = _try_triangle(spots, band, guess, (i, j, k), sides, kept, n)
                tried += more
    return n, tried


@inner
def _try_triangle(spots, band, guess, corner, sides, kept, n):
    """All catalogue triangles with the shape of three detections, whichever of its sides is the longest.

    corner : three detections;  sides : chords opposite to them, for the focal length of the guess
    """
    tried, xy_px, mag = 0, spots.xy_px, spots.mag
    orders = ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))
    for p, q, r in orders:
        a, b, c = sides[p], sides[q], sides[r]
        slack = 2.0 * CENTROID_PX / (guess.focal_px * a) + LENS + guess.bend
        middle, short = b / a, c / a
        if middle > 1.0 + slack or short > middle + slack or short < SLIVER - slack:
            continue
        at = corner[p], corner[q], corner[r]
        left = volume(guess.u_c, at[0], at[1], at[2]) < 0.0
        for m in range(
            int(max(middle - slack, 0.0) / CELL), min(int((middle + slack) / CELL), COLUMNS - 1) + 1
        ):
            begin = cell_of_shape((m + 0.5) * CELL, max(short - slack, 0.0), left)
            end = cell_of_shape((m + 0.5) * CELL, min(short + slack, 1.0), left)
            for t in range(band.cell[begin], band.cell[end + 1]):
                longest, by_middle, by_short = band.shape[t, 0], band.shape[t, 1], band.shape[t, 2]
                if abs(by_middle - middle) > slack or abs(by_short - short) > slack:
                    continue
                focal_px = guess.focal_px * a / longest
                if not is_about(focal_px, guess, 1.0 + slack):
                    continue
                s0, s1, s2 = band.corner[t, 0], band.corner[t, 1], band.corner[t, 2]
                first = (mag[at[0]] - mag[at[1]]) - (band.vmag[s0] - band.vmag[s1])
                second = (mag[at[0]] - mag[at[2]]) - (band.vmag[s0] - band.vmag[s2])
                if max(abs(first), abs(second), abs(first - second)) > MAGNITUDES:
                    continue
                true = longest, longest * by_middle, longest * by_short
                focal_px, misfit, u = fit_three(xy_px, spots.size_px, spots.xi, at, true, focal_px)
                if misfit > 1.0 or not is_about(focal_px, guess, OVERLAP):
                    continue
                tried += 1
                odds, C = _weigh(spots, band, at, u, t, focal_px)
                n = keep(kept, n, odds, C, focal_px, spots.xi)
    return n, tried


@inner
def is_about(focal_px, guess, factor):
    """Whether a focal length that may be wrong by a factor may be one of the guess."""
    return focal_px * factor >= guess.shortest_px and focal_px <= guess.longest_px * factor


@inner
def _weigh(spots, band, at, u, t, focal_px):
    """Odds of the attitude that puts catalogue triangle number t onto the detections `at`, and its 9 numbers.

    u : directions of these three detections
    """
    T = triad(u[1], u[2])  # the longest side
    x, y, u_i = band.corner[t, 1], band.corner[t, 2], band.u_i
    C = join(T, triad(t3.row(u_i, x), t3.row(u_i, y)))
    middle = (spots.xy_px[at[0]] + spots.xy_px[at[1]] + spots.xy_px[at[2]]) / 3.0
    return compare(band, spots, C, focal_px, (middle[0], middle[1])), C
