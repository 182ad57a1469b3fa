"""How a camera turns besides its mean rate while a picture is exposed.

A table has a row for each instant: seconds from the frame's instant, and by how much the camera has turned
there since that instant beyond what the mean rate of the exposure makes of it (rad, rotation vector in camera
axes). Between rows it is linear. A table has no rows where the rate is steady, else two or more.

A camera that turns by omega t + alpha t^2 / 2 sees the mean of an exposure T at alpha T^2 / 24 from the
instant of its middle. At 0.3 deg/s^2 and 0.2 s that is 1.8 arcsec; thrusters that are switched on and off
within the exposure do more.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.shutter import row_times
from shefex_nav.geometry.streak import place_at, seen_from_to, turn_jacobian, velocity

STEADY = np.empty((0, 4))
POINTS = 16  # of an exposure, at which a weighted mean is taken; even
ROUNDS = 2  # of the iteration: the row in which a star is read hardly moves with the correction
LONG = 60.0  # half length over sigma of the spot; of a longer streak a fit sees the ends alone


class Turns(NamedTuple):
    """Rotation vectors of an interval, rad: what `fit_offset_px` needs of it, the same for all stars."""

    mean: np.ndarray  # (3,)
    ends: np.ndarray  # (3,) mean of those at its two ends
    inside: np.ndarray  # (POINTS, 3) in the middle of equal parts


@inner
def rotation_at(table, t_s):
    """Rotation vector (3,) rad at t_s from the frame's instant; before and after the table as at its ends."""
    turned, n = np.zeros(3), table.shape[0]
    if n == 0:
        return turned
    k = 1
    while k < n - 1 and table[k, 0] < t_s:
        k += 1
    before, after = table[k - 1], table[k]
    part = min(max((t_s - before[0]) / (after[0] - before[0]), 0.0), 1.0)
    for j in range(3):
        turned[j] = before[1 + j] + part * (after[1 + j] - before[1 + j])
    return turned


@inner
def mean_rotation(table, begin_s, end_s):
    """Mean of the same over an interval: (3,) rad."""
    total, t_s, here = np.zeros(3), begin_s, rotation_at(table, begin_s)
    if table.shape[0] == 0 or not end_s > begin_s:
        return here
    for k in range(table.shape[0] + 1):
        t_next = table[k, 0] if k < table.shape[0] else end_s
        if t_next <= t_s:
            continue
        t_next = min(t_next, end_s)
        there = rotation_at(table, t_next)
        for j in range(3):
            total[j] += 0.5 * (here[j] + there[j]) * (t_next - t_s)
        t_s, here = t_next, there
        if t_s >= end_s:
            break
    return total / (end_s - begin_s)


@inner
def turns_of(table, begin_s, end_s):
    """Turns of an interval."""
    inside = np.empty((POINTS, 3))
    for k in range(POINTS):
        inside[k] = rotation_at(table, begin_s + (k + 0.5) / POINTS * (end_s - begin_s))
    ends = 0.5 * (rotation_at(table, begin_s) + rotation_at(table, end_s))
    return Turns(mean_rotation(table, begin_s, end_s), ends, inside)


@inner
def fitted_rotation(turns, half_length_px, sigma_px):
    """Mean turn (3,) as a fit of an even streak sees it along the streak.

    Light that is moved along a streak of half-length h shows at the streak's ends: a fit by least squares
    weighs what is moved at s from its middle as

        (h + s) exp(-(h + s)^2 / 4 sigma^2) + (h - s) exp(-(h - s)^2 / 4 sigma^2)

    for a Gaussian spot: the ends alone if the streak is long, all of it alike if it is short. A centroid that
    is a moment sees all alike: sigma_px infinite.
    """
    if half_length_px > LONG * sigma_px:
        return turns.ends
    if not np.isfinite(sigma_px):
        return turns.mean
    total, weights, weight = np.zeros(3), 0.0, np.empty(POINTS)
    for k in range(POINTS // 2):
        s = (2.0 * (k + 0.5) / POINTS - 1.0) * half_length_px
        behind, ahead = (half_length_px + s) / (2.0 * sigma_px), (half_length_px - s) / (2.0 * sigma_px)
        weight[k] = behind * np.exp(-behind * behind) + ahead * np.exp(-ahead * ahead)
        weight[POINTS - 1 - k] = weight[k]
    for k in range(POINTS):
        for j in range(3):
            total[j] += weight[k] * turns.inside[k, j]
        weights += weight[k]
    return total / weights if weights > 0.0 else turns.mean


@inner
def fit_offset_px(H, turns, way_px, sigma_px):
    """By how much a fit of a straight, even streak sees a star moved: x, y [px].

    Across the streak it sees the mean, along it `fitted_rotation`.

    H : (2, 3) px/rad, of `turn_jacobian`;  turns : Turns;  way_px : x, y from end to end
    """
    mean = turns.mean
    x, y, length = H[0] @ mean, H[1] @ mean, np.hypot(way_px[0], way_px[1])
    if length == 0.0:
        return x, y
    more = fitted_rotation(turns, 0.5 * length, sigma_px) - mean
    tx, ty = way_px[0] / length, way_px[1] / length
    along = tx * (H[0] @ more) + ty * (H[1] @ more)
    return x + along * tx, y + along * ty


@kernel
def at_instant(camera, sigma_px, exposed, omega_c, table, xy_px):
    """Where stars are at the frame's instant whose light a fit puts at xy_px.

    Parameters
    ----------
    camera : Pinhole
    sigma_px : of a spot, with the pixel's own; infinite where places are moments
    exposed : exposure_s, line_s, n_rows of the frame, as `row_times` takes them
    omega_c : (3,) rad/s, mean rate of the exposure
    table : (m, 4)
    xy_px : (n, 2) as found

    Returns
    -------
    places : (n, 2) px; NaN for a star that outruns the rows
    seen_s : (n,) s from the frame's instant, the middle of the time in which the light is collected
    """
    times, places, seen_s = row_times(*exposed), xy_px.copy(), np.empty(len(xy_px))
    before, turns = (np.nan, np.nan), turns_of(STEADY, 0.0, 0.0)
    for k in range(len(xy_px)):
        for _ in range(ROUNDS):
            x, y = places[k, 0], places[k, 1]
            begin_s, end_s = seen_from_to(camera, times, omega_c, x, y)
            if (begin_s, end_s) != before:  # with a global shutter all are seen in the same interval
                before, turns = (begin_s, end_s), turns_of(table, begin_s, end_s)
            seen_s[k] = 0.5 * (begin_s + end_s)
            moved_x, moved_y = place_at(camera, omega_c, x, y, seen_s[k])
            vx, vy = velocity(camera, omega_c, x, y)
            way_px, H = (vx * (end_s - begin_s), vy * (end_s - begin_s)), turn_jacobian(camera, x, y)
            dx, dy = fit_offset_px(H, turns, way_px, sigma_px)
            places[k, 0] = xy_px[k, 0] - (moved_x - x + dx)
            places[k, 1] = xy_px[k, 1] - (moved_y - y + dy)
    return places, seen_s
