"""Contradictions about the flight: start, air, wind, attitude programme, devices; events it may have."""

from importlib.util import find_spec
from itertools import pairwise

from shefex_nav.clock import SAME_EVENT_S
from shefex_nav.scenario import sounding_checks, surroundings, thrust
from shefex_nav.scenario.mission import WindTable

DOWN = ("apogee", "entry", "altitude_60km", "altitude_20km", "impact")
STARTS = ("launch", "orbit", "ground", "trajectory")
ONE_OF = "a flight starts from exactly one of launch, orbit and ground"
SAMPLED = 0.5  # bandwidth times period up to which a sampled loop is well damped
IN_ORBIT = ("point_nadir", "turn_with_orbit")  # kinds of tasks
DEVICES = ("spin_motors", "yo_yo", "cold_gas", "parachute")
PART = "run --until shows a part of this one"


def start(scenario):
    """Complaint about a flight that starts from nowhere or from several places."""
    given = [name for name in STARTS if getattr(scenario, name) is not None]
    if not given:
        yield ("launch",), f"is missing; {ONE_OF}, or follows a trajectory"
    elif len(given) > 1:
        words = f"{ONE_OF}, here are {' and '.join(given)}"
        if given[-1] == STARTS[-1]:
            words = f"a flight along a trajectory starts as its file says, not from {given[0]}"
        yield (given[-1],), f"{words}; {given[0]}: null takes away what an extended file gives"


def seconds(t_s):
    """A time as people write it."""
    return f"{t_s:g} s"


def air(scenario):
    """Atmosphere and wind."""
    atmosphere, wind = scenario.atmosphere, scenario.wind
    yield from surroundings.contradictions(scenario)
    if atmosphere.model == "msis" and find_spec("pymsis") is None:
        words = "msis needs the package pymsis, which is not installed"
        words += ": pip install 'shefex-nav[msis]'; or take us76"
        yield ("atmosphere", "model"), words
    if not isinstance(wind, WindTable):
        return
    for name, values in (("speed", wind.speed), ("from", wind.direction)):
        if len(values) != len(wind.height):
            words = f"{len(values)} values for {len(wind.height)} heights; give one for each"
            yield ("wind", name), words
    for k, (height, speed) in enumerate(zip(wind.height, wind.speed, strict=False)):
        if speed > (most := sounding_checks.fastest(height)):
            words = f"{speed:g} m/s at {height:g} m is no wind of the Earth; expected at most {most:g} m/s"
            yield ("wind", "speed", k), words
    yield from increasing(("wind", "height"), wind.height, "heights", "m")


def increasing(path, values, noun, unit, factor=1.0):
    """Complaint about the first of `values` that does not exceed the one before; shown times `factor`."""
    for k, (before, value) in enumerate(pairwise(values), 1):
        if value <= before:
            shown = (
                f"{factor * value:g}{unit and ' ' + unit} follows {factor * before:g}{unit and ' ' + unit}"
            )
            yield (*path, k), f"{noun} must increase: {shown}"
            return


def _orbit(scenario):
    """Heights the right way round."""
    if scenario.orbit is not None and scenario.orbit.apogee_height < scenario.orbit.perigee_height:
        words = f"must not be below perigee_height, {1e-3 * scenario.orbit.perigee_height:g} km"
        yield ("orbit", "apogee_height"), words


def _ground(scenario):
    """A vehicle that stands still does nothing."""
    if scenario.ground is None:
        return
    hint = "null takes away what an extended file gives"
    for name in scenario.vehicle.stages:
        yield ("vehicle", "stages", name), f"a vehicle that stands on the ground burns no stage; {hint}"
    for name in scenario.programme:
        yield ("programme", name), f"a vehicle that stands on the ground flies no task; {hint}"
    for name in DEVICES:
        if getattr(scenario.vehicle, name) is not None:
            yield ("vehicle", name), f"a vehicle that stands on the ground does not use it; {hint}"


def earliest(scenario):
    """Time before which nothing can be done, s, and its name."""
    return (0.0, "lift-off") if scenario.launch is not None else (scenario.mission.start, "mission.start")


def within(scenario, path, t_s):
    """Complaint about a time that is not within the flight."""
    begin, name = earliest(scenario)
    if t_s < begin:
        yield path, f"{seconds(t_s)} must not be before {name}, {seconds(begin)}"
    elif t_s > scenario.mission.time_limit:
        limit = seconds(scenario.mission.time_limit)
        yield path, f"{seconds(t_s)} is after mission.time_limit, {limit}"


def _on_rail(scenario, path, t_s):
    """Complaint about something that is due while the vehicle still stands on its rail."""
    if scenario.launch is not None and scenario.vehicle.stages:
        ignition = next(iter(scenario.vehicle.stages.values())).ignition
        if 0.0 <= t_s <= ignition:
            yield path, f"{seconds(t_s)} must be later than the first ignition, {seconds(ignition)}"


def _burning(scenario, path, t_s):
    """Complaint about a device that is released while a motor burns."""
    for name, stage in scenario.vehicle.stages.items():
        burn_out = stage.ignition + thrust.burn_time(stage.motor)
        if stage.ignition <= t_s < burn_out - SAME_EVENT_S:
            yield path, f"{seconds(t_s)} is before the burn-out of {name}, {seconds(burn_out)}"


def _programme(scenario):
    """Tasks one after the other, within the flight, with what they need."""
    if scenario.ground is not None:
        return
    before, limit = None, scenario.mission.time_limit
    for name, task in scenario.tasks:
        path = ("programme", name)
        if task.end > limit and task.end > task.start:
            yield _too_long(scenario, name, task)  # the tasks after it would all say the same
            break
        yield from within(scenario, (*path, "from"), task.start)
        yield from _on_rail(scenario, (*path, "from"), task.start)
        if task.end <= task.start:
            words = f"{seconds(task.end)} must be later than from, {seconds(task.start)}"
            yield (*path, "until"), words
            continue
        yield from within(scenario, (*path, "until"), task.end)
        if before is not None and task.start < before[1]:
            words = f"{seconds(task.start)} is before the end of {before[0]}, {seconds(before[1])}"
            yield (*path, "from"), f"{words}; tasks must not overlap"
        before = (name, task.end)
        yield from _task(scenario, path, task)
    if scenario.programme and scenario.attitude == "flown" and scenario.vehicle.cold_gas is None:
        words = "is missing; tasks are flown by a cold-gas system (or write attitude: prescribed)"
        yield ("vehicle", "cold_gas"), words
    gas = scenario.vehicle.cold_gas
    if gas is not None and gas.bandwidth * gas.period > SAMPLED:
        words = (
            f"{gas.bandwidth:g} rad/s is too fast for valves that work every {1e3 * gas.period:g} ms; "
            f"at most {SAMPLED / gas.period:.3g} rad/s"
        )
        yield ("vehicle", "cold_gas", "bandwidth"), words


def _too_long(scenario, name, task):
    """Complaint about the first task that the flight has no time for, and how to shorten the programme."""
    limit = seconds(scenario.mission.time_limit)
    names = [other for other, _ in scenario.tasks]
    later = names[names.index(name) + 1 :]
    if task.start < scenario.mission.time_limit:
        words = f"{seconds(task.end)} is after mission.time_limit, {limit}"
        words += f"; for a shorter flight give {limit} here"
        more = f" and null for what comes after it ({', '.join(later)})" if later else ""
        return ("programme", name, "until"), f"{words}{more}; {PART}"
    words = (
        f"{seconds(task.start)} is not before mission.time_limit, {limit}; for a shorter flight give null for"
    )
    return ("programme", name, "from"), f"{words} {', '.join([name, *later])}; {PART}"


def _task(scenario, path, task):
    """What the kinds of tasks have of their own."""
    if task.task in ("turn", "align_velocity") and task.at is not None:
        if task.at < task.start:
            words = f"{seconds(task.at)} must not be before the task, which starts at {seconds(task.start)}"
            yield (*path, "at"), words
        else:
            yield from within(scenario, (*path, "at"), task.at)
    if task.task == "dwell":
        yield from _dwell(path, task)
    if task.task in IN_ORBIT and scenario.orbit is None:
        words = f"{task.task} is for a vehicle in orbit: the scenario has no section orbit"
        yield (*path, "task"), words
    elif task.task == "turn_with_orbit":
        yield from _fades(path, task)


def _dwell(path, task):
    """Rates that can be flown."""
    if task.ramp is None and (task.boresight_rate != 0.0 or task.cross_rate != 0.0):
        yield (*path, "ramp"), "is missing; rates must fade in and out, expected for example 'ramp: 5 s'"
    if task.cross_period is None and task.cross_rate != 0.0:
        yield (*path, "cross_period"), "is missing; cross_rate needs it, for example 'cross_period: 40 s'"
    yield from _fades(path, task)


def _fades(path, task):
    """Rates can fade in and out within the task."""
    length = task.end - task.start
    if task.ramp is not None and 2.0 * task.ramp > length:
        words = f"fading in and out takes {seconds(2.0 * task.ramp)}, the task lasts {seconds(length)} only"
        yield (*path, "ramp"), words


def _devices(scenario):
    """Devices that work within the flight."""
    vehicle = scenario.vehicle
    if scenario.ground is not None:
        return
    if vehicle.spin_motors is not None:
        path, motors = ("vehicle", "spin_motors"), vehicle.spin_motors
        late = motors.at <= scenario.mission.time_limit < motors.at + motors.duration
        yield from within(scenario, (*path, "at"), motors.at)
        if late:
            yield from within(scenario, (*path, "duration"), motors.at + motors.duration)
        if motors.torque == 0.0:
            yield (*path, "torque"), "must not be zero"
    if vehicle.yo_yo is not None:
        yield from within(scenario, ("vehicle", "yo_yo", "at"), vehicle.yo_yo.at)
        yield from _burning(scenario, ("vehicle", "yo_yo", "at"), vehicle.yo_yo.at)
    parachute = vehicle.parachute
    if parachute is not None and (parachute.height is None) == (parachute.at is None):
        words = "opens through a height or at a time; give exactly one of height and at"
        yield ("vehicle", "parachute"), words
    elif parachute is not None and parachute.at is not None:
        yield from within(scenario, ("vehicle", "parachute", "at"), parachute.at)
        yield from _burning(scenario, ("vehicle", "parachute", "at"), parachute.at)


PARTS = (air, _orbit, _ground, _programme, _devices)  # (path of the field, text for people) of each


def possible_events(scenario):
    """Names of all events that may happen; a flight need not have all of them."""
    if scenario.ground is not None:
        return []
    if scenario.trajectory is not None:
        return _of_trajectory(scenario.trajectory)
    names = ["lift_off", "rail_exit", "max_dynamic_pressure"] if scenario.launch is not None else []
    for number, stage in enumerate(scenario.vehicle.stages.values(), 1):
        if number > 1 or stage.ignition > 0.0 or scenario.orbit is not None:
            names.append(f"ignition_{number}")
        names.append(f"burn_out_{number}")
        if stage.separation is not None:
            names.append(f"separation_{number}")
    for name, _ in scenario.tasks:
        names += [f"{name}_start", f"{name}_end"]
    vehicle = scenario.vehicle
    devices = (
        (vehicle.spin_motors, ["spin_motors"]),
        (vehicle.yo_yo, ["yo_yo_release", "yo_yo_off"]),
        (vehicle.cold_gas, ["cold_gas_empty"]),
        (vehicle.parachute, ["parachute"]),
    )
    for device, of_device in devices:
        names += of_device if device is not None else []
    return [*names, *DOWN]


def _of_trajectory(given):
    """Events that a trajectory may show, or that a log says of it."""
    n = len(given.separations)
    names = [f"{what}_{k}" for k in range(1, n + 2) for what in ("ignition", "burn_out")]
    names += [f"separation_{k}" for k in range(1, n + 1)]
    told = ["rail_exit", "parachute"] if given.format == "log" else []
    return ["lift_off", "max_dynamic_pressure", *names, *told, *DOWN]
