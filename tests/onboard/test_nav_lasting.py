"""Errors of position fixes that last: what a filter without states for them makes of fix after fix."""

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS, alignment, fly, gps_fix

from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.measurements import lasting_factor

WHITE, LASTING, SPEED_NOISE, ACCELERATION = 3.0, 3.0, 0.1, 5e-4  # m, m, m/s, m/s^2/sqrt(Hz)
SHARE = LASTING**2 / (WHITE**2 + LASTING**2)
GAP = range(150, 250)  # s without fixes


def statistics(time_s, share, n=4000, seconds=300):
    """RMS errors over what P says, (k, 2), of n filters along a line: position and velocity fixes at 1 Hz."""
    rng, r = np.random.default_rng(1), np.exp(-1.0 / time_s)
    bias, P = LASTING * rng.standard_normal(n), np.diag([3.0**2, 0.05**2])
    error = rng.standard_normal((n, 2)) * np.sqrt(np.diag(P))  # truth minus estimate
    F, last, found = np.array([[1.0, 1.0], [0.0, 1.0]]), -np.inf, []
    Q = ACCELERATION**2 * np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    for k in range(seconds):
        error = error @ F.T + rng.standard_normal((n, 2)) @ np.linalg.cholesky(Q).T
        bias = r * bias + LASTING * np.sqrt(1 - r * r) * rng.standard_normal(n)
        P = F @ P @ F.T + Q
        if k in GAP:
            continue
        R = (WHITE**2 + LASTING**2) * lasting_factor(share, time_s, k - last)
        last = k
        for j, variance in ((0, R), (1, SPEED_NOISE**2)):
            noise = bias + WHITE * rng.standard_normal(n) if j == 0 else SPEED_NOISE * rng.standard_normal(n)
            K = P[:, j] / (P[j, j] + variance)
            error = error - (error[:, j] + noise)[:, None] * K
            P = P - np.outer(K, K) * (P[j, j] + variance)
        found.append(error.std(axis=0) / np.sqrt(np.diag(P)))
    return np.array(found)


@pytest.mark.parametrize("time_s", [10.0, 30.0, 300.0, 3000.0])
def test_the_factor_makes_the_covariance_right(time_s):
    """4000 flights of 300 s, with a gap of 100 s: position and velocity errors within 15 % of their sigma."""
    ratio = statistics(time_s, SHARE)
    assert np.abs(ratio - 1.0).max() < 0.15
    assert statistics(time_s, 0.0)[:, 0].max() > 2.0  # as if fixes were independent: far too sure


def test_without_lasting_errors_and_after_a_long_gap_a_fix_counts_in_full():
    assert lasting_factor(0.0, 300.0, 1.0) == 1.0
    assert lasting_factor(0.5, 300.0, np.inf) == 1.0
    assert lasting_factor(0.5, 300.0, 3000.0) == pytest.approx(1.0, abs=1e-4)
    assert lasting_factor(1.0, 300.0, 1.0) == pytest.approx(600.0, rel=1e-3)  # 2 time/gap


def test_the_filter_takes_fixes_for_as_good_as_they_are():
    """What is recorded of the updates: the first in full, the next with the factor."""
    blocks, states = fly(5.0)
    params, kept = PARAMS._replace(lasting_share=0.4, range_bias_time_s=60.0), []
    nav = fusion.start(params, alignment(states[0]), EARTH, recorder=kept.append)
    waiting = [gps_fix(blocks, states, t_s, 0.2) for t_s in (4.0, 2.0, 1.0)]
    for block in blocks:
        fusion.advance(nav, block)
        if waiting and waiting[-1].t_available_s <= block.t_valid_s + 1e-6:
            fusion.fuse(nav, [("gps", waiting.pop())])
    fusion.finish(nav)
    used = [one for one in kept if isinstance(one, fusion.Correction)]
    factors = [one.R[0, 0] / one.fix.R_r_e[0, 0] for one in used if one.sensor == "gps_position"]
    expected = [1.0, lasting_factor(0.4, 60.0, 1.0), lasting_factor(0.4, 60.0, 2.0)]
    assert factors == pytest.approx(expected) and expected[1] > 40.0
