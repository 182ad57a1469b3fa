"""Steps of a covariance with large angles, each by its definition: moments of turned vectors, algebra."""

import numpy as np
import pytest
from plain import plain

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import unknown_attitude as unknown
from shefex_nav.onboard.navigation.state import ATT, POS, VEL
from shefex_nav.onboard.navigation.unknown_attitude import UNKNOWN2

N = 15
Q = rotation.quat_from_rotvec(np.array([0.5, -0.9, 0.3]))
C = rotation.dcm_from_quat(Q)
UNIT = np.eye(3)


def covariance(seed, angle=1.0):
    """(15, 15) with ties, the attitude's sigmas about `angle`."""
    A = np.random.default_rng(seed).standard_normal((N, N))
    P = A @ A.T / N
    scale = np.ones(N)
    scale[ATT] = angle
    return P * np.outer(scale, scale)


def changed(step, P, *given):
    """What a step that works in place makes of a covariance."""
    after = P.copy()
    plain(step)(after, *given)
    return after


def test_an_unknown_angle_has_the_variance_of_any():
    angles = np.linspace(-np.pi, np.pi, 100_001)
    assert np.mean(angles**2) == pytest.approx(UNKNOWN2, rel=1e-4)


@pytest.mark.parametrize("sigma", [0.05, 0.5, 2.0])
def test_the_sine_of_a_normal_angle(sigma):
    """Its standard deviation over that of the angle, by 200 000 draws; 1 of none."""
    angle = sigma * np.random.default_rng(1).standard_normal(200_000)
    got = plain(unknown._sine_share)(sigma**2)
    assert got == pytest.approx(np.sin(angle).std() / sigma, rel=0.01)
    assert plain(unknown._sine_share)(0.0) == 1.0


@pytest.mark.parametrize("k", range(3))
@pytest.mark.parametrize("angle", [0.01, 0.6])
def test_force_that_is_not_read_is_lost_across_its_axis(k, angle):
    """m theta x e_k of an m of known variance: its covariance is m^2 [e_k]x P [e_k]x^T, turned into inertia.

    Of large angles the sines count, whose covariance is smaller axis by axis.
    """
    P, variance = covariance(k, angle), 7.0
    share = np.sqrt(-0.5 * np.expm1(-2.0 * P.diagonal()[ATT]) / P.diagonal()[ATT])
    across = C @ rotation.skew(UNIT[k]).T * share  # theta x e_k = [e_k]x^T theta
    wanted = P.copy()
    wanted[VEL, VEL] += variance * across @ P[ATT, ATT] @ across.T
    np.testing.assert_allclose(changed(unknown._lose_force, P, k, variance, Q), wanted, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("variance", [0.01, 0.5, 4.0])
def test_velocity_that_a_large_angle_loses(variance):
    """Mean square of 1 - cos of a normal angle, in one direction: it adds to the sigma that is there."""
    axis, speed, P = np.array([2.0, -1.0, 2.0]) / 3.0, np.array([30.0, 5.0, -9.0]), covariance(1)
    across = C @ (speed - axis * (axis @ speed))
    h = np.sqrt(variance) * np.random.default_rng(2).standard_normal(400_000)
    lost = np.sqrt(np.mean((1.0 - np.cos(h)) ** 2)) * np.linalg.norm(across)
    u = across / np.linalg.norm(across)
    sigma = np.sqrt(u @ P[VEL, VEL] @ u)
    got = changed(unknown._lose_across, P, variance, tuple(axis), tuple(speed), Q)
    more = (got - P)[VEL, VEL]
    assert u @ more @ u == pytest.approx((sigma + lost) ** 2 - sigma**2, rel=0.01)
    np.testing.assert_allclose(more, (u @ more @ u) * np.outer(u, u), atol=1e-9)
    assert np.array_equal(changed(unknown._lose_across, P, variance, tuple(axis), (0.0, 0.0, 0.0), Q), P)


def test_the_second_order_counts_about_each_axis_that_has_no_ties():
    """Angles of which two are large: the loss of each, in turn, and a turn at most about each."""
    P = covariance(3)
    B = rotation.dcm_from_rotvec(np.array([0.2, 0.7, -0.4]))
    P[ATT, ATT] = B @ np.diag([0.3, 1.5, 6.0]) @ B.T
    speed, wanted = (12.0, -3.0, 4.0), P.copy()
    for value, axis in zip([0.3, 1.5, 6.0], B.T, strict=True):
        plain(unknown._lose_across)(wanted, value, tuple(axis), speed, Q)
    plain(unknown._wrap)(wanted, 6.0, tuple(B[:, 2]))
    np.testing.assert_allclose(changed(unknown._add_second_order, P, speed, Q), wanted, rtol=1e-8, atol=1e-9)
    flat = P.copy()
    flat[ATT] = flat[:, ATT] = 0.0
    assert np.array_equal(changed(unknown._add_second_order, flat, speed, Q), flat)


def test_an_angle_beyond_a_turn_has_the_variance_of_any_and_ties_that_fade():
    """E[v sin-like] of a normal angle falls by exp(-growth/2) beyond pi^2/3; it stays a covariance."""
    axis, growth = np.array([2.0, 3.0, 6.0]) / 7.0, 1.2
    P = covariance(4, 0.2)
    P[ATT, ATT] += (UNKNOWN2 + growth - axis @ P[ATT, ATT] @ axis) * np.outer(axis, axis)
    variance = axis @ P[ATT, ATT] @ axis
    got = changed(unknown._wrap, P, variance, tuple(axis))
    left = np.exp(-0.5 * growth) * np.sqrt(UNKNOWN2 / variance)
    assert axis @ got[ATT, ATT] @ axis == pytest.approx(UNKNOWN2)
    np.testing.assert_allclose(axis @ got[ATT, VEL], left * axis @ P[ATT, VEL], rtol=1e-9)
    np.testing.assert_allclose(got, got.T, atol=1e-12)
    other = np.cross(axis, UNIT[0])
    np.testing.assert_allclose(other @ got[ATT, VEL], other @ P[ATT, VEL], rtol=1e-9)
    np.testing.assert_array_equal(got[POS, VEL], P[POS, VEL])


def test_a_cut_angle_is_one_of_which_nothing_is_known():
    P = covariance(5)
    got, k = changed(unknown._cut, P, 7), [j for j in range(N) if j != 7]
    assert got[7, 7] == UNKNOWN2 and not got[7, k].any() and not got[k, 7].any()
    np.testing.assert_array_equal(got[np.ix_(k, k)], P[np.ix_(k, k)])


@pytest.mark.parametrize("k", range(3))
def test_an_axis_moves_by_the_angle_across_it(k):
    """In one direction: sigma plus the angle, of both axes across."""
    P, angle = covariance(6), np.array([0.3, -0.4, 1.2])
    across = [i for i in range(3) if i != k]
    moved = np.linalg.norm(angle[across])
    wanted = P.copy()
    for i in across:
        wanted[6 + i, 6 + i] = (np.sqrt(P[6 + i, 6 + i]) + moved) ** 2
    np.testing.assert_allclose(changed(unknown._lose_axis, P, k, angle), wanted, rtol=1e-12)


@pytest.mark.parametrize("k", range(3))
def test_no_direction_across_an_axis_is_known_better(k):
    """Both have the largest variance that any direction across had."""
    P = covariance(7)
    i, j = 6 + (k + 1) % 3, 6 + (k + 2) % 3
    largest = np.linalg.eigvalsh(P[np.ix_([i, j], [i, j])])[-1]
    wanted = P.copy()
    wanted[i, i] = wanted[j, j] = largest
    wanted[i, j] = wanted[j, i] = 0.0
    np.testing.assert_allclose(changed(unknown._lose_direction, P, k), wanted, rtol=1e-9)


QUIET, STILL = np.zeros((3, 3)), (0.0, 0.0, 0.0)


def test_what_is_put_right_depends_on_what_is_unknown():
    """Small angles: nothing. An axis beyond a turn: cut, moved, and without direction. A force not read."""
    angle, speed = (0.3, -0.4, 1.2), (12e-6, -3e-6, 4e-6)
    small = covariance(8, 0.02)
    assert np.array_equal(changed(unknown.widen, small, angle, speed, QUIET, 0.01, Q), small)
    P = covariance(8, 0.02)
    for k in range(3):
        wide = P.copy()
        wide[6 + k, 6 + k] = 1.06 * UNKNOWN2
        wanted = wide.copy()
        plain(unknown._cut)(wanted, 6 + k)
        plain(unknown._lose_axis)(wanted, k, angle)
        plain(unknown._lose_direction)(wanted, k)
        plain(unknown._add_second_order)(wanted, STILL, Q)
        np.testing.assert_allclose(
            changed(unknown.widen, wide, angle, STILL, QUIET, 0.01, Q), wanted, rtol=1e-9
        )
    wide = P.copy()
    wide[7, 7] = 1.04 * UNKNOWN2  # within the margin: it loses its ties little by little
    got = changed(unknown.widen, wide, angle, STILL, QUIET, 0.01, Q)
    assert got[7, 7] == pytest.approx(UNKNOWN2, rel=1e-3) and got[6, 6] == pytest.approx(P[6, 6], rel=1e-6)
    extra = np.zeros((3, 3))
    extra[0], extra[1, 1] = 5.0, 3.0  # of gyros nothing follows for the force
    wanted = small.copy()
    plain(unknown._lose_force)(wanted, 1, 100.0 * 0.01 * 3.0, Q)
    np.testing.assert_allclose(changed(unknown.widen, small, angle, speed, extra, 0.01, Q), wanted, rtol=1e-9)
    for k in range(3):  # beyond 0.05 rad the second order begins to count, about any axis
        just = np.diag(np.full(N, 1e-8))
        just[VEL, VEL] = np.eye(3)
        just[6 + k, 6 + k] = 0.051**2
        assert not np.array_equal(changed(unknown.widen, just, angle, speed, QUIET, 0.01, Q), just)
        just[6 + k, 6 + k] = 0.049**2
        assert np.array_equal(changed(unknown.widen, just, angle, speed, QUIET, 0.01, Q), just)
        assert unknown.is_known(just)
        just[6 + k, 6 + k] = 0.051**2
        assert not unknown.is_known(just)


def lost_by_small_angles(P, speed):
    """Mean loss of velocity along `speed`, (3,) m/s in an interval, by 400 000 drawn attitudes: m/s."""
    theta = np.random.default_rng(5).multivariate_normal(np.zeros(3), P[ATT, ATT], 400_000)
    return -(np.cross(theta, np.cross(theta, speed)) @ speed).mean() / np.linalg.norm(speed) / 2.0


def test_small_angles_count_where_the_velocity_is_known_better_than_what_they_take_from_it():
    """Ten seconds of the force take a tenth of the velocity's smallest sigma; about its own axis nothing."""
    P, speed, T = covariance(4, 0.02), np.array([0.3, -0.1, 0.2]), 0.01
    sigma = lost_by_small_angles(P, speed) * unknown.LASTS / T / unknown.SMALL
    for factor, counts in ((0.95, True), (1.05, False)):
        P[VEL, VEL] = np.diag([9.0, (factor * sigma) ** 2, 9.0])
        P[VEL, VEL][0, 0] = P[VEL, VEL][2, 2] = (2.0 * sigma) ** 2
        assert plain(unknown._is_bent)(P, speed, T) == counts
        assert np.array_equal(changed(unknown.widen, P, STILL, speed, QUIET, T, Q), P) != counts
    P[ATT, ATT] = 1e-3 * np.outer(speed, speed)
    assert not plain(unknown._is_bent)(P, speed, T) and not plain(unknown._is_bent)(P, np.zeros(3), T)


@pytest.mark.parametrize("before, gain", [(0.01, 0.9), (0.5, 0.6), (2.0, 0.3), (3.0, 0.99)])
def test_the_best_gain_for_the_sine_of_an_angle(before, gain):
    """By least squares of 400 000 draws: an angle, its sine with noise. No more than the linear gain."""
    noise2 = before * (1.0 / gain - 1.0)
    rng = np.random.default_rng(3)
    h = np.sqrt(before) * rng.standard_normal(400_000)
    seen = np.sin(h) + np.sqrt(noise2) * rng.standard_normal(400_000)
    best = min((h @ seen) / (seen @ seen), gain)
    share, after = unknown._by_the_sine(np.full(3, before), np.full(3, before * (1.0 - gain)))
    np.testing.assert_allclose(share, best / gain, rtol=0.02, atol=0.005)
    np.testing.assert_allclose(after, np.mean((h - share[0] * gain * seen) ** 2), rtol=0.02)


def test_a_share_is_taken_about_each_axis_without_ties():
    P = covariance(9)
    B = rotation.dcm_from_rotvec(np.array([0.2, 0.7, -0.4]))
    P[ATT, ATT] = B @ np.diag([0.3, 1.5, 2.5]) @ B.T
    H, R = np.zeros((3, N)), 0.2 * np.eye(3)
    H[:, ATT] = np.eye(3)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    updated, z = P - K @ H @ P, np.array([0.3, -0.8, 0.5])
    dx, linear = K @ z, K @ z
    after = unknown.take_share(dx, P, updated)
    share, left = unknown._by_the_sine(np.array([0.3, 1.5, 2.5]), np.diag(B.T @ updated[ATT, ATT] @ B))
    np.testing.assert_allclose(dx[ATT], B @ (share * (B.T @ linear[ATT])), rtol=1e-7)
    np.testing.assert_allclose(np.delete(dx, [6, 7, 8]), np.delete(linear, [6, 7, 8]), rtol=1e-7)
    assert np.all(np.diag(B.T @ after[ATT, ATT] @ B) >= left * (1.0 - 1e-9))
    assert np.linalg.eigvalsh(after - updated).min() > -1e-9
    small = covariance(9, 0.01)
    assert unknown.take_share(dx, small, updated) is updated


def heading(angle, variance=UNKNOWN2, length=60.0, noise=0.5):
    """An angle about body z that is hardly known, and the velocity d = C (length, 0, 0) gained across it."""
    d_b = np.array([length, 0.0, 0.0])
    P = np.diag([*[1.0] * 3, *[1e-4] * 3, 1e-8, 1e-8, variance, *[1e-8] * 6])
    tie = C @ np.cross(UNIT[2], d_b) * variance
    P[VEL, 8] = P[8, VEL] = tie
    P[VEL, VEL] += np.outer(tie, tie) / variance
    turned = C @ (rotation.dcm_from_rotvec(angle * UNIT[2]) @ d_b - d_b)
    H = np.zeros((3, N))
    H[:, VEL] = np.eye(3)
    return P, turned, H, noise**2 * np.eye(3), d_b


@pytest.mark.parametrize("deg", [-170.0, -60.0, 5.0, 100.0, 179.0])
def test_a_long_vector_tells_its_angle_as_a_whole(deg):
    """What is added is d turned by the angle less its linear part h u x d; the rest is linear."""
    h = np.radians(deg)
    P, z, H, R, d_b = heading(h)
    more = unknown.second_order(P, z, H, R, Q)
    linear = h * C @ np.cross(UNIT[2], d_b)
    np.testing.assert_allclose(z - H @ more, linear, atol=1e-6 * np.abs(linear).max())
    assert not more[ATT].any() and not more[9:].any()


def test_ties_along_the_axis_tell_nothing_of_the_vector_across():
    """A velocity along the axis that goes with the angle is none that the angle has turned."""
    P, z, H, R, _ = heading(1.0)
    more, tie = unknown.second_order(P, z, H, R, Q), 5.0 * UNKNOWN2 * C[:, 2]
    P[VEL, 8] += tie
    P[8, VEL] += tie
    P[VEL, VEL] += 25.0 * UNKNOWN2 * np.outer(C[:, 2], C[:, 2])
    np.testing.assert_allclose(unknown.second_order(P, z, H, R, Q), more, atol=1e-9)
    P, z, H, R, _ = heading(1.0)
    P[POS, 8] = P[8, POS] = 2.0 * P[VEL, 8]  # of a position that was gained likewise, seen or not
    P[POS, POS] += 4.0 * P[VEL, VEL]
    got = unknown.second_order(P, z, H, R, Q)
    np.testing.assert_allclose(got[POS], 2.0 * got[VEL], atol=1e-9)
    np.testing.assert_allclose(got[VEL], more[VEL], atol=1e-6)


def test_a_vector_must_be_five_times_as_long_as_it_is_uncertain():
    for noise, tells in ((11.9, True), (12.1, False)):
        P, z, H, R, _ = heading(1.0, noise=noise)
        assert (unknown.second_order(P, z, H, R, Q) is not None) == tells
    for sigma, tells in ((0.21, True), (0.19, False)):
        P, z, H, R, _ = heading(0.2, variance=sigma**2, noise=0.01)
        assert (unknown.second_order(P, z, H, R, Q) is not None) == tells
    P, z, H, R, _ = heading(1.0, length=0.0)
    assert unknown.second_order(P, z, H, R, Q) is None


def test_what_is_not_linear_of_a_lever_arm():
    """theta x (theta x l)/2: a quarter of the mean square angle times that across; twice the arm at most."""
    arm, P = np.array([0.0, 3.0, 4.0]), np.zeros((N, N))
    P[ATT, ATT] = np.diag([0.01, 0.04, 0.0])
    across = 0.05 * 25.0 - 9.0 * 0.04  # tr P |l|^2 - l^T P l
    assert unknown.of_arm(P, arm) == pytest.approx(100.0 * 0.25 * 0.05 * across)
    P[ATT, ATT] = 9.0 * np.eye(3)
    assert unknown.of_arm(P, arm) == pytest.approx(100.0 * 4.0 * 25.0)
    P[ATT, ATT] = 0.04**2 * np.eye(3)
    assert unknown.of_arm(P, arm) == 0.0
