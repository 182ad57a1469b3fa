"""Errors while the vehicle points: those of its phases POINTING alone."""

import numpy as np
import pytest

from shefex_nav.records import Phase
from shefex_nav.report import error_figures, requirements
from shefex_nav.report.navigation_errors import NavErrors
from shefex_nav.scenario.requirements import Requirements


class Truth:
    """What is asked of a truth."""

    def __init__(self, phases):
        self.t_s, self.phase = np.arange(float(len(phases))), np.array(phases, dtype=np.int8)


def made(phases):
    n = len(phases)
    attitude_b = np.radians(np.outer(np.arange(n), [0.01, -0.02, 0.0]))
    position_i, velocity_i = np.outer(np.arange(n), [3.0, 4.0, 0.0]), np.outer(np.ones(n), [0.0, 0.0, 0.5])
    return error_figures.while_pointing(
        Truth(phases), NavErrors(np.arange(float(n)), position_i, velocity_i, attitude_b)
    )


def test_they_are_of_the_phases_pointing_alone():
    found = made([Phase.BOOST, Phase.POINTING, Phase.POINTING, Phase.DESCENT])
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
    pointing = {"solution_share": 1.0, "from_s": 0.0, "to_s": 600.0, "attitude_deg": one, "position_m": one}
    aided = None if stars_s is None else {"from_s": stars_s}
    wanted = Requirements(
        attitude={"limit": "0.05 deg", "while_pointing": True},
        position={"limit": "3 m", "while_pointing": True},
    )
    summary = {"navigation": {"while_pointing": pointing, "star_aided": aided}}
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
    assert made([Phase.PAD, Phase.COAST]) is None
