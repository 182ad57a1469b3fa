"""One flight to the ground: what flies last by the simulator, each dropped stage as a body that falls.

In: a Scenario and the height of the ground. Out: `Landing`s and paths. A stage is followed if the scenario
says how it is braked (`vehicle.stages.NAME.spent`); of another one its name is told.

The instantaneous impact point is where the vehicle would land if its motor stopped now. Two of them: in a
vacuum, and with the drag of the vehicle as it is now, nose first, in the air and wind of the scenario.
Neither knows a parachute, nor how a vehicle tumbles.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav import prepare
from shefex_nav.clock import SAME_S
from shefex_nav.errors import UserError
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.scenario import params
from shefex_nav.world.flight import ballistic, fly, start, surroundings
from shefex_nav.world.flight import params as p

PATH_S = 1.0  # s between points of a path
LOWEST = -500.0  # m above the ellipsoid
FALL_STEP_S = -0.2  # fixed steps: a few mm on the ground in place of a tenth of the time
BURNING_S, COASTING_S = 1.0, 10.0  # s from one point to the next


class ImpactError(UserError):
    """Where it lands cannot be said; the message says why."""


class Landing(NamedTuple):
    """Where and how a body meets the ground."""

    body: str
    t_s: float
    latitude: float  # rad, geodetic
    longitude: float  # rad
    speed: float  # m/s, relative to the Earth
    angle: float  # rad, of the velocity below the horizon


class Path(NamedTuple):
    """The way of a body from its separation, or lift-off, to the ground: n points."""

    body: str
    t_s: np.ndarray  # (n,)
    r_e: np.ndarray  # (n, 3) m


class Landed(NamedTuple):
    """A flight with all that comes down of it."""

    flight: object  # fly.Flight
    world: surroundings.World
    landings: tuple  # of Landing: what flies last, then the stages in the order of their separation
    paths: tuple  # of Path, likewise
    unknown: tuple  # names of dropped stages whose drag is not described


def check(scenario, ground):
    """Refuse what does not land, or on no ground there is. ground : m above the ellipsoid"""
    if scenario.launch is None:
        raise ImpactError(
            f"{scenario.mission.name} has no section launch: only a rocket that is launched lands"
        )
    if not LOWEST <= ground <= 9000.0:
        raise ImpactError(f"a ground at {ground:g} m is none of this Earth; expected {LOWEST:g} to 9000 m")


def last_one(scenario):
    """Name of what flies last."""
    stays = [name for name, stage in scenario.vehicle.stages.items() if stage.separation is None]
    return " + ".join(["payload", *reversed(stays)])


def followed(scenario):
    """Names of what is followed to the ground: what flies last, then the stages whose drag is described."""
    stages = scenario.vehicle.stages.items()
    return last_one(scenario), *(
        name for name, one in stages if one.separation is not None and one.spent is not None
    )


def land(scenario, seed, ground, *, paths=True):
    """Fly a scenario and follow everything to the ground: Landed. FlightError as of a run.

    ground : m above the ellipsoid;  paths : whether they are wanted
    """
    given, earth = params.flight_params(scenario), prepare.earth_rotation(scenario)
    world, _ = start.surround(given, earth)
    flight = prepare.fly_vehicle(scenario, seed)
    landings, ways, unknown = [], [], []
    name = last_one(scenario)
    landings.append(last_landing(name, flight.trajectory, world, ground))
    if paths:
        ways.append(_path(name, flight.trajectory, earth))
    for one in flight.dropped:
        stage = given.stages[one.stage]
        if stage.spent is None:
            unknown.append(stage.name)
            continue
        body = ballistic.Body(stage.dry.mass, stage.spent)
        fall = ballistic.fall(world, body, one.t_s, one.r_i, one.v_i, ground=ground)
        if fall is None:
            raise ImpactError(f"{stage.name} is dropped below the ground, {ground:g} m above the ellipsoid")
        landings.append(landing_of(stage.name, earth, *fall.landing))
        if paths:
            ways.append(Path(stage.name, fall.t_s, _fixed(earth, fall.t_s, fall.r_i)))
    return Landed(flight, world, tuple(landings), tuple(ways), tuple(unknown))


def of_body(landings, body):
    """Landing of a body, None: of what flies last; None if it does not come off."""
    return next((one for one in landings if one.body == (body or landings[0].body)), None)


def place(latitude, longitude):
    """A place [rad] in degrees, for JSON."""
    return {"latitude_deg": math.degrees(latitude), "longitude_deg": math.degrees(longitude)}


def _fixed(earth, t_s, r_i):
    """Places (n, 3) m in frame e."""
    return np.array([frames.dcm_ie(earth, t).T @ r for t, r in zip(t_s, r_i, strict=True)])


def _path(name, trajectory, earth):
    every = max(1, round(PATH_S / (trajectory.t_s[1] - trajectory.t_s[0])))
    first = int(np.searchsorted(trajectory.t_s, 0.0))
    rows = np.unique([*range(first, len(trajectory.t_s), every), len(trajectory.t_s) - 1])
    return Path(name, trajectory.t_s[rows], _fixed(earth, trajectory.t_s[rows], trajectory.r_i[rows]))


def landing_of(name, earth, t_s, r_i, v_i):
    """Landing of a state on the ground, frame i."""
    r_e, v_e = frames.ecef_from_inertial(earth, t_s, r_i, v_i)
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    down = float((wgs84.dcm_en(latitude, longitude).T @ v_e)[2])
    speed = float(np.linalg.norm(v_e))
    angle = float(np.arcsin(np.clip(down / speed, -1.0, 1.0)))
    return Landing(name, float(t_s), float(latitude), float(longitude), speed, angle)


def last_landing(name, trajectory, world, ground):
    """Landing of what the simulator flies, by its IMU: where it comes down through the ground last.

    The samples are 2.5 ms apart; between them, and below the ellipsoid where the simulator ends, it goes on
    along its velocity.
    """
    t_s, earth = trajectory.t_s, world.earth

    def height(k):
        return surroundings.height(world.shape, frames.dcm_ie(earth, t_s[k]).T @ trajectory.r_i[k])

    low, high = _highest(trajectory), len(t_s) - 1  # above the ground, and perhaps not
    if height(low) <= ground:
        raise ImpactError(f"the flight never rises above the ground, {ground:g} m above the ellipsoid")
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if height(middle) > ground else (low, middle)
    low = high if height(high) > ground else low
    r_e, v_e = frames.ecef_from_inertial(earth, t_s[low], trajectory.r_i[low], trajectory.v_i[low])
    since = ballistic.along(world.shape, r_e, v_e, ground)
    state = frames.inertial_from_ecef(earth, t_s[low] + since, r_e + since * v_e, v_e)
    return landing_of(name, earth, t_s[low] + since, *state)


def _highest(trajectory):
    """Number of the sample farthest from the centre of the Earth."""
    return int(np.argmax(np.einsum("ij,ij->i", trajectory.r_i, trajectory.r_i)))


class Points(NamedTuple):
    """Impact points over m instants; NaN where the vehicle is not above the ground."""

    t_s: np.ndarray  # (m,)
    vacuum: np.ndarray  # (m, 2) rad, geodetic latitude and longitude
    drag: np.ndarray  # (m, 2) rad


def impact_points(scenario, landed, ground):
    """Points of a flight from the end of the rail to the landing, or to the parachute."""
    given = params.flight_params(scenario)
    configurations = fly.configurations(given)
    drops = [one.t_s for one in landed.flight.dropped]
    times, found = _times(landed.flight), []
    for t_s in times:
        k = sum(t_s >= drop - SAME_S for drop in drops)
        state, mass = _centre(landed.flight.trajectory, configurations[k], t_s)
        bodies = ballistic.Body(mass, None), ballistic.Body(mass, _nose_first(configurations[k].aero))
        found.append([_point(landed.world, body, t_s, state, ground) for body in bodies])
    found = np.array(found).reshape(-1, 2, 2)
    return Points(np.array(times), found[:, 0], found[:, 1])


def _times(flight):
    """Times of samples: close while a motor burns, and at separations."""
    at = {}
    for event in flight.events:
        at.setdefault(event.name, event.t_s)
    end = min(at.get("parachute", np.inf), at["impact"])
    burnt_out = [t for name, t in at.items() if name.startswith("burn_out")]
    last_burn = max(burnt_out, default=end)  # none before it hits the ground burning
    close = np.arange(at["rail_exit"], min(last_burn, end), BURNING_S)
    times = np.concatenate(
        [close, np.arange(last_burn, end, COASTING_S), [one.t_s for one in flight.dropped]]
    )
    rows = np.searchsorted(flight.trajectory.t_s, times[times < end] - SAME_S)
    return flight.trajectory.t_s[np.unique(rows)].tolist()


def _centre(trajectory, configuration, t_s):
    """State of the centre of mass, (3,) m and (3,) m/s, frame i, and mass, kg, at the sample of t_s."""
    k = int(np.searchsorted(trajectory.t_s, t_s))
    C_ib, lever = rotation.dcm_from_quat(trajectory.q_ib[k]), fly.lever(configuration, t_s)
    r_i = trajectory.r_i[k] + C_ib @ lever
    v_i = trajectory.v_i[k] + C_ib @ np.cross(trajectory.omega_ib_b[k], lever)
    return (r_i, v_i), float(trajectory.mass_kg[k])


def _nose_first(aero):
    """Spent of AeroTables at no angle of attack."""
    return p.Spent(aero.area, aero.mach, aero.axial[:, 0] + aero.drag[:, 0])


def _point(world, body, t_s, state, ground):
    fall = ballistic.fall(world, body, t_s, *state, ground=ground, tolerance=FALL_STEP_S)
    if fall is None:
        return np.nan, np.nan
    one = landing_of("", world.earth, *fall.landing)
    return one.latitude, one.longitude
