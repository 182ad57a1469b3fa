"""What was learnt and when it was last known to be right; what each kind of contradiction casts doubt on."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_integrity_learnt import NAV, ORDER

from shefex_nav.geometry import wgs84
from shefex_nav.onboard.navigation import integrity_learnt as learnt
from shefex_nav.onboard.navigation.state import ATT, X_R, X_V

X, P = NAV.history.x, NAV.history.P


def kept(*times):
    memory = learnt.Learnt()
    for t_s in times:
        memory.confirmed(t_s, X + t_s, P * (1.0 + t_s))
    return memory


def test_what_is_kept_is_five_seconds_apart_and_no_more_than_four():
    memory = kept(1.0, 5.9, 6.0, 11.0, 16.0, 21.0)
    assert [one.t_s for one in memory.kept] == [6.0, 11.0, 16.0, 21.0]
    np.testing.assert_array_equal(memory.kept[0].x, X + 6.0)
    np.testing.assert_array_equal(memory.kept[0].variances, 7.0 * P.diagonal())


@pytest.mark.parametrize("t_s, then", [(31.1, 21.0), (30.9, 16.0), (26.0, 16.0), (15.9, None)])
def test_what_was_confirmed_ten_seconds_ago_was_right(t_s, then):
    memory = kept(6.0, 11.0, 16.0, 21.0)
    got = memory.then(t_s)
    assert (got.t_s if got else None) == then
    assert len(memory.kept) == {21.0: 4, 16.0: 3, None: 0}[then]
    memory.forget()
    assert not memory.kept and memory.then(99.0) is None


def nav_of(memory, disputed=0.0):
    watch = SimpleNamespace(learnt=memory, disputed=disputed)
    return SimpleNamespace(watch=watch, params=NAV.params, layout=ORDER)


def now(t_s=40.0, moved=0.0, P_now=P):
    return SimpleNamespace(t_s=t_s, x=X + moved, P=P_now)


def test_blocks_get_back_what_they_have_gained_since():
    """sqrt of P then + (x now - x then)^2 - P now, of every learnt block aboard."""
    memory = kept(6.0)
    before = memory.kept[0]
    added = learnt.by_stars(nav_of(memory), now(moved=6.25), np.full(3, 1e-4), True)
    assert set(added) - {learnt.SPLIT} == {
        name for name in learnt.LEARNT if ORDER.places[name] is not None
    } - {"mounting"}
    for name, sigma in added.items():
        place = ORDER.places["mounting" if name == learnt.SPLIT else name]
        gained = before.variances[place] - P.diagonal()[place]
        np.testing.assert_allclose(sigma, np.sqrt(gained + 0.25**2), rtol=1e-9)
    grown = learnt.doubts(NAV.params, ORDER, before, X + 6.5, 99.0 * P + np.eye(len(P)))
    assert not any(sigma.any() for sigma in grown.values())


def test_a_covariance_that_was_too_small_grows_to_sixteen_sigmas_of_the_start():
    """Learnt errors; position and velocity by the whole factor."""
    start = np.sqrt(learnt.doubts(NAV.params, ORDER, None, X * 0.0, 0.0 * P)["gyro_bias"] ** 2)
    P_now, bias = P + 1e-12, ORDER.places["gyro_bias"]
    P_now[bias, bias] = np.diag((np.array([1.0, 8.0, 20.0]) * start) ** 2)
    factors = learnt.widened(NAV, P_now, 4.0).factors
    np.testing.assert_allclose(factors[bias], [4.0, 2.0, 1.0], rtol=1e-6)
    np.testing.assert_allclose(factors[:6], 4.0)


def test_what_is_doubted_again_grows_no_more():
    """Until it has been corrected further."""
    before, wider = kept(6.0).kept[0], P.copy()
    for moved in (6.25, 6.25, 6.5):
        learnt.add(wider, ORDER, X + moved, learnt.doubts(NAV.params, ORDER, before, X + moved, wider))
        for name in ("gyro_bias", "accel_bias"):
            place = ORDER.places[name]
            np.testing.assert_allclose(wider.diagonal()[place], before.variances[place] + (moved - 6.0) ** 2)


@pytest.mark.parametrize("angle, disputed", [(0.99, False), (1.01, True)])
def test_a_small_angle_is_left_to_the_mounting_and_a_large_one_disputed(angle, disputed):
    nav, z = nav_of(kept(6.0)), np.radians(angle) * np.array([0.6, 0.0, 0.8])
    explained = learnt.by_stars(nav_of(kept(6.0)), now(), z, True)[learnt.SPLIT]
    split = learnt.by_stars(nav, now(), z, False)[learnt.SPLIT]
    assert nav.watch.disputed == (pytest.approx(np.radians(angle)) if disputed else 0.0)
    wanted = explained if disputed else np.hypot(explained, np.radians(angle))
    np.testing.assert_allclose(split, wanted, rtol=1e-9)
    nav = nav_of(kept(6.0), disputed=0.5)
    learnt.by_stars(nav, now(), z, False)
    assert nav.watch.disputed == 0.5
    learnt.by_stars(nav, now(), z, True)
    assert nav.watch.disputed == 0.5


@pytest.mark.parametrize("error, explains", [(19.9, True), (20.1, False)])
def test_a_velocity_turned_by_a_wrong_attitude_is_off_by_twice_its_gain_at_most(error, explains):
    memory = kept(6.0)
    memory.moving(39.0, X)
    gravity = -wgs84.GM / np.linalg.norm(X[X_R]) ** 3 * X[X_R]
    moment = now()
    moment.x[X_V] = X[X_V] + gravity + np.array([6.0, 0.0, 8.0])
    added = learnt.by_velocity(nav_of(memory), moment, np.array([0.0, error, 0.0]))
    assert ("attitude" in added) == explains and not memory.kept
    if explains:
        np.testing.assert_allclose(added["attitude"], np.pi / np.sqrt(3.0))
    start = learnt.doubts(NAV.params, ORDER, None, moment.x, P)
    np.testing.assert_allclose(added["gyro_bias"], start["gyro_bias"])


def test_a_push_since_the_last_velocity_counts_gravity_half_way():
    memory, fallen = learnt.Learnt(), X.copy()
    assert memory.pushed(0.0, X) == np.inf
    memory.moving(0.0, X)
    fallen[X_R] = X[X_R] * 1.1
    middle = X[X_R] * 1.05
    fallen[X_V] += 20.0 * -wgs84.GM / np.linalg.norm(middle) ** 3 * middle + [3.0, 4.0, 0.0]
    assert memory.pushed(20.0, fallen) == pytest.approx(5.0, rel=1e-6)


def test_a_surprise_lets_variances_grow_by_its_ratio():
    """(excess - 1) P is added: P becomes excess P."""
    added = learnt.by_surprise(nav_of(learnt.Learnt()), now(), 5.0)
    assert "attitude" in added and "gyro_bias" in added and "gps_position" not in added
    np.testing.assert_allclose(added["attitude"] ** 2, 4.0 * P.diagonal()[ATT])
    after = P.copy()
    learnt.add(after, ORDER, X, added)
    for name in added:
        place = ORDER.places[name]
        np.testing.assert_allclose(after.diagonal()[place], 5.0 * P.diagonal()[place])


def test_learnt_errors_and_where_they_start():
    marked = learnt.places(ORDER)
    for name in learnt.LEARNT:
        if ORDER.places[name] is not None:
            assert marked[ORDER.places[name]].all()
    assert not marked[:9].any() and marked[9:15].all()
    assert learnt._at_start(NAV.params, "gyro_bias") == NAV.params.sigma_gyro_bias**2
    assert learnt._at_start(NAV.params, "accel_bias") == NAV.params.sigma_accel_bias**2
    assert np.allclose(learnt._at_start(NAV.params, "mounting"), NAV.params.sigma_blocks["mounting"] ** 2)


def test_the_gain_that_teaches_nothing_is_optimal_for_the_rest():
    """Any H: K of the whole, rows of learnt errors zero, and Joseph's form of that gain."""
    rng = np.random.default_rng(1)
    A, H = rng.standard_normal((ORDER.n, ORDER.n)), rng.standard_normal((2, ORDER.n))
    P_0, R, z = A @ A.T, np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([0.1, -0.2])
    K = P_0 @ H.T @ np.linalg.inv(H @ P_0 @ H.T + R)
    K[learnt.places(ORDER)] = 0.0
    left = np.eye(ORDER.n) - K @ H
    dx, updated = learnt._consider(P_0, z, H, R, learnt.places(ORDER))
    np.testing.assert_allclose(dx, K @ z, atol=1e-10)
    np.testing.assert_allclose(updated, left @ P_0 @ left.T + K @ R @ K.T, atol=1e-8)
