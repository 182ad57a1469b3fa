"""Requirements against the summary of a run."""

import math

import pytest

from shefex_nav.records import QUANTITIES
from shefex_nav.report import requirements
from shefex_nav.scenario.requirements import Attitude, Requirements

ATTITUDE = {"limit": "0.17 deg", "at_entry": True}

SUMMARY = {
    "flight": {"apogee_km": 176.2},
    "attitude_control": None,
    "star_tracker": {"solved": 95, "in_window": 100, "wrong": 1},
    "navigation": {
        "at_entry": {"attitude_error_deg": [0.1, -0.18, 0.0], "position_error_m": 99.0},
        "while_pointing": {
            **{"solution_share": 1.0, "from_s": 250.0, "to_s": 372.0},
            "attitude_deg": {"rms": 0.02, "max": 0.05},
            "position_m": {"rms": 2.0, "max": 4.0},
        },
        "integrity": {
            "misleading_share": 0.002,
            "at_entry": {"usable": True},
            "position": {"misleading_share": 0.0, "at_entry": {"protection_m": [30.0, 40.0]}},
            "velocity": {"misleading_share": 0.002, "at_entry": {"protection_m_s": [0.3, 0.4]}},
            "attitude": {"misleading_share": 0.0, "at_entry": {"protection_deg": [0.1, 0.2, 0.1]}},
        },
    },
}


def passed(**wanted):
    (one,) = requirements.judge(Requirements(**wanted), SUMMARY)
    return one.found, one.passed


@pytest.mark.parametrize(
    ("wanted", "found", "is_passed"),
    [
        ({"attitude": {"limit": "0.17 deg", "at_entry": True}}, 0.18, False),  # the largest, without sign
        ({"attitude": {"limit": "0.18 deg", "at_entry": True}}, 0.18, True),  # the limit itself is kept
        ({"position": {"limit": "0.1 km", "at_entry": True}}, 99.0, True),
        ({"position": {"limit": "50 m", "protection_at_entry": True}}, 50.0, True),  # hypot(30, 40)
        ({"velocity": {"limit": "0.49 m/s", "protection_at_entry": True}}, 0.5, False),
        ({"usable_at_entry": True}, True, True),
        ({"attitude": {"limit": "0.15 deg", "protection_at_entry": True}}, 0.2, False),
        ({"attitude": {"limit": "0.25 deg", "protection_at_entry": True}}, 0.2, True),
        ({"attitude": {"limit": "0.05 deg", "while_pointing": True}}, 0.05, True),
        ({"position": {"limit": "3 m", "while_pointing": True}}, 4.0, False),
        ({"misleading": "0 %"}, 0.2, False),
        ({"misleading": "0.2 %"}, 0.2, True),
        ({"wrong_star_fixes": 0}, 1, False),
        ({"star_fixes": "95 %"}, 95.0, True),
        ({"star_fixes": "95.1 %"}, 95.0, False),
        ({"apogee": "170 km"}, 176.2, True),
        ({"apogee": "177 km"}, 176.2, False),
    ],
)
def test_limits(wanted, found, is_passed):
    assert passed(**wanted) == (pytest.approx(found), is_passed)


@pytest.mark.parametrize("wanted", [{"cold_gas": "5 kg"}, {"velocity": {"at_entry": True}}])
def test_what_was_not_measured_was_not_met(wanted):
    assert passed(**wanted) == (None, False)


def star_fixes(apogee_km, **star):
    figures = {f"star_tracker.{name}": value for name, value in star.items()}
    (one,) = requirements.judge_figures({"star_fixes": 95.0}, (figures | {"flight.apogee_km": apogee_km}).get)
    return one


@pytest.mark.parametrize(
    ("apogee_km", "star", "is_passed", "said"),
    [
        (176.2, {"solved": 1251, "in_window": 1251}, True, "100 % of 1251 frames"),
        (176.2, {"solved": 0, "in_window": 1}, False, "0 % of 1 frame"),
        (None, {"solved": 81, "in_window": 81}, True, "100 % of 81 frames"),  # on the ground, in orbit
        (176.2, {"solved": 0, "in_window": 0}, False, "not measured: no frame in the window"),
        (176.2, {}, False, "not measured: no frame in the window"),
        (84.2, {"solved": 81, "in_window": 81}, False,
         "not measured: the camera stayed in the air, below 100 km"),
    ],
)  # fmt: skip
def test_a_share_says_of_how_many_frames_it_is(apogee_km, star, is_passed, said):
    one = star_fixes(apogee_km, **star)
    assert (one.passed, requirements.in_words(one)) == (is_passed, said)
    assert (one.found is None) == said.startswith("not measured")


def test_no_frame_is_no_proof_that_none_is_wrong():
    for frames, found in ((0, None), (5, 0)):
        figures = {"star_tracker.frames": frames, "star_tracker.wrong": 0}
        (one,) = requirements.judge_figures({"wrong_star_fixes": 0}, figures.get)
        assert one.found == found and one.passed == (found == 0)


@pytest.mark.parametrize(
    ("name", "found", "is_passed", "verdict"),
    [
        ("attitude_at_entry", 0.1, True, "met"),  # entry comes once
        ("attitude_at_entry", 0.2, False, "not met"),
        ("attitude_at_entry", None, False, "not reached"),
        ("cold_gas", 3.0, True, "met so far"),  # the rest of the mission needs more
        ("cold_gas", 9.0, False, "not met"),  # and gives nothing back
        ("star_fixes", 99.0, True, "met so far"),
        ("star_fixes", 90.0, False, "not met so far"),  # later frames may be good
    ],
)
def test_a_part_of_a_mission_decides_what_the_rest_cannot_change(name, found, is_passed, verdict):
    one = requirements.Judged(name, 1.0, found, "", is_passed)
    assert requirements.verdict(one, is_part=True) == verdict
    assert requirements.verdict(one, is_part=False) == ("met" if is_passed else "not met")


def test_limits_are_shown_as_they_were_written():
    found = requirements.limits(Requirements(attitude=ATTITUDE, star_fixes="95 %", usable_at_entry=True))
    assert found == {"attitude_at_entry": 0.17, "usable_at_entry": True, "star_fixes": 95.0}
    assert requirements.words("attitude_at_entry", 0.17, "deg") == "at most 0.17 deg"


def test_a_limit_alone_requires_nothing():
    assert requirements.limits(Requirements(attitude={"limit": "0.1 deg"})) == {}


def test_every_field_of_the_section_is_measured():
    judged = set(requirements.MEASURES) - set(requirements.OF_LIMIT)
    made_for = {"integrity_risk", "probability", "confidence"}  # of levels, predictions and campaigns
    assert judged | made_for | set(QUANTITIES) == set(Requirements.model_fields)
    assert {key for _, key in requirements.OF_LIMIT.values()} | {"limit"} == set(Attitude.model_fields)
    assert math.isclose(requirements.MEASURES["cold_gas"].factor, 1.0)


def test_runs_are_put_in_order_by_what_they_miss_and_then_by_how_near_they_came():
    wanted = Requirements(attitude=ATTITUDE, wrong_star_fixes=0, star_fixes="90 %")

    def severity(attitude_deg, wrong, solved):
        summary = {
            "navigation": {"at_entry": {"attitude_error_deg": [attitude_deg, 0.0, 0.0]}},
            "star_tracker": {"solved": solved, "in_window": 100, "wrong": wrong},
        }
        return requirements.severity(requirements.judge(wanted, summary))

    order = [severity(0.01, 0, 99), severity(0.01, 0, 95), severity(0.165, 0, 99), severity(0.2, 0, 99)]
    order += [severity(0.5, 0, 99), severity(0.2, 1, 99), severity(0.2, 1, 0)]
    assert order == sorted(order) and len(set(order)) == len(order)
    assert order[2] < 1.0 <= order[3] < 2.0 <= order[5] < 3.0 <= order[6]


def test_nothing_found_and_anything_too_much_are_worse_than_nearly_enough():
    """At least 95 % of the star fixes, at most 0 wrong ones: 0 % and 300 are the worst runs, not the best."""
    limits = {"star_fixes": 95.0, "wrong_star_fixes": 0}

    def severity(solved, wrong):
        figures = {"star_tracker.solved": solved, "star_tracker.in_window": 100, "star_tracker.wrong": wrong}
        return requirements.severity(requirements.judge_figures(limits, figures.get))

    assert severity(0, 0) > severity(90, 0) > severity(96, 0) > severity(100, 0)
    assert severity(100, 300) > severity(100, 0)
