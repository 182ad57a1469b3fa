"""The measurement update by the algebra of covariances, with NumPy's own factorisations as the reference."""

import numpy as np
import pytest
from plain import plain
from scipy import linalg
from unpacked import CORE, FALLING

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import eskf
from shefex_nav.onboard.navigation.state import ATT, X_Q, X_R, X_V, right_jacobian


def covariance(rng, n):
    """(n, n) with ties between all errors, sigmas over two decades."""
    A = rng.standard_normal((n, n)) * 10.0 ** rng.uniform(-1.0, 1.0, (n, 1))
    return A @ A.T + 1e-3 * np.eye(n)


@pytest.mark.parametrize("m", [1, 2, 3, 6])
def test_an_innovation_has_the_covariance_of_state_and_noise(m):
    rng = np.random.default_rng(m)
    for _ in range(10):
        P, H = covariance(rng, 15), rng.standard_normal((m, 15)) * (rng.random((m, 15)) < 0.5)
        R, z = covariance(rng, m), rng.standard_normal(m)
        S, nis = eskf.innovation(P, z, H, R)
        np.testing.assert_allclose(S, H @ P @ H.T + R, rtol=1e-10, atol=1e-10)
        assert np.array_equal(S, S.T)
        assert nis == pytest.approx(z @ linalg.solve(S, z, assume_a="pos"), rel=1e-7)
        assert eskf.normalised(S, z) == nis


@pytest.mark.parametrize("m", [3, 4])
def test_the_share_of_a_sensor_is_that_of_its_noise_in_the_innovation(m):
    """tr(S^-1 R)/m, with ties in both; few numbers and many are counted by different code."""
    rng = np.random.default_rng(5 + m)
    R, rest = covariance(rng, m), covariance(rng, m)
    S, z = R + rest, rng.standard_normal(m)
    w, own = eskf.weighed(z, R, S)
    assert own == pytest.approx(np.trace(linalg.inv(S) @ R) / m, rel=1e-7)
    np.testing.assert_allclose(w, linalg.solve_triangular(linalg.cholesky(S, lower=True), z, lower=True))


def joseph(P, H, R, K):
    A = np.eye(len(P)) - K @ H
    return A @ P @ A.T + K @ R @ K.T


def measured(rng, size=1e-4):
    P = 1e-4 * covariance(rng, CORE.n)
    H, R = rng.standard_normal((3, CORE.n)), 1e-4 * covariance(rng, 3)
    return P, (size * rng.standard_normal(3), H, R)


def turned(P, G):
    whole = np.eye(len(P))
    whole[ATT, ATT] = G
    return whole @ P @ whole.T


def test_an_update_is_that_of_the_optimal_gain_in_new_body_axes():
    rng = np.random.default_rng(2)
    P, (z, H, R) = measured(rng, 0.1)
    x, after, before = FALLING.copy(), np.empty_like(P), P.copy()
    dx, G = eskf.update_packed(eskf.engine(CORE), CORE, P, (z, H, R), x, after)
    K = P @ H.T @ linalg.inv(H @ P @ H.T + R)
    np.testing.assert_allclose(dx, K @ z, rtol=1e-8)
    np.testing.assert_allclose(G, right_jacobian(dx[ATT]), rtol=1e-12)
    assert np.abs(G - np.eye(3)).max() > 1e-3  # an angle that shows whether it is turned
    np.testing.assert_allclose(after, turned(joseph(P, H, R, K), G), rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(after, after.T, rtol=1e-12)
    np.testing.assert_array_equal(P, before)
    np.testing.assert_allclose(x[X_R] - FALLING[X_R], dx[:3], atol=1e-8)
    np.testing.assert_allclose(x[X_V], dx[3:6], atol=1e-12)
    rotated = rotation.quat_multiply(FALLING[X_Q], rotation.quat_from_rotvec(dx[ATT]))
    assert np.linalg.norm(rotation.rotvec_between(rotated, x[X_Q])) < 1e-9
    x, of_a_fix = FALLING.copy(), np.empty_like(P)
    _, G = eskf.update_packed(eskf.engine(CORE), CORE, P, (z, H, R), x, of_a_fix, turns=False)
    np.testing.assert_array_equal(G, np.eye(3))
    np.testing.assert_allclose(of_a_fix, joseph(P, H, R, K), rtol=1e-6, atol=1e-11)


def test_what_rounding_leaves_of_symmetry_is_shared():
    updated = np.arange(float(CORE.n**2)).reshape(CORE.n, CORE.n)
    after, dx = np.empty_like(updated), np.zeros(CORE.n)
    eskf.take_in(FALLING.copy(), dx, CORE.nominal, updated, after)
    np.testing.assert_allclose(after, 0.5 * (updated + updated.T), rtol=1e-14)


@pytest.mark.parametrize("share", [(1.0, 1.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.7, 0.2, 1.0)])
def test_a_part_of_a_correction_leaves_no_less_than_the_covariance_of_that_gain(share):
    """Joseph's form of the gain whose rows of the attitude are scaled, which is true of any gain.

    Where a share is none or all that is all of it. Between, the variance falls by the square of the share:
    that of the correction which is taken.
    """
    rng, s = np.random.default_rng(3), np.array(share)
    P, (z, H, R) = measured(rng)
    K = P @ H.T @ linalg.inv(H @ P @ H.T + R)
    scale = np.ones(CORE.n)
    scale[ATT] = s
    dx, updated = K @ z, joseph(P, H, R, K)
    got, least = plain(eskf.partly)(dx, P, updated, s), joseph(P, H, R, scale[:, None] * K)
    np.testing.assert_allclose(dx, scale * (K @ z), rtol=1e-12)
    if np.all(s * (1.0 - s) == 0.0):
        np.testing.assert_allclose(got, least, rtol=1e-7, atol=1e-12)
    assert np.linalg.eigvalsh(got - least).min() > -1e-10
    fallen = (P - got).diagonal()[ATT]
    np.testing.assert_allclose(fallen, s**2 * (P - updated).diagonal()[ATT], rtol=1e-7, atol=1e-12)
    np.testing.assert_allclose(got, got.T, rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("covariance_of", [4.0, np.diag([1.0, 2.0, 3.0])])
def test_a_block_that_is_forgotten_has_no_ties(covariance_of):
    rng = np.random.default_rng(4)
    P, block = covariance(rng, 9), slice(3, 6)
    got = eskf.forget(P, block, covariance_of)
    np.testing.assert_array_equal(got[block, block], covariance_of * np.eye(3))
    rest = [0, 1, 2, 6, 7, 8]
    np.testing.assert_array_equal(got[np.ix_(rest, rest)], P[np.ix_(rest, rest)])
    assert not got[block, rest].any() and not got[rest, block].any() and P[3, 0] != 0.0
