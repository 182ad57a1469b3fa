"""Winds whose columns are something else than they seem, and answers that do not fit themselves."""

import json
import re

import pytest
from test_soundings import forecast, read

from shefex_nav.scenario.soundings import SoundingError


@pytest.mark.parametrize(
    "heading",
    [
        "Height above ground_m",
        "height above the ground [m]",
        "height AGL (m)",
        "height_agl_m",
        "height (m AGL)",
        "geometric height above ground level_m",
        "height above terrain_ft",
        "height relative to launch site_m",
        "height above launcher_m",
    ],
)
def test_heights_above_the_ground(tmp_path, heading):
    """They are off by the height of the launcher."""
    text = f"# of a day\n{heading},wind direction_degree,wind speed_m/s\n0,2,3\n900,2,3\n"
    words = (
        rf"winds.txt, line 2: column '{re.escape(heading)}' has heights above the ground; expected heights"
    )
    with pytest.raises(SoundingError, match=f"{words} above mean sea level"):
        read(tmp_path, text)
    more = text.replace(heading, f"{heading},height above mean sea level_m").replace("\n0,", "\n0,360,")
    assert read(tmp_path, more.replace("\n900,", "\n900,1260,")).height == (360.0, 1260.0)


@pytest.mark.parametrize(
    "heading",
    [
        "wind direction to_degree",
        "Wind direction (to)_deg",
        "wind direction towards [deg]",
        "direction_to_deg",
        "wind direction blowing toward_deg",
    ],
)
def test_directions_to_which_it_blows(tmp_path, heading):
    text = f"height_m,{heading},wind speed_m/s\n0,2,3\n900,2,3\n"
    words = (
        rf"winds.txt, line 1: column '{re.escape(heading)}' has directions to which the wind blows; expected"
    )
    with pytest.raises(SoundingError, match=f"{words} those from which it comes"):
        read(tmp_path, text)
    more = text.replace(heading, f"{heading},wind direction from_deg").replace(",2,", ",2,182,")
    assert read(tmp_path, more).whence == (182.0, 182.0)


@pytest.mark.parametrize(
    "head",
    [
        "height above sea level_m,wind direction from_degree",
        "height above the ellipsoid_m,wind direction relative to north_deg",
        "height above surface of the ellipsoid_m,wind direction with respect to true north_deg",
        "geopotential height above mean sea level_m,total wind direction_deg",
    ],
)
def test_headings_that_say_what_is_expected(tmp_path, head):
    assert read(tmp_path, f"{head},wind speed_m/s\n0,2,3\n900,4,3\n").whence == (2.0, 4.0)


def test_lists_of_a_forecast_have_a_value_for_each_time(tmp_path):
    """48 speeds for 24 times are not those of these times."""
    for name in json.loads(forecast())["hourly"]:
        if name == "time":
            continue
        for values in ([1.0] * 4, [1.0], []):
            hourly = json.loads(forecast())["hourly"] | {name: values}
            words = (
                f"winds.txt: hourly.{name} has {len(values)} values, hourly.time has 2; expected a value for"
            )
            with pytest.raises(SoundingError, match=words):
                read(tmp_path, forecast(hourly=hourly))


@pytest.mark.parametrize("what", ["latitude", "longitude"])
@pytest.mark.parametrize("value", ["67.9", "north", True, None, [67.9], float("nan"), float("inf"), 10**400])
def test_a_place_of_a_forecast_that_is_none(tmp_path, what, value):
    place = {"latitude": 67.9, "longitude": 21.1}
    assert read(tmp_path, forecast(**place)).place == (67.9, 21.1)
    with pytest.raises(SoundingError, match=f"winds.txt: {what} is .*; expected a number of degrees"):
        read(tmp_path, forecast(**place | {what: value}))


@pytest.mark.parametrize(
    "place", [{"latitude": -999.0, "longitude": 21.1}, {"latitude": 9999, "longitude": 2}]
)
def test_a_place_of_a_forecast_that_is_not_on_the_earth(tmp_path, place):
    with pytest.raises(SoundingError, match=r"its place is .*expected a latitude of -90 to 90 deg"):
        read(tmp_path, forecast(**place))


def test_half_a_place_of_a_forecast(tmp_path):
    with pytest.raises(SoundingError, match="latitude without the other; expected latitude and longitude"):
        read(tmp_path, forecast(latitude=67.9))
    assert read(tmp_path, forecast()).place is None


@pytest.mark.parametrize("n", [0, 1, 3])
def test_an_answer_for_several_places(tmp_path, n):
    text = f"\n [{', '.join([forecast()] * n)}]"
    with pytest.raises(SoundingError, match=f"an answer of Open-Meteo for {n} places; expected one answer"):
        read(tmp_path, text)
