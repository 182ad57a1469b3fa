"""Requirements that a flight can never show are told before it, and the table says why they were not met."""

import pytest

from shefex_nav.records import Event
from shefex_nav.report import programme, requirements, unseen
from shefex_nav.scenario import load

LOW = (Event(0.0, "lift_off", 0.0, ""), Event(140.0, "apogee", 90.3e3, ""), Event(495.0, "impact", 0.0, ""))
HIGH = (*LOW[:2], Event(300.0, "entry", 100e3, ""), LOW[2])


def told(name, *overrides, events=HIGH):
    """{field: text} of what is said of a flight with these events."""
    flown = programme.Flown(events, 0.0, 495.0)
    found = unseen.never_met(load.load(name, overrides), flown)
    return {".".join(map(str, path)): text for path, text in found}


def test_an_entry_that_does_not_happen():
    assert not told("shefex2_andoya")
    assert not told("shefex2_andoya", events=LOW[:2])  # a log that is cut
    (field,) = found = told("shefex2_andoya", events=LOW)
    assert field == "requirements.attitude.at_entry"
    assert found[field].startswith("the flight stays below 100 km, its apogee is 90.3 km: it has no entry; ")
    assert (
        "attitude.at_entry, position.at_entry, velocity.at_entry, usable_at_entry can never" in found[field]
    )
    assert not told("shefex2_andoya", "requirements=null", events=LOW)


@pytest.mark.parametrize(
    ("name", "given", "field", "words"),
    [("cubesat", "requirements={position: {at_entry: true}}", "position.at_entry", "stays in its orbit"),
     ("night_sky", "requirements={apogee: 1 km, usable_at_entry: true}", "usable_at_entry", "on the ground"),
     ("rexus_like", "requirements={star_fixes: 95 %}", "star_fixes", "star tracker is off"),
     ("rexus_like", "requirements={velocity: {while_pointing: true}}", "velocity.while_pointing", "never"),
     ("rexus_like", "requirements={cold_gas: 1 kg}", "cold_gas", "nothing steers")],
)  # fmt: skip
def test_what_a_mission_does_not_have(name, given, field, words):
    (found,) = told(name, given).items()
    assert (
        found[0] == f"requirements.{field}" and words in found[1] and f"{field} can never be met" in found[1]
    )


def test_the_table_says_why():
    wanted = load.load("shefex2_andoya", ["requirements.cold_gas=3 kg"]).requirements
    summary = {"flight": {"apogee_km": 90.3}, "star_tracker": {"frames": 0}}
    words = {one.name: requirements.in_words(one) for one in requirements.judge(wanted, summary)}
    assert words["position_at_entry"] == "not measured: no entry, its apogee is 90.3 km"
    assert words["attitude_at_entry"] == words["usable_at_entry"] == words["position_at_entry"]
    assert words["wrong_star_fixes"] == "not measured: no frame taken"
    assert words["cold_gas"] == "not measured: no attitude control that is flown"
    higher = {"flight": {"apogee_km": 190.0}}
    words = {one.name: requirements.in_words(one) for one in requirements.judge(wanted, higher)}
    assert words["velocity_at_entry"] == "not measured: it did not come down through 100 km"
    came = {"flight": {"apogee_km": 190.0, "at_entry": {"t_s": 300.0}}}  # and no solution was there
    words = {one.name: requirements.in_words(one) for one in requirements.judge(wanted, came)}
    assert words["velocity_at_entry"] == "not measured"
