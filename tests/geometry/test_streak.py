"""The path of a star: against rotation matrices, its own derivative, and the shutter's definition."""

import numpy as np
import pytest

from shefex_nav.geometry.pinhole import Pinhole, pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.geometry.shutter import duration_s, instant_after_s, row_start_s, row_times
from shefex_nav.geometry.streak import (
    middles_seen,
    place_at,
    rate_lever,
    seen_from_to,
    turn_jacobian,
    turn_jacobians,
    velocity,
)

CAMERA = Pinhole(1024, 1024, 2889.0, 510.3, 512.9)


def some_turns(n):
    rng = np.random.default_rng(5)
    return rng.normal(size=(n, 3)) * 0.1, rng.uniform(0.0, 1023.0, (n, 2)), rng.uniform(-0.3, 0.3, n)


def test_place_is_the_rotated_direction():
    for omega_c, xy_px, t_s in zip(*some_turns(50), strict=True):
        C_c = dcm_from_rotvec(-omega_c * t_s)
        expected = pixels(CAMERA, unit_vectors(CAMERA, xy_px[None]) @ C_c.T)[0]
        assert np.allclose(place_at(CAMERA, omega_c, *xy_px, t_s), expected, rtol=0.0, atol=1e-9)


def test_a_camera_at_rest_sees_no_motion():
    assert place_at(CAMERA, np.zeros(3), 3.0, 900.0, 10.0) == pytest.approx((3.0, 900.0), abs=1e-9)


def test_velocity_is_the_derivative_of_the_place():
    h = 1e-5
    for omega_c, xy_px, _ in zip(*some_turns(50), strict=True):
        after, before = place_at(CAMERA, omega_c, *xy_px, h), place_at(CAMERA, omega_c, *xy_px, -h)
        expected = (np.array(after) - np.array(before)) / (2.0 * h)
        assert np.allclose(velocity(CAMERA, omega_c, *xy_px), expected, rtol=1e-6, atol=1e-4)


def test_rolling_rows_follow_one_another_and_zero_is_in_their_middle():
    times = row_times(0.2, 0.2 / 1024, 1024)
    starts = row_start_s(times, np.arange(1024.0))
    assert np.diff(starts) == pytest.approx(0.2 / 1024)
    assert starts[0] == pytest.approx(-instant_after_s(times))
    assert starts[-1] + 0.2 == pytest.approx(duration_s(times) - instant_after_s(times))
    assert starts.mean() + 0.1 == pytest.approx(0.0)


def test_light_is_collected_while_the_row_under_the_star_is_open():
    times = row_times(0.2, 0.2 / 1024, 1024)
    for omega_c, xy_px, _ in zip(*some_turns(50), strict=True):
        begin_s, end_s = seen_from_to(CAMERA, times, omega_c, *xy_px)
        _, y_begin = place_at(CAMERA, omega_c, *xy_px, begin_s)
        _, y_end = place_at(CAMERA, omega_c, *xy_px, end_s)
        assert begin_s == pytest.approx(row_start_s(times, y_begin), abs=1e-8)
        assert end_s == pytest.approx(row_start_s(times, y_end) + 0.2, abs=1e-8)


def test_a_star_that_runs_with_the_rows_is_seen_longer():
    """IMPA equations (9) and (11): T_eff = T + dk t_l with dk = T / (T_row - t_l) rows."""
    times = row_times(0.2, 0.2 / 1024, 1024)
    for sign in (1.0, -1.0):
        omega_c = np.array([sign * 0.08, 0.0, 0.0])
        begin_s, end_s = seen_from_to(CAMERA, times, omega_c, 512.0, 512.0)
        _, vy = velocity(CAMERA, omega_c, 512.0, 512.0)
        assert np.sign(vy) == sign
        assert end_s - begin_s == pytest.approx(0.2 / (1.0 - vy * times.line_s), rel=1e-4)


def test_a_star_that_outruns_the_rows_has_no_one_exposure():
    """Faster than a row a line time: t = row_start(y(t)) has any number of solutions."""
    times = row_times(0.2, 0.2 / 1024, 1024)
    omega_c = np.array([2.5, 0.0, 0.0])
    _, vy = velocity(CAMERA, omega_c, 512.0, 512.0)
    assert vy * times.line_s > 1.0
    assert np.isnan(seen_from_to(CAMERA, times, omega_c, 512.0, 512.0)).all()


def test_a_small_turn_moves_a_star_by_the_jacobian():
    step = 1e-6
    for xy_px in ([12.0, 7.5], [640.0, 980.0], [512.0, 500.0]):
        u_c = unit_vectors(CAMERA, np.array([xy_px]))
        H = turn_jacobian(CAMERA, *xy_px)
        for axis in np.eye(3):
            ways = [pixels(CAMERA, u_c @ dcm_from_rotvec(sign * step * axis))[0] for sign in (0.5, -0.5)]
            assert np.allclose(H @ axis, (ways[0] - ways[1]) / step, rtol=1e-5, atol=1e-3)
        assert np.array_equal(turn_jacobians(CAMERA, np.array([xy_px]))[0], H)


def test_a_wrong_rate_moves_the_place_at_the_instant_by_its_lever():
    """A star is seen in the middle of its time and carried to time zero with one rate and with another."""
    times, step = row_times(0.2, 0.2 / 1024, 1024), 1e-6
    omega_c = np.array([0.05, -0.06, 0.03])
    for xy_px in ([100.0, 60.0], [900.0, 950.0]):
        t_s = middles_seen(CAMERA, times, omega_c, np.array([xy_px]))[0]
        seen_px = place_at(CAMERA, omega_c, *xy_px, t_s)
        S = rate_lever(CAMERA, times, omega_c, *xy_px)
        for axis in np.eye(3):
            low = place_at(CAMERA, omega_c - step * axis, *seen_px, -t_s)
            assert np.allclose((np.array(low) - xy_px) / step, S @ axis, rtol=0.02, atol=2.0)
