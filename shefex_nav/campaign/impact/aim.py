"""The launcher's setting for a wished place of impact: Newton's method over flights of the simulator.

Unknown is the tilt of the rail from the vertical, as a vector to the north and to the east, which is smooth
where azimuth and elevation are not. The derivative is taken by two flights more and then kept up to date by
each flight (C. G. Broyden, A class of methods for solving nonlinear simultaneous equations, Mathematics of
Computation 19, 1965). A vehicle that steers by valves, or tumbles, does not land quite where a smooth
function would have it: the iteration ends within 5 m of the place, or else, with the best of its flights,
within a thousandth of the distance from the launcher. Trials stay within the tilt that a launcher may
have; one that cannot be flown is taken back by half a step.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign.impact.landing import ImpactError, followed, land, of_body
from shefex_nav.geometry import wgs84
from shefex_nav.world.flight.timeline import FlightError

PROBE = math.radians(0.1)  # of the derivative
LONGEST = math.radians(5.0)  # of one step
STEEPEST = math.radians(45.0) - 1e-9  # of a tilt: a launcher has 45 deg at most
SHORTEST = 1e-6  # rad, of one step: 0.1 m in 100 km
NEAR_M, NEAR = 5.0, 1e-3  # of the place; and relative to its distance
MOST = 20  # flights


class Aimed(NamedTuple):
    """A setting of the launcher."""

    azimuth: float  # rad
    elevation: float  # rad
    miss: float  # m, of the flight with it
    flights: int  # that were flown


class TrialError(ImpactError):
    """A setting that was tried cannot be flown; the message says which one and why."""


class _Range:
    """Flights with one setting after the other."""

    def __init__(self, scenario, place, seed, ground, body):
        self.scenario, self.seed, self.ground, self.body = scenario, seed, ground, body
        self.target, self.level = wgs84.ecef_from_geodetic(*place, ground), wgs84.dcm_en(*place)
        self.flights, self.best = 0, None  # (m, tilt)

    def miss(self, tilt):
        """(2,) m, where a flight with a tilt (2,) lands, north and east of the place. TrialError"""
        self.flights += 1
        azimuth, elevation = _setting(tilt)
        there = self.scenario.launch.model_copy(update={"azimuth": azimuth, "elevation": elevation})
        tilted = self.scenario.with_sections(launch=there)
        try:
            landings = land(tilted, self.seed, self.ground, paths=False).landings
        except (FlightError, ImpactError) as error:
            words = f"in search of the launcher's setting, {_words(azimuth, elevation)}: {error}"
            raise TrialError(words) from None
        one = of_body(landings, self.body)
        if one is None:
            raise TrialError(f"{self.body} does not come off with {_words(azimuth, elevation)}")
        here = wgs84.ecef_from_geodetic(one.latitude, one.longitude, self.ground)
        off = ((here - self.target) @ self.level)[:2]
        if self.best is None or np.linalg.norm(off) < self.best[0]:
            self.best = float(np.linalg.norm(off)), tilt
        return off


def check(scenario, body):
    """Refuse a body that is not followed to the ground. body : name, or None"""
    known = followed(scenario)
    if body is not None and body not in known:
        raise ImpactError(f"{body} is not followed to the ground; there is {', '.join(known)}")


def aim(scenario, latitude, longitude, seed, ground, body=None):
    """Setting with which a body lands at a place, rad: Aimed. ImpactError if there is none.

    body : name of a stage; None: what flies last
    """
    check(scenario, body)
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
    tilt = _clipped(tilt)
    off = flown.miss(tilt)
    slope = np.column_stack([_derivative(flown, tilt, off, step) for step in PROBE * np.eye(2)])
    while flown.best[0] > NEAR_M and flown.flights < MOST:
        step = -np.linalg.lstsq(slope, off, rcond=None)[0]
        step *= min(1.0, LONGEST / max(np.linalg.norm(step), 1e-12))
        step, moved = _shortened(flown, tilt, off, _clipped(tilt + step) - tilt)
        if moved is None:
            return
        slope += np.outer(moved - off - slope @ step, step) / (step @ step)
        tilt, off = tilt + step, moved


def _shortened(flown, tilt, off, step):
    """(step, its miss) of the first of halved steps that does not go too far; miss None: there is none.

    A step shorter than SHORTEST is none: what scatters more than it moves says nothing of the slope.
    """
    while np.linalg.norm(step) >= SHORTEST and flown.flights < MOST:
        moved = _tried(flown, tilt + step)
        if moved is not None and np.linalg.norm(moved) <= 2.0 * np.linalg.norm(off):
            return step, moved
        step = 0.5 * step
    return step, None


def _derivative(flown, tilt, off, step):
    """(2,) m/rad along a step, or against it where the launcher, or the flight, does not go so far."""
    if np.linalg.norm(tilt + step) > STEEPEST:
        step = -step
    moved = _tried(flown, tilt + step)
    if moved is None:
        step = -step
        moved = flown.miss(tilt + step)
    return (moved - off) / step.sum()


def _tried(flown, tilt):
    """(2,) m as of `miss`; None if it cannot be flown."""
    try:
        return flown.miss(tilt)
    except TrialError:
        return None


def _clipped(tilt):
    """A tilt (2,) within what the launcher has."""
    return tilt * min(1.0, STEEPEST / max(np.linalg.norm(tilt), 1e-12))


def _tilt(launch):
    """(2,) rad, tilt to the north and to the east."""
    size = 0.5 * math.pi - launch.elevation
    return size * np.array([math.cos(launch.azimuth), math.sin(launch.azimuth)])


def _setting(tilt):
    """(azimuth, elevation), rad, of a tilt."""
    return math.atan2(tilt[1], tilt[0]) % (2.0 * math.pi), 0.5 * math.pi - float(np.linalg.norm(tilt))


def _words(azimuth, elevation):
    return f"azimuth {math.degrees(azimuth):.3f} deg, elevation {math.degrees(elevation):.3f} deg"
