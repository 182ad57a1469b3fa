"""Position and velocity say for themselves when they must not be used, in flights whose attitude is good."""

import numpy as np
import pytest
from faulty_flight import fly

from shefex_nav.records import Doubt

STUCK = "faults.imu=[{fault: stuck, sensor: accelerometer, axis: y, from: 60 s, until: 360 s}]"
LIMITS = 100.0, 1.0  # m, m/s


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("gps_outage", ()),
        ("imu_faults", ()),
        pytest.param("gps_outage", (STUCK,), marks=pytest.mark.slow),
        pytest.param("frozen_gps", (), marks=pytest.mark.slow),
    ],
)
def test_what_may_be_used_is_within_its_level(name, overrides):
    """Nowhere over its level while usable, for a tenth of a second; and so within what is required."""
    flown = fly(name, *overrides)
    for k, limit in enumerate(LIMITS):
        axes, usable = slice(2 * k, 2 * k + 2), flown.doubts[:, k] == Doubt.NONE
        error, level = flown.level_error[usable, axes], flown.level[usable, axes]
        assert np.all(error <= level)
        assert np.all(np.hypot(*level.T) <= limit) and usable.sum() > 1000


def test_kilometres_off_and_not_to_be_used():
    """GPS is away, an accelerometer has been stuck: the attitude is good, the position is 20 km off."""
    flown = fly("gps_outage", STUCK)
    late = flown.during(365.0, 380.0)  # the sensor works again, stars are seen, GPS is not back
    assert np.all(np.linalg.norm(flown.error[late, :3], axis=1) > 10e3)
    assert np.all(flown.doubts[late] == Doubt.LEVEL) and np.all(flown.doubt[late] == Doubt.NONE)
    assert np.all(flown.doubts[flown.during(70.0, 350.0)] == Doubt.IMU)
    back = flown.during(410.0, 430.0)
    assert not flown.doubts[back].any()
