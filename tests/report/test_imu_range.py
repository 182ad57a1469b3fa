"""Rates and forces of a flight that the IMU cannot show are told before it flies."""

import numpy as np
import pytest

from shefex_nav.report import imu_range, programme
from shefex_nav.scenario import load


def test_the_largest_of_each_second_is_kept():
    t_s = np.arange(0.0, 5.0, 0.0025)
    omega_b = np.column_stack([3.0 * np.sin(t_s), np.zeros_like(t_s), -t_s])
    moved = imu_range.motion(t_s, omega_b, np.zeros((len(t_s), 3)))
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


def test_the_default_mission_stays_within_its_ranges(default_scenario):
    assert programme.foreseen(load.load(default_scenario)) == ()


def test_seconds_of_which_a_part_exceeds_a_range_are_not_said_to_exceed_it_throughout(default_scenario):
    """Four short peaks of 10 ms each: not 4 s beyond the range."""
    t_s = np.arange(0.0, 9.0, 0.0025)
    omega_b = np.where((t_s % 2.0 < 0.01)[:, None] & (t_s[:, None] > 1.0), [2.0, 0.0, 0.0], 0.0)
    flown = imu_range.motion(t_s, omega_b, np.zeros_like(omega_b))
    imu = load.load(default_scenario, ["imu.gyro.range=100 deg/s"]).imu
    ((_, text),) = imu_range.beyond(imu, flown)
    assert text.startswith("100 deg/s is exceeded at instants of 4 seconds, first at T+2 s")
