"""Reasons to doubt an attitude that beats chance.

The odds weigh an attitude as a whole. Three things can be wrong with one that no chance explains: stars that
crowd in one corner carry any attitude that turns about them, and a single false detection far away may set
that turn; a second image of the sky, shifted by a reflection, is as good a sky as the first; and errors far
beyond the model make an attitude of those stars that happen to fit. Each is refused.
"""

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.startracker.identify.ellipses import apart, between2, factor, weigh, weighted2
from shefex_nav.onboard.startracker.identify.evidence import (
    GATE,
    NOISE_SCALES,
    Fit,
    cholesky,
    gather_distances,
    information,
    jacobian,
    match,
    new_view,
    slopes,
    sort,
)
from shefex_nav.onboard.startracker.identify.lever import REACH_PX, lever_of, widest_gate
from shefex_nav.onboard.startracker.identify.odds import log_odds
from shefex_nav.onboard.startracker.identify.screen import directions, join, triad
from shefex_nav.onboard.startracker.identify.search import (
    MAGNITUDE_GATE,
    WIDER,
    changed,
    look,
    new_best,
    trace_between,
)

LEVER_SIGMA = np.radians(0.1)  # a star without which the attitude is less certain than this ...
LEVER = 2.0  # ... and than so many times what it is with it, must prove itself
IMAGE_SHIFT_PX = 80.0  # second images are looked for within this distance
SAME_PLACE_PX = 4.0  # a nearer detection is part of the star
IMAGE_GATE, WIDEST_IMAGE_GATE = 5.0, 1.5  # noise_px, at most px: two shifts that are the same
IMAGE_STARS = 4  # with the same shift make a second image
KEPT, KEPT_SHARE = 0.75, 0.55  # share of the matches; of the limit, as their sum has little of the last ones
KEPT_MEAN = 0.4  # share of the sum of all squares that KEPT of them have: 1 - (1 + ln 4) / 4
DENIED = 4.0  # times the told variance: one right attitude in a hundred
AROUND, LEAST_AROUND_PX = 45.0, 3.0  # centroid errors, at least px: 4.5 sigma of ten times the noise
RESIDUAL_QUANTILE = 3.1  # sigma of a normal variable: a right attitude is refused once in a thousand


@inner
def recall(task, n):
    """Give the n stars predicted in the room the detections that the best attitude has found for them."""
    best, scene, view = task.best, task.scene, task.room
    for s in range(n):
        view.det[s], view.distance2[s] = -1, 0.0
        for k in range(best.star.shape[0]):
            if best.star[k] == view.row[s]:
                dx, dy = apart(scene.xy_px, k, view.xy_px, s)
                view.det[s], view.distance2[s] = k, weighted2(scene.ellipses, k, dx, dy)


@inner
def around(scene, ellipses):
    """Distance [px, weighted] from a star within which a detection may still be that star.

    Ellipses come from the picture itself: they are not looked at as if they were told ten times too small.
    """
    if ellipses is None:
        return min(max(AROUND * scene.centroid_error, LEAST_AROUND_PX), REACH_PX)
    return GATE * NOISE_SCALES[-1] * scene.centroid_error


@inner
def fits_badly(task, n, n_par):
    """Whether the n stars predicted in the room deny the noise that was told, and by how much.

    Stars are matched again, much further than the noise that is thought possible: a noise that is larger
    makes an attitude of those stars that happen to fit each other, and its own residuals do not tell.
    Of the best KEPT of the matches, so that a few double stars or chance neighbours do not count.

    Returns
    -------
    bool : the squared residuals are beyond the largest noise that is thought possible; quantile of chi
        squared by Wilson and Hilferty (1931)
    float : variance of the centroids over the told one where that is DENIED, else 0
    float : squares of which that is known
    """
    scene, view = task.scene, task.room
    widest_px = NOISE_SCALES[-1] * scene.centroid_error
    match(scene, view, n, around(scene, scene.ellipses), widest_px)
    m, best = gather_distances(view, n), 0.0
    sort(view.spare, m)
    for k in range(int(np.ceil(KEPT * m))):
        best += view.spare[k]
    dof = max(2.0 * m - n_par, 1.0)
    spread = 2.0 / (9.0 * dof)
    limit = dof * (1.0 - spread + RESIDUAL_QUANTILE * np.sqrt(spread)) ** 3
    seen = best / (KEPT_MEAN * dof * scene.centroid_error**2)
    nu = max(KEPT * dof - 1.0, 2.5)  # squares of which it is known; one for the choice of those that fit
    return best > KEPT_SHARE * limit * widest_px**2, seen if seen > DENIED else 0.0, nu


@inner
def _variances(L, n_par):
    """Sum of the first three diagonal elements of (L L')^-1."""
    total = 0.0
    column = np.empty(4)
    for c in range(3):
        for a in range(n_par):
            value = 1.0 if a == c else 0.0
            for b in range(a):
                value -= L[a, b] * column[b]
            column[a] = value / L[a, a]
            total += column[a] ** 2
    return total


@inner
def leans_on_one_star(task, n, focal_px, noise_px, n_par):
    """Whether one star fixes the attitude that has no better reason to be a star than chance.

    Each star is left out in turn. Where the others alone leave the attitude uncertain, the odds with the star
    must beat the odds without it by task.strict: where many false detections may set the turn, a chance star
    is hardly rarer than its odds say. A prediction counts with the others.
    """
    scene, view = task.scene, task.room
    N = np.empty((4, 4))
    information(scene, view, n, focal_px, np.inf, N, np.empty(4))
    known = np.zeros((4, 4))  # of a prediction, with the doubled covariance that `odds` gives it
    if task.prior.known:
        known[:3, :3] = np.linalg.inv(2.0 * task.prior.P_c) * noise_px**2
    L = N + known
    if cholesky(L, n_par) == -np.inf:
        return True
    variance = noise_px**2 * _variances(L, n_par)
    tolerable = max(LEVER_SIGMA**2, LEVER**2 * variance)
    for s in range(n):
        k = view.det[s]
        if k < 0 or variance < tolerable * (1.0 - _leverage(L, scene, view, s, focal_px, n_par)):
            continue
        rest = N.copy()
        _add(rest, scene, view, s, focal_px, n_par, -1.0)
        held = rest + known
        if cholesky(held, n_par) > -np.inf and noise_px**2 * _variances(held, n_par) < tolerable:
            continue
        log_det = cholesky(rest, n_par)
        if log_det == -np.inf:
            return True
        view.det[s] = -1
        fit = Fit(task.best.C, focal_px, n_par, n, rest, log_det, noise_px)
        without = log_odds(task.stars, scene, task.prior, view, fit)
        view.det[s] = k
        if task.best.score[0] - without < task.strict:
            return True
    return False


@inner
def _leverage(L, scene, view, s, focal_px, n_par):
    """Share h of the information that is one star's, L L' that of all: without it no variance grows beyond
    1 / (1 - h) times (trace of N^-1 J' W J: two rows of a factor of W times J).
    """
    J = jacobian(*slopes(scene, view.xy_px, s, focal_px))
    p, q, r = factor(scene.ellipses, view.det[s])
    total = 0.0
    for row in range(2):  # forward substitution; written out, as it is done for every star of every frame
        a, b = (p, q) if row == 0 else (0.0, r)
        x0 = (a * J[0] + b * J[3]) / L[0, 0]
        x1 = (a * J[1] + b * J[4] - L[1, 0] * x0) / L[1, 1]
        x2 = (a * J[2] + b * J[5] - L[2, 0] * x0 - L[2, 1] * x1) / L[2, 2]
        total += x0 * x0 + x1 * x1 + x2 * x2
        if n_par == 4:
            x3 = (a * J[6] + b * J[7] - L[3, 0] * x0 - L[3, 1] * x1 - L[3, 2] * x2) / L[3, 3]
            total += x3 * x3
    return total * focal_px**2


@inner
def _add(N, scene, view, s, focal_px, n_par, sign):
    """Add the information of a star [px^-2 rad^2], lower triangle."""
    J = jacobian(*slopes(scene, view.xy_px, s, focal_px))
    for a in range(n_par):
        ux, uy = (J[a], J[3 + a]) if a < 3 else (J[6], J[7])
        ux, uy = weigh(scene.ellipses, view.det[s], ux, uy)
        for b in range(a + 1):
            vx, vy = (J[b], J[3 + b]) if b < 3 else (J[6], J[7])
            N[a, b] += sign * focal_px**2 * (ux * vx + uy * vy)


@inner
def has_second_image(task, n, noise_px):
    """Whether detections that are no stars repeat the stars: all shifted alike, or turned by 180 degrees.

    A window reflects a shifted image of the sky; a lens, one turned about its axis.
    """
    scene, view = task.scene, task.room
    n_det = scene.xy_px.shape[0]
    size = 4 * n_det
    shift, of_det, m, turned = np.empty((size, 2)), np.empty(size, dtype=np.int64), 0, 0
    gate2 = min(IMAGE_GATE * noise_px, WIDEST_IMAGE_GATE) ** 2
    for k in range(n_det):
        if task.best.star[k] >= 0:
            continue
        x, y = scene.xy_px[k, 0], scene.xy_px[k, 1]
        for s in range(n):
            if view.det[s] < 0:
                continue
            star_x, star_y = view.xy_px[s, 0], view.xy_px[s, 1]
            distance2 = (x - star_x) ** 2 + (y - star_y) ** 2
            if SAME_PLACE_PX**2 < distance2 < IMAGE_SHIFT_PX**2 and m < size:
                shift[m, 0], shift[m, 1], of_det[m] = x - star_x, y - star_y, k
                m += 1
            dx, dy = x + star_x - 2.0 * scene.cx_px, y + star_y - 2.0 * scene.cy_px
            turned += weighted2(scene.ellipses, k, dx, dy) < gate2
    most = turned
    for p in range(m):
        alike = 0
        for q in range(m):
            dx, dy = apart(shift, p, shift, q)
            alike += between2(scene.ellipses, of_det[p], of_det[q], dx, dy) < gate2
        most = max(most, alike)
    return most >= IMAGE_STARS


# ----------------------------------------------------------------------------------------------------------
# Whether a star has the name of its neighbour.
#
# A search ends with the first attitude that is certain, and none within 0.6 deg of it is a rival. But where a
# star has a neighbour a few pixels off and sets the turn, both names make an attitude: one is turned by the
# neighbour's distance over the star's lever, and all others follow. Each such star is given the other name
# here, and the attitude of it and of the star that is furthest from it is fitted and weighed like any other.


APART = 1.0 + 2.0 * np.cos(np.radians(0.1))  # [E] trace of the rotation between attitudes that differ


@inner
def is_named_for_a_neighbour(task, n):
    """Whether the best attitude has a rival in which one of its stars is its neighbour.

    n : stars predicted in the room, with the detections that the attitude has found for them
    """
    scene, view, stars = task.scene, task.room, task.stars
    width = WIDER * MAGNITUDE_GATE * scene.magnitude_error if scene.has_flux else np.inf
    for s in range(n):
        if view.det[s] < 0:
            continue
        for t in range(n):
            dx, dy = apart(view.xy_px, t, view.xy_px, s)
            if view.det[t] >= 0 or not dx * dx + dy * dy < REACH_PX * REACH_PX:
                continue
            if abs(stars.vmag[view.row[t]] - stars.vmag[view.row[s]]) > width:
                continue
            if _rivals(task, n, s, view.row[t]):
                return True
    return False


@inner
def _rivals(task, n, s, row):
    """Whether the detection of star s makes another attitude, about as likely, as the star of `row`."""
    scene, view, stars, best = task.scene, task.room, task.stars, task.best
    k, partner, furthest = view.det[s], -1, 0.0
    for p in range(n):
        j = view.det[p]
        if j >= 0 and p != s:
            dx, dy = apart(scene.xy_px, j, scene.xy_px, k)
            if dx * dx + dy * dy > furthest:
                partner, furthest = p, dx * dx + dy * dy
    if partner < 0:
        return False
    j, focal_px = view.det[partner], best.score[4]
    u_c = directions(scene, focal_px)
    other = changed(task, scene, task.seen, new_best(len(best.star)), new_view())
    T = triad(t3.row(u_c, k), t3.row(u_c, j))
    t3.store(other.best.trial_C, join(T, triad(t3.row(stars.u_i, row), t3.row(stars.u_i, view.row[partner]))))
    lever = lever_of(scene, scene.ellipses, k, j, scene.centroid_error)
    look(other, focal_px, widest_gate(scene, scene.ellipses, lever), lever, best.score[2] == 4.0)
    if other.best.score[0] < best.score[0] - task.threshold:
        return False
    return trace_between(other.best.C, best.C) < APART
