"""A barometer whose filter counts with the standard atmosphere, in an air that is another one."""

import numpy as np
import pytest

from shefex_nav.environment import atmosphere
from shefex_nav.instruments.barometer import Day
from shefex_nav.onboard.navigation import measure_barometer
from shefex_nav.report import air_on_board
from shefex_nav.report.programme import Flown
from shefex_nav.scenario.load import load

DAY = Day(pressure=800.0, temperature=8.0, depth=8e3)
NO_FLIGHT = Flown((), 0.0, 0.0)
NAME, MSIS = "baro_2d_gps", "atmosphere.model=msis"
WIDER = "navigation.told.barometer.day={pressure: 18 hPa, temperature: 23 K, depth: 8 km}"


def said(*values):
    return air_on_board.words(load(NAME, values), NO_FLIGHT)


def air(level_m, warmth):
    """Table of an air whose pressures lie at level + (1 + warmth) H where the standard has them at H."""
    heights = np.arange(-1e3, 40e3, 50.0)
    pressure = [atmosphere.us76((height - level_m) / (1.0 + warmth))[1] for height in heights.tolist()]
    return np.column_stack([heights, heights, np.log(pressure), heights])


def test_an_air_of_known_warmth_lies_where_its_warmth_puts_it():
    heights, off = air_on_board.offsets(air(-90.0, -0.06), 30e3)
    assert heights[0] == 0.0 and 29e3 < heights[-1] <= 30e3
    np.testing.assert_allclose(off, -90.0 - 0.06 * (heights + 90.0) / 0.94, atol=0.1)
    _, none = air_on_board.offsets(air(0.0, 0.0), 30e3)
    np.testing.assert_allclose(none, 0.0, atol=0.1)


@pytest.mark.parametrize(("level_m", "warmth"), [(-90.0, -0.06), (50.0, 0.04), (0.0, 0.08), (120.0, 0.0)])
def test_the_day_to_be_told_covers_the_day_and_the_air(level_m, warmth):
    """In the mean over the heights; nowhere less than 0.7 sigma of both, and no wider than it need be."""
    heights, off = air_on_board.offsets(air(level_m, warmth), 30e3)
    wider = air_on_board.covering(DAY, heights, off)

    def variance(day):
        level = day.pressure / measure_barometer.SURFACE_WEIGHT
        parts = np.array([measure_barometer.thicknesses(height) for height in heights.tolist()])
        return level**2 + np.einsum("ni,ij,nj->n", parts, measure_barometer.of_layers(day), parts)

    ratio = (variance(DAY) + off**2) / variance(wider)
    assert 0.7 < ratio.mean() <= 1.0 or wider.temperature == DAY.temperature
    assert ratio.max() < 0.7**-2
    assert wider.depth == DAY.depth and wider.pressure >= DAY.pressure


def test_a_winter_in_lapland_is_no_day_about_the_standard():
    """Kiruna in February: 3 sigma, and no word once the computer knows of it or makes no use of it."""
    assert said() == ""
    words = said(MSIS)
    assert "the air of msis lies 301 m below that, 3 sigma of such a day" in words
    assert WIDER.replace("day={", "day: {") in words
    assert said(MSIS, WIDER) == ""
    assert said(MSIS, "navigation.barometer.used=false") == ""
    assert said(MSIS, "barometer=null", "navigation.states=automatic") == ""
