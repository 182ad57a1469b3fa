"""Attitudes worth a look: pairs of detections, brightest first, and what else each attitude predicts.

A pair of detections has an angle and a difference of brightness; the k-vector gives the pairs of stars that
have them too. Each is an attitude, and most are dismissed by the first few bright stars that it predicts and
that are not there. What survives is adjusted and weighed (`evidence`, `odds`). The number of attitudes looked
at is bounded.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.identify.evidence import adjust, jacobian
from shefex_nav.onboard.startracker.identify.odds import log_odds
from shefex_nav.onboard.startracker.skygrid import cell_of

CELL_SHIFT = 4
CELL_PX = 1 << CELL_SHIFT  # of the table of detections
MAX_DETECTIONS = 64  # one bit each
REACH_PX = 10.0  # no prediction is trusted to be worse
PAIR_GATE = 3.0  # sigma of the angle of a pair
STAR_GATE = 3.5  # sigma of a place predicted by a pair
MAGNITUDE_GATE = 4.5  # magnitude_sigma, of a difference of brightness
SHORT_PX = 40.0  # closer detections say little about the attitude
PATIENCE_PER_HIT = 3  # bright stars more that may be missing for each that is found
TRIALS_PER_PAIR = 4  # cost of a pair of detections, in attitudes
TRIALS_PER_LOOK = 100  # cost of adjusting and weighing one, in attitudes
SURE = 5.0  # more than enough, in ln B: no need to look for a rival
# Passes over all pairs: noise and focal length times what was said, bright stars that may be missing before
# the first further one is found, and the share of the budget used up by the end of the pass.
PASSES = (
    (1.1, 1.0, 2, 0.55),
    (3.4, 1.0, 2, 0.75),
    (1.1, 1.0, 6, 0.85),
    (2.0, 1.008, 2, 0.93),
    (2.0, 0.992, 2, 1.0),
)
MAX_PROPOSALS = 512  # detections near their predicted places


class Pairs(NamedTuple):
    """Pairs of catalogue stars by the cosine of their angle; see StarPairs."""

    cosine: np.ndarray
    first: np.ndarray
    second: np.ndarray
    count: np.ndarray
    slope: float
    intercept: float


class Best(NamedTuple):
    """The best attitude so far, in arrays, as it is replaced in place."""

    C: np.ndarray  # (3, 3) C_ci
    star: np.ndarray  # (n,) row of the catalogue per detection, -1
    trial_C: np.ndarray  # (3, 3) the one under examination
    L: np.ndarray  # (4, 4) factor of the information of `adjust`
    score: np.ndarray  # [ln B, ln B of the best different attitude, parameters, sum of squares px^2]


@njit(cache=True)
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


@njit(cache=True, inline="always")
def screen(u_i, start, row, table, xy_px, C, frame, lever, a, b):
    """Further stars found near where an attitude puts them; -1 as soon as too many bright ones are missing.

    The innermost loop of the search, so it takes plain arrays and numbers: C is (3, 3) row by row; frame is
    focal_px, cx, cy, right, bottom, border and the patience; lever is the middle of the pair (x, y), and the squared gate as
    c0 + c1 r^2 at the distance r from it.
    """
    focal_px, cx, cy, right, bottom, border, patience = frame
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
            gate2 = min(lever[2] + lever[3] * ((x - lever[0]) ** 2 + (y - lever[1]) ** 2), REACH_PX * REACH_PX)
            k, near = 0, False
            while bits != 0 and not near:
                if bits & np.uint64(1):
                    near = (xy_px[k, 0] - x) ** 2 + (xy_px[k, 1] - y) ** 2 < gate2
                bits >>= np.uint64(1)
                k += 1
            if near:
                hits += 1
                patience += PATIENCE_PER_HIT
                continue
        due = (x > border) & (y > border) & (x < right - border) & (y < bottom - border)
        patience -= due & (s != a) & (s != b)
        if patience < 0:
            return -1
    return hits


@njit(cache=True)
def triad(p0, p1, p2, q0, q1, q2):
    """Three unit vectors: along p + q, across in their plane, normal to it; 9 numbers for unit p and q."""
    x, y, z = p0 + q0, p1 + q1, p2 + q2
    norm = 1.0 / np.sqrt(x * x + y * y + z * z)
    x, y, z = x * norm, y * norm, z * norm
    u, v, w = p1 * q2 - p2 * q1, p2 * q0 - p0 * q2, p0 * q1 - p1 * q0
    norm = 1.0 / np.sqrt(u * u + v * v + w * w)
    u, v, w = u * norm, v * norm, w * norm
    return x, y, z, v * z - w * y, w * x - u * z, u * y - v * x, u, v, w


@njit(cache=True)
def join(T, S):
    """C_ci, row by row, from the triads of a pair in the camera, T, and in the sky, S."""
    return (
        T[0] * S[0] + T[3] * S[3] + T[6] * S[6],
        T[0] * S[1] + T[3] * S[4] + T[6] * S[7],
        T[0] * S[2] + T[3] * S[5] + T[6] * S[8],
        T[1] * S[0] + T[4] * S[3] + T[7] * S[6],
        T[1] * S[1] + T[4] * S[4] + T[7] * S[7],
        T[1] * S[2] + T[4] * S[5] + T[7] * S[8],
        T[2] * S[0] + T[5] * S[3] + T[8] * S[6],
        T[2] * S[1] + T[5] * S[4] + T[8] * S[7],
        T[2] * S[2] + T[5] * S[5] + T[8] * S[8],
    )


@njit(cache=True)
def scan(u_i, vmag, start, row, first, second, table, xy_px, T, frame, lever, gate, ij, need, begin, end):
    """Next attitude that passes the screen among those of one pair of detections.

    Entry 2 p is pair p of the catalogue in its order, brighter star on detection i; 2 p + 1 the other way.

    Parameters
    ----------
    T, frame, lever : as in `screen` and `join`
    gate : (lowest, highest) vmag[star of j] - vmag[star of i]
    ij : stars that are already known to be i and j
    need : hits
    begin, end : entries

    Returns
    -------
    entry : int, end if there is none
    C : its attitude, 9 numbers
    trials : attitudes looked at
    """
    trials = 0
    C = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    for entry in range(begin, end):
        a, b = first[entry >> 1], second[entry >> 1]
        if entry & 1:
            a, b = b, a
        if not gate[0] < vmag[b] - vmag[a] < gate[1] or (a == ij[0] and b == ij[1]):
            continue
        trials += 1
        S = triad(u_i[a, 0], u_i[a, 1], u_i[a, 2], u_i[b, 0], u_i[b, 1], u_i[b, 2])
        C = join(T, S)
        if screen(u_i, start, row, table, xy_px, C, frame, lever, a, b) >= need:
            return entry, C, trials
    return end, C, trials


@njit(cache=True)
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


@njit(cache=True)
def lever_of(scene, i, j, sigma_px):
    """How the error of a pair's attitude grows with the distance from its middle; see `screen`."""
    dx, dy = scene.xy_px[j, 0] - scene.xy_px[i, 0], scene.xy_px[j, 1] - scene.xy_px[i, 1]
    variance = (STAR_GATE * sigma_px) ** 2
    xm, ym = 0.5 * (scene.xy_px[i, 0] + scene.xy_px[j, 0]), 0.5 * (scene.xy_px[i, 1] + scene.xy_px[j, 1])
    return xm, ym, 1.5 * variance, 2.0 * variance / (dx * dx + dy * dy)


@njit(cache=True)
def widest_gate(scene, lever):
    """Gate at the far end of the detector."""
    far2 = 0.5 * (scene.width_px**2 + scene.height_px**2)
    return min(np.sqrt(lever[2] + lever[3] * far2), REACH_PX)


@njit(cache=True)
def position(pairs, value):
    """Number of pairs whose cosine is below the value, by the k-vector."""
    n = pairs.cosine.shape[0]
    step = min(max((value - pairs.intercept) / pairs.slope, 1.0), float(n))
    k = pairs.count[int(step) - 1]
    while k > 0 and pairs.cosine[k - 1] >= value:
        k -= 1
    while k < n and pairs.cosine[k] < value:
        k += 1
    return k


@njit(cache=True)
def look(stars, scene, prior, best, view, focal_px, gate_px, min_stars, free_focal):
    """Adjust and weigh best.trial_C, without and with a free focal length; keep it if it is the best."""
    start = best.trial_C.copy()
    for n_par in range(3, 5 if free_focal else 4):
        best.trial_C[:] = start
        f = focal_px if n_par == 4 else scene.focal_px
        n, f, L, log_det, noise = adjust(
            stars, scene, best.trial_C, f, view, n_par, gate_px, min_stars
        )  # fmt: skip
        if n == 0:
            continue
        odds = log_odds(stars, scene, prior, best.trial_C, f, view, n, L, log_det, noise, n_par)
        same = 0.0
        for a in range(3):
            for b in range(3):
                same += best.trial_C[a, b] * best.C[a, b]
        if odds <= best.score[0]:
            if same < 2.9999:  # trace of the rotation between them: 0.6 deg
                best.score[1] = max(best.score[1], odds)
            continue
        if same < 2.9999:
            best.score[1] = best.score[0]
        best.C[:] = best.trial_C
        best.L[:] = L
        best.score[0], best.score[2], best.score[3] = odds, n_par, 0.0
        best.star[:] = -1
        for s in range(n):
            if view.det[s] >= 0:
                best.star[view.det[s]] = view.row[s]
                best.score[3] += view.distance2[s]


@njit(cache=True)
def is_settled(best, threshold):
    """Good enough, against chance and against a rival that is itself better than chance."""
    return best.score[0] - max(best.score[1], 0.0) >= threshold


@njit(cache=True)
def frame_of(scene, focal_px, patience):
    """The camera and the patience as `screen` takes them."""
    right, bottom = scene.width_px - 1.0, scene.height_px - 1.0
    return focal_px, scene.cx_px, scene.cy_px, right, bottom, scene.border_px, patience


@njit(cache=True)
def put(C, nine):
    """Nine numbers into a matrix."""
    for a in range(3):
        for b in range(3):
            C[a, b] = nine[3 * a + b]


@njit(cache=True)
def try_pair(stars, pairs, scene, prior, table, best, view, u_c, i, j, how, goal):
    """All pairs of stars that can be the detections i and j; number of attitudes looked at."""
    min_stars, enough = goal
    sigma_px, focal_px, patience, wide = how
    u, v = u_c[i], u_c[j]
    angle = np.arccos(min(u[0] * v[0] + u[1] * v[1] + u[2] * v[2], 1.0))
    tolerance = PAIR_GATE * np.sqrt(2.0) * sigma_px / focal_px
    if angle * focal_px < SHORT_PX:
        return 0
    T = triad(u[0], u[1], u[2], v[0], v[1], v[2])
    lever, frame = lever_of(scene, i, j, sigma_px), frame_of(scene, focal_px, patience)
    width = MAGNITUDE_GATE * scene.magnitude_sigma * (1.6 if wide else 1.0) if scene.has_flux else np.inf
    fainter = scene.mag[j] - scene.mag[i]
    gate = (fainter - width, fainter + width)
    trials = TRIALS_PER_PAIR
    entry = 2 * position(pairs, np.cos(angle + tolerance))
    end = 2 * position(pairs, np.cos(angle - tolerance))
    while entry < end:
        entry, C, n = scan(
            stars.u_i, stars.vmag, stars.start, stars.row, pairs.first, pairs.second, table, scene.xy_px,
            T, frame, lever, gate, (best.star[i], best.star[j]), min_stars - 2, entry, end,
        )  # fmt: skip
        trials += n
        if entry < end:
            trials += TRIALS_PER_LOOK
            put(best.trial_C, C)
            gate_px = widest_gate(scene, lever)
            look(stars, scene, prior, best, view, focal_px, gate_px, min_stars, wide)
            if best.score[0] - max(best.score[1], 0.0) >= enough:
                break
            entry += 1
    return trials


@njit(cache=True)
def lost_in_space(stars, pairs, scene, prior, table, best, view, min_stars, threshold, budget):
    """Go through the pairs of detections until one attitude is certain; attitudes looked at."""
    n = scene.xy_px.shape[0]
    trials, enough = 0, threshold + SURE
    for number in range(len(PASSES)):
        noise, focal, patience, share = PASSES[number]
        focal_px = focal * scene.focal_px
        how = (noise * scene.sigma_px, focal_px, patience, number != 0 and number != 2)
        u_c = directions(scene, focal_px)
        for total in range(1, 2 * n - 2):
            for i in range(max(0, total - n + 1), (total + 1) // 2):
                if trials > share * budget:
                    break
                trials += try_pair(
                    stars, pairs, scene, prior, table, best, view, u_c, i, total - i, how,
                    (min_stars, enough),
                )  # fmt: skip
                if best.score[0] - max(best.score[1], 0.0) >= enough:
                    return trials
        if is_settled(best, threshold):
            break
    return trials


@njit(cache=True)
def propose(stars, scene, prior, sigma_px):
    """Detections near the predicted place of a star: (m, 2) detection, star; m = 0 when too many."""
    found = np.empty((MAX_PROPOSALS, 2), dtype=np.int64)
    m = 0
    C, f = prior.C_ci, scene.focal_px
    cell = cell_of(C[2, 0], C[2, 1], C[2, 2])
    for e in range(stars.start[cell], stars.start[cell + 1]):
        s = stars.row[e]
        p = stars.u_i[s]
        Z = C[2, 0] * p[0] + C[2, 1] * p[1] + C[2, 2] * p[2]
        if Z <= 0.1:
            continue
        x = (C[0, 0] * p[0] + C[0, 1] * p[1] + C[0, 2] * p[2]) / Z
        y = (C[1, 0] * p[0] + C[1, 1] * p[1] + C[1, 2] * p[2]) / Z
        J = jacobian(x, y)
        xx, xy, yy = (sigma_px / f) ** 2, 0.0, (sigma_px / f) ** 2
        for a in range(3):
            for b in range(3):
                xx += 2.0 * J[a] * prior.P_c[a, b] * J[b]
                xy += 2.0 * J[a] * prior.P_c[a, b] * J[3 + b]
                yy += 2.0 * J[3 + a] * prior.P_c[a, b] * J[3 + b]
        det = xx * yy - xy * xy
        for k in range(scene.xy_px.shape[0]):
            dx = (scene.xy_px[k, 0] - scene.cx_px) / f - x
            dy = (scene.xy_px[k, 1] - scene.cy_px) / f - y
            if (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) < STAR_GATE**2 * det:
                if m == MAX_PROPOSALS:
                    return found[:0]
                found[m, 0], found[m, 1] = k, s
                m += 1
    return found[:m]


@njit(cache=True)
def track(stars, scene, prior, table, best, view, min_stars, threshold, budget):
    """As `lost_in_space`, with the few pairs that a prediction leaves; attitudes looked at."""
    trials, enough = 0, threshold + SURE
    for number in range(2):
        sigma_px = PASSES[number][0] * scene.sigma_px
        u_c = directions(scene, scene.focal_px)
        found = propose(stars, scene, prior, sigma_px)
        tolerance = PAIR_GATE * np.sqrt(2.0) * sigma_px / scene.focal_px
        for p in range(found.shape[0]):
            for q in range(p):
                i, j, a, b = found[p, 0], found[q, 0], found[p, 1], found[q, 1]
                if i == j or a == b or trials > budget:
                    continue
                trials += 1
                u, v, x, y = u_c[i], u_c[j], stars.u_i[a], stars.u_i[b]
                seen = np.arccos(min(u[0] * v[0] + u[1] * v[1] + u[2] * v[2], 1.0))
                true = np.arccos(min(x[0] * y[0] + x[1] * y[1] + x[2] * y[2], 1.0))
                if abs(seen - true) > tolerance or seen * scene.focal_px < SHORT_PX:
                    continue
                T = triad(u[0], u[1], u[2], v[0], v[1], v[2])
                nine = join(T, triad(x[0], x[1], x[2], y[0], y[1], y[2]))
                lever = lever_of(scene, i, j, sigma_px)
                hits = screen(
                    stars.u_i, stars.start, stars.row, table, scene.xy_px, nine,
                    frame_of(scene, scene.focal_px, PASSES[2][2]), lever, a, b,
                )  # fmt: skip
                if hits + 2 < min_stars:
                    continue
                trials += TRIALS_PER_LOOK
                put(best.trial_C, nine)
                look(stars, scene, prior, best, view, scene.focal_px, widest_gate(scene, lever), min_stars, number > 0)
                if best.score[0] - max(best.score[1], 0.0) >= enough:
                    return trials
        if is_settled(best, threshold):
            break
    return trials
