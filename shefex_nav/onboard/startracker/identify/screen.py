"""The quick look at an attitude that a pair of detections proposes: are the bright stars there?

In: pairs of stars with the right angle. Out: those whose attitude finds further stars before too many bright
ones are missing. The innermost loops of the identification.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.startracker.identify.ellipses import Ellipses
from shefex_nav.onboard.startracker.identify.lever import REACH_PX, Lever, is_near, reach_of
from shefex_nav.onboard.startracker.tables import cell_of

CELL_SHIFT = 4
CELL_PX = 1 << CELL_SHIFT  # of the table of detections
MAX_DETECTIONS = 64  # one bit each
WORK_PER_TRIAL = 4  # cost of an attitude, in stars looked at
AT_ONCE = 64  # entries of which the brightness is compared first, for the processor cannot foresee it
PATIENCE_PER_HIT = 3  # bright stars more that may be missing for each that is found


class Seen(NamedTuple):
    """The n detections of a frame as `screen` looks for them."""

    table: np.ndarray  # of `detection_table`
    xy_px: np.ndarray  # (n, 2)
    ellipses: Ellipses | None
    partners: np.ndarray  # of `search.with_partners`; (0, 0): nothing is known of them
    room: np.ndarray  # (AT_ONCE,) int64, working space of `scan`


class TwoSeen(NamedTuple):
    """Two detections, i and j, as `scan` compares them with pairs of stars."""

    T: tuple  # triad of their directions in the camera, 9 numbers
    lever: Lever
    gate: tuple  # (lowest, highest) vmag[star of j] - vmag[star of i]
    known: tuple  # the stars that are already known to be i and j, rows of the catalogue
    ij: tuple  # the detections


@inner
def new_seen(scene, ellipses):
    """Seen of a frame of which no partners are known."""
    partners, room = np.zeros((0, 0), dtype=np.uint32), np.empty(AT_ONCE, dtype=np.int64)
    return Seen(detection_table(scene), scene.xy_px, ellipses, partners, room)


@inner
def detection_table(scene):
    """Which detections are within REACH_PX of each cell of the detector, one bit each."""
    rows, columns = int(scene.height_px) // CELL_PX + 3, int(scene.width_px) // CELL_PX + 3
    table = np.zeros((rows, columns), dtype=np.uint64)
    for k in range(scene.xy_px.shape[0]):
        x, y = scene.xy_px[k, 0] + CELL_PX, scene.xy_px[k, 1] + CELL_PX
        left = max(int((x - REACH_PX) / CELL_PX), 0)
        right = min(int((x + REACH_PX) / CELL_PX), columns - 1)
        top = max(int((y - REACH_PX) / CELL_PX), 0)
        bottom = min(int((y + REACH_PX) / CELL_PX), rows - 1)
        for r in range(top, bottom + 1):
            for c in range(left, right + 1):
                table[r, c] |= np.uint64(1) << np.uint64(k)
    return table


@inner(inline="always")
def screen(stars, seen, C, frame, lever, a, b):
    """Further stars found near where an attitude puts them, and how many stars were looked at.

    No more than are convincing; -1 is found as soon as too many bright ones are missing.

    Parameters
    ----------
    stars : Stars
    seen : Seen
    C : C_ci row by row, 9 numbers
    frame : of `frame_of`
    lever : Lever
    a, b : the stars of which the attitude was made
    """
    focal_px, cx, cy, right, bottom, border, patience, convincing = frame
    u_i, start, row = stars.u_i, stars.start, stars.row
    table, xy_px, ellipses = seen.table, seen.xy_px, seen.ellipses
    hits = 0
    cell = cell_of(C[6], C[7], C[8])
    for e in range(start[cell], start[cell + 1]):
        s = row[e]
        p, q, r = u_i[s, 0], u_i[s, 1], u_i[s, 2]
        scale = 1.0 / (C[6] * p + C[7] * q + C[8] * r)  # all stars of the list are in front
        x = focal_px * (C[0] * p + C[1] * q + C[2] * r) * scale + cx
        y = focal_px * (C[3] * p + C[4] * q + C[5] * r) * scale + cy
        # few branches: the processor cannot foresee which stars are in the frame
        column = min(max(x, -1.0), right + 1.0) + CELL_PX
        line = min(max(y, -1.0), bottom + 1.0) + CELL_PX
        bits = table[int(line) >> CELL_SHIFT, int(column) >> CELL_SHIFT]
        if bits != 0 and (x >= 0.0) & (y >= 0.0) & (x <= right) & (y <= bottom) & (s != a) & (s != b):
            reach = reach_of(ellipses, lever, x, y)
            k, near = 0, False
            while bits != 0 and not near:
                if bits & np.uint64(1):
                    near = is_near(ellipses, lever, reach, k, xy_px[k, 0] - x, xy_px[k, 1] - y)
                bits >>= np.uint64(1)
                k += 1
            if near:
                hits += 1
                if hits == convincing:
                    return hits, e + 1 - start[cell]
                patience += PATIENCE_PER_HIT
                continue
        due = (x > border) & (y > border) & (x < right - border) & (y < bottom - border)
        patience -= due & (s != a) & (s != b)
        if patience < 0:
            return -1, e + 1 - start[cell]
    return hits, start[cell + 1] - start[cell]


@inner
def angle_between(p, q):
    """Angle between two unit vectors."""
    return np.arccos(min(t3.dot(p, q), 1.0))


@inner
def triad(p, q):
    """Three unit vectors: along p + q, across in their plane, normal to it; 9 numbers for unit p and q."""
    along, normal = t3.plus(p, 1.0, q), t3.cross(p, q)
    along = t3.scaled(1.0 / np.sqrt(t3.dot(along, along)), along)
    normal = t3.scaled(1.0 / np.sqrt(t3.dot(normal, normal)), normal)
    return along + t3.cross(normal, along) + normal


@inner
def join(T, S):
    """C_ci, row by row, from the triads of a pair in the camera, T, and in the sky, S."""
    return t3.product(t3.transposed(T), S)


@inner
def has_bits(bits, need):
    """Whether at least `need` bits are set."""
    for _ in range(need - 1):
        bits &= bits - np.uint64(1) if bits != 0 else bits
    return need <= 0 or bits != 0


@inner
def scan(stars, pairs, seen, two, frame, need, begin, end):
    """Next attitude that passes the screen among those of one pair of detections.

    Entry 2 p is pair p of the catalogue in its order, brighter star on detection i; 2 p + 1 the other way.

    Parameters
    ----------
    stars, pairs : Stars, Pairs
    seen, frame : as in `screen`
    two : TwoSeen
    need : hits
    begin, end : entries

    Returns
    -------
    entry : int, end if there is none
    C : its attitude, 9 numbers
    work : stars looked at, with WORK_PER_TRIAL for each attitude
    """
    u_i, star, fainter = stars.u_i, pairs.star, pairs.fainter
    (low, high), known, partners, room = two.gate, two.known, seen.partners, seen.room
    is_filtered = partners.shape[0] > 0
    i, j = two.ij
    work = 0
    C = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    for first in range(begin, end, AT_ONCE):
        passed = 0
        for entry in range(first, min(first + AT_ONCE, end)):
            difference = (1 - 2 * (entry & 1)) * fainter[entry >> 1]
            room[passed] = entry
            passed += (low < difference) & (difference < high)
        for entry in room[:passed]:
            a, b = star[entry >> 1, entry & 1], star[entry >> 1, 1 - (entry & 1)]
            if a == known[0] and b == known[1]:
                continue
            if is_filtered and not has_bits(np.uint64(partners[i, a] & partners[j, b]), need):
                continue
            C = join(two.T, triad(t3.row(u_i, a), t3.row(u_i, b)))
            hits, looked_at = screen(stars, seen, C, frame, two.lever, a, b)
            work += WORK_PER_TRIAL + looked_at
            if hits >= need:
                return entry, C, work
    return end, C, work


@inner
def directions(scene, focal_px):
    """Unit vectors of the detections for a focal length: (n, 3)."""
    n = scene.xy_px.shape[0]
    u_c = np.empty((n, 3))
    for k in range(n):
        x = (scene.xy_px[k, 0] - scene.cx_px) / focal_px
        y = (scene.xy_px[k, 1] - scene.cy_px) / focal_px
        norm = 1.0 / np.sqrt(1.0 + x * x + y * y)
        u_c[k, 0], u_c[k, 1], u_c[k, 2] = x * norm, y * norm, norm
    return u_c


@inner
def frame_of(scene, focal_px, patience, convincing):
    """The camera, the patience and what is convincing as `screen` takes them."""
    right, bottom = scene.width_px - 1.0, scene.height_px - 1.0
    return focal_px, scene.cx_px, scene.cy_px, right, bottom, scene.border_px, patience, convincing


# ----------------------------------------------------------------------------------------------------------
# Which detections may belong to a star: those that find a neighbour of it at the right angle.
#
# A right attitude is a set of detections of which any two have the angle of their stars. So if detection i is
# star a, and j is b, the other stars of that attitude are among the detections k for which a has a neighbour
# at the angle between i and k, and b one at the angle between j and k. Where there are too few of them, the
# pair need not be looked at, and most pairs of a wrong attitude have too few: the search gives up early.


@inner
def mark(pairs, partners, ij, entries, gate):
    """Mark two detections as partners for the stars of all catalogue pairs with their angle.

    Parameters
    ----------
    pairs : Pairs
    partners : (n, n_stars) uint32, written: bit j of [i, a] is set if a pair of stars (a, b) may be (i, j)
    ij : the detections
    entries : (begin, end) of the catalogue pairs
    gate : (lowest, highest) magnitude of the star of j minus that of i
    """
    i, j = ij
    of_i, of_j = partners[i], partners[j]
    bit_i, bit_j = np.uint32(1 << i), np.uint32(1 << j)
    star, fainter = pairs.star, pairs.fainter
    for p in range(entries[0], entries[1]):
        a, b, difference = star[p, 0], star[p, 1], fainter[p]
        if gate[0] < difference < gate[1]:
            of_i[a] |= bit_j
            of_j[b] |= bit_i
        if gate[0] < -difference < gate[1]:
            of_i[b] |= bit_j
            of_j[a] |= bit_i
