"""`navigation.told`: the computer is told other figures than are true; the world does not notice."""

import sys

import numpy as np
import pytest
from broken import the_message

from shefex_nav.commands.app import main
from shefex_nav.onboard.navigation.measurements import understood
from shefex_nav.onboard.navigation.state import NOTHING_TOLD, GpsTold
from shefex_nav.records import GpsFix, GpsRanges
from shefex_nav.scenario import params, params_onboard
from shefex_nav.scenario.load import Pattern, load
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.told import as_told, differences, lines

NAME = "shefex2_andoya"
BLOCKS = (
    "navigation.states=[gyro_scale, gyro_misalignment, gyro_g_sensitivity, accel_scale, accel_misalignment, "
)
BLOCKS += "accel_rectification, mounting, lever_arm]"
NO_BAD_PIXELS = np.zeros((0, 2), dtype=np.int64)


class Bodies:
    """As ephemeris.SkyBodies."""

    sun_u_i = np.array([1.0, 0.0, 0.0])
    earth_v_i = np.zeros(3)


def told(*values):
    return load(NAME, [BLOCKS, *(f"navigation.told.{value}" for value in values)])


def same(one, two):
    """Whether two parameters are the same, to the last bit."""
    if isinstance(one, dict):
        return one.keys() == two.keys() and all(same(one[key], two[key]) for key in one)
    if isinstance(one, tuple):
        return len(one) == len(two) and all(map(same, one, two))
    if isinstance(one, np.ndarray):
        return np.array_equal(one, two, equal_nan=True)
    return one == two or (one != one and two != two)


def of_world(scenario):
    world = settings(scenario.gps), settings(scenario.star_camera), params.flight_params(scenario)
    true = scenario.imu.model_dump(), scenario.pad_alignment.model_dump(), scenario.gps.clock_offset
    return (*world, *true)


def of_computer(scenario):
    return params_onboard.computer_params(scenario, Bodies, NO_BAD_PIXELS)


@pytest.fixture(scope="module")
def plain():
    return load(NAME, [BLOCKS])


def test_nothing_told_is_nothing_changed(plain):
    assert as_told(plain) is plain
    assert params_onboard.nav_params(plain).gps_told is NOTHING_TOLD
    assert list(differences(plain)) == list(lines(plain)) == []


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("imu.gyro.bias", "3 deg/h"),
        ("imu.gyro.in_run_bias", "3 deg/h"),
        ("imu.gyro.in_run_bias_time", "30 s"),
        ("imu.gyro.random_walk", "0.3 deg/sqrt(h)"),
        ("imu.gyro.scale_factor_roll", "7 ppm"),
        ("imu.gyro.scale_factor", "7 ppm"),
        ("imu.gyro.misalignment", "7 mrad"),
        ("imu.gyro.g_sensitivity", "7 deg/h/gee"),
        ("imu.gyro.vibration_rectification", "7 deg/h/gee2"),
        ("imu.gyro.range", "700 deg/s"),
        ("imu.gyro.quantum", "7 arcsec"),
        ("imu.accelerometer.bias", "7 mgee"),
        ("imu.accelerometer.in_run_bias", "7 mgee"),
        ("imu.accelerometer.in_run_bias_time", "7 s"),
        ("imu.accelerometer.random_walk", "7 m/s/sqrt(h)"),
        ("imu.accelerometer.scale_factor", "7 ppm"),
        ("imu.accelerometer.misalignment", "7 mrad"),
        ("imu.accelerometer.vibration_rectification", "7 ugee/gee2"),
        ("imu.accelerometer.range", "7 gee"),
        ("imu.accelerometer.quantum", "7 mm/s"),
        ("imu.vibration.boost", "[1 gee, 0.7 gee]"),
        ("gps.range_noise", "7 m"),
        ("gps.range_rate_noise", "7 m/s"),
        ("gps.latency", "70 ms"),
        ("gps.clock_offset", "7 ms"),
        ("gps.antenna.lever_arm", "[7 m, 0 m, 0 m]"),
        ("gps.clock.h_0", "7e-19 s"),
        ("gps.errors.multipath", "{range: 7 m, time: 7 s}"),
        ("star_camera.mounting.error", "7 deg"),
        ("star_camera.optics.focal_length", "26 mm"),
    ],
)
def test_what_is_told_reaches_the_computer_and_never_the_world(path, value, plain):
    """As if it were true, as far as the computer is concerned; but for what a receiver says of itself."""
    other = told(f"{path}={value}")
    assert same(of_world(other), of_world(plain))
    assert not same(of_computer(other), of_computer(plain))
    if path.split(".")[1] in ("range_noise", "range_rate_noise", "latency", "clock_offset"):
        return
    true = of_computer(load(NAME, [BLOCKS, f"{path}={value}"]))
    known = of_computer(other)
    assert same(known._replace(nav=known.nav._replace(gps_told=NOTHING_TOLD)), true)


def test_a_whole_unit_is_told(plain):
    other = told("imu.use=ln_200s", "imu.gyro.bias=2 deg/h")
    true = load(NAME, [BLOCKS, "imu.use=ln_200s", "imu.gyro.bias=2 deg/h"])
    assert same(of_world(other), of_world(plain)) and same(of_computer(other), of_computer(true))


def test_what_is_told_of_the_receiver():
    nav = params_onboard.nav_params(told("gps.range_noise=3 m", "gps.range_rate_noise=25 mm/s"))
    assert nav.gps_told[:3] == (2.0, 0.5, 0.0) and np.isnan(nav.gps_told.latency_s)
    assert params_onboard.nav_params(told("gps.clock_offset=7 ms")).gps_told.clock_offset_s == 0.007
    assert params_onboard.nav_params(told("gps.latency=70 ms")).gps_told.latency_s == pytest.approx(0.07)


def test_how_messages_are_understood():
    v, R = np.ones(3), np.eye(3)
    fix = GpsFix(10.0, 10.2, True, v, v, 4.0 * R, 0.01 * R, 8, 2.0, "")
    prn = np.arange(2)
    ranges = GpsRanges(10.0, 10.2, prn, prn, prn, prn, prn, np.full(2, 3.0), np.full(2, 0.1))
    assert understood(GpsTold(2.0), 7) == 7
    assert same(understood(NOTHING_TOLD, fix), fix) and same(understood(GpsTold(), ranges), ranges)
    noisy = understood(GpsTold(2.0, 3.0), fix)
    assert np.array_equal(noisy.R_r_e, 16.0 * R) and np.allclose(noisy.R_v_e, 0.09 * R)
    assert same(noisy._replace(R_r_e=fix.R_r_e, R_v_e=fix.R_v_e), fix)
    noisy = understood(GpsTold(2.0, 3.0), ranges)
    assert np.array_equal(noisy.sigma_range, [6.0, 6.0]) and np.allclose(noisy.sigma_range_rate, 0.3)
    for message in (fix, ranges):  # a stamp that is late is of an instant before
        assert understood(GpsTold(clock_offset_s=0.05), message).t_valid_s == 9.95
        assert understood(GpsTold(latency_s=0.1), message).t_valid_s == pytest.approx(10.1)


@pytest.mark.parametrize(
    ("values", "field", "words"),
    [
        (["imu.gyro.random_wlk=1 deg"], "imu.gyro.random_wlk", "unknown key; did you mean 'random_walk'?"),
        (["imu.gyro.bias=1 m"], "imu.gyro.bias", "'1 m' is a length, expected an angular rate"),
        (["imu.gyro.bias=-1 deg/h"], "imu.gyro.bias", "must not be negative"),
        (["imu.vibration.boost=[7 gee]"], "imu.vibration.boost", "1 value for 2 stages"),
        (["imu.vibration.highest_frequency=3 Hz"], "imu.vibration.lowest_frequency", "must be below"),
        (["imu.use=ln200s"], "imu.use", "did you mean ln_200s?"),
        (["gps.latency=1 ms", "gps.clock_offset=1 ms"], "gps.clock_offset", "of no use beside latency"),
        (["gps.rate=5 Hz"], "gps.rate", "unknown key"),
        (
            ["gps.errors.multipath.range=3 m"],
            "gps.errors.multipath",
            "'multipath: {range: 0.5 m, time: 30 s}'",
        ),
        (["star_camera.mounting.boresight=[1, 0, 0]"], "star_camera.mounting.image_right", "right angles"),
    ],
)
def test_nonsense_is_refused(values, field, words):
    said = the_message(NAME, [f"navigation.told.{value}" for value in values])
    assert f"navigation.told.{field}: " in said and words in said


def test_nothing_is_told_twice():
    arm = "[1 m, 0 m, 0 m]"
    said = the_message(
        NAME, [f"navigation.told.gps.antenna.lever_arm={arm}", f"navigation.sensors.lever_arm={arm}"]
    )
    assert "navigation.told.gps.antenna.lever_arm: navigation.sensors.lever_arm says so too" in said


@pytest.mark.parametrize(
    ("told_so", "key", "value"),
    [
        ("gps.clock.bias=10 ms", "clock_bias", "5 km"),
        ("gps.clock.drift=10 ppm", "clock_drift", "20 m/s"),
        ("gps.clock.h_0=1e-18 s", "clock_white_frequency", "0.1 m/sqrt(s)"),
        ("gps.clock.h_minus_2=1e-19 1/s", "clock_random_walk", "0.2 m/s/sqrt(s)"),
    ],
)
def test_a_clock_is_told_once(told_so, key, value):
    said = the_message(NAME, [f"navigation.told.{told_so}", f"navigation.sensors.{key}={value}"])
    assert f"navigation.told.{told_so.partition('=')[0]}: navigation.sensors.{key} says so too" in said


def test_check_says_what_differs(monkeypatch, capsys):
    sets = ["imu.gyro.bias=1 deg/h", "imu.gyro.range=unlimited", "imu.gyro.scale_factor=100 ppm"]
    sets += ["gps.antenna.lever_arm=[1 m, 0.05 m, -30 mm]"]
    words = [part for value in sets for part in ("--set", f"navigation.told.{value}")]
    monkeypatch.setattr(sys, "argv", ["shefex-nav", "check", NAME, *words])
    with pytest.raises(SystemExit):
        main()
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("told otherwise: ")]
    assert [line.partition("--set navigation.told.")[2] for line in said] == [
        "imu.gyro.bias: 1 deg/h, the truth is 0.5 deg/h",
        "imu.gyro.range: unlimited, the truth is 1000 deg/s",
        "gps.antenna.lever_arm: [1 m, 0.05 m, -0.03 m], the truth is [0.6 m, 0.05 m, -0.03 m]",
    ]


def test_a_campaign_disperses_what_is_told(tmp_path):
    path = tmp_path / "a.yaml"
    text = "navigation: {told: {imu: {gyro: {bias: 1 deg/h}}}}\ndispersions:\n"
    path.write_text(f"extends: {NAME}\n{text}  navigation.told.imu.gyro.bias: {{log_normal: 20 %}}\n")
    pattern = Pattern(load(path).source, "a.yaml")
    drawn = pattern.with_draws({"navigation.told.imu.gyro.bias": 3.0})
    assert drawn.imu == load(NAME).imu
    assert drawn.navigation.told.imu.gyro.bias == pytest.approx(3.0 * np.radians(1.0) / 3600.0)
