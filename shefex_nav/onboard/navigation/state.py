"""The states of the filter: what is estimated, in which order the errors stand, and what is assumed of them.

Nominal states are carried by the strapdown; the covariance belongs to their errors,

    truth = estimate (+) error:   r = r^ + dr,   q_ib = q_ib^ * exp(dtheta_b),   b = b^ + db, ...

The slices below are the only place where the order of the errors is written. To add a block: a slice and a
new `N_ERROR` here, a field in `NavState`, a line in `correct` and in `initial`, its columns in
`error_model.transition` (if it drives the others) and in the measurements that see it.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.geometry import rotation

POS = slice(0, 3)  # dr_i [m]
VEL = slice(3, 6)  # dv_i [m/s]
ATT = slice(6, 9)  # dtheta_b [rad]
BG = slice(9, 12)  # gyro bias [rad/s]
BA = slice(12, 15)  # accelerometer bias [m/s^2]
ROLL = slice(15, 18)  # gyro error on x, y, z per unit of roll rate [-]: scale factor and two misalignments
MOUNT = slice(18, 21)  # star camera against its nominal mounting, rotation vector in body axes [rad]
N_ERROR = 21
PVA = slice(0, 9)  # position, velocity, attitude


class NavState(NamedTuple):
    """Nominal state at one instant."""

    t_s: float
    r_i: np.ndarray  # (3,) m
    v_i: np.ndarray  # (3,) m/s
    q_ib: np.ndarray  # (4,)
    gyro_bias: np.ndarray  # (3,) rad/s
    accel_bias: np.ndarray  # (3,) m/s^2
    gyro_roll_column: np.ndarray  # (3,)
    mounting: np.ndarray  # (3,) rad; C_bc = exp(skew(mounting)) C_bc(nominal)


class ImuModel(NamedTuple):
    """What the filter assumes of the inertial sensors beyond its states; all are numbers.

    Errors that are no states enter as noise (`error_model.noise_densities` says how).
    """

    gyro_random_walk: float  # rad/sqrt(s)
    gyro_bias_walk: float  # rad/s/sqrt(s), wander of the bias
    gyro_cross: float  # scale factor and misalignment met by rates across the roll axis, rms of three axes
    manoeuvre_angle: float  # rad, angle through which the roll axis is typically turned at a time
    gyro_g_sensitivity: float  # rad/s per m/s^2
    gyro_rectification: float  # rad/s, bias while the strongest motor burns
    gyro_vibration: float  # rad rms, swinging of the sensors while the strongest motor burns
    gyro_quantum: float  # rad, smallest increment
    accel_random_walk: float  # m/s/sqrt(s)
    accel_bias_walk: float  # m/s^2/sqrt(s), wander of the bias
    accel_cross: float  # scale factor, as met by thrust along the roll axis
    accel_rectification: float  # m/s^2, bias while the strongest motor burns
    accel_vibration: float  # m/s rms, swinging of the sensors while the strongest motor burns
    thrust_threshold: float  # m/s^2, specific force towards the nose above which a motor burns
    thrust_time_s: float  # correlation time of errors that go with specific force: half a burn
    gravity: float  # m/s^2, what the on-board gravity model leaves out
    gravity_time_s: float  # for how long it acts before GPS corrects for it, while the body turns
    saturated_rate: float  # rad/s, error while a sensor is at its range
    saturated_acceleration: float  # m/s^2


class ReleaseRule(NamedTuple):
    """When a sensor that contradicts the filter is believed after all."""

    count: int  # consecutive rejections
    duration_s: float  # from the first to the last of them


class NavParams(NamedTuple):
    """Parameters of the navigation filter."""

    imu: ImuModel
    sigma_gyro_bias: float  # rad/s, at the start, each axis
    sigma_accel_bias: float  # m/s^2
    sigma_gyro_roll_column: np.ndarray  # (3,)
    sigma_mounting: float  # rad
    l_ba_b: np.ndarray  # (3,) m, IMU to GPS antenna
    C_bc: np.ndarray  # (3, 3) nominal mounting of the star camera
    gate_probability: float  # of rejecting a good measurement
    star_sigma_floor: float  # rad, each axis: errors of a star fix that its covariance does not know
    release_gps: ReleaseRule
    release_star_first: ReleaseRule  # before the first star fix has been used
    release_star: ReleaseRule  # afterwards
    gps_agreement: float  # m per second between two fixes, for the check of fixes against each other
    history_s: float  # how far back a measurement may lie
    motors: np.ndarray  # (n, 2) in order of burning: s from when it may burn, vibration by the strongest's


def initial(params, alignment):
    """State and covariance at the start.

    NavParams, Alignment -> NavState, (21, 21)
    """
    state = NavState(
        float(alignment.t_valid_s),
        np.array(alignment.r_i, dtype=float),
        np.array(alignment.v_i, dtype=float),
        rotation.quat_normalise(np.array(alignment.q_ib, dtype=float)),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
        np.zeros(3),
    )
    P = np.zeros((N_ERROR, N_ERROR))
    P[POS, POS] = alignment.sigma_r**2 * np.eye(3)
    P[VEL, VEL] = alignment.sigma_v**2 * np.eye(3)
    P[ATT, ATT] = alignment.P_theta_b
    P[BG, BG] = params.sigma_gyro_bias**2 * np.eye(3)
    P[BA, BA] = params.sigma_accel_bias**2 * np.eye(3)
    P[ROLL, ROLL] = np.diag(params.sigma_gyro_roll_column**2)
    P[MOUNT, MOUNT] = params.sigma_mounting**2 * np.eye(3)
    return state, P


def correct(state, dx):
    """Take an estimated error (21,) into the nominal state: truth = estimate (+) error."""
    return NavState(
        state.t_s,
        state.r_i + dx[POS],
        state.v_i + dx[VEL],
        rotation.quat_normalise(
            rotation.quat_multiply(state.q_ib, rotation.quat_from_rotvec(np.ascontiguousarray(dx[ATT])))
        ),
        state.gyro_bias + dx[BG],
        state.accel_bias + dx[BA],
        state.gyro_roll_column + dx[ROLL],
        state.mounting + dx[MOUNT],
    )


@njit(cache=True)
def right_jacobian(phi):
    """Jr of the rotation group: exp(phi + d) = exp(phi) exp(Jr d) for small d. (3,) rad -> (3, 3).

    Jr = I - (1 - cos a)/a^2 X + (a - sin a)/a^3 X^2,   X = skew(phi), a = |phi|
    (Sola, arXiv:1711.02508, eq. 183).
    """
    a2 = phi[0] ** 2 + phi[1] ** 2 + phi[2] ** 2
    if a2 < 1e-4:  # series; the next terms are below 1e-12
        first, second = 0.5 - a2 / 24.0 + a2 * a2 / 720.0, 1.0 / 6.0 - a2 / 120.0
    else:
        a = np.sqrt(a2)
        first, second = (1.0 - np.cos(a)) / a2, (a - np.sin(a)) / (a2 * a)
    X = rotation.skew(phi)
    return np.eye(3) - first * X + second * (X @ X)
