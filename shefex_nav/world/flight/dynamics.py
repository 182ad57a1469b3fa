"""Equations of motion of the vehicle and their integration.

In: state, `vehicle.Configuration` of the section, `attitude_program.RateLaw`, `surroundings.World`. Out:
truth at the IMU rate.

The state is that of the IMU, a point fixed in the body, not of the centre of mass, which moves as propellant
burns and jumps at staging. For a body of varying mass (solidification principle: Meirovitch, J. Spacecraft
and Rockets 7, 1970; Eke & Wang, ASME J. Appl. Mech. 61, 1994) the point that is the centre of mass at this
instant obeys a_cg = F/m + g, and the IMU, from which the centre of mass lies at l,
    a_b = a_cg - C_ib (alpha x l + omega x (omega x l)),   f_b = C_bi (a_b - g(r_b)).
F holds thrust, aerodynamic force and the Coriolis force of the gas on its way through the motor; the gas is
taken to keep its angular momentum about the roll axis. No wind, no gravity-gradient torque.

State vector (19,): r_i 0:3, v_i 3:6, q_ib 6:10, omega_ib_b 10:13, and the integrals since the last sample of
omega_ib_b 13:16 and f_b 16:19 in the turning body frame: what ideal gyros and accelerometers put out.

Vectors are written out in components: arrays this small cost more to allocate than to compute.
"""

import numpy as np
from numba import njit

from shefex_nav.environment.atmosphere import us76
from shefex_nav.world.flight.attitude_program import body_rate
from shefex_nav.world.flight.surroundings import (
    coarse_gravity_i,
    fine_gravity_i,
    height,
    position_e,
    times,
    transposed_times,
    turned,
)
from shefex_nav.world.flight.vehicle import mass_properties, thrust

ON_RAIL, FREE, PROGRAMMED = 0, 1, 2  # how the attitude comes about
STATE = 19
AUX = 8  # f_b 0:3, mass 3, Mach number 4, dynamic pressure 5, thrust 6, height 7
ROW = STATE + AUX
TIME_EPS = 1e-9  # s, instants closer than this are one


@njit(cache=True)
def _cross(ax, ay, az, bx, by, bz):
    """a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True)
def _attitude(x, C):
    """Write C_ib of the state into C (3, 3)."""
    w, a, b, c = x[6], x[7], x[8], x[9]
    C[0, 0], C[0, 1], C[0, 2] = 1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b - w * c), 2.0 * (a * c + w * b)
    C[1, 0], C[1, 1], C[1, 2] = 2.0 * (a * b + w * c), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c - w * a)
    C[2, 0], C[2, 1], C[2, 2] = 2.0 * (a * c - w * b), 2.0 * (b * c + w * a), 1.0 - 2.0 * (a * a + b * b)


@njit(cache=True)
def _coefficients(table, mach):
    """Row of the aerodynamic table at a Mach number, linear in between, constant outside: six numbers."""
    last = table.shape[0] - 2
    k = 0
    while k < last and mach >= table[k + 1, 0]:
        k += 1
    part = min(1.0, max(0.0, (mach - table[k, 0]) / (table[k + 1, 0] - table[k, 0])))
    rest = 1.0 - part
    return (
        rest * table[k, 1] + part * table[k + 1, 1],
        rest * table[k, 2] + part * table[k + 1, 2],
        rest * table[k, 3] + part * table[k + 1, 3],
        rest * table[k, 4] + part * table[k + 1, 4],
        rest * table[k, 5] + part * table[k + 1, 5],
        rest * table[k, 6] + part * table[k + 1, 6],
    )


@njit(cache=True)
def _aerodynamics(configuration, station, density, sound, u, v, w, p, q, r):
    """Aerodynamic force and moment about the centre of mass in body axes, Mach number, dynamic pressure.

    u, v, w: velocity of the centre of mass relative to the air in body axes; p, q, r: relative rate.
    Normal force C_N,alpha sin(alpha) against the cross flow at the centre of pressure, axial force
    C_A cos(alpha) |cos(alpha)|, damping proportional to omega d/(2V).
    """
    speed2 = u * u + v * v + w * w
    speed = np.sqrt(speed2)
    mach = speed / sound
    q_dynamic = 0.5 * density * speed2
    if q_dynamic <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, mach, q_dynamic
    axial, normal, x_cp, pitch_damping, roll_damping, roll_by_cant = _coefficients(configuration.aero, mach)
    d = configuration.diameter
    force = q_dynamic * configuration.area
    fx = -force * axial * u * abs(u) / speed2
    fy, fz = -force * normal * v / speed, -force * normal * w / speed
    arm = x_cp - station
    by_rate = 0.5 * force * d * d / speed
    mx = force * d * roll_by_cant * configuration.fin_cant + by_rate * roll_damping * p
    return (
        fx,
        fy,
        fz,
        mx,
        arm * fz + by_rate * pitch_damping * q,
        -arm * fy + by_rate * pitch_damping * r,
        mach,
        q_dynamic,
    )


@njit(cache=True)
def _motor(configuration, vacuum_thrust, pressure, station, grain_k2, q, r):
    """Thrust against ambient pressure, Coriolis force of the gas, coefficient of the jet damping.

    Gas that goes from the grain at x_p to the exit at x_e, flow mu, in a body that turns: force
    -2 mu omega x (r_e - r_p), moment -mu ((x_e - x)^2 - (x_p - x)^2 - k^2) omega across the roll axis, k the
    radius of gyration of the burning surface. Both follow from -2 int rho omega x v dV for steady flow.
    """
    if vacuum_thrust <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    c = configuration
    flow = vacuum_thrust / c.exhaust_speed
    push = max(0.0, vacuum_thrust - c.exit_area * pressure)
    across = 2.0 * flow * (c.exit_station - c.grain_station)
    damping = flow * ((c.exit_station - station) ** 2 - (c.grain_station - station) ** 2 - grain_k2)
    return push, across * r, -across * q, damping


@njit(cache=True)
def _on_rail(x, C, earth, gx, gy, gz, push):
    """Specific force in body axes while the rail allows motion along itself only; push: F_x/m.

    s'' = F_x/m + u . (g - omega x (omega x r)) along the rail u, never backwards from rest.
    """
    ex, ey, ez = earth.C_iq[0, 2] * earth.rate, earth.C_iq[1, 2] * earth.rate, earth.C_iq[2, 2] * earth.rate
    vx, vy, vz = _cross(ex, ey, ez, x[0], x[1], x[2])
    cx, cy, cz = _cross(ex, ey, ez, vx, vy, vz)
    ux, uy, uz = C[0, 0], C[1, 0], C[2, 0]
    along = push + ux * (gx - cx) + uy * (gy - cy) + uz * (gz - cz)
    speed = ux * (x[3] - vx) + uy * (x[4] - vy) + uz * (x[5] - vz)
    if speed < 1e-6 and along < 0.0:
        along = 0.0
    kx, ky, kz = _cross(ex, ey, ez, ux, uy, uz)
    return transposed_times(
        C,
        ux * along + cx + 2.0 * speed * kx - gx,
        uy * along + cy + 2.0 * speed * ky - gy,
        uz * along + cz + 2.0 * speed * kz - gz,
    )


@njit(cache=True)
def _at_imu(x, C, gm, lx, ly, lz, ax, ay, az):
    """f_b(IMU) - F/m: what the rotation and the gradient of gravitation make of the distance l to the IMU.

    a: angular acceleration. The gradient is that of a point mass: good to 1e-7 m/s^2 over a few metres.
    """
    p, q, r = x[10], x[11], x[12]
    nx, ny, nz = transposed_times(C, x[0], x[1], x[2])
    r2 = nx * nx + ny * ny + nz * nz
    k = gm / (r2 * np.sqrt(r2))
    ln = 3.0 * (lx * nx + ly * ny + lz * nz) / r2
    tx, ty, tz = _cross(ax, ay, az, lx, ly, lz)
    wl, w2 = p * lx + q * ly + r * lz, p * p + q * q + r * r
    return (
        -tx - (p * wl - w2 * lx) - k * (lx - ln * nx),
        -ty - (q * wl - w2 * ly) - k * (ly - ln * ny),
        -tz - (r * wl - w2 * lz) - k * (lz - ln * nz),
    )


@njit(cache=True)
def derivative(t_s, x, mode, law, configuration, world, fine, work, rate, aux):
    """Time derivative of the state into rate (19,), f_b and air data into aux (8,).

    fine: three numbers, m/s^2, the gravitation in inertial components that the closed form lacks.
    work: (4, 3) to work in. In a programmed section omega_ib_b in x is overwritten by the programme's.
    """
    earth, r_e, C = world.earth, work[3], work[:3]
    c, s = turned(earth, t_s)
    position_e(earth, c, s, x[0], x[1], x[2], r_e)
    gx, gy, gz = coarse_gravity_i(earth, c, s, r_e)
    gx, gy, gz = gx + fine[0], gy + fine[1], gz + fine[2]
    height_m = height(r_e)
    density, pressure, _, sound = us76(height_m)
    alpha_x, alpha_y, alpha_z = 0.0, 0.0, 0.0
    if mode == PROGRAMMED:
        x[10], x[11], x[12], alpha_x, alpha_y, alpha_z = body_rate(law, t_s)
    p, q, r = x[10], x[11], x[12]
    _attitude(x, C)
    vacuum_thrust, propellant = thrust(configuration, t_s)
    mass, station, i_roll, i_pitch, grain_k2 = mass_properties(configuration, propellant)
    lx, ly, lz = -station - configuration.imu[0], -configuration.imu[1], -configuration.imu[2]

    # the air turns with the Earth
    ex, ey, ez = earth.C_iq[0, 2] * earth.rate, earth.C_iq[1, 2] * earth.rate, earth.C_iq[2, 2] * earth.rate
    wx, wy, wz = _cross(ex, ey, ez, x[0], x[1], x[2])
    u, v, w = transposed_times(C, x[3] - wx, x[4] - wy, x[5] - wz)
    ex, ey, ez = transposed_times(C, ex, ey, ez)
    ex, ey, ez = p - ex, q - ey, r - ez
    wx, wy, wz = _cross(ex, ey, ez, lx, ly, lz)
    fx, fy, fz, mx, my, mz, mach, q_dynamic = _aerodynamics(
        configuration, station, density, sound, u + wx, v + wy, w + wz, ex, ey, ez
    )
    push, side_y, side_z, damping = _motor(configuration, vacuum_thrust, pressure, station, grain_k2, q, r)
    fx, fy, fz = (fx + push) / mass, (fy + side_y) / mass, (fz + side_z) / mass

    if mode == ON_RAIL:
        fx, fy, fz = _on_rail(x, C, earth, gx, gy, gz, fx)
    else:
        if mode == FREE:
            alpha_x = mx / i_roll
            alpha_y = (my - damping * q + (i_pitch - i_roll) * p * r) / i_pitch
            alpha_z = (mz - damping * r - (i_pitch - i_roll) * p * q) / i_pitch
        dx, dy, dz = _at_imu(x, C, world.gravity.gm, lx, ly, lz, alpha_x, alpha_y, alpha_z)
        fx, fy, fz = fx + dx, fy + dy, fz + dz
    ax, ay, az = times(C, fx, fy, fz)
    rate[0], rate[1], rate[2] = x[3], x[4], x[5]
    rate[3], rate[4], rate[5] = ax + gx, ay + gy, az + gz
    rate[6] = 0.5 * (-x[7] * p - x[8] * q - x[9] * r)
    rate[7] = 0.5 * (x[6] * p + x[8] * r - x[9] * q)
    rate[8] = 0.5 * (x[6] * q + x[9] * p - x[7] * r)
    rate[9] = 0.5 * (x[6] * r + x[7] * q - x[8] * p)
    rate[10], rate[11], rate[12] = alpha_x, alpha_y, alpha_z
    rate[13], rate[14], rate[15] = p, q, r
    rate[16], rate[17], rate[18] = fx, fy, fz
    aux[0], aux[1], aux[2] = fx, fy, fz
    aux[3], aux[4], aux[5], aux[6], aux[7] = mass, mach, q_dynamic, push, height_m


@njit(cache=True)
def _step(t_s, h, x, mode, law, configuration, world, work, new, aux):
    """One step of the classical Runge-Kutta method from x into new; aux gets f_b and air data at t_s."""
    rate, total, other, small = work[0], work[1], work[2, :AUX], work[3, :12].reshape(4, 3)
    half = 0.5 * h
    fine = fine_gravity_i(
        world, t_s + half, x[0] + half * x[3], x[1] + half * x[4], x[2] + half * x[5], small[3]
    )
    new[:] = x
    total[:] = 0.0
    for stage in range(4):
        at = 0.0 if stage == 0 else (h if stage == 3 else half)
        air = aux if stage == 0 else other
        derivative(t_s + at, new, mode, law, configuration, world, fine, small, rate, air)
        weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
        ahead = h if stage == 2 else half
        for j in range(STATE):
            total[j] += weight * rate[j]
            new[j] = x[j] + ahead * rate[j]
    for j in range(STATE):
        new[j] = x[j] + total[j]
    norm = np.sqrt(new[6] ** 2 + new[7] ** 2 + new[8] ** 2 + new[9] ** 2)
    for j in range(6, 10):
        new[j] /= norm


@njit(cache=True)
def _until_end(t_s, x, mode, world, r_e):
    """Negative until the section's event, the end of the rail or the ground; m."""
    c, s = turned(world.earth, t_s)
    position_e(world.earth, c, s, x[0], x[1], x[2], r_e)
    if mode == ON_RAIL:
        rail = world.rail
        travel = 0.0
        for j in range(3):
            travel += (r_e[j] - rail.r_e[j]) * rail.direction_e[j]
        return travel - rail.length
    return -height(r_e)


@njit(cache=True)
def integrate(x, t_s, t_end, k, t_start, dt, mode, law, configuration, world, rows):
    """Integrate one section from t_s until t_end or until its event: (time, next sample, by event).

    Parameters
    ----------
    x : (19,) state, advanced in place
    k : index of the next sample; sample k is at t_start + k dt and goes to rows[k] as state and aux, with
        the values that hold just after it where they jump
    mode : ON_RAIL, FREE or PROGRAMMED
    """
    new, aux, work = np.empty(STATE), np.empty(AUX), np.empty((4, STATE))
    while t_s < t_end - TIME_EPS:
        is_sample = abs(t_s - (t_start + k * dt)) < TIME_EPS
        if is_sample:
            rows[k, :STATE] = x
            x[13:] = 0.0
        t_next = min(t_start + (k + 1 if is_sample else k) * dt, t_end)
        for corner in configuration.corners:
            if t_s + TIME_EPS < corner < t_next - TIME_EPS:
                t_next = corner
        low, high = 0.0, t_next - t_s
        h = high
        while True:  # the step, or its halving down to the event
            _step(t_s, h, x, mode, law, configuration, world, work, new, aux)
            if mode == PROGRAMMED or _until_end(t_s + h, new, mode, world, work[3, :3]) < 0.0:
                low = h
            else:
                high = h
            if high - low < 1e-3 * TIME_EPS:
                break
            h = 0.5 * (low + high)
        if is_sample:
            rows[k, STATE:] = aux
            k += 1
        by_event = low < t_next - t_s
        x[:] = new
        if by_event:
            return t_s + h, k, True
        t_s = t_next
    return t_end, k, False
