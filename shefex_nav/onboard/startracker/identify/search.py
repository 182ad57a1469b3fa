"""Attitudes worth a look: pairs of detections, and what else each attitude predicts.

A pair of detections has an angle and a difference of brightness; the k-vector gives the pairs of stars that
have them too. Each is an attitude, and most are dismissed by the first few bright stars that it predicts and
that are not there (`screen`). What survives is adjusted and weighed (`evidence`, `odds`). The number of
attitudes looked at is bounded. The first pairs are the brightest. A frame that they do not solve is searched
with those pairs of stars only that could belong to an attitude (`screen`), in turn by brightness and from
all (`from_all`): whatever noise it is, it is soon given up.
"""

from math import gcd
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, lent
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.startracker.identify.ellipses import along, apart
from shefex_nav.onboard.startracker.identify.evidence import Prior, Scene, Trial, View, adjust
from shefex_nav.onboard.startracker.identify.lever import lever_of, widest_gate
from shefex_nav.onboard.startracker.identify.odds import log_odds
from shefex_nav.onboard.startracker.identify.screen import (
    Seen,
    TwoSeen,
    angle_between,
    directions,
    frame_of,
    mark,
    scan,
    triad,
)
from shefex_nav.onboard.startracker.tables import Stars

PAIR_GATE = 3.0  # sigma of the angle of a pair
MAGNITUDE_GATE = 3.2  # magnitude errors, of a difference of brightness
WIDER = 2.2  # times that gate, in a pass that takes nothing for granted
SHORT_PX = 50.0  # closer detections say little about the attitude
BLOCK, LARGEST_BLOCK = 1.5, 40  # times n: pairs of about the same brightness, of which the cheaper go first
WORK_PER_PAIR = 40  # cost of a pair of detections, in stars looked at by the screen
PARTNER_GATE = 1.4  # times that of a pair: three stars may be worse placed than two
ORDINARY, MOST_GROWTH = 230.0, 5.0  # pairs of stars for one of detections: with more, the work may grow
MOST_FILTERED = 32  # detections, one bit each; with more, the partners would take longer than the search
DENSE = 0.3  # such pairs over stars of the catalogue: with more, nearly all stars have partners
DENSE_SHARE = 0.5  # of the budget, for the first pass then
ENTRIES_PER_WORK = 8  # catalogue pairs that are marked in the time of looking at a star
WORK_PER_LOOK = 300  # cost of adjusting and weighing an attitude ...
WORK_PER_MATCH = 1.0  # ... and for each star predicted times each detection
GOLDEN = 0.618034
SURE = 3.0  # more than enough, in ln B: no need to look for a rival
SAME_TRACE = 2.9999  # of the rotation between two attitudes that are one: 0.6 deg


class Pass(NamedTuple):
    """One way through all pairs of detections."""

    noise: float  # times the centroid error
    focal: float  # times the nominal focal length
    patience: int  # bright stars that may be missing before the first further one is found
    convincing: int  # further stars that are worth a closer look, however many fainter ones are missing
    is_wide: bool  # the focal length is adjusted, too
    share: float  # of the budget used up by its end
    is_filtered: bool  # only pairs of stars that have partners


PASSES = (
    Pass(1.1, 1.0, 2, 3, False, 0.1, False),
    Pass(1.1, 1.0, 6, 3, False, 0.7, True),
    Pass(3.4, 1.0, 2, 5, True, 0.84, False),
    Pass(2.0, 1.008, 2, 5, True, 0.92, False),
    Pass(2.0, 0.992, 2, 5, True, 1.0, False),
)


class Best(NamedTuple):
    """The best attitude so far, in arrays, as it is replaced in place."""

    C: np.ndarray  # (3, 3) C_ci
    star: np.ndarray  # (n,) row of the catalogue per detection, -1
    trial_C: np.ndarray  # (3, 3) the one under examination
    L: np.ndarray  # (4, 4) factor of the information of `adjust`
    score: (
        np.ndarray
    )  # [ln B, ln B of the best different attitude, parameters, sum of squares px^2, focal, noise]


class Task(NamedTuple):
    """All that a search needs, and where its result goes."""

    stars: Stars
    scene: Scene
    prior: Prior
    seen: Seen  # the detections of the scene
    best: Best
    room: View  # working space
    min_stars: int
    threshold: float  # of ln B, an attitude against chance
    strict: float  # of ln B, one star against chance


@inner
def changed(task, scene, seen, best, room):
    """The task with other detections, another place for its result and other working space."""
    rules = task.min_stars, task.threshold, task.strict
    return Task(task.stars, scene, task.prior, seen, best, room, *rules)


@inner
def new_best(n):
    """Nothing found yet in n detections."""
    score = np.array([-np.inf, -np.inf, 3.0, 0.0, 1.0, 1.0])
    return Best(np.zeros((3, 3)), np.full(n, -1, dtype=np.int64), np.eye(3), np.zeros((4, 4)), score)


@inner
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


@inner
def look(task, focal_px, gate_px, lever, free_focal):
    """Adjust and weigh best.trial_C, without and with a free focal length; keep the best. Work."""
    stars, scene, best, view = task.stars, task.scene, task.best, task.room
    start, work = t3.matrix(best.trial_C), 0
    for n_par in range(3, 5 if free_focal else 4):
        t3.store(best.trial_C, start)
        trial = Trial(best.trial_C, focal_px if n_par == 4 else scene.focal_px, n_par)
        fit = adjust(stars, scene, trial, view, gate_px, lever, task.min_stars)
        work += WORK_PER_LOOK + int(WORK_PER_MATCH * fit.n * scene.xy_px.shape[0])
        if fit.n == 0:
            continue
        odds = log_odds(stars, scene, task.prior, view, fit)
        same = trace_between(best.trial_C, best.C)
        if odds <= best.score[0]:
            if same < SAME_TRACE:
                best.score[1] = max(best.score[1], odds)
            continue
        if same < SAME_TRACE:
            best.score[1] = best.score[0]
        best.C[:] = best.trial_C
        best.L[:] = fit.L
        best.score[0], best.score[2], best.score[3] = odds, n_par, 0.0
        best.score[4], best.score[5] = fit.focal_px, fit.noise_px
        best.star[:] = -1
        for s in range(fit.n):
            if view.det[s] >= 0:
                best.star[view.det[s]] = view.row[s]
                best.score[3] += view.distance2[s]
    return work


@inner
def trace_between(A, B):
    """Trace of the rotation between two attitudes, (3, 3) each."""
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += A[a, b] * B[a, b]
    return total


@inner
def margin(task):
    """ln B of the best attitude, against chance and against a rival that is itself better than chance."""
    return task.best.score[0] - max(task.best.score[1], 0.0)


@inner
def window(pairs, u_c, i, j, tolerance):
    """Catalogue pairs with the angle of the detections i and j: begin, end; empty for close detections."""
    angle = angle_between(t3.row(u_c, i), t3.row(u_c, j))
    low, high = np.cos(angle + tolerance), np.cos(max(angle - tolerance, 0.0))
    return position(pairs, low), position(pairs, high)


@inner
def try_pair(task, pairs, u_c, pair, tolerance, way):
    """The catalogue pairs with the angle of a pair of detections, to a tolerance [rad]; work."""
    stars, scene, best, i, j = task.stars, task.scene, task.best, pair[0], pair[1]
    begin, end = window(pairs, u_c, i, j, tolerance)
    sigma_px, focal_px = way.noise * scene.centroid_error, way.focal * scene.focal_px
    lever = lever_of(scene, scene.ellipses, i, j, sigma_px)
    frame = frame_of(scene, focal_px, way.patience, way.convincing)
    width = MAGNITUDE_GATE * scene.magnitude_error * (WIDER if way.is_wide else 1.0)
    if not scene.has_flux:
        width = np.inf
    fainter = scene.mag[j] - scene.mag[i]
    T = triad(t3.row(u_c, i), t3.row(u_c, j))
    two = TwoSeen(T, lever, (fainter - width, fainter + width), (best.star[i], best.star[j]), (i, j))
    entry, work = 2 * begin, WORK_PER_PAIR
    while entry < 2 * end:
        entry, C, n = scan(stars, pairs, task.seen, two, frame, task.min_stars - 2, entry, 2 * end)
        work += n
        if entry < 2 * end:
            t3.store(best.trial_C, C)
            work += look(task, focal_px, widest_gate(scene, scene.ellipses, lever), lever, way.is_wide)
            if margin(task) >= task.threshold + SURE:
                break
            entry += 1
    return work


@inner
def pairs_by_brightness(n):
    """All pairs of n detections, brightest first: (m, 2)."""
    order = np.empty((n * (n - 1) // 2, 2), dtype=np.int64)
    m = 0
    for total in range(1, 2 * n - 2):
        for i in range(max(0, total - n + 1), (total + 1) // 2):
            order[m, 0], order[m, 1] = i, total - i
            m += 1
    return order


@inner
def from_all(order):
    """The same pairs, in turn the brightest and any: (m, 2). For frames whose brightest detections are false.

    Any: m times the golden ratio further each time, so that few of them are already a fair sample of all.
    """
    m = order.shape[0]
    mixed, taken, bright, any_k = np.empty_like(order), np.zeros(m, dtype=np.bool_), 0, 0
    step = max(int(GOLDEN * m), 1)
    while step > 1 and gcd(step, m) > 1:  # else not all pairs would be met
        step -= 1
    for k in range(m):
        if k % 2 == 0:
            while taken[bright]:
                bright += 1
            which = bright
        else:
            while taken[any_k]:
                any_k = (any_k + step) % m
            which = any_k
        taken[which] = True
        mixed[k, 0], mixed[k, 1] = order[which, 0], order[which, 1]
    return mixed


@inner
def costs_of(scene, order):
    """Relative cost of pairs of detections, inf for close ones, and their variance along the line, (m,) each.

    Squares of what the number of catalogue pairs grows with: the angle and its tolerance.
    """
    cost, spread = np.full(order.shape[0], np.inf), np.ones(order.shape[0])
    for k in range(order.shape[0]):
        i, j = order[k, 0], order[k, 1]
        dx, dy = apart(scene.xy_px, i, scene.xy_px, j)
        distance2 = dx * dx + dy * dy
        if distance2 > SHORT_PX**2:
            spread[k] = along(scene.ellipses, i, j, dx, dy)
            cost[k] = distance2 * spread[k]
    return cost, spread


@inner
def tolerance_of(task, way):
    """Tolerance [rad] of the angle of a pair of ordinary stars."""
    return (
        PAIR_GATE * np.sqrt(2.0) * way.noise * task.scene.centroid_error / (way.focal * task.scene.focal_px)
    )


@inner
def try_block(task, pairs, u_c, block, way, limit):
    """A few pairs of detections, the closest first, as those have the fewest catalogue pairs; work."""
    cost, spread = costs_of(task.scene, block)
    tolerance, work = tolerance_of(task, way), block.shape[0]
    for _ in range(block.shape[0]):
        k = np.argmin(cost)
        if cost[k] == np.inf or work > limit:
            break
        cost[k] = np.inf
        work += try_pair(task, pairs, u_c, block[k], tolerance * np.sqrt(spread[k]), way)
        if margin(task) >= task.threshold + SURE:
            break
    return work


@inner
def try_in_turn(task, pairs, u_c, order, size, way, limit):
    """All pairs of detections: the cheapest of all, and the cheapest of a block of bright ones; work.

    A pair of two good places is worth many others, but false detections may look good or stand close to
    each other, too: half of the work for each.
    """
    cost, spread = costs_of(task.scene, order)
    tolerance, work, ahead, first = tolerance_of(task, way), order.shape[0], 0, 0
    while first < order.shape[0] and work <= limit:
        is_bright = ahead > 0  # the cheap ones have had more of the work
        k = first + np.argmin(cost[first : first + size]) if is_bright else np.argmin(cost)
        if cost[k] == np.inf:
            first += size
            continue
        cost[k] = np.inf
        more = try_pair(task, pairs, u_c, order[k], tolerance * np.sqrt(spread[k]), way)
        work, ahead = work + more, ahead + (-more if is_bright else more)
        if margin(task) >= task.threshold + SURE:
            break
    return work


@inner
def try_all(task, ellipses, pairs, u_c, order, way, limit):
    """All pairs of detections, brightest first or, with ellipses, best first; work."""
    size = min(int(BLOCK * task.scene.xy_px.shape[0]), LARGEST_BLOCK)
    if ellipses is not None:
        return try_in_turn(task, pairs, u_c, order, size, way, limit)
    work = 0
    for first in range(0, order.shape[0], size):
        if limit - work < 0.0 or margin(task) >= task.threshold + SURE:
            break
        work += try_block(task, pairs, u_c, order[first : first + size], way, limit - work)
    return work


@inner
def with_partners(task, pairs, u_c, order, way):
    """The task with the partners of its detections; work."""
    seen, spread = task.seen, costs_of(task.scene, order)[1]
    width = WIDER * MAGNITUDE_GATE * task.scene.magnitude_error if task.scene.has_flux else np.inf
    partners = np.zeros((u_c.shape[0], task.stars.u_i.shape[0]), dtype=np.uint32)
    tolerance, entries = PARTNER_GATE * tolerance_of(task, way), 0
    for k in range(order.shape[0]):
        i, j = order[k, 0], order[k, 1]
        begin, end = window(pairs, u_c, i, j, tolerance * np.sqrt(spread[k]))
        fainter = task.scene.mag[j] - task.scene.mag[i]
        mark(pairs, partners, (i, j), (begin, end), (fainter - width, fainter + width))
        entries += end - begin
    seen = Seen(seen.table, seen.xy_px, seen.ellipses, partners, seen.room)
    return changed(task, task.scene, seen, task.best, task.room), entries // ENTRIES_PER_WORK


@inner
def crowd_of(task, pairs):
    """Whether a search for partners does not pay: too many detections, or nearly all stars have them.

    And by how much the work may grow therefore.
    """
    n = task.scene.xy_px.shape[0]
    if n > MOST_FILTERED:
        return True, MOST_GROWTH
    tolerance = tolerance_of(task, PASSES[0])
    if task.scene.ellipses is not None:
        tolerance *= np.sqrt(costs_of(task.scene, pairs_by_brightness(n))[1]).mean()
    entries = pairs.cosine.shape[0] * 2.0 * tolerance / np.arccos(pairs.cosine[0])
    return entries > DENSE * task.stars.u_i.shape[0], min(max(entries / ORDINARY, 1.0), MOST_GROWTH)


@inner
def lost_in_space(task, pairs, budget):
    """Go through the pairs of detections until one attitude is certain; work."""
    task, pairs = lent(task), lent(pairs)
    work, ellipses = 0, task.scene.ellipses
    n = task.scene.xy_px.shape[0]
    is_dense, growth = crowd_of(task, pairs)
    for way in PASSES:
        u_c = directions(task.scene, way.focal * task.scene.focal_px)
        trying, order = task, pairs_by_brightness(n)
        if way.is_filtered:
            order = from_all(order)
            if not is_dense:
                trying, more = with_partners(task, pairs, u_c, order, way)
                work += more
        share = max(way.share, DENSE_SHARE) if is_dense else way.share
        work += try_all(trying, ellipses, pairs, u_c, order, way, share * growth * budget - work)
        if margin(task) >= task.threshold:
            break
    return work
