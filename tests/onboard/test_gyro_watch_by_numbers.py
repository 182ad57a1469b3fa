"""Comparison of gyros and stars, row by row: variances, steadiness and verdicts by their definition."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from plain import plain
from scipy import stats
from test_integrity_gyro import packed

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import history
from shefex_nav.onboard.navigation import integrity_gyro as gyro
from shefex_nav.onboard.navigation.integrity_gyro import CONFORM, UNDECIDED, WRONG

NOISE = np.array([1e-12, 1e-8, 1e-10, 0.0])
LIMITS = np.array([stats.chi2.isf(p, 3) for p in (1e-9, 0.05, 1e-3, 1e-4)])
Q_B = rotation.quat_from_rotvec(np.array([0.5, -0.2, 1.0]))
C_IB = rotation.dcm_from_quat(Q_B)
SIGMA = 5e-6
NONE = np.array([1.0, 0.0, 0.0, 0.0])  # nothing was corrected


def rows_of(times_s, turned_i, path=0.0, push=0.0, path_stars=0.0, sigma=SIGMA, bias=0.0):
    """Rows of a steady attitude: at each time the stars have turned away by turned_i(t), inertial axes."""
    rows = np.zeros((len(times_s), gyro.WIDTH))
    for row, t_s in zip(rows, times_s, strict=True):
        row[gyro.T] = t_s
        row[gyro.Q_E] = rotation.quat_from_rotvec(np.array(turned_i(t_s)))
        row[gyro.R_I] = (sigma**2 * np.diag([1.0, 4.0, 9.0])).ravel()
        row[gyro.P_BG] = (bias**2 * np.eye(3)).ravel()
        row[gyro.Q_IB] = Q_B
        share = (t_s - times_s[0]) / max(times_s[-1] - times_s[0], 1e-9)
        row[gyro.PATH], row[gyro.PUSH], row[gyro.PATH_STARS] = share * path, share * push, share * path_stars
    return rows


def test_limits_and_noise_are_those_of_the_unit():
    model = SimpleNamespace(gyro_random_walk=2e-6)
    watch = gyro.GyroWatch(model, 3e-4, 5e-6)
    np.testing.assert_allclose(watch.noise, [4e-12, 9e-8, 2.5e-11, 0.0])
    np.testing.assert_allclose(watch.limits, LIMITS, rtol=1e-9)


@pytest.mark.parametrize("camera", [0.0, 1e-2])
def test_the_rotation_between_two_fixes_has_the_variance_of_all_that_turns_it(camera):
    """Fixes at both ends, bias over the time, a random walk, and what grows with angle and with push."""
    noise = NOISE.copy()
    noise[3] = camera**2
    rows = rows_of([2.0, 5.0], lambda t: np.zeros(3), path=0.3, push=40.0, path_stars=0.2, bias=2e-6)
    lasting = 1e-8 * 0.3**2 + 1e-10 * 40.0**2 + camera**2 * 0.2**2
    wanted = 2.0 * SIGMA**2 * np.diag([1.0, 4.0, 9.0]) + (9.0 * 4e-12 + 3e-12 + lasting) * np.eye(3)
    np.testing.assert_allclose(plain(gyro._covariance)(rows, 0, 1, noise), wanted, rtol=1e-9)
    assert plain(gyro._lasting)(rows, 0, 1, noise) == pytest.approx(lasting)


def test_what_is_remembered_of_a_fix():
    """E = e A, noise in inertial axes, the paths of gyros and stars and what has pushed, all summed up."""
    rng, rows = np.random.default_rng(1), np.zeros((3, gyro.WIDTH))
    A, R, P = (
        rotation.quat_from_rotvec(np.array([0.3, 0.1, -0.2])),
        np.diag([1.0, 2.0, 3.0]),
        np.eye(15) + 0.1,
    )
    P[9, 10] = P[10, 9] = 0.7
    attitudes = [rotation.quat_from_rotvec(0.3 * k * np.array([1.0, -2.0, 2.0]) / 3.0) for k in range(3)]
    mounting = np.array([0.02, -0.01, 0.05])
    for k, q in enumerate(attitudes):
        z, f_b = 1e-2 * rng.standard_normal(3), np.array([3.0, 0.0, -4.0])
        seen = gyro.StarSight(1.0 + 0.5 * k, packed(q, mounting), P, z, R, f_b)
        plain(gyro._remember)(rows, k, A, seen)
        C = rotation.dcm_from_quat(q)
        camera = rotation.quat_multiply(q, rotation.quat_from_rotvec(mounting))
        e = C @ rotation.dcm_from_rotvec(mounting) @ z  # z turns the camera, seen from inertia
        wanted = rotation.quat_multiply(rotation.quat_from_rotvec(e), A)
        assert np.linalg.norm(rotation.rotvec_between(wanted, rows[k, gyro.Q_E])) < 1e-9
        np.testing.assert_allclose(rows[k, gyro.R_I].reshape(3, 3), C @ R @ C.T, atol=1e-12)
        np.testing.assert_allclose(rows[k, gyro.P_BG].reshape(3, 3), C @ P[9:12, 9:12] @ C.T, atol=1e-12)
        np.testing.assert_allclose(rows[k, gyro.Q_IB], q)
        assert rows[k, gyro.T] == seen.t_s and rows[k, gyro.PATH] == pytest.approx(0.3 * k)
        assert rows[k, gyro.PUSH] == pytest.approx(5.0 * 0.5 * k) and camera.shape == (4,)
    stars = [rotation.dcm_from_quat(row[gyro.Q_STARS]) for row in rows]
    turns = [np.arccos(0.5 * (np.trace(a.T @ b) - 1.0)) for a, b in pairwise(stars)]
    assert rows[2, gyro.PATH_STARS] == pytest.approx(sum(turns))


def test_a_correction_turns_what_was_seen_before():
    """A <- q+ q-^-1 A, of the camera, so that a turn of the body against its mounting is none."""
    A, turn = (
        rotation.quat_from_rotvec(np.array([0.3, 0.1, -0.2])),
        rotation.quat_from_rotvec(np.array([0.02, 0.01, 0.0])),
    )
    after = rotation.quat_multiply(turn, Q_B)
    before, after = (packed(q, (0.1, 0.0, 0.0)) for q in (Q_B, after))
    got, dr, dv = plain(history._corrected)(A, np.zeros(3), np.zeros(3), 1.0, before, after)
    assert not dr.any() and not dv.any()
    assert np.linalg.norm(rotation.rotvec_between(got, rotation.quat_multiply(turn, A))) < 1e-12


def verdict(rows, noise=NOISE, baselines=(0.4, 2.0, 8.0), limits=LIMITS):
    return gyro._compare(rows, len(rows), np.array(baselines), noise, limits)


TIMES = np.arange(0.0, 2.01, 0.1)
RATE_I = np.array([1.5e-4, -1e-4, 0.5e-4])  # rad/s, 0.37 mrad in two seconds


def test_a_steady_turn_is_wrong_by_its_rate_in_body_axes():
    found, rate_b, sigma_b = verdict(rows_of(TIMES, lambda t: RATE_I * t))
    assert found == WRONG
    np.testing.assert_allclose(rate_b, C_IB.T @ RATE_I, rtol=1e-6)
    S = plain(gyro._covariance)(rows_of([0.0, 2.0], lambda t: 0.0 * RATE_I), 0, 1, NOISE)
    np.testing.assert_allclose(sigma_b, np.sqrt(np.diag(C_IB.T @ S @ C_IB)) / 2.0, rtol=1e-6)


@pytest.mark.parametrize("half", [0, 1])
def test_a_step_is_no_turn(half):
    """All in one half: the other is not significant."""
    step = lambda t: RATE_I * 2.0 * (t > (0.35 if half == 0 else 1.45))  # noqa: E731
    assert verdict(rows_of(TIMES, step))[0] == UNDECIDED


def test_a_turn_must_be_shared_out_evenly():
    """0.12 of it and the noise of the three fixes apart: chi-square of one in twenty."""
    u = np.array([1.0, 0.0, 0.0])
    D = 2e-3
    white = 1e-12 * 2.0 * 0.25 + 4e-13 + (0.12 * D) ** 2
    rim = np.sqrt(LIMITS[1] * (1.5 * SIGMA**2 + white))  # of fixes: 1/4 + 1 + 1/4
    for off, found in ((0.99, WRONG), (1.01, UNDECIDED)):
        bent = lambda t, off=off: u * (D * t / 2.0 + off * rim * (1.0 - abs(t - 1.0)))  # noqa: E731
        assert verdict(rows_of(TIMES, bent), baselines=(2.0,))[0] == found


@pytest.mark.parametrize("size, found", [(0.99, CONFORM), (1.01, UNDECIDED)])
def test_gyros_conform_below_the_quantile_of_one_in_a_thousand(size, found):
    S = plain(gyro._covariance)(rows_of([0.0, 2.0], lambda t: 0.0 * RATE_I), 0, 1, NOISE)
    u = np.array([0.0, 1.0, 0.0])
    D = size * np.sqrt(LIMITS[2] * S[1, 1])
    assert verdict(rows_of(TIMES, lambda t: u * D * t / 2.0))[0] == found
    short = rows_of(TIMES[:5], lambda t: 0.0 * u)  # 0.4 s alone say nothing
    assert verdict(short)[0] == UNDECIDED


@pytest.mark.parametrize("factor, found", [(0.99, UNDECIDED), (1.01, WRONG)])
def test_gyros_are_wrong_beyond_the_quantile_of_one_in_a_thousand_million(factor, found):
    S = plain(gyro._covariance)(rows_of([0.0, 2.0], lambda t: 0.0 * RATE_I), 0, 1, NOISE)
    D = factor * np.sqrt(LIMITS[0] * S[0, 0])
    assert (
        verdict(
            rows_of(TIMES, lambda t: np.array([D * t / 2.0, 0.0, 0.0])),
            baselines=(2.0,),
            limits=LIMITS * [1, 1, 1, 0.1],
        )[0]
        == found
    )


def test_baselines_need_fixes_at_their_ends_and_in_their_middle():
    turns = lambda t: 10.0 * RATE_I * t  # noqa: E731
    given = {"baselines": (2.0,)}
    assert verdict(rows_of([0.0, 1.0, 2.0], turns), **given)[0] == WRONG
    assert verdict(rows_of([0.0, 1.0, 1.99], turns), **given)[0] == UNDECIDED
    assert verdict(rows_of([0.0, 1.5, 2.99], turns), **given)[0] == WRONG
    assert verdict(rows_of([0.0, 1.5, 3.01], turns), **given)[0] == UNDECIDED
    assert verdict(rows_of([0.0, 1.19, 2.0], turns), **given)[0] == WRONG
    assert verdict(rows_of([0.0, 1.21, 2.0], turns), **given)[0] == UNDECIDED
    assert verdict(rows_of([-1.0, 0.0, 1.0, 2.0], turns), **given)[0] == WRONG


def watch():
    return gyro.GyroWatch(SimpleNamespace(gyro_random_walk=1e-6, gyro_quantum=1e-6), 1e-4, 1e-5)


def conclude(one, t_s, verdict=WRONG, rate=(1e-3, 3e-4, 1e-5), sigma=1e-5):
    return one._conclude(t_s, verdict, np.array(rate), np.full(3, sigma))


def test_three_comparisons_within_a_second_call_gyros_wrong():
    """Axes beyond four sigma and a fifth of the largest."""
    one = watch()
    assert conclude(one, 1.0) is None and conclude(one, 1.9) is None
    assert conclude(one, 2.05) is None  # the first is too old
    found = conclude(one, 2.1)
    assert found.axes == ("gyro x", "gyro y") == one.wrong == one.failed and not one.found_s and one.n == 0
    assert found.largest == pytest.approx(np.sqrt(1e-6 + 9e-8 + 1e-10))
    np.testing.assert_allclose(found.admitted, [np.hypot(1e-3, 1e-5), np.hypot(3e-4, 1e-5), 0.0])
    for rate, axes in (
        ((1e-3, 1.9e-4, 0.0), "x"),
        ((4.1e-5, 3.9e-5, 0.0), "x"),
        ((1e-3, 2.1e-4, -9e-4), "xyz"),
    ):
        one = watch()
        for t_s in (1.0, 1.1, 1.2):
            found = conclude(one, t_s, rate=rate)
        assert found.axes == tuple(f"gyro {axis}" for axis in axes)


def test_gyros_recover_when_they_conform():
    one = watch()
    assert one.trust(1.0) and one.is_unchecked(1.0)
    for t_s in (1.0, 1.1, 1.2):
        conclude(one, t_s)
    assert not one.trust(1.2) and one.recovered == []
    assert conclude(one, 2.0, CONFORM) is None
    assert one.trust(2.0) and one.trust(3.0) and not one.trust(3.01) and one.recovered == ["gyro x", "gyro y"]
    one.doubt(0.3)
    assert one.noise[3] == pytest.approx(0.09) and one.failed == gyro.AXES and not one.trust(2.0)
    one.doubt(0.1)
    assert one.noise[3] == pytest.approx(0.09)
    one.doubt(5.0)
    assert one.noise[3] == 1.0


def test_fixes_too_far_apart_begin_anew_and_late_ones_are_left_out():
    one, R, P, f_b = watch(), 1e-10 * np.eye(3), 1e-14 * np.eye(15), np.zeros(3)

    def compare(t_s):
        return one.compare(gyro.StarSight(t_s, packed(Q_B), P, np.zeros(3), R, f_b), NONE)

    for t_s in (0.0, 0.5, 1.04):
        compare(t_s)
    assert one.n == 3
    compare(1.04), compare(0.7)
    assert one.n == 3
    compare(1.6)
    assert one.n == 1  # 0.56 s later
    for k in range(1023):
        compare(1.7 + 0.1 * k)
    assert one.n == 1024 and one.checked_s == pytest.approx(1.7 + 102.2)
    compare(1.7 + 102.3)
    assert one.n == 513 and one.rows[511, gyro.T] == pytest.approx(1.7 + 102.2)
    assert one.rows[0, gyro.T] == pytest.approx(1.7 + 102.2 - 51.1)


def test_the_camera_that_may_be_turned_explains_a_turn_of_the_vehicle():
    """A fix that contradicts by an angle: what stars have turned is wrong by as much, in this comparison."""
    one, R, P, f_b = watch(), 1e-12 * np.eye(3), 1e-16 * np.eye(15), np.zeros(3)
    found = []
    for turned in (0.0, 0.5):
        one = watch()
        for k in range(40):
            angle = 0.05 * k
            q = rotation.quat_from_rotvec(np.array([angle, 0.0, 0.0]))
            z = np.array([0.0, 2e-3 * angle, 0.0])
            seen = gyro.StarSight(0.1 * k, packed(q), P, z, R, f_b)
            found.append((turned, one.compare(seen, NONE, turned)))
        assert one.noise[3] == 0.0
    assert any(one for turned, one in found if turned == 0.0)
    assert not any(one for turned, one in found if turned == 0.5)


@pytest.mark.parametrize(
    "rate_hz, found_s", [(1.5, None), (2.0, 9.0), (10.0, 8.2), (20.0, 8.1), (50.0, 8.04)]
)
def test_a_slow_error_is_found_after_eight_seconds_at_any_rate_of_fixes(rate_hz, found_s):
    """4 arcsec/s with stars good to an arcsecond; 256 rows, halved when full, never have 8 s of 50 Hz."""
    arcsec, rng = np.pi / 648000.0, np.random.default_rng(0)
    watch = gyro.GyroWatch(SimpleNamespace(gyro_random_walk=2e-6), 1e-4, 1e-6)
    sigma, found = arcsec * np.array([1.0, 1.0, 10.0]), None
    for k in range(round(15.0 * rate_hz)):
        z = np.array([0.0, 4.0 * arcsec * k / rate_hz, 0.0]) + sigma * rng.standard_normal(3)
        seen = gyro.StarSight(k / rate_hz, packed(Q_B), 1e-14 * np.eye(15), z, np.diag(sigma**2), np.zeros(3))
        if watch.compare(seen, NONE):
            found = k / rate_hz
            break
    assert found == (None if found_s is None else pytest.approx(found_s, abs=0.2))


def test_eight_seconds_are_left_when_half_of_the_fixes_go():
    assert gyro.ROWS // 2 > 1.2 * 50.0 * gyro.BASELINES_S[-1]
