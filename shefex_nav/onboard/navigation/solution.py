"""What the filter tells the vehicle: NavSolution at every tick, with sigmas by linear propagation of P.

Air-relative velocity is that of an atmosphere which turns with the Earth, without wind.
"""

from math import pi

import numpy as np
from numba import njit

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import strapdown
from shefex_nav.onboard.navigation.state import ATT, BA, BG, N_ERROR, POS, PVA, ROLL, VEL, NavState
from shefex_nav.onboard.navigation.strapdown import ImuWindow
from shefex_nav.records import NavCovariance, NavSolution

SLOWEST = 1e-3  # m/s, below it the angles of the velocity have no meaning; their sigma is pi


def solution(nav):
    """NavSolution of the last tick of a running filter."""
    tick = nav.history[-1]
    state = tick.state
    model = nav.params.imu
    vectors, angles, sigmas = derive(
        state, reported(nav), tick.imu, model.gyro_random_walk, model.gyro_quantum, nav.earth
    )
    r_e, v_e, omega_ib_b, *vector_sigmas = vectors
    # by position, in the order of the record: nineteen keywords would cost more than the arithmetic
    return NavSolution(
        *(state.t_s, state.r_i, state.v_i, state.q_ib, omega_ib_b, r_e, v_e),
        *angles,
        *vector_sigmas,
        *sigmas,
        nav.health["star_tracker"].used > 0,
    )


def reported(nav):
    """Covariance of the errors of the solution, (21, 21).

    While a motor burns, the sensors swing with the vibration and the strapdown follows them. Nothing of it
    stays, so the filter does not count it as an error that grows, but the solution of the moment contains it.
    """
    tick, model = nav.history[-1], nav.params.imu
    if tick.imu is None or tick.imu.vibration == 0.0:
        return tick.P
    P = tick.P.copy()
    variances = P.ravel()[:: N_ERROR + 1]  # a view of the diagonal
    variances[VEL] += (tick.imu.vibration * model.accel_vibration) ** 2
    variances[ATT] += (tick.imu.vibration * model.gyro_vibration) ** 2
    return P


def covariance(nav):
    """NavCovariance of the last tick."""
    state, P = nav.history[-1].state, reported(nav)
    variances = np.diag(P).copy()
    variances[BA] += nav.params.imu.gravity**2  # which the estimate of the bias contains
    return NavCovariance(
        state.t_s,
        P[PVA, PVA].copy(),
        state.gyro_bias,
        state.accel_bias,
        state.gyro_roll_column,
        state.mounting,
        np.sqrt(variances[PVA.stop :]),
    )


@njit(cache=True)
def _variance(g, P):
    """g^T P g: variance of a scalar with gradient g. (n,), (n, n)."""
    total = 0.0
    for i in range(g.shape[0]):
        for j in range(g.shape[0]):
            total += g[i] * P[i, j] * g[j]
    return max(total, 0.0)


def derive(state, P, imu, random_walk, quantum, earth):
    """Quantities derived from the state, and their sigmas.

    Parameters
    ----------
    state : NavState
    P : (21, 21)
    imu : ImuWindow that ends at the state
    random_walk, quantum : rad/sqrt(s), rad, of the gyros
    earth : EarthRotation

    Returns
    -------
    vectors : (7, 3) r_e [m], v_e [m/s], omega_ib_b [rad/s], mean of the last sample, and the sigmas of
        r_e, v_e, attitude in b [rad], rate [rad/s]
    angles : flight-path angle, heading, angle of attack, sideslip [rad]
    sigmas : of the first, third and fourth [rad], pi at most
    """
    # tuples are taken apart here: as arguments of a kernel they would cost as much as all that it does
    return _derive(*state, *imu, *earth, P, random_walk, quantum)


@njit(cache=True)
def _derive(
    t_s, r_i, v_i, q_ib, gyro_bias, accel_bias, gyro_roll_column, mounting,  # NavState
    t_end_s, dt_s, dtheta_b, dv_b, dtheta_before_b, dv_before_b, saturated, vibration,  # ImuWindow
    C_iq, C_re, angle_0, rate,  # EarthRotation
    P, random_walk, quantum,
):  # fmt: skip
    """`derive` with the fields of its tuples."""
    state = NavState(t_s, r_i, v_i, q_ib, gyro_bias, accel_bias, gyro_roll_column, mounting)
    imu = ImuWindow(t_end_s, dt_s, dtheta_b, dv_b, dtheta_before_b, dv_before_b, saturated, vibration)
    earth = frames.EarthRotation(C_iq, C_re, angle_0, rate)
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, state.t_s).T)
    C_bi = np.ascontiguousarray(rotation.dcm_from_quat(state.q_ib).T)
    omega_ie_i = frames.omega_ie_i(earth)
    u_i = state.v_i - rotation.cross(omega_ie_i, state.r_i)
    r_e, v_e, v_b = C_ei @ state.r_i, C_ei @ u_i, C_bi @ u_i
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    C_en = wgs84.dcm_en(latitude, longitude)
    v_n = np.ascontiguousarray(C_en.T) @ v_e
    speed = max(np.sqrt((u_i**2).sum()), SLOWEST)
    level = max(np.sqrt(v_n[0] ** 2 + v_n[1] ** 2), SLOWEST)
    pitch_plane = max(np.sqrt(v_b[0] ** 2 + v_b[2] ** 2), SLOWEST)
    path = np.arctan2(-v_n[2], np.sqrt(v_n[0] ** 2 + v_n[1] ** 2))
    heading = np.arctan2(v_n[1], v_n[0])
    attack_angle = np.arctan2(v_b[2], v_b[0])
    slip_angle = np.arctan2(v_b[1], np.sqrt(v_b[0] ** 2 + v_b[2] ** 2))

    # gradients of the angles with respect to the velocity in n or b, with |v|^2 in the denominator
    up = np.array([v_n[0] * v_n[2] / level, v_n[1] * v_n[2] / level, -level]) / speed**2
    attack = np.array([-np.sin(attack_angle), 0.0, np.cos(attack_angle)]) / pitch_plane
    slip = np.array([-v_b[0] * v_b[1] / pitch_plane, pitch_plane, -v_b[2] * v_b[1] / pitch_plane]) / speed**2
    path_i = np.ascontiguousarray(C_ei.T) @ (C_en @ up)
    g, sigmas = np.zeros(9), np.empty(3)
    for k, u, dv_i in ((0, np.zeros(3), path_i), (1, attack, attack @ C_bi), (2, slip, slip @ C_bi)):
        g[VEL] = dv_i
        g[POS] = rotation.cross(omega_ie_i, dv_i)  # dv_i . (-omega x dr) = (omega x dv_i) . dr
        g[ATT] = rotation.cross(u, v_b)  # u . (v_b x dtheta) = (u x v_b) . dtheta
        sigmas[k] = min(pi, np.sqrt(_variance(g, P)))

    vectors = np.empty((7, 3))
    vectors[0], vectors[1] = r_e, v_e
    vectors[2] = strapdown.rate(state, imu, strapdown.SAMPLES * imu.dt_s)
    roll_rate = vectors[2, 0]
    # of one increment: white noise, and rounding to whole quanta at both of its ends (variance q^2/12 each)
    rate_noise = (random_walk**2 * imu.dt_s + quantum**2 / 6.0) / imu.dt_s**2
    g = np.zeros(6)
    for k in range(3):
        vectors[3, k] = np.sqrt(_variance(C_ei[k], P[POS, POS]))
        g[VEL] = C_ei[k]
        g[POS] = rotation.cross(omega_ie_i, C_ei[k])
        vectors[4, k] = np.sqrt(_variance(g, P))
        vectors[5, k] = np.sqrt(P[ATT.start + k, ATT.start + k])
        b, c = BG.start + k, ROLL.start + k
        rate2 = P[b, b] + 2.0 * roll_rate * P[b, c] + roll_rate**2 * P[c, c]
        vectors[6, k] = np.sqrt(rate2 + rate_noise)
    return vectors, (path, heading, attack_angle, slip_angle), (sigmas[0], sigmas[1], sigmas[2])
