"""Errors while the vehicle points are those of its phases POINTING alone.

Errors after two star fixes leave out those of the start, which are its alone.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.records import Phase, Reason
from shefex_nav.report import error_figures, requirements
from shefex_nav.report.navigation_errors import NavErrors
from shefex_nav.report.table import _navigation_rows
from shefex_nav.scenario.requirements import Requirements


class Truth:
    """What is asked of a truth."""

    def __init__(self, phases):
        self.t_s, self.phase = np.arange(float(len(phases))), np.array(phases, dtype=np.int8)


def pointing(phases):
    n = len(phases)
    attitude_b = np.radians(np.outer(np.arange(n), [0.01, -0.02, 0.0]))
    position_i, velocity_i = np.outer(np.arange(n), [3.0, 4.0, 0.0]), np.outer(np.ones(n), [0.0, 0.0, 0.5])
    return error_figures.while_pointing(
        Truth(phases), NavErrors(np.arange(float(n)), position_i, velocity_i, attitude_b)
    )


def test_they_are_of_the_phases_pointing_alone():
    found = pointing([Phase.BOOST, Phase.POINTING, Phase.POINTING, Phase.DESCENT])
    assert (found["from_s"], found["to_s"]) == (1.0, 2.0)
    assert found["position_m"] == pytest.approx(
        {"rms": np.sqrt((5**2 + 10**2) / 2), "max": 10.0, "max_at_s": 2.0}
    )
    assert found["velocity_m_s"] == pytest.approx({"rms": 0.5, "max": 0.5, "max_at_s": 1.0})
    sizes = np.hypot(0.01, 0.02) * np.array([1.0, 2.0])
    assert found["attitude_deg"] == pytest.approx(
        {"rms": np.sqrt(np.mean(sizes**2)), "max": 0.04, "max_at_s": 2.0}
    )


def test_the_time_is_that_of_the_largest_error_about_one_axis():
    """At T+0 s the whole error is 0.5 deg, 0.4 about an axis; at T+1 s 0.45 in both; 0.1 after."""
    attitude_b = np.radians([[0.3, 0.4, 0.0], [0.0, -0.45, 0.0], [0.1, 0.0, 0.0]])
    truth = Truth([Phase.POINTING] * 3)
    nothing = np.zeros((3, 3))
    found = error_figures.while_pointing(truth, NavErrors(truth.t_s, nothing, nothing, attitude_b))
    assert found["attitude_deg"]["max"] == pytest.approx(0.45) and found["attitude_deg"]["max_at_s"] == 1.0


@pytest.mark.parametrize(
    ("stars_s", "words"),
    [
        (40.0, "at T+11.2 s, before the second star fix; the largest of T+0 to +600 s"),
        (11.2, "at T+11.2 s; the largest of T+0 to +600 s"),
        (None, "at T+11.2 s; the largest of T+0 to +600 s"),
    ],
)
def test_a_requirement_says_when_its_largest_error_was(stars_s, words):
    one = {"rms": 0.1, "max": 1.196, "max_at_s": 11.2}
    while_pointing = {
        "solution_share": 1.0,
        "from_s": 0.0,
        "to_s": 600.0,
        "attitude_deg": one,
        "position_m": one,
    }
    aided = None if stars_s is None else {"from_s": stars_s}
    wanted = Requirements(
        attitude={"limit": "0.05 deg", "while_pointing": True},
        position={"limit": "3 m", "while_pointing": True},
    )
    summary = {"navigation": {"while_pointing": while_pointing, "star_aided": aided}}
    attitude, position = requirements.judge(wanted, summary)
    assert attitude.note == words and not attitude.passed
    assert position.note == "at T+11.2 s; the largest of T+0 to +600 s"  # of GPS, whatever the stars say
    del one["max_at_s"]
    assert requirements.judge(wanted, summary)[0].note == "at most, T+0 to +600 s"


def test_a_solution_for_a_part_of_it_measures_nothing():
    phases = [Phase.POINTING] * 4
    found = error_figures.while_pointing(
        Truth(phases), NavErrors(np.arange(2.0), *(np.zeros((2, 3)) for _ in range(3)))
    )
    assert found["solution_share"] == 0.5
    wanted = Requirements(attitude={"limit": "1 deg", "while_pointing": True})
    (one,) = requirements.judge(wanted, {"navigation": {"while_pointing": found}})
    assert not one.passed and one.found is None and "50 % of the pointing" in one.note


def test_one_that_never_points_has_none():
    assert pointing([Phase.PAD, Phase.COAST]) is None


def fix(t_s, reason=Reason.NONE):
    return SimpleNamespace(reason=reason, t_available_s=t_s)


def aided(fixes):
    """Attitude errors of 10, 8, 0.3, 0.4 deg at T+0, 1, 2, 3 s."""
    size = np.radians([10.0, 8.0, 0.3, 0.4])
    ones = np.ones((4, 3))
    found = NavErrors(np.arange(4.0), ones, 2.0 * ones, np.outer(size, [0.6, 0.0, 0.8]))
    return error_figures.star_aided(SimpleNamespace(star_fixes=fixes), found)


def test_from_the_second_fix_on():
    found = aided([fix(0.0, Reason.NO_MATCH), fix(0.5), fix(1.0, Reason.SATURATED), fix(1.2), fix(3.0)])
    assert found["from_s"] == 1.2
    rms = np.sqrt(0.5 * (0.3**2 + 0.4**2))
    assert found["attitude_deg"] == pytest.approx({"rms": rms, "max": 0.4})
    assert found["position_m"] == pytest.approx({"rms": np.sqrt(3.0), "max": np.sqrt(3.0)})
    assert found["velocity_m_s"]["max"] == pytest.approx(2.0 * np.sqrt(3.0))


def test_none_without_stars():
    assert aided([]) is None and aided([fix(0.5)]) is None
    assert aided([fix(1.0), fix(9.0)]) is None  # after the last error


def test_rows_of_the_table():
    both = {"rms": 1.0, "max": 2.0}
    pointing = dict.fromkeys(("position_m", "velocity_m_s", "attitude_deg"), both)
    navigation = {
        "position_error_m": both, "velocity_error_m_s": both, "attitude_error_deg": both, "at_entry": None,
        "star_aided": {"from_s": 33.2, "attitude_deg": {"rms": 0.001, "max": 0.004}}, "integrity": None,
        "while_pointing": pointing | {"from_s": 30.0, "to_s": 90.0}, "nees": {"mean": None},
    }  # fmt: skip
    found = dict(_navigation_rows(navigation))
    assert found["after two star fixes"] == "0.001 deg rms, 0.004 deg max, T+33.2 s to the end"
    assert found["while pointing"].endswith("T+30 to +90 s, star fixes since T+33.2 s")
    navigation["while_pointing"]["from_s"] = 40.0
    assert dict(_navigation_rows(navigation))["while pointing"].endswith("T+40 to +90 s")
