"""Equations (5) to (22) of the Improved Multi-Poles paper: streaks of points, for which they are exact."""

from dataclasses import replace

import numpy as np
import pytest
from star_fields import DETECT

from shefex_nav.geometry.shutter import row_start_s, row_times
from shefex_nav.papers.impa.methods.compensate import compensate

TIMES = row_times(0.2, 0.2 / 1024, 1024)  # the paper's T_exp = t_l n_row
SETTINGS = replace(DETECT.run_length, slowest=10.0)
SIGMA = np.full((1, 2), 0.1)
VELOCITIES = [(vx, vy) for vx in (-240.0, -30.0, 0.0, 60.0) for vy in (-250.0, -20.0, 0.0, 250.0)]


def point_streak(times, xy_px, velocity):
    """Middle and extents of what a point leaves that is at xy at the instant, by solving for its two ends."""
    x, y = xy_px
    vx, vy = velocity
    # row_start(y + vy t) = t, and the same later by the exposure
    begin = row_start_s(times, y) / (1.0 - vy * times.line_s)
    end = (row_start_s(times, y) + times.exposure_s) / (1.0 - vy * times.line_s)
    ends = np.array([[x + vx * t, y + vy * t] for t in (begin, end)])
    return ends.mean(axis=0), np.abs(ends[1] - ends[0]), end - begin


@pytest.mark.parametrize("velocity", VELOCITIES)
@pytest.mark.parametrize("row", [10.0, 511.5, 1000.0])
@pytest.mark.parametrize("times", [TIMES, row_times(0.05, 1e-5, 493), row_times(0.2, 0.0, 1024)])
def test_points_are_put_where_they_were(velocity, row, times):
    xy_px = np.array([400.0, min(row, 2.0 * times.middle_row)])
    middle, extent, seen_s = point_streak(times, xy_px, velocity)
    shift = np.array(velocity) * times.exposure_s
    found = compensate(SETTINGS, times, middle[None], extent[None], shift[None], SIGMA)
    np.testing.assert_allclose(found.xy_px[0], xy_px, atol=1e-9)
    np.testing.assert_allclose(found.velocity_px_s[0], velocity, atol=1e-9)
    np.testing.assert_allclose(found.seen_s[0], seen_s, rtol=1e-12)


def test_implicit_form_solves_equation_22_as_printed():
    for velocity in ((100.0, 250.0), (100.0, -250.0)):
        middle, extent, _ = point_streak(TIMES, (300.0, 1000.0), velocity)
        shift = 0.2 * np.array([velocity])
        found = compensate(SETTINGS, TIMES, middle[None], extent[None], shift, SIGMA, "implicit")
        late_s = TIMES.line_s * (TIMES.middle_row - found.xy_px[0, 1])
        np.testing.assert_allclose(found.xy_px[0] - middle, np.array(velocity) * late_s, rtol=1e-12)
        explicit = compensate(SETTINGS, TIMES, middle[None], extent[None], shift, SIGMA)
        assert 1.0 < abs(found.xy_px[0, 1] - explicit.xy_px[0, 1]) < 1.5  # "up to 1.3 px"
    with pytest.raises(ValueError, match="explicit, implicit"):
        compensate(SETTINGS, TIMES, middle[None], extent[None], shift, SIGMA, "exact")


def test_signs_with_and_against_the_rows():
    """Equations (11) and (14) in numbers: 50 rows in 0.2 s + 50 t_l, or in 0.2 s - 50 t_l."""
    for sign, seen in ((1.0, 0.2 + 50 * TIMES.line_s), (-1.0, 0.2 - 50 * TIMES.line_s)):
        shift = np.array([[-8.0, sign * 50.0]])
        found = compensate(SETTINGS, TIMES, np.array([[1.0, 2.0]]), np.array([[8, 50]]), shift, SIGMA)
        np.testing.assert_allclose(found.velocity_px_s[0], [-8.0 / seen, sign * 50.0 / seen])


def test_below_v_star_nothing_moves():
    """A bright star at rest is six pixels wide and its shift is noise; a streak along x has no y."""
    xy_px, extent = np.array([[500.0, 900.0], [500.0, 900.0]]), np.array([[6, 6], [40, 3]])
    found = compensate(
        SETTINGS, TIMES, xy_px, extent, np.array([[0.1, -0.2], [40.0, 0.3]]), np.tile(SIGMA, (2, 1))
    )
    np.testing.assert_array_equal(found.xy_px[0], xy_px[0])
    np.testing.assert_array_equal(found.velocity_px_s[:, 1], 0.0)
    assert found.xy_px[1, 1] == 900.0 and found.xy_px[1, 0] < 490.0


def test_no_star_makes_a_streak_longer_than_the_rows_allow():
    """Against the rows dk t_l < T_exp always; a scratch over all rows of a slow detector is not a star."""
    times = row_times(0.05, 1e-3, 100)
    found = compensate(
        SETTINGS, times, np.array([[50.0, 50.0]]), np.array([[0, 60]]), np.array([[0.0, -9.0]]), SIGMA
    )
    assert np.isnan(found.xy_px).all()


def test_covariance_is_of_noise_ends_and_the_way_carried():
    shift = np.array([[30.0, 40.0]])
    spread = {}
    for row in (511.5, 800.0, 1020.0):
        found = compensate(SETTINGS, TIMES, np.array([[5.0, row]]), np.array([[30, 40]]), shift, SIGMA)
        spread[row] = found.P_px[0]
        np.testing.assert_allclose(found.P_px[0], found.P_px[0].T)
    value, vector = np.linalg.eigh(spread[511.5])
    np.testing.assert_allclose(value[0], 0.01)  # across: the noise alone
    np.testing.assert_allclose(np.abs(vector[:, 1]), [0.6, 0.8])  # along the streak
    assert np.trace(spread[511.5]) < np.trace(spread[800.0]) < np.trace(spread[1020.0])
    rest = compensate(SETTINGS, TIMES, np.array([[5.0, 1020.0]]), np.array([[6, 6]]), np.zeros((1, 2)), SIGMA)
    np.testing.assert_allclose(rest.P_px[0], 0.01 * np.eye(2))  # at rest there is nothing to carry
