"""Protection levels step by step: what a fix leaves of older errors, growth in between, and what is told."""

import numpy as np
import pytest
from plain import plain
from test_integrity_protection import LIMIT, NED, N, case, followed, slope, slope_of_stars, updated
from unpacked import FALLING

from shefex_nav.onboard.navigation import integrity_gps
from shefex_nav.onboard.navigation import integrity_protection as protection
from shefex_nav.onboard.navigation.history import Corrections
from shefex_nav.onboard.navigation.integrity_protection import Level, Slope
from shefex_nav.onboard.navigation.protected import BODY, P_NED, V_NED
from shefex_nav.onboard.navigation.state import ATT, MOUNTING, POS, VEL, X_Q, layout

T = followed()
ROWS = ("worst", "before", "after", "left", "left_stars", "most")


def along(P):
    """(9,) variances along the axes that are followed."""
    return np.diag(T @ P @ T.T)


def table_of(slope):
    return dict(zip(ROWS, slope.table, strict=True))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("confirmed", [False, True])
def test_what_a_fix_could_do_and_what_it_leaves(seed, confirmed):
    """T sqrt(P before - P after), at most T sqrt(2 P after) if others agree; older errors as the variance."""
    P, H, R = case(seed)
    R = 99.0 * R if confirmed and seed else R
    after, _, _ = updated(P, H, R)
    got = table_of(slope(P, after, LIMIT, NED, confirmed))
    worst = along(P) - along(after)
    worst = np.minimum(worst, 2.0 * along(after)) if confirmed else worst
    np.testing.assert_allclose(got["worst"], np.sqrt(LIMIT * worst), rtol=1e-6)
    np.testing.assert_allclose(got["before"], np.sqrt(along(P)), rtol=1e-9)
    np.testing.assert_allclose(got["after"], np.sqrt(along(after)), rtol=1e-9)
    np.testing.assert_allclose(got["left"], along(after) / along(P), rtol=1e-9)
    assert np.all(got["left_stars"][BODY] == 1.0) and np.all(np.isinf(got["most"]))
    np.testing.assert_array_equal(got["left_stars"][:6], got["left"][:6])
    grown = table_of(slope(after, P, LIMIT, NED))  # a covariance that has grown: nothing is taken out
    assert np.all(grown["left"] == 1.0) and not grown["worst"].any()


def star_case(seed):
    P, _, _ = case(seed)
    H = np.zeros((3, N))
    H[:, ATT], H[:, 12:15] = np.eye(3), 0.5 * np.eye(3)
    R = np.diag([0.2, 0.4, 0.1])
    return P, H, R, updated(P, H, R)[0]


@pytest.mark.parametrize("confirmed", [False, True])
def test_what_a_star_fix_could_do_is_of_what_it_measures(confirmed):
    P, H, R, after = star_case(1)
    got = table_of(slope_of_stars(P, after, LIMIT, H, R, confirmed, NED))
    seen = np.diag(H @ P @ H.T)
    np.testing.assert_allclose(got["left_stars"][BODY], np.diag(H @ after @ H.T) / seen, rtol=1e-9)
    np.testing.assert_allclose(got["most"][BODY], 2.0 * np.sqrt(LIMIT * (seen + np.diag(R))), rtol=1e-9)
    moved = (P - after).diagonal()[ATT]
    worst = np.minimum(moved, 2.0 * np.diag(R)) if confirmed else moved
    np.testing.assert_allclose(got["worst"][BODY], np.sqrt(LIMIT * worst), rtol=1e-9)
    assert np.all(np.isinf(got["most"][:6]))


@pytest.mark.parametrize("mounting", [True, False])
def test_single_stars_leave_of_attitude_and_mounting_together(mounting):
    order = layout(("mounting",) if mounting else ())
    A = np.random.default_rng(2).standard_normal((order.n, order.n))
    P, H = A @ A.T, np.random.default_rng(3).standard_normal((4, order.n))
    R = np.diag([1.0, 2.0, 1.0, 3.0])
    after, _, _ = updated(P, H, R)
    table = protection._slope_of_vectors(P, after, LIMIT, H, R, int(order.at[MOUNTING]), NED)
    got = dict(zip(ROWS, table, strict=True))
    sees = np.zeros((3, order.n))
    sees[:, ATT] = np.eye(3)
    if mounting:
        sees[:, order.places["mounting"]] = np.eye(3)
    ratio = np.diag(sees @ after @ sees.T) / np.diag(sees @ P @ sees.T)
    np.testing.assert_allclose(got["left_stars"][BODY], ratio, rtol=1e-7)
    whole = np.zeros((9, order.n))
    whole[:, :N] = T
    each = []  # what the other star alone leaves, less what both do
    for rest in (slice(2, 4), slice(0, 2)):
        less = updated(P, H[rest], R[rest, rest])[0] - after
        each.append(np.diag(whole @ less @ whole.T))
    np.testing.assert_allclose(got["worst"], np.sqrt(LIMIT * np.max(each, axis=0)), rtol=1e-6)


@pytest.mark.parametrize("block, first", [(POS, 0), (VEL, 3)])
def test_a_fix_that_passes_bounds_what_it_measures(block, first):
    """2 T sqrt(S) of the innovation that shows axis j: rows of H turned into the level axes."""
    P, _, R = case(3)
    H, turn = np.zeros((3, N)), np.linalg.qr(np.random.default_rng(6).standard_normal((3, 3)))[0]
    H[:, block] = turn
    found = Slope(False, np.zeros((6, 9)))
    protection.bound(found, P, H, R, LIMIT, first, NED)
    S = H @ P @ H.T + R
    a = NED[:3] @ turn.T  # axis j by the innovation
    wanted = 2.0 * np.sqrt(LIMIT * np.diag(a @ S @ a.T))
    np.testing.assert_allclose(table_of(found)["most"][first : first + 3], wanted, rtol=1e-9)
    assert np.count_nonzero(found.table) == 3


def grown(w, before, now, dt_s):
    w = w.copy()
    w[:, V_NED] *= np.maximum(now[V_NED] / before[V_NED], 1.0)
    w[:, P_NED] += w[:, V_NED] * dt_s
    return w


def test_levels_pass_through_fixes_in_their_order():
    """Growth to the fix, what it leaves, its own worst. Kinds of sensors apart; a late one takes it back."""
    rng = np.random.default_rng(7)
    table, other = (rng.uniform(0.2, 2.0, (6, 9)) for _ in range(2))
    table[[3, 4]], other[[3, 4]] = rng.uniform(0.1, 1.0, (2, 9)), rng.uniform(0.1, 1.0, (2, 9))
    level = Level(rng.uniform(0.0, 3.0, (3, 9)), rng.uniform(0.5, 2.0, 9), 100.0)
    kept = level.w.copy()
    got = protection.after_fixes(level, [(101.5, Slope(True, table)), (101.0, Slope(False, other))])
    w, before = kept, level.sigma
    for dt_s, rows, stars in ((1.5, table, True), (0.0, other, False)):
        w = grown(w, before, rows[1], dt_s)
        bounded = w.copy()
        bounded[0, :6] = np.minimum(w[0, :6], rows[5, :6])
        bounded[1] = np.minimum(w[1], rows[5])
        w = bounded * np.stack([rows[4], rows[3], np.ones(9)])  # of a drift `integrity_drift` says it anew
        w[0 if stars else 1] = np.maximum(w[0 if stars else 1], rows[0])
        before = rows[2]
    np.testing.assert_allclose(got.w, w, rtol=1e-9)
    np.testing.assert_array_equal(got.sigma, before)
    assert got.t_s == 101.0 and np.array_equal(level.w, kept)


def test_what_is_told_is_k_sigma_and_the_worse_kind():
    rng = np.random.default_rng(10)
    w, before, known = rng.uniform(0.0, 3.0, (3, 9)), rng.uniform(0.5, 1.0, 9), rng.uniform(0.7, 2.0, 9)
    k, sigma, got = rng.uniform(1.0, 5.0, 7), rng.uniform(0.1, 1.0, 7), np.empty(7)
    plain(protection.levels)(w, before, 2.0, k, known, sigma, got)
    w = grown(w, before, known, 2.0)
    both = [[np.hypot(*one[0:2]), one[2], np.hypot(*one[3:5]), one[5], *one[6:9]] for one in w]
    np.testing.assert_allclose(got, k * sigma + np.max(both, axis=0), rtol=1e-9)
    assert set(np.argmax(both, axis=0)) == {0, 1, 2}


def test_means_of_innovations_by_their_recursion():
    """m <- (1 - a) m + a w, v <- (1 - a)^2 v + a^2; suspected beyond both; over by the short window."""
    rng = np.random.default_rng(9)
    A = rng.standard_normal((3, 3))
    S, limit = A @ A.T + np.eye(3), 30.0
    drift, mean, variance, suspected = integrity_gps.QUIET, np.zeros((2, 3)), np.zeros(2), False
    a, seen = 1.0 / np.array([10.0, 30.0]), []
    for k in range(400):
        offset = np.array([3.0, 0.0, 0.0]) * (100 <= k < 200) + np.array([0.0, 4.0, 0.0]) * (k >= 300)
        z = np.linalg.cholesky(S) @ (offset + 0.5 * rng.standard_normal(3))
        drift = integrity_gps.follow(drift, z, S, limit, 0.05)
        w = np.linalg.inv(np.linalg.cholesky(S)) @ z
        mean = (1.0 - a)[:, None] * mean + a[:, None] * w
        variance = (1.0 - a) ** 2 * variance + a**2
        norm2, bound = (mean**2).sum(axis=1), limit * (variance + 0.05)
        if suspected:
            suspected = norm2[0] > max(0.5 * bound[0], 1.0)
        else:
            suspected = bool(np.any(norm2 > np.maximum(bound, 4.0)))
        np.testing.assert_allclose(drift.mean, mean, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(drift.variance, variance, rtol=1e-9)
        assert bool(drift.suspected) == suspected
        seen.append(suspected)
    assert 1 < sum(seen) < 399 and seen[-1] and not seen[250]
    largest = np.sqrt(np.linalg.eigvalsh(S)[-1]) * np.sqrt((mean**2).sum(axis=1)).max()
    assert integrity_gps.followed(drift, S) == pytest.approx(4.0 * largest)  # 1 + 30/10


def test_a_fix_without_height_says_nothing_along_a_third_axis():
    S2 = np.array([[4.0, 1.0], [1.0, 9.0]])
    S3 = np.eye(3)
    S3[:2, :2] = S2
    z, one, two = np.array([3.0, -2.0]), integrity_gps.QUIET, integrity_gps.QUIET
    for _ in range(5):
        one = integrity_gps.follow(one, z, S2, 30.0)
        two = integrity_gps.follow(two, np.append(z, 0.0), S3, 30.0)
    np.testing.assert_array_equal(one.mean, two.mean)


def test_the_path_without_corrections():
    """Sums of dr_k - t_k dv_k and dv_k until a tick; a filter that goes back makes them again."""
    path, x = Corrections(), np.zeros(len(FALLING))
    x[X_Q] = 1.0, 0.0, 0.0, 0.0
    made = []
    for number, t_s in ((3, 1.0), (5, 2.0), (5, 2.5), (8, 4.0)):
        after = x.copy()
        after[:6] = np.arange(6.0) * t_s
        path.add(number, 0, t_s, x, after)
        made.append((number, after[:3] - t_s * after[3:6], after[3:6]))
    for number in range(2, 10):
        sums = path.until(number)
        np.testing.assert_allclose(sums.dr, sum((dr for n, dr, _ in made if n <= number), np.zeros(3)))
        np.testing.assert_allclose(sums.dv, sum((dv for n, _, dv in made if n <= number), np.zeros(3)))
    path.back_to(5)
    np.testing.assert_allclose(path.until(9).dv, sum(dv for n, _, dv in made if n <= 5))
    path.back_to(4)
    np.testing.assert_allclose(path.until(9).dv, made[0][2])
    path.add(6, 5, 3.0, x, x)  # nothing before tick 5 is asked for any more
    assert [one.number for one in path.kept] == [3, 6]
