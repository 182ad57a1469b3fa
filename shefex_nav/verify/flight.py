"""A check-case flown with the equations of motion and the integrator of this package.

In: a `Case` and its vehicle. Out: a `History` of the centre of mass at 10 Hz.

The trajectories give position and velocity of the centre of mass, which in the rocket moves forward as
propellant burns: its position counts, and the velocity of the point of the body that it is at.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.gravity import from_normalised, gravity_e
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import EarthRotation, dcm_ie, ecef_from_inertial, inertial_from_ecef
from shefex_nav.geometry.rotation import cross, dcm_from_quat, quat_from_dcm, rows
from shefex_nav.verify.vehicles import EARTH, sections
from shefex_nav.world.flight import attitude_program, control, dynamics, integrate
from shefex_nav.world.flight.surroundings import Rail, World

STEP_S = 0.1  # between the rows of the trajectories
SPLIT_S = 0.05  # step by which a moment is added that the equations of motion do not have
DEG = math.pi / 180.0


class History(NamedTuple):
    """The flight of the centre of mass; n rows, SI units and radians."""

    t_s: np.ndarray  # (n,)
    height_m: np.ndarray  # (n,)
    values: dict  # quantity, as in compare.QUANTITIES -> (n,)


def fly(case, models, tolerance=integrate.TOLERANCE):
    """History of a case; models as `vehicles.MODELS` names them."""
    world, parts = surroundings(case), sections(case, models)
    count = round(case.end_s / STEP_S) + 1
    states = np.zeros((count, dynamics.ROW))
    x = start(case, parts[0].configuration)
    t_s, k = 0.0, 0
    for part in parts:
        last = part is parts[-1]
        end_s = part.end_s + 0.5 * STEP_S if last else part.end_s  # a row at the very end would be left out
        if part.growth is None:
            t_s, k = _advance(x, t_s, end_s, k, part.configuration, world, tolerance, states)
        else:
            t_s, k = _advance_growing(x, t_s, end_s, k, part, world, tolerance, states)
    return history(world, parts, np.arange(count) * STEP_S, states)


def _advance(x, t_s, end_s, k, configuration, world, tolerance, states):
    """Integrate to end_s; x in place, rows into states. Returns (end_s, next row)."""
    law, quiet = attitude_program.hold(0.0, 1.0, 0.0), control.none()
    flown = integrate.Vehicle(configuration, dynamics.FREE, law, quiet)
    samples = integrate.Samples(0.0, STEP_S, states)
    reached_s, k, event = integrate.integrate(x, t_s, end_s, k, samples, flown, world, tolerance)
    if event != 0:
        raise RuntimeError(f"the flight of a check-case ended early, at {reached_s:.3f} s")
    return end_s, k


def _advance_growing(x, t_s, end_s, k, part, world, tolerance, states):
    """As `_advance`, with the moment growth * omega, which the equations of motion do not have.

    It is split off (Strang 1968, second order): half a short step without it, its effect over the step,
    omega exp(growth/I dt) about the centre of mass, the other half. Short steps are flown with the point of
    the state at the centre of mass: the height of that point decides on the air, and the unguided rocket
    answers to a metre of it with 0.08 deg of pitch at the end.
    """
    count = max(1, round((end_s - t_s) / SPLIT_S))
    short = (end_s - t_s) / count
    fixed = part.configuration
    for middle in t_s + short * (np.arange(count) + 0.5):
        left = np.interp(middle, fixed.thrust[:, 0], fixed.thrust[:, 2])
        mass, *inertia = (np.interp(left, fixed.mass[:, 0], fixed.mass[:, column]) for column in (1, 3, 4, 5))
        l_b = _centre_of_mass(fixed, np.array([mass]))[0]
        configuration, first = fixed._replace(imu=fixed.imu + l_b), k
        _move(x, l_b)
        t_s, k = _advance(x, t_s, middle, k, configuration, world, tolerance, states)
        x[10:13] *= np.exp(part.growth / np.array(inertia) * short)
        t_s, k = _advance(x, t_s, middle + 0.5 * short, k, configuration, world, tolerance, states)
        for state in (x, *states[first:k]):
            _move(state, -l_b)
    return t_s, k


def _move(x, l_b):
    """Let a state be that of the point l_b (3,) m away in the body; in place."""
    C_ib = dcm_from_quat(x[6:10])
    x[0:3] += C_ib @ l_b
    x[3:6] += C_ib @ cross(x[10:13], l_b)


def surroundings(case):
    """World of a case: its Earth and wind, the US Standard Atmosphere 1976, no rail."""
    planet = case.planet
    cosine, sine = np.zeros((3, 3)), np.zeros((3, 3))
    cosine[0, 0], cosine[2, 0] = 1.0, -planet.j2 / math.sqrt(5.0)
    wind = np.array(case.wind, dtype=float).reshape(-1, 3)
    return World(
        gravity=from_normalised(wgs84.GM, planet.radius_m, cosine, sine),
        coarse=np.array([wgs84.GM, planet.radius_m, planet.j2]),
        earth=EarthRotation(np.eye(3), np.eye(3), 0.0, planet.rate),
        shape=np.array([planet.radius_m, planet.e2]),
        rail=Rail(np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.0),
        air=np.zeros((0, 4)),
        density_factor=1.0,
        wind=wind,
        wind_times=np.zeros(1),
    )


def start(case, configuration):
    """State vector (19,) at the start, of the IMU point; on the equator, longitude zero."""
    planet = case.planet
    earth = EarthRotation(np.eye(3), np.eye(3), 0.0, planet.rate)
    C_en = wgs84.dcm_en(0.0, 0.0)
    yaw, pitch, roll = (DEG * angle for angle in case.yaw_pitch_roll)
    C_nb = _about_z(yaw) @ _about_y(pitch) @ _about_x(roll)
    r_e = np.array([planet.radius_m + case.height_m, 0.0, 0.0])
    r_i, v_i = inertial_from_ecef(earth, 0.0, r_e, C_en @ np.array(case.velocity_n))
    C_ib = dcm_ie(earth, 0.0) @ C_en @ C_nb
    omega_b = DEG * np.array(case.rates)
    if case.rates_to == EARTH:
        omega_b = omega_b + C_ib.T @ np.array([0.0, 0.0, planet.rate])
    full = configuration.mass[-1, 1]
    l_b = _centre_of_mass(configuration, np.array([full]))[0]
    x = np.zeros(dynamics.STATE)
    x[0:3], x[3:6] = r_i - C_ib @ l_b, v_i - C_ib @ cross(omega_b, l_b)
    x[6:10], x[10:13] = quat_from_dcm(C_ib), omega_b
    return x


def _about_x(angle):
    c, s = math.cos(angle), math.sin(angle)
    return rows((1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c))


def _about_y(angle):
    c, s = math.cos(angle), math.sin(angle)
    return rows((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c))


def _about_z(angle):
    c, s = math.cos(angle), math.sin(angle)
    return rows((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0))


def _centre_of_mass(configuration, mass_kg):
    """Centre of mass from the IMU point in body axes, by the mass left: (n,) kg -> (n, 3) m."""
    l_b = np.tile(-configuration.imu, (mass_kg.size, 1))
    l_b[:, 0] -= np.interp(mass_kg, configuration.mass[:, 1], configuration.mass[:, 2])
    return l_b


def history(world, parts, t_s, states):
    """History from the rows of the integration."""
    section = np.searchsorted([part.end_s for part in parts[:-1]], t_s, side="right")
    l_b = np.zeros((t_s.size, 3))
    for k, part in enumerate(parts):
        l_b[section == k] = _centre_of_mass(part.configuration, states[section == k, dynamics.STATE + 3])
    lines = [_row(world, t, x, l) for t, x, l in zip(t_s, states, l_b, strict=True)]
    values = {name: np.array([line[name] for line in lines]) for name in lines[0]}
    return History(t_s, values["altitude"], values)


def _row(world, t_s, x, l_b):
    """Quantities of one instant: name -> value."""
    C_ib = dcm_from_quat(x[6:10])
    r_i, v_i = x[0:3] + C_ib @ l_b, x[3:6] + C_ib @ cross(x[10:13], l_b)
    r_e, v_e = ecef_from_inertial(world.earth, t_s, r_i, v_i)
    latitude, longitude, height = _geodetic(world.shape, r_e)
    C_ne = wgs84.dcm_en(latitude, longitude).T
    C_nb = C_ne @ dcm_ie(world.earth, t_s).T @ C_ib
    north, east, down = C_ne @ v_e
    density, pressure, temperature, sound = us76(height)
    return {
        "altitude": height,
        "latitude": latitude,
        "longitude": longitude,
        "yaw": math.atan2(C_nb[1, 0], C_nb[0, 0]),
        "pitch": -math.asin(min(1.0, max(-1.0, C_nb[2, 0]))),
        "roll": math.atan2(C_nb[2, 1], C_nb[2, 2]),
        "roll_rate": x[10],
        "pitch_rate": x[11],
        "yaw_rate": x[12],
        "velocity_north": north,
        "velocity_east": east,
        "velocity_down": down,
        "gravity": math.sqrt((gravity_e(world.gravity, r_e) ** 2).sum()),
        "density": density,
        "pressure": pressure,
        "temperature": temperature,
        "speed_of_sound": sound,
        "mach": x[dynamics.STATE + 4],
        "dynamic_pressure": x[dynamics.STATE + 5],
    }


def _geodetic(shape, r_e):
    """Latitude, longitude, height over a sphere or the WGS 84 ellipsoid."""
    if shape[1] > 0.0:
        return wgs84.geodetic_from_ecef(r_e)
    across = math.hypot(r_e[0], r_e[1])
    return math.atan2(r_e[2], across), math.atan2(r_e[1], r_e[0]), math.hypot(across, r_e[2]) - shape[0]
