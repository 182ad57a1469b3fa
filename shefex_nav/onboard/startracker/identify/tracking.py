"""Identification with a prediction: each detection can only be one of the few stars predicted near it.

Pairs of such proposals whose angles agree are attitudes, which are looked at as those of `search`.
"""

import numpy as np

from shefex_nav.compiled import inner, lent
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.startracker.identify.ellipses import along, apart, with_own
from shefex_nav.onboard.startracker.identify.evidence import jacobian, slopes
from shefex_nav.onboard.startracker.identify.lever import STAR_GATE, lever_of, widest_gate
from shefex_nav.onboard.startracker.identify.screen import (
    angle_between,
    directions,
    frame_of,
    join,
    screen,
    triad,
)
from shefex_nav.onboard.startracker.identify.search import (
    PAIR_GATE,
    SHORT_PX,
    SURE,
    look,
    margin,
)
from shefex_nav.onboard.startracker.tables import cell_of

MAX_PROPOSALS = 512  # detections near their predicted places; with more, the prediction is no help
NOISES = (1.1, 3.4)  # times the centroid error, one after the other
CONVINCING = 3  # further stars are worth a closer look
PATIENCE = 6  # bright stars that may be missing before the first further one is found


@inner
def propose(stars, scene, prior, sigma_px):
    """Detections near the predicted place of a star: (m, 2) detection, star; m = 0 when too many."""
    found = np.empty((MAX_PROPOSALS, 2), dtype=np.int64)
    m = 0
    f, nine = scene.focal_px, t3.matrix(prior.C_ci)
    cell = cell_of(nine[6], nine[7], nine[8])
    for e in range(stars.start[cell], stars.start[cell + 1]):
        s = stars.row[e]
        X, Y, Z = t3.rotated(nine, t3.row(stars.u_i, s))
        if Z <= 0.1:
            continue
        x, y = X / Z, Y / Z
        J = jacobian(x, y)
        variance = (sigma_px / f) ** 2
        xx, xy, yy = variance, 0.0, variance  # of an ordinary star
        for a in range(3):
            for b in range(3):
                xx += 2.0 * J[a] * prior.P_c[a, b] * J[b]
                xy += 2.0 * J[a] * prior.P_c[a, b] * J[3 + b]
                yy += 2.0 * J[3 + a] * prior.P_c[a, b] * J[3 + b]
        for k in range(scene.xy_px.shape[0]):
            seen_x, seen_y = slopes(scene, scene.xy_px, k, f)
            dx, dy = seen_x - x, seen_y - y
            kxx, kxy, kyy = with_own(scene.ellipses, k, variance, xx, xy, yy)
            det = kxx * kyy - kxy * kxy
            if (kyy * dx * dx - 2.0 * kxy * dx * dy + kxx * dy * dy) < STAR_GATE**2 * det:
                if m == MAX_PROPOSALS:
                    return found[:0]
                found[m, 0], found[m, 1] = k, s
                m += 1
    return found[:m]


@inner
def try_proposals(task, u_c, p, q, noise):
    """The attitude that makes two proposals true, if they agree; work."""
    stars, scene = task.stars, task.scene
    i, a, j, b = p[0], p[1], q[0], q[1]
    sigma_px, focal_px = noise * scene.centroid_error, scene.focal_px
    u, v, x, y = t3.row(u_c, i), t3.row(u_c, j), t3.row(stars.u_i, a), t3.row(stars.u_i, b)
    seen, true = angle_between(u, v), angle_between(x, y)
    if seen * focal_px < SHORT_PX:
        return 1
    dx, dy = apart(scene.xy_px, i, scene.xy_px, j)
    gate_px = PAIR_GATE * np.sqrt(2.0) * sigma_px * np.sqrt(along(scene.ellipses, i, j, dx, dy))
    if abs(seen - true) * focal_px > gate_px:
        return 1
    C = join(triad(u, v), triad(x, y))
    lever = lever_of(scene, scene.ellipses, i, j, sigma_px)
    frame = frame_of(scene, focal_px, PATIENCE, CONVINCING)
    hits, work = screen(stars, task.seen, C, frame, lever, a, b)
    if hits + 2 < task.min_stars:
        return work
    t3.store(task.best.trial_C, C)
    return work + look(task, focal_px, widest_gate(scene, scene.ellipses, lever), lever, noise > NOISES[0])


@inner
def track(task, budget):
    """Go through the pairs of proposals until one attitude is certain; work."""
    task, work = lent(task), 0
    u_c = directions(task.scene, task.scene.focal_px)
    for noise in NOISES:
        found = propose(task.stars, task.scene, task.prior, noise * task.scene.centroid_error)
        for p in range(found.shape[0]):
            for q in range(p):
                if found[p, 0] == found[q, 0] or found[p, 1] == found[q, 1] or work > budget:
                    continue
                work += try_proposals(task, u_c, found[p], found[q], noise)
                if margin(task) >= task.threshold + SURE:
                    return work
        if margin(task) >= task.threshold:
            break
    return work
