"""Rows of satellites and stars given the others: against sums over the rest, and what a wrong one does."""

import itertools

import numpy as np
import pytest
from plain import plain
from scipy import stats
from test_integrity_protection import NED, N, followed, updated

from shefex_nav.onboard.navigation import integrity_rows
from shefex_nav.onboard.navigation.integrity import Limits

P_GATE = 1e-4
LIMITS = Limits(P_GATE)


def of(S, z, rows):
    """z^T S^-1 z of some rows."""
    return float(z[rows] @ np.linalg.inv(S[np.ix_(rows, rows)]) @ z[rows])


def slow(S, z, size):
    """Rows that pass, by leaving out each group in turn; None if half are gone."""
    groups = [list(range(k, k + size)) for k in range(0, len(z), size)]
    kept = list(range(len(groups)))
    while 2 * len(kept) > len(groups):
        rows = list(itertools.chain(*(groups[g] for g in kept)))
        nis, less = of(S, z, rows), []
        for g in kept:
            rest = [row for row in rows if row not in groups[g]]
            less.append(nis - (of(S, z, rest) if rest else 0.0))
        if nis <= stats.chi2.isf(P_GATE, len(rows)) and max(less) <= stats.chi2.isf(P_GATE, size):
            return rows
        kept.remove(kept[int(np.argmax(less))])
    return None


def shared(rng, m, wide):
    """Covariance of rows that share errors of a sigma `wide` in one direction and of 5 in three others."""
    H = np.column_stack([np.ones(m), rng.standard_normal((m, 3))])
    return H @ np.diag([wide**2, 25.0, 25.0, 25.0]) @ H.T + np.diag(rng.uniform(0.5, 2.0, m))


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("wide", [1.0, 300.0])
def test_the_rows_that_pass_are_those_of_the_slow_way(size, wide):
    rng, seen = np.random.default_rng(size), set()
    for _ in range(200):
        m = size * rng.integers(1, 12)
        S = shared(rng, m, wide)
        z = np.linalg.cholesky(S) @ rng.standard_normal(m)
        for _ in range(rng.integers(0, 9)):
            z[rng.integers(m)] += rng.uniform(-30.0, 30.0)
        rows, passed = integrity_rows.passed(LIMITS, S, z, size)
        wanted = slow(S, z, size)
        assert passed == (wanted is not None)
        if passed:
            found = np.ones(m, dtype=bool) if rows is None else rows
            assert np.flatnonzero(found).tolist() == wanted
            assert (rows is None) == (len(wanted) == m)
        seen.add((passed, rows is None))
    assert seen == {(True, True), (True, False), (False, True)}


def test_a_wrong_satellite_shows_against_the_others_whatever_the_clock():
    """Clock known to 500 m, one of eleven wrong by 60 m: each row alone is within 2 sigma of nothing."""
    rng = np.random.default_rng(3)
    for k in range(11):
        S = shared(rng, 11, 500.0)
        z = np.linalg.cholesky(S) @ rng.standard_normal(11)
        z[k] += 60.0
        assert np.sum(z**2 / np.diag(S) > LIMITS[1]) == 0  # what a row by itself would say
        rows, passed = integrity_rows.passed(LIMITS, S, z, 1)
        assert passed and np.flatnonzero(~rows).tolist() == [k]


def test_a_wrong_star_shows_against_the_others_whatever_the_attitude():
    """Attitude known to 0.04 deg, stars to 8 arcsec, one of six wrong by 0.1 deg: 2.5 sigma of it alone."""
    rng, arcsec = np.random.default_rng(0), np.radians(1.0 / 3600.0)
    u = np.column_stack([rng.uniform(-0.12, 0.12, (6, 2)), np.ones(6)])
    H = np.vstack([[[0.0, -w, v], [w, 0.0, -x]] for x, v, w in u])  # across the axis: the turn of each star
    S = H @ H.T * np.radians(0.04) ** 2 + np.eye(12) * (8.0 * arcsec) ** 2
    for k in range(6):
        z = np.linalg.cholesky(S) @ rng.standard_normal(12)
        z[2 * k] += np.radians(0.1)
        rows, passed = integrity_rows.passed(LIMITS, S, z, 2)
        assert passed and np.flatnonzero(~rows).tolist() == [2 * k, 2 * k + 1]


def test_a_healthy_row_is_refused_as_seldom_as_its_gate_says():
    """1e-2, of 8 rows in 4000 epochs: 320 at most by themselves, and 40 epochs of all eight together.

    Fewer, for rows that go against each other are over with the first of them.
    """
    rng, limits, refused = np.random.default_rng(4), Limits(1e-2), 0
    S = shared(rng, 8, 100.0)
    L = np.linalg.cholesky(S)
    for _ in range(4000):
        rows, passed = integrity_rows.passed(limits, S, L @ rng.standard_normal(8), 1)
        refused += 8 if not passed else 0 if rows is None else int(np.sum(~rows))
    assert 200 < refused < 360


def test_half_of_the_rows_are_not_most_of_them():
    z = np.array([0.0, 0.0, 99.0, 99.0])
    assert integrity_rows.passed(LIMITS, np.eye(4), z, 1) == (None, False)
    assert integrity_rows.passed(LIMITS, np.eye(3), z[1:], 1) == (None, False)
    rows, passed = integrity_rows.passed(LIMITS, np.eye(3), z[:3], 1)
    assert passed and rows.tolist() == [True, True, False]
    rows, passed = integrity_rows.passed(LIMITS, np.eye(6), np.append(z, [0.0, 0.0]), 2)
    assert passed and rows.tolist() == [True, True, False, False, True, True]


def test_rows_that_are_each_within_their_gate_may_be_too_much_together():
    """Eleven independent rows of 3 sigma: each below 3.9, the sum of squares 99 of 37."""
    z = np.full(11, 3.0)
    assert np.all(z**2 < LIMITS[1])
    assert integrity_rows.passed(LIMITS, np.eye(11), z, 1) == (None, False)


def test_a_row_that_is_no_number_is_refused_and_the_others_are_not():
    S, z = np.eye(5), np.array([0.5, np.nan, 0.1, -0.3, 0.2])
    rows, passed = integrity_rows.passed(LIMITS, S, z, 1)
    assert passed and rows.tolist() == [True, False, True, True, True]
    S[4, 4] = np.inf
    assert integrity_rows.passed(LIMITS, S, z, 1)[0].tolist() == [True, False, True, True, False]
    assert integrity_rows.passed(LIMITS, S, np.full(5, np.nan), 1) == (None, False)


def case(seed, size, groups=5):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    m = size * groups
    u = rng.standard_normal((m, 2))
    H = rng.standard_normal((m, N))
    H[:, 7] = 1.0
    P = A @ A.T
    P[7, 7] += 1e4  # what all share
    return P, H, np.diag(rng.uniform(0.1, 2.0, m)) + u @ u.T


def worst_of(P, H, R, limit, size):
    out = np.full(9, 77.0)
    plain(integrity_rows.worst_of)(P, H, R, limit, size, NED, out)
    return out


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_what_a_group_has_done_is_against_the_estimate_without_it(seed, size):
    """K z less K' z' of the others is K_g Y_gg^-1 y_g; squared, over T^2, what P is more without it."""
    P, H, R = case(seed, size)
    after, K, S = updated(P, H, R)
    z, Y, less = np.random.default_rng(seed).standard_normal(len(R)), np.linalg.inv(S), []
    for first in range(0, len(R), size):
        g = slice(first, first + size)
        rest = np.delete(np.arange(len(R)), np.arange(first, first + size))
        P_rest, K_rest, _ = updated(P, H[rest], R[np.ix_(rest, rest)])
        done = K[:, g] @ np.linalg.solve(Y[g, g], (Y @ z)[g])
        np.testing.assert_allclose(K @ z - K_rest @ z[rest], done, rtol=1e-6, atol=1e-9)
        less.append(np.diag(followed() @ (P_rest - after) @ followed().T))
    wanted = np.sqrt(9.0 * np.max(less, axis=0))
    np.testing.assert_allclose(worst_of(P, H, R, 9.0, size), wanted, rtol=1e-6)


@pytest.mark.parametrize("size", [1, 2])
def test_the_worst_that_the_gate_lets_through_by_brute_force(size):
    """Each group alone wrong, in all directions, by as much as `passed` does not notice: none does more."""
    P, H, R = case(7, size)
    _, K, S = updated(P, H, R)
    angles = np.linspace(0.0, np.pi, 181) if size == 2 else [0.0]
    moved = np.zeros(9)
    for first, angle in itertools.product(range(0, len(R), size), angles):
        z = np.zeros(len(R))
        z[first : first + size] = (np.cos(angle), np.sin(angle))[:size]
        low, high = 0.0, 1e4  # bisect the size at which it is noticed
        for _ in range(45):
            middle = 0.5 * (low + high)
            rows, passed = integrity_rows.passed(LIMITS, S, middle * z, size)
            low, high = (middle, high) if passed and rows is None else (low, middle)
        moved = np.maximum(moved, np.abs(followed() @ K @ (low * z)))
    worst = worst_of(P, H, R, LIMITS[size], size)
    assert np.all(moved <= worst * (1.0 + 1e-9))
    assert np.all(moved > 0.9998 * worst)
