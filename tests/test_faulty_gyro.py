"""Gyros that go on reading, wrongly: found by the stars, covered by P, or said to be unchecked."""

import numpy as np
import pytest
from faulty_flight import REQUIRED, fly

from shefex_nav.records import Doubt


def gyro(kind, axis, size, begin_s, end_s=600.0):
    what = "rate" if kind == "gyro_bias" else "factor"
    return (
        f"faults.imu=[{{fault: {kind}, axis: {axis}, {what}: {size}, from: {begin_s} s, until: {end_s} s}}]"
    )


def misleading(flown):
    """Where the attitude is off by more than the protection level without a warning."""
    return (np.abs(flown.error[:, 6:]) > flown.protection_b).any(axis=1) & (flown.doubt == Doubt.NONE)


@pytest.mark.parametrize(
    ("axis", "rate", "within_s"),
    [
        ("z", "0.003 deg/s", 4.0),
        pytest.param("y", "1 deg/s", 0.7, marks=pytest.mark.slow),
        pytest.param("z", "0.02 deg/s", 0.7, marks=pytest.mark.slow),
    ],
)
def test_a_bias_that_jumps_in_the_star_window(axis, rate, within_s):
    """Named; the solution warns meanwhile; the bias is estimated anew, the attitude is right again."""
    flown = fly("shefex2_andoya", gyro("gyro_bias", axis, rate, 290), until_s=406.0)
    (t_s, words), (right_s, nothing), *_ = flown.noticed(f"gyro {axis}")
    assert 290.0 < t_s <= 290.0 + within_s and "turns otherwise than the stars" in words
    assert nothing == "" and right_s < t_s + 3.0
    assert (flown.doubt[flown.during(t_s + 0.01, right_s - 0.01)] == Doubt.IMU).all()
    assert misleading(flown).sum() <= 4  # until three fixes in a row have been rejected
    ratio = np.abs(flown.error[:, 6:]) / flown.sigma[:, 6:]
    assert ratio[flown.during(right_s, 384.0)].max() < 4.5
    assert not flown.doubt[flown.during(right_s + 0.2, 372.0)].any()
    assert [record.source for record in flown.health if "turns" in record.reason] == [f"gyro {axis}"]


def test_gyros_that_were_wrong_are_not_trusted_without_stars():
    """At entry the stars are gone: nobody would notice if the gyro were wrong again."""
    flown = fly("shefex2_andoya", gyro("gyro_bias", "y", "1 deg/s", 290), until_s=406.0)
    entry = flown.at(flown.entry_s)
    assert flown.doubt[entry] == Doubt.IMU and "no stars" in flown.noticed("gyro y")[-1][1]
    assert np.abs(flown.error[entry, 6:]).max() < REQUIRED  # it was not


def test_a_bias_that_jumps_before_the_stars():
    """The attitude is 9 deg off at the first star fix: found, and nothing is concluded from it falsely."""
    flown = fly("shefex2_andoya", gyro("gyro_bias", "x", "0.5 deg/s", 230), until_s=300.0)
    assert np.degrees(np.abs(flown.error[flown.at(248.0), 6]).max()) > 8.0
    assert flown.noticed("gyro x")[0][0] < 250.2  # until then the camera might be turned, too
    assert not misleading(flown).any()
    late = flown.during(252.0, 300.0)
    assert (np.abs(flown.error[late, 6:]) / flown.sigma[late, 6:]).max() < 4.0
    assert np.degrees(np.abs(flown.error[late, 6:]).max()) < 0.06  # the camera's mounting, as at first


@pytest.mark.slow
def test_a_scale_factor_that_jumps_does_nothing_until_the_vehicle_turns():
    """1 % is nothing while the attitude is held; the turn for the entry makes it 0.2 deg: noticed."""
    flown = fly("shefex2_andoya", gyro("gyro_scale", "y", "1 %", 260), until_s=406.0)
    assert not flown.doubt[flown.during(262.0, 370.0)].any()
    assert np.degrees(np.abs(flown.error[flown.during(370.0, 384.0), 6:]).max()) > 0.15
    assert flown.noticed("star_tracker") or flown.noticed("gyro y")
    assert not misleading(flown)[flown.during(384.0, 406.0)].any()


@pytest.mark.slow
def test_a_roll_bias_before_the_stars_teaches_no_scale_factor():
    """It ends before the first star fix; the spin for the entry would show what was learnt from it."""
    flown = fly("shefex2_andoya", gyro("gyro_bias", "x", "-0.46 deg/s", 113, 213), until_s=455.0)
    assert not misleading(flown).any()
    assert not flown.doubt[flown.during(255.0, 370.0)].any()  # GPS had contradicted the gyros: stars decide
    assert flown.doubt[flown.at(flown.entry_s)]
