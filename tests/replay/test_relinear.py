"""A filter about a given trajectory: against the equations that are not linear, and against itself."""

import numpy as np
import pytest
import slow_relinear as relinear
from navigation_flight import EARTH, PARAMS, alignment, antenna_of, fly, gps_fix, star_fix, state_at
from unpacked import correct, propagate, star_attitude, window

from shefex_nav.onboard.navigation import fusion, measurements
from shefex_nav.onboard.navigation.state import ATT, corrected, layout, pack, unpack

DEG = np.pi / 180.0
FLIGHT = fly(3.0)
BLOCKS = ("gyro_scale", "gyro_misalignment", "gyro_g_sensitivity", "accel_scale", "mounting")
SIGMA = {
    "gyro_scale": np.full(3, 1e-4),
    "gyro_misalignment": np.full(6, 1e-4),
    "gyro_g_sensitivity": np.full(9, 1e-6),
    "accel_scale": np.full(3, 3e-4),
    "mounting": np.full(3, 1e-3),
}


@pytest.fixture(scope="module")
def nav():
    params = PARAMS._replace(states=BLOCKS, sigma_blocks=SIGMA)
    return fusion.start(params, alignment(FLIGHT[1][0]), EARTH)


@pytest.fixture(scope="module")
def sigma(nav):
    """Of every error at the start: (n,)."""
    return np.sqrt(np.diag(nav.history.P))


def test_difference_undoes_correct(nav, sigma):
    rng = np.random.default_rng(1)
    state, e = FLIGHT[1][0], sigma * rng.standard_normal(nav.layout.n)
    e[ATT] = [0.3, -1.0, 0.7]
    found = relinear.difference(nav.layout, pack(state), pack(correct(nav.layout, state, e)))
    assert np.allclose(found, e, rtol=1e-12, atol=2e-9)  # metres of 6e6 m


def way(x, k=120):
    """Way through a tick, and the ImuWindow."""
    imu = window(FLIGHT[0][k], window(FLIGHT[0][k - 1]), 0.0)
    return relinear.Way(imu.t_end_s - imu.length_s, imu.t_end_s, imu, x), imu


def flown(nav, x, t_s, imu):
    """Packed nominal values after a tick, the equations as they are."""
    state = unpack(t_s, x)
    r_i, v_i, q_ib = propagate(state, imu, 0.0, imu.length_s, EARTH)
    return pack(state._replace(r_i=r_i, v_i=v_i, q_ib=q_ib))


def test_mean_goes_as_the_truth_does_where_the_trajectory_is_far_from_a_flight(nav, sigma):
    """The trajectory leaps by degrees and metres between two instants; errors about it are small."""
    rng, n = np.random.default_rng(2), nav.layout.n
    x = pack(FLIGHT[1][120])
    leap = 100.0 * sigma * rng.standard_normal(n)
    leap[ATT] = [0.02, -0.05, 0.03]
    step, imu = way(x)
    truth = corrected(x, mean := 1e-2 * sigma * rng.standard_normal(n), nav.layout.nominal)
    there = flown(nav, truth, step.t_begin_s, imu)
    y = corrected(there, leap, nav.layout.nominal)
    before = relinear.Filtered(mean, nav.history.P)
    after = relinear.follow(nav, before, x, step._replace(x=y))
    e = relinear.difference(nav.layout, y, there)
    assert np.allclose(e[ATT], -leap[ATT], rtol=1e-9)
    assert np.abs((after.mean - e) / sigma).max() < 1e-3
    # the leap turns the errors as it turns the axes: their size is what it was
    still = relinear.follow(nav, before, x, step._replace(x=there))
    assert np.allclose(
        np.linalg.eigvalsh(after.P[ATT, ATT]), np.linalg.eigvalsh(still.P[ATT, ATT]), rtol=4e-3
    )


def kept(sensor, fix, state, then, z, H, R):
    """Seen as the first pass kept it, linear about `then`; x: the trajectory."""
    star = fix if sensor == "star_tracker" else None
    return relinear.Seen(pack(then), z, H, R, None, (), star, pack(state))


@pytest.mark.parametrize("sensor", ["gps_position", "gps_velocity", "star_tracker"])
def test_measurement_about_another_estimate(nav, sensor):
    """What was linear about an estimate off by a degree and 50 m, against the measurement itself there."""
    t_s = 1.2
    truth, omega_b = state_at(*FLIGHT, t_s)
    rng, f_b = np.random.default_rng(3), np.array([60.0, 1.2, 0.0])
    e = np.zeros(nav.layout.n)
    e[:9] = np.concatenate(
        [50.0 * rng.standard_normal(3), 2.0 * rng.standard_normal(3), [0.017, -2e-3, 3e-3]]
    )
    then = correct(nav.layout, truth, e)

    def rows(state):
        if sensor == "star_tracker":
            fix = star_fix(*FLIGHT, t_s, 0.0)
            return fix, *star_attitude(nav.layout, state, fix, PARAMS.C_bc, 0.0)
        fix = gps_fix(*FLIGHT, t_s, 0.0)
        antenna = antenna_of(nav.layout, state, EARTH, PARAMS.l_ba_b, omega_b, f_b, 0.0)
        return fix, *getattr(measurements, sensor)(fix, antenna)

    fix, z, H, R = rows(then)
    _, z_there, H_there, R_there = rows(truth)
    found = relinear._rows(nav, kept(sensor, fix, truth, then, z, H, R))
    tolerance = {"gps_position": 2e-3, "gps_velocity": 3e-4, "star_tracker": 1e-12}[sensor]
    assert np.abs(found[0] - z_there).max() < tolerance  # arms of 0.6 m, 3 rad/s; gradients of gravity
    assert np.abs(found[1][:, :9] - H_there[:, :9]).max() < 0.03  # of an arm of 0.6 m, seen from 1 deg aside
    assert np.allclose(found[2], R_there, rtol=1e-12)


def test_about_its_own_estimates_it_is_the_filter(nav):
    """Every step of a filter with GPS and stars, about the filter's own path: mean and P are the filter's."""
    rng, steps = np.random.default_rng(4), []
    state = correct(nav.layout, FLIGHT[1][0], np.zeros(nav.layout.n))
    running = fusion.start(nav.params, alignment(state, sigma_deg=0.02), EARTH, recorder=steps.append)
    for k, block in enumerate(FLIGHT[0]):
        fusion.advance(running, block)
        if k == 150:
            fusion.fuse(running, [("gps", gps_fix(*FLIGHT, 1.437, 0.0, rng))])
    fusion.finish(running)
    first = fusion.start(nav.params, alignment(state, sigma_deg=0.02), EARTH)
    x, filtered = relinear.origin(first, first.history[0], np.zeros(nav.layout.n))
    for step in steps:
        seen = relinear.step_of(step, pack(step.state_after))
        filtered, x = relinear.follow(first, filtered, x, seen), seen.x
        scale = np.sqrt(np.diag(step.P_after))
        assert np.abs((filtered.P - step.P_after) / np.outer(scale, scale)).max() < 1e-7
        assert np.abs(filtered.mean / scale).max() < 1e-6, type(step)
    assert sum(type(step) is fusion.Correction for step in steps) == 2


def test_what_was_forgotten_is_anything_about_what_the_filter_held(nav, sigma):
    """A reset: ties are cut, and the error is that of the first pass's estimate, not of the trajectory."""
    order, rng = layout(BLOCKS), np.random.default_rng(5)
    block = order.places["mounting"]
    x = pack(FLIGHT[1][0])
    P = np.diag(sigma**2) + 0.3 * np.outer(sigma, sigma)
    e = np.zeros(order.n)
    e[block] = [1e-3, -2e-3, 0.5e-3]
    P_forgotten = np.eye(order.n)
    nothing = np.empty(0), np.empty((0, order.n)), np.empty((0, 0))
    seen = relinear.Seen(corrected(x, e, order.nominal), *nothing, P_forgotten, (block,), None, x)
    mean = sigma * rng.standard_normal(order.n)
    after = relinear.follow(nav, relinear.Filtered(mean, P), x, seen)
    others = np.delete(np.arange(order.n), np.arange(block.start, block.stop))
    assert np.array_equal(after.P[block, block], np.eye(3)) and not after.P[block][:, others].any()
    assert np.allclose(after.mean[block], e[block], rtol=1e-9)
    assert np.allclose(after.mean[others], mean[others])
    assert np.allclose(after.P[others][:, others], P[others][:, others])


def test_noise_that_was_added_is_added(nav, sigma):
    order = nav.layout
    x, more = pack(FLIGHT[1][0]), np.diag(np.arange(order.n) * 1e-3)
    nothing = np.empty(0), np.empty((0, order.n)), np.empty((0, 0))
    seen = relinear.Seen(x, *nothing, more, (), None, x)
    after = relinear.follow(nav, relinear.Filtered(sigma, np.diag(sigma**2)), x, seen)
    assert np.allclose(after.P, np.diag(sigma**2) + more, rtol=1e-14)
    assert np.allclose(after.mean, sigma, rtol=1e-12)
