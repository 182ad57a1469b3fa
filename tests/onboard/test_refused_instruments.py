"""Instruments that the gate refuses are told of, believed or not; gates of their own."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from shefex_nav.onboard.navigation import gate, integrity, integrity_watch, sensor
from shefex_nav.records import Doubt

NOTHING = integrity.HEALTHY
OTHERS = {name: NOTHING for name in ("gps_position", "gps_velocity", "star_tracker", "star_vectors")}


def refused(times, name="altimeter"):
    """Health of a sensor that is never believed, after so many readings far off."""
    health = NOTHING
    for k in range(times):
        trial = sensor.never(None, None, None, None, None)
        fate, health = integrity.judge(health, trial, np.inf, 16.0, 0.2 * k)
        assert fate == integrity.Fate.REJECTED
    return {**OTHERS, name: health}


def test_an_instrument_that_is_never_believed_is_told_of():
    """Its readings are not compared with each other; three in a row say enough."""
    contradicting = integrity_watch.contradicting
    assert list(contradicting(refused(2))) == []
    assert contradicting(refused(3)) == contradicting(refused(825)) == ["altimeter"]
    words = integrity_watch.reason("altimeter", refused(3))
    assert words == "contradicts the filter"


def test_single_stars_and_ranges_have_others_to_speak_for_them():
    """Stars one by one are left to the attitudes, ranges are compared with each other."""
    for name in ("star_vectors", "gps_range", "gps_range_rate"):
        assert list(integrity_watch.contradicting(refused(9, name))) == []


def test_a_reading_that_is_used_ends_it():
    health = refused(5)["altimeter"]
    fate, health = integrity.judge(health, None, 1.0, 16.0, 2.0)
    assert fate == integrity.Fate.USED
    assert list(integrity_watch.contradicting({**OTHERS, "altimeter": health})) == []


def test_the_filter_cannot_know_which_of_the_two_is_right():
    watch = SimpleNamespace(
        constants=SimpleNamespace(found=""), step=None, alarms=set(), moved=None, reasons={}
    )
    doubt = partial(integrity_watch.Watch.graver_doubts, watch, imu_blind=False)
    assert doubt(refused(2)).tolist() == [Doubt.NONE] * 3
    assert doubt(refused(3)).tolist() == [Doubt.CONTRADICTED] * 3


@pytest.mark.parametrize("own", [None, 1e-9])
@pytest.mark.parametrize("rows", [1, 3])
def test_the_gate_of_an_instrument(own, rows):
    one = sensor.Sensor(None, None, np.inf, sensor.never, gate_probability=own)
    nav = SimpleNamespace(limits=integrity.Limits(1e-4))
    assert gate._limit(nav, one, rows) == pytest.approx(stats.chi2.isf(own or 1e-4, rows), rel=1e-9)
