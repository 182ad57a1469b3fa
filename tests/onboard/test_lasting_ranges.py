"""Ranges whose errors last and have no state: a receiver that stands still, against drawn errors."""

import numpy as np
from navigation_flight import PARAMS, antenna_of
from scipy.stats import chi2
from test_nav_ranges import EARTH, LAYOUT, PRN, measured, state_of

from shefex_nav.onboard.navigation import measure_ranges, sensors
from shefex_nav.onboard.navigation.measurements import lasting_factor
from shefex_nav.onboard.navigation.state import layout

SIGMA, LASTS_S, EPOCHS = 1.5, 100.0, 250
OWN, SHARED = np.array([2.0, 1.5, 1.0, 2.5, 1.8]), np.array([1.2, 0.9, 0.6, 1.5, 1.0])  # m
WITHOUT = layout(("clock",))


MESSAGE = measured(state_of())._replace(sigma_lasting=OWN, sigma_shared=SHARED)


def linearised(order):
    state = state_of()
    antenna = antenna_of(order, state, EARTH, np.zeros(3), np.zeros(3), np.zeros(3), 0.0)
    return measure_ranges.pseudoranges(order, state, MESSAGE, antenna, SIGMA)


def test_errors_that_last_are_in_the_noise_with_what_satellites_share():
    """White noise of 1.5 m, as the receiver says; own errors, and one that all have."""
    wanted = np.diag(MESSAGE.sigma_range**2 + OWN**2) + np.outer(SHARED, SHARED)
    R = linearised(WITHOUT)[2]
    np.testing.assert_allclose(R, wanted, rtol=1e-12)
    more = measure_ranges.counted(MESSAGE, R, SIGMA, 7.0)
    np.testing.assert_allclose(more, wanted + 6.0 * (np.diag(OWN**2) + np.outer(SHARED, SHARED)), rtol=1e-12)
    np.testing.assert_allclose(linearised(LAYOUT)[2], np.diag(MESSAGE.sigma_range**2))  # they are states


def test_ranges_count_with_it_where_the_filter_has_no_states_for_it():
    for blocks, lasts, wanted in (({}, SIGMA, True), ({"range_bias": None}, SIGMA, False), ({}, 0.0, False)):
        given = PARAMS._replace(sigma_blocks=blocks, range_bias_sigma=lasts)
        assert (sensors.table(given)["gps_range"].counted is not None) == wanted


def stood_still(rng, counts):
    """Normalised square of the position's error after `EPOCHS` sets of ranges, a second apart."""
    _, H, R = linearised(WITHOUT)
    A = np.column_stack([H[:, :3], np.ones(len(PRN))])  # a clock that nobody knows from set to set
    r = np.exp(-1.0 / LASTS_S)
    own, shared = OWN * rng.standard_normal(len(PRN)), rng.standard_normal()
    information, weighted = np.zeros((3, 3)), np.zeros(3)
    for k in range(EPOCHS):
        z = own + SHARED * shared + MESSAGE.sigma_range * rng.standard_normal(len(PRN))
        factor = lasting_factor(1.0, LASTS_S, 1.0 if k else np.inf)
        W = np.linalg.inv(measure_ranges.counted(MESSAGE, R, SIGMA, factor) if counts else R)
        full, side = A.T @ W @ A, A.T @ W @ z
        information += full[:3, :3] - np.outer(full[:3, 3], full[3, :3]) / full[3, 3]
        weighted += side[:3] - full[:3, 3] * side[3] / full[3, 3]
        own = r * own + np.sqrt(1.0 - r**2) * OWN * rng.standard_normal(len(PRN))
        shared = r * shared + np.sqrt(1.0 - r**2) * rng.standard_normal()
    error = np.linalg.solve(information, weighted)
    return error @ information @ error


def test_a_position_of_many_such_ranges_is_as_good_as_it_says():
    """Mean of 60 against chi-square (99.9 %); taken for independent, they are too sure by far."""
    sums = {
        counts: sum(stood_still(np.random.default_rng(k), counts) for k in range(60))
        for counts in (True, False)
    }
    low, high = chi2.ppf([5e-4, 0.9995], 3 * 60)
    assert 0.6 * low < sums[True] < high and sums[False] > 5.0 * high, sums
