"""Outages, faults and limits that a flight never comes to are told: they would have no effect in silence."""

import pytest

from shefex_nav.records import Event
from shefex_nav.report import programme, unseen
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
