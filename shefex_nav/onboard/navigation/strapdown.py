"""Strapdown: IMU increments in, position, velocity and attitude out, in inertial axes.

Every sample is taken as a rate and a specific force that change linearly, so that a sample may be cut
anywhere (measurements between samples). Coning and sculling compensation after Savage, JGCD 21 (1998),
parts 1 and 2. The slopes in the middle of a sample come from the parabola through it and the two before;
the usual difference of two samples is the slope half a sample earlier, which under spin at a rate w leaves a
share w dt/2 of the coning undone, always with the same sign in inertial axes.

For a piece of duration T with rate A + B tau and specific force a + b tau::

    phi = dtheta + T^3/12 A x B                                                   coning
    s   = J(dtheta) dv + T^3/12 (A x b + a x B),   J = 1/T int exp(skew(A tau)) dtau    rotation, sculling
    s_r = T/2 dv - T^3/12 b + T/6 dtheta x dv                                     the same for position

    q <- q exp(phi),   v <- v + C_ib s + g T,   r <- r + v T + C_ib s_r + g T^2/2

The kernels take the nominal state packed (`state.pack`), and the increments of a tick behind the two before
it, and work on tuples of numbers (`triples`).
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.environment.gravity import J2_WGS84
from shefex_nav.geometry import triples as t3
from shefex_nav.geometry import wgs84
from shefex_nav.onboard.navigation import error_model
from shefex_nav.onboard.navigation.calibration import (
    NO_DRIVE,
    acting,
    correct_increments,
    free_increment,
    triads,
)
from shefex_nav.onboard.navigation.state import X_Q, X_R, X_V

BEFORE = 2  # samples kept from before a block, for the slopes
LEAST = 1e-9  # share of a sample that is worth a step
NO_EXTRA = np.zeros((3, 3))
NO_NOISE = np.zeros(3)


class ImuWindow(NamedTuple):
    """The samples of one tick, any number, and the two before them, which give the first slopes."""

    t_end_s: float
    dt_s: float
    increments: np.ndarray  # (2 + n, 6) rad and m/s, as measured
    vibration: float  # level, 0: no motor burns, 1: the strongest motor
    extra: np.ndarray = NO_EXTRA  # (3, 3) white noise of more, body axes, as `integrity_imu.screen` says
    drive: np.ndarray = NO_DRIVE  # (6, m) what the last m errors drive, as in `calibration`
    rate_noise: np.ndarray = NO_NOISE  # (3,) rad/s, what of the mean rate is noise, of `process_noise`

    @property
    def dtheta_b(self):
        """Integrated rate of the tick's own samples: (n, 3) rad."""
        return self.increments[BEFORE:, :3]

    @property
    def dv_b(self):
        """Integrated specific force of the tick's own samples: (n, 3) m/s."""
        return self.increments[BEFORE:, 3:]

    @property
    def n(self):
        """Number of the tick's own samples."""
        return len(self.increments) - BEFORE

    @property
    def length_s(self):
        """Duration of the tick."""
        return self.n * self.dt_s


@inner(forceinline=True)
def cut(last, before, sample, h, x0, x1):
    """Part x0 ... x1 (0 ... 1) of a sample of duration h, from its two predecessors' and its own increments.

    last, before, sample : (dtheta, dv), corrected, of which `last` is the oldest

    Returns
    -------
    T : s
    dtheta, dv : rad, m/s, increments of the part
    B, b : rad/s^2, m/s^3, slopes of rate and specific force
    phi : rad, rotation in it
    s, s_r : m/s, m, velocity and distance gained, in the axes at its start
    """
    T = (x1 - x0) * h
    off_centre = 0.5 * (x0 + x1 - 1.0) * h * T
    T3 = T * T * T / 12.0
    B = _slope(last[0], before[0], sample[0], h)
    b = _slope(last[1], before[1], sample[1], h)
    A, a = t3.scaled(1.0 / h, sample[0]), t3.scaled(1.0 / h, sample[1])  # means
    dtheta = t3.plus(t3.scaled(T, A), off_centre, B)
    dv = t3.plus(t3.scaled(T, a), off_centre, b)
    phi = t3.plus(dtheta, T3, t3.cross(A, B))  # A x B is the same at every instant of the sample
    # J(dtheta) dv as a series to the fourth order: enough for 0.1 rad in a sample
    t2, turn = t3.dot(dtheta, dtheta), t3.cross(dtheta, dv)
    s = t3.plus(dv, 0.5 - t2 / 24.0, turn)
    s = t3.plus(s, 1.0 / 6.0 - t2 / 120.0, t3.cross(dtheta, turn))
    s = t3.plus(t3.plus(s, T3, t3.cross(A, b)), T3, t3.cross(a, B))
    s_r = t3.plus(t3.plus(t3.scaled(T / 2.0, dv), -T3, b), T / 6.0, turn)
    return T, dtheta, dv, B, b, phi, s, s_r


@inner(forceinline=True)
def _slope(last, before, sample, h):
    """Slope in the middle of a sample of what the increments integrate: parabola through three samples."""
    return t3.scaled(1.0 / (h * h), t3.plus(t3.plus(t3.scaled(1.5, sample), -2.0, before), 0.5, last))


@inner(forceinline=True)
def gravity_i(r, angle, C_iq, C_re):
    """Gravitation with J2 at r, inertial axes, the Earth turned by an angle. -> m/s^2

    As `environment.gravity.gravity_j2_e`, which needs of the Earth's attitude its axis alone.
    """
    c, s = np.cos(angle), np.sin(angle)
    pole = c * C_re[0, 2] - s * C_re[1, 2], s * C_re[0, 2] + c * C_re[1, 2], C_re[2, 2]
    pole = t3.rotated(t3.matrix(C_iq), pole)
    r2, z = t3.dot(r, r), t3.dot(r, pole)
    k = 1.5 * J2_WGS84 * wgs84.A**2 / r2
    pull = -wgs84.GM / (r2 * np.sqrt(r2))
    return t3.plus(t3.scaled(pull * (1.0 + k * (1.0 - 5.0 * z * z / r2)), r), 2.0 * pull * k * z, pole)


@inner
def propagate(x, imu, begin_s, end_s, g, responses):
    """Carry packed values through a part of a window, and with them the responses to errors of the IMU.

    Parameters
    ----------
    x : (X,) packed nominal state at begin_s; position, velocity and attitude are written
    imu : ImuWindow
    begin_s, end_s : s from the start of the window
    g : m/s^2, three numbers, inertial axes
    responses : error_model.Responses, changed

    Returns
    -------
    u, u_r : velocity and distance gained against free fall, inertial axes
    angle, speed : sums of the corrected increments, rad, m/s
    """
    increments, h = imu.increments, imu.dt_s
    inverses = triads(x)
    r, v = t3.vector(x, X_R.start), t3.vector(x, X_V.start)
    q = t3.quaternion(x, X_Q.start)
    u_sum = u_r_sum = angle = speed = (0.0, 0.0, 0.0)
    m, weights = np.empty((4, 3, 3)), np.empty(error_model.WEIGHTS)
    known, noise = acting(x, imu.vibration, imu.drive), t3.vector(imu.rate_noise, 0)
    last = free_increment(known, inverses, increments, 0, h)
    before = free_increment(known, inverses, increments, 1, h)
    for n in range(BEFORE, increments.shape[0]):
        sample = free_increment(known, inverses, increments, n, h)
        x0, x1 = max(begin_s / h - (n - BEFORE), 0.0), min(end_s / h - (n - BEFORE), 1.0)
        if x1 - x0 >= LEAST:
            piece = cut(last, before, sample, h, x0, x1)
            T, dtheta, dv, _, _, phi, s, s_r = piece
            C = t3.dcm_from_quat(q)
            u, u_r = t3.rotated(C, s), t3.rotated(C, s_r)
            if responses.by_gyro[0]:
                error_model.carry_all(responses, m, weights, piece, noise, C, u, u_r)
            u_r_sum, u_sum = t3.plus(t3.plus(u_r_sum, T, u_sum), 1.0, u_r), t3.plus(u_sum, 1.0, u)
            angle, speed = t3.plus(angle, 1.0, dtheta), t3.plus(speed, 1.0, dv)
            r = t3.plus(t3.plus(t3.plus(r, T, v), 1.0, u_r), 0.5 * T * T, g)
            v = t3.plus(t3.plus(v, 1.0, u), T, g)
            q = t3.quat_multiply(q, t3.quat_from_rotvec(phi))
        last, before = before, sample
    x[0], x[1], x[2], x[3], x[4], x[5] = r + v
    x[6], x[7], x[8], x[9] = t3.quat_normalise(q)
    return u_sum, u_r_sum, angle, speed


@inner
def sensed_packed(x, increments, n, dt_s, vibration, drive, at_s):
    """Corrected rate and specific force with packed values: means of the sample in which at_s lies.

    increments, dt_s, vibration, drive : of an ImuWindow of n samples;  at_s : s from its start
    -> (6,) rad/s, m/s^2
    """
    k = BEFORE - 1 + min(max(int(np.ceil(at_s / dt_s - 1e-6)), 1), n)
    out = correct_increments(acting(x, vibration, drive), increments[k : k + 1], dt_s)[0]
    out /= dt_s
    return out
