"""The vehicle: mass, inertia, centre of mass and thrust of what is still attached; aerodynamic tables.

In: the parameters of payload and stages. Out: a `Configuration` per flight section, and from it the thrust
and the mass properties at any time.

Places along the roll axis are stations: distance behind the nose tip, m. Everything is axisymmetric in mass;
only the IMU may sit off the axis.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

G_0 = 9.80665  # m/s^2, standard gravity, by which specific impulse is given in seconds


class Part(NamedTuple):
    """A rigid part: the payload, or a stage without its propellant."""

    mass_kg: float
    station_m: float  # centre of mass
    inertia_roll: float  # kg m^2 about the roll axis
    inertia_pitch: float  # kg m^2 across, about its own centre of mass


class Stage(NamedTuple):
    """A solid motor: dry part, a hollow cylindrical grain that burns outwards, a nozzle."""

    dry: Part
    propellant_mass_kg: float
    grain_station_m: float  # middle of the grain
    grain_length_m: float
    grain_outer_radius_m: float
    grain_inner_radius_m: float  # before ignition
    isp_vacuum_s: float
    burn_time_s: float
    rise_s: float  # thrust from zero to its first level
    tail_off_s: float  # thrust to zero at the end, part of burn_time_s
    level_ratio: float  # thrust at the start of the tail-off over the thrust after the rise
    exit_area_m2: float
    exit_station_m: float


class Aerodynamics(NamedTuple):
    """Coefficients of one configuration over Mach number, all to the same reference area and diameter."""

    area_m2: float
    diameter_m: float
    fin_cant: float  # rad
    mach: np.ndarray  # (n,) increasing
    axial: np.ndarray  # (n,) C_A at zero angle of attack
    normal_slope: np.ndarray  # (n,) dC_N/dalpha, 1/rad
    pressure_station_m: np.ndarray  # (n,) centre of pressure
    pitch_damping: np.ndarray  # (n,) C_mq + C_m,alpha-dot for omega d/(2V), negative
    roll_damping: np.ndarray  # (n,) C_lp for omega d/(2V), negative
    roll_by_cant: np.ndarray  # (n,) dC_l/d(fin cant), 1/rad


class Configuration(NamedTuple):
    """What flies in one section of the flight, as the equations of motion need it."""

    rigid_mass: float  # kg, everything but the propellant that burns in this section
    rigid_station: float  # m, its centre of mass
    rigid_roll: float  # kg m^2
    rigid_pitch: float  # kg m^2, about its own centre of mass
    grain_mass: float  # kg at ignition; zero: no motor in this section
    grain_station: float  # m
    grain_length: float  # m
    grain_outer2: float  # m^2, outer radius squared
    grain_inner2: float  # m^2, inner radius squared at ignition
    t_ignition: float  # s
    corners: np.ndarray  # (4,) s, mission times of the corners of the thrust history
    levels: np.ndarray  # (4,) N, vacuum thrust at them
    exhaust_speed: float  # m/s, thrust per mass flow
    exit_area: float  # m^2
    exit_station: float  # m
    imu: np.ndarray  # (3,) m, IMU from the nose tip in body axes
    area: float  # m^2
    diameter: float  # m
    fin_cant: float  # rad
    aero: np.ndarray  # (n, 7) columns: mach, C_A, C_N,alpha, station of pressure, C_mq, C_lp, C_l,cant


def combine(parts):
    """Rigid union of `Part`s, by the parallel-axis theorem."""
    mass = sum(part.mass_kg for part in parts)
    station = sum(part.mass_kg * part.station_m for part in parts) / mass
    pitch = sum(p.inertia_pitch + p.mass_kg * (p.station_m - station) ** 2 for p in parts)
    return Part(mass, station, sum(part.inertia_roll for part in parts), pitch)


def grain(stage, mass_kg):
    """The propellant of a stage when mass_kg of it is left, as a `Part`."""
    outer2, inner2 = stage.grain_outer_radius_m**2, stage.grain_inner_radius_m**2
    inner2 = outer2 - (outer2 - inner2) * mass_kg / stage.propellant_mass_kg
    roll = 0.5 * mass_kg * (outer2 + inner2)
    pitch = mass_kg * (3.0 * (outer2 + inner2) + stage.grain_length_m**2) / 12.0
    return Part(mass_kg, stage.grain_station_m, roll, pitch)


def thrust_history(stage, t_ignition):
    """Corners [s] and vacuum thrust at them [N], (4,) each: rise, slow decline, tail-off.

    The area under it is propellant mass times exhaust speed: the motor burns out exactly at its end.
    """
    level_s = stage.burn_time_s - stage.rise_s - stage.tail_off_s
    if min(stage.rise_s, stage.tail_off_s, level_s) <= 0.0:
        raise ValueError("a stage needs rise and tail-off above zero that together are shorter than its burn")
    corners = np.cumsum([0.0, stage.rise_s, level_s, stage.tail_off_s])
    shape = np.array([0.0, 1.0, stage.level_ratio, 0.0])
    area = (0.5 * (shape[1:] + shape[:-1]) * np.diff(corners)).sum()
    impulse = stage.propellant_mass_kg * stage.isp_vacuum_s * G_0
    return t_ignition + corners, impulse / area * shape


def configure(rigid, stage, t_ignition, imu, aerodynamics):
    """Configuration of rigid parts and one stage that burns; stage None: nothing burns any more.

    `rigid` holds the dry part of the burning stage too.
    """
    body = combine(rigid)
    if stage is None:
        motor = (0.0, 0.0, 1.0, 1.0, 0.5, t_ignition, t_ignition + np.arange(4.0), np.zeros(4), 1.0, 0.0, 0.0)
    else:
        corners, levels = thrust_history(stage, t_ignition)
        motor = (
            stage.propellant_mass_kg,
            stage.grain_station_m,
            stage.grain_length_m,
            stage.grain_outer_radius_m**2,
            stage.grain_inner_radius_m**2,
            t_ignition,
            corners,
            levels,
            stage.isp_vacuum_s * G_0,
            stage.exit_area_m2,
            stage.exit_station_m,
        )
    a = aerodynamics
    if np.any(np.diff(a.mach) <= 0.0):
        raise ValueError("the Mach numbers of an aerodynamic table have to increase")
    columns = (
        a.mach,
        a.axial,
        a.normal_slope,
        a.pressure_station_m,
        a.pitch_damping,
        a.roll_damping,
        a.roll_by_cant,
    )
    table = np.ascontiguousarray(np.stack([np.asarray(c, dtype=float) for c in columns], axis=1))
    numbers = [float(x) if np.ndim(x) == 0 else np.array(x, dtype=float) for x in (*body, *motor)]
    frame = (np.array(imu, dtype=float), float(a.area_m2), float(a.diameter_m), float(a.fin_cant))
    return Configuration(*numbers, *frame, table)


@njit(cache=True)
def thrust(configuration, t_s):
    """(vacuum thrust N, propellant left kg) at a mission time, both exact for the broken-line history."""
    corners, levels = configuration.corners, configuration.levels
    if t_s <= corners[0]:
        return 0.0, configuration.grain_mass
    impulse = 0.0
    for k in range(3):
        width = corners[k + 1] - corners[k]
        part = min(t_s - corners[k], width)
        force = levels[k] + (levels[k + 1] - levels[k]) * part / width
        impulse += 0.5 * (levels[k] + force) * part
        if t_s < corners[k + 1]:
            return force, configuration.grain_mass - impulse / configuration.exhaust_speed
    return 0.0, max(0.0, configuration.grain_mass - impulse / configuration.exhaust_speed)


@njit(cache=True)
def mass_properties(configuration, propellant):
    """Mass, station of the centre of mass, inertia about the roll axis and across it, `propellant` kg left.

    Also the derivative of the grain's own pitch inertia by its mass [m^2], for the jet damping.
    """
    c = configuration
    mass = c.rigid_mass + propellant
    station = (c.rigid_mass * c.rigid_station + propellant * c.grain_station) / mass
    inner2 = c.grain_outer2
    if c.grain_mass > 0.0:
        inner2 -= (c.grain_outer2 - c.grain_inner2) * propellant / c.grain_mass
    roll = c.rigid_roll + 0.5 * propellant * (c.grain_outer2 + inner2)
    pitch = c.rigid_pitch + propellant * (3.0 * (c.grain_outer2 + inner2) + c.grain_length**2) / 12.0
    pitch += c.rigid_mass * (c.rigid_station - station) ** 2
    pitch += propellant * (c.grain_station - station) ** 2
    return mass, station, roll, pitch, (6.0 * inner2 + c.grain_length**2) / 12.0
