"""Definitions of the atmospheric NESC check-cases that are flown: what flies, over which Earth, from where.

Source: NASA/TM-2015-218675 (NESC-RP-12-00770), Check-Cases for Verification of 6-Degree-of-Freedom Flight
Vehicle Simulations; for case 17 the notes that come with its models (version 2, 2014-03-30). The figures were
compared with the first rows of the published trajectories.

Case 17 is flown as its one published trajectory was, which departs from notes and models (`NOTES`). Each
departure is read off the trajectory: the velocity from its first row, the area from its aerodynamic force
over dynamic pressure, the moment from its aerodynamic moment less what the model gives.
"""

from typing import NamedTuple

from shefex_nav.environment.gravity import J2_WGS84
from shefex_nav.geometry import wgs84
from shefex_nav.verify.daveml import FOOT

SPHERE, BRICK, ROCKET = "sphere", "brick", "rocket"
INERTIAL, EARTH = "inertial", "earth"  # what the initial rates are relative to


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
