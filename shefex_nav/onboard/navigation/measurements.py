"""What the sensors say about the errors: each function linearises one measurement about the nominal state.

z = H dx + noise, noise ~ N(0, R), dx in the order of `state`. Frames and units with each function.
"""

import numpy as np

from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation.state import ATT, BG, MOUNT, N_ERROR, POS, ROLL, VEL, right_jacobian


def gps_position(state, fix, earth, l_ba_b):
    """Position fix of the antenna: z = r_ea_e(measured) - C_ei (r_i + C_ib l).

    Parameters
    ----------
    state : NavState at the instant of the fix
    fix : GpsFix
    earth : EarthRotation
    l_ba_b : (3,) m, IMU to antenna

    Returns
    -------
    z : (3,) m, frame e
    H : (3, 21)
    R : (3, 3) m^2

    References
    ----------
    Groves, 2nd ed., section 14.3.1.
    """
    C_ei = frames.dcm_ie(earth, state.t_s).T
    C_eb = C_ei @ rotation.dcm_from_quat(state.q_ib)
    z = fix.r_ea_e - C_ei @ state.r_i - C_eb @ l_ba_b
    H = np.zeros((3, N_ERROR))
    H[:, POS] = C_ei
    H[:, ATT] = -C_eb @ rotation.skew(l_ba_b)
    return z, H, fix.R_r_e


def gps_velocity(state, fix, earth, l_ba_b, omega_ib_b):
    """Velocity fix of the antenna, relative to the rotating Earth.

    z = v_ea_e(measured) - C_ei (v_i + C_ib (omega_ib_b x l) - omega_ie_i x (r_i + C_ib l))

    Parameters as in `gps_position`, and
    omega_ib_b : (3,) rad/s, corrected for the estimated errors of the gyros

    Returns
    -------
    z : (3,) m/s, frame e;  H : (3, 21);  R : (3, 3) m^2/s^2
    """
    C_ie = frames.dcm_ie(earth, state.t_s)
    C_ei = C_ie.T
    C_ib = rotation.dcm_from_quat(state.q_ib)
    omega_ie_i = frames.omega_ie_i(earth)
    swing_b = rotation.cross(omega_ib_b, l_ba_b)
    v_ea_i = state.v_i + C_ib @ swing_b - rotation.cross(omega_ie_i, state.r_i + C_ib @ l_ba_b)
    z = fix.v_ea_e - C_ei @ v_ea_i

    C_eb, earth_rate, arm = C_ei @ C_ib, rotation.skew(omega_ie_i), rotation.skew(l_ba_b)
    k = state.gyro_roll_column
    M = np.eye(3)
    M[:, 0] -= k / (1.0 + k[0])  # d(omega) = -M (d(bias) + roll rate d(roll column))
    H = np.zeros((3, N_ERROR))
    H[:, POS] = -C_ei @ earth_rate
    H[:, VEL] = C_ei
    H[:, ATT] = -C_eb @ rotation.skew(swing_b) + C_ei @ earth_rate @ C_ib @ arm
    H[:, BG] = C_eb @ arm @ M
    H[:, ROLL] = omega_ib_b[0] * H[:, BG]
    return z, H, fix.R_v_e


def star_attitude(state, fix, C_bc, sigma_floor):
    """Attitude of the star camera: residual rotation in body axes.

    exp(z) = (q_ib exp(mounting))^-1 q_ic(measured) q_cb(nominal)

    Parameters
    ----------
    state : NavState at the instant of the fix
    fix : StarFix with an attitude
    C_bc : (3, 3) nominal mounting
    sigma_floor : rad, each axis, added to the covariance of the fix

    Returns
    -------
    z : (3,) rad, body axes
    H : (3, 21)
    R : (3, 3) rad^2

    References
    ----------
    Markley & Crassidis, Fundamentals of Spacecraft Attitude Determination and Control, section 6.2.
    """
    q_mounting = rotation.quat_from_rotvec(state.mounting)
    q_predicted = rotation.quat_multiply(state.q_ib, q_mounting)
    q_measured = rotation.quat_multiply(fix.q_ic, rotation.quat_from_dcm(np.ascontiguousarray(C_bc.T)))
    z = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q_predicted), q_measured))
    H = np.zeros((3, N_ERROR))
    H[:, ATT] = rotation.dcm_from_quat(q_mounting).T
    H[:, MOUNT] = right_jacobian(state.mounting)
    return z, H, C_bc @ fix.P_c @ C_bc.T + sigma_floor**2 * np.eye(3)
