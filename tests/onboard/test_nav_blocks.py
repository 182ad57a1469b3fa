"""Every block of states on: Jacobians against finite differences, sensors without noise, and the layout."""

import numpy as np
import pytest
import slow_strapdown
from navigation_flight import C_BC, DT, EARTH, PARAMS, fly
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from unpacked import correct, propagate, star_attitude, window

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import (
    calibration,
    error_model,
    laws,
    measurements,
    prediction,
)
from shefex_nav.onboard.navigation.blocks import Block
from shefex_nav.onboard.navigation.history import History, Tick
from shefex_nav.onboard.navigation.state import (
    ATT,
    OPTIONAL,
    POS,
    VEL,
    X_Q,
    NavState,
    layout,
    pack,
)
from shefex_nav.records import GpsFix, StarFix

DRIFT = Block("drift", np.diag([4.0, 9.0]), np.array([0.3, 0.0]))  # of an instrument, one that wanders
COEFFICIENTS = np.array(  # rad/s and m/s^2 for each unit of the two errors of OWN
    [[0.5, 0.0], [-0.2, 0.3], [0.1, 1.0], [20.0, -3.0], [4.0, 0.0], [0.0, 7.0]]
)
OWN = Block(  # of a plug-in: one error decays into the other, and both drive increments
    "own",
    np.diag([1.0, 4.0]),
    np.array([0.2, 0.1]),
    F=np.array([[-0.5, 1.5], [0.0, -0.2]]),
    drives=lambda felt: COEFFICIENTS,
)
DRIVE = np.hstack([np.zeros((6, DRIFT.size)), COEFFICIENTS])
ALL = layout((*tuple(OPTIONAL)[1:], "drift"), (DRIFT,))  # the roll column is part of the next two
ROLL = layout(("gyro_roll_column", "gyro_g_sensitivity", "accel_misalignment", "lever_arm"))
OUTSIDE = layout(
    ("gyro_roll_column", "gyro_g_sensitivity", "accel_scale", "clock", "drift", "own"), (DRIFT, OWN)
)
ORDERS = pytest.mark.parametrize("order", [ALL, ROLL, OUTSIDE], ids=["all", "roll column", "outside"])
STEPS = {
    "position": 10.0,
    "velocity": 0.1,
    "attitude": 1e-4,
    "gyro_bias": 1e-3,
    "accel_bias": 1.0,
    "gyro_roll_column": 1e-4,
    "gyro_scale": 1e-4,
    "gyro_misalignment": 1e-4,
    "gyro_g_sensitivity": 1e-5,
    "accel_scale": 1e-4,
    "accel_misalignment": 1e-4,
    "accel_rectification": 1.0,
    "gravity": 1e-2,
    "mounting": 1e-4,
    "lever_arm": 0.1,
    "clock": 1.0,
    "gps_latency": 1e-4,
    "range_bias": 1.0,
    "drift": 1.0,
    "own": 1e-3,
}
RNG = np.random.default_rng(11)  # anew in each test: conftest.own_numbers
BLOCKS, STATES = fly(0.3)
ARM = PARAMS.l_ba_b
VIBRATION = 0.7  # level at which the motion is measured
SPIN, FORCE = np.array([9.4, 0.2, -0.1]), np.array([60.0, 1.0, -2.0])  # as the sensors measure them
CLOCK = {"clock_white": 0.1, "clock_walk": 0.2, "range_bias_sigma": 3.0, "range_bias_time_s": 100.0}
CLOCK["gravity_error"] = 2e-4
NOISE = error_model.record(PARAMS._replace(**CLOCK))


def state_with_errors(names, latency_s=0.0, t_s=123.4):
    """A state in flight, nothing zero of what is estimated."""
    small = {"gyro_g_sensitivity": 1e-6, "mounting": 2e-3, "lever_arm": 0.1, "clock": 5.0, "range_bias": 2.0}
    own = [name for name in names if name in OPTIONAL]
    blocks = {name: small.get(name, 5e-4) * RNG.standard_normal(OPTIONAL[name]) for name in own}
    if "drift" in names:
        blocks["others"] = RNG.standard_normal(DRIFT.size)
    if "own" in names:
        blocks["others"] = np.concatenate([blocks["others"], 1e-3 * RNG.standard_normal(OWN.size)])
    if "gps_latency" in names:
        blocks["gps_latency"] = np.array([latency_s])
    return NavState(
        t_s,
        np.array([2.1e6, 0.6e6, 6.0e6]),
        np.array([1500.0, -900.0, 700.0]),
        rotation.quat_normalise(RNG.standard_normal(4)),
        1e-4 * RNG.standard_normal(3),
        0.01 * RNG.standard_normal(3),
        **blocks,
    )


def each_error(order):
    """(name of the block, index of the error, step) of all errors."""
    for name, place in order.places.items():
        for j in range(place.start, place.stop) if place else ():
            yield name, j, STEPS[name]


def unit(order, j, size):
    dx = np.zeros(order.n)
    dx[j] = size
    return dx


def error_between(order, estimate, truth):
    """The error dx with truth = estimate (+) dx."""
    dx = np.zeros(order.n)
    dx[POS], dx[VEL] = truth.r_i - estimate.r_i, truth.v_i - estimate.v_i
    dx[ATT] = rotation.rotvec_between(estimate.q_ib, truth.q_ib)
    for name in ("gyro_bias", "accel_bias", *order.names):
        value = order.values[name]
        dx[order.places[name]] = pack(truth)[value] - pack(estimate)[value]
    return dx


def drive_of(order):
    """What blocks from outside drive in all ticks."""
    return DRIVE if "own" in order.names else calibration.NO_DRIVE


def driven(order, state):
    """Error of rate and specific force by blocks from outside: (3,) rad/s, (3,) m/s^2."""
    error = COEFFICIENTS @ state.others[-OWN.size :] if "own" in order.names else np.zeros(6)
    return error[:3], error[3:]


def constants_of(order):
    """What a prediction with some blocks needs."""
    return prediction.constants(order, NOISE, EARTH, (DRIFT, OWN))


@ORDERS
@pytest.mark.parametrize(("begin_s", "end_s"), [(0.0, 0.01), (0.0013, 0.0087)])
def test_transition_of_every_block_is_the_derivative_of_the_strapdown(order, begin_s, end_s):
    """Central differences, each pair of blocks to 1e-6 of its largest element.

    In the gravity gradient the oblateness is left out: 0.3 % of that block.
    """
    state, T = state_with_errors(order.names), end_s - begin_s
    imu = window(BLOCKS[11], window(BLOCKS[10]))._replace(drive=drive_of(order))

    def end(start):
        r_i, v_i, q_ib = propagate(start, imu, begin_s, end_s, EARTH)
        clock = start.clock + np.array([start.clock[1] * T, 0.0])
        decayed = start.range_bias * np.exp(-T / CLOCK["range_bias_time_s"])
        gravity = start.gravity * np.exp(-T / laws.FIELD_TIME_S)
        others = start.others.copy()
        if "own" in order.names:
            others[-OWN.size :] = expm(OWN.F * T) @ others[-OWN.size :]
        own = {"clock": clock, "range_bias": decayed, "gravity": gravity, "others": others}
        return start._replace(r_i=r_i, v_i=v_i, q_ib=q_ib, **own)

    nominal = end(state)
    Phi, _ = prediction.growth(constants_of(order), order, state, imu, begin_s, end_s)
    measured = np.empty((order.n, order.n))
    for _, j, step in each_error(order):
        up = error_between(order, nominal, end(correct(order, state, unit(order, j, step))))
        down = error_between(order, nominal, end(correct(order, state, unit(order, j, -step))))
        measured[:, j] = (up - down) / (2.0 * step)
    gradient = wgs84.GM / np.linalg.norm(state.r_i) ** 3
    for rows_name, rows in order.places.items():
        for name, columns in order.places.items():
            if rows is None or columns is None:
                continue
            rounding = {"position": 2e-9, "velocity": 1e-12}.get(rows_name, 2e-15) / STEPS[name]
            gravity = {"position": 0.01, "velocity": 0.01 * T}.get(name, 0.01 * T * T) * gradient * T
            tolerance = 1e-6 * np.abs(Phi[rows, columns]).max() + rounding
            tolerance += gravity if rows in (POS, VEL) else 0.0
            difference = np.abs(measured[rows, columns] - Phi[rows, columns]).max()
            assert difference <= tolerance, (rows_name, name, difference, tolerance)


def test_the_kernel_carries_the_state_as_the_strapdown_does():
    """Part by part, and eleven ticks in one call, against a slow strapdown and Phi P Phi^T + Q in NumPy."""
    state = state_with_errors(ALL.names, t_s=BLOCKS[0].t_valid_s - 0.01)
    x, t_s = pack(state), state.t_s
    scale = np.array([step for _, _, step in each_error(ALL)])
    A = RNG.standard_normal((ALL.n, ALL.n))
    P = 1e-4 * (A @ A.T + np.eye(ALL.n)) * np.outer(scale, scale)
    history, motors = History(Tick(t_s, x, P, None)), np.array([[-1.0, 0.3]])
    for k, block in enumerate(BLOCKS[:11], 1):
        place = history.make_room(4)
        history.increments[place, 2:], history.extra[place] = np.hstack([block.dtheta_b, block.dv_b]), 0.0
        t_end_s = state.t_s + 0.01 * k
        prediction.enter(constants_of(ALL), history.arrays, k, motors, t_end_s, DT, 4)
        history.extend([t_end_s])
    in_turn = history.xs[:12].copy(), history.Ps[:12].copy()
    history.go_to(0)
    prediction.propagate(constants_of(ALL), history.arrays, 1, 0.0, 11, np.inf)
    assert np.array_equal(in_turn[0], history.xs[:12]) and np.array_equal(in_turn[1], history.Ps[:12])
    for k in range(1, 12):
        imu = history.imu(k)
        r_i, v_i, C_ib = slow_strapdown.propagate(state, imu, 0.0, 0.01, EARTH)
        Phi, Q = prediction.growth(constants_of(ALL), ALL, state, imu, 0.0, 0.01)
        x, P_step = prediction.advance(constants_of(ALL), x, t_s, P, imu, 0.0, 0.01)
        P = Phi @ P @ Phi.T + Q
        P = 0.5 * (P + P.T)
        clock = state.clock + np.array([0.01 * state.clock[1], 0.0])
        range_bias = state.range_bias * np.exp(-0.01 / CLOCK["range_bias_time_s"])
        gravity = state.gravity * np.exp(-0.01 / laws.FIELD_TIME_S)
        state = state._replace(
            r_i=r_i, v_i=v_i, q_ib=x[X_Q], clock=clock, range_bias=range_bias, gravity=gravity
        )
        assert np.abs(rotation.dcm_from_quat(x[X_Q]) - C_ib).max() < 1e-12
        t_s += 0.01
        state = state._replace(t_s=t_s)
        sigma = np.sqrt(np.diag(P))
        for found in (P_step, history[k].P):
            assert np.abs((found - P) / np.outer(sigma, sigma)).max() < 1e-9
            assert np.array_equal(found, found.T)
        for found in (x, history[k].x):
            np.testing.assert_allclose(found, pack(state), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(("begin_s", "end_s"), [(0.0, 0.01), (0.0013, 0.0087), (0.0041, 0.0049)])
def test_the_strapdown_does_what_its_equations_say(begin_s, end_s):
    """Cuts anywhere, errors of all kinds known, against the slow one."""
    state = state_with_errors(ALL.names)
    for k in (1, 10, 25):
        imu = window(BLOCKS[k], window(BLOCKS[k - 1]))
        r_i, v_i, C_ib = slow_strapdown.propagate(state, imu, begin_s, end_s, EARTH)
        found = propagate(state, imu, begin_s, end_s, EARTH)
        np.testing.assert_allclose(found[0], r_i, rtol=0.0, atol=4e-9)  # rounding of 6e6 m
        np.testing.assert_allclose(found[1], v_i, rtol=0.0, atol=1e-11)
        np.testing.assert_allclose(rotation.dcm_from_quat(found[2]), C_ib, rtol=0.0, atol=1e-13)


def test_noise_of_receiver_and_field_grows_as_said():
    """White frequency noise and random walk of it over 10 s, many steps against the closed form."""
    order, imu = layout(("clock", "range_bias", "gravity")), window(BLOCKS[0])
    state = NavState(0.0, *STATES[0][1:6])
    P, n = np.zeros((order.n, order.n)), 1000
    for _ in range(n):
        _, P = prediction.advance(constants_of(order), pack(state), 0.0, P, imu, 0.0, 0.01)
    T, white, walk = 10.0, CLOCK["clock_white"] ** 2, CLOCK["clock_walk"] ** 2
    c, r = order.places["clock"], order.places["range_bias"]
    expected = [[white * T + walk * T**3 / 3.0, walk * T**2 / 2.0], [walk * T**2 / 2.0, walk * T]]
    np.testing.assert_allclose(P[c, c], expected, rtol=1e-9)
    share = 1.0 - np.exp(-2.0 * T / CLOCK["range_bias_time_s"])
    np.testing.assert_allclose(np.diag(P)[r], CLOCK["range_bias_sigma"] ** 2 * share, rtol=1e-9)
    share = 1.0 - np.exp(-2.0 * T / laws.FIELD_TIME_S)
    np.testing.assert_allclose(
        np.diag(P)[order.places["gravity"]], CLOCK["gravity_error"] ** 2 * share, rtol=1e-9
    )


def measured_motion(state, order=ALL):
    """Rate and specific force for which sensors with the errors of `state` measure SPIN and FORCE."""
    of_rate, of_force = driven(order, state)

    def response(scale, misalignment):
        A = np.diag(1.0 + scale)
        A[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]] += misalignment
        return A

    gyro = response(state.gyro_scale, state.gyro_misalignment)
    gyro += np.outer(state.gyro_roll_column, [1.0, 0.0, 0.0])
    bias = state.accel_bias + VIBRATION**2 * state.accel_rectification
    accel = response(state.accel_scale, state.accel_misalignment)
    f_b = np.linalg.solve(accel, FORCE - of_force - bias)
    pull = state.gyro_g_sensitivity.reshape(3, 3) @ f_b
    return np.linalg.solve(gyro, SPIN - of_rate - state.gyro_bias - pull), f_b


@ORDERS
def test_the_sensors_are_inverted(order):
    state = state_with_errors(order.names)
    measured = np.concatenate([SPIN, FORCE]) * DT
    known = calibration.acting(pack(state), VIBRATION, drive_of(order))
    free = calibration.correct_increments(known, measured.reshape(1, 6), DT)[0] / DT
    omega_b, f_b = free[:3], free[3:]
    np.testing.assert_allclose(omega_b, measured_motion(state, order)[0], rtol=1e-12)
    np.testing.assert_allclose(f_b, measured_motion(state, order)[1], rtol=1e-12)


@ORDERS
def test_jacobians_of_the_corrected_motion(order):
    state = state_with_errors(order.names)
    here = measured_motion(state, order)
    J_omega, J_f = calibration.jacobians(order, pack(state), *here, VIBRATION, drive_of(order))
    for name, j, step in each_error(order):
        up = measured_motion(correct(order, state, unit(order, j, step)), order)
        down = measured_motion(correct(order, state, unit(order, j, -step)), order)
        for k, J in enumerate((J_omega, J_f)):
            slope = (up[k] - down[k]) / (2.0 * step)
            assert np.abs(slope - J[:, j]).max() <= 1e-6 * np.abs(J[:, j]).max() + 1e-14 / step, (name, j)


def antenna(state, order=ALL):
    """Position and velocity of the antenna in e when a fix of the state's time was really taken.

    From the motion of the point: constant rate and specific force, differences in time.
    """
    omega_b, f_b = measured_motion(state, order)
    a_i = measurements_gravity(state) + Rotation.from_quat(rotation.xyzw(state.q_ib)).apply(f_b)

    def place(dt):
        turned = Rotation.from_quat(rotation.xyzw(state.q_ib)) * Rotation.from_rotvec(omega_b * dt)
        r_i = state.r_i + state.v_i * dt + 0.5 * a_i * dt**2 + turned.apply(ARM + state.lever_arm)
        return frames.dcm_ie(EARTH, state.t_s + dt).T @ r_i

    at, h = -state.gps_latency[0], 1e-4
    return place(at), (place(at + h) - place(at - h)) / (2.0 * h)


def measurements_gravity(state):
    """Gravitation at a state, inertial axes."""
    from shefex_nav.environment.gravity import gravity_j2_e

    C_ie = frames.dcm_ie(EARTH, state.t_s)
    return C_ie @ gravity_j2_e(C_ie.T @ state.r_i)


def fixes_of(state, order=ALL):
    """What GPS and star tracker without noise measure."""
    r_e, v_e = antenna(state, order)
    gps = GpsFix(state.t_s, state.t_s, True, r_e, v_e, 4.0 * np.eye(3), 0.01 * np.eye(3), 9, 2.0, "")
    C_bc = rotation.dcm_from_rotvec(state.mounting) @ C_BC
    q_ic = rotation.quat_from_dcm(rotation.dcm_from_quat(state.q_ib) @ C_bc)
    P_c = np.diag([1e-4, 1e-4, 5e-4]) ** 2
    return gps, StarFix(0, state.t_s, state.t_s, 0, q_ic, P_c, None, None, 0.3, 12.0, 0.05, False, False)


def linearised(order, state, fixes):
    """(z, H, R) of position, velocity, attitude."""
    motion = np.concatenate(measured_motion(state, order))
    here = pack(state), state.t_s, EARTH, ARM, motion, VIBRATION, drive_of(order)
    a = measurements.antenna(order, *here)
    return (
        measurements.gps_position(fixes[0], a),
        measurements.gps_velocity(fixes[0], a),
        star_attitude(order, state, fixes[1], C_BC, 0.0),
    )


@ORDERS
def test_measurements_move_with_the_truth_as_their_jacobians_say(order):
    """truth = estimate (+) dx: the fix moves, differentiated from the motion of the antenna.

    Hence its rounding: 1e-9 m of 6e6 m, by 1e-4 s in the velocity. 20 us of latency: hardly any turn.
    """
    state = state_with_errors(order.names, 2e-5)
    here = linearised(order, state, fixes_of(state, order))
    for k, (z, H, _) in enumerate(here):
        assert np.abs(z).max() < (1e-8, 2e-4, 1e-14)[k]
        for name, j, step in each_error(order):
            up = linearised(order, state, fixes_of(correct(order, state, unit(order, j, step)), order))[k][0]
            down = linearised(order, state, fixes_of(correct(order, state, unit(order, j, -step)), order))[k][
                0
            ]
            rounding = (4e-9, 4e-5, 2e-15)[k] / step
            scale = np.abs(H[:, j]).max() if k < 2 else np.abs(H).max()
            assert np.abs((up - down) / (2.0 * step) - H[:, j]).max() <= 1e-6 * scale + rounding, (k, name, j)


@ORDERS
@pytest.mark.parametrize("latency_s", [2e-3, 0.1])
def test_jacobians_against_their_own_innovations(order, latency_s):
    """The estimate moves, the fix stays; without rounding of a differentiated position: to 1e-6.

    In the gravity gradient, which acts within a latency, the oblateness is left out.
    """
    state = state_with_errors(order.names, latency_s)
    left_out = 0.01 * wgs84.GM / np.linalg.norm(state.r_i) ** 3 * latency_s
    fixes = fixes_of(state, order)
    here = linearised(order, state, fixes)
    for name, j, step in each_error(order):
        up = linearised(order, correct(order, state, unit(order, j, step)), fixes)
        down = linearised(order, correct(order, state, unit(order, j, -step)), fixes)
        for k in (0, 1):
            slope, H = -(up[k][0] - down[k][0]) / (2.0 * step), here[k][1]
            scale, rounding = np.abs(H[:, order.places[name]]).max(), (2e-9, 1e-12)[k] / step
            rounding += left_out if name == "position" else 0.0
            assert np.abs(slope - H[:, j]).max() <= 1e-6 * scale + rounding, (k, name, j)


@pytest.mark.parametrize("name", [name for name in OPTIONAL if name != "gyro_roll_column"])
def test_every_block_alone_gives_numbers_whatever_the_memory_held(name):
    """Freed memory full of NaN before each call: nothing that was not written may be used."""
    order, imu = layout((name,)), window(BLOCKS[0])
    x, P = pack(state_with_errors((name,))), np.eye(order.n)
    for _ in range(5):
        held = [np.full(shape, np.nan) for shape in ((7, 3, 3, 3), (7, 2, 3, 3), (9, order.n), (9, 9))]
        del held
        _, after = prediction.advance(constants_of(order), x, 0.0, P, imu, 0.0, 0.01)
        assert np.all(np.isfinite(after))
