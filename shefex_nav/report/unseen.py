"""What of a scenario its flight never comes to: outages of events that it lacks, faults after its end.

They would have no effect, and nobody would see that. Said only where the flight is known to its end.
"""

from shefex_nav.clock import SAME_S
from shefex_nav.scenario import checks_flight


def found(scenario, flown):
    """Warnings: (path in the scenario, text). flown : programme.Flown"""
    at = {}
    for event in flown.events:
        at.setdefault(event.name, event.t_s)
    ended_s, words = at.get("impact"), "the impact"
    if ended_s is None and scenario.trajectory is not None and not flown.is_part:
        ended_s, words = flown.end_s, "the end of the trajectory"
    if ended_s is not None:
        had = [name for name in checks_flight.possible_events(scenario) if name in at]
        yield from _outages(scenario.gps.outages, had)
    elif (scenario.orbit or scenario.ground) and flown.end_s >= scenario.mission.time_limit - SAME_S:
        ended_s, words = scenario.mission.time_limit, "the end of the flight"
    if ended_s is None:
        return
    begin_s, none = scenario.mission.start, "it has no effect"
    for path, several in _spans(scenario):
        for k, one in enumerate(several):
            if one.start >= ended_s:
                yield (*path, k, "from"), f"{one.start:g} s is after {words}, T{ended_s:+.1f} s: {none}"
            elif one.end <= begin_s:
                yield (*path, k, "until"), f"{one.end:g} s is before mission.start, {begin_s:g} s: {none}"


def _spans(scenario):
    """(path, list of what begins and ends at given times) of everything that goes wrong with sensors."""
    for device in type(scenario.faults).model_fields:
        yield ("faults", device), getattr(scenario.faults, device)
    yield ("gps", "only"), scenario.gps.only


def _outages(outages, had):
    """Outages that no event begins. had : names of the events that happened"""
    for k, outage in enumerate(outages):
        if outage.event not in had:
            words = f"the flight has no {outage.event}, so this outage does not happen; it has "
            yield ("gps", "outages", k, "event"), words + ", ".join(had)
