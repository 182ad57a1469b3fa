"""What a scenario gets wrong of its flight: tasks and devices whose times do not fit the heights, and more.

A programme's times count from lift-off and are not moved by another launch angle or another motor. The
vehicle flies them all the same; an engineer wants to be told. The events of the flight say at which height
each of its moments was. They say, too, for how long weight acts, which the filter has to be made for
(`lasting`).
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.environment import ephemeris
from shefex_nav.report import air_on_board, lasting, odd_parts, sensor_limits, star_light, star_sight, unseen
from shefex_nav.report.pairing import pointing_error
from shefex_nav.report.requirements import AIR_KM
from shefex_nav.scenario import aboard, lens

LOOKS = "the star camera looks into the air, which the frames here do not show"
UPRIGHT = math.radians(89.0)  # an elevation from which on little is won
TURNS = math.radians(15.0)  # so much gravity and wind bend the path of a burn down, at most
ASTRAY_DEG = 5.0  # an attitude control that holds is within a degree
LOOKING = *star_sight.TURNS, "dwell", "turn_with_orbit"  # kinds of tasks in which the star camera works
DEVICES = ("yo_yo", "spin_motors")


class Warned(NamedTuple):
    """Something in a scenario that does not fit the flight."""

    field: tuple  # path in the scenario
    text: str


class Flown(NamedTuple):
    """What a flight has to say of its scenario."""

    events: tuple  # of Event
    astray_deg: float  # largest pointing error in the phases POINTING; 0 if there was none
    end_s: float  # of what is known of it
    motion: sensor_limits.Motion | None = None  # None: not known
    track: sensor_limits.Track | None = None  # likewise
    sight: star_sight.Sight | None = None  # likewise
    pushed: lasting.Pushed | None = None  # None: not known, or hardly any
    turned: np.ndarray | None = None  # likewise, of `lasting.turned`
    is_part: bool = False  # it went on after end_s


class _Moments(NamedTuple):
    """Times of the physical events, s; None for those that did not happen."""

    apogee: float | None
    entry: float | None
    landed: float | None
    low: float | None  # 60 km on the way down


def of_flight(flight):
    """Flown of a world.flight.fly.Flight, before any sensor has seen it."""
    truth = flight.trajectory
    return Flown(flight.events, astray_deg(flight.control, truth), float(truth.t_s[-1]), *_of_truth(truth))


def of_data(data):
    """Flown of a RunData."""
    truth, is_part = data.truth, data.ended_early or data.until_s is not None
    known = _of_truth(truth) if len(truth.t_s) else ()
    astray, end_s = astray_deg(data.control, truth), float(data.last_t_s)
    return Flown(tuple(data.events), astray, end_s, *known, is_part=is_part)


def _of_truth(truth):
    """`motion` to `turned` of Flown. Trajectory or TruthSample of arrays"""
    return (
        sensor_limits.motion(truth.t_s, truth.omega_ib_b, truth.f_b),
        sensor_limits.track(truth.t_s, truth.r_i, truth.v_i),
        star_sight.sight(truth.t_s, truth.q_ib, truth.r_i),
        lasting.pushed(truth),
        lasting.turned(truth),
    )


def astray_deg(control, truth):
    """Largest pointing error of the phases POINTING, deg; control may be None. See `pointing_error`."""
    angle = np.zeros(0) if control is None else pointing_error(control, truth)
    return float(np.degrees(angle.max(initial=0.0)))


def foreseen(scenario, flown=None):
    """The warnings of a scenario whose states are settled, as `check` gives them.

    flown : of its flight; None: its vehicle is flown for them, without sensors, which raises FlightError as a
        run does; one at rest is not, and of an orbit the first `prepare.BEGIN_S` are

    Raises CatalogueError where the star tracker can have no catalogue.
    """
    if scenario.ground is not None:
        flown = Flown((), 0.0, scenario.mission.time_limit)
    elif flown is None:
        from shefex_nav import prepare

        begin = prepare.fly_begin if scenario.orbit is not None else prepare.fly_vehicle
        flown = of_flight(begin(scenario, prepare.PLANNED))
    light = (Warned(*one) for one in star_light.warnings(scenario))
    whole = flown._replace(end_s=scenario.mission.time_limit) if scenario.orbit is not None else flown
    cut = f"; looked at until T{flown.end_s:+.0f} s" if whole.end_s > flown.end_s + SAME_S else ""
    by_flight = (one._replace(text=f"{one.text}{cut}") for one in _by_flight(scenario, whole))
    return (*of_files(scenario), *light, *_by_itself(scenario), *by_flight)


def of_files(scenario):
    """What is odd in the files of a scenario, whatever flies: tuple of Warned."""
    return (*(Warned(*one) for one in scenario.dropped), *of_trajectory(scenario))


def of_trajectory(scenario):
    """What is odd in the file of a trajectory, if the scenario has one: tuple of Warned."""
    if scenario.trajectory is None:
        return ()
    from shefex_nav import prepare
    from shefex_nav.trajectory import flight

    odd = flight.oddities(scenario, prepare.earth_rotation(scenario))
    return tuple(Warned(one.field, one.text) for one in odd)


def of_parts(scenario):
    """What no rocket has, whatever its flight: list of Warned. See `odd_parts`."""
    return [Warned(path, text) for path, text in odd_parts.found(scenario)]


def warnings(scenario, flown):
    """Everything that does not fit: tuple of Warned, in the order of the scenario.

    The programmes of vehicles that are not launched have no such moments; nothing is said of what a cut log
    has not seen.
    """
    return (*_by_itself(scenario), *_by_flight(scenario, flown))


def _by_itself(scenario):
    """What is odd whatever the flight: list of Warned."""
    found = _of_epoch(scenario.mission.epoch) + _of_acceptance(scenario.star_tracker)
    if words := lens.off_axis(scenario.star_camera):
        found.append(Warned(("star_camera", "optics", "principal_point"), words))
    found += [Warned(*one) for one in star_sight.too_fast(scenario)]
    found += [Warned(*one) for one in aboard.unused_blocks(scenario)]
    return found + of_parts(scenario)


def _by_flight(scenario, flown):
    """What does not fit the flight: list of Warned."""
    found = []
    if scenario.launch is not None:
        found += _of_programme(scenario, flown)
    elif scenario.orbit is not None:
        found += _of_sight(scenario, flown)
    said = []  # (path, text)
    if flown.motion is not None:
        said += sensor_limits.beyond(scenario.imu, flown.motion)
        said += sensor_limits.coarse(scenario.imu, flown.motion)
        said += star_sight.turning(scenario, flown.motion)
    if flown.track is not None:
        said += sensor_limits.beyond_gps(scenario.gps, flown.track)
    if text := lasting.words(scenario, flown):
        said.append((("navigation", "states"), text))
    if text := air_on_board.words(scenario, flown):
        said.append((("atmosphere", "model"), text))
    said += unseen.found(scenario, flown)
    said += unseen.never_met(scenario, flown)
    return [*found, *(Warned(*one) for one in said)]


def _of_epoch(epoch_utc):
    """A day whose leap seconds are not known: list of Warned."""
    if ephemeris.is_utc_known(epoch_utc):
        return []
    words = "leap seconds of that year are not known, and those of today are taken: sky and Earth are"
    return [Warned(("mission", "epoch"), f"{words} 15 arcsec off for each that is missing")]


def _of_acceptance(tracker):
    """A star tracker whose attitudes nobody verifies: list of Warned."""
    settings = tracker.identification
    if not tracker.enabled or settings.acceptance == "verified":
        return []
    words = (
        f"an attitude of method {settings.method!r} is accepted as its paper does, so wrong attitudes are "
        "believed; acceptance: verified holds each against the whole field"
    )
    return [Warned(("star_tracker", "identification", "acceptance"), words)]


def _of_programme(scenario, flown):
    """Times, devices and attitude of a vehicle that is launched: list of Warned."""
    found = [*_tasks(scenario, flown), *_devices(scenario, flown), *_star_tracker(scenario, flown)]
    if not found and flown.astray_deg > ASTRAY_DEG:
        words = f"the vehicle was up to {flown.astray_deg:.1f} deg off the attitude that it was to hold"
        found.append(Warned(("programme",), f"{words}; the attitude control could not keep it"))
    else:
        found += _of_sight(scenario, flown)
    return [*found, *_on_the_way_up(scenario, flown)]


def _of_sight(scenario, flown):
    """Where the star camera looks: list of Warned."""
    if flown.sight is None:
        return []
    looks = [(name, task) for name, task in scenario.tasks if task.task in LOOKING]
    told = *star_sight.excluded(scenario, flown.sight, looks), *star_sight.poor(scenario, flown.sight, looks)
    return [Warned(*one) for one in told]


def _moments(flown):
    at = {}
    for event in flown.events:
        at.setdefault(event.name, event.t_s)
    return _Moments(at.get("apogee"), at.get("entry"), at.get("impact"), at.get("altitude_60km"))


def _height_km(flown, name):
    """Height of the vehicle at the event `name`; None if it did not happen."""
    return next((1e-3 * event.altitude_m for event in flown.events if event.name == name), None)


def _tasks(scenario, flown):
    moments = _moments(flown)
    for name, task in scenario.tasks:
        path, looks = ("programme", name), task.task in LOOKING
        if task.start > flown.end_s:
            if moments.landed is not None:
                yield Warned(
                    (*path, "from"), f"{task.start:g} s is after the impact, T{moments.landed:+.1f} s"
                )
            continue
        if moments.entry is not None:
            yield from _late(flown, name, task, looks)
        elif looks and moments.landed is not None:
            top_km = _height_km(flown, "apogee") or 0.0
            yield Warned(path, f"the vehicle stays in the air, its apogee is {top_km:.1f} km: "
                         f"the star camera cannot see through it{_steeper(scenario, top_km)}")  # fmt: skip
            continue
        if looks:
            yield from _early(scenario, flown, name, task)
        at = getattr(task, "at", None)
        if task.task == "align_velocity" and moments.low is not None and at > moments.low:
            if moments.entry is not None:
                words = f"{_after(at, moments)}, below 60 km"
            elif moments.landed is not None and at > moments.landed:
                words = f"{at:g} s is after the impact, T{moments.landed:+.1f} s"
            else:
                words = f"{at:g} s is on the way down, below 60 km"
            words += "; wanted is the velocity of about the entry"
            yield Warned((*path, "at"), words)


def _steeper(scenario, top_km):
    """Words about what would raise an apogee of top_km: launch and burns that are not upright, or the motors.

    The height of a throw goes with the square of the sine of its elevation, TURNS less by the end of a burn.
    """
    angles = {"launch.elevation": scenario.launch.elevation}
    for stage in scenario.vehicle.stages.values():
        turns = [one for one in scenario.tasks if one[1].task == "turn" and one[1].end <= stage.ignition]
        if turns:  # the last of them is what the burn begins with
            name, task = turns[-1]
            angles[f"programme.{name}.elevation"] = task.elevation
    low = {name: angle for name, angle in angles.items() if angle < UPRIGHT}
    named = [f"{name} ({math.degrees(angle):.4g} deg)" for name, angle in low.items()]
    least = max(min(low.values(), default=UPRIGHT) - TURNS, 0.0)
    if not low or top_km < AIR_KM * math.sin(least) ** 2:
        why = f"not even a burn straight up would reach {AIR_KM:.0f} km" if low else "it burns straight up"
        return f"; {why}: it takes more impulse of the motors, or less mass or drag"
    return f"; a larger {' or '.join(named)} raises it"


def _after(t_s, moments):
    """How long after the entry a time is."""
    return f"{t_s:g} s is {t_s - moments.entry:.1f} s after the entry at T{moments.entry:+.1f} s"


def _late(flown, name, task, looks):
    """A task that goes on below the entry."""
    moments = _moments(flown)
    if task.end <= moments.entry or task.start > flown.end_s:
        return
    why = LOOKS if looks else "cold gas steers against the air"
    is_all = task.start >= moments.entry
    key, t_s, verb = ("from", task.start, "start") if is_all else ("until", task.end, "end")
    height_km = _height_km(flown, f"{name}_{verb}")
    place = "" if height_km is None else f", at {height_km:.1f} km"
    words = f"{_after(t_s, moments)}{place}: {why}; {verb} it before"
    yield Warned(("programme", name, key), words)


def _early(scenario, flown, name, task):
    """A task of the star camera on the way up through the air, or under thrust."""
    moments, height_km = _moments(flown), _height_km(flown, f"{name}_start")
    rising = moments.apogee is None or task.start < moments.apogee
    if rising and height_km is not None and height_km < AIR_KM:
        words = f"{task.start:g} s is on the way up, at {height_km:.1f} km: {LOOKS}"
        yield Warned(("programme", name, "from"), f"{words}; start it above {AIR_KM:.0f} km")
    out = {event.name: event.t_s for event in flown.events}
    for n, (stage, given) in enumerate(scenario.vehicle.stages.items(), 1):
        burn_out = out.get(f"burn_out_{n}")
        if burn_out is not None and given.ignition < task.end and task.start < burn_out:
            words = f"from {task.start:g} s until {task.end:g} s the star camera is to be pointed"
            burns = f"T{given.ignition:+.1f} to {burn_out:+.1f} s"
            yield Warned(("programme", name), f"{words}, while {stage} burns, {burns}")


def _devices(scenario, flown):
    """Spin motors and yo-yo in the air, a parachute on the way up, gas that runs out."""
    moments, vehicle = _moments(flown), scenario.vehicle
    for name in DEVICES:
        device = getattr(vehicle, name)
        if device is not None and moments.entry is not None and moments.entry < device.at <= flown.end_s:
            yield Warned(("vehicle", name, "at"), f"{_after(device.at, moments)}; it belongs before")
    parachute = vehicle.parachute
    if parachute is not None and parachute.at is not None and parachute.at < (moments.apogee or 0.0):
        words = f"{parachute.at:g} s is before the apogee, T{moments.apogee:+.1f} s"
        yield Warned(("vehicle", "parachute", "at"), f"{words}: it opens on the way up")
    empty = next((event.t_s for event in flown.events if event.name == "cold_gas_empty"), None)
    if empty is not None:
        words = f"{vehicle.cold_gas.propellant:g} kg are used up at T{empty:+.1f} s"
        yield Warned(("vehicle", "cold_gas", "propellant"), f"{words}: from then on nothing is steered")


def _star_tracker(scenario, flown):
    """A star tracker that is on in the air on the way down."""
    moments, tracker = _moments(flown), scenario.star_tracker
    entry = moments.entry
    if not tracker.enabled or entry is None or tracker.off <= entry or flown.end_s <= entry:
        return
    key, t_s = ("on", tracker.on) if tracker.on >= entry else ("off", tracker.off)
    yield Warned(("star_tracker", key), f"{_after(t_s, moments)}: {LOOKS}")


def _on_the_way_up(scenario, flown):
    """A star tracker that is on in the air before the vehicle leaves it, or although it never does."""
    moments, tracker = _moments(flown), scenario.star_tracker
    looks = any(task.task in LOOKING for _, task in scenario.tasks)
    if not tracker.enabled:
        return
    if moments.landed is not None and moments.entry is None:
        if not looks:  # of tasks it is said
            top_km = _height_km(flown, "apogee") or 0.0
            words = f"the vehicle stays in the air, its apogee is {top_km:.1f} km: {LOOKS}"
            yield Warned(("star_tracker", "enabled"), f"{words}; write false")
        return
    if flown.track is None:
        return
    heights_km, t_s = 1e-3 * sensor_limits.heights(flown.track), flown.track.t_s
    above = np.flatnonzero(heights_km >= AIR_KM)
    if len(above) and tracker.on < t_s[above[0]] - sensor_limits.STEP_S:
        height_km = float(np.interp(tracker.on, t_s, heights_km))
        words = f"{tracker.on:g} s is on the way up, at {height_km:.1f} km: {LOOKS}; switch it on above"
        yield Warned(("star_tracker", "on"), f"{words} {AIR_KM:.0f} km, from T{t_s[above[0]]:+.0f} s on")
