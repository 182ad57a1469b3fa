"""Limits of speed and height of a receiver, against a flight."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.geometry import wgs84
from shefex_nav.report import sensor_limits

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
