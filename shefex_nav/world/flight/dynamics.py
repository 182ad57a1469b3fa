"""Equations of motion of the vehicle.

In: state, `scene.Scene` of the section, `attitude_program.RateLaw`. Out: the time derivative of the state,
and what an accelerometer and an air data sensor would sense.

The state is that of the IMU, a point fixed in the body, not of the centre of mass, which moves as propellant
burns and jumps at staging. For a body of varying mass (solidification principle: Meirovitch, J. Spacecraft
and Rockets 7, 1970; Eke & Wang, ASME J. Appl. Mech. 61, 1994) the point that is the centre of mass at this
instant obeys a_cg = F/m + g, and the IMU, from which the centre of mass lies at l,
    a_b = a_cg - C_ib (alpha x l + omega x (omega x l)),   f_b = C_bi (a_b - g(r_b)).
F holds thrust, aerodynamic force, the pull of a parachute, and the Coriolis force of the gas on its way
through the motor; the gas is taken to keep its angular momentum about the roll axis. No gravity-gradient
torque.

State vector (19,): r_i 0:3, v_i 3:6, q_ib 6:10, omega_ib_b 10:13, and the integrals since the last sample of
omega_ib_b 13:16 and f_b 16:19 in the turning body frame: what ideal gyros and accelerometers put out.

Vectors are written out in components: arrays this small cost more to allocate than to compute. The functions
are compiled into those that call them: handed over through memory, the tuples took an eighth of a flight.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.world.flight.aerodynamics import force_and_moment, total_angle
from shefex_nav.world.flight.attitude_program import RateLaw, body_rate
from shefex_nav.world.flight.devices import yo_yo_acceleration
from shefex_nav.world.flight.surroundings import (
    air,
    coarse_gravity,
    earth_angle,
    level,
    position_e,
    times,
    to_inertial,
    transposed_times,
    wind_e,
)
from shefex_nav.world.flight.vehicle import mass_properties, thrust

ON_RAIL, FREE, PROGRAMMED, CONTROLLED = 0, 1, 2, 3  # how the attitude comes about
STATE = 19
AUX = 9  # f_b 0:3, mass 3, Mach number 4, dynamic pressure 5, thrust 6, height 7, total angle of attack 8
ROW = STATE + AUX


class Section(NamedTuple):
    """A section of the flight as the kernels see it."""

    mode: int  # ON_RAIL, FREE, PROGRAMMED or CONTROLLED
    law: RateLaw  # followed in the mode PROGRAMMED
    s: np.ndarray  # one row of `scene.RECORD`, its rows of tables chosen (`vehicle.choose_rows`)
    tables: np.ndarray  # (n,) of the Scene


class Around(NamedTuple):
    """What is around the vehicle. The wind and all other vectors here: three numbers, frame i."""

    height_m: float  # above the ellipsoid
    density: float  # kg/m^3
    pressure: float  # Pa
    sound: float  # m/s
    wind: tuple  # m/s


@inner(error_model="numpy", forceinline=True)
def cross(ax, ay, az, bx, by, bz):
    """a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inner(error_model="numpy", forceinline=True)
def write_attitude(x, C):
    """Write C_ib of the state into C (3, 3)."""
    w, a, b, c = x[6], x[7], x[8], x[9]
    C[0, 0], C[0, 1], C[0, 2] = 1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b - w * c), 2.0 * (a * c + w * b)
    C[1, 0], C[1, 1], C[1, 2] = 2.0 * (a * b + w * c), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c - w * a)
    C[2, 0], C[2, 1], C[2, 2] = 2.0 * (a * c - w * b), 2.0 * (b * c + w * a), 1.0 - 2.0 * (a * a + b * b)


@inner(error_model="numpy", forceinline=True)
def _relative_to_air(x, s, wind, lx, ly, lz):
    """Velocity of the centre of mass, at l from the IMU, relative to the air, and rate relative to the Earth.

    Three numbers each, body axes. The air turns with the Earth, and the wind comes on top.
    """
    wx, wy, wz = s.C_iq[0, 2] * s.rate, s.C_iq[1, 2] * s.rate, s.C_iq[2, 2] * s.rate
    vx, vy, vz = cross(wx, wy, wz, x[0], x[1], x[2])
    u, v, w = transposed_times(s.C, x[3] - vx - wind[0], x[4] - vy - wind[1], x[5] - vz - wind[2])
    wx, wy, wz = transposed_times(s.C, wx, wy, wz)
    p, q, r = x[10] - wx, x[11] - wy, x[12] - wz
    vx, vy, vz = cross(p, q, r, lx, ly, lz)
    return (u + vx, v + vy, w + vz), (p, q, r)


@inner(error_model="numpy", forceinline=True)
def _parachute(s, t_s, density, arm, velocity, rate):
    """Force of the parachute in body axes; arm: from the centre of mass to where its lines are fixed.

    It pulls against the motion of that place; its area grows evenly while it fills.
    """
    since = t_s - s.parachute[0]
    area = s.parachute[2]
    if since < s.parachute[1]:
        area *= since / s.parachute[1]
    wx, wy, wz = cross(rate[0], rate[1], rate[2], arm[0], arm[1], arm[2])
    u, v, w = velocity[0] + wx, velocity[1] + wy, velocity[2] + wz
    k = -0.5 * density * np.sqrt(u * u + v * v + w * w) * area
    return k * u, k * v, k * w


@inner(error_model="numpy", forceinline=True)
def _motor(s, body, vacuum_thrust, pressure, q, r):
    """Force and moment of the motor about the centre of mass, body axes, and the thrust as it is: 7 numbers.

    Gas that goes from the burning surface at the station x_p to the exit at x_e, flow mu, in a body that
    turns, `vehicle.MassProperties`: force -2 mu omega x (r_e - r_p), and across the roll axis the moment
    -mu ((x_e - x)^2 - dI/dm) omega, where dI/dm = (x_p - x)^2 + k^2 with k the radius of gyration of the
    burning surface. Both follow from -2 int rho omega x v dV for steady flow.
    """
    if vacuum_thrust <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    push = max(0.0, vacuum_thrust - s.exit_area * pressure)
    fx, fy, fz = push * s.thrust_axis[0], push * s.thrust_axis[1], push * s.thrust_axis[2]
    ry, rz = s.thrust_offset[0] - s.offset[0], s.thrust_offset[1] - s.offset[1]
    mx, my, mz = cross(body.station - s.exit_station, ry, rz, fx, fy, fz)
    flow = s.gas * vacuum_thrust / s.exhaust_speed
    across = 2.0 * flow * (s.exit_station - body.x_burning)
    reach2 = (s.exit_station - body.station) ** 2
    my -= flow * (reach2 - body.di_y) * q
    mz -= flow * (reach2 - body.di_z) * r
    return fx, fy + across * r, fz - across * q, mx, my, mz, push


@inner(error_model="numpy", forceinline=True)
def _outside(s, tables, t_s, density, sound, station, velocity, rate):
    """Force and moment about the centre of mass, body axes, of air, parachute, spin motors: six numbers."""
    fx, fy, fz, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    moving = velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2 > 0.0
    if density > 0.0 and moving:
        fx, fy, fz, mx, my, mz = force_and_moment(s, tables, density, sound, station, velocity, rate)
    if t_s >= s.parachute[0]:
        arm = (station - s.parachute[3], -s.offset[0], -s.offset[1])
        px, py, pz = _parachute(s, t_s, density, arm, velocity, rate)
        tx, ty, tz = cross(arm[0], arm[1], arm[2], px, py, pz)
        fx, fy, fz, mx, my, mz = fx + px, fy + py, fz + pz, mx + tx, my + ty, mz + tz
    for k in range(s.spin_motors_n):
        at = s.spin_motors_at + 3 * k
        if tables[at] <= t_s < tables[at + 1]:
            mx += tables[at + 2]
    return fx, fy, fz, mx, my, mz


@inner(error_model="numpy", forceinline=True)
def _angular_acceleration(x, s, inertia, moment):
    """I^-1 (M - omega x I omega) for the full inertia tensor: three numbers."""
    p, q, r = x[10], x[11], x[12]
    i_x, i_y, i_z = inertia
    j_xy, j_xz, j_yz = s.products[0], s.products[1], s.products[2]
    hx, hy, hz = i_x * p + j_xy * q + j_xz * r, j_xy * p + i_y * q + j_yz * r, j_xz * p + j_yz * q + i_z * r
    tx, ty, tz = cross(p, q, r, hx, hy, hz)
    mx, my, mz = moment[0] - tx, moment[1] - ty, moment[2] - tz
    a_xx, a_yy, a_zz = i_y * i_z - j_yz * j_yz, i_x * i_z - j_xz * j_xz, i_x * i_y - j_xy * j_xy
    a_xy, a_xz, a_yz = j_xz * j_yz - j_xy * i_z, j_xy * j_yz - j_xz * i_y, j_xy * j_xz - j_yz * i_x
    d = 1.0 / (i_x * a_xx + j_xy * a_xy + j_xz * a_xz)
    return (
        d * (a_xx * mx + a_xy * my + a_xz * mz),
        d * (a_xy * mx + a_yy * my + a_yz * mz),
        d * (a_xz * mx + a_yz * my + a_zz * mz),
    )


@inner(error_model="numpy", forceinline=True)
def _on_rail(x, s, gx, gy, gz, push):
    """Specific force in body axes while the rail allows motion along itself only; push: F_x/m.

    s'' = F_x/m + u . (g - omega x (omega x r)) along the rail u, never backwards from rest.
    """
    ex, ey, ez = s.C_iq[0, 2] * s.rate, s.C_iq[1, 2] * s.rate, s.C_iq[2, 2] * s.rate
    vx, vy, vz = cross(ex, ey, ez, x[0], x[1], x[2])
    cx, cy, cz = cross(ex, ey, ez, vx, vy, vz)
    ux, uy, uz = s.C[0, 0], s.C[1, 0], s.C[2, 0]
    along = push + ux * (gx - cx) + uy * (gy - cy) + uz * (gz - cz)
    speed = ux * (x[3] - vx) + uy * (x[4] - vy) + uz * (x[5] - vz)
    if speed < 1e-6 and along < 0.0:
        along = 0.0
    kx, ky, kz = cross(ex, ey, ez, ux, uy, uz)
    return transposed_times(
        s.C,
        ux * along + cx + 2.0 * speed * kx - gx,
        uy * along + cy + 2.0 * speed * ky - gy,
        uz * along + cz + 2.0 * speed * kz - gz,
    )


@inner(error_model="numpy", forceinline=True)
def _at_imu(x, s, lx, ly, lz, ax, ay, az):
    """f_b(IMU) - F/m: what the rotation and the gradient of gravitation make of the distance l to the IMU.

    a: angular acceleration. The gradient is that of a point mass: good to 1e-7 m/s^2 over a few metres.
    """
    p, q, r = x[10], x[11], x[12]
    nx, ny, nz = transposed_times(s.C, x[0], x[1], x[2])
    r2 = nx * nx + ny * ny + nz * nz
    k = s.gm / (r2 * np.sqrt(r2))
    ln = 3.0 * (lx * nx + ly * ny + lz * nz) / r2
    tx, ty, tz = cross(ax, ay, az, lx, ly, lz)
    wl, w2 = p * lx + q * ly + r * lz, p * p + q * q + r * r
    return (
        -tx - (p * wl - w2 * lx) - k * (lx - ln * nx),
        -ty - (q * wl - w2 * ly) - k * (ly - ln * ny),
        -tz - (r * wl - w2 * lz) - k * (lz - ln * nz),
    )


@inner(error_model="numpy", forceinline=True)
def _around(t_s, x, s, tables, fine):
    """Gravitation in frame i, three numbers, m/s^2, and Around."""
    turn = earth_angle(s, t_s)
    ex, ey, ez = position_e(s, turn, x[0], x[1], x[2])
    gx, gy, gz = coarse_gravity(s, ex, ey, ez)
    gx, gy, gz = to_inertial(s, turn, gx, gy, gz)
    height_m, sine, cosine = level(s.a, s.e2, ex, ey, ez)
    density, pressure, sound = air(s, tables, height_m)
    wx, wy, wz = 0.0, 0.0, 0.0
    if s.wind_n > 0:
        wx, wy, wz = wind_e(s, tables, t_s, height_m, sine, cosine, ex, ey)
        wx, wy, wz = to_inertial(s, turn, wx, wy, wz)
    gravitation = gx + fine[0], gy + fine[1], gz + fine[2]
    return gravitation, Around(height_m, density, pressure, sound, (wx, wy, wz))


@inner(error_model="numpy", forceinline=True)
def _acting(t_s, x, s, tables, around):
    """What acts on the vehicle but gravitation, and on what; body axes, three numbers each unless said.

    Way from the IMU to the centre of mass m, velocity relative to the air m/s, force over mass m/s^2, moment
    about the centre of mass N m, I_x, I_y, I_z kg m^2, and mass kg and thrust N, two numbers.
    """
    vacuum, left = thrust(s, tables, t_s)
    body = mass_properties(s, tables, left)
    lever = (-body.station - s.imu[0], s.offset[0] - s.imu[1], s.offset[1] - s.imu[2])
    velocity, turning = _relative_to_air(x, s, around.wind, lever[0], lever[1], lever[2])
    fx, fy, fz, mx, my, mz = _outside(
        s, tables, t_s, around.density, around.sound, body.station, velocity, turning
    )
    px, py, pz, nx, ny, nz, push = _motor(s, body, vacuum, around.pressure, x[11], x[12])
    mx += nx + s.torque[0] + body.i_x * yo_yo_acceleration(s.yo_yo, t_s)
    force = ((fx + px) / body.mass, (fy + py) / body.mass, (fz + pz) / body.mass)
    moment = (mx, my + ny + s.torque[1], mz + nz + s.torque[2])
    return lever, velocity, force, moment, (body.i_x, body.i_y, body.i_z), (body.mass, push)


@inner(error_model="numpy")
def derivative(t_s, x, section, fine, rate, aux):
    """Time derivative of the state into rate (19,), f_b and air data into aux (9,).

    That of the attitude, 6:10, is left to the integration, which knows how to turn.

    Parameters
    ----------
    x : (19,) state; in a programmed section its omega_ib_b is overwritten by the programme's
    section : Section
    fine : three numbers, m/s^2, the gravitation in inertial components that the closed form lacks
    """
    mode, law, s, tables = section
    (gx, gy, gz), around = _around(t_s, x, s, tables, fine)
    ax, ay, az = 0.0, 0.0, 0.0
    if mode == PROGRAMMED:
        x[10], x[11], x[12], ax, ay, az = body_rate(law, t_s)
    write_attitude(x, s.C)
    lever, velocity, force, moment, inertia, (mass, push) = _acting(t_s, x, s, tables, around)
    if mode == ON_RAIL:
        fx, fy, fz = _on_rail(x, s, gx, gy, gz, force[0])
    else:
        if mode != PROGRAMMED:
            ax, ay, az = _angular_acceleration(x, s, inertia, moment)
        dx, dy, dz = _at_imu(x, s, lever[0], lever[1], lever[2], ax, ay, az)
        fx, fy, fz = force[0] + dx, force[1] + dy, force[2] + dz
    nx, ny, nz = times(s.C, fx, fy, fz)
    rate[0], rate[1], rate[2] = x[3], x[4], x[5]
    rate[3], rate[4], rate[5] = nx + gx, ny + gy, nz + gz
    rate[10], rate[11], rate[12] = ax, ay, az
    rate[13], rate[14], rate[15] = x[10], x[11], x[12]
    rate[16], rate[17], rate[18] = fx, fy, fz
    u, v, w = velocity
    speed2 = u * u + v * v + w * w
    aux[0], aux[1], aux[2] = fx, fy, fz
    aux[3], aux[4], aux[5] = mass, np.sqrt(speed2) / around.sound, 0.5 * around.density * speed2
    aux[6], aux[7], aux[8] = push, around.height_m, total_angle(u, v, w)
