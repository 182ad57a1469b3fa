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
it. The helpers are inlined by force: handing arrays to a function costs more than three sums.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.gravity import gravity_j2_e
from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation.calibration import correct_increments, motion
from shefex_nav.onboard.navigation.state import X_Q, X_R, X_V, pack

BEFORE = 2  # samples kept from before a block, for the slopes
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


class Pieces(NamedTuple):
    """What an interval passed through, for the error model: n pieces of samples, corrected increments."""

    n: int
    dt_s: np.ndarray  # (N,) the first n are used, here and below
    C_ib: np.ndarray  # (N, 3, 3) attitude at the start of the piece
    dtheta_b: np.ndarray  # (N, 3) rad
    dv_b: np.ndarray  # (N, 3) m/s
    s_b: np.ndarray  # (N, 3) m/s, velocity gained, in the axes at the start of the piece
    s_r_b: np.ndarray  # (N, 3) m, distance gained by it
    B_b: np.ndarray  # (N, 3) rad/s^2, slope of the rate
    b_b: np.ndarray  # (N, 3) m/s^3, slope of the specific force


def window(block, before=None, vibration=0.0):
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
    return ImuWindow(block.t_valid_s, block.dt_s, increments, block.saturated, vibration)


@njit(cache=True, forceinline=True)
def _add_cross(out, factor, u, v):
    """out += factor u x v, in place: the loops below make no arrays, which would cost more than the sums."""
    out[0] += factor * (u[1] * v[2] - u[2] * v[1])
    out[1] += factor * (u[2] * v[0] - u[0] * v[2])
    out[2] += factor * (u[0] * v[1] - u[1] * v[0])


@njit(cache=True, forceinline=True)
def _room_for_pieces(most):
    """Pieces without content."""
    v = np.empty((6, most, 3))
    return Pieces(0, np.empty(most), np.empty((most, 3, 3)), v[0], v[1], v[2], v[3], v[4], v[5])


@njit(cache=True, forceinline=True)
def _count(p, n):
    """The same pieces, n of them in use."""
    return Pieces(n, p.dt_s, p.C_ib, p.dtheta_b, p.dv_b, p.s_b, p.s_r_b, p.B_b, p.b_b)


@njit(cache=True, forceinline=True)
def _cut(dtheta_b, dv_b, k, h, x0, x1, pieces, n):
    """Part x0 ... x1 (0 ... 1) of sample k becomes piece n. -> phi (3,) rad, the rotation in it

    dtheta_b, dv_b : (N, 3) rad, m/s, corrected increments;  h : s, duration of a sample
    """
    T = (x1 - x0) * h
    off_centre = 0.5 * (x0 + x1 - 1.0) * h * T
    T3 = T * T * T / 12.0
    A, a, phi = np.empty(3), np.empty(3), np.empty(3)  # A, a: means of the sample
    dtheta, dv, s, s_r = pieces.dtheta_b[n], pieces.dv_b[n], pieces.s_b[n], pieces.s_r_b[n]
    B, b = pieces.B_b[n], pieces.b_b[n]
    for j in range(3):
        B[j] = (1.5 * dtheta_b[k, j] - 2.0 * dtheta_b[k - 1, j] + 0.5 * dtheta_b[k - 2, j]) / (h * h)
        b[j] = (1.5 * dv_b[k, j] - 2.0 * dv_b[k - 1, j] + 0.5 * dv_b[k - 2, j]) / (h * h)
        A[j], a[j] = dtheta_b[k, j] / h, dv_b[k, j] / h
        dtheta[j], dv[j] = A[j] * T + B[j] * off_centre, a[j] * T + b[j] * off_centre
        phi[j], s[j], s_r[j] = dtheta[j], dv[j], T / 2.0 * dv[j] - T3 * b[j]
    _add_cross(phi, T3, A, B)  # A x B is the same at every instant of the sample
    # J(dtheta) dv as a series to the fourth order: enough for 0.1 rad in a sample
    t2 = dtheta[0] * dtheta[0] + dtheta[1] * dtheta[1] + dtheta[2] * dtheta[2]
    turn = rotation.cross(dtheta, dv)
    for j in range(3):
        s[j] += (0.5 - t2 / 24.0) * turn[j]
        s_r[j] += T / 6.0 * turn[j]
    _add_cross(s, 1.0 / 6.0 - t2 / 120.0, dtheta, turn)
    _add_cross(s, T3, A, b)
    _add_cross(s, T3, a, B)
    pieces.dt_s[n] = T
    return phi


@njit(cache=True)
def integrate_packed(x, increments, dt_s, begin_s, end_s, g_i):
    """`integrate` with packed values. -> (10,) r_i, v_i, q_ib; Pieces"""
    h = dt_s
    free = correct_increments(x, increments, h)
    dtheta_b, dv_b = free[:, :3], free[:, 3:]
    moved = np.empty(10)
    r, v = moved[:3], moved[3:6]
    r[:], v[:], q = x[X_R], x[X_V], x[X_Q]
    pieces = _room_for_pieces(increments.shape[0] - BEFORE)
    n = 0
    for k in range(BEFORE, increments.shape[0]):
        x0, x1 = max(begin_s / h - (k - BEFORE), 0.0), min(end_s / h - (k - BEFORE), 1.0)
        if x1 - x0 < 1e-9:
            continue
        phi = _cut(dtheta_b, dv_b, k, h, x0, x1, pieces, n)
        T, s, s_r = pieces.dt_s[n], pieces.s_b[n], pieces.s_r_b[n]
        C = rotation.dcm_from_quat(q)
        pieces.C_ib[n] = C
        for i in range(3):
            r[i] += T * v[i] + C[i, 0] * s_r[0] + C[i, 1] * s_r[1] + C[i, 2] * s_r[2] + 0.5 * T * T * g_i[i]
            v[i] += C[i, 0] * s[0] + C[i, 1] * s[1] + C[i, 2] * s[2] + T * g_i[i]
        q = rotation.quat_multiply(q, rotation.quat_from_rotvec(phi))
        n += 1
    moved[6:] = rotation.quat_normalise(q)
    return moved, _count(pieces, n)


@njit(cache=True)
def propagate_packed(x, t_s, increments, dt_s, begin_s, end_s, C_iq, C_re, angle_0, rate):
    """`propagate` with packed values and the fields of EarthRotation. -> (10,) r_i, v_i, q_ib; Pieces"""
    half_s = 0.5 * (end_s - begin_s)
    C_ie = frames.dcm_ie(frames.EarthRotation(C_iq, C_re, angle_0, rate), t_s + half_s)
    g_i = C_ie @ gravity_j2_e(C_ie.T @ (x[X_R] + half_s * x[X_V]))
    return integrate_packed(x, increments, dt_s, begin_s, end_s, g_i)


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
    pieces : Pieces
    """
    moved, pieces = integrate_packed(pack(state), imu.increments, imu.dt_s, begin_s, end_s, g_i)
    return moved[:3], moved[3:6], moved[6:], pieces


def propagate(state, imu, begin_s, end_s, earth):
    """`integrate` under the on-board gravity model (J2), evaluated in the middle of the interval."""
    moved, pieces = propagate_packed(pack(state), state.t_s, imu.increments, imu.dt_s, begin_s, end_s, *earth)
    return moved[:3], moved[3:6], moved[6:], pieces


def felt(state, imu, at_s):
    """Corrected rate and specific force: means of the sample in which at_s lies.

    NavState, ImuWindow, s from the start of the window -> omega_ib_b (3,) rad/s, f_b (3,) m/s^2
    """
    k = min(max(int(np.ceil(at_s / imu.dt_s - 1e-6)), 1), imu.n)
    return motion(state, imu.increments[BEFORE + k - 1], imu.dt_s)


def rate(state, imu, at_s):
    """omega_ib_b corrected for the estimated errors: mean of the sample in which at_s lies, (3,) rad/s."""
    return felt(state, imu, at_s)[0]
