"""Pseudoranges and range rates in the filter: against inertial geometry, differences, and least squares."""

import numpy as np
import pytest
from navigation_flight import antenna_of as antenna_at
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from unpacked import correct, update

from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation import eskf, measure_ranges, measurements
from shefex_nav.onboard.navigation.state import ATT, OPTIONAL, POS, VEL, NavState, layout
from shefex_nav.records import GpsFix, GpsRanges

C = 299792458.0
EARTH = frames.EarthRotation(
    rotation.dcm_from_rotvec(np.array([1e-3, -2e-3, 5e-4])), np.eye(3), 2.5, 7.292115e-5
)
ARM = np.array([0.6, 0.05, -0.3])
SPIN, FORCE = np.array([9.4, 0.2, -0.1]), np.array([60.0, 1.0, -2.0])
LAYOUT = layout(("gyro_roll_column", "mounting", "lever_arm", "clock", "range_bias"))
STEP = np.concatenate(
    [
        np.repeat([1.0, 1e-2, 1e-5, 1e-4, 1e-2, 1e-5, 1e-5, 1e-2], 3),
        [1.0, 1e-2],
        np.ones(OPTIONAL["range_bias"]),
    ]
)
PRN = np.array([2, 5, 9, 17, 30])


def state_of(seed=7, t_s=123.4):
    rng = np.random.default_rng(seed)
    return NavState(
        t_s=t_s,
        r_i=np.array([2.1e6, 0.6e6, 6.0e6]),
        v_i=np.array([1500.0, -900.0, 700.0]),
        q_ib=rotation.quat_normalise(rng.standard_normal(4)),
        gyro_bias=1e-4 * rng.standard_normal(3),
        accel_bias=0.01 * rng.standard_normal(3),
        gyro_roll_column=3e-4 * rng.standard_normal(3),
        lever_arm=0.02 * rng.standard_normal(3),
        clock=np.array([4e4, 70.0]),
        range_bias=2.0 * rng.standard_normal(OPTIONAL["range_bias"]),
    )


def true_rate(state):
    """Rate for which gyros with the errors of `state` measure SPIN."""
    response = np.eye(3) + np.outer(state.gyro_roll_column, [1.0, 0.0, 0.0])
    return np.linalg.solve(response, SPIN - state.gyro_bias)


def satellite_i(k, t_s):
    """Position of satellite k in inertial axes: a circle of its own, seen by the receiver."""
    rng = np.random.default_rng(100 + k)
    up = np.array([2.1e6, 0.6e6, 6.0e6]) / 6.4e6
    u = up + 0.8 * rng.standard_normal(3)
    u /= np.linalg.norm(u)
    w = np.cross(u, rng.standard_normal(3))
    w /= np.linalg.norm(w)
    angle = 1.4585e-4 * (t_s - 123.4)
    return 26.56e6 * (np.cos(angle) * u + np.sin(angle) * w)


def antenna_i(state, dt):
    """Antenna in inertial axes dt after the state, under its velocity and rate."""
    turned = Rotation.from_quat(rotation.xyzw(state.q_ib)) * Rotation.from_rotvec(true_rate(state) * dt)
    return state.r_i + state.v_i * dt + turned.apply(ARM + state.lever_arm)


def light(k, state, dt):
    """Distance that the light received dt after the state has come, and when it left."""
    tau = 0.07
    for _ in range(8):
        rho = np.linalg.norm(satellite_i(k, state.t_s + dt - tau) - antenna_i(state, dt))
        tau = rho / C
    return rho, state.t_s + dt - tau


def measured(state, repeat=None):
    """GpsRanges without noise, from light time in inertial axes and differences in time."""
    h, rows = 0.05, []
    for k, prn in enumerate(PRN):
        rho, sent_s = light(k, state, 0.0)
        rate = (light(k, state, h)[0] - light(k, state, -h)[0]) / (2.0 * h)
        r_i = satellite_i(k, sent_s)
        v_i = (satellite_i(k, sent_s + 0.5) - satellite_i(k, sent_s - 0.5)) / 1.0
        r_e, v_e = frames.ecef_from_inertial(EARTH, state.t_s, r_i, v_i)
        rows.append((rho + state.clock[0] + state.range_bias[prn - 1], rate + state.clock[1], r_e, v_e))
    pseudorange, rate, r_e, v_e = (np.array(column) for column in zip(*rows, strict=True))
    n = len(PRN)
    return GpsRanges(
        state.t_s, state.t_s, PRN, pseudorange, rate, r_e, v_e, np.full(n, 1.5), np.full(n, 0.05)
    )


def antenna_of(order, state):
    return antenna_at(order, state, EARTH, ARM, true_rate(state), FORCE, 0.0)


def ranges_of(state, message):
    return measure_ranges.pseudoranges(LAYOUT, state, message, antenna_of(LAYOUT, state))


def rates_of(state, message):
    return measure_ranges.range_rates(LAYOUT, state, message, antenna_of(LAYOUT, state))


def test_a_swing_of_the_antenna_shows_in_all_satellites_by_the_rows_of_the_velocity():
    """By those rows its noise goes into that of the range rates (`arm_in_velocity`); linear to 1e-6."""
    state = state_of()
    message = measured(state)
    z, H, _ = rates_of(state, message)
    swings = 0.3 * np.random.default_rng(5).standard_normal((200, 3))
    moved = [z - rates_of(state._replace(v_i=state.v_i + dv), message)[0] for dv in swings]
    np.testing.assert_allclose(moved, swings @ H[:, VEL].T, rtol=1e-5, atol=1e-7)


def test_innovation_of_perfect_ranges_is_zero():
    """Rates: the third derivative of a spinning antenna's distance, over (50 ms)^2/6."""
    state = state_of()
    message = measured(state._replace(gyro_bias=SPIN, gyro_roll_column=np.zeros(3)))  # it does not turn
    still = state._replace(gyro_bias=SPIN, gyro_roll_column=np.zeros(3))
    assert np.abs(ranges_of(still, message)[0]).max() < 1e-6
    assert np.abs(rates_of(still, message)[0]).max() < 1e-5


@pytest.mark.parametrize("model", [ranges_of, rates_of])
def test_jacobian_is_the_derivative_of_the_innovation(model):
    """The estimate moves, the measurement stays: every column to 1e-6 of the largest element of its block."""
    state = state_of()
    message = measured(state)
    _, H, R = model(state, message)
    assert H.shape == (len(PRN), LAYOUT.n) and R.shape == (len(PRN), len(PRN))

    def innovation(dx):
        return model(correct(LAYOUT, state, dx), message)[0]

    for j in range(LAYOUT.n):
        dx = np.zeros(LAYOUT.n)
        dx[j] = STEP[j]
        slope = -(innovation(dx) - innovation(-dx)) / (2.0 * STEP[j])
        # rounding of 2.6e7 m (4e-9 m) by the step; of rates 4e-13 of 1e4 m/s
        rounding = (1e-11 if model is rates_of else 1e-8) / STEP[j]
        assert np.abs(slope - H[:, j]).max() <= 1e-6 * np.abs(H[:, j]).max() + rounding, j


def test_what_a_channel_sees():
    """A range: line of sight, clock, its own satellite. A rate: the same of velocity and drift."""
    state = state_of()
    message = measured(state)
    _, H, R = ranges_of(state, message)
    np.testing.assert_allclose(np.linalg.norm(H[:, POS], axis=1), 1.0)
    np.testing.assert_array_equal(H[:, LAYOUT.places["clock"]], np.tile([1.0, 0.0], (5, 1)))
    slots = H[:, LAYOUT.places["range_bias"]]
    assert slots.sum() == 5.0 and np.all(slots[np.arange(5), PRN - 1] == 1.0)
    np.testing.assert_allclose(np.diag(R), 1.5**2)
    _, H_rate, _ = rates_of(state, message)
    np.testing.assert_array_equal(H_rate[:, LAYOUT.places["clock"]], np.tile([0.0, 1.0], (5, 1)))
    np.testing.assert_allclose(H_rate[:, VEL], H[:, POS], atol=1e-4)
    assert np.all(H_rate[:, LAYOUT.places["range_bias"]] == 0.0)
    assert np.abs(H_rate[:, ATT]).max() > 0.5  # the antenna swings with 6 m/s


def test_without_its_state_an_error_that_lasts_is_noise():
    plain = layout(("gyro_roll_column", "mounting", "clock"))
    state = state_of()._replace(range_bias=np.zeros(OPTIONAL["range_bias"]))
    message = measured(state)
    _, H, R = measure_ranges.pseudoranges(plain, state, message, antenna_of(plain, state), 2.0)
    assert H.shape == (5, plain.n)
    np.testing.assert_allclose(np.diag(R), 1.5**2 + 2.0**2)
    beyond = message._replace(prn=np.array([2, 5, 9, 17, 40]))  # no state for the last one
    _, H, R = measure_ranges.pseudoranges(LAYOUT, state, beyond, antenna_of(LAYOUT, state), 2.0)
    np.testing.assert_allclose(np.diag(R), [1.5**2] * 4 + [1.5**2 + 2.0**2])
    assert H[:, LAYOUT.places["range_bias"]].sum() == 4.0


OWN, SHARED = np.array([0.8, 3.0, 0.5, 1.5, 6.0]), np.array([0.6, 5.0, 0.1, 2.0, 4.0])  # m


def told(message):
    return message._replace(sigma_lasting=OWN, sigma_shared=SHARED)


def test_a_receiver_says_how_large_the_errors_that_last_are():
    """Each satellite's own, and what all share: of states of 2 m or of noise, the same covariance."""
    state, plain = state_of(), layout(("gyro_roll_column", "mounting", "clock"))
    message = told(measured(state))
    z, H, R = measure_ranges.pseudoranges(LAYOUT, state, message, antenna_of(LAYOUT, state), 2.0)
    block = H[:, LAYOUT.places["range_bias"]]
    expected = np.diag(OWN**2) + np.outer(SHARED, SHARED)
    np.testing.assert_allclose(2.0**2 * block @ block.T, expected, atol=1e-12)
    np.testing.assert_allclose(R, 1.5**2 * np.eye(5))
    moved = state.range_bias[PRN - 1] * (OWN / 2.0 - 1.0) + state.range_bias[-1] * SHARED / 2.0
    untold = measure_ranges.pseudoranges(LAYOUT, state, measured(state), antenna_of(LAYOUT, state), 2.0)
    np.testing.assert_allclose(z, untold[0] - moved, atol=1e-7)
    _, _, R = measure_ranges.pseudoranges(plain, state, message, antenna_of(plain, state), 2.0)
    np.testing.assert_allclose(R, 1.5**2 * np.eye(5) + expected)


def test_jacobian_with_what_the_receiver_says():
    def model(state, message):
        return measure_ranges.pseudoranges(LAYOUT, state, told(message), antenna_of(LAYOUT, state), 2.0)

    test_jacobian_is_the_derivative_of_the_innovation(model)


def prior(tight):
    """Covariance of a filter that knows 100 m and 1 m/s, and nothing of the clock."""
    sigma = np.repeat([100.0, 1.0, 1e-3, 1e-6, 1e-3, 1e-5, 1e-4], 3)
    return np.diag(np.concatenate([sigma, [3e5, 300.0]]) ** 2) if tight else np.diag(sigma**2)


def test_five_ranges_are_worth_the_fix_that_is_made_of_them():
    """Tight with an unknown clock = loose with the least-squares fix and its covariance."""
    rng = np.random.default_rng(5)
    plain, with_clock = layout(), layout(("gyro_roll_column", "mounting", "clock"))
    truth = state_of()._replace(range_bias=np.zeros(OPTIONAL["range_bias"]), lever_arm=np.zeros(3))
    message = measured(truth)
    noise = 1.5 * rng.standard_normal(5)
    message = message._replace(pseudorange=message.pseudorange + noise)
    dx = np.zeros(with_clock.n)
    dx[POS] = [40.0, -60.0, 30.0]
    state = correct(with_clock, truth, dx)._replace(clock=np.zeros(2))
    a = antenna_of(plain, truth)
    H = np.column_stack([-measure_ranges.lines_of_sight(message, a.r_e)[1], np.ones(5)])
    cofactor = np.linalg.inv(H.T @ H)
    r_e, R = a.r_e + (cofactor @ H.T @ noise)[:3], 1.5**2 * cofactor[:3, :3]
    fix = GpsFix(truth.t_s, truth.t_s, True, r_e, np.zeros(3), R, np.eye(3), 5, 2.0, "")
    tight = update(
        eskf.engine(with_clock), with_clock, state, prior(True),
        *measure_ranges.pseudoranges(with_clock, state, message, antenna_of(with_clock, state)),
    )  # fmt: skip
    loose = update(
        eskf.engine(plain), plain, state, prior(False),
        *measurements.gps_position(fix, antenna_of(plain, state)),
    )  # fmt: skip
    # lines of sight from 80 m off bend by 4e-6: 0.3 mm; rounding of a clock unknown to 300 km
    np.testing.assert_allclose(tight.state.r_i, loose.state.r_i, atol=5e-3)
    np.testing.assert_allclose(tight.P[POS, POS], loose.P[POS, POS], rtol=1e-3, atol=1e-3)
    assert tight.state.clock[0] == pytest.approx(truth.clock[0], abs=10.0)


def test_two_satellites_say_their_difference_whatever_the_clock():
    """Along u1 - u2 the error falls to the noise of the difference; across it nothing is learned."""
    order = layout(("gyro_roll_column", "mounting", "clock"))
    state = state_of()._replace(range_bias=np.zeros(OPTIONAL["range_bias"]), lever_arm=np.zeros(3))
    message = measured(state)
    two = GpsRanges(*(field[:2] if isinstance(field, np.ndarray) else field for field in message))
    z, H, R = measure_ranges.pseudoranges(order, state, two, antenna_of(order, state))
    P = update(eskf.engine(order), order, state, prior(True), z, H, R).P[POS, POS]
    apart = H[0, POS] - H[1, POS]
    along = apart / np.linalg.norm(apart)
    expected = 1.0 / (1.0 / 100.0**2 + (apart @ apart) / (2.0 * 1.5**2))
    assert along @ P @ along == pytest.approx(expected, rel=2e-3)
    across = np.linalg.svd(along[None])[2][1:]
    np.testing.assert_allclose(across @ P @ across.T, 100.0**2 * np.eye(2), rtol=1e-2, atol=10.0)


def test_ranges_agree_if_they_moved_as_they_say():
    now, later = measured(state_of(t_s=123.4)), measured(state_of(t_s=124.4))
    # the same state a second later, so nothing but the satellites' motion and the noted rates fit together
    honest = now._replace(
        t_valid_s=124.4, pseudorange=now.pseudorange + now.range_rate, range_rate=now.range_rate
    )
    assert measure_ranges.ranges_agree(now, honest, 20.0)
    assert not measure_ranges.ranges_agree(now, now._replace(t_valid_s=124.4), 20.0)  # a set repeated
    jumped = honest._replace(pseudorange=honest.pseudorange + 200.0 * (honest.prn == 9))
    assert not measure_ranges.ranges_agree(now, jumped, 20.0)
    few = GpsRanges(*(field[:3] if isinstance(field, np.ndarray) else field for field in honest))
    assert not measure_ranges.ranges_agree(now, few, 20.0)
    assert not measure_ranges.ranges_agree(now, honest._replace(t_valid_s=130.0), 20.0)
    assert later.t_valid_s == 124.4


def test_gate_of_a_row_is_that_of_one_degree_of_freedom():
    """4000 draws of one epoch from the filter's own covariance: each row normalised has its chi-square."""
    rng = np.random.default_rng(9)
    state = state_of()
    _, H, R = ranges_of(state, measured(state))
    P = np.diag(np.concatenate([STEP[:24] ** 2, [25.0, 1.0], np.ones(OPTIONAL["range_bias"])]))
    S = H @ P @ H.T + R
    z = np.linalg.cholesky(S) @ rng.standard_normal((5, 4000))
    share = np.mean(z**2 / np.diag(S)[:, None] > chi2.isf(0.01, 1))
    assert share == pytest.approx(0.01, abs=0.003)
