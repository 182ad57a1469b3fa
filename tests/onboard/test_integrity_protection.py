"""Protection level: the slope against the worst case found by brute force, and what later fixes do to it."""

import numpy as np
import pytest
from scipy.stats import norm

from shefex_nav.onboard.navigation import integrity, integrity_watch
from shefex_nav.onboard.navigation import integrity_protection as protection
from shefex_nav.onboard.navigation.state import ATT
from shefex_nav.records import Doubt

N, LIMIT = 15, 21.1


def updated(P, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return P - K @ S @ K.T, K, S


def case(seed):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    return A @ A.T, rng.standard_normal((3, N)), np.diag(rng.uniform(0.1, 2.0, 3))


@pytest.mark.parametrize("seed", range(5))
def test_the_slope_is_the_worst_that_passes_the_gate(seed):
    """100 000 innovations on the surface of the gate: none moves the attitude further, one almost as far."""
    P, H, R = case(seed)
    after, K, S = updated(P, H, R)
    directions = np.random.default_rng(seed).standard_normal((100_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    z = np.sqrt(LIMIT) * directions @ np.linalg.cholesky(S).T
    moved = np.abs(z @ K.T)[:, ATT].max(axis=0)
    worst = protection.slope(P, after, LIMIT).table[protection.WORST]
    assert np.all(moved <= worst * (1 + 1e-9)) and np.all(moved > 0.999 * worst)


@pytest.mark.parametrize("seed", range(5))
def test_the_worst_single_satellite(seed):
    """Rows gated one by one: each alone at the rim of its own gate, noise of all rows tied together."""
    rng = np.random.default_rng(seed)
    P, H, _ = case(seed)
    H = np.vstack([H, rng.standard_normal((4, N))])
    u = rng.standard_normal((7, 3))
    R = np.diag(rng.uniform(0.1, 2.0, 7)) + u @ u.T
    after, K, S = updated(P, H, R)
    single = 15.1
    rim = K[ATT] * np.sqrt(single * np.diag(S))  # a column for each satellite
    found = protection.slope_of_ranges(P, after, single, H, R)
    np.testing.assert_allclose(found.table[protection.WORST], np.abs(rim).max(axis=1), rtol=1e-9)
    np.testing.assert_allclose(found.table[protection.VARIANCE], np.diag(after)[ATT])
    assert not found.stars


def test_a_confirmed_fix_can_be_wrong_by_less():
    P, H, R = np.eye(N), np.zeros((3, N)), 1e-6 * np.eye(3)
    H[:, ATT] = np.eye(3)
    after, _, _ = updated(P, H, R)
    both = (protection.slope_of_stars(P, after, LIMIT, H, R, confirmed) for confirmed in (False, True))
    alone, confirmed = (found.table[protection.WORST] for found in both)
    assert np.allclose(alone, np.sqrt(LIMIT), rtol=1e-5)
    assert np.allclose(confirmed, np.sqrt(2.0 * LIMIT * 1e-6))


def test_later_fixes_take_the_error_of_a_wrong_one_out():
    """A fix wrong by b, then good ones: what is left of b in the estimate stays below the level."""
    H, R, P = np.zeros((3, N)), 1e-2 * np.eye(3), np.eye(N)
    H[:, ATT] = np.eye(3)
    level, x = protection.NO_FIX, np.zeros(N)
    for k in range(30):
        after, K, S = updated(P, H, R)
        wrong = np.sqrt(LIMIT * S[0, 0]) * np.array([1.0, 0.0, 0.0]) if k == 0 else np.zeros(3)
        x = x + K @ (wrong - H @ x)
        found = protection.slope_of_stars(P, after, LIMIT, H, R, False)
        level = protection.after_fix(level, found, after)
        P = after
        assert abs(x[ATT.start]) <= level.stars_b[0] * (1 + 1e-9)
    assert level.stars_b[0] < 0.2 * np.sqrt(LIMIT)


def test_a_star_fix_that_passes_bounds_what_others_have_done():
    """Whatever error b passes the gate with noise inside it is below the bound, and so is what is left."""
    rng, passed = np.random.default_rng(8), 0
    H, R, P = np.zeros((3, N)), np.diag([1e-4, 2e-4, 1e-2]), np.diag(np.full(N, 0.04))
    H[:, ATT] = np.eye(3)
    P[ATT.start, ATT.start] = 1.0
    after, K, S = updated(P, H, R)
    found = protection.slope_of_stars(P, after, LIMIT, H, R, True)
    level = protection.after_fix(protection.Level(np.zeros(3), np.full(3, 1e3)), found, after)
    for _ in range(20_000):
        b = rng.uniform(-20.0, 20.0, 3) * np.sqrt(np.diag(S))
        noise = np.linalg.cholesky(S) @ rng.standard_normal(3)
        inside = [x @ np.linalg.solve(S, x) <= LIMIT for x in (noise + b, noise)]
        if all(inside):
            passed += 1
            assert np.all(np.abs(b) <= found.table[protection.MOST])
            assert np.all(np.abs((np.eye(3) - K[ATT]) @ b) <= level.others_b * (1 + 1e-9))
    assert passed > 100
    other = protection.after_fix(level, protection.slope(P, P, LIMIT), P)
    assert np.allclose(other.others_b, level.others_b)  # no other sensor bounds anything


def test_k_is_that_of_the_normal_distribution():
    for risk in (0.05, 1e-5):
        wanted = protection.requirement(0.003, risk)
        assert 2.0 * norm.sf(wanted.k) == pytest.approx(risk)
    for stars, others, expected in (
        (0.1, 0.0, 0.1),
        (0.0, 0.2, 0.2),
        (np.nan, 0.1, np.nan),
        (0.1, np.nan, np.nan),
    ):
        found = protection.of_axis(stars, others, wanted.k, 0.01)
        assert found == pytest.approx(wanted.k * 0.01 + expected, nan_ok=True)


def test_the_gravest_doubt_counts_and_what_is_no_number_never_passes():
    limit = 0.003
    good, bad, unknown = np.full(3, limit), np.array([0.001, 0.0031, 0.001]), np.array([np.nan, 0.001, 0.001])
    for level, own in ((good, Doubt.NONE), (bad, Doubt.ATTITUDE), (unknown, Doubt.ATTITUDE)):
        assert protection.doubt(level, limit, int(Doubt.NONE)) == own
        for graver in (Doubt.CONTRADICTED, Doubt.IMU):
            assert protection.doubt(level, limit, int(graver)) == graver


def test_a_blind_imu_is_graver_than_a_sensor_that_contradicts():
    names = "star_tracker", "gps_position", "gps_velocity"
    at_ease = dict.fromkeys(names, integrity.HEALTHY._replace(used=9))
    insists = at_ease["star_tracker"]._replace(in_a_row=integrity_watch.CONTRADICTIONS)
    at_odds = at_ease | {"star_tracker": insists}
    assert integrity_watch.graver_doubt(at_ease, False) == Doubt.NONE
    assert integrity_watch.graver_doubt(at_odds, False) == Doubt.CONTRADICTED
    assert integrity_watch.graver_doubt(at_odds, True) == Doubt.IMU
    assert integrity_watch.graver_doubt(at_ease, True) == Doubt.IMU
