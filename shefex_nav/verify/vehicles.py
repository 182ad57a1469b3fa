"""The atmospheric NESC check-cases that are flown, and their vehicles as the equations of motion fly them.

Source: NASA/TM-2015-218675 (NESC-RP-12-00770), Check-Cases for Verification of 6-Degree-of-Freedom Flight
Vehicle Simulations; for case 17 the notes that come with its models (version 2, 2014-03-30). The figures were
compared with the first rows of the published trajectories.

Case 17 is flown as its one published trajectory was, which departs from notes and models (`NOTES`). Each
departure is read off the trajectory: the velocity from its first row, the area from its aerodynamic force
over dynamic pressure, the moment from its aerodynamic moment less what the model gives.

In: DAVE-ML models of aerodynamics, inertia and propulsion. Out: a `Section` of the flight
per vehicle configuration.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.gravity import J2_WGS84
from shefex_nav.geometry import wgs84
from shefex_nav.verify.daveml import FOOT, DaveMlError, evaluate
from shefex_nav.world.flight.aerodynamics import AeroTables
from shefex_nav.world.flight.vehicle import Configuration

SPHERE, BRICK, ROCKET = "sphere", "brick", "rocket"
INERTIAL, EARTH = "inertial", "earth"  # what the initial rates are relative to
MODELS = {
    SPHERE: ("cannonball_inertia.dml", "cannonball_aero.dml"),
    BRICK: ("brick_inertia.dml", "brick_aero.dml"),
    ROCKET: ("twostage_inertia.dml", "twostage_aero.dml", "twostage_prop.dml"),
}
MASS_ROWS = 11  # of the mass table over the propellant left; the model is linear in it
ALPHA_STEP = math.radians(0.05)  # of the tables over the angle of attack, up to ALPHA_FINE
ALPHA_FINE = math.radians(24.0)
ALPHA_LAST = math.radians(176.0)  # C_N / sin(alpha) has no finite value at 180 deg


class Planet(NamedTuple):
    """The Earth of a case."""

    radius_m: float  # equatorial
    e2: float  # first eccentricity squared
    j2: float
    rate: float  # rad/s


class Case(NamedTuple):
    """A check-case; it starts on the equator at longitude zero."""

    title: str
    body: str
    drag: bool  # the drag of the aerodynamic model is flown
    damping: bool  # so are its damping moments
    planet: Planet
    height_m: float  # of the centre of mass
    velocity_n: tuple  # m/s, relative to the Earth: north, east, down
    yaw_pitch_roll: tuple  # deg, body against north, east, down
    rates: tuple  # deg/s about x, y, z
    rates_to: str  # INERTIAL or EARTH
    wind: tuple  # rows height m, north m/s, east m/s
    end_s: float


WGS84 = Planet(wgs84.A, wgs84.E2, J2_WGS84, wgs84.OMEGA)
AUTHALIC_RADIUS = 6371007.1809  # m, sphere of the area of the WGS 84 ellipsoid, NIMA TR8350.2
ROUND_AT_REST = Planet(AUTHALIC_RADIUS, 0.0, 0.0, 0.0)
ROUND = Planet(AUTHALIC_RADIUS, 0.0, 0.0, wgs84.OMEGA)

_HIGH = 30000.0 * FOOT
_REST = (0.0, 0.0, 0.0)
_TUMBLE = (10.0, 20.0, 30.0)
_LEVEL = (0.0, 0.0, 0.0)
_KILO = 1000.0 * FOOT
_STEADY = ((0.0, 0.0, 20.0 * FOOT), (_HIGH, 0.0, 20.0 * FOOT))  # from the west
_SHEAR = ((0.0, 0.0, -20.0 * FOOT), (_HIGH, 0.0, 70.0 * FOOT))  # linear in between

_DROP = Case("", SPHERE, False, False, WGS84, _HIGH, _REST, _LEVEL, _REST, INERTIAL, (), 30.0)
_THROWN = _DROP._replace(drag=True, height_m=0.0, rates_to=EARTH)
CASES = {
    "01": _DROP._replace(title="dragless sphere"),
    "02": _DROP._replace(title="tumbling brick, no damping", body=BRICK, rates=_TUMBLE),
    "03": _DROP._replace(title="tumbling brick, damping", body=BRICK, damping=True, rates=_TUMBLE),
    "04": _DROP._replace(title="sphere, round Earth at rest", drag=True, planet=ROUND_AT_REST, rates=_TUMBLE),
    "05": _DROP._replace(title="sphere, round rotating Earth", drag=True, planet=ROUND, rates=_TUMBLE),
    "06": _DROP._replace(title="sphere, ellipsoidal Earth", drag=True),
    "07": _DROP._replace(title="sphere in a steady wind", drag=True, wind=_STEADY),
    "08": _DROP._replace(title="sphere in a wind shear", drag=True, wind=_SHEAR),
    "09": _THROWN._replace(
        title="cannonball to the east", velocity_n=(0.0, _KILO, -_KILO), yaw_pitch_roll=(90.0, 0.0, 0.0)
    ),
    "10": _THROWN._replace(title="cannonball to the north", velocity_n=(_KILO, 0.0, -_KILO)),
    "17": _THROWN._replace(
        title="two-stage rocket to orbit",
        body=ROCKET,
        velocity_n=(0.0, 0.0, -0.1),
        yaw_pitch_roll=(90.0, 55.22, 0.0),
        end_s=200.0,
    ),
}
ROCKET_COAST_S = 96.79  # from the end of the first burn to staging, which lights the second stage
NOTES = {
    "17": (
        "starts with 0.1 m/s straight up, not 0.1 ft/s along the body x axis",
        "has the reference area of a circle of 3 m diameter, 7.069 m^2, not the 7 m^2 of its model",
        "has a moment of minus half the rate of the moments of inertia times the body rates, while a stage "
        "burns and on after the second burn",
    ),
}


class Section(NamedTuple):
    """A part of the flight with one configuration."""

    configuration: Configuration
    end_s: float
    growth: np.ndarray | None = None  # (3,) kg m^2/s, moment on the body per body rate; see `NOTES`


def sections(case, models):
    """Sections of the flight of a case. models: as `MODELS` names them, read."""
    if case.body == ROCKET:
        return _rocket(case, *models)
    inertia, aero = models
    tables = _sphere(aero, case.drag) if case.body == SPHERE else _brick(aero, case.damping)
    body = _configuration(_rigid(inertia), tables, imu=np.zeros(3))
    return (Section(body, case.end_s),)


def _configuration(mass, aero, *, imu, thrust=None, exhaust_speed=1.0):
    """Configuration without offsets, gas effects and devices, as the check-cases define their vehicles."""
    still = np.array([[0.0, 0.0, mass[0, 0]], [1.0, 0.0, mass[0, 0]]])
    never = math.inf
    return Configuration(
        mass=np.ascontiguousarray(mass),
        products=np.zeros(3),
        offset=np.zeros(2),
        thrust=still if thrust is None else thrust,
        exhaust_speed=float(exhaust_speed),
        exit_area=0.0,
        exit_station=0.0,
        thrust_axis=np.array([1.0, 0.0, 0.0]),
        thrust_offset=np.zeros(2),
        gas=0.0,
        imu=np.array(imu, dtype=float),
        aero=aero,
        spin_motors=np.zeros((0, 3)),
        yo_yo=np.array([never, never, 0.0, 1.0]),
        parachute=np.array([never, 0.0, 0.0, 0.0, 0.0]),
    )


def _rigid(inertia):
    """Mass table (2, 6) of a body that burns nothing, its centre of mass at station 0."""
    names = ("XMASS", "XIXX", "XIYY", "XIZZ")
    mass, i_x, i_y, i_z = (evaluate(inertia, name) for name in names)
    for name in ("XIXY", "XIZX", "XIYZ", "DXCG", "DYCG", "DZCG"):
        if evaluate(inertia, name) != 0.0:
            raise DaveMlError(f"{inertia.path}: {name} is not zero, which this body is flown with")
    return np.array([[0.0, mass, 0.0, i_x, i_y, i_z], [1.0, mass, 0.0, i_x, i_y, i_z]])


def _tables(area, diameter, *, drag=0.0, damping=(0.0, 0.0, 0.0)):
    """AeroTables of drag and damping alone, the same at every Mach number and angle of attack."""
    zeros, mach = np.zeros((2, 1)), np.array([0.0, 100.0])
    return AeroTables(
        area=area,
        diameter=diameter,
        fin_cant=0.0,
        moment_station=0.0,
        mach=mach,
        alpha=np.zeros(1),
        axial=zeros,
        normal=zeros.copy(),
        moment=zeros.copy(),
        drag=np.full((2, 1), float(drag)),
        damping=np.tile([*damping, 0.0], (2, 1)),
    )


def _sphere(aero, drag):
    coefficient = evaluate(aero, "totalCoefficientOfDrag") if drag else 0.0
    return _tables(evaluate(aero, "referenceWingArea"), 1.0, drag=coefficient)


def _brick(aero, damping):
    """Damping moments without drag: the definition of the case has none, whatever the model says.

    The model has one reference length for pitch and another one for roll and yaw; the tables know one. What
    a length enters twice (as arm, and in omega l/(2V)) is folded into the coefficient.
    """
    area, chord, span = (evaluate(aero, f"referenceWing{name}") for name in ("Area", "Chord", "Span"))
    if not damping:
        return _tables(area, chord)
    speed, rates = 100.0, {"PB": 0.0, "QB": 0.0, "RB": 0.0}  # ft/s; the coefficients go with rate/speed
    derivative = {}
    for rate in rates:
        for moment, length in (("Cl", span), ("Cm", chord), ("Cn", span)):
            coefficient = evaluate(aero, moment, VRW=speed, **(rates | {rate: 1.0}))
            derivative[moment, rate] = coefficient * length * 2.0 * speed * FOOT / chord**2
    kept = {("Cm", "QB"), ("Cn", "RB"), ("Cl", "PB")}
    if any(value != 0.0 for pair, value in derivative.items() if pair not in kept):
        raise DaveMlError(f"{aero.path}: damping across the axes, which is not flown")
    return _tables(
        area, chord, damping=(derivative["Cm", "QB"], derivative["Cn", "RB"], derivative["Cl", "PB"])
    )


def _rocket(case, inertia, aero, propulsion):
    """First burn, coast with the empty first stage, second burn, coast."""
    # the point that is integrated: the centre of mass of the coast, in which there still is air
    station = evaluate(inertia, "vrsPositionOfCM_X", **_flags(inertia, 1, evaluate(inertia, "stg1maxFuel")))
    first = _stage(inertia, aero, propulsion, station, number=1)
    end_1 = first.thrust[-1, 0]
    start_2 = end_1 + ROCKET_COAST_S
    second = _stage(inertia, aero, propulsion, station, number=2, start_s=start_2)
    end_2 = second.thrust[-1, 0]
    return (
        Section(first, end_1, _growth(first)),
        Section(_burnt_out(first), start_2),
        Section(second, end_2, _growth(second)),
        Section(_burnt_out(second), case.end_s, _growth(second)),
    )


def _growth(configuration):
    """Minus half the rate of the moments of inertia while the stage burns: (3,) kg m^2/s, positive."""
    empty, full = configuration.mass[0], configuration.mass[-1]
    flow = configuration.thrust[0, 1] / configuration.exhaust_speed
    return 0.5 * flow * (full[3:] - empty[3:]) / full[0]


def _burnt_out(configuration):
    still = configuration.thrust.copy()
    still[:, 1:] = 0.0
    return configuration._replace(thrust=still)


def _stage(inertia, aero, propulsion, station, *, number, start_s=0.0):
    """Configuration while stage 1 or 2 is the lowest one, its motor lit at start_s; state at a station."""
    firing = {"stg1firing": float(number == 1), "stg2firing": float(number == 2)}
    force, flow = (evaluate(propulsion, name, **firing) for name in ("thrust", "mdot"))
    full = evaluate(inertia, f"stg{number}maxFuel")
    left = np.linspace(0.0, full, MASS_ROWS)
    mass = np.array([[kg, *_mass(inertia, number, full - kg)] for kg in left])
    burn_s = full / flow
    thrust = np.array([[start_s, force, full], [start_s + burn_s, force, 0.0]])
    tables = _lifting(aero, evaluate(inertia, "vrsPositionOfMrc_X", **_flags(inertia, number, 0.0)))
    imu = np.array([-station, 0.0, 0.0])
    return _configuration(mass, tables, imu=imu, thrust=thrust, exhaust_speed=force / flow)


def _mass(inertia, number, used):
    """Mass kg, station of the centre of mass m, moments of inertia kg m^2, `used` kg burnt in this stage."""
    names = ("XMASS", "vrsPositionOfCM_X", "XIXX", "XIYY", "XIZZ")
    return [evaluate(inertia, name, **_flags(inertia, number, used)) for name in names]


def _flags(inertia, number, used):
    """Inputs of the model of inertia while stage `number` is the lowest one and `used` kg of it are burnt."""
    return {
        "stagedFlag": float(number == 2),
        "stg1fuelUsed": used if number == 1 else evaluate(inertia, "stg1maxFuel"),
        "stg2fuelUsed": used if number == 2 else 0.0,
    }


def _lifting(aero, moment_station):
    """AeroTables from lift, drag and pitching moment over the angle of attack.

    The model is symmetric about the roll axis as long as one of angle of attack and sideslip is zero, which
    the tables in the total angle of attack take to be so always; the flight has no sideslip. Lift and drag
    turned into body axes: C_A = C_D cos a - C_L sin a, C_N = C_L cos a + C_D sin a.
    """
    fine = np.arange(0.0, ALPHA_FINE, ALPHA_STEP)
    alpha = np.concatenate([fine, np.arange(ALPHA_FINE, ALPHA_LAST, math.radians(0.5)), [ALPHA_LAST]])
    at = [{"alpha": math.degrees(a), "beta": 0.0} for a in alpha]
    lift, drag, moment = (
        np.array([evaluate(aero, name, **inputs) for inputs in at])
        for name in ("totalCoefficientOfLift", "totalCoefficientOfDrag", "aeroBodyMomentCoefficient_Pitch")
    )
    sin, cos = np.sin(alpha), np.cos(alpha)
    with np.errstate(invalid="ignore"):
        normal, turning = (lift * cos + drag * sin) / sin, moment / sin
    normal[0] = drag[0] + lift[1] / alpha[1]  # limits at zero; the lift is a straight line there
    turning[0] = moment[1] / alpha[1]
    length = evaluate(aero, "cbar")
    if evaluate(aero, "bspan") != length:
        raise DaveMlError(f"{aero.path}: cbar and bspan differ; the tables know one length")
    twice = [np.tile(column, (2, 1)) for column in (drag * cos - lift * sin, normal, turning)]
    return AeroTables(
        area=0.25 * math.pi * length**2,  # see `NOTES`; the model has `sref` of 7 m^2
        diameter=length,
        fin_cant=0.0,
        moment_station=moment_station,
        mach=np.array([0.0, 100.0]),
        alpha=alpha,
        axial=twice[0],
        normal=twice[1],
        moment=twice[2],
        drag=np.zeros((2, alpha.size)),
        damping=np.zeros((2, 4)),
    )
