"""Figures of trust, counted by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.records import Doubt, NavHealth
from shefex_nav.report import trust

T_S = 0.1 * np.arange(100)
AXES = {"position": 2, "velocity": 2, "attitude": 3}


def solution(doubts, level):
    """A hundred ticks: {quantity: (100,) Doubt}, level of every axis of every quantity."""
    fields = {"t_s": T_S}
    for quantity, size in AXES.items():
        doubt = np.asarray(doubts.get(quantity, np.zeros(100)), dtype=np.int64)
        fields[f"protection_{quantity}"] = np.full((100, size), level)
        fields[f"doubt_{quantity}"], fields[f"do_not_use_{quantity}"] = doubt, doubt != 0
    return SimpleNamespace(**fields)


@pytest.fixture
def told(monkeypatch):
    """Function (doubts, errors) -> figures; errors : {quantity: (100,)}, along its last axis."""

    def figures(doubts, errors, level=1.0):
        sizes = {quantity: np.zeros((100, n)) for quantity, n in AXES.items()}
        for quantity, error in errors.items():
            sizes[quantity][:, -1] = error
        monkeypatch.setattr(trust, "axis_errors", lambda data: (T_S, sizes))
        return trust.trust(SimpleNamespace(nav=solution(doubts, level), health=[]), 7.0)

    return figures


def at(*spans):
    """(100,) bool: inside any of some spans of time, their ends not."""
    return np.any([(T_S > a - 0.05) & (T_S < b - 0.05) for a, b in spans], axis=0)


def test_each_quantity_is_counted_by_itself(told):
    doubts = {"attitude": np.where(at((0.0, 3.0)), Doubt.LEVEL, np.where(at((3.0, 4.0)), Doubt.IMU, 0))}
    found = told(doubts, {"position": np.where(at((5.0, 7.0)), 1.5, 0.5), "attitude": 9.0 * at((0.0, 4.0))})
    assert found["attitude"]["usable_share"] == 0.6 == found["usable_share"]
    assert found["attitude"]["doubts"] == {"level": 0.3, "imu": 0.1}
    assert found["attitude"]["misleading_share"] == 0.0  # of 9 levels, but not to be used
    position = found["position"]
    assert position["usable_share"] == 1.0 and position["usable_h"] == pytest.approx(10.0 / 3600.0)
    assert (position["misleading_share"], position["misleading_events"]) == (0.2, 1)
    assert position["over_level"] == 1.5 and found["velocity"]["over_level"] == 0.0
    assert found["misleading_share"] == 0.2
    assert found["at_entry"] == {"usable": True}
    assert position["at_entry"] == {"usable": True, "doubt": "none", "protection_m": [1.0, 1.0]}
    assert np.allclose(found["attitude"]["at_entry"]["protection_deg"], np.degrees(1.0))


def test_an_error_that_is_over_in_a_second_misleads_nobody(told):
    error = {"velocity": 2.0 * at((1.0, 2.0), (4.0, 5.3))}
    found = told({}, error)["velocity"]
    assert (found["misleading_events"], found["misleading_share"]) == (1, 0.13)
    unused = {"velocity": np.where(at((4.6, 4.7)), Doubt.CONTRADICTED, 0)}  # a tick in the middle
    assert told(unused, error)["velocity"]["misleading_events"] == 0


def test_a_quantity_that_must_not_be_used_at_entry(told):
    found = told({"velocity": np.full(100, Doubt.CONTRADICTED)}, {})
    assert found["at_entry"] == {"usable": False} and found["usable_share"] == 0.0
    assert np.isnan(found["velocity"]["over_level"])  # never usable


def test_an_older_log_has_none(told):
    assert told({}, {}, level=np.nan) is None


def test_what_was_noticed_and_for_how_long():
    said = [
        NavHealth(1.0, "gps", False, "frozen: position of T+0.0 s"),
        NavHealth(2.0, "gyro y", False, "stuck"),
        NavHealth(3.0, "gps", False, "no fix: outage"),
        NavHealth(4.0, "gps", True, ""),
    ]
    found = [(e["source"], e["from_s"], e["until_s"], e["reason"].split(":")[0]) for e in trust.noticed(said)]
    assert found == [
        ("gps", 1.0, 3.0, "frozen"),
        ("gyro y", 2.0, None, "stuck"),
        ("gps", 3.0, 4.0, "no fix"),
    ]
