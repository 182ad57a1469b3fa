"""The rate that drives scale factors of the gyros: noise teaches nothing, and a turn all that it shows."""

from types import SimpleNamespace

import numpy as np
import pytest
from navigation_flight import DT, EARTH, PARAMS, Q_0, R_0, V_0, alignment, star_fix
from plain import plain
from scipy import stats
from unpacked import propagate, window

from shefex_nav.onboard.navigation import fusion, momentary, prediction, process_noise
from shefex_nav.onboard.navigation.state import NavState
from shefex_nav.records import ImuBlock

WALK, SCALE = 6e-4, 5e-3  # rad/sqrt(s), sigma of the scale factors: consumer gyros
RUNS = 8
T = 4 * DT  # s, of a tick
NOISY = PARAMS._replace(
    imu=PARAMS.imu._replace(gyro_random_walk=WALK),
    states=("gyro_scale",),
    sigma_blocks={"gyro_scale": np.full(3, SCALE)},
    motors=np.zeros((0, 2)),
)
START = NavState(0.0, R_0, V_0, Q_0, *[np.zeros(3)] * 4)


def truth(rates):
    """Blocks and states of a fall that turns at each of the rates (n, 3) for a tick."""
    blocks, states, imu = [], [START], None
    for k, rate_b in enumerate(rates):
        t_s = (k + 1) * T
        block = ImuBlock(t_s, t_s, DT, np.tile(rate_b * DT, (4, 1)), np.zeros((4, 3)), False)
        imu = window(block, imu)
        r_i, v_i, q_ib = propagate(states[-1], imu, 0.0, T, EARTH)
        blocks.append(block)
        states.append(NavState(t_s, r_i, v_i, q_ib, *START[4:]))
    return blocks, states


def flown(rates, scale, rng):
    """Scale factors, truth minus estimate, and their sigma, after ten star fixes a second."""
    blocks, states = truth(rates)
    nav = fusion.start(NOISY, alignment(START, rng), EARTH)
    for block in blocks:
        noise = WALK * np.sqrt(DT) * rng.standard_normal((4, 3))
        fusion.advance(nav, block._replace(dtheta_b=(1.0 + scale) * block.dtheta_b + noise))
        if round(block.t_valid_s / T) % 10 == 0:
            fusion.fuse(nav, [("star_tracker", star_fix(blocks, states, block.t_valid_s, 0.0, rng))])
    place = nav.layout.places["gyro_scale"]
    return scale - nav.history[-1].state.gyro_scale, np.sqrt(np.diag(nav.history.P)[place])


def test_a_body_at_rest_under_the_stars_learns_no_scale_factor():
    rng = np.random.default_rng(4)
    for _ in range(4):
        error, sigma = flown(np.zeros((3000, 3)), np.zeros(3), rng)
        assert sigma.min() > 0.9 * SCALE
        assert np.abs(error / sigma).max() < 0.4  # as measured it was 0.3 to 1.2, on one side


@pytest.mark.parametrize("largest", [1.0, 4.0, 12.0, 60.0])
def test_a_turn_shows_the_scale_factors_at_any_rate(largest):
    """Rates that swing, up to so many sigmas of the noise of a tick: errors are as large as is said."""
    rng, z, t_s = np.random.default_rng(11), [], T * np.arange(2000)
    swing = np.sin(0.4 * t_s[:, None] + np.array([0.0, 2.0, 4.0]))
    for _ in range(RUNS):
        error, sigma = flown(largest * WALK / np.sqrt(T) * swing, SCALE * rng.standard_normal(3), rng)
        z.append(error / sigma)
    low, high = stats.chi2.ppf([1e-3, 1.0 - 1e-3], 3 * RUNS) / (3 * RUNS)
    assert low < np.mean(np.square(z)) < high


def followed(rates, sigma):
    """The rate that drives, of measured ones whose noise has a sigma in a tick."""
    row = SimpleNamespace(gyro_random_walk=sigma * np.sqrt(T))
    w, out, of_tick = rates[0], [], plain(process_noise.noise_of_rate)
    for rate in rates:
        w = rate - of_tick(row, momentary.NONE, 0.0, w, rate, T)
        out.append(w)
    return np.array(out)


def test_noise_moves_the_rate_that_drives_by_what_is_left_of_a_mean():
    rates = 2.0 * np.random.default_rng(2).standard_normal(30_000)
    wanted = 2.0 * np.sqrt(T / (2.0 * process_noise.FOLLOWS_S))
    assert followed(rates, 2.0)[1000:].std() == pytest.approx(wanted, rel=0.1)


def test_a_turn_is_followed_at_once_and_in_the_end_all_of_it():
    rates = np.where(np.arange(1000) < 200, 0.0, 100.0)
    driven = followed(rates, 2.0)
    np.testing.assert_allclose(driven[200], 100.0 - process_noise.BAND * 2.0)
    assert driven[-1] == pytest.approx(100.0, abs=0.01)
    assert np.abs(followed(1e3 * rates, 0.0) - 1e3 * rates).max() == 0.0


def test_rounding_and_swinging_at_rest_widen_the_band():
    """Of an angle with 3 mrad at either end of a tick."""
    row, errors = SimpleNamespace(gyro_random_walk=0.0), np.zeros((2, 3))
    for column in (momentary.ROUNDING, momentary.COAST):
        errors[:] = 0.0
        errors[momentary.ATTITUDE, column] = 3e-3**2
        noise = plain(process_noise.noise_of_rate)(row, errors, 0.0, 0.0, 100.0, T)
        assert noise == pytest.approx(process_noise.BAND * np.sqrt(2.0) * 3e-3 / T)


def test_a_tick_has_the_noise_of_its_own_axes_and_keeps_it():
    """More noise of one gyro, as of one that is not read, and of the accelerometers, which is none of it."""
    nav = fusion.start(NOISY, alignment(START), EARTH)
    for k in range(1, 4):
        rates = np.array([5.0, -7.0, 9.0]) if k == 3 else np.zeros(3)
        place = nav.history.make_room(4)
        nav.history.increments[place, 2:6] = np.tile(np.append(rates * DT, np.zeros(3)), (4, 1))
        nav.history.extra[place] = [[0.0, 4.0 * T, 0.0], [9.0, 9.0, 9.0], [0.0, 0.0, 0.0]]
        number, motors = nav.history.newest + 1, nav.params.motors
        prediction.enter(nav.constants, nav.history.arrays, number, motors, k * T, DT, 4)
        nav.history.extend([k * T])
    band = process_noise.BAND * WALK / np.sqrt(T)
    within = -7.0 * (1.0 - T / process_noise.FOLLOWS_S)  # of a band of 8 rad/s
    np.testing.assert_allclose(nav.history.imu(-1).rate_noise, [band, within, band], rtol=1e-9)


def test_noise_of_more_widens_the_band():
    """A gyro that is not read: its rate, put in its place, is no turn."""
    row = SimpleNamespace(gyro_random_walk=0.0)
    noise = plain(process_noise.noise_of_rate)(row, momentary.NONE, 25.0 * T, 0.0, 100.0, T)
    assert noise == pytest.approx(process_noise.BAND * 5.0)
