"""Winds of weather services: forms, units, heights, and what is refused."""

import json

import pytest

from shefex_nav.scenario import load, sounding_checks, soundings
from shefex_nav.scenario.layers import ScenarioError
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
PLAIN = "height_m,wind direction_degree,wind speed_m/s\n"


def forecast(**changed):
    hourly = {"time": ["2011-02-22T13:00", "2011-02-22T14:00"]}
    for level, speed, height in ((1000, 18.0, 110.0), (500, 72.0, 5200.0)):
        hourly[f"wind_speed_{level}hPa"] = [0.0, speed]
        hourly[f"wind_direction_{level}hPa"] = [10, 250]
        hourly[f"geopotential_height_{level}hPa"] = [height, height]
    told = {"wind_speed": "km/h", "wind_direction": "°", "geopotential_height": "m", "time": "iso8601"}
    units = {name: next(unit for begins, unit in told.items() if name.startswith(begins)) for name in hourly}
    return json.dumps({"utc_offset_seconds": 3600, "hourly": hourly, "hourly_units": units} | changed)


def forecast_in(**changed):
    """The forecast with other units."""
    return forecast(hourly_units=json.loads(forecast())["hourly_units"] | changed)


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
        (PLAIN.replace("height_m", "height_fathom"), "the height is in 'fathom'; expected one of m, gpm"),
        (PLAIN.replace("height_m", "height"), "the height has no unit"),
        (PLAIN.replace("height_m", "height_m,height_km"), "2 columns may be the height: height_m, height_km"),
        (PLAIN.replace("wind speed_m", "wind speed gust_m"), "no column for speed"),
        (PLAIN.replace("_degree", "_mil"), "the direction is in 'mil'"),
        (PLAIN.replace("_degree", ""), "the direction has no unit"),
        (PLAIN.replace("speed_m/s", "speed"), "the speed has no unit; expected one of m/s"),
        (LIST.replace(" hPa     m ", " hPa    yd "), "the height is in 'yd'"),
        (LIST.replace("deg", "gon"), "the direction is in 'gon'"),
        (LIST.replace("deg", "   "), "the direction has no unit"),
        (LIST[: LIST.index("    hPa")], "ends after line 4, the names of its columns"),
        (PLAIN + "0,2,3\n6356766,2,3\n", "winds.txt, line 3: a height of 6.35677e[+]06 m; expected -1000 m"),
        (PLAIN + "0,2,3\n9000,2,3\n-5000,2,3\n", "winds.txt, line 4: a height of -5000 m"),
        (LIST.replace(" 30480", "630480"), "winds.txt, line 11: a height of 630480 m"),
        (PLAIN + "0,2,3\n900,2,5,3\n", "winds.txt, line 3: 4 values, but 3 names of columns"),
        (PLAIN + "0,2,3\n900,2\n", "winds.txt, line 3: 2 values, but 3 names of columns"),
        (PLAIN + '0,2,3\n900,"2,3\n1900,2,3\n', "winds.txt, line 3: a quotation mark has no partner"),
        (PLAIN + '0,2,3\n900,"2"x,3\n1900,2,3\n', "winds.txt, line 3: ',' expected"),
        (forecast_in(wind_speed_500hPa="furlong"), "the speed is in 'furlong'"),
        (forecast_in(wind_direction_500hPa="mil"), "the direction is in 'mil'"),
        (forecast_in(geopotential_height_500hPa="yd"), "the height is in 'yd'"),
        (forecast_in(geopotential_height_500hPa=None), "another 'geopotential_height_500hPa'"),
        ("{1}", "begins as JSON and is none"),
        (forecast(hourly={"time": ["2011-02-22T13:00"]}), "no wind_speed_...hPa in hourly"),
        (forecast().replace('"2011-02-22T14:00"', "1298383200"), "time 1298383200 is not of ISO 8601"),
        (forecast(utc_offset_seconds="an hour"), "utc_offset_seconds is 'an hour'"),
        (forecast(utc_offset_seconds=1e15), r"utc_offset_seconds is 1000000000000000\.0"),
        (forecast(utc_offset_seconds=float("nan")), "utc_offset_seconds is nan"),
        ("a,b\n1,2\n", "no column for height and direction and speed"),
        (CSV.replace("wind speed_m/s", "wind speed_furlong"), "'furlong'; expected one of m/s"),
        (PLAIN + "1,2,3\n", "1 rows with height"),
        (PLAIN + "0,2,5\n0.4,2,250\n900,2,3\n", "winds.txt, line 3: another wind at 0 m than in line 2"),
        (PLAIN + "1,2,-3\n900,2,3\n", "winds.txt, line 2: -3 m/s from 2 deg is no wind"),
        ("{}", "no answer of Open-Meteo"),
        (forecast(utc_offset_seconds=-36000), "the hour nearest to lift-off"),
    ],
)
def test_what_cannot_be_read_is_told(tmp_path, text, words):
    with pytest.raises(SoundingError, match=words) as refused:
        read(tmp_path, text)
    assert "Error" not in str(refused.value)  # that is for programmers


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(SoundingError, match="there is no such file"):
        soundings.read(tmp_path / "none.csv", EPOCH)


@pytest.mark.parametrize(
    ("head", "rows", "height"),
    [
        ("geopotential height_m", (0, 30480), 30626.8),  # US76: Z = 30627 m at H = 30480 m
        ("HGHT", (0, 30480), 30626.8),
        ("height [gpm]", (0, 30480), 30626.8),
        ("geopotential height (ft)", (0, 100000), 30626.8),
        ("height_m", (0, 30480), 30480.0),
        ("geometric height [km]", (0, 30.48), 30480.0),
        ("height_ft", (0, 100000), 30480.0),
    ],
)
def test_heights_are_of_the_kind_and_unit_of_their_heading(tmp_path, head, rows, height):
    text = f"{head},wind direction_degree,wind speed_m/s\n" + "".join(f"{row},90,5\n" for row in rows)
    assert read(tmp_path, text).height == pytest.approx((0.0, height), abs=0.2)


def test_directions_in_radians(tmp_path):
    found = read(tmp_path, PLAIN.replace("degree", "rad") + "0,1.5707963,5\n900,3.1415927,5\n")
    assert found.whence == pytest.approx((90.0, 180.0))


def test_a_text_list_in_feet(tmp_path):
    text = LIST.replace(" hPa     m ", " hPa    ft ")
    for metres, feet in (
        ("    34", "   112"),
        ("   713", "  2339"),
        ("  5180", " 16995"),
        (" 30480", "100000"),
    ):
        text = text.replace(metres, feet)
    assert read(tmp_path, text).height[-1] == pytest.approx(30626.8, abs=0.2)


def test_a_forecast_in_feet(tmp_path):
    answer = json.loads(forecast())
    for level, height in (1000, 360.9), (500, 17060.4):
        answer["hourly"][f"geopotential_height_{level}hPa"] = [height, height]
        answer["hourly_units"][f"geopotential_height_{level}hPa"] = "ft"
    assert read(tmp_path, json.dumps(answer)).height == pytest.approx((110.0, 5204.3), abs=0.1)


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)])
def test_rows_may_come_in_any_order(tmp_path, order):
    rows = "100,10,1\n", "2000,20,2\n", "5000,30,3\n", "9000,40,4\n"
    found = read(tmp_path, PLAIN + "".join(rows[k] for k in order))
    assert found.height == (100.0, 2000.0, 5000.0, 9000.0) and found.speed == (1.0, 2.0, 3.0, 4.0)


def test_levels_without_a_height_take_no_other_with_them(tmp_path):
    """Open-Meteo names levels from high to low; one below the ground has no height."""
    answer = json.loads(forecast())
    hourly, units = answer["hourly"], answer["hourly_units"]
    for level, height in ((30, 23500.0), (900, None), (200, 11800.0), (850, 1400.0)):
        for name, value in (("wind_speed", 36.0), ("wind_direction", 90), ("geopotential_height", height)):
            hourly[f"{name}_{level}hPa"] = [value, value]
            units[f"{name}_{level}hPa"] = units[f"{name}_500hPa"]
    found = read(tmp_path, json.dumps(answer))
    assert found.height == pytest.approx((110.0, 1400.3, 5204.3, 11822.0, 23587.2), abs=0.2)


@pytest.mark.parametrize("times", [("T12:00Z", "T13:00Z"), ("T13:00+01:00", "T14:00+01:00")])
def test_times_of_a_forecast_may_name_their_zone(tmp_path, times):
    hourly = json.loads(forecast())["hourly"] | {"time": [f"2011-02-22{one}" for one in times]}
    text = forecast(hourly=hourly, utc_offset_seconds=7200)
    found = read(tmp_path, text)
    assert found.what.startswith("forecast for 2011-02-22T13:00 UTC") and found.speed[0] == pytest.approx(5.0)


MORE = "pressure_hPa,temperature_C,latitude,longitude," + PLAIN


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            PLAIN + "0,2,3\n900,2,900\n",
            "line 3: 900 m/s is no wind of the Earth; expected at most 300",
        ),
        (
            PLAIN + "0,2,3\n900,400,3\n",
            "line 3: 3 m/s from 400 deg is no wind; expected .* 0 to 360 deg",
        ),
        (PLAIN + "0,2,3\n900,-90,3\n", "winds.txt, line 3: 3 m/s from -90 deg is no wind"),
        (
            PLAIN + "0,2,3\n900,2,3\n900,182,30\n",
            "line 4: another wind at 900 m than in line 3; keep one of them",
        ),
        (PLAIN + "0,2,3\n900,2,1_0\n", "line 3: speed: expected a number such as 12.5, got '1_0'"),
        (PLAIN + "0,2,3\n900,2,inf\n", "line 3: speed: expected a number such as 12.5, got 'inf'"),
        (PLAIN + "0,2,3\n900,2,1e400\n", "line 3: speed: expected a number below 1e308, got '1e400'"),
        (PLAIN, "0 rows with height"),
        (
            MORE + "1000,5,68,20,0,2,3\n0,-5,68,20,900,2,3\n",
            "line 3: a pressure of 0 hPa; expected 0.0001 to 1100",
        ),
        (MORE + "1000,5,68,20,0,2,3\n900,-300,68,20,900,2,3\n", "line 3: a temperature of -300 C; expected"),
        (
            MORE + "1000,5,68,20,0,2,3\n200,-50,68,20,900,2,3\n",
            "line 3: 200 hPa at 900 m do not belong together",
        ),
        (
            MORE + "1000,5,98,20,0,2,3\n900,-5,68,20,900,2,3\n",
            "its place is 98 deg, 20 deg; expected a latitude",
        ),
        (
            LIST.replace("  500.0   5180", "  500.0    180"),
            "line 10: 500 hPa at 180.005 m do not .* about 5600 m",
        ),
        (LIST.replace("  925.0", "  x25.0"), "line 9: is no row of the list, but rows follow in line 10"),
        (
            LIST.replace("350     10", "350    1_0"),
            "line 9: speed: expected a number such as 12.5, got '1_0'",
        ),
        (forecast(latitude=500.0, longitude=20.0), "its place is 500 deg, 20 deg"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path, text, words):
    with pytest.raises(SoundingError, match=words):
        read(tmp_path, text)


@pytest.mark.parametrize(
    "row", ["900,,3", "900,NaN,3", "900,--,3", "900,2,", "900,2,M", "900,2,///", ",2,3", "900,N/A,3"]
)
def test_what_was_not_measured_is_left_out(tmp_path, row):
    assert read(tmp_path, PLAIN + f"0,2,3\n{row}\n1900,2,3\n").height == (0.0, 1900.0)


def test_rows_of_one_height_may_have_one_wind(tmp_path):
    assert read(tmp_path, PLAIN + "0,2,3\n900,350,3\n900,10,4\n").speed == (3.0, 3.0)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        (LIST + "\nStation latitude: 65.54\nStation longitude: 22.11\n", (65.54, 22.11)),
        (LIST, None),
        (MORE + "1000,5,68.1,20.2,0,2,3\n900,-5,69,21,900,2,3\n", (68.1, 20.2)),
        (forecast(latitude=68.0, longitude=20), (68.0, 20.0)),
    ],
)
def test_the_place_of_winds(tmp_path, text, place):
    assert read(tmp_path, text).place == place


def test_a_place_far_from_the_site_is_told():
    """A degree along a meridian is 111.2 km; the antimeridian is no border."""
    assert sounding_checks.distance((60.0, 20.0), (61.0, 20.0)) == pytest.approx(111.19e3, rel=1e-3)
    assert sounding_checks.distance((0.0, 179.5), (0.0, -179.5)) == pytest.approx(111.19e3, rel=1e-3)
    assert not sounding_checks.elsewhere((60.0, 20.0), (62.5, 20.0))
    words = sounding_checks.elsewhere((60.0, 20.0), (63.0, 20.0))
    assert words.startswith("is of 60.00 deg, 20.00 deg, 334 km from the launch site at 63.00 deg, 20.00 deg")


@pytest.mark.parametrize(
    ("pressure", "height"), [(850.0, 1457.0), (500.0, 5574.0), (10.0, 31055.0), (1.0, 47820.0)]
)
def test_heights_of_pressures(pressure, height):
    """US Standard Atmosphere 1976, table I."""
    assert sounding_checks.standard_height(pressure) == pytest.approx(height, abs=100.0)


def test_winds_of_a_scenario_that_cannot_be():
    with pytest.raises(ScenarioError, match=r"wind.speed.1: 900 m/s at 5000 m is no wind of the Earth"):
        load.load("rexus_like", ["wind={height: [0 m, 5 km], speed: [3 m/s, 900 m/s], from: [0 deg, 0 deg]}"])
    high = ["wind={height: [0 m, 300 km], speed: [3 m/s, 900 m/s], from: [0 deg, 0 deg]}"]
    assert load.load("rexus_like", high).wind.speed[1] == 900.0


def test_gusts_and_marks_of_what_was_not_measured_are_no_wind(tmp_path):
    path = tmp_path / "winds.csv"
    head = "wind speed gust_m/s,height_m,wind direction_degree,wind speed_m/s\n"
    path.write_text(f"{head}20,0,90,5\n20,-999,90,5\n20,500,-9999,5\n20,1000,90,-999\n20,2000,90,7\n")
    found = soundings.read(path, EPOCH)
    assert found.height == (0.0, 2000.0) and found.speed == (5.0, 7.0)
