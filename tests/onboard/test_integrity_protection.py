"""Protection level: the slope against the worst case found by brute force, and what later fixes do to it."""

import numpy as np
import pytest
from scipy.stats import norm

from shefex_nav.onboard.navigation import integrity, integrity_watch
from shefex_nav.onboard.navigation import integrity_protection as protection
from shefex_nav.onboard.navigation.protected import BODY, P_NED, V_NED, sigmas
from shefex_nav.onboard.navigation.state import ATT, POS, VEL
from shefex_nav.records import Doubt

N, LIMIT = 15, 21.1
TURN = 7.292115e-5
NED = np.vstack(
    [np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0], [0.0, 0.0, TURN]]
)  # of level_axes


def followed():
    """(9, N): the nine axes by the errors of the filter."""
    T = np.zeros((9, N))
    T[P_NED, POS] = T[V_NED, VEL] = NED[:3]
    T[V_NED, POS] = -NED[:3] @ np.cross(NED[3], np.eye(3)).T
    T[BODY, ATT] = np.eye(3)
    return T


def updated(P, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return P - K @ S @ K.T, K, S


def slope(P, after, limit, axes, confirmed=False):
    """Slope of a fix whose rows are gated together."""
    return protection.Slope(False, protection._slope(P, after, limit, confirmed, axes))


def slope_of_stars(P, after, limit, H, R, confirmed, axes):
    return protection.Slope(True, protection._slope_of_stars(P, after, limit, H, R, confirmed, axes))


def case(seed):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    return A @ A.T, rng.standard_normal((3, N)), np.diag(rng.uniform(0.1, 2.0, 3))


@pytest.mark.parametrize("seed", range(5))
def test_the_slope_is_the_worst_that_passes_the_gate(seed):
    """100 000 innovations on the surface of the gate: none moves any axis further, one almost as far."""
    P, H, R = case(seed)
    after, K, S = updated(P, H, R)
    directions = np.random.default_rng(seed).standard_normal((100_000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    z = np.sqrt(LIMIT) * directions @ np.linalg.cholesky(S).T
    moved = np.abs(z @ K.T @ followed().T).max(axis=0)
    worst = slope(P, after, LIMIT, NED).table[protection.WORST]
    assert np.all(moved <= worst * (1 + 1e-9)) and np.all(moved > 0.999 * worst)


@pytest.mark.parametrize("seed", range(5))
def test_the_worst_single_satellite(seed):
    """Rows gated one by one, given the others: by what P is without each, noise of all rows tied together."""
    rng = np.random.default_rng(seed)
    P, H, _ = case(seed)
    H = np.vstack([H, rng.standard_normal((4, N))])
    u = rng.standard_normal((7, 3))
    R = np.diag(rng.uniform(0.1, 2.0, 7)) + u @ u.T
    after, single = updated(P, H, R)[0], 15.1
    along, without = np.diag(followed() @ after @ followed().T), []
    for k in range(7):
        rest = np.arange(7) != k
        without.append(followed() @ updated(P, H[rest], R[np.ix_(rest, rest)])[0] @ followed().T)
    worst = np.sqrt(single * (np.max([np.diag(one) for one in without], axis=0) - along))
    table = protection._slope_of_rows(P, after, single, H, R, 1, False, NED)
    np.testing.assert_allclose(table[protection.WORST], worst, rtol=1e-7)
    known = np.sqrt(along)
    np.testing.assert_allclose(table[protection.AFTER], known, rtol=1e-9)
    np.testing.assert_allclose(sigmas(after, NED), known, rtol=1e-9)


def test_a_confirmed_fix_can_be_wrong_by_less():
    P, H, R = np.eye(N), np.zeros((3, N)), 1e-6 * np.eye(3)
    H[:, ATT] = np.eye(3)
    after, _, _ = updated(P, H, R)
    both = (slope_of_stars(P, after, LIMIT, H, R, confirmed, NED) for confirmed in (False, True))
    alone, confirmed = (found.table[protection.WORST, BODY] for found in both)
    assert np.allclose(alone, np.sqrt(LIMIT), rtol=1e-5)
    assert np.allclose(confirmed, np.sqrt(2.0 * LIMIT * 1e-6))
    P, R = 1e-6 * np.eye(N), 1e-4 * np.eye(3)  # known better than the fix says: it moves little
    after, _, _ = updated(P, H, R)
    confirmed = slope_of_stars(P, after, LIMIT, H, R, True, NED).table[protection.WORST, BODY]
    assert np.allclose(confirmed, np.sqrt(LIMIT * 1e-12 / (1e-6 + 1e-4)))


def test_later_fixes_take_the_error_of_a_wrong_one_out():
    """A fix wrong by b, then good ones: what is left of b in the estimate stays below the level."""
    H, R, P = np.zeros((3, N)), 1e-2 * np.eye(3), np.eye(N)
    H[:, ATT] = np.eye(3)
    level, x = protection.NO_FIX, np.zeros(N)
    for k in range(30):
        after, K, S = updated(P, H, R)
        wrong = np.sqrt(LIMIT * S[0, 0]) * np.array([1.0, 0.0, 0.0]) if k == 0 else np.zeros(3)
        x = x + K @ (wrong - H @ x)
        found = slope_of_stars(P, after, LIMIT, H, R, False, NED)
        level = protection.after_fixes(level, [(float(k), found)])
        P = after
        assert abs(x[ATT.start]) <= level.w[protection.STARS, BODY.start] * (1 + 1e-9)
    assert level.w[protection.STARS, BODY.start] < 0.2 * np.sqrt(LIMIT)


def test_a_star_fix_that_passes_bounds_what_others_have_done():
    """Whatever error b passes the gate with noise inside it is below the bound, and so is what is left."""
    rng, passed = np.random.default_rng(8), 0
    H, R, P = np.zeros((3, N)), np.diag([1e-4, 2e-4, 1e-2]), np.diag(np.full(N, 0.04))
    H[:, ATT] = np.eye(3)
    P[ATT.start, ATT.start] = 1.0
    after, K, S = updated(P, H, R)
    found = slope_of_stars(P, after, LIMIT, H, R, True, NED)
    w = np.zeros((2, 9))
    w[protection.OTHERS, BODY] = 1e3
    level = protection.after_fixes(protection.Level(w, np.full(9, np.inf), 0.0), [(0.0, found)])
    for _ in range(20_000):
        b = rng.uniform(-20.0, 20.0, 3) * np.sqrt(np.diag(S))
        noise = np.linalg.cholesky(S) @ rng.standard_normal(3)
        inside = [x @ np.linalg.solve(S, x) <= LIMIT for x in (noise + b, noise)]
        if all(inside):
            passed += 1
            assert np.all(np.abs(b) <= found.table[protection.MOST, BODY])
            assert np.all(np.abs((np.eye(3) - K[ATT]) @ b) <= level.w[protection.OTHERS, BODY] * (1 + 1e-9))
    assert passed > 100
    other = protection.after_fixes(level, [(0.0, slope(P, P, LIMIT, NED))])
    assert np.allclose(other.w[:, BODY], level.w[:, BODY])  # no other sensor bounds anything


def test_an_error_of_a_wrong_fix_that_grows_stays_below_its_level():
    """A wrong velocity fix, then a minute without any: position and velocity drift apart from the truth."""
    rng, dt_s = np.random.default_rng(5), 0.1
    F, Q = np.eye(N), np.zeros((N, N))
    F[POS, VEL] = dt_s * np.eye(3)
    Q[VEL, VEL] = 1e-4 * dt_s * np.eye(3)
    P = np.diag(np.r_[np.full(3, 4.0), np.full(3, 0.04), np.full(9, 1e-4)])
    H, R = np.zeros((3, N)), 0.01 * np.eye(3)
    H[:, VEL] = np.eye(3)
    after, K, S = updated(P, H, R)
    found = slope(P, after, LIMIT, NED)
    level = protection.after_fixes(protection.NO_FIX, [(0.0, found)])
    z = rng.standard_normal((200, 3))
    z *= (np.sqrt(LIMIT) / np.linalg.norm(np.linalg.solve(np.linalg.cholesky(S), z.T), axis=0))[:, None]
    x, P, k = z @ K.T, after, np.zeros(7)
    for n in range(600):
        x, P = x @ F.T, F @ P @ F.T + Q
        told = np.empty(7)
        protection.levels(level.w, level.sigma, dt_s * (n + 1), k, sigmas(P, NED), np.zeros(7), told)
        r, v = x[:, POS] @ NED[:3].T, (x[:, VEL] - np.cross(NED[3], x[:, POS])) @ NED[:3].T
        worst = [np.hypot(*r[:, :2].T), np.abs(r[:, 2]), np.hypot(*v[:, :2].T), np.abs(v[:, 2])]
        assert np.all(np.max(worst, axis=1) <= told[:4] * (1.0 + 1e-3))  # 1e-3: the turn of the Earth


def test_a_reset_is_bounded_by_what_agreeing_fixes_let_through():
    """Fixes that agree reset a position of which nothing was known: not all of that can be their error."""
    P, H, R = np.eye(N), np.zeros((3, N)), 4.0 * np.eye(3)
    P[POS, POS] = 1e10 * np.eye(3)
    H[:, POS] = np.eye(3)
    after, _, _ = updated(P, H, R)
    alone, agreed = (slope(P, after, LIMIT, NED, told) for told in (False, True))
    assert np.all(alone.table[protection.WORST, P_NED] > 1e5)
    np.testing.assert_allclose(agreed.table[protection.WORST, P_NED], np.sqrt(2.0 * LIMIT * 4.0), rtol=1e-6)


def test_k_is_that_of_the_risk_per_hour():
    """Each quantity exceeds one of its axes as often in an hour as is stated: horizontal by Rayleigh."""
    for risk in (10.0, 1e-5):
        wanted = protection.requirement(100.0, 1.0, 0.003, risk)
        tails = 2.0 * norm.sf(wanted.k)
        tails[[0, 2]] = np.exp(-0.5 * wanted.k[[0, 2]] ** 2)
        for axes in (slice(0, 2), slice(2, 4), slice(4, 7)):
            assert tails[axes].sum() * protection.INDEPENDENT_PER_HOUR == pytest.approx(risk)
            assert np.ptp(tails[axes]) < 1e-6 * risk


def test_levels_count_the_worse_of_the_two_kinds_and_what_is_no_number_stays_none():
    k, sigma, told = np.arange(1.0, 8.0), 0.01 * np.ones(7), np.empty(7)
    for stars, others, expected in (
        (0.1, 0.0, 0.1),
        (0.0, 0.2, 0.2),
        (np.nan, 0.1, np.nan),
        (0.1, np.nan, np.nan),
    ):
        w = np.vstack([np.full(9, stars), np.full(9, others)])
        protection.levels(w, np.ones(9), 0.0, k, np.ones(9), sigma, told)
        whole = expected * np.array([np.sqrt(2.0), 1.0, np.sqrt(2.0), 1.0, 1.0, 1.0, 1.0])
        np.testing.assert_allclose(told, 0.01 * k + whole)


def test_each_quantity_has_its_own_doubt():
    limits, none = np.array([100.0, 1.0, 0.003]), np.zeros(3, dtype=np.int64)
    good = np.array([60.0, 79.0, 0.6, 0.79, 0.003, 0.001, 0.001])
    for change, quantity in (
        ({0: 62.0}, 0),  # each below 100 m, together above
        ({1: np.nan}, 0),
        ({3: 0.9}, 1),
        ({6: 0.0031}, 2),
        ({4: np.nan}, 2),
    ):
        levels, told = good.copy(), np.full(3, -1.0)
        for k, value in change.items():
            levels[k] = value
        protection.doubts(levels, limits, none, told)
        assert told.tolist() == [float(Doubt.LEVEL) if k == quantity else 0.0 for k in range(3)]
    told = np.empty(3)
    protection.doubts(good, limits, none, told)
    assert not told.any()
    protection.doubts(good, limits, np.array([0, 2, 3]), told)
    assert told.tolist() == [0.0, 2.0, 3.0]


def test_a_blind_imu_is_graver_than_a_sensor_that_contradicts():
    names = "star_tracker", "gps_position", "gps_velocity"
    at_ease = dict.fromkeys(names, integrity.HEALTHY._replace(used=9))
    insists = at_ease["star_tracker"]._replace(in_a_row=integrity_watch.CONTRADICTIONS)
    at_odds = at_ease | {"star_tracker": insists}
    watch = integrity_watch.Watch(integrity_watch.DEFAULT, 30.0, None)

    def doubts(health, blind):
        return watch.graver_doubts(health, blind).tolist()

    assert doubts(at_ease, False) == [Doubt.NONE] * 3
    assert doubts(at_odds, False) == [Doubt.NONE, Doubt.NONE, Doubt.CONTRADICTED]
    assert doubts(at_odds, True) == doubts(at_ease, True) == [Doubt.IMU] * 3
    velocity = at_ease["gps_velocity"]._replace(rejected=integrity_watch.CONTRADICTIONS)
    assert doubts(at_ease | {"gps_velocity": velocity}, False) == [Doubt.CONTRADICTED] * 3
    watch.reasons["gps"] = "no fix: outage"  # nothing checks position and velocity
    assert doubts(at_odds, False) == [Doubt.CONTRADICTED] * 3
