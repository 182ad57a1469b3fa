"""Rates, forces, speeds and heights of a flight beyond IMU and GPS receiver are told before it flies."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.geometry import wgs84
from shefex_nav.report import programme, sensor_limits
from shefex_nav.scenario import load


def test_the_largest_of_each_second_is_kept():
    t_s = np.arange(0.0, 5.0, 0.0025)
    omega_b = np.column_stack([3.0 * np.sin(t_s), np.zeros_like(t_s), -t_s])
    moved = sensor_limits.motion(t_s, omega_b, np.zeros((len(t_s), 3)))
    assert np.array_equal(moved.t_s, np.arange(5.0))
    assert moved.rate[:, 2] == pytest.approx(np.arange(1.0, 6.0) - 0.0025)
    assert moved.rate[1, 0] == pytest.approx(3.0, abs=1e-5)


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("imu.gyro.range=400 deg/s", ("400 deg/s is exceeded", "axis x reaches 540 deg/s", "unknown")),
        ("imu.accelerometer.range=8 gee", ("8 gee is exceeded", "vibration apart", "axis x", "velocity")),
    ],
)
def test_check_tells_what_the_unit_cannot_show(default_scenario, setting, words):
    (warned,) = programme.foreseen(load.load(default_scenario, [setting]))
    assert warned.field == ("imu", setting.split(".")[1], "range")
    assert all(word in warned.text for word in words)


@pytest.mark.parametrize(("quantum", "is_told"), [("5 arcsec", False), ("20 arcsec", True)])
def test_counts_that_are_the_same_turn_after_turn_are_told(default_scenario, quantum, is_told):
    """Flown, the attitude at entry was 1.0 times the predicted one with 5 arcsec, 1.7 times with 20."""
    warned = programme.foreseen(load.load(default_scenario, [f"imu.gyro.quantum={quantum}"]))
    assert [one.field for one in warned] == [("imu", "gyro", "quantum")] * is_told
    assert all("540 deg/s" in one.text and "6.5 arcsec" in one.text for one in warned)


def test_counts_stay_for_a_turn_where_noise_needs_longer_to_walk_through_one(default_scenario):
    """The phase 2 pi theta/q of a walk theta loses its memory at 2 pi^2 N^2/q^2 a second: by 4000 walks."""
    gyro, turn_s = load.load(default_scenario).imu.gyro, 2.0 * np.pi / 6.0
    rate = np.zeros((20, 3))
    rate[:, 0] = 6.0
    moved = sensor_limits.Motion(np.arange(20.0), rate, rate)
    walked = gyro.random_walk * np.sqrt(turn_s) * np.random.default_rng(3).standard_normal(4000)
    for share, told in ((0.9, False), (1.1, True)):
        quantum = share * gyro.random_walk * np.sqrt(4.0 * np.pi**3 / 6.0)
        imu = load.load(default_scenario, [f"imu.gyro.quantum={np.degrees(quantum) * 3600.0} arcsec"]).imu
        assert bool(list(sensor_limits.coarse(imu, moved))) == told
        kept = np.mean(np.cos(2.0 * np.pi * walked / quantum))
        assert kept == pytest.approx(np.exp(-1.0 / share**2), abs=0.04)
    assert not list(
        sensor_limits.coarse(imu, moved._replace(t_s=moved.t_s[:4], rate=rate[:4], force=rate[:4]))
    )


def test_the_default_mission_stays_within_its_ranges(default_scenario):
    assert programme.foreseen(load.load(default_scenario)) == ()


def test_seconds_of_which_a_part_exceeds_a_range_are_not_said_to_exceed_it_throughout(default_scenario):
    """Four short peaks of 10 ms each: not 4 s beyond the range."""
    t_s = np.arange(0.0, 9.0, 0.0025)
    omega_b = np.where((t_s % 2.0 < 0.01)[:, None] & (t_s[:, None] > 1.0), [2.0, 0.0, 0.0], 0.0)
    flown = sensor_limits.motion(t_s, omega_b, np.zeros_like(omega_b))
    imu = load.load(default_scenario, ["imu.gyro.range=100 deg/s"]).imu
    ((_, text),) = sensor_limits.beyond(imu, flown)
    assert text.startswith("100 deg/s is exceeded at instants of 4 seconds, first at T+2 s")


T_S = np.arange(0.0, 100.0, 0.25)


def flown(height_m, speed_m_s):
    """Track over the equator: height over time, and speed over the ground, to the east."""
    r_i = np.zeros((len(T_S), 3))
    r_i[:, 0] = wgs84.A + height_m
    v_i = np.zeros((len(T_S), 3))
    v_i[:, 1] = wgs84.OMEGA * r_i[:, 0] + speed_m_s
    return sensor_limits.track(T_S, r_i, v_i)


def test_times_and_largest_values_of_each_limit():
    track = flown(1e3 * T_S, np.full(len(T_S), 600.0))
    assert len(track.t_s) == 100
    gps = SimpleNamespace(highest_speed=500.0, highest_height=80e3)
    (first, speed), (second, height) = sensor_limits.beyond_gps(gps, track)
    assert (first, second) == (("gps", "highest_speed"), ("gps", "highest_height"))
    assert speed.startswith("500 m/s is exceeded for 100 s, first at T+0 s, up to 600 m/s")
    assert height.startswith("80 km is exceeded for 19 s, first at T+81 s, up to 99 km")


@pytest.mark.parametrize("limit", [650.0, np.inf])
def test_the_turn_of_the_earth_is_no_speed(limit):
    gps = SimpleNamespace(highest_speed=limit, highest_height=np.inf)
    assert list(sensor_limits.beyond_gps(gps, flown(0.0 * T_S, np.full(len(T_S), 600.0)))) == []
