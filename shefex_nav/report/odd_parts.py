"""What no rocket has: parts outside the vehicle, grains too wide, propellant that weighs or gives too little.

Each value is possible by itself, so none is an error: a slipped unit or decimal point shows only beside the
others. In: a scenario. Stations are distances behind the nose tip; the vehicle ends at its last nozzle exit.
"""

import math

from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.scenario import thrust
from shefex_nav.scenario.vehicle import Grain

DENSITIES = 500.0, 3000.0  # kg/m^3; composite propellant has 1600 to 1900, black powder 1000
IMPULSES = 120.0, 320.0  # s, of grains in vacuum: below sugar, above the best composites in long nozzles
HIGHEST = 470.0  # s, of what is no grain and may be liquid: above hydrogen and oxygen
LARGEST_MARGIN = 15.0  # calibres; slender rockets with large fins come near ten
SLENDEREST = 60.0  # lengths over diameters; sounding rockets are below 40
BEYOND = 0.25  # vehicle lengths: so far outside a small normal force may put its centre of pressure
SLACK = 1.02  # of lengths and diameters, for rounded values
AREAS = 0.1, 10.0  # reference area over that of a circle of the reference diameter


def found(scenario):
    """(path in the scenario, text) of each; nothing of a vehicle that follows a given trajectory."""
    if scenario.trajectory is not None:
        return
    vehicle = scenario.vehicle
    for path, aero in _aerodynamics(vehicle):
        yield from _reference(path, aero)
    if not vehicle.stages:
        return
    end = max(stage.motor.exit_station for stage in vehicle.stages.values())
    width = max(aero.diameter for _, aero in _aerodynamics(vehicle))
    yield from _slender(vehicle, end, width)
    for name, stage in vehicle.stages.items():
        path = ("vehicle", "stages", name)
        yield from _grain((*path, "propellant"), stage, width)
        yield from _impulse((*path, "motor"), stage)
        yield from _inside(path, stage)
        yield from _inertia((*path, "dry"), stage.dry, end, width)
    yield from _inertia(("vehicle", "payload"), vehicle.payload, end, width)
    yield from _sensors(scenario, end, width)
    yield from _margins(vehicle, end)


def _aerodynamics(vehicle):
    """(path, coefficients) of every configuration that has some."""
    for name, stage in vehicle.stages.items():
        yield ("vehicle", "stages", name, "aerodynamics"), stage.aerodynamics
    if vehicle.payload.aerodynamics is not None:
        yield ("vehicle", "payload", "aerodynamics"), vehicle.payload.aerodynamics


def _reference(path, aero):
    """Reference area and diameter of one configuration."""
    circle = 0.25 * math.pi * aero.diameter**2
    if not AREAS[0] <= aero.area / circle <= AREAS[1]:
        words = f"{aero.area:.4g} m2 is {aero.area / circle:.3g} times the circle of the reference diameter, "
        yield (*path, "area"), f"{words}{aero.diameter:g} m; the coefficients count to both: check them"


def _slender(vehicle, end, width):
    """Length over diameter; nozzles in the order in which the stages are dropped."""
    before = None
    for name, stage in vehicle.stages.items():
        path, station = ("vehicle", "stages", name, "motor", "exit_station"), stage.motor.exit_station
        if station == end and end > SLENDEREST * width:
            words = f"{end:g} m makes a vehicle {end / width:.4g} times as long as its reference diameter, "
            yield path, f"{words}{width:g} m; sounding rockets have 10 to 40"
        if before is not None and station > SLACK * before[1]:
            words = f"{station:g} m is behind the nozzle exit of {before[0]}, {before[1]:g} m, which is "
            yield path, f"{words}dropped first; stages stand in the order in which they burn"
        before = name, station


def _grain(path, stage, width):
    """A hollow cylinder in the vehicle, and what it is made of."""
    grain = stage.propellant
    if not isinstance(grain, Grain):
        return
    if 2.0 * grain.outer_radius > SLACK * width:
        words = f"{grain.outer_radius:g} m makes a grain of {2.0 * grain.outer_radius:g} m across in a "
        yield (*path, "outer_radius"), f"{words}vehicle whose reference diameter is {width:g} m"
    section = math.pi * (grain.outer_radius**2 - grain.inner_radius**2)  # m^2
    density = grain.mass / (section * grain.length)
    if not DENSITIES[0] <= density <= DENSITIES[1]:
        words = f"{grain.mass:g} kg in the volume of the grain is a density of {density:.3g} kg/m3; solid "
        words += f"propellant has {DENSITIES[0]:.0f} to {DENSITIES[1]:.0f} kg/m3: "
        yield (*path, "mass"), f"{words}check mass, length and radii"


def impulse(stage):
    """Total impulse of a stage's motor in vacuum as it is flown, N s, and its specific impulse, s."""
    curve = thrust.vacuum_curve(stage.motor, stage.propellant.mass)
    total = thrust.area(curve.t_s, curve.thrust_n)
    return total, total / (stage.propellant.mass * STANDARD_GRAVITY)


def _impulse(path, stage):
    """Specific impulse of the propellant, whatever share of it a thrust factor takes."""
    total, speed = (value / stage.motor.thrust_factor for value in impulse(stage))
    is_grain = isinstance(stage.propellant, Grain)
    kind, most = ("solid propellant", IMPULSES[1]) if is_grain else ("propellant", HIGHEST)
    if IMPULSES[0] <= speed <= most:
        return
    limits = f"{kind} gives {IMPULSES[0]:.0f} to {most:.0f} s"
    if stage.motor.specific_impulse is not None:
        yield (*path, "specific_impulse"), f"{stage.motor.specific_impulse:g} s in vacuum: {limits}"
        return
    words = f"{total:.4g} N s in vacuum from {stage.propellant.mass:g} kg of propellant is a specific impulse"
    yield path, f"{words} of {speed:.4g} s; {limits}: check thrust, times, mass, exit_area and measured_at"


def _inside(path, stage):
    """Parts of a stage between the nose tip and its own nozzle exit."""
    end, grain = stage.motor.exit_station, stage.propellant
    where = f"behind the nozzle exit of its stage, {end:g} m"
    if stage.dry.station > SLACK * end:
        yield (*path, "dry", "station"), f"{stage.dry.station:g} m is {where}"
    if not isinstance(grain, Grain):
        rear = max(range(len(grain.table.station)), key=grain.table.station.__getitem__)
        if grain.table.station[rear] > SLACK * end:
            words = f"{grain.table.station[rear]:g} m is {where}"
            yield (*path, "propellant", "table", "station", rear), words
        return
    front, back = grain.station - 0.5 * grain.length, grain.station + 0.5 * grain.length
    reaches = f"a grain of {grain.length:g} m around {grain.station:g} m"
    if back > SLACK * end:
        yield (*path, "propellant", "station"), f"{reaches} ends at {back:.4g} m, {where}"
    if front < (1.0 - SLACK) * end:
        words = f"{reaches} begins {-front:.4g} m ahead of the nose tip"
        yield (*path, "propellant", "station"), words


def _inertia(path, part, end, width):
    """Moments of inertia that a mass inside the vehicle can have."""
    for key, most, limit in (
        ("inertia_roll", width, f"the whole reference diameter, {width:g} m"),
        ("inertia_pitch", 0.5 * end, f"half the length of the vehicle, {0.5 * end:.4g} m"),
    ):
        radius = math.sqrt(getattr(part, key) / part.mass)
        if radius > SLACK * most:
            words = f"{getattr(part, key):g} kg m2 of {part.mass:g} kg is a radius of gyration of "
            yield (*path, key), f"{words}{radius:.3g} m, more than {limit}"


def _sensors(scenario, end, width):
    """IMU, GPS antenna and devices inside the vehicle."""
    vehicle, gps = scenario.vehicle, scenario.gps
    imu = list(_outside("the IMU", vehicle.imu, end, width))
    yield from ((("vehicle", "imu"), words) for words in imu)
    if not imu:
        antenna = [a + b for a, b in zip(vehicle.imu, gps.antenna.lever_arm, strict=True)]
        for words in _outside("the antenna, this far from the IMU,", antenna, end, width):
            yield ("gps", "antenna", "lever_arm"), words
    gas, yo_yo = vehicle.cold_gas, vehicle.yo_yo
    if gas is not None and max(gas.arm) > SLACK * end:
        words = f"{max(gas.arm):g} m is more than the length of the vehicle, {end:g} m"
        yield ("vehicle", "cold_gas", "arm", gas.arm.index(max(gas.arm))), words
    if yo_yo is not None and yo_yo.radius > SLACK * width:
        words = f"{yo_yo.radius:g} m is more than the reference diameter, {width:g} m"
        yield ("vehicle", "yo_yo", "radius"), words


def _outside(what, place, end, width):
    """Words about a place, body axes from the nose tip (x to the nose), that is not in the vehicle."""
    station, aside = -place[0], math.hypot(*place[1:])
    if station < (1.0 - SLACK) * end:
        words = f"{what} is {-station:.4g} m ahead of the nose tip; body x points to the nose: what is "
        yield f"{words}behind the nose tip has a negative x"
    elif station > SLACK * end:
        yield f"{what} is {station:.4g} m behind the nose tip; the vehicle is {end:g} m long"
    if aside > SLACK * width:
        yield f"{what} is {aside:.4g} m off the roll axis; the reference diameter is {width:g} m"


def _margins(vehicle, end):
    """Centres of pressure near the vehicle, at most some calibres behind the centres of mass."""
    left = [vehicle.payload, *(stage.dry for stage in vehicle.stages.values())]
    left = [(part.mass, part.station) for part in left]
    stages = list(vehicle.stages.values())
    for k, (path, aero) in enumerate(_aerodynamics(vehicle)):
        row, inner = aero.pressure_station, ()
        if isinstance(row[0], list | tuple):
            row, inner = row[0], (0,)
        farthest = max(range(len(row)), key=lambda j: abs(row[j] - 0.5 * end))
        if not -BEYOND * end <= row[farthest] <= (1.0 + BEYOND) * end:
            words = f"a centre of pressure {row[farthest]:g} m behind the nose tip, at Mach "
            words += f"{aero.mach[farthest]:g}, is outside a vehicle of {end:g} m; in which unit is it?"
            yield (*path, "pressure_station", *inner, farthest), words
            continue
        above = [(one.propellant.mass, _full(one.propellant)) for one in stages[k + 1 :]]
        rest = [left[0], *left[1 + k :], *above]
        own = [(one.propellant.mass, _full(one.propellant)) for one in stages[k : k + 1]]
        full = _centre(rest + own)
        if k == 0 and stages and row[0] < full:
            margin = (row[0] - full) / aero.diameter
            words = f"the static margin at lift-off is {margin:.3g} calibres, so the rocket turns over; "
            words += f"behind the nose tip: centre of pressure {row[0]:g} m (Mach {aero.mach[0]:g}), "
            words += f"centre of mass {full:.4g} m"
            yield (*path, "pressure_station", *inner, 0), words
        centre = min(full, _centre(rest))  # m, at ignition, at burn-out
        rear = max(range(len(row)), key=row.__getitem__)
        margin = (row[rear] - centre) / aero.diameter
        if margin > LARGEST_MARGIN:
            words = f"the static margin reaches {margin:.4g} calibres: centre of pressure at {row[rear]:g} m "
            words += f"at Mach {aero.mach[rear]:g}, centre of mass at {centre:.4g} m; 1 to 3 are usual: "
            yield (*path, "pressure_station", *inner, rear), f"{words}check both, and the diameter"


def _full(propellant):
    """Station of the centre of mass of propellant before it burns, m."""
    return propellant.station if isinstance(propellant, Grain) else propellant.table.station[0]


def _centre(parts):
    """Centre of mass of (mass, station) of parts, m."""
    return sum(mass * station for mass, station in parts) / sum(mass for mass, _ in parts)
