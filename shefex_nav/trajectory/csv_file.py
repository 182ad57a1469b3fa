"""A CSV whose columns, units and frames the scenario names."""

import numpy as np

from shefex_nav.geometry import frames, wgs84
from shefex_nav.scenario.data_table import DataError, read_csv
from shefex_nav.scenario.trajectory import AemFile, AlongVelocity, QuaternionColumns
from shefex_nav.trajectory import placing
from shefex_nav.trajectory.rows import (
    Attitudes,
    Rows,
    ascending,
    clock_rounding,
    moved,
    rounding,
    unit_quaternions,
)
from shefex_nav.world.flight import track

LENGTHS = {"m": 1.0, "km": 1e3, "ft": 0.3048}  # that positions may be in by mistake


def read(given, earth):
    """Rows of a scenario.trajectory.Csv."""
    names = [given.time, *given.position, *(given.velocity or ()), *(given.acceleration or ())]
    names += _of_attitude(given.attitude)
    table = read_csv(given.file, tuple(dict.fromkeys(names)))
    t_s = table.columns[given.time] * given.time_unit.factor - given.lift_off
    ascending(table, t_s)
    here = placing.place(earth, t_s, given.origin)
    r_e, rounding_m = _positions(given, table, here)
    r_i = placing.rotated(here.C_ie, r_e)
    v_i, rounding_m_s, others = _velocities(given, table, here, (t_s, r_e, r_i, rounding_m))
    v_e = v_i - np.cross(frames.omega_ie_i(earth), r_i)
    rounding_m += moved(v_e, clock_rounding(table.columns[given.time]) * given.time_unit.factor)
    a_i = None
    if given.acceleration:
        values = table.stack(given.acceleration) * given.acceleration_unit.factor
        a_i = placing.accelerations(here, r_i, v_i, values, given.velocity_frame)
    attitudes = _attitudes(given.attitude, table, here, (t_s, r_e))
    return Rows(table, t_s, r_i, v_i, a_i, rounding_m, rounding_m_s, attitudes, None, others)


def _of_attitude(given):
    """Names of the columns of an attitude: list."""
    if isinstance(given, AlongVelocity | AemFile):
        return []
    return list(given.quaternion if isinstance(given, QuaternionColumns) else given.euler)


def _positions(given, table, here):
    """Positions (N, 3) m, frame e, and their rounding, m."""
    values, unit = table.stack(given.position), given.position_unit.factor
    if given.position_frame != "geodetic":
        return placing.ecef(here, values * unit, given.position_frame), rounding(values) * unit
    scale = np.array([given.angle_unit.factor, given.angle_unit.factor, unit])
    steep = np.flatnonzero(np.abs(values[:, 0] * scale[0]) > 0.5 * np.pi)
    if len(steep):
        words = f"{given.position[0]}: {values[steep[0], 0]:g} is no latitude in the unit given; angle_unit?"
        raise DataError(f"{table.place(int(steep[0]))}: {words}")
    digits = [rounding(values[:, k : k + 1]) * scale[k] for k in range(3)]
    return placing.ecef(here, values * scale, "geodetic"), max(wgs84.A * max(digits[:2]), digits[2])


def _velocities(given, table, here, where):
    """Inertial velocities (N, 3) m/s, their rounding, and what they might be otherwise.

    where : times (N,), positions (N, 3) in e and in i, and their rounding
    """
    t_s, r_e, r_i, rounding_m = where
    if given.velocity is None:
        v_e = track.velocity(t_s, r_e, rounding_m)
        return placing.velocities(here, r_i, v_e, "ecef"), 0.0, ()
    values = table.stack(given.velocity)
    converted = values * given.velocity_unit.factor
    known = ("ned", "enu", "ecef", "inertial", *(("launch_enu",) if given.origin else ()))
    others = [
        (f"velocity_frame: {frame}", placing.velocities(here, r_i, converted, frame))
        for frame in known
        if frame != given.velocity_frame
    ]
    for unit, of_one in (("km/s", 1e3), ("km/h", 1.0 / 3.6), ("ft/s", 0.3048), ("m/s", 1.0)):
        v_i = placing.velocities(here, r_i, values * of_one, given.velocity_frame)
        others.append((f"velocity_unit: {unit}", v_i))
    if given.position_frame != "geodetic":  # lengths of another unit: velocities that are as much longer
        for unit, of_one in LENGTHS.items():
            ratio = given.position_unit.factor / of_one
            if ratio != 1.0:
                v_i = placing.velocities(here, r_i, converted * ratio, given.velocity_frame)
                others.append((f"position_unit: {unit}", v_i))
    v_i = placing.velocities(here, r_i, converted, given.velocity_frame)
    return v_i, rounding(values) * given.velocity_unit.factor, tuple(others)


def _attitudes(given, table, here, where):
    """Attitudes of the columns; None if they are not in this file. where : times, positions in e"""
    if isinstance(given, AlongVelocity | AemFile):
        return None
    t_s, r_e = where
    if isinstance(given, QuaternionColumns):
        values = table.stack(given.quaternion)
        C_ff, digit = placing.of_quaternions(unit_quaternions(table, values), given.sense), rounding(values)
        digit *= 2.0
    else:
        values = table.stack(given.euler) * given.angle_unit.factor
        C_ff = placing.of_angles(values)
        digit = rounding(table.stack(given.euler)) * given.angle_unit.factor
    C_fb = placing.body_axes(C_ff, given.axes)
    return Attitudes(table, t_s, placing.attitudes(here, r_e, C_fb, given.frame), digit)
