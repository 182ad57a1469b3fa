"""What the sensors say about the errors: each function linearises one measurement about the nominal state.

z = H dx + noise, noise ~ N(0, R), dx in the order of a `state.Layout`. Frames and units with each function.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.gravity import gravity_j2_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import calibration
from shefex_nav.onboard.navigation.state import ATT, POS, VEL, right_jacobian


class Antenna(NamedTuple):
    """Motion of the GPS antenna against the rotating Earth, frame e, and its Jacobians of the errors."""

    r_e: np.ndarray  # (3,) m
    v_e: np.ndarray  # (3,) m/s
    J_r: np.ndarray  # (3, n) d r_e / dx
    J_v: np.ndarray  # (3, n)


def antenna(layout, state, earth, l_ba_b, omega_ib_b, f_b):
    """Where the GPS antenna is at the instant that a fix with the time of the state belongs to.

    r_ea_e = C_ei (r_i + C_ib l),   v_ea_e = C_ei (v_i + C_ib (omega_ib_b x l) - omega_ie_i x (r_i + C_ib l)),

    and, where a latency d is estimated, r - v d + a d^2/2 and v - a d: what was measured d earlier. l is the
    nominal lever arm and its estimated error. The rate is taken as constant within d.

    Parameters
    ----------
    layout : Layout
    state : NavState
    earth : EarthRotation
    l_ba_b : (3,) m, IMU to antenna, nominal
    omega_ib_b, f_b : (3,) rad/s, m/s^2, corrected for the estimated errors of the IMU

    Returns
    -------
    Antenna

    References
    ----------
    Groves, 2nd ed., section 14.3.1.
    """
    C_ie = frames.dcm_ie(earth, state.t_s)
    C_ei = C_ie.T
    C_ib = rotation.dcm_from_quat(state.q_ib)
    arm = l_ba_b + state.lever_arm
    Omega, W, arm_x = rotation.skew(frames.omega_ie_i(earth)), rotation.skew(omega_ib_b), rotation.skew(arm)
    swing = W @ arm
    r_i, v_i = state.r_i + C_ib @ arm, state.v_i + C_ib @ swing
    J_omega, J_f = calibration.jacobians(layout, state, omega_ib_b, f_b)
    lever, latency = layout.places["lever_arm"], layout.places["gps_latency"]

    # of the antenna in inertial axes
    J_ri, J_vi = np.zeros((3, layout.n)), -C_ib @ arm_x @ J_omega
    J_ri[:, POS], J_ri[:, ATT] = np.eye(3), -C_ib @ arm_x
    J_vi[:, VEL], J_vi[:, ATT] = np.eye(3), -C_ib @ rotation.skew(swing)
    if lever:
        J_ri[:, lever], J_vi[:, lever] = C_ib, C_ib @ W
    r, v = r_i, v_i - Omega @ r_i
    J_r, J_v = J_ri, J_vi - Omega @ J_ri
    delay = state.gps_latency[0]
    if latency or delay:
        felt, turn = f_b + W @ swing, W @ arm_x + rotation.skew(swing)  # d(W W l) = -turn d(omega)
        a_i = C_ib @ felt + C_ie @ gravity_j2_e(C_ei @ state.r_i) + state.gravity
        J_ai = C_ib @ (J_f - turn @ J_omega)
        J_ai[:, ATT] = -C_ib @ rotation.skew(felt)
        J_ai[:, POS] = gravity_gradient(state.r_i)
        if layout.places["gravity"]:
            J_ai[:, layout.places["gravity"]] = np.eye(3)
        if lever:
            J_ai[:, lever] = C_ib @ W @ W
        a, J_a = (
            a_i - 2.0 * Omega @ v_i + Omega @ Omega @ r_i,
            J_ai - 2.0 * Omega @ J_vi + Omega @ Omega @ J_ri,
        )
        J_r, J_v = J_r - delay * J_v + 0.5 * delay**2 * J_a, J_v - delay * J_a
        r, v = r - delay * v + 0.5 * delay**2 * a, v - delay * a
        if latency:
            J_r[:, latency], J_v[:, latency] = -v[:, None], -a[:, None]
    return Antenna(C_ei @ r, C_ei @ v, C_ei @ J_r, C_ei @ J_v)


def gravity_gradient(r_i):
    """Gradient of a central gravity field: (3,) m -> (3, 3) 1/s^2."""
    d2 = r_i @ r_i
    return wgs84.GM / (d2 * np.sqrt(d2)) * (3.0 / d2 * np.outer(r_i, r_i) - np.eye(3))


def gps_position(layout, state, fix, earth, l_ba_b, omega_ib_b, f_b):
    """Position fix of the antenna: z = r_ea_e(measured) - r_ea_e.

    Parameters as of `antenna`, state at the instant of the fix, a GpsFix

    Returns
    -------
    z : (3,) m, frame e;  H : (3, n);  R : (3, 3) m^2
    """
    a = antenna(layout, state, earth, l_ba_b, omega_ib_b, f_b)
    return fix.r_ea_e - a.r_e, a.J_r, fix.R_r_e


def lasting_factor(share, time_s, gap_s):
    """By how much more a position fix is uncertain than it says, because it errs as the one before it did.

    A part of its variance is of errors that last, first-order Gauss-Markov: r = exp(-gap/time) of them is
    what the fix before had. Fixes at a steady rate tell as much about a position that stands still as fixes with
    independent errors of (1 + r)/(1 - r) times that part would; the first after a long gap counts in full.

    Parameters
    ----------
    share : of the variance that lasts, 0 to 1
    time_s : correlation time
    gap_s : since the fix before; inf: there was none

    Returns
    -------
    float, on the covariance of the fix
    """
    if not share or gap_s == np.inf:
        return 1.0
    r = np.exp(-gap_s / time_s)
    return float(1.0 - share + share * (1.0 + r) / max(1.0 - r, 1e-6))


def gps_velocity(layout, state, fix, earth, l_ba_b, omega_ib_b, f_b):
    """Velocity fix of the antenna, relative to the rotating Earth: z = v_ea_e(measured) - v_ea_e.

    Parameters as of `gps_position`

    Returns
    -------
    z : (3,) m/s, frame e;  H : (3, n);  R : (3, 3) m^2/s^2
    """
    a = antenna(layout, state, earth, l_ba_b, omega_ib_b, f_b)
    return fix.v_ea_e - a.v_e, a.J_v, fix.R_v_e


def star_attitude(layout, state, fix, C_bc, sigma_floor):
    """Attitude of the star camera: residual rotation in body axes.

    exp(z) = (q_ib exp(mounting))^-1 q_ic(measured) q_cb(nominal)

    Parameters
    ----------
    layout : Layout
    state : NavState at the instant of the fix
    fix : StarFix with an attitude
    C_bc : (3, 3) nominal mounting
    sigma_floor : rad, each axis, added to the covariance of the fix

    Returns
    -------
    z : (3,) rad, body axes
    H : (3, n)
    R : (3, 3) rad^2

    References
    ----------
    Markley & Crassidis, Fundamentals of Spacecraft Attitude Determination and Control, section 6.2.
    """
    mounting = layout.places["mounting"]
    first = -1 if mounting is None else mounting.start
    H, R = np.zeros((3, layout.n)), np.empty((3, 3))
    z = _star_attitude(state.q_ib, state.mounting, fix.q_ic, fix.P_c, C_bc, sigma_floor, first, H, R)
    return z, H, R


@njit(cache=True)
def _star_attitude(q_ib, mounting, q_ic, P_c, C_bc, sigma_floor, first, H, R):
    """`star_attitude` of its parts; first: error of the mounting, -1 if it is none. H, R are written."""
    q_mounting = rotation.quat_from_rotvec(mounting)
    q_predicted = rotation.quat_multiply(q_ib, q_mounting)
    q_measured = rotation.quat_multiply(q_ic, rotation.quat_from_dcm(np.ascontiguousarray(C_bc.T)))
    z = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q_predicted), q_measured))
    H[:, ATT] = rotation.dcm_from_quat(q_mounting).T
    if first >= 0:
        H[:, first : first + 3] = right_jacobian(mounting)
    R[:] = C_bc @ P_c @ C_bc.T
    for i in range(3):
        R[i, i] += sigma_floor**2
    return z
