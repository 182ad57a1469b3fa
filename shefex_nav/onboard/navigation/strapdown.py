"""Strapdown: IMU increments in, position, velocity and attitude out, in inertial axes.

Every 400 Hz sample is taken as a rate and a specific force that change linearly, so that a sample may be cut
anywhere (measurements between samples). Coning and sculling compensation after Savage, JGCD 21 (1998),
parts 1 and 2. The slopes in the middle of a sample come from the parabola through it and the two before;
the usual difference of two samples is the slope half a sample earlier, which under spin at a rate w leaves a
share w dt/2 of the coning undone, always with the same sign in inertial axes.

For a piece of duration T with rate A + B tau and specific force a + b tau::

    phi = dtheta + T^3/12 A x B                                                   coning
    s   = J(dtheta) dv + T^3/12 (A x b + a x B),   J = 1/T int exp(skew(A tau)) dtau    rotation, sculling
    s_r = T/2 dv - T^3/12 b + T/6 dtheta x dv                                     the same for position

    q <- q exp(phi),   v <- v + C_ib s + g T,   r <- r + v T + C_ib s_r + g T^2/2
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.gravity import gravity_j2_e
from shefex_nav.geometry import frames, rotation

SAMPLES = 4  # in one ImuBlock
BEFORE = 2  # samples kept from the block before it, for the slopes
ROWS = BEFORE + SAMPLES


class ImuWindow(NamedTuple):
    """The samples of one tick, the last four rows, and the two before them, which give the first slopes."""

    t_end_s: float
    dt_s: float
    dtheta_b: np.ndarray  # (6, 3) rad
    dv_b: np.ndarray  # (6, 3) m/s
    saturated: bool
    vibration: float  # level, 0: no motor burns, 1: the first motor


class Pieces(NamedTuple):
    """What an interval passed through, for the error model: n pieces of samples, corrected increments."""

    n: int
    dt_s: np.ndarray  # (4,) the first n are used, here and below
    C_ib: np.ndarray  # (4, 3, 3) attitude at the start of the piece
    dtheta_b: np.ndarray  # (4, 3) rad
    dv_b: np.ndarray  # (4, 3) m/s
    s_b: np.ndarray  # (4, 3) m/s, velocity gained, in the axes at the start of the piece
    s_r_b: np.ndarray  # (4, 3) m, distance gained by it
    B_b: np.ndarray  # (4, 3) rad/s^2, slope of the rate
    b_b: np.ndarray  # (4, 3) m/s^3, slope of the specific force


def window(block, before=None, vibration=0.0):
    """ImuWindow of an ImuBlock and the window before it; at the start the first sample stands in for it."""
    dtheta_b, dv_b = np.empty((ROWS, 3)), np.empty((ROWS, 3))
    dtheta_b[BEFORE:], dv_b[BEFORE:] = block.dtheta_b, block.dv_b
    dtheta_b[:BEFORE] = block.dtheta_b[0] if before is None else before.dtheta_b[SAMPLES:]
    dv_b[:BEFORE] = block.dv_b[0] if before is None else before.dv_b[SAMPLES:]
    return ImuWindow(block.t_valid_s, block.dt_s, dtheta_b, dv_b, block.saturated, vibration)


@njit(cache=True)
def corrected(state, imu):
    """Increments free of the estimated sensor errors: (6, 3) rad, (6, 3) m/s.

    measured = (I + k e_x^T) omega + bias, k the roll column; solved for omega.
    """
    k = state.gyro_roll_column
    dtheta_b = imu.dtheta_b - state.gyro_bias * imu.dt_s
    for n in range(ROWS):
        roll = dtheta_b[n, 0] / (1.0 + k[0])
        dtheta_b[n, 0] = roll
        dtheta_b[n, 1] -= k[1] * roll
        dtheta_b[n, 2] -= k[2] * roll
    return dtheta_b, imu.dv_b - state.accel_bias * imu.dt_s


@njit(cache=True)
def turned(dtheta, dv):
    """J(dtheta) dv, series to the fourth order: enough for 0.1 rad in a sample."""
    t2 = dtheta[0] ** 2 + dtheta[1] ** 2 + dtheta[2] ** 2
    first = rotation.cross(dtheta, dv)
    return dv + (0.5 - t2 / 24.0) * first + (1.0 / 6.0 - t2 / 120.0) * rotation.cross(dtheta, first)


@njit(cache=True)
def _no_pieces():
    """Room for the pieces of one tick."""
    v = np.zeros((6, SAMPLES, 3))
    return Pieces(0, np.zeros(SAMPLES), np.zeros((SAMPLES, 3, 3)), v[0], v[1], v[2], v[3], v[4], v[5])


@njit(cache=True)
def _count(p, n):
    """The same pieces, n of them in use."""
    return Pieces(n, p.dt_s, p.C_ib, p.dtheta_b, p.dv_b, p.s_b, p.s_r_b, p.B_b, p.b_b)


@njit(cache=True)
def integrate(state, imu, begin_s, end_s, g_i):
    """Carry the state from begin_s to end_s, counted from the start of the window, under the gravitation g_i.

    Parameters
    ----------
    state : NavState at begin_s
    imu : ImuWindow
    begin_s, end_s : within 0 ... 4 dt_s
    g_i : (3,) m/s^2, taken as constant: give the value in the middle of the interval

    Returns
    -------
    r_i, v_i, q_ib : at end_s
    pieces : Pieces
    """
    h = imu.dt_s
    dtheta_b, dv_b = corrected(state, imu)
    r, v, q = state.r_i.copy(), state.v_i.copy(), state.q_ib.copy()
    pieces = _no_pieces()
    n = 0
    for k in range(BEFORE, ROWS):
        x0, x1 = max(begin_s / h - (k - BEFORE), 0.0), min(end_s / h - (k - BEFORE), 1.0)
        if x1 - x0 < 1e-9:
            continue
        T = (x1 - x0) * h
        B = (1.5 * dtheta_b[k] - 2.0 * dtheta_b[k - 1] + 0.5 * dtheta_b[k - 2]) / h**2
        b = (1.5 * dv_b[k] - 2.0 * dv_b[k - 1] + 0.5 * dv_b[k - 2]) / h**2
        A, a = dtheta_b[k] / h, dv_b[k] / h  # means of the sample: A x B is the same at every instant
        skewness = 0.5 * (x0 + x1 - 1.0) * h * T
        dtheta, dv = A * T + B * skewness, a * T + b * skewness
        phi = dtheta + T**3 / 12.0 * rotation.cross(A, B)
        s = turned(dtheta, dv) + T**3 / 12.0 * (rotation.cross(A, b) + rotation.cross(a, B))
        s_r = T / 2.0 * dv - T**3 / 12.0 * b + T / 6.0 * rotation.cross(dtheta, dv)
        pieces.dt_s[n], pieces.dtheta_b[n], pieces.dv_b[n] = T, dtheta, dv
        pieces.s_b[n], pieces.s_r_b[n], pieces.B_b[n], pieces.b_b[n] = s, s_r, B, b
        pieces.C_ib[n] = rotation.dcm_from_quat(q)
        r = r + v * T + rotation.quat_rotate(q, s_r) + (0.5 * T * T) * g_i
        v = v + rotation.quat_rotate(q, s) + T * g_i
        q = rotation.quat_multiply(q, rotation.quat_from_rotvec(phi))
        n += 1
    return r, v, rotation.quat_normalise(q), _count(pieces, n)


@njit(cache=True)
def propagate(state, imu, begin_s, end_s, earth):
    """`integrate` under the on-board gravity model (J2), evaluated in the middle of the interval."""
    half_s = 0.5 * (end_s - begin_s)
    C_ie = frames.dcm_ie(earth, state.t_s + half_s)
    g_i = C_ie @ gravity_j2_e(C_ie.T @ (state.r_i + half_s * state.v_i))
    return integrate(state, imu, begin_s, end_s, g_i)


@njit(cache=True)
def rate(state, imu, at_s):
    """omega_ib_b corrected for the estimated errors: mean of the sample in which at_s lies, (3,) rad/s."""
    k = min(max(int(np.ceil(at_s / imu.dt_s - 1e-6)), 1), SAMPLES)
    return corrected(state, imu)[0][BEFORE - 1 + k] / imu.dt_s
