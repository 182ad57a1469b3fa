"""The streak of one star on the detector, as a few numbers that the filter and the fit draw it from.

In: camera, motion and the star's place at the frame's instant. Out: the ends of its streak, from the exact
path. Between them the path is a parabola through the exact middle, which is good to 0.01 px for the streaks
of a tenth of a second or two.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.geometry.shutter import RowTimes
from shefex_nav.geometry.streak import place_at, seen_from_to, turn_jacobian, velocity
from shefex_nav.geometry.unsteady import STEADY, fit_offset_px, rotation_at, turns_of

# Numbers of a path: first end, direction from end to end, length, sagitta, times of the ends, along-track
# distance of the star from one row's opening to the next one's, last end, light per pixel of length
X0, Y0, TX, TY, LENGTH, SAG, BEGIN, END, SKEW, X1, Y1, SHARE = range(12)
NUMBERS = 12
LEAST_LENGTH_PX = 0.3  # a spot is drawn as a streak this long: it adds 0.0075 px^2 to its variance
CENTRED_PX = 1e-3
MOST_ROUNDS = 6


class Turning(NamedTuple):
    """How a camera turns during the exposure of its rows."""

    camera: Pinhole
    omega_c: np.ndarray  # (3,) rad/s, of the camera in its own axes, mean of the exposure
    P_omega_c: np.ndarray  # (3, 3) (rad/s)^2
    times: RowTimes
    unsteady_c: np.ndarray = STEADY  # (m, 4), table of `geometry.unsteady`
    sigma_px: float = 1.0  # of a spot, for that


@kernel
def path_of(turning, x_px, y_px, path):
    """Write the numbers of a star's streak.

    Parameters
    ----------
    turning : Turning
    x_px, y_px : place at the frame's instant
    path : (NUMBERS,) written

    Returns
    -------
    bool, False for a star that leaves the front of the camera, outruns the rows of a rolling shutter, or
        leaves a streak longer than the frame's shorter side; path is not written then
    """
    camera, omega_c, times, unsteady_c = turning.camera, turning.omega_c, turning.times, turning.unsteady_c
    begin, end = seen_from_to(camera, times, omega_c, x_px, y_px)
    xa, ya = place_at(camera, omega_c, x_px, y_px, begin)
    xb, yb = place_at(camera, omega_c, x_px, y_px, end)
    xm, ym = place_at(camera, omega_c, x_px, y_px, 0.5 * (begin + end))
    if unsteady_c.shape[0] > 0:
        H = turn_jacobian(camera, x_px, y_px)
        turns = turns_of(unsteady_c, begin, end)
        middle = fit_offset_px(H, turns, (xb - xa, yb - ya), turning.sigma_px)
        half = 0.5 * (rotation_at(unsteady_c, end) - rotation_at(unsteady_c, begin))
        half_x, half_y = H[0] @ half, H[1] @ half
        xa, ya = xa + middle[0] - half_x, ya + middle[1] - half_y
        xb, yb = xb + middle[0] + half_x, yb + middle[1] + half_y
        xm, ym = xm + middle[0], ym + middle[1]
    if not (np.isfinite(xa + xb) and end > begin):
        return False
    length = np.hypot(xb - xa, yb - ya)
    if not length <= min(camera.width_px, camera.height_px):
        return False
    if length >= LEAST_LENGTH_PX:
        tx, ty = (xb - xa) / length, (yb - ya) / length
        path[SAG] = -ty * (xm - 0.5 * (xa + xb)) + tx * (ym - 0.5 * (ya + yb))
        path[SKEW] = length / (end - begin) * times.line_s
    else:
        vx, vy = velocity(camera, omega_c, x_px, y_px)
        speed = np.hypot(vx, vy)
        tx, ty = (vx / speed, vy / speed) if speed > 0.0 else (1.0, 0.0)
        length = LEAST_LENGTH_PX
        xa, ya = xm - 0.5 * length * tx, ym - 0.5 * length * ty
        xb, yb = xm + 0.5 * length * tx, ym + 0.5 * length * ty
        path[SAG] = path[SKEW] = 0.0
    path[X0], path[Y0], path[TX], path[TY], path[LENGTH] = xa, ya, tx, ty, length
    path[BEGIN], path[END], path[X1], path[Y1] = begin, end, xb, yb
    path[SHARE] = (end - begin) / (times.exposure_s * length)
    return True


@inner
def place_of_middle(turning, middle_x, middle_y, path):
    """Place at the instant of the star whose streak has its middle at a point; writes its path.

    Returns
    -------
    x, y : px; NaN where there is none
    """
    x, y = middle_x, middle_y
    for _ in range(MOST_ROUNDS):
        if not path_of(turning, x, y, path):
            return np.nan, np.nan
        dx, dy = middle_x - 0.5 * (path[X0] + path[X1]), middle_y - 0.5 * (path[Y0] + path[Y1])
        if abs(dx) + abs(dy) < CENTRED_PX:
            break
        x, y = x + dx, y + dy
    return x, y


@inner
def between_middles(path, other):
    """Distance of the middles of two streaks along the first one and across it [px]."""
    ex = 0.5 * (other[X0] + other[X1] - path[X0] - path[X1])
    ey = 0.5 * (other[Y0] + other[Y1] - path[Y0] - path[Y1])
    return abs(ex * path[TX] + ey * path[TY]), abs(ey * path[TX] - ex * path[TY])


@inner
def touching(path, other, s, extra_px):
    """Whether the light of another streak may reach the window of one that is searched extra_px along."""
    along, across = between_middles(path, other)
    # the other one may lie askew: half of what its direction differs by
    askew = 0.5 * other[LENGTH] * abs(path[TX] * other[TY] - path[TY] * other[TX])
    return (
        along < 0.5 * (path[LENGTH] + other[LENGTH]) + extra_px + 8.0 * s and across < 9.0 * s + 2.0 + askew
    )
