"""Constants of the GPS receiver that were told wrongly: found, named, and the solution withdrawn."""

import re

import numpy as np
import pytest
from faulty_flight import fly

from shefex_nav.records import Doubt


def said(flown):
    """(s, words) of what was found wrong."""
    return [(one.t_s, one.reason) for one in flown.health if one.source == "gps_constants" and one.reason]


@pytest.mark.parametrize("name", ["shefex2_andoya", pytest.param("rexus_like", marks=pytest.mark.slow)])
def test_right_constants_are_never_found_wrong(name):
    for seed in (1, 2):
        assert not said(fly(name, until_s=150.0, seed=seed))


def test_vibration_is_not_taken_for_a_wrong_time():
    """Fixes so close that the slowest vibration, of 5 Hz, is in the motion that the filter knows, too."""
    slow = "gps.rate=50 Hz", "imu.vibration.lowest_frequency=5 Hz", "mission.start=-3 s"
    assert not said(fly("no_star_tracker", *slow, until_s=20.0, seed=881))


@pytest.mark.parametrize("offset_ms", [50.0, -50.0])
def test_the_time_of_fixes_is_found_wrong_soon_after_lift_off(offset_ms):
    """A stamp that is later than the fix by so much belongs to a fix measured before it."""
    flown = fly("shefex2_andoya", f"gps.clock_offset={offset_ms} ms", until_s=100.0)
    found = said(flown)
    assert found and found[0][0] < 10.0
    assert re.search(r"about \d+ ms (before|after)", found[0][1])[1] == (
        "before" if offset_ms > 0.0 else "after"
    )
    after = flown.t_s > found[0][0] + 0.2
    assert np.all(flown.doubts[after] != Doubt.NONE)


def test_a_lever_arm_is_found_wrong_in_the_spin():
    """What is told is 1 m off across the axis about which the rocket spins."""
    flown = fly("rexus_like", "navigation.told.gps.antenna.lever_arm=[0 m, 1 m, 0 m]", until_s=60.0)
    found = said(flown)
    assert found and found[0][1].startswith("lever arm wrong")


TIGHT = "gps.only=null", "navigation.gps=tight"
FEW = "navigation.gps=tight", "gps.only=[{from: 10 s, until: 400 s, satellites: 5}]"


def test_right_constants_of_ranges_are_never_found_wrong():
    for given in (TIGHT, FEW):
        assert not said(fly("tight", *given, until_s=150.0, seed=3))


@pytest.mark.parametrize("offset_ms, side", [(50.0, "before"), (-50.0, "after")])
def test_the_time_of_ranges_is_found_wrong(offset_ms, side):
    flown = fly("tight", *TIGHT, f"gps.clock_offset={offset_ms} ms", until_s=100.0)
    found = said(flown)
    assert found and found[0][0] < 60.0 and found[0][1].endswith(f"{side} it")
    assert np.all(flown.doubts[flown.t_s > found[0][0] + 0.2] != Doubt.NONE)


def test_the_lever_arm_of_ranges_is_found_wrong_in_the_spin():
    flown = fly("tight", *TIGHT, "navigation.told.gps.antenna.lever_arm=[0 m, 1 m, 0 m]", until_s=80.0)
    found = said(flown)
    assert found and found[0][1].startswith("lever arm wrong")
