"""A short flight with sensors, made for the tests of the filter: spin and thrust, then coast.

The truth is what the strapdown makes of smooth, ideal increments; the sensors are that plus errors.
"""

from itertools import count, islice

import numpy as np
from unpacked import felt, propagate, window

from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation import measurements
from shefex_nav.onboard.navigation.settings import Release, Releases
from shefex_nav.onboard.navigation.state import ImuModel, NavParams, NavState, pack
from shefex_nav.records import Alignment, GpsFix, ImuBlock, StarFix

EARTH = frames.EarthRotation(np.eye(3), np.eye(3), 1.234, 7.292115e-5)
DT = 1.0 / 400.0
DEG = np.pi / 180.0
ARCSEC = DEG / 3600.0
C_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])

MODEL = ImuModel(
    gyro_random_walk=9e-6,
    gyro_bias_walk=2e-8,
    gyro_cross=1e-4,
    spun_along=0.75,
    spun_across=0.75,
    manoeuvre_angle=1.0,
    gyro_g_sensitivity=2.5e-7,
    gyro_rectification=0.0,
    gyro_vibration=0.0,
    gyro_quantum=0.0,
    accel_random_walk=5e-4,
    accel_bias_walk=2e-5,
    accel_scale=3e-4,
    accel_misalignment=1e-4,
    accel_rectification=0.0,
    accel_vibration=0.0,
    thrust_threshold=15.0,
    shake_threshold=np.inf,
    thrust_time_s=30.0,
    gravity=1e-5,  # the truth of these tests has the on-board gravity
    gravity_time_s=50.0,
    saturated_rate=1.0,
)
PARAMS = NavParams(
    imu=MODEL,
    sigma_gyro_bias=2.4e-6,
    sigma_accel_bias=5e-3,
    sigma_blocks={"gyro_roll_column": np.array([3e-5, 5e-5, 5e-5]), "mounting": np.full(3, 0.02 * DEG)},
    l_ba_b=np.array([0.6, 0.05, -0.03]),
    C_bc=C_BC,
    gate_probability=1e-4,
    star_fix_floor=0.0,
    release=Releases(
        gps=Release(rejections=4, duration=3.0),
        first_star_fix=Release(rejections=2, duration=0.0),
        star_fix=Release(rejections=20, duration=1.9),
    ),
    gps_agreement=20.0,
    history_s=0.6,
    motors=np.array([[0.0, 1.0]]),
)
SIGMA_R, SIGMA_V = 2.0, 0.1  # of GPS: m, m/s
P_STAR_C = np.diag([20 * ARCSEC, 20 * ARCSEC, 100 * ARCSEC]) ** 2


def motion(t):
    """omega_b, f_b at t: spin-up under thrust until 20 s, coast with a slow tumble afterwards."""
    thrust = 60.0 / (1.0 + np.exp((t - 20.0) / 0.3))
    omega_b = np.array(
        [3.0 / (1.0 + np.exp((t - 20.0) / 0.5)), 0.02 * np.sin(0.7 * t), 0.015 * np.cos(0.5 * t)]
    )
    return omega_b, np.array([thrust, 0.02 * thrust, 0.0])


def _ticks():
    """Ideal ImuBlock and the NavState at its end; three-point Gauss quadrature of each sample."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    state, imu = STATES[0], None
    for n in count():
        dtheta_b, dv_b = np.zeros((4, 3)), np.zeros((4, 3))
        for k in range(4):
            for x, w in zip(nodes, weights, strict=True):
                omega_b, f_b = motion((4 * n + k + 0.5 + 0.5 * x) * DT)
                dtheta_b[k] += 0.5 * DT * w * omega_b
                dv_b[k] += 0.5 * DT * w * f_b
        block = ImuBlock((n + 1) / 100.0, (n + 1) / 100.0, DT, dtheta_b, dv_b, False)
        imu = window(block, imu)
        r_i, v_i, q_ib = propagate(state, imu, 0.0, 4 * DT, EARTH)
        state = NavState(block.t_valid_s, r_i, v_i, q_ib, *state[4:])
        yield block, state


R_0, V_0 = np.array([2.2e6, 0.6e6, 6.0e6]), np.array([100.0, 400.0, 900.0])
Q_0 = rotation.quat_normalise(np.array([0.6, 0.2, -0.5, 0.3]))
BLOCKS, STATES = [], [NavState(0.0, R_0, V_0, Q_0, *[np.zeros(3)] * 4)]  # as far as somebody has flown
TICKS = _ticks()


def fly(duration_s):
    """(blocks, states): ideal ImuBlock n ends at state n + 1. All fly the same, which is made once."""
    n = round(duration_s * 100)
    for block, state in islice(TICKS, max(n - len(BLOCKS), 0)):
        BLOCKS.append(block)
        STATES.append(state)
    return BLOCKS[:n], STATES[: n + 1]


def antenna_of(order, state, earth, l_ba_b, omega_b, f_b, vibration):
    """`measurements.antenna` of a NavState."""
    motion_b = np.concatenate((omega_b, f_b))
    return measurements.antenna(order, pack(state), state.t_s, earth, l_ba_b, motion_b, vibration)


def state_at(blocks, states, t_s):
    """The truth at any instant, between samples too."""
    n = max(int(np.ceil(t_s * 100.0 - 1e-9)) - 1, 0)
    imu = window(blocks[n], window(blocks[n - 1]) if n else None)
    r_i, v_i, q_ib = propagate(states[n], imu, 0.0, t_s - states[n].t_s, EARTH)
    return NavState(t_s, r_i, v_i, q_ib, *states[n][4:]), felt(states[n], imu, t_s - states[n].t_s)[0]


def alignment(state, rng=None, sigma_deg=0.1):
    """Alignment with errors of 3 m, 0.01 m/s and of the attitude; without errors if there is no generator."""
    P_theta_b = (sigma_deg * DEG) ** 2 * np.eye(3)
    noise = np.zeros((3, 3)) if rng is None else rng.standard_normal((3, 3))
    q_ib = rotation.quat_multiply(state.q_ib, rotation.quat_from_rotvec(sigma_deg * DEG * noise[2]))
    return Alignment(
        state.t_s, state.r_i + 3.0 * noise[0], state.v_i + 0.01 * noise[1], q_ib, 3.0, 0.01, P_theta_b
    )


def gps_fix(blocks, states, t_s, latency_s, rng=None):
    """GpsFix of the antenna; without noise if there is no generator."""
    state, omega_b = state_at(blocks, states, t_s)
    C_ib = rotation.dcm_from_quat(state.q_ib)
    arm = PARAMS.l_ba_b
    r_e, v_e = frames.ecef_from_inertial(
        EARTH, t_s, state.r_i + C_ib @ arm, state.v_i + C_ib @ np.cross(omega_b, arm)
    )
    noise = np.zeros((2, 3)) if rng is None else rng.standard_normal((2, 3))
    r_e, v_e = r_e + SIGMA_R * noise[0], v_e + SIGMA_V * noise[1]
    R_r, R_v = SIGMA_R**2 * np.eye(3), SIGMA_V**2 * np.eye(3)
    return GpsFix(t_s, t_s + latency_s, True, r_e, v_e, R_r, R_v, 8, 2.0, "")


def star_fix(blocks, states, t_s, latency_s, rng=None, wrong_by=None):
    """StarFix; `wrong_by` (3,) rad turns it away from the truth in body axes."""
    state, _ = state_at(blocks, states, t_s)
    q_ib = state.q_ib
    if wrong_by is not None:
        q_ib = rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(wrong_by))
    q_ic = rotation.quat_multiply(q_ib, rotation.quat_from_dcm(C_BC))
    noise = np.zeros(3) if rng is None else np.sqrt(np.diag(P_STAR_C)) * rng.standard_normal(3)
    q_ic = rotation.quat_multiply(q_ic, rotation.quat_from_rotvec(noise))
    return StarFix(0, t_s, t_s + latency_s, 0, q_ic, P_STAR_C, None, None, 0.3, 12.0, 0.0, False, False)
