"""What a scenario requires and its flight can never show: it would count as not met, in every run.

An entry where the vehicle stays below 100 km or in orbit, stars where the star tracker is off, a pointing
error without attitude control. Who extends a mission inherits its requirements, and is to be told before a
campaign says that no run met them. Of what comes with the flight it is said only where that is known.
"""

from shefex_nav.records import QUANTITIES
from shefex_nav.report.requirements import AIR_KM, OF_LIMIT, limits

_AT_ENTRY = *(f"{name}_at_entry" for name in QUANTITIES), "usable_at_entry"
AT_ENTRY = *_AT_ENTRY, *(f"{name}_protection_at_entry" for name in QUANTITIES)
POINTING = tuple(f"{name}_while_pointing" for name in QUANTITIES)
STARS = "wrong_star_fixes", "star_fixes"
CONTROL = "pointing_error", "cold_gas"
HOLDING = "dwell", "turn_with_orbit", "hold"  # kinds of tasks of the phase POINTING


def found(scenario, flown):
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
