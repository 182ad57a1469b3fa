"""How a camera turns besides its mean rate: tables against closed forms, places against a drawn streak."""

import numpy as np
import pytest

from shefex_nav.geometry import unsteady
from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.geometry.shutter import row_times
from shefex_nav.geometry.streak import place_at, turn_jacobian

CAMERA = Pinhole(focal_length_px=2000.0, width_px=1024, height_px=1024, cx_px=511.5, cy_px=511.5)
T = 0.1
ALPHA = np.array([0.3, -0.2, 0.1])  # rad/s^2


def accelerated(n=200):
    """Table of a turn by ALPHA t^2 / 2, whose mean rate is that of the middle."""
    t = np.linspace(-0.5 * T, 0.5 * T, n + 1)
    return np.column_stack([t, 0.5 * np.outer(t**2, ALPHA)])


def test_a_steady_rate_has_no_rows():
    for of in (unsteady.rotation_at(unsteady.STEADY, 0.01), unsteady.mean_rotation(unsteady.STEADY, -T, T)):
        np.testing.assert_array_equal(of, np.zeros(3))


@pytest.mark.parametrize("t", [-0.05, -0.0123, 0.0, 0.031, 0.05])
def test_between_rows_it_is_linear(t):
    np.testing.assert_allclose(unsteady.rotation_at(accelerated(), t), 0.5 * ALPHA * t**2, atol=1e-7)


@pytest.mark.parametrize("begin, end", [(-0.05, 0.05), (-0.05, 0.0), (0.013, 0.0371), (0.0101, 0.0102)])
def test_mean_of_an_acceleration(begin, end):
    mean = ALPHA * (end**3 - begin**3) / 6.0 / (end - begin)
    np.testing.assert_allclose(unsteady.mean_rotation(accelerated(), begin, end), mean, atol=1e-7)


def test_the_mean_of_an_exposure_is_a_third_of_its_ends():
    np.testing.assert_allclose(
        unsteady.mean_rotation(accelerated(), -0.5 * T, 0.5 * T), ALPHA * T**2 / 24, rtol=1e-3
    )


@pytest.mark.parametrize("half_px", [0.01, 0.5, 2.0, 5.0, 40.0])
def test_what_a_fit_sees_along_a_streak(half_px):
    """Light moved along an even streak, drawn fine and fitted by least squares in place alone."""
    sigma, table = 1.0, accelerated()
    t = np.linspace(-0.5 * T, 0.5 * T, 4001)
    s = 2.0 * t / T * half_px
    moved = 1e-3 * (t / T) ** 2  # px, a small displacement of the light at each time
    x = np.linspace(-half_px - 8.0, half_px + 8.0, 3000)

    def drawn(places):
        return np.exp(-0.5 * ((x[:, None] - places[None, :]) / sigma) ** 2).sum(axis=1)

    slope = (drawn(s + 1e-4) - drawn(s - 1e-4)) / 2e-4
    fitted = slope @ (drawn(s + moved) - drawn(s)) / (slope @ slope)
    seen = unsteady.fitted_rotation(unsteady.turns_of(table, -0.5 * T, 0.5 * T), half_px, sigma)
    expected = 1e-3 * seen[0] / (0.5 * ALPHA[0] * T**2)
    assert fitted == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("half_px", [0.0, 0.4, 3.0, 20.0])
def test_weights_of_a_fit_written_out(half_px):
    """The sum of `fitted_rotation`'s docstring over the points, one after the other; no turn is symmetric."""
    sigma, table, ends = 0.8, accelerated(), (-0.3 * T, 0.4 * T)
    table[:, 1:] += 1e-4 * np.sin(90.0 * table[:, :1])
    total, weights = np.zeros(3), 0.0
    for part in (np.arange(unsteady.POINTS) + 0.5) / unsteady.POINTS:
        s, t_s = (2.0 * part - 1.0) * half_px, ends[0] + part * (ends[1] - ends[0])
        weight = sum(d * np.exp(-((d / (2.0 * sigma)) ** 2)) for d in (half_px + s, half_px - s))
        total += weight * np.array([np.interp(t_s, table[:, 0], table[:, 1 + j]) for j in range(3)])
        weights += weight
    turns = unsteady.turns_of(table, *ends)
    expected = total / weights if weights else unsteady.mean_rotation(table, *ends)
    np.testing.assert_allclose(unsteady.fitted_rotation(turns, half_px, sigma), expected, rtol=1e-12)


@pytest.mark.parametrize("line_s", [0.0, 4e-5])
def test_each_star_is_brought_back_as_if_it_were_alone(line_s):
    """What stars share of an exposure is worked out once: to the last bit the same."""
    omega, exposed = np.array([0.02, -0.03, 0.1]), (T, line_s, CAMERA.height_px)
    seen_px = np.array([[100.0, 90.0], [500.0, 520.0], [520.0, 520.0], [950.0, 900.0]])
    given = CAMERA, 1.0, exposed, omega, accelerated()
    places, seen_s = unsteady.at_instant(*given, seen_px)
    for k in range(len(seen_px)):
        place, at_s = unsteady.at_instant(*given, seen_px[k : k + 1])
        np.testing.assert_array_equal(places[k], place[0])
        assert seen_s[k] == at_s[0]


@pytest.mark.parametrize("line_s", [0.0, 4e-5])
def test_places_come_back_to_the_instant(line_s):
    """Stars carried along the path, averaged over their exposures, and brought back."""
    omega = np.array([0.002, -0.003, 0.01])
    exposed = T, line_s, CAMERA.height_px
    times, table = row_times(*exposed), accelerated()
    table[:, 0] *= 2.0  # the rows of a rolling shutter take longer than one exposure
    table[:, 1:] *= 4.0
    true_px = np.array([[100.0, 90.0], [500.0, 520.0], [950.0, 900.0]])
    seen_px = np.empty_like(true_px)
    for k, (x, y) in enumerate(true_px):
        begin = (y - times.middle_row) * line_s - 0.5 * T
        at_s = begin + T * (np.arange(400) + 0.5) / 400.0
        H = turn_jacobian(CAMERA, x, y)
        path = [place_at(CAMERA, omega, x, y, t) + H @ (0.5 * ALPHA * t**2) for t in at_s]
        seen_px[k] = np.mean(path, axis=0)
    places, seen_s = unsteady.at_instant(CAMERA, 50.0, exposed, omega, table, seen_px)
    np.testing.assert_allclose(places, true_px, atol=2e-3)
    np.testing.assert_allclose(seen_s, (true_px[:, 1] - times.middle_row) * line_s, atol=1e-4)
    steady, _ = unsteady.at_instant(CAMERA, 50.0, exposed, omega, unsteady.STEADY, seen_px)
    assert np.abs(steady - true_px).max() > 0.1
