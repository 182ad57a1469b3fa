"""Contradictions about the vehicle: stages in their order, motors that can burn, tables that fit."""

import math
from itertools import pairwise

from shefex_nav.clock import SAME_EVENT_S
from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.scenario import thrust
from shefex_nav.scenario.checks_flight import earliest, increasing, seconds, within
from shefex_nav.scenario.vehicle import Grain, ShapedMotor, TabulatedPropellant

CLOSURE = 0.02  # between total impulse, propellant mass and specific impulse
RATED = 0.02  # between the propellant mass and that of the motor file
LEAST_DRAG = 1e-9  # below zero: rounding
IMPULSES = (
    20.0,
    500.0,
)  # s, specific impulse of a motor, from a bottle of water to well beyond solid propellant


def contradictions(scenario, rated):
    """(path of the field, text for people) of each; `rated` as `expand` returns it."""
    vehicle, faulty = scenario.vehicle, set()
    for name, stage in vehicle.stages.items():
        path = ("vehicle", "stages", name)
        found = [*_propellant(path, stage), *_motor(path, stage), *_rated(path, stage, rated)]
        faulty |= {name} if found else set()
        yield from found
        yield from _coefficients((*path, "aerodynamics"), stage.aerodynamics)
        yield from _spent((*path, "spent"), stage)
    if vehicle.payload.aerodynamics is not None:
        yield from _coefficients(("vehicle", "payload", "aerodynamics"), vehicle.payload.aerodynamics)
    if scenario.ground is not None:
        return
    yield from _payload(scenario)
    yield from _order(scenario)
    yield from _stations(vehicle)
    if scenario.launch is not None and not vehicle.stages:
        yield ("vehicle", "stages"), "is empty; a rocket on its rail needs a stage with a motor"
    elif scenario.launch is not None and next(iter(vehicle.stages)) not in faulty:
        yield from _lift_off(scenario)


def _stations(vehicle):
    """Nothing lies behind the last nozzle."""
    if not vehicle.stages:
        return
    end = max(stage.motor.exit_station for stage in vehicle.stages.values())
    places = {("payload", "station"): vehicle.payload.station}
    for name, stage in vehicle.stages.items():
        places["stages", name, "dry", "station"] = stage.dry.station
    if vehicle.parachute is not None:
        places["parachute", "station"] = vehicle.parachute.station
    for where, station in places.items():
        if station > end:
            yield ("vehicle", *where), f"{station:g} m is behind the last nozzle exit, {end:g} m"


def _payload(scenario):
    """Coefficients for what flies last."""
    stages = list(scenario.vehicle.stages.values())
    alone = not stages or stages[-1].separation is not None
    if alone and scenario.vehicle.payload.aerodynamics is None:
        words = (
            "is missing; the payload flies alone where no stage stays attached, and needs its coefficients"
        )
        yield ("vehicle", "payload", "aerodynamics"), words


def _order(scenario):
    """Each stage burns when those below are gone, burns out before it is dropped, all within the flight."""
    before = None
    for name, stage in scenario.vehicle.stages.items():
        path, drop = ("vehicle", "stages", name), stage.separation
        yield from within(scenario, (*path, "ignition"), stage.ignition)
        burn_out = stage.ignition + thrust.burn_time(stage.motor)
        if earliest(scenario)[0] <= stage.ignition <= scenario.mission.time_limit < burn_out:
            limit = seconds(scenario.mission.time_limit)
            yield (
                (*path, "ignition"),
                f"the motor burns until {seconds(burn_out)}, past mission.time_limit, {limit}",
            )
        if drop is not None and drop.at < burn_out - SAME_EVENT_S:
            words = f"{seconds(drop.at)} is before the burn-out of its motor, {seconds(burn_out)}"
            yield (*path, "separation", "at"), words
        elif drop is not None:
            yield from within(scenario, (*path, "separation", "at"), drop.at)
        if before is not None:
            yield from _above(path, stage, before)
        before = (name, stage)


def _above(path, stage, before):
    """A stage and the one below it, (name, stage)."""
    name, below = before
    if below.separation is None:
        words = (
            f"the stage below, {name}, stays attached to it; give {name} a separation before this ignition"
        )
        yield (*path, "ignition"), words
    elif stage.ignition < below.separation.at:
        words = f"{seconds(stage.ignition)} is before the separation of {name} below it"
        words = f"{words}, {seconds(below.separation.at)}; stages stand in the order in which they burn"
        yield (*path, "ignition"), words


def _propellant(path, stage):
    """Grains the right way round, tables from full to empty."""
    path, grain = (*path, "propellant"), stage.propellant
    if isinstance(grain, Grain) and grain.inner_radius >= grain.outer_radius:
        words = f"{grain.inner_radius:g} m must be smaller than outer_radius, {grain.outer_radius:g} m"
        yield (*path, "inner_radius"), words
    if isinstance(grain, TabulatedPropellant):
        table, path = grain.table, (*path, "table")
        for name in ("station", "inertia_roll", "inertia_pitch"):
            values = getattr(table, name)
            if len(values) != len(table.burnt):
                words = f"{len(values)} values for {len(table.burnt)} shares burnt; give one for each"
                yield (*path, name), words
        yield from increasing((*path, "burnt"), table.burnt, "shares", "%", 100.0)
        for index, end in ((0, 0.0), (len(table.burnt) - 1, 1.0)):
            if abs(table.burnt[index] - end) > 1e-9:
                words = f"the table must go from 0 % to 100 %, here it has {100.0 * table.burnt[index]:g} %"
                yield (*path, "burnt", index), words


def _motor(path, stage):
    """Thrust that makes a curve, and an impulse that fits the propellant."""
    path, motor = (*path, "motor"), stage.motor
    if isinstance(motor, ShapedMotor):
        if motor.rise + motor.tail_off >= motor.burn_time:
            words = f"{seconds(motor.burn_time)} must be longer than rise and tail_off together"
            yield (*path, "burn_time"), words
        return
    time, force = motor.thrust.time, motor.thrust.force
    found = list(_curve((*path, "thrust"), time, force))
    yield from found
    if found:
        return
    mass, impulse = stage.propellant.mass, thrust.area(time, thrust.vacuum_force(motor))
    speed = impulse / (mass * STANDARD_GRAVITY)  # s
    said = f"the thrust curve has {impulse:.5g} N s in vacuum, which from {mass:g} kg is {speed:.4g} s"
    if motor.specific_impulse is None:
        if not IMPULSES[0] <= speed <= IMPULSES[1]:
            limits = f"{IMPULSES[0]:g} to {IMPULSES[1]:g} s"
            words = f"{said} of specific impulse, not {limits} as of any motor; check both"
            yield ("vehicle", "stages", path[2], "propellant", "mass"), words
    elif abs(speed / motor.specific_impulse - 1.0) > CLOSURE:
        words = f"{motor.specific_impulse:g} s does not agree within 2 %: {said}; leave it out to take that"
        yield (*path, "specific_impulse"), words


def _curve(path, time, force):
    """A thrust curve that starts at ignition and ends with zero."""
    if len(force) != len(time):
        yield (*path, "force"), f"{len(force)} values for {len(time)} times; give one for each"
        return
    yield from increasing((*path, "time"), time, "times", "s")
    if time[0] != 0.0:
        yield (*path, "time", 0), f"the curve must start at ignition, 0 s, not at {seconds(time[0])}"
    if max(force) == 0.0:
        yield (*path, "force"), "must not be zero throughout"
    elif force[-1] != 0.0:
        yield (*path, "force", len(force) - 1), f"the thrust must end with 0 N, not with {force[-1]:g} N"


def _rated(path, stage, rated):
    """Propellant mass against that of the motor file."""
    if path not in rated:
        return
    mass, file = stage.propellant.mass, rated[path]
    if abs(mass / file.mass - 1.0) > RATED:
        words = f"{mass:g} kg does not agree within 2 % with {file.mass:g} kg in the header of the motor file"
        yield (*path, "propellant", "mass"), f"{words}, {file.mark.file}:{file.mark.line}"


def _spent(path, stage):
    """Drag of a stage that is dropped."""
    if stage.spent is None:
        return
    if stage.separation is None:
        yield path, "the stage has no separation: it stays attached and never falls alone; write spent: null"
    yield from increasing((*path, "mach"), stage.spent.mach, "Mach numbers", "")
    yield from _columns(path, "mach", len(stage.spent.mach), {("drag",): stage.spent.drag})


def _coefficients(path, aero):
    """Columns of one length over increasing Mach numbers and angles; cant only where it does something."""
    yield from increasing((*path, "mach"), aero.mach, "Mach numbers", "")
    if aero.damping_mach is not None:
        yield from increasing((*path, "damping_mach"), aero.damping_mach, "Mach numbers", "")
    wrong = list(_lengths(path, aero))
    yield from wrong or _pushed(path, aero)
    angles = aero.angle_of_attack
    if angles is not None:
        yield from increasing((*path, "angle_of_attack"), angles, "angles", "deg", 180.0 / math.pi)
        if angles[0] != 0.0:
            words = f"the angles must start at 0 deg, not at {math.degrees(angles[0]):g} deg"
            yield (*path, "angle_of_attack", 0), words
    if aero.fin_cant != 0.0 and not any(aero.roll_by_cant or ()):
        words = (
            "there are no fins that it could turn: roll_by_cant is zero or missing; give it, or 0 deg here"
        )
        yield (*path, "fin_cant"), words


def _pushed(path, aero):
    """The first place of the tables where the air would push a body along its velocity, not brake it."""
    one = aero.angle_of_attack is None
    axial, normal = (([rows] if one else rows) for rows in (aero.axial, aero.normal_slope))
    drag = [[0.0] * len(aero.mach)] * len(axial) if aero.drag is None else [aero.drag] if one else aero.drag
    for k, angle in enumerate(aero.angle_of_attack or [0.0]):
        for j, mach in enumerate(aero.mach):
            braked = axial[k][j] * math.cos(angle) + normal[k][j] * math.sin(angle) ** 2 + drag[k][j]
            if braked < -LEAST_DRAG:
                words = f"{axial[k][j]:g} at Mach {mach:g} and {math.degrees(angle):g} deg makes a drag "
                words += f"coefficient of {braked:.3g}: the air would push the vehicle along"
                words += "; tail first, beyond 90 deg, the axial force is negative" * (angle > 0.5 * math.pi)
                yield (*path, "axial", *(() if one else (k,)), j), words
                return


def _lengths(path, aero):
    """One value for each Mach number, in each column and for each angle of attack."""
    n, k = len(aero.mach), len(aero.angle_of_attack or ())
    columns = {name: getattr(aero, name) for name in ("axial", "normal_slope", "pressure_station", "drag")}
    columns = {name: values for name, values in columns.items() if values is not None}
    plain = {name: values for name, values in columns.items() if not (values and isinstance(values[0], list))}
    wrong = list(columns.keys() - plain.keys()) if k == 0 else list(plain)
    if wrong:
        words = (
            "lists of lists are for several angles of attack, and angle_of_attack is not given"
            if k == 0
            else f"expected {k} lists, one for each angle of attack, of {n} values"
        )
        yield (*path, min(wrong)), words
        return
    rows = {(name,): values for name, values in columns.items()} if k == 0 else {}
    for name, values in columns.items() if k else ():
        if len(values) != k:
            yield (*path, name), f"{len(values)} lists for {k} angles of attack; give one for each"
        rows |= {(name, i): row for i, row in enumerate(values)}
    damping = {
        (name,): values
        for name in ("pitch_damping", "roll_damping", "roll_by_cant")
        if (values := getattr(aero, name)) is not None
    }
    if aero.damping_mach is None:
        rows |= damping
    else:
        yield from _columns(path, "damping_mach", len(aero.damping_mach), damping)
    yield from _columns(path, "mach", n, rows)


def _columns(path, name, n, rows):
    """Rows that have not n values; if none has and all agree, the Mach numbers are what is wrong."""
    odd = {where: len(values) for where, values in rows.items() if len(values) != n}
    if len(odd) > 1 and len(odd) == len(rows) and len(set(odd.values())) == 1:
        words = f"{n} Mach numbers, but {next(iter(odd.values()))} values in every other column"
        yield (*path, name), words
        return
    for where, length in odd.items():
        yield (*path, *where), f"{length} values for {n} Mach numbers; give one for each"


def _lift_off(scenario):
    """Thrust at the height of the rail within a second after ignition, against the weight along the rail."""
    launch, vehicle = scenario.launch, scenario.vehicle
    name, stage = next(iter(vehicle.stages.items()))
    curve = thrust.vacuum_curve(stage.motor, stage.propellant.mass)
    pressure = thrust.SEA_LEVEL * (1.0 - 2.25577e-5 * launch.height) ** 5.25588  # Pa, US76 below 11 km
    force = _highest(curve, 1.0) - pressure * stage.motor.exit_area
    mass = vehicle.payload.mass
    mass += sum(part.dry.mass + part.propellant.mass for part in vehicle.stages.values())
    weight = mass * _gravity(launch) * math.sin(launch.elevation)
    if force <= weight:
        words = (
            f"{name} gives {_newtons(force)} on the rail within a second after ignition, the weight along "
            f"the rail is {_newtons(weight)}; the vehicle would not lift off"
        )
        if (later_s := _reaches(curve, weight + pressure * stage.motor.exit_area)) is not None:
            words += (
                f" before {later_s:.3g} s, and lift-off counts from ignition: the thrust must rise faster"
            )
        yield ("vehicle", "stages", name, "motor"), words


def _gravity(launch):
    """m/s^2 at the launch site: Somigliana's formula for WGS 84 (NIMA TR8350.2), less with the height.

    Written out here because checking a scenario must not wait for the compiled kernels of the environment.
    """
    sine2 = math.sin(launch.latitude) ** 2
    on_ellipsoid = 9.7803253359 * (1.0 + 0.00193185265241 * sine2) / math.sqrt(1.0 - 0.00669437999014 * sine2)
    return on_ellipsoid - 3.086e-6 * launch.height


def _highest(curve, until_s):
    """Largest thrust of a Curve in its first until_s seconds."""
    highest = 0.0
    for (t_a, a), (t_b, b) in pairwise(zip(curve.t_s, curve.thrust_n, strict=True)):
        if t_a > until_s:
            break
        part = min(1.0, (until_s - t_a) / (t_b - t_a))
        highest = max(highest, a, a + part * (b - a))
    return highest


def _reaches(curve, force):
    """When the thrust of a Curve exceeds a force, s since ignition; None: it never does."""
    for (t_a, a), (t_b, b) in pairwise(zip(curve.t_s, curve.thrust_n, strict=True)):
        if b > force >= a:
            return t_a + (t_b - t_a) * (force - a) / (b - a)
    return None


def _newtons(force):
    return f"{1e-3 * force:.0f} kN" if force >= 1e5 else f"{force:.4g} N"
