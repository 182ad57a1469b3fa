"""Winds of weather services: forms, units, heights, and what is refused."""

import json

import pytest

from shefex_nav.scenario import load, soundings
from shefex_nav.scenario.soundings import SoundingError

EPOCH = "2011-02-22T12:56:00"
LIST = """02185 Lulea Observations at 12Z 22 Feb 2011

-----------------------------------------------------------------------------
   PRES   HGHT   TEMP   DWPT   RELH   MIXR   DRCT   SKNT   THTA   THTE   THTV
    hPa     m      C      C      %    g/kg    deg   knot     K      K      K
-----------------------------------------------------------------------------
 1013.0     34  -20.1  -22.8     79   0.55    320      4  252.1  253.6  252.2
 1000.0    130  -18.5  -21.0     81   0.65                254.7  256.5  254.8
  925.0    713  -15.9  -18.4     81   0.88    350     10  263.1  265.6  263.2
  500.0   5180  -38.1  -45.1     48   0.12    285     32  286.5  287.0  286.5
   10.0  30480  -60.0  -90.0      1   0.01    270     60  795.0  795.0  795.0

Station information and sounding indices
"""
CSV = """time,pressure_hPa,geopotential height_m,temperature_C,wind direction_degree,wind speed_m/s
2011-02-22 11:00:00,1013.0,34,-20.1,320,2.0
2011-02-22 11:00:10,1011.0,40,-20.0,321,2.1
2011-02-22 11:30:00,500.0,5180,-38.1,285,16.0
"""


def forecast(**changed):
    hourly = {"time": ["2011-02-22T13:00", "2011-02-22T14:00"]}
    for level, speed, height in ((1000, 18.0, 110.0), (500, 72.0, 5200.0)):
        hourly[f"wind_speed_{level}hPa"] = [0.0, speed]
        hourly[f"wind_direction_{level}hPa"] = [10, 250]
        hourly[f"geopotential_height_{level}hPa"] = [height, height]
    units = dict.fromkeys(hourly, "km/h")
    return json.dumps({"utc_offset_seconds": 3600, "hourly": hourly, "hourly_units": units} | changed)


def read(tmp_path, text):
    (tmp_path / "winds.txt").write_text(text)
    return soundings.read(tmp_path / "winds.txt", EPOCH)


def test_text_list_of_wyoming(tmp_path):
    """Rows without a wind are left out, knots become m/s, geopotential heights geometric ones."""
    found = read(tmp_path, LIST)
    assert found.whence == (320.0, 350.0, 285.0, 270.0)
    assert found.speed == pytest.approx([4 * 0.514444, 10 * 0.514444, 32 * 0.514444, 60 * 0.514444], rel=1e-5)
    assert found.height[0] == pytest.approx(34.0, abs=0.01)
    assert found.height[-1] == pytest.approx(30626.8, abs=0.2)  # US76: Z = 30627 m at H = 30480 m


def test_columns_of_wyoming(tmp_path):
    """Rows closer than 50 m are left out."""
    found = read(tmp_path, CSV)
    assert found.speed == (2.0, 16.0) and found.whence == (320.0, 285.0)


def test_forecast_of_open_meteo(tmp_path):
    """The hour nearest to lift-off by UTC: 14:00 there is 13:00."""
    found = read(tmp_path, forecast())
    assert found.speed == pytest.approx((5.0, 20.0)) and found.whence == (250.0, 250.0)
    assert found.what.startswith("forecast for 2011-02-22T13:00 UTC")


def test_the_scenario_flies_in_them(tmp_path):
    scenario = load.load("rexus_like", [read(tmp_path, LIST).override()])
    assert scenario.wind.speed == pytest.approx([2.05778, 5.14444, 16.4622, 30.8667], rel=1e-4)
    assert scenario.wind.height[2] == pytest.approx(5184.2, abs=0.1)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "no column for height and direction and speed"),
        (CSV.replace("wind speed_m/s", "wind speed_furlong"), "'furlong'; expected one of m/s"),
        ("height_m,direction,wind speed_m/s\n1,2,3\n", "1 rows with height"),
        ("height_m,direction,wind speed_m/s\n1,2,-3\n900,2,3\n", "is no wind"),
        ("{}", "no answer of Open-Meteo"),
        (forecast(utc_offset_seconds=-36000), "the hour nearest to lift-off"),
    ],
)
def test_what_cannot_be_read_is_told(tmp_path, text, words):
    with pytest.raises(SoundingError, match=words):
        read(tmp_path, text)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(SoundingError, match="No such file"):
        soundings.read(tmp_path / "none.csv", EPOCH)
