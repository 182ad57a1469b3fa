"""An IMU that saturates, drops out and sticks: each fault is named within 0.2 s, and its error is covered."""

import numpy as np
import pytest
from faulty_flight import REQUIRED, fly

from shefex_nav.records import Doubt

FAULTS = (  # source, from, until, reason
    ("imu", 120.0, 120.05, "no samples"),
    ("imu", 130.0, 130.05, "the same block"),
    ("gyro y", 290.0, 300.0, "stuck"),
    ("accelerometer x", 310.0, 320.0, "stuck"),
)


@pytest.mark.parametrize(("source", "begin_s", "end_s", "reason"), FAULTS)
def test_each_fault_is_noticed_named_and_over(source, begin_s, end_s, reason):
    flown = fly("imu_faults")
    said = [(t_s, words) for t_s, words in flown.noticed(source) if begin_s <= t_s <= end_s + 0.2]
    (first, words), (last, nothing) = said
    assert first <= begin_s + 0.2 and reason in words
    assert nothing == "" and end_s <= last <= end_s + 0.05
    inside = flown.during(begin_s + 0.2, end_s)
    assert (flown.doubts[inside] == Doubt.IMU).all()
    attitude = Doubt.NONE if source.startswith("accelerometer") else Doubt.IMU  # what gyros and stars say
    assert (flown.doubt[inside] == attitude).all()


def test_accelerometers_at_the_end_of_their_range():
    """12 gee are exceeded by thrust and vibration towards the end of the first burn."""
    flown = fly("imu_faults")
    said = [t_s for t_s, words in flown.noticed("accelerometer x") if "range" in words and t_s < 60.0]
    assert said and 20.0 < said[0] < 56.0


def test_errors_stay_within_the_covariance():
    """Nine errors, ten times a second, over 500 s."""
    flown = fly("imu_faults")
    assert (np.abs(flown.error) / flown.sigma).max() < 4.5
    assert not ((np.abs(flown.error[:, 6:]) > flown.protection_b).any(axis=1) & (flown.doubt == 0)).any()


def test_the_mission_goes_on():
    flown = fly("imu_faults")
    entry = flown.at(flown.entry_s)
    assert np.abs(flown.error[entry, 6:]).max() < REQUIRED
    assert np.linalg.norm(flown.error[entry, :3]) < 15.0
    assert flown.doubt[entry] == Doubt.NONE
    others = {record.source for record in flown.health} - {"gps"}
    assert others == {"imu", "gyro y", "accelerometer x"}  # nothing else is blamed
