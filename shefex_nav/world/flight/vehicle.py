"""The vehicle as the equations of motion need it: mass, inertia, thrust, devices, aerodynamic tables.

In: the parameters of rigid parts and of the stage that burns. Out: a `Configuration` per section of the
flight, and from it thrust and mass properties at any time.

Places along the roll axis are stations: distance behind the nose tip, m. Body axes: x along the roll axis to
the nose, so that the station s is at x = -s.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.world.flight import devices
from shefex_nav.world.flight.aerodynamics import AeroTables, tables
from shefex_nav.world.flight.scene import mixed, place
from shefex_nav.world.flight.settings import RigidPart


class Configuration(NamedTuple):
    """What flies in one section of the flight. Arrays are writable, C-contiguous and of its own."""

    mass: (
        np.ndarray
    )  # (n, 6) by propellant left, ascending: that kg, mass kg, station of c.m. m, I_x, I_y, I_z
    products: np.ndarray  # (3,) kg m^2, J_xy, J_xz, J_yz of the inertia tensor
    offset: np.ndarray  # (2,) m, centre of mass off the roll axis in y and z
    thrust: np.ndarray  # (m, 3) mission time s, increasing, vacuum thrust N, propellant left kg; zero outside
    exhaust_speed: float  # m/s, vacuum thrust per mass flow
    exit_area: float  # m^2
    exit_station: float  # m
    thrust_axis: np.ndarray  # (3,) unit, direction of the thrust, body axes
    thrust_offset: np.ndarray  # (2,) m, line of the thrust off the roll axis in y and z, at the exit
    gas: float  # 1: with Coriolis force and jet damping of the gas in the motor, 0: without
    imu: np.ndarray  # (3,) m from the nose tip, body axes
    aero: AeroTables
    spin_motors: np.ndarray  # (k, 3) start s, end s, roll torque N m
    yo_yo: np.ndarray  # (4,) release s, cords off s, spin at release rad/s, 1 + I_x/(m R^2); inf: none
    parachute: (
        np.ndarray
    )  # (5,) opening s (inf: not yet), inflation s, drag area m^2, station of its lines m, 0


def combine(parts):
    """Rigid union of `settings.RigidPart`s on one axis, by the parallel-axis theorem."""
    mass = sum(part.mass for part in parts)
    station = sum(part.mass * part.station for part in parts) / mass
    roll = sum(part.inertia_roll for part in parts)
    pitch = sum(p.inertia_pitch + p.mass * (p.station - station) ** 2 for p in parts)
    return RigidPart(mass=mass, station=station, inertia_roll=roll, inertia_pitch=pitch)


def charge(propellant, row):
    """RigidPart of a row of a params.Propellant."""
    mass, station, roll, pitch = (column[row] for column in propellant)
    return RigidPart(mass=mass, station=station, inertia_roll=roll, inertia_pitch=pitch)


def configure(rigid_parts, stage, params, aerodynamics):
    """Configuration of rigid parts and one stage that burns; stage None: nothing burns any more.

    Parameters
    ----------
    rigid_parts : of all that flies but the propellant of that stage; its dry part belongs here
    stage : params.Stage or None
    params : FlightParams, for the IMU and the asymmetry of the vehicle
    aerodynamics : params.Aerodynamics
    """
    body = combine(rigid_parts)
    table, products = _mass_table(body, stage, params.payload.principal_axis_tilt)
    return Configuration(
        mass=table,
        products=products,
        offset=np.array(params.payload.centre_of_mass_offset, dtype=float),
        imu=np.array(params.imu_b, dtype=float),
        aero=tables(aerodynamics),
        spin_motors=devices.spin_motor_rows(None),
        yo_yo=devices.yo_yo_row(None, 0.0, 1.0),
        parachute=devices.parachute_row(None),
        **_motor(stage),
    )


def _mass_table(body, stage, tilt):
    """Mass table (n, 6) and products of inertia (3,) of a rigid body and the propellant of a stage.

    The principal axis of roll is turned by tilt (2,) rad about y and z. The products are constant: those of
    the vehicle when half of that propellant is left.
    """
    if stage is None:
        left, parts = np.array([0.0, 1.0]), [body, body]
    else:
        q = stage.propellant
        left = np.array(q.mass_kg, dtype=float)
        if left[0] != 0.0 or np.any(np.diff(left) <= 0.0):
            raise ValueError(f"{stage.name}: the propellant of its table has to grow from zero")
        parts = [combine([body, charge(q, row)]) for row in range(left.size)]
    turn = dcm_from_rotvec(np.array([0.0, tilt[0], tilt[1]]))
    roll, pitch = np.array([p.inertia_roll for p in parts]), np.array([p.inertia_pitch for p in parts])
    # R diag(I_x, I_t, I_t) R^T = I_t + (I_x - I_t) e e^T with e the principal axis of roll
    axis = turn[:, 0]
    table = np.empty((left.size, 6))
    table[:, 0], table[:, 1] = left, [p.mass for p in parts]
    table[:, 2] = [p.station for p in parts]
    table[:, 3:] = pitch[:, None] + np.outer(roll - pitch, axis**2)
    half = np.interp(0.5 * left[-1], left, roll - pitch)
    products = half * np.array([axis[0] * axis[1], axis[0] * axis[2], axis[1] * axis[2]])
    return table, products


def _motor(stage):
    """Fields of a Configuration about the motor of a stage; None: none."""
    if stage is None:
        thrust = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
        place, axis, offset = (1.0, 0.0, 0.0), np.array([1.0, 0.0, 0.0]), np.zeros(2)
    else:
        m = stage.motor
        t_s, force = np.array(m.t_s, dtype=float), np.array(m.vacuum_thrust_n, dtype=float)
        if t_s.size < 2 or np.any(np.diff(t_s) <= 0.0) or np.any(force < 0.0):
            raise ValueError(
                f"{stage.name}: the times of its thrust have to increase, thrust is never negative"
            )
        impulse = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(t_s))])
        full = float(stage.propellant.mass_kg[-1])
        if abs(impulse[-1] / (full * m.exhaust_speed) - 1.0) > 1e-6:
            raise ValueError(
                f"{stage.name}: {full:.6g} kg of propellant at {m.exhaust_speed:.6g} m/s do not give the "
                f"impulse of its thrust, {impulse[-1]:.6g} N s"
            )
        left = full * (1.0 - impulse / impulse[-1])
        thrust = np.column_stack([stage.t_ignition_s + t_s, force, left])
        place = (impulse[-1] / full, float(m.nozzle.exit_area), float(m.nozzle.exit_station))
        axis = dcm_from_rotvec(np.array([0.0, *m.nozzle.misalignment]))[:, 0].copy()
        offset = np.array(m.nozzle.offset, dtype=float)
    return {
        "thrust": np.ascontiguousarray(thrust),
        "exhaust_speed": float(place[0]),
        "exit_area": place[1],
        "exit_station": place[2],
        "thrust_axis": axis,
        "thrust_offset": offset,
        "gas": 1.0,
    }


def no_motor():
    """Fields of a Configuration about a motor that is not there."""
    return _motor(None)


def corners(configuration):
    """Mission times at which something jumps or kinks, ascending: (n,) s.

    Corners of the thrust, instants at which the propellant passes a row of the mass table, beginning and end
    of the devices.
    """
    c = configuration
    t_s, force, left = c.thrust.T
    k, j = np.nonzero((left[1:, None] < c.mass[:, 0]) & (c.mass[:, 0] < left[:-1, None]))
    # impulse until then: F_0 s + slope s^2 / 2, solved for s without cancellation
    impulse = (left[k] - c.mass[j, 0]) * c.exhaust_speed
    slope = (np.diff(force) / np.diff(t_s))[k]
    twice = force[k] + np.sqrt(np.maximum(0.0, force[k] ** 2 + 2.0 * slope * impulse))
    passed = t_s[k[twice > 0.0]] + 2.0 * impulse[twice > 0.0] / twice[twice > 0.0]
    full = c.parachute[0] + c.parachute[1]
    times = np.concatenate([t_s, passed, c.spin_motors[:, :2].ravel(), c.yo_yo[:2], c.parachute[:1], [full]])
    return np.unique(times[np.isfinite(times)])


@inner(error_model="numpy", forceinline=True)
def choose_rows(s, tables, t_s):
    """Note in the record of the Scene in which rows of its tables thrust and mass are at t_s.

    They stay the same between two corners. At the corners themselves only the side from which one comes tells
    which rows hold; a time in the middle knows.
    """
    end = s.thrust_at + 3 * (s.thrust_n - 1)
    if t_s < tables[s.thrust_at]:
        s.thrust_row = -1
    elif t_s >= tables[end]:
        s.thrust_row = s.thrust_n - 1
    else:
        s.thrust_row, _ = place(tables, s.thrust_at, s.thrust_n, 3, t_s)
    _, left = thrust(s, tables, t_s)
    s.mass_row, _ = place(tables, s.mass_at, s.mass_n, 6, left)


@kernel(error_model="numpy", forceinline=True)
def thrust(s, tables, t_s):
    """(vacuum thrust N, propellant left kg) at a mission time; both exact for a broken line."""
    k = s.thrust_row
    if k < 0:
        return 0.0, tables[s.thrust_at + 2]
    at = s.thrust_at + 3 * k
    if k == s.thrust_n - 1:
        return 0.0, tables[at + 2]
    since = t_s - tables[at]
    force = mixed(tables, at + 1, 3, since / (tables[at + 3] - tables[at]))
    return force, tables[at + 2] - 0.5 * (tables[at + 1] + force) * since / s.exhaust_speed


class MassProperties(NamedTuple):
    """What the mass table says for one amount of propellant."""

    mass: float  # kg
    station: float  # m, of the centre of mass
    i_x: float  # kg m^2, about it, likewise below
    i_y: float
    i_z: float
    x_burning: float  # m, station of the propellant that burns now, d(m x)/dm
    di_y: float  # m^2, dI_y/dm
    di_z: float  # m^2


@inner(error_model="numpy", forceinline=True)
def mass_properties(s, tables, propellant):
    """MassProperties with `propellant` kg left. Slopes are those from row to row."""
    at = s.mass_at + 6 * s.mass_row
    width = tables[at + 6] - tables[at]
    part = (propellant - tables[at]) / width
    return MassProperties(
        mixed(tables, at + 1, 6, part),
        mixed(tables, at + 2, 6, part),
        mixed(tables, at + 3, 6, part),
        mixed(tables, at + 4, 6, part),
        mixed(tables, at + 5, 6, part),
        (tables[at + 7] * tables[at + 8] - tables[at + 1] * tables[at + 2]) / width,
        (tables[at + 10] - tables[at + 4]) / width,
        (tables[at + 11] - tables[at + 5]) / width,
    )
