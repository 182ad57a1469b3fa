"""Outages, faults and limits that a flight never comes to are told: they would have no effect in silence.

Requirements that it can never show are told before it, and the table says why they were not met.
"""

import pytest

from shefex_nav.records import Event
from shefex_nav.report import programme, requirements, unseen
from shefex_nav.scenario import load

EVENTS = (Event(0.0, "lift_off", 0.0, ""), Event(140.0, "apogee", 80e3, ""), Event(495.0, "impact", 0.0, ""))


def told(name, *overrides, events=EVENTS, end_s=495.0, is_part=False):
    """{field: text} of what is said of a flight with these events."""
    flown = programme.Flown(events, 0.0, end_s, is_part=is_part)
    return {".".join(map(str, path)): text for path, text in unseen.found(load.load(name, overrides), flown)}


def test_an_outage_of_an_event_that_does_not_happen():
    """The rocket stays below 100 km: no entry."""
    last = "shortest: 1 s, longest: 2 s"
    given = f"gps.outages=[{{event: apogee, {last}}}, {{event: entry, {last}}}]"
    (field,) = found = told("rexus_like", given)
    assert field == "gps.outages.1.event"
    words = "the flight has no entry, so this outage does not happen; it has lift_off, apogee, impact"
    assert found[field] == words
    assert not told("rexus_like", given, events=EVENTS[:2])  # a log that is cut
    high = (*EVENTS[:2], Event(300.0, "entry", 100e3, ""), EVENTS[2])
    assert not told("rexus_like", given, events=high)


@pytest.mark.parametrize(
    ("start", "end", "key"), [(500, 520, "from"), (494, 520, None), (-30, -20, "until"), (-30, 1, None)]
)
def test_a_fault_and_a_limit_of_the_receiver_outside_the_flight(start, end, key):
    times = f"from: {start} s, until: {end} s"
    for field, given in (
        ("faults.gps.0", f"faults={{gps: [{{fault: outage, {times}}}]}}"),
        ("gps.only.0", f"gps.only=[{{{times}, satellites: 2}}]"),
    ):
        found = told("shefex2_andoya", "gps.outages=[]", given)
        assert list(found) == ([f"{field}.{key}"] if key else [])
        assert all(text.endswith("it has no effect") for text in found.values())


def test_who_does_not_come_down_flies_to_the_time_limit():
    given = "gps.only=[{from: 900 s, until: 950 s, satellites: 2}]"
    limit = load.load("orbit").mission.time_limit
    (text,) = told(
        "orbit", given.replace("900", "90000").replace("950", "95000"), events=(), end_s=limit
    ).values()
    assert text.startswith(f"90000 s is after the end of the flight, T{limit:+.1f} s")
    assert not told("orbit", given.replace("900", "90000").replace("950", "95000"), events=(), end_s=9.0)


def test_a_trajectory_ends_with_its_file():
    """In the air, without an impact, unless it is that of a log that is cut."""
    given = "gps.only=[{from: 90 s, until: 95 s, satellites: 2}]"
    outage = "gps.outages=[{event: entry, shortest: 1 s, longest: 2 s}]"
    cut = {"events": EVENTS[:2], "end_s": 70.0}
    found = told("given_trajectory", given, outage, **cut)
    assert found["gps.only.0.from"].startswith("90 s is after the end of the trajectory, T+70.0 s")
    assert found["gps.outages.0.event"].startswith("the flight has no entry")
    assert not told("given_trajectory", given, outage, **cut, is_part=True)


LOW = (Event(0.0, "lift_off", 0.0, ""), Event(140.0, "apogee", 90.3e3, ""), Event(495.0, "impact", 0.0, ""))
HIGH = (*LOW[:2], Event(300.0, "entry", 100e3, ""), LOW[2])


def required(name, *overrides, events=HIGH):
    """{field: text} of what is said of requirements that such a flight can never show."""
    flown = programme.Flown(events, 0.0, 495.0)
    found = unseen.never_met(load.load(name, overrides), flown)
    return {".".join(map(str, path)): text for path, text in found}


def test_an_entry_that_does_not_happen():
    assert not required("shefex2_andoya")
    assert not required("shefex2_andoya", events=LOW[:2])  # a log that is cut
    (field,) = found = required("shefex2_andoya", events=LOW)
    assert field == "requirements.attitude.at_entry"
    assert found[field].startswith("the flight stays below 100 km, its apogee is 90.3 km: it has no entry; ")
    assert (
        "attitude.at_entry, position.at_entry, velocity.at_entry, usable_at_entry can never" in found[field]
    )
    assert not required("shefex2_andoya", "requirements=null", events=LOW)


@pytest.mark.parametrize(
    ("name", "given", "field", "words"),
    [("cubesat", "requirements={position: {at_entry: true}}", "position.at_entry", "stays in its orbit"),
     ("night_sky", "requirements={apogee: 1 km, usable_at_entry: true}", "usable_at_entry", "on the ground"),
     ("rexus_like", "requirements={star_fixes: 95 %}", "star_fixes", "star tracker is off"),
     ("rexus_like", "requirements={velocity: {while_pointing: true}}", "velocity.while_pointing", "never"),
     ("rexus_like", "requirements={cold_gas: 1 kg}", "cold_gas", "nothing steers")],
)  # fmt: skip
def test_what_a_mission_does_not_have(name, given, field, words):
    (found,) = required(name, given).items()
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
