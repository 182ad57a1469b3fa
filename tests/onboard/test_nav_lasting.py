"""Errors of position fixes that last: what a filter without states for them makes of fix after fix."""

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS, SIGMA_V, alignment, fly, gps_fix
from scipy.special import chdtri

from shefex_nav.onboard.navigation import fusion, integrity_gps
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.measurements import lasting_factor
from shefex_nav.onboard.navigation.state import POS

WHITE, LASTING, SPEED_NOISE, ACCELERATION = 3.0, 3.0, 0.1, 5e-4  # m, m, m/s, m/s^2/sqrt(Hz)
SHARE = LASTING**2 / (WHITE**2 + LASTING**2)
GAP = range(150, 250)  # s without fixes
SHARE_OF_FIXES, TIME_S = 0.4, 60.0  # of the fixes that the filter is given
BLOCKS, STATES = fly(6.0)


def factor(gap_s):
    return lasting_factor(SHARE_OF_FIXES, TIME_S, gap_s)


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


def factors_of(fixes, until_s=5.0):
    """Factors with which position fixes were used, in order of their instants, and the filter."""
    params, kept = PARAMS._replace(lasting_share=SHARE_OF_FIXES, range_bias_time_s=TIME_S), []
    nav = fusion.start(params, alignment(STATES[0]), EARTH, recorder=kept.append)
    waiting = sorted(fixes, key=lambda fix: -fix.t_available_s)
    for block in BLOCKS[: round(until_s * 100)]:
        fusion.advance(nav, block)
        while waiting and waiting[-1].t_available_s <= block.t_valid_s + 1e-6:
            fusion.fuse(nav, [("gps", waiting.pop())])
    fusion.finish(nav)
    used = [one for one in kept if isinstance(one, fusion.Correction) and one.sensor == "gps_position"]
    return [one.R[0, 0] / one.fix.R_r_e[0, 0] for one in used], kept, nav


def fix_at(t_s, delay_s=0.2):
    return gps_fix(BLOCKS, STATES, t_s, delay_s)


def test_the_filter_takes_fixes_for_as_good_as_they_are():
    """What is recorded of the updates: the first in full, the next with the factor."""
    factors, _, _ = factors_of([fix_at(t_s) for t_s in (1.0, 2.0, 4.0)])
    expected = [1.0, factor(1.0), factor(2.0)]
    assert factors == pytest.approx(expected) and expected[1] > 40.0


def test_the_order_of_arrival_does_not_matter():
    """Fixes of 1.0, 1.2 and 1.4 s, the second the last to come: gaps of 0.2 s as if it had come in time."""
    factors, _, _ = factors_of([fix_at(1.0), fix_at(1.2, 0.5), fix_at(1.4, 0.1), fix_at(3.0, 0.0)])
    assert factors == pytest.approx([1.0, factor(0.2), factor(0.2), factor(1.6)])


def test_fixes_that_are_refused_count_for_nothing():
    """Three that are 1 km off between 1 s and 5 s: for the good one at 5 s the last was that of 1 s."""
    wrong = [fix_at(t_s)._replace(r_ea_e=fix_at(t_s).r_ea_e + 1000.0) for t_s in (2.0, 3.0, 4.0)]
    factors, _, nav = factors_of([fix_at(1.0), *wrong, fix_at(5.0)], 6.0)
    assert factors == pytest.approx([1.0, factor(4.0)]) and nav.health["gps_position"].used == 2


def test_errors_that_last_are_no_drift():
    """100 flights of 500 s, a share of 0.5 or 0.7 of the variance lasting 300 s: not one is called a drift.

    Judged as if innovations were white, more than one in twenty are. Steady drifts of a tenth of a sigma of
    the innovation more each second are called that in all of twenty, and it is over when they are.
    """
    rng, n, limit = np.random.default_rng(5), 100, float(chdtri(3, integrity_gps.DRIFT_PROBABILITY))
    for share in (0.5, 0.7):
        sigma, r = np.sqrt(1.0 - share), np.exp(-1.0 / 300.0)
        found = {True: 0, False: 0}
        for _ in range(n):
            bias = np.sqrt(share) * rng.standard_normal(3)
            drifts, called = dict.fromkeys(found, integrity_gps.QUIET), dict.fromkeys(found, False)
            for _ in range(500):
                bias = r * bias + np.sqrt(share * (1.0 - r * r)) * rng.standard_normal(3)
                z = bias + sigma * rng.standard_normal(3)
                for known in (True,) if called[False] else (True, False):
                    lasting = share if known else 0.0
                    drifts[known] = integrity_gps.follow(drifts[known], z, np.eye(3), limit, lasting)
                    called[known] |= drifts[known].suspected
            for known in found:
                found[known] += called[known]
        assert found[True] == 0 and found[False] > n // 20
        for _ in range(20):
            bias, drift, states = np.sqrt(share) * rng.standard_normal(3), integrity_gps.QUIET, []
            for k in range(300):
                wrong = 0.1 * np.array([max(k - 50, 0) if k < 150 else 0.0, 0.0, 0.0])
                z = bias + wrong + sigma * rng.standard_normal(3)
                drift = integrity_gps.follow(drift, z, np.eye(3), limit, share)
                states.append(drift.suspected)
            assert not any(states[:50]) and states[149] and not all(states[160:220])


@pytest.mark.compiled
def test_a_drift_of_a_receiver_with_lasting_errors_is_noticed_in_flight():
    """3 m/s more each second from T+60 s on, fixes with sigma 2 m of which half the variance lasts: not used
    any more within 30 s, and no fix of the minute before is doubted."""
    params = PARAMS._replace(lasting_share=0.5, range_bias_time_s=300.0)
    rng, blocks, states = np.random.default_rng(3), *fly(120.0)
    nav = fusion.start(params, alignment(states[0], rng), EARTH)
    bias, results = np.sqrt(2.0) * rng.standard_normal(3), []
    for n, block in enumerate(blocks, 1):
        fusion.advance(nav, block)
        if n % 100 == 0:
            fix = gps_fix(blocks, states, block.t_valid_s, 0.0)
            wrong = bias + np.sqrt(2.0) * rng.standard_normal(3) + 3.0 * max(n / 100 - 60, 0) * np.eye(3)[0]
            v = fix.v_ea_e + SIGMA_V * rng.standard_normal(3)
            results += fusion.fuse(nav, [("gps", fix._replace(r_ea_e=fix.r_ea_e + wrong, v_ea_e=v))])
    positions = [one for one in results if one.sensor == "gps_position"]
    assert all(one.accepted for one in positions[:60])
    assert not any(one.accepted for one in positions[90:])


def test_what_makes_a_sensor_doubted_is_recorded():
    """P grows without an update, and the intervals before and after it fit together."""
    kept = []
    nav = fusion.start(PARAMS, alignment(STATES[0]), EARTH, recorder=kept.append)
    nav.watch.gps_drift = integrity_gps.Drift(np.full((2, 3), 5.0), np.full(2, 0.05), False)
    for n, block in enumerate(BLOCKS[:300], 1):
        fusion.advance(nav, block)
        if n == 100:
            fusion.fuse(nav, [("gps", fix_at(1.0, 0.0))])
    fusion.finish(nav)
    (doubt,) = (one for one in kept if isinstance(one, fusion.Correction) and one.fate == Fate.DOUBTED)
    assert doubt.z.shape == (0,) and doubt.H.shape == (0, nav.layout.n) and not doubt.dx.any()
    np.testing.assert_array_equal(doubt.P_after, doubt.P_forgotten)
    assert np.all(np.diag(doubt.P_after - doubt.P)[POS] > 100.0)
    P = None
    for one in kept:
        if P is not None:
            np.testing.assert_array_equal(one.P, P)
        P = one.P_after
