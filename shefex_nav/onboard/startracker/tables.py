"""Stars and pairs as the compiled search takes them: plain arrays, small, in the order of use.

In: the stars of the on-board catalogue, its pairs and their k-vector. Out: `Stars`, `Pairs`. The search reads
a few places of these tables for each attitude it looks at; that they fit into the caches of a processor
decides its speed.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.elementary import log


class Stars(NamedTuple):
    """The catalogue by direction, and how common each magnitude is."""

    u_i: np.ndarray  # (n, 3)
    vmag: np.ndarray  # (n,) ascending
    log_density: np.ndarray  # (n,) ln of the density of catalogue magnitudes [1/mag] at each star
    start: np.ndarray  # (6 CELLS^2 + 1,) int64, list of cell c is row[start[c]:start[c + 1]]
    row: np.ndarray  # uint16 rows of the catalogue, ascending, i.e. brightest first


class Pairs(NamedTuple):
    """Pairs of catalogue stars by the cosine of their angle."""

    cosine: np.ndarray  # (m,) ascending
    star: np.ndarray  # (m, 2) uint16 rows, brighter and fainter
    fainter: np.ndarray  # (m,) float32 by how many magnitudes
    count: np.ndarray  # of the k-vector, with its slope and intercept
    slope: float
    intercept: float


def build(stars, radius, cosine, first, second, index):
    """(Stars, Pairs) of an OnboardCatalogue.

    Parameters
    ----------
    stars : OnboardCatalogue
    radius : float [rad], within which the direction of the axis finds its stars
    cosine, first, second : (m,) as in StarPairs
    index : KVector of cosine
    """
    both = np.column_stack([first, second]).astype(np.uint16)
    fainter = (stars.vmag[second] - stars.vmag[first]).astype(np.float32)
    return by_direction(stars.u_i, stars.vmag, radius), Pairs(cosine, both, fainter, *index)


# ----------------------------------------------------------------------------------------------------------
# Which stars can be in the field: the sky in cells, each with the stars near it.
#
# In: the stars of the on-board catalogue and the radius of the field. Out: for every direction, a list of
# stars that holds all within that radius, brightest first. The cells are squares on the faces of a cube, so
# that a direction is found without trigonometry.


CELLS = 24  # per edge of a face: 3.75 degrees, small against a field; 3456 lists in all
BLOCK = 4  # cells per edge of a block, whose stars are looked for first
DENSITY_WINDOW = 0.3  # mag, half width over which the density of magnitudes is averaged


def by_direction(u_i, vmag, radius):
    """Stars, with lists of all within `radius` [rad] of any direction. (n, 3), (n,) sorted"""
    return Stars(u_i, vmag, log_density(vmag), *_lists_kernel(u_i, radius))


def log_density(vmag):
    """ln of the density of magnitudes [1/mag] at each star. (n,) sorted -> (n,)"""
    below = np.searchsorted(vmag, vmag - DENSITY_WINDOW, side="left")
    above = np.searchsorted(vmag, vmag + DENSITY_WINDOW, side="right")
    faint, bright = vmag[-1], vmag[0]  # the window ends with the catalogue
    width = np.minimum(vmag + DENSITY_WINDOW, faint) - np.maximum(vmag - DENSITY_WINDOW, bright)
    density = (above - below) / (len(vmag) * np.maximum(width, DENSITY_WINDOW))
    return log(density)


@inner
def cell_of(x, y, z):
    """Cell of a direction: the face of the cube that it leaves through and the square on it."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if az >= ax and az >= ay:
        face, a, b, c = (4 if z > 0.0 else 5), x, y, az
    elif ay >= ax:
        face, a, b, c = (2 if y > 0.0 else 3), x, z, ay
    else:
        face, a, b, c = (0 if x > 0.0 else 1), y, z, ax
    scale = 0.5 * CELLS / c
    i = min(int(a * scale + 0.5 * CELLS), CELLS - 1)
    j = min(int(b * scale + 0.5 * CELLS), CELLS - 1)
    return (face * CELLS + i) * CELLS + j


@inner
def _on_face(face, a, b):
    """Unit vector through the point (a, b) in [-1, 1]^2 of a face."""
    v = np.empty(3)
    sign = 1.0 if face % 2 == 0 else -1.0
    if face < 2:
        v[0], v[1], v[2] = sign, a, b
    elif face < 4:
        v[0], v[1], v[2] = a, sign, b
    else:
        v[0], v[1], v[2] = a, b, sign
    return v / np.sqrt(1.0 + a * a + b * b)


@inner
def _around(face, a, b, half):
    """A square on a face, of edge 2 half: unit vector of its middle, cosine to the furthest corner."""
    centre, cosine = _on_face(face, a, b), 1.0
    for da in (-half, half):
        for db in (-half, half):
            cosine = min(cosine, (centre * _on_face(face, a + da, b + db)).sum())
    return centre, cosine


@inner
def _within(u_i, rows, centre, angle):
    """Those of some rows, in their order, whose direction is within an angle [rad] of another."""
    limit, found, n = np.cos(min(angle, np.pi)), np.empty(len(rows), dtype=np.uint16), 0
    for s in rows:
        if centre[0] * u_i[s, 0] + centre[1] * u_i[s, 1] + centre[2] * u_i[s, 2] >= limit:
            found[n] = s
            n += 1
    return found[:n]


@kernel
def _lists_kernel(u_i, radius):
    """Stars within the radius of any point of each cell: start, row.

    A cell looks among the stars of its block alone. These are within the radius and the diagonal of a cell,
    at most 2 sqrt(2)/CELLS, of the block, so that none is missing.
    """
    start, row = np.zeros(6 * CELLS * CELLS + 1, dtype=np.int64), np.empty(1024, dtype=np.uint16)
    n, step, blocks = 0, 1.0 / CELLS, CELLS // BLOCK
    stars, more = np.arange(u_i.shape[0]).astype(np.uint16), radius + 2.0 * np.sqrt(2.0) * step
    for face in range(6):
        of_blocks = []
        for k in range(blocks * blocks):
            a, b = (2 * (k // blocks) + 1) * BLOCK * step - 1.0, (2 * (k % blocks) + 1) * BLOCK * step - 1.0
            centre, cosine = _around(face, a, b, BLOCK * step)
            of_blocks.append(_within(u_i, stars, centre, np.arccos(cosine) + more))
        for i in range(CELLS):
            for j in range(CELLS):
                centre, cosine = _around(face, (2 * i + 1) * step - 1.0, (2 * j + 1) * step - 1.0, step)
                near = of_blocks[(i // BLOCK) * blocks + j // BLOCK]
                found = _within(u_i, near, centre, np.arccos(cosine) + radius)
                while n + len(found) > len(row):
                    row = np.concatenate((row, np.empty(len(row), dtype=np.uint16)))
                row[n : n + len(found)] = found
                n += len(found)
                start[(face * CELLS + i) * CELLS + j + 1] = n
    return start, row[:n].copy()


# ----------------------------------------------------------------------------------------------------------
# k-vector: range search in sorted data without a search (Mortari; SHEFEX-2 star tracker, section 3.4).
#
# A straight line is laid through the sorted values; for each step of the line the table says how many values
# lie below it. A range of values is then two divisions and two look-ups, however long the table.


EPSILON = 2.3e-16  # relative rounding of float64: the line begins below the first and ends above the last


class KVector(NamedTuple):
    """Index of n sorted values: line z(j) = slope j + intercept, j = 1 ... n."""

    count: np.ndarray  # (n,) int64, count[j - 1] = number of values <= z(j)
    slope: float
    intercept: float


def k_vector(values):
    """Index of ascending values, at least two of them different. (n,) -> KVector."""
    n = len(values)
    xi = EPSILON * max(abs(values[0]), abs(values[-1]))
    slope = (values[-1] - values[0] + 2.0 * xi) / (n - 1)
    intercept = values[0] - slope - xi
    count = np.searchsorted(values, slope * np.arange(1, n + 1) + intercept, side="right")
    count[0], count[-1] = 0, n  # by construction, whatever the rounding of the line
    return KVector(count.astype(np.int64), float(slope), float(intercept))


@inner
def span(count, slope, intercept, values, low, high):
    """Positions of the values within [low, high]: first, last of values[first:last], equal when it is empty.

    The fields of KVector come one by one: compiled code takes plain arrays faster than records.
    """
    n = values.shape[0]
    # clamped before they become integers: a range far outside would overflow
    j_low = np.floor(min(max((low - intercept) / slope, 1.0), float(n)))
    j_high = np.ceil(min(max((high - intercept) / slope, 1.0), float(n)))
    a, b = count[int(j_low) - 1], count[int(j_high) - 1]
    # The line is coarser than the values: trim. The rounding of the division may also have cut one off.
    while a > 0 and values[a - 1] >= low:
        a -= 1
    while a < n and values[a] < low:
        a += 1
    while b < n and values[b] <= high:
        b += 1
    while b > 0 and values[b - 1] > high:
        b -= 1
    return a, max(a, b)
