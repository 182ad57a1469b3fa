"""Instruments that the gate refuses are told of, believed or not; gates of their own."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from navigation_flight import PARAMS
from scipy import stats

from shefex_nav.onboard.navigation import aiding, integrity, integrity_protection, integrity_watch, sensor
from shefex_nav.onboard.navigation.aid import Aid
from shefex_nav.onboard.navigation.state import POS, layout
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


@pytest.mark.parametrize("name", ["star_vectors", "gps_range", "gps_range_rate"])
def test_rows_of_which_few_are_compared_with_none_are_told_of_too(name):
    """Two or three satellites, single stars: they do not agree with each other; three in a row say enough."""
    contradicting = integrity_watch.contradicting
    assert list(contradicting(refused(2, name))) == []
    assert contradicting(refused(3, name)) == contradicting(refused(60, name)) == [name]
    one = refused(1, name)  # of attitudes there are ten a second: one far off says nothing
    far = [name] if name != "star_vectors" else []
    assert list(contradicting({**one, name: one[name]._replace(far=True)})) == far


def test_a_reading_that_is_used_ends_it():
    health = refused(5)["altimeter"]
    fate, health = integrity.judge(health, None, 1.0, 16.0, 2.0)
    assert fate == integrity.Fate.USED
    assert list(integrity_watch.contradicting({**OTHERS, "altimeter": health})) == []


def test_the_filter_cannot_know_which_of_the_two_is_right():
    watch = integrity_watch.start(PARAMS)
    doubt = partial(watch.graver_doubts, imu_blind=False)
    assert doubt(refused(2)).tolist() == [Doubt.NONE] * 3
    assert doubt(refused(3)).tolist() == [Doubt.CONTRADICTED] * 3


@pytest.mark.parametrize("own", [None, 1e-9])
@pytest.mark.parametrize("rows", [1, 3])
def test_the_gate_of_an_instrument(own, rows):
    limit = integrity.Limits(1e-4)[rows, own]
    assert limit == pytest.approx(stats.chi2.isf(own or 1e-4, rows), rel=1e-9)


def test_it_is_that_of_the_aid_and_of_the_level_too():
    """What a reading that just passes may leave, over the sigma: grows with the root of the limit."""
    aid = Aid("altimeter", None, None, gate_probability=1e-9)
    assert aiding.sensor(aid).gate_probability == 1e-9
    limits = integrity.Limits(1e-4)
    ratio = limits[1, aiding.sensor(aid).gate_probability] / limits[1]
    assert ratio == pytest.approx(stats.chi2.isf(1e-9, 1) / stats.chi2.isf(1e-4, 1), rel=1e-9)
    own, usual = (worst(aiding.sensor(one), limits) for one in (aid, aid._replace(gate_probability=None)))
    assert usual.max() > 0.0 and own == pytest.approx(np.sqrt(ratio) * usual)


def worst(one, limits):
    """(9,) what a wrong height that has just passed the gate could have done, by its own update."""
    order = layout(())
    P, H = np.eye(order.n) + 0.01, np.zeros((1, order.n))
    H[0, POS.start + 2] = 1.0
    after = P - P @ H.T @ H @ P / (H @ P @ H.T + 1.0)
    axes = SimpleNamespace(axes=lambda *_: np.vstack([np.eye(3), [0.0, 0.0, 1e-4]]))
    watch = SimpleNamespace(protection=axes)
    nav = SimpleNamespace(limits=limits, sensors={"altimeter": one}, watch=watch, layout=order, earth=None)
    measurement = SimpleNamespace(sensor="altimeter", admitted=None, fate=integrity.Fate.USED)
    now = SimpleNamespace(P=after, t_s=0.0, x=None)
    found = integrity_protection.of_measurement(nav, now, measurement, P, P, H, np.eye(1), False)
    return found.table[integrity_protection.WORST]
