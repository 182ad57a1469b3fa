"""The path of a star over the detector of a camera that turns at a constant rate.

In: the camera, its angular rate, the times of its rows. Out: where a star is at any time of the exposure, and
from when to when its light is collected. A camera that turns by omega sees a star turn by -omega:
u_c(t) = exp(-skew(omega_c) t) u_c(0).

With a rolling shutter a star that moves with the order of the rows is seen for longer than the exposure of a
row, and one that moves against it for less: the light of time t is collected where the row at y(t) is open,
so the first and the last instant solve t = row_start(y(t)) and t = row_start(y(t)) + exposure.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry.pinhole import turn_slopes
from shefex_nav.geometry.shutter import row_start_s

SOLVED_S = 1e-9  # of the first and last instant; less than 1e-5 px at any rate
MOST_STEPS = 60  # of the fixed point, which shrinks by |v_y| line_s each: 0.1 at 10 deg/s


@kernel
def place_at(camera, omega_c, x_px, y_px, t_s):
    """Where a star that is at (x_px, y_px) at time zero is at t_s.

    Parameters
    ----------
    camera : Pinhole
    omega_c : (3,) rad/s, of the camera in its own axes, constant
    x_px, y_px : float
    t_s : float

    Returns
    -------
    x, y : px, exact for a constant rate; NaN behind the camera
    """
    a = (x_px - camera.cx_px) / camera.focal_length_px
    b = (y_px - camera.cy_px) / camera.focal_length_px
    wx, wy, wz = omega_c[0], omega_c[1], omega_c[2]
    rate = np.sqrt(wx * wx + wy * wy + wz * wz)
    angle = rate * t_s
    # Rodrigues with n = w / rate: u(t) = u cos - (n x u) sin + n (n.u)(1 - cos)
    sine = np.sin(angle) / rate if rate > 0.0 else t_s
    half = np.sin(0.5 * angle)
    versine = 2.0 * half * half / (rate * rate) if rate > 0.0 else 0.5 * t_s * t_s
    cosine, along = np.cos(angle), versine * (wx * a + wy * b + wz)
    X = a * cosine - (wy - wz * b) * sine + wx * along
    Y = b * cosine - (wz * a - wx) * sine + wy * along
    Z = cosine - (wx * b - wy * a) * sine + wz * along
    if Z <= 0.0:
        return np.nan, np.nan
    scale = camera.focal_length_px / Z
    return camera.cx_px + scale * X, camera.cy_px + scale * Y


@kernel
def turn_jacobian(camera, x_px, y_px):
    """How a small turn of the camera, dtheta_c, moves a star: d xy = H dtheta_c. -> (2, 3) px/rad.

    q_ic(true) = q_ic exp(dtheta), as `turn_slopes`.
    """
    f = camera.focal_length_px
    return f * np.array(turn_slopes((x_px - camera.cx_px) / f, (y_px - camera.cy_px) / f))


@kernel
def turn_jacobians(camera, xy_px):
    """`turn_jacobian` at each place. (n, 2) px -> (n, 2, 3) px/rad."""
    H = np.empty((len(xy_px), 2, 3))
    for k in range(len(xy_px)):
        H[k] = turn_jacobian(camera, xy_px[k, 0], xy_px[k, 1])
    return H


@kernel
def velocity(camera, omega_c, x_px, y_px):
    """Velocity of a star at (x_px, y_px). -> vx, vy [px/s]: the derivative of `place_at` at time zero."""
    f = camera.focal_length_px
    dx, dy = turn_slopes((x_px - camera.cx_px) / f, (y_px - camera.cy_px) / f)
    vx = dx[0] * omega_c[0] + dx[1] * omega_c[1] + dx[2] * omega_c[2]
    vy = dy[0] * omega_c[0] + dy[1] * omega_c[1] + dy[2] * omega_c[2]
    return f * vx, f * vy


@kernel
def seen_from_to(camera, times, omega_c, x_px, y_px):
    """First and last instant at which the light of a star is collected.

    Parameters
    ----------
    camera, omega_c, x_px, y_px : as `place_at`, the star's place at time zero
    times : RowTimes

    Returns
    -------
    begin_s, end_s : from the frame's instant; NaN for a star that leaves the front of the camera, or that
        outruns the rows: it may be seen several times or never
    """
    begin_s = end_s = row_start_s(times, y_px)
    end_s += times.exposure_s
    if times.line_s == 0.0:
        return begin_s, end_s
    for _ in range(MOST_STEPS):
        _, y_begin = place_at(camera, omega_c, x_px, y_px, begin_s)
        _, y_end = place_at(camera, omega_c, x_px, y_px, end_s)
        next_begin, next_end = row_start_s(times, y_begin), row_start_s(times, y_end) + times.exposure_s
        settled = abs(next_begin - begin_s) < SOLVED_S and abs(next_end - end_s) < SOLVED_S
        begin_s, end_s = next_begin, next_end
        if settled:
            return begin_s, end_s
    return np.nan, np.nan


@kernel
def middles_seen(camera, times, omega_c, xy_px):
    """When the light of stars is collected, in the mean. (n, 2) places at time zero -> (n,) s."""
    t_s = np.empty(len(xy_px))
    for k in range(len(xy_px)):
        begin_s, end_s = seen_from_to(camera, times, omega_c, xy_px[k, 0], xy_px[k, 1])
        t_s[k] = 0.5 * (begin_s + end_s)
    return t_s


@kernel
def rate_lever(camera, times, omega_c, x_px, y_px):
    """How an error of the rate moves a star's place at time zero: d xy = S domega_c. -> (2, 3) px s.

    The star was seen in the middle of its time; a rate that is domega too low carries it from there to time
    zero by too little. With a global shutter the lever is zero to first order.
    """
    begin_s, end_s = seen_from_to(camera, times, omega_c, x_px, y_px)
    return 0.5 * (begin_s + end_s) * turn_jacobian(camera, x_px, y_px)
