"""The launcher's setting for a wished place of impact: Newton's method over flights of the simulator.

Unknown is the tilt of the rail from the vertical, as a vector to the north and to the east, which is smooth
where azimuth and elevation are not. The derivative is taken by two flights more and then kept up to date by
each flight (C. G. Broyden, A class of methods for solving nonlinear simultaneous equations, Mathematics of
Computation 19, 1965). A vehicle that steers by valves, or tumbles, does not land quite where a smooth
function would have it: the iteration ends within 5 m of the place, or else, with the best of its flights,
within a thousandth of the distance from the launcher.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign.impact.landing import ImpactError, land
from shefex_nav.geometry import wgs84

PROBE = math.radians(0.1)  # of the derivative
LONGEST = math.radians(5.0)  # of one step
STEEPEST = math.radians(45.0)  # tilt that the simulator's launcher has at most
NEAR_M, NEAR = 5.0, 1e-3  # of the place; and relative to its distance
MOST = 20  # flights


class Aimed(NamedTuple):
    """A setting of the launcher."""

    azimuth: float  # rad
    elevation: float  # rad
    miss: float  # m, of the flight with it
    flights: int  # that were flown


class _Range:
    """Flights with one setting after the other."""

    def __init__(self, scenario, place, seed, ground, body):
        self.scenario, self.seed, self.ground, self.body = scenario, seed, ground, body
        self.target, self.level = wgs84.ecef_from_geodetic(*place, ground), wgs84.dcm_en(*place)
        self.flights, self.best = 0, None  # (m, tilt)

    def miss(self, tilt):
        """(2,) m, where a flight with a tilt (2,) lands, north and east of the place."""
        self.flights += 1
        azimuth, elevation = _setting(tilt)
        there = self.scenario.launch.model_copy(update={"azimuth": azimuth, "elevation": elevation})
        tilted = self.scenario.model_copy(update={"launch": there})
        landings = land(tilted, self.seed, self.ground, paths=False).landings
        one = next((one for one in landings if one.body == (self.body or landings[0].body)), None)
        if one is None:
            known = ", ".join(one.body for one in landings)
            raise ImpactError(f"{self.body} is not followed to the ground; there is {known}")
        here = wgs84.ecef_from_geodetic(one.latitude, one.longitude, self.ground)
        off = ((here - self.target) @ self.level)[:2]
        if self.best is None or np.linalg.norm(off) < self.best[0]:
            self.best = float(np.linalg.norm(off)), tilt
        return off


def aim(scenario, latitude, longitude, seed, ground, body=None):
    """Setting with which a body lands at a place, rad: Aimed. ImpactError if there is none.

    body : name of a stage; None: what flies last
    """
    flown = _Range(scenario, (latitude, longitude), seed, ground, body)
    site = scenario.launch
    launcher = wgs84.ecef_from_geodetic(site.latitude, site.longitude, site.height)
    near = max(NEAR_M, NEAR * float(np.linalg.norm(flown.target - launcher)))
    _search(flown, _tilt(site))
    if flown.best[0] > near:
        raise ImpactError(
            f"no setting of the launcher was found: the best of {flown.flights} flights lands "
            f"{flown.best[0] / 1e3:.3g} km off; is the place within range? What tumbles lands by chance"
        )
    return Aimed(*_setting(flown.best[1]), flown.best[0], flown.flights)


def _search(flown, tilt):
    """Fly until one lands near, or for as long as it may take."""
    off = flown.miss(tilt)
    slope = np.column_stack([(flown.miss(tilt + step) - off) / PROBE for step in PROBE * np.eye(2)])
    while flown.best[0] > NEAR_M and flown.flights < MOST:
        step = -np.linalg.lstsq(slope, off, rcond=None)[0]
        step *= min(1.0, LONGEST / max(np.linalg.norm(step), 1e-12))
        while np.linalg.norm(tilt + step) >= STEEPEST:
            step *= 0.5
        moved = flown.miss(tilt + step)
        while np.linalg.norm(moved) > 2.0 * np.linalg.norm(off) and flown.flights < MOST:  # too far
            step *= 0.5
            moved = flown.miss(tilt + step)
        slope += np.outer(moved - off - slope @ step, step) / (step @ step)
        tilt, off = tilt + step, moved


def _tilt(launch):
    """(2,) rad, tilt to the north and to the east."""
    size = 0.5 * math.pi - launch.elevation
    return size * np.array([math.cos(launch.azimuth), math.sin(launch.azimuth)])


def _setting(tilt):
    """(azimuth, elevation), rad, of a tilt."""
    return math.atan2(tilt[1], tilt[0]) % (2.0 * math.pi), 0.5 * math.pi - float(np.linalg.norm(tilt))
