"""How sure a star's place is that a pair of detections predicts.

The attitude of a pair moves by the mean of their two errors, and turns about their middle by the difference
of the errors across the line between them, over its length. A place far from the middle is predicted less
well. For round errors that is a circle, otherwise an ellipse for every place.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.startracker.identify.ellipses import apart

REACH_PX = 10.0  # no prediction is trusted to be worse
STAR_GATE = 3.5  # sigma of a place predicted by a pair


class Lever(NamedTuple):
    """Error of the places that one pair predicts: all squared gates, px^2."""

    x: float  # middle of the pair
    y: float
    near2: float  # round errors: gate there, the detection's own error included ...
    far2: float  # ... and its growth with the squared distance
    shift: tuple  # ellipses: xx, xy, yy of the shift,
    both: tuple  # x, y of its covariance with the turn
    turn2: float  # and the turn;
    gate2: float  # a detection adds this times its spread


@inner
def _round(x, y, near2, far2):
    """Lever for round errors."""
    return Lever(x, y, near2, far2, (0.0, 0.0, 0.0), (0.0, 0.0), 0.0, near2)


@inner
def lever_of(scene, ellipses, i, j, sigma_px):
    """Lever of the detections i and j for centroid errors of sigma_px. ellipses: those of the scene."""
    dx, dy = apart(scene.xy_px, j, scene.xy_px, i)
    variance = (STAR_GATE * sigma_px) ** 2
    xm, ym = 0.5 * (scene.xy_px[i, 0] + scene.xy_px[j, 0]), 0.5 * (scene.xy_px[i, 1] + scene.xy_px[j, 1])
    if ellipses is None:
        return _round(xm, ym, 1.5 * variance, 2.0 * variance / (dx * dx + dy * dy))
    spread, length = ellipses.spread, np.sqrt(dx * dx + dy * dy)
    nx, ny = -dy / length, dx / length  # across the line
    xx, xy, yy = t3.plus(t3.row(spread, i), 1.0, t3.row(spread, j))
    turn2 = variance * (xx * nx * nx + 2.0 * xy * nx * ny + yy * ny * ny) / (length * length)
    shift = t3.scaled(0.25 * variance, (xx, xy, yy))
    xx, xy, yy = t3.plus(t3.row(spread, j), -1.0, t3.row(spread, i))
    half = 0.5 * variance / length
    both = (half * (xx * nx + xy * ny), half * (xy * nx + yy * ny))
    return Lever(xm, ym, 0.0, 0.0, shift, both, turn2, variance)


@inner
def no_lever(gate_px):
    """Lever of an attitude without error, for a gate of an ordinary star."""
    return _round(0.0, 0.0, gate_px * gate_px, 0.0)


@inner
def widest_gate(scene, ellipses, lever):
    """Gate at the far end of the detector."""
    if ellipses is None:
        far2 = 0.5 * (scene.width_px**2 + scene.height_px**2)
        return min(np.sqrt(lever.near2 + lever.far2 * far2), REACH_PX)
    return REACH_PX


@inner
def reach_of(ellipses, lever, x, y):
    """Squared gate of a star predicted at (x, y), 0, 0; with ellipses xx, xy, yy of its part."""
    dx, dy = x - lever.x, y - lever.y
    if ellipses is None:
        return min(lever.near2 + lever.far2 * (dx**2 + dy**2), REACH_PX * REACH_PX), 0.0, 0.0
    return (
        lever.shift[0] - 2.0 * lever.both[0] * dy + lever.turn2 * dy * dy,
        lever.shift[1] + lever.both[0] * dx - lever.both[1] * dy - lever.turn2 * dx * dy,
        lever.shift[2] + 2.0 * lever.both[1] * dx + lever.turn2 * dx * dx,
    )


@inner
def gate_of(ellipses, lever, reach, k, dx, dy):
    """Squared distance (dx, dy) of detection k over the squared gate there, and the gate's determinant."""
    spread = ellipses.spread
    xx, xy = reach[0] + lever.gate2 * spread[k, 0], reach[1] + lever.gate2 * spread[k, 1]
    yy = reach[2] + lever.gate2 * spread[k, 2]
    det = xx * yy - xy * xy
    return (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / det, det


@inner
def is_near(ellipses, lever, reach, k, dx, dy):
    """Whether detection k may be a star that is predicted (dx, dy) away; reach is that of the star."""
    distance2 = dx**2 + dy**2
    if ellipses is None:
        return distance2 < reach[0]
    return distance2 < REACH_PX * REACH_PX and gate_of(ellipses, lever, reach, k, dx, dy)[0] < 1.0
