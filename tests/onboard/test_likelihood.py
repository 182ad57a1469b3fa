"""Attitude from centroids with covariances, and the test that drops a bad star."""

from fractions import Fraction

import numpy as np
import pytest
from scipy import stats
from star_fields import CAMERA, random_attitude

from shefex_nav.geometry.pinhole import pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply, rotvec_between
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.onboard.startracker.attitude import covariance, esoq2, product
from shefex_nav.onboard.startracker.likelihood import (
    CommonErrors,
    _shared,
    drop_worst,
    misfit_factor,
    misfit_growth,
    refine,
    sigma_of_centroids,
)

CORNER = np.array([CAMERA.width_px - 1.0, CAMERA.height_px - 1.0])


def streaks(rng, n, long_px=1.5, short_px=0.1):
    """(n, 2, 2) covariances, all elongated in about one direction."""
    angle = rng.uniform(0.0, np.pi) + rng.normal(0.0, 0.1, n)
    along = np.column_stack([np.cos(angle), np.sin(angle)])
    return short_px**2 * np.eye(2) + (long_px**2 - short_px**2) * along[:, :, None] * along[:, None, :]


def frame(rng, n, P_px):
    """(q_ic, xy_px, v_i): centroids with errors of the given covariances."""
    q_ic = random_attitude(rng)
    ideal = rng.uniform(0.0, CORNER, (n, 2))
    v_i = unit_vectors(CAMERA, ideal) @ dcm_from_quat(q_ic).T
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(P_px), rng.standard_normal((n, 2)))
    return q_ic, ideal + noise, v_i


def first_attitude(xy_px, v_i, P_px):
    return esoq2(unit_vectors(CAMERA, xy_px), v_i, sigma_of_centroids(CAMERA, xy_px, P_px))


def predicted(q_ic, v_i):
    return pixels(CAMERA, np.ascontiguousarray(v_i @ dcm_from_quat(q_ic)))


def chi2_of(q_ic, xy_px, v_i, P_px):
    r = xy_px - predicted(q_ic, v_i)
    return np.einsum("ni,nij,nj->", r, np.linalg.inv(P_px), r)


def test_sigma_is_the_spread_of_the_direction():
    """Against the derivative of the direction by differences, for an elongated covariance in a corner."""
    P_px = streaks(np.random.default_rng(1), 3)
    xy_px = np.array([[10.0, 20.0], [329.0, 246.0], [600.0, 480.0]])
    step = 1e-3
    for k in range(3):
        J = np.column_stack(
            [
                (unit_vectors(CAMERA, xy_px[k : k + 1] + e) - unit_vectors(CAMERA, xy_px[k : k + 1] - e))[0]
                for e in 0.5 * step * np.eye(2)
            ]
        )
        expected = np.sqrt(0.5 * np.trace(J @ P_px[k] @ J.T)) / step
        assert sigma_of_centroids(CAMERA, xy_px, P_px)[k] == pytest.approx(expected, rel=1e-6)


def test_refined_attitude_is_a_minimum_and_its_covariance_the_curvature():
    rng = np.random.default_rng(2)
    P_px = streaks(rng, 7)
    _, xy_px, v_i = frame(rng, 7, P_px)
    q_ic, P_c, chi2 = refine(CAMERA, first_attitude(xy_px, v_i, P_px), xy_px, v_i, P_px)
    assert chi2 == pytest.approx(chi2_of(q_ic, xy_px, v_i, P_px), rel=1e-9)
    sigma = np.sqrt(np.diag(P_c))
    for direction in np.eye(3):
        step = sigma * direction
        up, down = (
            chi2_of(quat_multiply(q_ic, quat_from_rotvec(sign * step)), xy_px, v_i, P_px) for sign in (1, -1)
        )
        rise = step @ np.linalg.solve(P_c, step)  # chi2 = chi2_min + d' P^-1 d
        assert 0.5 * (up + down) - chi2 == pytest.approx(rise, rel=5e-3)
        assert (up - down) / rise == pytest.approx(0.0, abs=0.02)


def test_round_covariances_give_the_covariance_of_esoq2():
    rng = np.random.default_rng(3)
    P_px = np.tile(0.2**2 * np.eye(2), (8, 1, 1))
    _, xy_px, v_i = frame(rng, 8, P_px)
    q_0 = first_attitude(xy_px, v_i, P_px)
    q_ic, P_c, _ = refine(CAMERA, q_0, xy_px, v_i, P_px)
    P_0 = covariance(unit_vectors(CAMERA, xy_px), sigma_of_centroids(CAMERA, xy_px, P_px))
    np.testing.assert_allclose(np.sqrt(np.diag(P_c)), np.sqrt(np.diag(P_0)), rtol=0.03)
    assert np.abs(rotvec_between(q_0, q_ic) / np.sqrt(np.diag(P_c))).max() < 0.2


def test_elongated_covariances_are_consistent_and_better_than_one_weight():
    """NEES has the chi-square distribution of three degrees of freedom, chi2 that of 2 n - 3."""
    rng = np.random.default_rng(4)
    trials, n = 1500, 8
    nees, misfit, gain = [], [], []
    for _ in range(trials):
        P_px = streaks(rng, n) * rng.uniform(0.25, 4.0, n)[:, None, None]
        truth, xy_px, v_i = frame(rng, n, P_px)
        q_0 = first_attitude(xy_px, v_i, P_px)
        q_ic, P_c, chi2 = refine(CAMERA, q_0, xy_px, v_i, P_px)
        error = rotvec_between(q_ic, truth)
        nees.append(error @ np.linalg.solve(P_c, error))
        misfit.append(chi2)
        gain.append((np.linalg.norm(rotvec_between(q_0, truth)), np.linalg.norm(error)))
    for values, dof in ((nees, 3), (misfit, 2 * n - 3)):
        low, high = stats.chi2.ppf([5e-4, 1.0 - 5e-4], dof * trials) / trials
        assert low < np.mean(values) < high
        assert stats.kstest(values, stats.chi2(dof).cdf).pvalue > 1e-3
    before, after = np.sqrt(np.mean(np.square(gain), axis=0))
    assert after < 0.9 * before


def test_nothing_is_dropped_more_often_than_stated():
    """Bonferroni is an upper limit, and a close one: the stars hardly depend on each other."""
    rng = np.random.default_rng(5)
    trials, false_alarm = 4000, 0.05
    P_px = np.tile(0.15**2 * np.eye(2), (8, 1, 1))
    dropped = 0
    for _ in range(trials):
        truth, xy_px, v_i = frame(rng, 8, P_px)
        dropped += drop_worst(CAMERA, truth, xy_px, v_i, P_px, false_alarm, 4)[0] >= 0
    assert 0.8 * false_alarm < dropped / trials < false_alarm + 3.0 * np.sqrt(false_alarm / trials)


@pytest.mark.parametrize("shift_sigma", [4.0, 6.0, 10.0])
def test_a_displaced_star_is_found_as_often_as_theory_says(shift_sigma):
    """Power: a non-central chi-square, its centre the shift seen against the other stars' prediction."""
    rng = np.random.default_rng(6)
    trials, n, bad, sigma_px, false_alarm = 1200, 9, 3, 0.15, 1e-3
    P_px = np.tile(sigma_px**2 * np.eye(2), (n, 1, 1))
    found, expected, errors = 0, [], []
    for _ in range(trials):
        truth, xy_px, v_i = frame(rng, n, P_px)
        others = np.arange(n) != bad
        _, P_others, _ = refine(CAMERA, truth, xy_px[others], v_i[others], P_px[others])
        H = (
            np.column_stack(
                [
                    predicted(quat_multiply(truth, quat_from_rotvec(1e-6 * e)), v_i[bad : bad + 1])[0]
                    - predicted(quat_multiply(truth, quat_from_rotvec(-1e-6 * e)), v_i[bad : bad + 1])[0]
                    for e in np.eye(3)
                ]
            )
            / 2e-6
        )
        angle = rng.uniform(0.0, 2.0 * np.pi)
        shift = shift_sigma * sigma_px * np.array([np.cos(angle), np.sin(angle)])
        centre = shift @ np.linalg.solve(P_px[bad] + H @ P_others @ H.T, shift)
        expected.append(stats.ncx2.sf(2.0 * np.log(n / false_alarm), 2, centre))
        xy_px[bad] += shift
        start = first_attitude(xy_px, v_i, P_px)
        dropped, q_ic, P_c, _ = drop_worst(CAMERA, start, xy_px, v_i, P_px, false_alarm, 4)
        found += dropped == bad
        if dropped == bad:
            error = rotvec_between(q_ic, truth)
            errors.append(error @ np.linalg.solve(P_c, error))
    scatter = np.sqrt(np.mean(expected) * (1.0 - np.mean(expected)) / trials)
    assert found / trials == pytest.approx(np.mean(expected), abs=4.0 * scatter + 0.01)  # 0.01: mistaken ones
    if shift_sigma == 10.0:
        assert found / trials > 0.99
        assert np.mean(errors) == pytest.approx(3.0, abs=4.0 * np.sqrt(6.0 / len(errors)))


def test_a_field_that_would_be_too_small_keeps_its_stars():
    rng = np.random.default_rng(7)
    P_px = np.tile(0.1**2 * np.eye(2), (4, 1, 1))
    truth, xy_px, v_i = frame(rng, 4, P_px)
    xy_px[2] += 30.0
    dropped, _, _, chi2 = drop_worst(CAMERA, truth, xy_px, v_i, P_px, 1e-3, 4)
    assert dropped == -1 and chi2 > 1000.0
    assert drop_worst(CAMERA, truth, xy_px, v_i, P_px, 1e-3, 3)[0] == 2


P_OMEGA = np.radians(np.diag([0.02, 0.03, 0.05])) ** 2  # (rad/s)^2


def rolling_frame(rng, n, P_px, P_omega):
    """A frame whose rows were exposed over 0.2 s, its places brought to one instant with a wrong rate.

    Returns
    -------
    q_ic, xy_px, v_i as `frame`, and t_s (n,)
    """
    q_ic, xy_px, v_i = frame(rng, n, P_px)
    truth_px = predicted(q_ic, v_i)
    t_s = 0.2 * (truth_px[:, 1] / 492.0 - 0.5)
    domega = rng.multivariate_normal(np.zeros(3), P_omega)
    return q_ic, xy_px + t_s[:, None] * (turn_jacobians(CAMERA, truth_px) @ domega), v_i, t_s


def test_common_error_of_the_rate_is_that_of_one_large_covariance():
    """The same as all places together with the covariance P + S P_omega S' between every two of them."""
    rng = np.random.default_rng(21)
    P_px = streaks(rng, 9)
    _, xy_px, v_i, t_s = rolling_frame(rng, 9, P_px, P_OMEGA)
    q_ic, P_c, chi2 = refine(
        CAMERA, first_attitude(xy_px, v_i, P_px), xy_px, v_i, P_px, CommonErrors(t_s, P_OMEGA, 0.0)
    )
    at = predicted(q_ic, v_i)
    H = turn_jacobians(CAMERA, at)
    S = (t_s[:, None, None] * H).reshape(-1, 3)
    V = S @ P_OMEGA @ S.T
    for k in range(9):
        V[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += P_px[k]
    H, r = H.reshape(-1, 3), (xy_px - at).ravel()
    assert np.allclose(P_c, np.linalg.inv(H.T @ np.linalg.solve(V, H)), rtol=1e-6)
    assert chi2 == pytest.approx(r @ np.linalg.solve(V, r), rel=1e-6)
    assert np.abs(P_c @ H.T @ np.linalg.solve(V, r)).max() < 1e-3 * np.sqrt(np.diag(P_c)).min()


def test_covariance_covers_a_wrong_rate_and_independent_errors_do_not():
    """Chi-square of three degrees of freedom over 400 frames, about the boresight and in all."""
    rng = np.random.default_rng(22)
    common, apart = np.empty(400), np.empty(400)
    for k in range(400):
        P_px = np.tile(0.01 * np.eye(2), (20, 1, 1))
        truth, xy_px, v_i, t_s = rolling_frame(rng, 20, P_px, P_OMEGA)
        S = t_s[:, None, None] * turn_jacobians(CAMERA, xy_px)
        for out, P, errors in (
            (common, P_px, CommonErrors(t_s, P_OMEGA, 0.0)),
            (apart, P_px + S @ P_OMEGA @ S.transpose(0, 2, 1), None),
        ):
            q_ic, P_c, _ = refine(CAMERA, truth, xy_px, v_i, P, errors)
            error = rotvec_between(q_ic, truth)
            out[k] = error @ np.linalg.solve(P_c, error) / 3.0
    assert common.mean() == pytest.approx(1.0, abs=3.5 * np.sqrt(2.0 / 3.0 / 400))
    assert apart.mean() > 1.0 + 5.0 * np.sqrt(2.0 / 3.0 / 400)


def test_with_a_wrong_rate_the_bad_star_is_still_the_one_that_is_dropped():
    """And without a bad star one is dropped as often as said: Poisson, 99.9 %."""
    rng = np.random.default_rng(23)
    n_dropped, n_right = 0, 0
    for _ in range(300):
        P_px = np.tile(0.01 * np.eye(2), (12, 1, 1))
        truth, xy_px, v_i, t_s = rolling_frame(rng, 12, P_px, P_OMEGA)
        rate = CommonErrors(t_s, P_OMEGA, 0.0)
        n_dropped += drop_worst(CAMERA, truth, xy_px, v_i, P_px, 0.05, 4, rate)[0] >= 0
        xy_px[5] += [0.9, -0.6]
        n_right += drop_worst(CAMERA, truth, xy_px, v_i, P_px, 0.05, 4, rate)[0] == 5
    assert 4 <= n_dropped <= 30  # 15 expected
    assert n_right > 290


def wrong_focal_length(xy_px, part):
    """Places behind a lens whose focal length is longer by a part."""
    middle = np.array([CAMERA.cx_px, CAMERA.cy_px])
    return middle + (1.0 + part) * (xy_px - middle)


def test_common_error_of_the_focal_length_is_that_of_one_large_covariance():
    """Best for P + s s' sigma^2 between all places, s from the middle; P_c is what P alone leaves of it."""
    rng = np.random.default_rng(24)
    sigma, P_px = 3e-4, np.tile(0.02**2 * np.eye(2), (8, 1, 1))
    _, xy_px, v_i = frame(rng, 8, P_px)
    xy_px = wrong_focal_length(xy_px, 2.0 * sigma)
    lens = CommonErrors(np.zeros(8), np.zeros((3, 3)), sigma)
    q_ic, P_c, chi2 = refine(CAMERA, first_attitude(xy_px, v_i, P_px), xy_px, v_i, P_px, lens)
    at = predicted(q_ic, v_i)
    H, r = turn_jacobians(CAMERA, at).reshape(-1, 3), (xy_px - at).ravel()
    s = (at - [CAMERA.cx_px, CAMERA.cy_px]).ravel()
    V = 0.02**2 * np.eye(16) + sigma**2 * np.outer(s, s)
    K = np.linalg.solve(H.T @ np.linalg.solve(V, H), np.linalg.solve(V, H).T)
    assert np.allclose(P_c, 0.02**2 * K @ K.T, rtol=1e-6)
    assert chi2 == pytest.approx(r @ np.linalg.solve(V, r), rel=1e-6)
    assert np.abs(K @ r).max() < 1e-3 * np.sqrt(np.diag(P_c)).min()


def test_with_a_wrong_focal_length_the_covariance_is_that_of_what_changes():
    """400 frames of the same stars: chi-square of three degrees of freedom about the mean; no more drops
    than said. To forget the focal length drops good stars."""
    rng = np.random.default_rng(25)
    sigma, P_px = 2e-4, np.tile(0.02**2 * np.eye(2), (8, 1, 1))
    truth, ideal_px, v_i = frame(rng, 8, 1e-20 * P_px)
    lens = CommonErrors(np.zeros(8), np.zeros((3, 3)), sigma)
    errors, dropped = np.empty((400, 3)), np.zeros(2)
    for k in range(400):
        xy_px = wrong_focal_length(ideal_px, 2.0 * sigma) + 0.02 * rng.standard_normal((8, 2))
        q_ic, P_c, _ = refine(CAMERA, truth, xy_px, v_i, P_px, lens)
        errors[k] = rotvec_between(q_ic, truth)
        for j, known in enumerate((lens, None)):
            dropped[j] += drop_worst(CAMERA, truth, xy_px, v_i, P_px, 0.01, 4, known)[0] >= 0
    errors -= errors.mean(axis=0)
    nees = np.einsum("ki,ij,kj->k", errors, np.linalg.inv(P_c), errors) / 3.0
    assert nees.mean() == pytest.approx(1.0, abs=3.5 * np.sqrt(2.0 / 3.0 / 400))
    assert dropped[0] <= 13  # 4 expected; Poisson, 99.9 %
    assert dropped[1] > 100


def test_only_a_misfit_beyond_chance_makes_a_covariance_grow():
    """Chi squared as predicted: the mean of 1/factor, which an NIS is multiplied by, stays one."""
    chi2 = stats.chi2(11).rvs(20000, random_state=np.random.default_rng(26))
    growth = np.array([misfit_growth(one, 11.0, 10.0) for one in chi2])
    follow = np.array([misfit_factor(one, 11.0, 10.0) for one in chi2])
    assert growth.min() == 1.0
    assert (1.0 / growth).mean() == pytest.approx(1.0, abs=0.01)
    assert (1.0 / follow).mean() > 1.03
    assert misfit_growth(44.0, 11.0, 10.0) == pytest.approx((54.0 - 3.0 * np.sqrt(22.0)) / 21.0)


@pytest.mark.parametrize(("n", "k", "m"), [(4, 4, 4), (3, 4, 4), (3, 4, 3), (4, 3, 4), (2, 7, 7), (2, 7, 2)])
def test_products_of_small_matrices(n, k, m):
    """Also of parts of larger ones, and transposed."""
    rng = np.random.default_rng(27)
    A, B = rng.standard_normal((n, k)), rng.standard_normal((k, m))
    wide, turned = np.zeros((n + 2, k + 3)), np.ascontiguousarray(B.T).T
    wide[1:-1, 2:-1] = A
    for left in (A, wide[1:-1, 2:-1]):
        for right in (B, turned):
            np.testing.assert_allclose(product(left, right), A @ B, rtol=1e-14, atol=1e-14)


def shared_exactly(C, P):
    """(I + P C)^-1 P in fractions, by Gauss and Jordan."""
    n = len(P)
    C, P = ([[Fraction(x) for x in row] for row in M.tolist()] for M in (C, P))
    rows = [[sum(P[i][k] * C[k][j] for k in range(n)) + (i == j) for j in range(n)] + P[i] for i in range(n)]
    for k in range(n):
        first = next(i for i in range(k, n) if rows[i][k])
        rows[k], rows[first] = rows[first], rows[k]
        rows[k] = [x / rows[k][k] for x in rows[k]]
        for i in set(range(n)) - {k}:
            rows[i] = [x - rows[i][k] * y for x, y in zip(rows[i], rows[k], strict=True)]
    return np.array([[float(x) for x in row[n:]] for row in rows])


def common_covariance(rng, kind):
    """(4, 4) of the size of (1e-4)^2: of rate and focal length, or of what there is of them."""
    A, P = rng.standard_normal((3, 3)), np.zeros((4, 4))
    if kind in ("rate", "both"):
        P[:3, :3] = 1e-8 * (A @ A.T)
    if kind in ("focal length", "both"):
        P[3, 3] = 1e-8 * rng.uniform(0.1, 10.0)
    if kind == "one turn":  # rank one, all four of it tied together
        P = 1e-8 * np.outer(*2 * [rng.standard_normal(4)])
    if kind == "very unequal":
        scale = 10.0 ** rng.uniform(-3.0, 3.0, 4)
        P = 1e-8 * np.diag(scale)
    return P


@pytest.mark.parametrize("size", [1e2, 1e7, 1e12])
@pytest.mark.parametrize("kind", ["nothing", "rate", "focal length", "both", "one turn", "very unequal"])
def test_what_stars_share_with_any_covariance_of_it(kind, size):
    """D = P (I + C P)^-1 against fractions, in units of its own sigmas, and against NumPy."""
    rng = np.random.default_rng(28)
    for _ in range(40):
        A = rng.standard_normal((20, 4)) * [1.0, 1.0, 0.1, 3.0]  # rolls move a place less
        C, P = size * (A.T @ A), common_covariance(rng, kind)
        found, expected = _shared(C, P), shared_exactly(C, P)
        sigma = np.sqrt(np.diag(expected))
        rounding = 1e-11 * sigma.max() ** 2  # where P, and with it D, is zero
        assert np.all(np.abs(found - expected) <= 1e-8 * np.outer(sigma, sigma) + rounding)
        inverse = P @ np.linalg.inv(np.eye(4) + C @ P)
        np.testing.assert_allclose(found, inverse, rtol=0.0, atol=1e-8 * sigma.max() ** 2)


def test_what_stars_share_where_a_first_element_is_zero():
    """Symmetric and positive definite, both of them, and yet 1 + (P C)_11 = 0: rows have to change places."""
    C, P = np.eye(4), np.eye(4)
    P[:2, :2], C[:2, :2] = [[1.0, -2.0], [-2.0, 5.0]], [[1.0, 1.0], [1.0, 2.0]]
    assert (np.eye(4) + P @ C)[0, 0] == 0.0
    np.testing.assert_allclose(_shared(C, P), shared_exactly(C, P), atol=1e-15)
    np.testing.assert_allclose(_shared(1e12 * C, 1e-12 * P), 1e-12 * shared_exactly(C, P), atol=1e-27)
