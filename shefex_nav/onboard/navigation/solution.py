"""What the filter tells the vehicle: NavSolution at every tick, with sigmas by linear propagation of P.

Air-relative velocity is that of an atmosphere which turns with the Earth, without wind.
"""

from math import pi

import numpy as np
from numba import njit

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import integrity_protection, integrity_watch
from shefex_nav.onboard.navigation.calibration import correct_increments, jacobians_packed
from shefex_nav.onboard.navigation.state import ATT, BA, BG, OPTIONAL, POS, PVA, VEL, X_Q, X_R, X_V
from shefex_nav.records import Doubt, NavCovariance, NavSolution

SLOWEST = 1e-3  # m/s, below it the angles of the velocity have no meaning; their sigma is pi


def solution(nav):
    """NavSolution of the last tick of a running filter."""
    tick, model = nav.history[-1], nav.params.imu
    P = reported(nav)
    vectors, angles, sigmas = derive(
        nav.layout, tick, P, model.gyro_random_walk, model.gyro_quantum, nav.earth
    )
    x = tick.x
    r_e, v_e, omega_ib_b, *vector_sigmas = vectors
    # by position, in the order of the record: nineteen keywords would cost more than the arithmetic
    return NavSolution(
        *(tick.t_s, x[X_R], x[X_V], x[X_Q], omega_ib_b, r_e, v_e),
        *angles,
        *vector_sigmas,
        *sigmas,
        nav.health["star_tracker"].used > 0,
        *_trust(nav, vector_sigmas[2]),
    )


def _trust(nav, sigma_b):
    """Protection level of the attitude (3,) rad, whether not to use the solution, and the Doubt."""
    watch = nav.watch
    wanted = watch.params.wanted
    protection_b = integrity_protection.of_attitude(watch.level, wanted, sigma_b)
    contradicted = integrity_watch.contradicted(nav.health)
    doubt = integrity_protection.doubt(protection_b, wanted, contradicted, watch.imu_blind)
    return protection_b, doubt != Doubt.NONE, int(doubt)


def reported(nav):
    """Covariance of the errors of the solution, (n, n).

    While a motor burns, the sensors swing with the vibration and the strapdown follows them. Nothing of it
    stays, so the filter does not count it as an error that grows, but the solution of the moment contains it.
    """
    tick, model = nav.history[-1], nav.params.imu
    if tick.imu is None or tick.imu.vibration == 0.0:
        return tick.P
    P = tick.P.copy()
    variances = P.ravel()[:: len(P) + 1]  # a view of the diagonal
    variances[VEL] += (tick.imu.vibration * model.accel_vibration) ** 2
    variances[ATT] += (tick.imu.vibration * model.gyro_vibration) ** 2
    return P


def covariance(nav):
    """NavCovariance of the last tick."""
    state, P, layout = nav.history[-1].state, reported(nav), nav.layout
    variances = np.diag(P).copy()
    variances[BA] += nav.params.imu.gravity**2  # which the estimate of the bias contains
    sigma = np.sqrt(variances)

    def of(name):
        place = layout.places[name]
        return np.full(OPTIONAL[name], np.nan) if place is None else sigma[place]

    return NavCovariance(
        state.t_s,
        P[PVA, PVA].copy(),
        state.gyro_bias,
        state.accel_bias,
        state.gyro_roll_column,
        state.mounting,
        np.concatenate([sigma[BG], sigma[BA], of("gyro_roll_column"), of("mounting")]),
        " ".join(layout.names),
        np.concatenate([np.empty(0), *(getattr(state, name) for name in layout.names)]),
        sigma[BA.stop :],
    )


@njit(cache=True)
def _variance(g, P):
    """g^T P g: variance of a scalar with gradient g. (n,), (n, n)."""
    total = 0.0
    for i in range(g.shape[0]):
        for j in range(g.shape[0]):
            total += g[i] * P[i, j] * g[j]
    return max(total, 0.0)


def derive(layout, tick, P, random_walk, quantum, earth):
    """Quantities derived from the state, and their sigmas.

    Parameters
    ----------
    layout : Layout
    tick : fusion.Tick
    P : (n, n)
    random_walk, quantum : rad/sqrt(s), rad, of the gyros
    earth : EarthRotation

    Returns
    -------
    vectors : (7, 3) r_e [m], v_e [m/s], omega_ib_b [rad/s], mean of the last sample, and the sigmas of
        r_e, v_e, attitude in b [rad], rate [rad/s]
    angles : flight-path angle, heading, angle of attack, sideslip [rad]
    sigmas : of the first, third and fourth [rad], pi at most
    """
    imu = tick.imu
    return _derive(
        layout.at, tick.t_s, tick.x, P, imu.increments[-1:], imu.dt_s, random_walk, quantum, *earth
    )


@njit(cache=True)
def _derive(at, t_s, x, P, sample, dt_s, random_walk, quantum, C_iq, C_re, angle_0, rate):
    """`derive` with the fields of its tuples; sample (1, 6): the last increments."""
    earth = frames.EarthRotation(C_iq, C_re, angle_0, rate)
    r_i, v_i, q_ib = x[X_R], x[X_V], x[X_Q]
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, t_s).T)
    C_bi = np.ascontiguousarray(rotation.dcm_from_quat(q_ib).T)
    omega_ie_i = frames.omega_ie_i(earth)
    u_i = v_i - rotation.cross(omega_ie_i, r_i)
    r_e, v_e, v_b = C_ei @ r_i, C_ei @ u_i, C_bi @ u_i
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
    felt = correct_increments(x, sample, dt_s)[0] / dt_s
    vectors[2] = felt[:3]
    J_omega, _ = jacobians_packed(at, P.shape[0], x, felt[:3], felt[3:])
    # of one increment: white noise, and rounding to whole quanta at both of its ends (variance q^2/12 each)
    rate_noise = (random_walk**2 * dt_s + quantum**2 / 6.0) / dt_s**2
    g = np.zeros(6)
    for k in range(3):
        vectors[3, k] = np.sqrt(_variance(C_ei[k], P[POS, POS]))
        g[VEL] = C_ei[k]
        g[POS] = rotation.cross(omega_ie_i, C_ei[k])
        vectors[4, k] = np.sqrt(_variance(g, P))
        vectors[5, k] = np.sqrt(P[ATT.start + k, ATT.start + k])
        vectors[6, k] = np.sqrt(_variance(J_omega[k, ATT.stop :], P[ATT.stop :, ATT.stop :]) + rate_noise)
    return vectors, (path, heading, attack_angle, slip_angle), (sigmas[0], sigmas[1], sigmas[2])
