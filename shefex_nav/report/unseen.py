"""What of a scenario its flight never comes to: outages of events that it lacks, faults after its end.

They would have no effect, and nobody would see that. Said only where the flight is known to its end.

And what it requires and its flight can never show, which would count as not met in every run (`never_met`):
an entry where the vehicle stays below 100 km or in orbit, stars where the star tracker is off, a pointing
error without attitude control. Who extends a mission inherits its requirements, and is to be told before a
campaign says that no run met them. Of what comes with the flight it is said only where that is known.
"""

from shefex_nav.clock import SAME_S
from shefex_nav.records import QUANTITIES
from shefex_nav.report.requirements import AIR_KM, OF_LIMIT, limits
from shefex_nav.scenario import checks_flight

_AT_ENTRY = *(f"{name}_at_entry" for name in QUANTITIES), "usable_at_entry"
AT_ENTRY = *_AT_ENTRY, *(f"{name}_protection_at_entry" for name in QUANTITIES)
POINTING = tuple(f"{name}_while_pointing" for name in QUANTITIES)
STARS = "wrong_star_fixes", "star_fixes"
CONTROL = "pointing_error", "cold_gas"
HOLDING = "dwell", "turn_with_orbit", "hold"  # kinds of tasks of the phase POINTING


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


def never_met(scenario, flown):
    """Warnings: (path in the scenario, text), one for each reason. flown : programme.Flown"""
    required = limits(scenario.requirements)
    reasons = ((AT_ENTRY, _no_entry), (POINTING, _no_task), (STARS, _no_stars), (CONTROL, _no_control))
    for names, reason in reasons:
        names = [name for name in required if name in names]
        if names and (why := reason(scenario, flown)):
            keys = [OF_LIMIT.get(name, (name,)) for name in names]
            listed = ", ".join(".".join(key) for key in keys)
            words = f"{why}; {listed} can never be met; take away with null what is not meant"
            yield ("requirements", *keys[0]), words


def _no_entry(scenario, flown):
    """Why there is no entry; None where there is one, or where nobody knows."""
    if scenario.ground is not None:
        return "the vehicle stays on the ground, so there is no entry"
    if scenario.orbit is not None:
        perigee_km = 1e-3 * scenario.orbit.perigee_height
        if perigee_km < 1.5 * AIR_KM:
            return None  # the air may bring it down
        return f"the satellite stays in its orbit, its perigee at {perigee_km:.0f} km, so there is no entry"
    heights = {event.name: 1e-3 * event.altitude_m for event in flown.events}
    if "impact" not in heights or "entry" in heights:
        return None
    if "apogee" not in heights:
        return f"the flight does not come down through {AIR_KM:.0f} km, so it has no entry"
    return (
        f"the flight stays below {AIR_KM:.0f} km, its apogee is {heights['apogee']:.1f} km: it has no entry"
    )


def _no_task(scenario, flown):
    if scenario.trajectory is not None or any(task.task in HOLDING for _, task in scenario.tasks):
        return None  # a log that is flown again may have pointed
    return f"the programme never points, with a task {', '.join(HOLDING[:-1])} or {HOLDING[-1]}"


def _no_stars(scenario, flown):
    return None if scenario.star_tracker.enabled else "the star tracker is off (star_tracker.enabled)"


def _no_control(scenario, flown):
    gas = scenario.vehicle is not None and scenario.vehicle.cold_gas is not None
    if gas and scenario.attitude == "flown":
        return None
    return "nothing steers the vehicle with an error of its own (vehicle.cold_gas, attitude: flown)"
