"""Whether a star has the name of its neighbour.

A search ends with the first attitude that is certain, and none within 0.6 deg of it is a rival. But where a
star has a neighbour a few pixels off and sets the turn, both names make an attitude: one is turned by the
neighbour's distance over the star's lever, and all others follow. Each such star is given the other name
here, and the attitude of it and of the star that is furthest from it is fitted and weighed like any other.
"""

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.startracker.identify.ellipses import apart
from shefex_nav.onboard.startracker.identify.evidence import new_view
from shefex_nav.onboard.startracker.identify.lever import REACH_PX, lever_of, widest_gate
from shefex_nav.onboard.startracker.identify.screen import directions, join, triad
from shefex_nav.onboard.startracker.identify.search import (
    MAGNITUDE_GATE,
    WIDER,
    changed,
    look,
    new_best,
    trace_between,
)

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
