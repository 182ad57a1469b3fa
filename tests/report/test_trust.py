"""Figures of trust, counted by hand.

A met requirement beside a quantity that is not usable: one sentence that says why both are true.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.records import Doubt, NavHealth
from shefex_nav.report import trust
from shefex_nav.report.requirements import Judged

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

    def figures(doubts, errors, level=1.0, entry_s=7.0, no_level=None):
        sizes = {quantity: np.zeros((100, n)) for quantity, n in AXES.items()}
        for quantity, error in errors.items():
            sizes[quantity][:, -1] = error
        monkeypatch.setattr(trust, "axis_errors", lambda data: (T_S, sizes))
        nav = solution(doubts, level)
        if no_level:
            getattr(nav, f"protection_{no_level}")[:] = np.nan
        return trust.trust(SimpleNamespace(nav=nav, health=[]), entry_s)

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


def test_a_solution_that_ended_before_the_entry_is_not_usable_there(told):
    """The last instant with a solution is T+9.9 s, the entry at T+300 s."""
    found = told({}, {}, entry_s=300.0)
    assert found["at_entry"] is None and found["position"]["at_entry"] is None


def test_a_quantity_that_is_usable_without_a_level_has_no_misleading_share(told):
    """The attitude has levels, and the position an error of 1000 km without one."""
    found = told({}, {"position": np.full(100, 1e6)}, no_level="position")
    for one in (found, found["position"]):
        assert np.isnan(one["misleading_share"])
    assert found["position"]["misleading_events"] is None
    assert found["attitude"]["misleading_share"] == 0.0
    unused = told({"position": np.full(100, Doubt.IMU)}, {}, no_level="position")
    assert unused["misleading_share"] == 0.0


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


MET = Judged("attitude_at_entry", 0.1, 0.032, "deg", True)
POINTED = Judged("attitude_while_pointing", 0.1, 0.037, "deg", True)


def integrity(share, *, usable=False, doubt="level"):
    said = {
        "usable_share": share,
        "limit_deg": 0.1,
        "limit_by_default": False,
        "doubts": {doubt: 1.0 - share},
    }
    entry = {"usable": usable, "doubt": "none" if usable else doubt, "protection_deg": [0.133, 0.134, 0.132]}
    other = {"usable_share": 0.9, "doubts": {}, "at_entry": {"usable": True}}
    return {"position": other, "velocity": other, "attitude": said | {"at_entry": entry}}


def said(judged, trusted):
    errors = {"attitude_sigma_deg": [0.0202, 0.0201, 0.0198]}
    return dict(trust.vouched({"navigation": {"integrity": trusted, "at_entry": errors}}, judged))


def test_it_says_that_the_level_is_above_the_limit_and_what_makes_it_large():
    words = said([MET, POINTED], integrity(0.0))["attitude"]
    assert words.startswith(
        "both are true: the error was small, but the computer on board cannot vouch for it"
    )
    parts = ["At entry: protection level above 0.1 deg (requirements.attitude.limit)", "0.134 deg"]
    parts += ["a sigma of 0.020 deg", "requirements.integrity_risk", "requirements.attitude.limit larger"]
    for part in parts:
        assert part in words


def test_while_pointing_the_share_of_the_time_is_said():
    words = said([POINTED], integrity(0.02))["attitude"]
    assert "For 98.0 % of the time: protection level above 0.1 deg" in words


def test_another_doubt_has_its_own_words_and_no_advice_about_levels():
    words = said([MET], integrity(0.3, doubt="imu"))["attitude"]
    assert words.endswith("At entry: the IMU does not measure the motion")


@pytest.mark.parametrize(
    ("judged", "trusted"),
    [
        ([MET], integrity(0.4, usable=True)),
        ([POINTED], integrity(0.4)),
        ([MET._replace(passed=False)], integrity(0.0)),
        ([], integrity(0.0)),
        ([MET], None),
    ],
)
def test_nothing_is_said_where_nothing_contradicts(judged, trusted):
    assert said(judged, trusted) == {}
