"""Prediction: nominal state and covariance over ticks and parts of them, each in one compiled call.

    x <- strapdown(x),   P <- Phi P Phi^T + Q

Of Phi only the rows of position, velocity and attitude, the clock and the range errors of the receiver
differ from the identity, and only the errors of the IMU drive the first nine: the products run over those.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.onboard.navigation import error_model
from shefex_nav.onboard.navigation import triples as t3
from shefex_nav.onboard.navigation.calibration import (
    accel_inverse,
    free_increment,
    g_sensitivity,
    gyro_inverse,
)
from shefex_nav.onboard.navigation.error_model import FIELD_TIME_S, WEIGHTS
from shefex_nav.onboard.navigation.state import (
    BA,
    BG,
    CLOCK,
    GRAVITY,
    N_CORE,
    OPTIONAL,
    PVA,
    RANGE_BIAS,
    X_CLOCK,
    X_GRAVITY,
    X_Q,
    X_R,
    X_RANGE,
    X_V,
    pack,
)
from shefex_nav.onboard.navigation.strapdown import BEFORE, LEAST, cut, gravity_i, move, shaken

SIZES = np.array(list(OPTIONAL.values()))
TOP = PVA.stop  # rows of Phi that the strapdown makes


class Growth(NamedTuple):
    """How the errors went over an interval."""

    Phi: np.ndarray  # (n, n)
    Q: np.ndarray  # (n, n)


def growth(layout, model, state, imu, begin_s, end_s, earth):
    """Transition matrix and process noise of the part begin_s ... end_s of a tick.

    Parameters
    ----------
    layout : Layout
    model : `error_model.record`
    state : NavState at begin_s
    imu : ImuWindow
    begin_s, end_s : s from the start of the window
    earth : EarthRotation

    Returns
    -------
    Growth
    """
    arguments = (imu.increments, imu.dt_s, imu.vibration, imu.extra, begin_s, end_s)
    return Growth(*_growth(layout.at, layout.n, model, pack(state), state.t_s, *arguments, *earth))


def advance(layout, model, x, t_s, P, imu, begin_s, end_s, earth):
    """State and covariance after the part begin_s ... end_s of a tick.

    As `growth`, with the packed nominal state x at begin_s, mission time t_s, and its covariance P (n, n)
    -> x, P (n, n)
    """
    arguments = (imu.increments, imu.dt_s, imu.vibration, imu.extra, begin_s, end_s)
    after, P_after = np.empty(x.shape), np.empty(P.shape)  # to make them here costs less than to return them
    _advance(layout.at, model, x, t_s, P, *arguments, *earth, after, P_after)
    return after, P_after


def advance_ticks(layout, model, x, t_s, P, windows, earth):
    """State and covariance after each of several whole ticks, one after the other.

    As `advance`, with a list of m ImuWindow -> x (m, N), P (m, n, n)
    """
    increments = np.concatenate([imu.increments for imu in windows])
    numbers = np.array([(len(imu.increments), imu.dt_s, imu.vibration) for imu in windows])
    extra = np.concatenate([imu.extra for imu in windows])
    return _advance_ticks(layout.at, model, x, t_s, P, increments, numbers, extra, *earth)


@njit(cache=True)
def _advance_ticks(at, model, x, t_s, P, increments, numbers, extra, C_iq, C_re, angle_0, rate):
    """`advance_ticks`, all windows in one array; numbers (m, 3): rows, dt_s, vibration of each."""
    m, n, row = numbers.shape[0], P.shape[0], 0
    xs, Ps = np.empty((m, x.shape[0])), np.empty((m, n, n))
    top, Q = np.empty((TOP, n)), np.empty((TOP, TOP))
    for k in range(m):
        rows, h = int(numbers[k, 0]), numbers[k, 1]
        length_s = (rows - BEFORE) * h
        bias_walk = _interval(
            at, model[0], x, t_s, increments[row : row + rows], h, numbers[k, 2],
            extra[2 * k : 2 * k + 2], 0.0, length_s, C_iq, C_re, angle_0, rate, xs[k], top, Q,
        )  # fmt: skip
        _covariance(at, model[0], P, top, Q, bias_walk, length_s, Ps[k])
        x, P, t_s, row = xs[k], Ps[k], t_s + length_s, row + rows
    return xs, Ps


@njit(cache=True)
def _advance(
    at,
    model,
    x,
    t_s,
    P,
    increments,
    h,
    vibration,
    extra,
    begin_s,
    end_s,
    C_iq,
    C_re,
    angle_0,
    rate,
    after,
    P_after,
):
    """`advance` with the fields of its tuples; after, P_after are written."""
    n = P.shape[0]
    top, Q = np.empty((TOP, n)), np.empty((TOP, TOP))
    bias_walk = _interval(
        at, model[0], x, t_s, increments, h, vibration, extra, begin_s, end_s,
        C_iq, C_re, angle_0, rate, after, top, Q,
    )  # fmt: skip
    _covariance(at, model[0], P, top, Q, bias_walk, end_s - begin_s, P_after)


@njit(cache=True)
def _growth(
    at,
    n,
    model,
    x,
    t_s,
    increments,
    h,
    vibration,
    extra,
    begin_s,
    end_s,
    C_iq,
    C_re,
    angle_0,
    rate,
):
    """Phi and Q in full: the rows of the strapdown, and a covariance of zero carried on."""
    after, Phi, Q = np.empty(x.shape[0]), np.eye(n), np.empty((n, n))
    top, Q_top, T = np.empty((TOP, n)), np.empty((TOP, TOP)), end_s - begin_s
    bias_walk = _interval(
        at, model[0], x, t_s, increments, h, vibration, extra, begin_s, end_s,
        C_iq, C_re, angle_0, rate, after, top, Q_top,
    )  # fmt: skip
    Phi[:TOP] = top
    if at[CLOCK] >= 0:
        Phi[at[CLOCK], at[CLOCK] + 1] = T
    if at[RANGE_BIAS] >= 0:
        for i in range(at[RANGE_BIAS], at[RANGE_BIAS] + SIZES[RANGE_BIAS]):
            Phi[i, i] = np.exp(-T / model[0].range_bias_time_s)
    if at[GRAVITY] >= 0:
        for i in range(at[GRAVITY], at[GRAVITY] + 3):
            Phi[i, i] = np.exp(-T / FIELD_TIME_S)
    _covariance(at, model[0], np.zeros((n, n)), top, Q_top, bias_walk, T, Q)
    return Phi, Q


@njit(cache=True)
def _interval(
    at, model, x, t_s, increments, h, vibration, extra, begin_s, end_s,
    C_iq, C_re, angle_0, rate, after, top, Q,
):  # fmt: skip
    """Strapdown and error model of a part of a tick.

    Arguments of `advance`, the tuples in their fields. Written: after (N,) the packed state at the end;
    top (9, n) first rows of Phi; Q (9, 9) of them. -> m^2/s^5, random walk of the accelerometer bias
    """
    true, x = x, shaken(x, vibration)
    M, A, G = gyro_inverse(x), accel_inverse(x), g_sensitivity(x)
    r, v = t3.vector(x, X_R.start), t3.vector(x, X_V.start)
    q = x[X_Q.start], x[X_Q.start + 1], x[X_Q.start + 2], x[X_Q.start + 3]
    start, C_start, T = r, t3.dcm_from_quat(q), end_s - begin_s
    g = gravity_i(t3.plus(r, 0.5 * T, v), angle_0 + rate * (t_s + 0.5 * T), C_iq, C_re)
    g = t3.plus(g, 1.0, t3.vector(x, X_GRAVITY))

    gyro, accel = np.zeros((WEIGHTS, 3, 3, 3)), np.zeros((WEIGHTS, 2, 3, 3))
    by_gyro, by_accel = np.empty(WEIGHTS, np.bool_), np.empty(WEIGHTS, np.bool_)
    error_model.needed(at, G, by_gyro, by_accel)
    weights, m = np.empty(WEIGHTS), np.empty((4, 3, 3))
    u_sum = u_r_sum = angle = speed = (0.0, 0.0, 0.0)
    across_angle = 0.0
    last = free_increment(x, M, A, G, increments, 0, h)
    before = free_increment(x, M, A, G, increments, 1, h)
    for n in range(BEFORE, increments.shape[0]):
        sample = free_increment(x, M, A, G, increments, n, h)
        x0, x1 = max(begin_s / h - (n - BEFORE), 0.0), min(end_s / h - (n - BEFORE), 1.0)
        if x1 - x0 >= LEAST:
            part_s, dtheta, dv, B, b, phi, s, s_r = cut(last, before, sample, h, x0, x1)
            C = t3.dcm_from_quat(q)
            J, D, D_r, J_r = error_model.derivatives(part_s, dtheta, dv, B, b)
            t3.store(m[0], t3.product(C, J))
            t3.store(m[1], t3.product(C, D))
            t3.store(m[2], t3.product(C, D_r))
            t3.store(m[3], t3.product(C, J_r))
            u, u_r = t3.turned(C, s), t3.turned(C, s_r)
            weights[0], weights[1], weights[2], weights[3] = part_s, dtheta[0], dtheta[1], dtheta[2]
            weights[4], weights[5], weights[6] = dv
            for k in range(WEIGHTS):
                if by_gyro[k]:
                    error_model.carry(gyro, k, part_s, u, u_r, weights[k], m)
                if by_accel[k]:
                    error_model.carry_force(accel, k, part_s, weights[k], m)
            u_r_sum = t3.plus(t3.plus(u_r_sum, part_s, u_sum), 1.0, u_r)
            u_sum = t3.plus(u_sum, 1.0, u)
            angle, speed = t3.plus(angle, 1.0, dtheta), t3.plus(speed, 1.0, dv)
            across_angle += np.sqrt(dtheta[1] * dtheta[1] + dtheta[2] * dtheta[2])
            r, v, q = move(r, v, q, C, part_s, phi, s, s_r, g)
        last, before = before, sample

    q = t3.quat_normalise(q)
    after[:] = true
    after[0], after[1], after[2], after[3], after[4], after[5] = r[0], r[1], r[2], v[0], v[1], v[2]
    after[6], after[7], after[8], after[9] = q
    after[X_CLOCK] += T * x[X_CLOCK + 1]
    after[X_RANGE] *= np.exp(-T / model.range_bias_time_s)
    after[X_GRAVITY : X_GRAVITY + 3] *= np.exp(-T / FIELD_TIME_S)

    C_bi = t3.transposed(t3.dcm_from_quat(q))
    for k in range(WEIGHTS):
        if by_gyro[k]:
            t3.store(gyro[k, 2], t3.product(C_bi, t3.matrix(gyro[k, 2])))
    top[:] = 0.0
    error_model.put_motion(top, start, u_sum, u_r_sum, C_start, C_bi, T)
    error_model.put_gravity(top, at, T)
    triads = np.empty((3, 3, 3))
    t3.store(triads[0], M)
    t3.store(triads[1], A)
    t3.store(triads[2], t3.product(M, t3.product(G, A)))
    error_model.put_calibration(top, at, gyro, accel, triads[0], triads[1], triads[2])
    error_model.put_rectification(top, at, vibration)
    along, across, bias_walk = error_model.noise_densities(model, vibration, T, angle, speed, across_angle)
    error_model.process_noise(top, along, across, extra, C_start, T, Q)
    return bias_walk


@njit(cache=True)
def _covariance(at, model, P, top, Q, bias_walk, T, out):
    """Phi P Phi^T + Q, written into out (n, n), exactly symmetric.

    The clock of the receiver: white frequency noise of density a^2 and a random walk of frequency of
    density b^2 give its bias a^2 T + b^2 T^3/3, its drift b^2 T, the two together b^2 T^2/2 (Brown & Hwang,
    Introduction to Random Signals and Applied Kalman Filtering, 4th ed., section 9.3).
    """
    n, drivers = P.shape[0], N_CORE
    for k in range(GRAVITY + 1):
        if at[k] >= 0:
            drivers += SIZES[k]
    A = np.zeros((TOP, n))
    for i in range(TOP):
        for k in range(drivers):
            factor = top[i, k]
            if factor != 0.0:
                for j in range(n):
                    A[i, j] += factor * P[k, j]
    for i in range(TOP):
        for j in range(i + 1):
            total = Q[i, j]
            for k in range(drivers):
                total += A[i, k] * top[j, k]
            out[i, j] = out[j, i] = total
        for j in range(TOP, n):
            out[i, j] = out[j, i] = A[i, j]
    for i in range(TOP, n):
        for j in range(TOP, n):
            out[i, j] = P[i, j]
    for i in range(3):
        out[BG.start + i, BG.start + i] += model.gyro_bias_walk**2 * T
        out[BA.start + i, BA.start + i] += bias_walk * T
    if at[CLOCK] >= 0:
        c, white, walk = at[CLOCK], model.clock_white**2, model.clock_walk**2
        for j in range(n):
            out[c, j] += T * out[c + 1, j]
        for j in range(n):
            out[j, c] += T * out[j, c + 1]
        out[c, c] += white * T + walk * T**3 / 3.0
        out[c, c + 1] += walk * T**2 / 2.0
        out[c + 1, c] = out[c, c + 1]
        out[c + 1, c + 1] += walk * T
    if at[RANGE_BIAS] >= 0:
        left = np.exp(-T / model.range_bias_time_s)
        _wander(out, at[RANGE_BIAS], SIZES[RANGE_BIAS], left, model.range_bias_sigma)
    if at[GRAVITY] >= 0:
        _wander(out, at[GRAVITY], 3, np.exp(-T / FIELD_TIME_S), model.gravity_sigma)


@njit(cache=True)
def _wander(P, first, size, left, sigma):
    """Rows and columns of a first-order Gauss-Markov process of which a part `left` is left, in place."""
    for i in range(first, first + size):
        for j in range(P.shape[0]):
            P[i, j] *= left
        for j in range(P.shape[0]):
            P[j, i] *= left
        P[i, i] += sigma**2 * (1.0 - left * left)
