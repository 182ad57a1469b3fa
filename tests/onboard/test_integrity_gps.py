"""Repeated fixes and slow drift: what the rules call which."""

import numpy as np
import pytest
from scipy.special import chdtri

from shefex_nav.onboard.navigation import integrity_gps
from shefex_nav.records import GpsFix, GpsRanges

LIMIT = float(chdtri(3, integrity_gps.DRIFT_PROBABILITY))
BOTH = {"gps_position", "gps_velocity"}


def fix(t_s, r, v):
    r, v = np.array(r, dtype=float), np.array(v, dtype=float)
    return GpsFix(t_s, t_s + 0.2, True, r, v, np.eye(3), np.eye(3), 8, 2.0, "")


def here(t_s, r_e, v_e, sigma_v=0.0, sigma_a=0.0):
    return integrity_gps.InertialState(t_s, r_e, v_e, sigma_v, sigma_a)


def verdicts(*fixes, speed=100.0, acceleration=10.0):
    """Reasons of `repeated` for a vehicle that moves, by what the filter says."""
    memory, found = integrity_gps.memory(), []
    for one in fixes:
        r_e, v_e = np.array([[speed * one.t_valid_s, 0, 0], [acceleration * one.t_valid_s, 0, 0]])
        found.append(integrity_gps.repeated(memory, one, here(one.t_valid_s, r_e, v_e))[0])
    return found


def test_new_fixes_pass():
    assert verdicts(*(fix(t, [t, 0, 0], [1, 0, t]) for t in range(20))) == [{}] * 20


def test_a_frozen_position_takes_its_velocity_with_it():
    first = fix(0.0, [1, 2, 3], [4, 5, 6])
    found = verdicts(
        first, fix(1.0, [1, 2, 3], [4, 5, 7]), fix(2.0, [1, 2, 3], [4, 5, 6]), fix(3.0, [2, 2, 3], [1, 1, 1])
    )
    assert [set(one) for one in found] == [set(), BOTH, BOTH, set()]
    assert found[2]["gps_position"] == "frozen: position of T+0.0 s"


def test_a_frozen_velocity_leaves_the_position():
    found = verdicts(fix(0.0, [1, 2, 3], [4, 5, 6]), fix(1.0, [1, 2, 4], [4, 5, 6]))
    assert set(found[1]) == {"gps_velocity"}
    at_rest = verdicts(fix(0.0, [1, 2, 3], [0, 0, 0]), fix(1.0, [1, 2, 4], [0, 0, 0]))
    assert at_rest[1] == {}
    coarse = (fix(0.0, [1, 2, 3], [4, 5, 6]), fix(1.0, [1, 2, 4], [4, 5, 6]))
    assert verdicts(*coarse, acceleration=1.0)[1] == {}  # of a receiver with sigma 1 m/s
    assert set(verdicts(*coarse, acceleration=2.0)[1]) == {"gps_velocity"}


def test_a_velocity_that_stays_may_be_said_again():
    """Free of force at 7 km/s: what counts is the change of velocity, not the velocity; sigma 1 m/s."""
    memory = integrity_gps.memory()
    for t_s, change, frozen in ((0.0, 0.0, False), (1.0, 1.0, False), (2.0, 3.0, True)):
        v_e = np.array([7000.0 + change, 0.0, 0.0])
        there = here(t_s, 7000.0 * t_s * np.array([1.0, 0.0, 0.0]), v_e)
        reasons, _ = integrity_gps.repeated(memory, fix(t_s, [7000.0 * t_s, 0, 0], [7000, 0, 0]), there)
        assert (set(reasons) == {"gps_velocity"}) == frozen


def test_a_coarse_receiver_at_rest_may_repeat_itself():
    """It is used, but a hundred times the same says less than six times something new: sum of 1/k.

    A receiver that has frozen on the pad does so, too: its velocity is no news each time either.
    """
    memory, information, of_velocity = integrity_gps.memory(), 0.0, 0.0
    for k in range(100):
        place = np.array([0.001 * k, 0.0, 0.0])  # the filter wanders
        there = here(float(k), place, place)
        reasons, one = integrity_gps.repeated(memory, fix(float(k), [1, 2, 3], [0, 0, 0]), there)
        assert reasons == {}
        information += 1.0 / one.R_r_e[0, 0]
        of_velocity += 1.0 / one.R_v_e[0, 0]
    assert information == of_velocity == pytest.approx(np.sum(1.0 / np.arange(1, 101)))
    again, _ = integrity_gps.repeated(memory, fix(99.0, [1, 2, 3], [0, 0, 0]), there)
    assert set(again) == BOTH  # the last one once more, its time as well
    moved = here(100.0, np.array([1.9, 0.0, 0.0]), place)  # of sqrt(3) m
    gone, _ = integrity_gps.repeated(memory, fix(100.0, [1, 2, 3], [0, 0, 0]), moved)
    assert set(gone) == BOTH and gone["gps_position"].startswith("frozen")
    fast = here(100.0, place, np.array([0.0, 1.8, 0.0]))
    gone, _ = integrity_gps.repeated(memory, fix(100.0, [1, 2, 3], [0, 0, 0]), fast)
    assert set(gone) == BOTH and gone["gps_position"].startswith("frozen")


def test_another_velocity_at_the_same_place_counts_in_full():
    memory, nothing = integrity_gps.memory(), np.zeros(3)
    for k, times in enumerate([1, 1, 3, 1]):
        said = fix(float(k), [1, 2, 3], [0, 0, 0.1 if k in (1, 2) else 0.0])
        reasons, one = integrity_gps.repeated(memory, said, here(float(k), nothing, nothing))
        assert reasons == {} and one.R_v_e[0, 0] == times and one.R_r_e[0, 0] == k + 1


@pytest.mark.parametrize(
    ("sigma_v", "sigma_a", "moved", "rests"),
    [(0.0, 0.1, 14.0, True), (0.0, 0.1, 16.0, False), (0.5, 0.0, 14.0, True), (0.5, 0.0, 16.0, False)],
)
def test_inertial_sensors_that_stray_do_not_betray_a_receiver_at_rest(sigma_v, sigma_a, moved, rests):
    """Ten seconds: 3 sigma are 15 m, of 0.1 m/s^2 as of 0.5 m/s."""
    memory, nothing, strays = integrity_gps.memory(), np.zeros(3), (sigma_v, sigma_a)
    integrity_gps.repeated(memory, fix(0.0, [1, 2, 3], [0, 0, 0]), here(0.0, nothing, nothing, *strays))
    there = here(10.0, np.array([moved, 0.0, 0.0]), nothing)
    reasons, _ = integrity_gps.repeated(memory, fix(10.0, [1, 2, 3], [0, 0, 0]), there)
    assert (reasons == {}) == rests


def test_the_acceleration_of_a_level_unit_strays_by_tilt_and_bias():
    """Weight times the tilt about two axes, and the bias of three; ties between the two count."""
    P = np.zeros((15, 15))
    P[6:9, 6:9], P[12:15, 12:15] = 1e-4 * np.eye(3), 0.01 * np.eye(3)
    sigma_v, sigma_a = integrity_gps.sigmas(P, np.array([0.0, 0.0, 10.0]))
    assert sigma_a == pytest.approx(np.sqrt(2 * 0.01 + 3 * 0.01)) and sigma_v == 0.0
    P[6, 13] = P[13, 6] = -0.001  # tilt about x and bias of y, which weight cannot tell apart
    P[7, 12] = P[12, 7] = 0.001
    assert integrity_gps.sigmas(P, np.array([0.0, 0.0, 10.0]))[1] == pytest.approx(0.1)


def test_a_stale_fix_is_one_of_an_instant_that_was_here():
    """Whatever it says; a late one of an instant that was not is none."""
    found = verdicts(
        fix(0.0, [1, 2, 3], [4, 5, 6]), fix(2.0, [2, 2, 3], [4, 5, 7]), fix(1.0, [3, 2, 3], [4, 5, 8])
    )
    assert found[2] == {}
    found = verdicts(fix(0.0, [1, 2, 3], [4, 5, 6]), fix(0.0, [2, 2, 3], [4, 5, 7]))
    assert set(found[1]) == BOTH and found[1]["gps_position"].startswith("stale")


def test_ranges_repeat_like_fixes():
    def ranges(t_s, shift):
        n = np.ones(3)
        return GpsRanges(
            t_s, t_s, np.arange(3), 2e7 * n + shift, n + shift, np.ones((3, 3)), np.ones((3, 3)), n, n
        )

    found = verdicts(ranges(0.0, 0.0), ranges(1.0, 5.0), ranges(2.0, 0.0), fix(3.0, [1, 2, 3], [4, 5, 6]))
    assert [set(one) for one in found] == [set(), set(), {"gps_range", "gps_range_rate"}, set()]


def drift_found(slope, sigma, seconds, rng, gain=0.1):
    """Seconds until a drift (3,) m/s is suspected by a filter that takes over `gain` of every innovation."""
    drift, lag, S = integrity_gps.QUIET, np.zeros(3), sigma**2 * np.eye(3)
    for k in range(seconds):
        lag = (1.0 - gain) * lag + slope
        drift = integrity_gps.follow(drift, lag + sigma * rng.standard_normal(3), S, LIMIT)
        if drift.suspected:
            return k, drift, lag, S
    return None, drift, lag, S


def test_white_innovations_are_no_drift():
    """Twenty hours of a receiver with one fix a second."""
    found = drift_found(np.zeros(3), 2.0, 72000, np.random.default_rng(1))
    assert found[0] is None


@pytest.mark.parametrize("seed", range(5))
def test_a_drift_that_the_filter_follows_is_noticed(seed):
    """1 m/s with innovations of 2 m: the lag is 10 m in the end, five sigma."""
    k, drift, lag, S = drift_found(np.array([0.6, -0.8, 0.0]), 2.0, 120, np.random.default_rng(seed))
    assert k is not None and k < 20
    misled = np.linalg.norm((k + 1) * np.array([0.6, -0.8, 0.0]) - lag)
    assert misled < 3.0 * integrity_gps.followed(drift, S)  # what is admitted covers what was taken over


def test_the_means_have_the_variance_that_is_kept_with_them():
    """Over 4000 sequences of 25 white innovations: chi-square means of 3 within five sigma."""
    rng, statistics = np.random.default_rng(3), []
    for _ in range(4000):
        drift = integrity_gps.QUIET
        for z in rng.standard_normal((25, 3)):
            drift = integrity_gps.follow(drift, z, np.eye(3), LIMIT)
        statistics.append((drift.mean**2).sum(axis=1) / drift.variance)
    assert np.allclose(np.mean(statistics, axis=0), 3.0, atol=5.0 * np.sqrt(6.0 / 4000))


@pytest.mark.parametrize("lasting", [0.0, 0.5])
def test_a_drift_is_over_when_chance_explains_half_of_its_square(lasting):
    """Or when the mean is below one sigma of an innovation, where that is more."""
    a = 1.0 / np.array(integrity_gps.WINDOWS)
    variance = a / (2.0 - a)  # of a full window
    over = np.sqrt(max(0.5 * LIMIT * (variance[0] + lasting), 1.0))
    for share, still in ((0.99, False), (1.01, True)):
        z = share * over * np.array([0.6, 0.0, 0.8])
        drift = integrity_gps.Drift(np.tile(z, (2, 1)), variance, True)
        assert integrity_gps.follow(drift, z, np.eye(3), LIMIT, lasting).suspected == still
