"""The strapdown against analytic motion, and its errors against finite differences of itself."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from unpacked import QUIET, correct, felt, noise_of, propagate, window

from shefex_nav.compiled import kernel
from shefex_nav.environment.gravity import gravity_j2_e
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import error_model, prediction, process_noise, strapdown
from shefex_nav.onboard.navigation.state import ATT, BA, BG, POS, VEL, NavState, layout
from shefex_nav.records import ImuBlock

EARTH = frames.EarthRotation(np.eye(3), np.eye(3), 1.234, 7.292115e-5)
DT = 1.0 / 400.0
LAYOUT = layout()
ROLL, MOUNT, N_ERROR = LAYOUT.places["gyro_roll_column"], LAYOUT.places["mounting"], LAYOUT.n
NODES, WEIGHTS = np.polynomial.legendre.leggauss(6)  # within one sample: error below 1e-16


class Coning:
    """A vehicle under thrust that spins and whose spin axis cones: C_ib = Rz(W t) Ry(cone) Rx(s t)."""

    spin, precession, cone = 2 * np.pi * 1.5, 2 * np.pi * 0.2, np.deg2rad(5.0)
    r_0, v_0 = np.array([2.3e6, 0.4e6, 6.0e6]), np.array([-300.0, 500.0, 1200.0])

    def C_ib(self, t):
        angles = [self.precession * t, self.cone, self.spin * t]
        return Rotation.from_euler("ZYX", angles).as_matrix()

    def omega_b(self, t):
        """Kinematics of the three angles."""
        roll = self.spin * t
        along = self.precession * np.array(
            [-np.sin(self.cone), np.cos(self.cone) * np.sin(roll), np.cos(self.cone) * np.cos(roll)]
        )
        return along + np.array([self.spin, 0.0, 0.0])

    def f_b(self, t):
        """Thrust with a ripple, and what an IMU off the spin axis senses."""
        return np.array([60.0 + 5.0 * np.sin(3.0 * t), 2.0 + np.cos(9.0 * t), -1.0])

    def block(self, n):
        """ImuBlock n of ideal increments, by quadrature."""
        dtheta, dv = np.zeros((4, 3)), np.zeros((4, 3))
        for k in range(4):
            begin = (4 * n + k) * DT
            for x, w in zip(NODES, WEIGHTS, strict=True):
                t = begin + 0.5 * DT * (1.0 + x)
                dtheta[k] += 0.5 * DT * w * self.omega_b(t)
                dv[k] += 0.5 * DT * w * self.f_b(t)
        end = (4 * n + 4) * DT
        return ImuBlock(end, end, DT, dtheta, dv, False)

    def truth(self, t_end):
        """(r_i, v_i) by an adaptive Runge-Kutta method of order 8."""

        def rates(t, x):
            C_ie = frames.dcm_ie(EARTH, t)
            g_i = C_ie @ gravity_j2_e(C_ie.T @ x[:3])
            return np.concatenate([x[3:], self.C_ib(t) @ self.f_b(t) + g_i])

        start = np.concatenate([self.r_0, self.v_0])
        x = solve_ivp(rates, (0.0, t_end), start, method="DOP853", rtol=1e-13, atol=1e-7).y[:, -1]
        return x[:3], x[3:]

    def start(self, **errors):
        zero = {"gyro_bias": np.zeros(3), "accel_bias": np.zeros(3), "gyro_roll_column": np.zeros(3)}
        q_ib = rotation.quat_from_dcm(self.C_ib(0.0))
        return NavState(0.0, self.r_0, self.v_0, q_ib, mounting=np.zeros(3), **(zero | errors))


MOTION = Coning()
BLOCKS = [MOTION.block(n) for n in range(1000)]


def fly(state, blocks, cuts=(0.0, 4 * DT)):
    """The state after the blocks, each integrated in parts between the cuts."""
    imu = None
    for block in blocks:
        imu = window(block, imu)
        for begin_s, end_s in pairwise(cuts):
            r_i, v_i, q_ib = propagate(state, imu, begin_s, end_s, EARTH)
            t_s = block.t_valid_s - 4 * DT + end_s
            state = NavState(t_s, r_i, v_i, q_ib, *state[4:])
    return state


def attitude_error(state):
    return rotation.rotvec_between(state.q_ib, rotation.quat_from_dcm(MOTION.C_ib(state.t_s)))


def test_ideal_increments_give_back_coning_motion_under_thrust():
    """10 s, 15 revolutions. Without coning compensation the attitude is 5e-4 rad off, see below."""
    state = fly(MOTION.start(), BLOCKS)
    r_i, v_i = MOTION.truth(10.0)
    assert np.linalg.norm(attitude_error(state)) < 1e-7
    assert np.linalg.norm(state.v_i - v_i) < 1e-4
    assert np.linalg.norm(state.r_i - r_i) < 5e-4


def test_compensation_is_needed():
    """The increments taken as rotation vectors, as a reference without compensation."""
    q_ib = rotation.quat_from_dcm(MOTION.C_ib(0.0))
    for dtheta in np.concatenate([block.dtheta_b for block in BLOCKS]):
        q_ib = rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(dtheta))
    error = rotation.rotvec_between(q_ib, rotation.quat_from_dcm(MOTION.C_ib(10.0)))
    assert np.linalg.norm(error) > 1e-4


def test_cutting_a_sample_anywhere_changes_nothing():
    """A cut at an arbitrary instant costs less than the compensation itself leaves."""
    whole, cut = (
        fly(MOTION.start(), BLOCKS[:200]),
        fly(MOTION.start(), BLOCKS[:200], (0.0, 0.00137, 0.0081, 0.01)),
    )
    assert np.linalg.norm(rotation.rotvec_between(whole.q_ib, cut.q_ib)) < 1e-8
    assert np.linalg.norm(whole.v_i - cut.v_i) < 1e-5
    assert np.linalg.norm(whole.r_i - cut.r_i) < 1e-5


def test_state_inside_a_tick_is_that_of_then():
    imu = window(BLOCKS[1], window(BLOCKS[0]))
    state = fly(MOTION.start(), BLOCKS[:1])
    _, _, q_ib = propagate(state, imu, 0.0, 0.0037, EARTH)
    q_true = rotation.quat_from_dcm(MOTION.C_ib(0.01 + 0.0037))
    assert np.linalg.norm(rotation.rotvec_between(q_ib, q_true)) < 1e-7


def test_known_sensor_errors_are_taken_out():
    """Increments of gyros and accelerometers with errors, integrated with those errors as estimates."""
    bias, accel, column = (
        np.array([1e-4, -2e-4, 3e-4]),
        np.array([0.02, -0.01, 0.03]),
        np.array([4e-4, -3e-4, 2e-4]),
    )
    faulty = []
    for block in BLOCKS[:300]:
        dtheta_b = block.dtheta_b + np.outer(block.dtheta_b[:, 0], column) + bias * DT
        faulty.append(block._replace(dtheta_b=dtheta_b, dv_b=block.dv_b + accel * DT))
    clean = fly(MOTION.start(), BLOCKS[:300])
    state = fly(MOTION.start(gyro_bias=bias, accel_bias=accel, gyro_roll_column=column), faulty)
    assert np.linalg.norm(rotation.rotvec_between(clean.q_ib, state.q_ib)) < 1e-12
    assert np.linalg.norm(clean.r_i - state.r_i) < 1e-6
    omega_b, _ = felt(state, window(faulty[-1]), 4 * DT)
    middle = MOTION.omega_b(3.0 - 0.5 * DT)
    assert np.allclose(omega_b, middle, atol=1e-4)  # mean of a sample against its middle: curvature only


@pytest.mark.compiled
def test_standing_still_on_the_turning_earth():
    """A minute at rest: specific force cancels gravity, rate is that of the Earth."""
    r_e = wgs84.ecef_from_geodetic(np.deg2rad(69.3), np.deg2rad(16.0), 10.0)
    r_i, v_i = frames.inertial_from_ecef(EARTH, 0.0, r_e, np.zeros(3))
    q_ib = rotation.quat_from_dcm(frames.dcm_ie(EARTH, 0.0))  # body axes along those of the Earth
    omega_e = np.array([0.0, 0.0, EARTH.rate])
    f_e = np.cross(omega_e, np.cross(omega_e, r_e)) - gravity_j2_e(r_e)
    dtheta_b, dv_b = np.tile(omega_e * DT, (4, 1)), np.tile(f_e * DT, (4, 1))
    blocks = [ImuBlock(0.01 * (n + 1), 0.0, DT, dtheta_b, dv_b, False) for n in range(6000)]
    state = fly(NavState(0.0, r_i, v_i, q_ib, *[np.zeros(3)] * 4), blocks)
    r_end, v_end = frames.ecef_from_inertial(EARTH, 60.0, state.r_i, state.v_i)
    assert np.linalg.norm(r_end - r_e) < 1e-4
    assert np.linalg.norm(v_end) < 1e-5


def error_between(estimate, truth):
    """The error state dx with truth = estimate (+) dx."""
    dx = np.empty(N_ERROR)
    dx[POS], dx[VEL] = truth.r_i - estimate.r_i, truth.v_i - estimate.v_i
    dx[ATT] = rotation.rotvec_between(estimate.q_ib, truth.q_ib)
    dx[BG], dx[BA] = truth.gyro_bias - estimate.gyro_bias, truth.accel_bias - estimate.accel_bias
    dx[ROLL] = truth.gyro_roll_column - estimate.gyro_roll_column
    dx[MOUNT] = truth.mounting - estimate.mounting
    return dx


STEP = np.repeat([10.0, 0.1, 1e-4, 1e-3, 1.0, 1e-4, 1e-4], 3)


@pytest.mark.parametrize(("begin_s", "end_s"), [(0.0, 0.01), (0.0013, 0.0087)])
def test_transition_matrix_is_the_derivative_of_the_strapdown(begin_s, end_s):
    """Central differences. Only the oblateness is left out of the gravity gradient: 0.3 % of that block."""
    state = MOTION.start(
        gyro_bias=np.array([1e-4, -2e-4, 3e-4]),
        accel_bias=np.array([0.02, -0.01, 0.03]),
        gyro_roll_column=np.array([4e-4, -3e-4, 2e-4]),
    )
    imu = window(BLOCKS[1], window(BLOCKS[0]))

    def end(start):
        r_i, v_i, q_ib = propagate(start, imu, begin_s, end_s, EARTH)
        return NavState(0.0, r_i, v_i, q_ib, *start[4:])

    nominal = end(state)
    constants = prediction.constants(LAYOUT, noise_of(QUIET), EARTH)
    Phi, _ = prediction.growth(constants, LAYOUT, state, imu, begin_s, end_s)
    measured = np.empty((N_ERROR, N_ERROR))
    for j in range(N_ERROR):
        dx = np.zeros(N_ERROR)
        dx[j] = STEP[j]
        up = error_between(nominal, end(correct(LAYOUT, state, dx)))
        down = error_between(nominal, end(correct(LAYOUT, state, -dx)))
        measured[:, j] = (up - down) / (2.0 * STEP[j])
    gradient = wgs84.GM / np.linalg.norm(state.r_i) ** 3
    T = end_s - begin_s
    for rows in (POS, VEL, ATT, BG, BA, ROLL, MOUNT):
        for columns in (POS, VEL, ATT, BG, BA, ROLL, MOUNT):
            scale = np.abs(Phi[rows, columns]).max()
            # rounding of positions of 6e6 m in the differences; gradient: oblateness, where g is evaluated
            rounding = {POS.start: 2e-9, VEL.start: 1e-12}.get(rows.start, 1e-14) / STEP[columns.start]
            gravity = {POS.start: 0.01, VEL.start: 0.01 * T}.get(columns.start, 1e-2 * T * T) * gradient * T
            tolerance = 1e-6 * scale + rounding + (gravity if rows in (POS, VEL) else 0.0)
            difference = np.abs(measured[rows, columns] - Phi[rows, columns]).max()
            assert difference <= tolerance, (rows, columns, difference, tolerance, scale)


def noise_of_a_tick(model, extra=strapdown.NO_EXTRA):
    imu = window(BLOCKS[1], window(BLOCKS[0]), 0.0, extra)
    state = MOTION.start()
    constants = prediction.constants(LAYOUT, noise_of(model), EARTH)
    return prediction.growth(constants, LAYOUT, state, imu, 0.0, 0.01).Q


def test_white_noise_of_the_sensors_grows_as_the_datasheet_says():
    """After 1 s of unaccelerated flight: angle random walk, velocity random walk."""
    Q = noise_of_a_tick(QUIET._replace(gyro_random_walk=2e-5, accel_random_walk=7e-4, gyro_bias_walk=3e-8))
    assert np.allclose(np.diag(Q)[ATT], 2e-5**2 * 0.01, rtol=1e-9)
    assert np.allclose(np.diag(Q)[VEL], 7e-4**2 * 0.01, rtol=1e-3)  # attitude noise under thrust adds to it
    assert np.allclose(np.diag(Q)[BG], 3e-8**2 * 0.01)
    assert np.linalg.eigvalsh(Q).min() > -1e-18


def test_spin_averages_errors_across_the_roll_axis_only():
    Q = noise_of_a_tick(QUIET._replace(gyro_g_sensitivity=1e-6))
    f = np.linalg.norm(MOTION.f_b(0.015))
    assert Q[ATT, ATT][0, 0] == pytest.approx(2 * 30.0 * (1e-6 * f) ** 2 * 0.01, rel=1e-2)
    assert Q[ATT, ATT][1, 1] < 1e-4 * Q[ATT, ATT][0, 0]


def test_noise_that_comes_on_top_acts_along_its_axes():
    """As of an axis at the end of its range, or one that is stuck: densities per body axis."""
    assert np.allclose(noise_of_a_tick(QUIET), 0.0)
    rate, force = np.array([0.5, 0.0, 0.2]) ** 2 * 0.01, np.array([0.0, 10.0, 3.0]) ** 2 * 0.01
    Q = noise_of_a_tick(QUIET, np.array([0.75 * rate, force, 0.25 * rate]))  # of either kind
    C_ib = MOTION.C_ib(0.0)  # at the start of the interval
    angle = 0.01 * MOTION.spin / 2.0  # by which the axes have turned on average: all that is left out
    assert np.allclose(Q[ATT, ATT], np.diag(rate) * 0.01, atol=rate.max() * 0.01 * 2.0 * angle)
    assert np.allclose(Q[VEL, VEL], C_ib @ np.diag(force) @ C_ib.T * 0.01, atol=2e-5)
    assert np.linalg.eigvalsh(Q[:9, :9] / np.outer(SCALE, SCALE)).min() > -1e-12


SCALE = np.repeat([1e-3, 1.0, 5e-3], 3)


def test_vibration_is_that_of_the_motor_that_burns():
    limits = 15.0, 0.002
    motors = np.array([[0.0, 1.0], [5.0, 0.4], [9.0, 0.7]])
    for t_s, level in ((0.01, 1.0), (4.99, 1.0), (6.0, 0.4), (20.0, 0.7)):
        assert error_model.vibration_level(motors, *limits, t_s, 40.0, 0.0) == level
        assert error_model.vibration_level(motors, *limits, t_s, 5.0, 0.01) == level  # the last of a burn
    assert error_model.vibration_level(motors, *limits, 6.0, 4.0, 0.001) == 0.0
    assert error_model.vibration_level(motors, *limits, 6.0, -40.0, 0.001) == 0.0  # drag is no motor
    assert error_model.vibration_level(np.zeros((0, 2)), *limits, 6.0, 40.0, 0.01) == 0.0


def test_shaking_is_told_from_motion():
    """Increments with noise of 5 mm/s while thrust rises by 100 m/s^2 a second; 2000 ticks, 3 sigma."""
    rng = np.random.default_rng(8)
    rising = np.array([[100.0, 0.0, 0.0]]) * (DT**2 * np.arange(4))[:, None]
    found = [error_model.shake(rising + 0.005 * rng.standard_normal((4, 3))) ** 2 for _ in range(2000)]
    scatter = np.sqrt(2.0 / 7.0 / 2000)  # of 9 changes that share samples
    assert np.mean(found) == pytest.approx(0.005**2, rel=3.0 * scatter)
    assert error_model.shake(rising) < 0.001
    assert error_model.shake(rising[:1]) == 0.0


def test_swinging_under_vibration_is_not_taken_for_turning():
    """Noise of scale factor and misalignment: that of the turn, and little without one; 4000 ticks."""
    swing, rng = 3e-5, np.random.default_rng(9)
    model = noise_of(QUIET._replace(gyro_cross=1e-4, manoeuvre_angle=1.0, gyro_vibration=swing))
    ends = swing * rng.standard_normal((4000, 2, 2))  # of both axes at both ends

    def noise(rate):
        turned = np.array([0.01 * rate, 0.0]) + ends[:, 1] - ends[:, 0]
        return np.mean([gyro_noise(model, (0.1, *angles)) for angles in turned.tolist()])

    assert noise(0.05) == pytest.approx(1e-8 * 0.05, rel=0.05)
    counted_too = 1e-8 * np.sqrt(np.pi / 2.0) * np.sqrt(2.0) * swing / 0.01  # mean of a Rayleigh distribution
    assert noise(0.0) < 0.4 * counted_too


def test_a_tick_that_is_cut_gathers_as_much_noise():
    """In parts of a third and two thirds, at a steady rate in vibration: the variance of the whole."""
    model = noise_of(QUIET._replace(gyro_cross=1e-4, manoeuvre_angle=1.0, gyro_vibration=3e-5))
    angle = np.array([1e-3, 9e-5, 2e-5])
    whole = 0.01 * gyro_noise(model, tuple(angle))
    parts = sum(0.01 * share * gyro_noise(model, tuple(share * angle), share) for share in (1 / 3, 2 / 3))
    assert parts == pytest.approx(whole, rel=1e-12)
    assert whole > 1e-8 * 1e-2 * 1e-3  # and that is not nothing


@kernel
def gyro_noise(model, dtheta, share=1.0):
    zero = (0.0, 0.0, 0.0)
    along, _, _ = process_noise.densities(model[0], 1.0, share, 0.01, 0.01 * share, dtheta, zero, zero[:2])
    return along[0]
