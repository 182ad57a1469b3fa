"""Which events of a flight `rare` knows: a quantity of the rocket or of a body that lands, and a limit."""

import re
from typing import NamedTuple

import numpy as np

from shefex_nav import prepare
from shefex_nav.campaign.impact.landing import of_body
from shefex_nav.errors import UserError
from shefex_nav.report import requirements, track, vehicle


class RareError(UserError):
    """A probability that cannot be asked for; the message says why."""


class Quantity(NamedTuple):
    """What can be asked for."""

    figure: object  # function of a Problem, the scenario and the Flight or Landed, SI; None: it has none
    unit: str  # SI
    shown: str  # unit for people
    factor: float  # from SI to that
    lands: bool  # whether bodies have to be followed to the ground
    words: str


class Event(NamedTuple):
    """What is asked."""

    name: str  # of QUANTITIES
    sign: int  # 1: greater than the limit, -1: less
    limit: float  # SI


def _apogee(problem, scenario, flight):
    return next((event.altitude_m for event in flight.events if event.name == "apogee"), None)


def _rail_exit_speed(problem, scenario, flight):
    if vehicle.at(flight, "rail_exit") is None:
        return None
    return vehicle.rail_exit_speed(flight, prepare.earth_rotation(scenario))


def _dynamic_pressure(problem, scenario, flight):
    top_s = vehicle.at(flight, "apogee")
    rows = flight.trajectory.t_s <= (np.inf if top_s is None else top_s)
    return float(flight.trajectory.dynamic_pressure_pa[rows].max())


def _range(problem, scenario, landed):
    site, one = scenario.launch, of_body(landed.landings, problem.body)
    if one is None:
        return None
    return track.ground_distance(site.latitude, site.longitude, one.latitude, one.longitude)


def _off(problem, scenario, landed):
    one = of_body(landed.landings, problem.body)
    return None if one is None else track.ground_distance(*problem.place, one.latitude, one.longitude)


def _impact_speed(problem, scenario, landed):
    one = of_body(landed.landings, problem.body)
    return None if one is None else one.speed


QUANTITIES = {
    "apogee": Quantity(_apogee, "m", "km", 1e-3, False, "height above the ellipsoid"),
    "rail_exit_speed": Quantity(_rail_exit_speed, "m/s", "m/s", 1.0, False, "relative to the Earth"),
    "dynamic_pressure": Quantity(
        _dynamic_pressure, "Pa", "kPa", 1e-3, False, "the largest before the apogee"
    ),
    "range": Quantity(_range, "m", "km", 1e-3, True, "from the launcher to where the body lands"),
    "off": Quantity(_off, "m", "km", 1e-3, True, "from the nominal impact, or a place, to where it lands"),
    "impact_speed": Quantity(_impact_speed, "m/s", "m/s", 1.0, True, "relative to the Earth"),
}


def parsed(text, scenario, read):
    """Event of `apogee < 150 km`, or of a name alone whose limit stands in the scenario's requirements.

    read : function of a text and of an SI unit, the value;  RareError
    """
    found = re.fullmatch(r"\s*([a-z_]+)\s*(?:([<>])(?!=)\s*(.*\S))?\s*", text)
    if found is None or found[1] not in QUANTITIES:
        names = ", ".join(QUANTITIES)
        raise RareError(f"{text!r}: expected such as 'apogee < 150 km'; there is {names}")
    name, sign, limit = found.groups()
    if sign is not None:
        value = read(limit, QUANTITIES[name].unit)
        if value <= 0.0:
            raise RareError(f"{name}: got a limit of {limit}, expected one above 0")
        return Event(name, 1 if sign == ">" else -1, value)
    required = getattr(scenario.requirements, name, None) if name in requirements.MEASURES else None
    if required is None:
        unit = QUANTITIES[name].shown
        raise RareError(
            f"{name}: has no limit in requirements.{name}; expected such as '{name} < 150 {unit}'"
        )
    least = requirements.MEASURES[name].word == "at least"
    return Event(name, -1 if least else 1, required)
