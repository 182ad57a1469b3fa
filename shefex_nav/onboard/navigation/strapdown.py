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
from numba import njit

from shefex_nav.environment.gravity import J2_WGS84
from shefex_nav.geometry import wgs84
from shefex_nav.onboard.navigation import triples as t3
from shefex_nav.onboard.navigation.calibration import (
    accel_inverse,
    free_increment,
    g_sensitivity,
    gyro_inverse,
    motion,
)
from shefex_nav.onboard.navigation.state import X_BA, X_GRAVITY, X_Q, X_R, X_RECTIFIED, X_V, pack

BEFORE = 2  # samples kept from before a block, for the slopes
LEAST = 1e-9  # share of a sample that is worth a step
NO_EXTRA = np.zeros((2, 3))


class ImuWindow(NamedTuple):
    """The samples of one tick, any number, and the two before them, which give the first slopes."""

    t_end_s: float
    dt_s: float
    increments: np.ndarray  # (2 + n, 6) rad and m/s, as measured
    saturated: bool
    vibration: float  # level, 0: no motor burns, 1: the strongest motor
    extra: np.ndarray = NO_EXTRA  # (2, 3) white noise of more, body axes: rad^2/s, m^2/s^3

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


def window(block, before=None, vibration=0.0, extra=NO_EXTRA):
    """ImuWindow of an ImuBlock and the window before it; at the start the first sample stands in for it.

    Samples of another duration are taken to have gone on at their rate.
    """
    increments = np.empty((BEFORE + len(block.dtheta_b), 6))
    increments[BEFORE:, :3], increments[BEFORE:, 3:] = block.dtheta_b, block.dv_b
    if before is None:
        increments[:BEFORE] = increments[BEFORE]
    else:
        increments[:BEFORE] = before.increments[-BEFORE:]
        if before.dt_s != block.dt_s:
            increments[:BEFORE] *= block.dt_s / before.dt_s
    return ImuWindow(block.t_valid_s, block.dt_s, increments, block.saturated, vibration, extra)


@njit(cache=True, forceinline=True)
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


@njit(cache=True, forceinline=True)
def _slope(last, before, sample, h):
    """Slope in the middle of a sample of what the increments integrate: parabola through three samples."""
    return t3.scaled(1.0 / (h * h), t3.plus(t3.plus(t3.scaled(1.5, sample), -2.0, before), 0.5, last))


@njit(cache=True, forceinline=True)
def move(r, v, q, C, T, phi, s, s_r, g):
    """Position, velocity and attitude at the end of a part that starts with the attitude C (of q)."""
    r = t3.plus(t3.plus(t3.plus(r, T, v), 1.0, t3.turned(C, s_r)), 0.5 * T * T, g)
    v = t3.plus(t3.plus(v, 1.0, t3.turned(C, s)), T, g)
    return r, v, t3.quat_multiply(q, t3.quat_from_rotvec(phi))


@njit(cache=True, forceinline=True)
def gravity_i(r, angle, C_iq, C_re):
    """Gravitation with J2 at r, inertial axes, the Earth turned by an angle. -> m/s^2

    As `environment.gravity.gravity_j2_e`, which needs of the Earth's attitude its axis alone.
    """
    c, s = np.cos(angle), np.sin(angle)
    pole = c * C_re[0, 2] - s * C_re[1, 2], s * C_re[0, 2] + c * C_re[1, 2], C_re[2, 2]
    pole = t3.turned(t3.matrix(C_iq), pole)
    r2, z = t3.dot(r, r), t3.dot(r, pole)
    k = 1.5 * J2_WGS84 * wgs84.A**2 / r2
    pull = -wgs84.GM / (r2 * np.sqrt(r2))
    return t3.plus(t3.scaled(pull * (1.0 + k * (1.0 - 5.0 * z * z / r2)), r), 2.0 * pull * k * z, pole)


@njit(cache=True)
def shaken(x, vibration):
    """The packed values with the accelerometer bias as it is under a level of vibration. (93,), float"""
    out = x.copy()
    for i in range(3):
        out[X_BA + i] += vibration**2 * x[X_RECTIFIED + i]
    return out


@njit(cache=True)
def integrate_packed(x, increments, h, begin_s, end_s, g):
    """`integrate` with packed values and g as three numbers. -> (10,) r_i, v_i, q_ib"""
    M, A, G = gyro_inverse(x), accel_inverse(x), g_sensitivity(x)
    r, v = t3.vector(x, X_R.start), t3.vector(x, X_V.start)
    k = X_Q.start
    q = x[k], x[k + 1], x[k + 2], x[k + 3]
    last = free_increment(x, M, A, G, increments, 0, h)
    before = free_increment(x, M, A, G, increments, 1, h)
    for n in range(BEFORE, increments.shape[0]):
        sample = free_increment(x, M, A, G, increments, n, h)
        x0, x1 = max(begin_s / h - (n - BEFORE), 0.0), min(end_s / h - (n - BEFORE), 1.0)
        if x1 - x0 >= LEAST:
            T, _, _, _, _, phi, s, s_r = cut(last, before, sample, h, x0, x1)
            r, v, q = move(r, v, q, t3.dcm_from_quat(q), T, phi, s, s_r, g)
        last, before = before, sample
    q = t3.quat_normalise(q)
    out = np.empty(10)
    out[0], out[1], out[2] = r
    out[3], out[4], out[5] = v
    out[6], out[7], out[8], out[9] = q
    return out


@njit(cache=True)
def propagate_packed(x, t_s, increments, h, begin_s, end_s, C_iq, C_re, angle_0, rate):
    """`propagate` with packed values and the fields of EarthRotation. -> (10,) r_i, v_i, q_ib"""
    half_s = 0.5 * (end_s - begin_s)
    middle = t3.plus(t3.vector(x, X_R.start), half_s, t3.vector(x, X_V.start))
    g = gravity_i(middle, angle_0 + rate * (t_s + half_s), C_iq, C_re)
    g = t3.plus(g, 1.0, t3.vector(x, X_GRAVITY))
    return integrate_packed(x, increments, h, begin_s, end_s, g)


def integrate(state, imu, begin_s, end_s, g_i):
    """Carry the state from begin_s to end_s, counted from the start of the window, under the gravitation g_i.

    Parameters
    ----------
    state : NavState at begin_s
    imu : ImuWindow
    begin_s, end_s : within 0 ... imu.length_s
    g_i : (3,) m/s^2, taken as constant: give the value in the middle of the interval

    Returns
    -------
    r_i, v_i, q_ib : at end_s
    """
    x = shaken(pack(state), imu.vibration)
    moved = integrate_packed(x, imu.increments, imu.dt_s, begin_s, end_s, tuple(g_i))
    return moved[:3], moved[3:6], moved[6:]


def propagate(state, imu, begin_s, end_s, earth):
    """`integrate` under the on-board gravity model (J2), evaluated in the middle of the interval."""
    x = shaken(pack(state), imu.vibration)
    moved = propagate_packed(x, state.t_s, imu.increments, imu.dt_s, begin_s, end_s, *earth)
    return moved[:3], moved[3:6], moved[6:]


def felt(state, imu, at_s):
    """Corrected rate and specific force: means of the sample in which at_s lies.

    NavState, ImuWindow, s from the start of the window -> omega_ib_b (3,) rad/s, f_b (3,) m/s^2
    """
    k = min(max(int(np.ceil(at_s / imu.dt_s - 1e-6)), 1), imu.n)
    return motion(state, imu.increments[BEFORE + k - 1], imu.dt_s)


def rate(state, imu, at_s):
    """omega_ib_b corrected for the estimated errors: mean of the sample in which at_s lies, (3,) rad/s."""
    return felt(state, imu, at_s)[0]
