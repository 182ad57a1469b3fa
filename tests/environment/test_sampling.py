"""Tables of atmospheres and winds against the functions that they are of, between the rows."""

import numpy as np
import pytest

from shefex_nav.environment import sampling
from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.models import BUILT_IN, Air, Atmosphere, Site, Wind
from shefex_nav.errors import CodeError

SITE = Site("2012-06-22T19:18:00", 1.2, 0.3)
DENSE = np.arange(-500.0, 200e3, 7.3)
SPAN = (-10.0, 600.0)


def standard(heights, site):
    """The standard atmosphere as somebody's function: layers with kinks, and above 86 km its own table."""
    density, pressure, _, sound = np.array([us76(height) for height in heights]).T
    return Air(density, pressure, sound)


def waves(heights, t_s, site):
    """A jet, a wave that is 3 km long, and a shear with a kink that is nowhere near a place that is asked."""
    north = 20.0 * np.exp(-(((heights - 11e3) / 2e3) ** 2)) + 3.0 * np.sin(2.0 * np.pi * heights / 3e3)
    east = np.where(heights < 4321.0, 1e-2 * heights, 43.21) * (1.0 + 0.2 * np.sin(2.0 * np.pi * t_s / 40.0))
    return north, east


def test_air_is_off_the_function_by_what_is_said():
    rows = sampling.air_table(Atmosphere("mine", standard), SITE)
    exact = standard(DENSE, SITE)
    density, pressure = (np.interp(DENSE, rows[:, 0], rows[:, k]) for k in (1, 2))
    assert np.abs(density - np.log(exact.density)).max() < 2e-4
    assert np.abs(pressure - np.log(exact.pressure)).max() < 2e-4
    assert np.abs(np.interp(DENSE, rows[:, 0], rows[:, 3]) - exact.sound).max() < 0.06
    assert rows[0, 0] == -500.0 and rows[-1, 0] == 1e6 and len(rows) < 2000
    coarse = np.interp(DENSE, rows[::8, 0], rows[::8, 1])
    assert np.abs(coarse - np.log(exact.density)).max() > 1e-3  # the rows are needed


def test_sound_follows_from_pressure_and_density_if_it_is_not_given():
    def thin(heights, site):
        return Air(np.exp(-heights / 8e3), 1e5 * np.exp(-heights / 8e3))

    rows = sampling.air_table(Atmosphere("mine", thin, heights=(0.0, 100e3)), SITE)
    assert rows[:, 3] == pytest.approx(np.sqrt(1.4e5)) and len(rows) == 2


def test_wind_is_off_the_function_by_what_is_said():
    rows, times = sampling.wind_table(Wind("mine", waves), SITE, SPAN)
    heights, at_s = np.arange(0.0, 30e3, 17.3), np.arange(0.0, 600.0, 3.7)
    for t_s in at_s:
        exact = waves(heights, t_s, SITE)
        k = min(int(np.searchsorted(times, t_s, "right")) - 1, len(times) - 2)
        later = (t_s - times[k]) / (times[k + 1] - times[k])
        for column, value in enumerate(exact):
            two = [np.interp(heights, rows[:, 0], rows[:, 1 + 2 * j + column]) for j in (k, k + 1)]
            assert np.abs((1.0 - later) * two[0] + later * two[1] - value).max() < 0.15
    assert (times[0], times[-1]) == SPAN and 65 < len(times) < 2000


def test_a_wind_that_does_not_change_has_one_time():
    rows, times = sampling.wind_table(
        Wind("mine", lambda heights, t_s, site: (heights * 0.0, 1e-3 * heights)), SITE, SPAN
    )
    assert times.shape == (1,) and rows.shape[1] == 3 and not rows[:, 1].any()


def test_a_jump_is_a_slope_over_some_metres():
    def layers(heights, site):
        return Air(np.where(heights < 12345.6, 1.0, 0.5), np.ones_like(heights))

    rows = sampling.air_table(Atmosphere("mine", layers), SITE)
    k = np.flatnonzero(np.diff(rows[:, 1]))
    assert len(k) == 1 and 1.0 <= np.diff(rows[:, 0])[k[0]] < 3.0
    assert rows[k[0], 0] < 12345.6 < rows[k[0] + 1, 0]


def test_a_wind_with_too_much_detail_is_refused():
    def rough(heights, t_s, site):
        gust = 9.0 * np.sin(40.0 * t_s + 0.05 * heights)
        return gust, gust

    with pytest.raises(CodeError, match="wind 'rough' has too much detail"):
        sampling.wind_table(Wind("rough", rough), SITE, SPAN)


def test_what_kernels_have_needs_no_table():
    assert sampling.air_table(BUILT_IN[Atmosphere]["us76"], SITE).shape == (0, 4)
    rows, times = sampling.wind_table(BUILT_IN[Wind]["none"], SITE, SPAN)
    assert rows.shape == (0, 3) and times.shape == (1,)
