"""Aerodynamic force and moment of one configuration of the vehicle, from tables.

In: `params.Aerodynamics`, the velocity relative to the air and the rate. Out: `AeroTables`, and by them force
and moment about the centre of mass in body axes.

The vehicle is taken to be symmetric about the roll axis: what counts is the Mach number and the total angle
of attack alpha between roll axis and velocity, 0 to pi. Axial and normal force and the moment lie in the
plane of both. Tables are bilinear in Mach number and angle, and constant beyond their ends; but a table over
the angle that ends before 180 deg goes on to there, with an axial force that turns round as the flow does:
held constant, what brakes nose first would push tail first.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.world.flight.scene import mixed, place

FROM_TAIL = np.radians(5.0)  # rad, between angles that are added to a table: cos^2 to 0.002


class AeroTables(NamedTuple):
    """Coefficients over n Mach numbers and k total angles of attack, to one area and one diameter.

    k = 1: axial is multiplied by cos(alpha) |cos(alpha)|, the others hold at every angle.
    """

    area: float  # m^2
    diameter: float  # m
    fin_cant: float  # rad
    moment_station: float  # m behind the nose tip: forces are taken to act there, the moment is about it
    mach: np.ndarray  # (n,) increasing, n >= 2
    alpha: np.ndarray  # (k,) rad, increasing from 0
    axial: np.ndarray  # (n, k) C_A, against body x
    normal: np.ndarray  # (n, k) C_N / sin(alpha), against the cross flow
    moment: np.ndarray  # (n, k) C_M / sin(alpha), negative: turns the nose into the wind
    drag: np.ndarray  # (n, k) C_D along the air velocity, added to axial and normal force
    damping: (
        np.ndarray
    )  # (n, 4) C_mq, C_nr, C_lp, each for rate diameter / (2 V), and C_l per rad of fin cant


def tables(aero):
    """AeroTables of `params.Aerodynamics`. Normal force and drag act at the centre of pressure."""
    a = aero
    mach, alpha = np.array(a.mach, dtype=float), np.atleast_1d(np.array(a.alpha, dtype=float))
    if mach.size < 1 or np.any(np.diff(mach) <= 0.0):
        raise ValueError("the Mach numbers of an aerodynamic table have to increase")
    if alpha[0] != 0.0 or np.any(np.diff(alpha) <= 0.0):
        raise ValueError("the angles of attack of an aerodynamic table have to increase from zero")
    shape = (mach.size, alpha.size)
    names = ("axial", "normal_slope", "pressure_station_m", "drag")
    grids = {name: np.array(getattr(a, name), dtype=float).reshape(shape) for name in names}
    alpha, grids = _to_the_tail(alpha, grids)
    columns = (a.pitch_damping, a.pitch_damping, a.roll_damping, a.roll_by_cant)
    damping = np.column_stack([np.array(column, dtype=float) for column in columns])
    if mach.size == 1:  # a kernel interpolates between two rows at least
        mach = np.array([mach[0], mach[0] + 1.0])
        grids = {name: np.repeat(grid, 2, axis=0) for name, grid in grids.items()}
        damping = np.repeat(damping, 2, axis=0)
    station = float(grids["pressure_station_m"].mean())
    arm = (station - grids["pressure_station_m"]) / a.diameter_m
    return AeroTables(
        area=float(a.area_m2),
        diameter=float(a.diameter_m),
        fin_cant=float(a.fin_cant),
        moment_station=station,
        mach=mach,
        alpha=alpha,
        axial=grids["axial"],
        normal=grids["normal_slope"],
        moment=(grids["normal_slope"] + grids["drag"]) * arm,
        drag=grids["drag"],
        damping=np.ascontiguousarray(damping),
    )


def _to_the_tail(alpha, grids):
    """Angles (k,) and {name: (n, k)} of a table over the angle, carried on to 180 deg.

    Beyond its last angle the axial force goes over to that of a table without angles, C_A(0) cos |cos|, until
    90 deg, or 180 deg if the table ends between; the others hold.
    """
    last = alpha[-1]
    if alpha.size == 1 or last >= np.pi - 1e-6:
        return alpha, grids
    more = np.append(np.arange(last + FROM_TAIL, np.pi - 0.5 * FROM_TAIL, FROM_TAIL), np.pi)
    fades = 0.5 * np.pi if last < 0.5 * np.pi else np.pi
    left = np.clip((fades - more) / (fades - last), 0.0, 1.0)
    nose, end = grids["axial"][:, :1], grids["axial"][:, -1:]
    axial = nose * _cosines(more) + (end - nose * _cosines(last)) * left
    held = {name: np.repeat(grid[:, -1:], more.size, axis=1) for name, grid in grids.items()}
    held["axial"] = axial
    return np.append(alpha, more), {name: np.hstack([grid, held[name]]) for name, grid in grids.items()}


def _cosines(alpha):
    return np.cos(alpha) * np.abs(np.cos(alpha))


@inner(forceinline=True)
def total_angle(u, v, w):
    """Total angle of attack [rad] of a velocity in body axes; 0 at rest."""
    return np.arctan2(np.sqrt(v * v + w * w), u)


@inner(error_model="numpy", forceinline=True)
def _coefficients(s, tables, mach, alpha):
    """C_A, C_N/sin(alpha), C_M/sin(alpha), C_D and the four of the damping at a Mach number and an angle."""
    j, part = place(tables, s.mach_at, s.mach_n, 1, mach)
    row = 4 * s.alpha_n
    at = s.aero_at + row * j
    k, share = 0, 0.0
    if s.alpha_n > 1:
        k, share = place(tables, s.alpha_at, s.alpha_n, 1, alpha)
        at += 4 * k
    axial, normal = mixed(tables, at, row, part), mixed(tables, at + 1, row, part)
    moment, drag = mixed(tables, at + 2, row, part), mixed(tables, at + 3, row, part)
    if share > 0.0:
        at += 4
        axial += share * (mixed(tables, at, row, part) - axial)
        normal += share * (mixed(tables, at + 1, row, part) - normal)
        moment += share * (mixed(tables, at + 2, row, part) - moment)
        drag += share * (mixed(tables, at + 3, row, part) - drag)
    at = s.damping_at + 4 * j
    pitch, yaw = mixed(tables, at, 4, part), mixed(tables, at + 1, 4, part)
    roll, cant = mixed(tables, at + 2, 4, part), mixed(tables, at + 3, 4, part)
    return axial, normal, moment, drag, pitch, yaw, roll, cant


@inner(error_model="numpy", forceinline=True)
def force_and_moment(s, tables, density, sound, station, velocity, rate):
    """Force N and moment N m about the centre of mass in body axes: six numbers.

    Parameters
    ----------
    s, tables : of the Scene
    density, sound : kg/m^3, speed of sound m/s
    station : m, of the centre of mass
    velocity : three numbers, m/s of the centre of mass relative to the air, body axes, not zero
    rate : three numbers, rad/s relative to the Earth, body axes
    """
    u, v, w = velocity
    p, q, r = rate
    speed2 = u * u + v * v + w * w
    speed = np.sqrt(speed2)
    alpha, by_angle = 0.0, u * abs(u) / speed2
    if s.alpha_n > 1:
        alpha, by_angle = total_angle(u, v, w), 1.0
    axial, normal, moment, drag, c_mq, c_nr, c_lp, c_l = _coefficients(s, tables, speed / sound, alpha)
    d = s.diameter
    force = 0.5 * density * speed2 * s.area
    along, across = -force * drag / speed, -force * (normal + drag) / speed
    fx, fy, fz = along * u - force * axial * by_angle, across * v, across * w
    turn, by_rate = force * d * moment / speed, 0.5 * force * d * d / speed
    mx = force * d * c_l * s.fin_cant + by_rate * c_lp * p
    my, mz = by_rate * c_mq * q + turn * w, by_rate * c_nr * r - turn * v
    # from the point of the moments, on the axis, to the centre of mass
    rx, ry, rz = station - s.moment_station, -s.offset[0], -s.offset[1]
    return fx, fy, fz, mx + ry * fz - rz * fy, my + rz * fx - rx * fz, mz + rx * fy - ry * fx
