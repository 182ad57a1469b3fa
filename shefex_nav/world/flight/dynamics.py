"""Equations of motion of the vehicle and their integration: everything of the flight that is compiled.

In: state, `vehicle.Configuration` of the section, `attitude_program.RateLaw`. Out: truth at the IMU rate.

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

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.gravity import gravity_e
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import dcm_ie

ON_RAIL, FREE, PROGRAMMED = 0, 1, 2  # how the attitude comes about
STATE = 19
AUX = 8  # f_b 0:3, mass 3, Mach number 4, dynamic pressure 5, thrust 6, height 7
ROW = STATE + AUX
TIME_EPS = 1e-9  # s, instants closer than this are one


class Rail(NamedTuple):
    """The launch rail, fixed to the Earth."""

    r_e: np.ndarray  # (3,) m, IMU before lift-off
    direction_e: np.ndarray  # (3,) unit
    length: float  # m, travel until the vehicle is free


class World(NamedTuple):
    """What surrounds the vehicle."""

    gravity: tuple  # environment.gravity.GravityModel
    earth: tuple  # geometry.frames.EarthRotation
    rail: Rail


@njit(cache=True)
def smooth_step(u):
    """S(u) = 10 u^3 - 15 u^4 + 6 u^5 from 0 to 1, its two derivatives and its integral from 0."""
    u = min(1.0, max(0.0, u))
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    ds = 30.0 * u**2 * (1.0 - u) ** 2
    return s, ds, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u), u**4 * (2.5 - 3.0 * u + u * u)


@njit(cache=True)
def _residual_rate(law, t_s):
    """The small motions of a `RateLaw` and their derivative: six numbers."""
    tau = t_s - law.t_0
    rise, drise, _, _ = smooth_step(tau / law.ramp)
    fall, dfall, _, _ = smooth_step((law.t_1 - t_s) / law.ramp)
    fade, dfade = rise * fall, (drise * fall - rise * dfall) / law.ramp
    c, s = np.cos(law.frequency * tau + law.phase), np.sin(law.frequency * tau + law.phase)
    a, b = law.swing[0], law.swing[1]
    x, y = law.steady[0] + c * a[0] + s * b[0], law.steady[1] + c * a[1] + s * b[1]
    z = law.steady[2] + c * a[2] + s * b[2]
    w = fade * law.frequency
    return (
        fade * x,
        fade * y,
        fade * z,
        dfade * x + w * (c * b[0] - s * a[0]),
        dfade * y + w * (c * b[1] - s * a[1]),
        dfade * z + w * (c * b[2] - s * a[2]),
    )


@njit(cache=True)
def body_rate(law, t_s):
    """omega_ib_b of a `RateLaw` and its derivative at t_s within the piece: six numbers, rad/s, rad/s^2."""
    width = law.t_1 - law.t_0
    tau = t_s - law.t_0
    s, ds, dds, integral = smooth_step(tau / width)
    change = law.spin_1 - law.spin_0
    p, dp = law.spin_0 + change * s, change * ds / width
    phi = law.spin_0 * tau + change * integral * width
    w, dw = law.angle * ds / width, law.angle * dds / width**2
    # the axis keeps its direction in space while the body spins under it
    c, sn = np.cos(phi), np.sin(phi)
    ax, ay, az = law.axis[0], c * law.axis[1] + sn * law.axis[2], c * law.axis[2] - sn * law.axis[1]
    # transverse rate at the start, nutating and damped
    c, sn = np.cos(law.nutation * tau), np.sin(law.nutation * tau)
    ty, tz = c * law.transverse[1] - sn * law.transverse[2], sn * law.transverse[1] + c * law.transverse[2]
    left, dleft = 1.0 - s, -ds / width
    x, y, z, dx, dy, dz = _residual_rate(law, t_s)
    return (
        x + p + w * ax,
        y + w * ay + left * ty,
        z + w * az + left * tz,
        dx + dp + dw * ax,
        dy + dw * ay + w * p * az + dleft * ty - left * law.nutation * tz,
        dz + dw * az - w * p * ay + dleft * tz + left * law.nutation * ty,
    )


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


@njit(cache=True)
def _times(C, x, y, z):
    """C @ (x, y, z)."""
    return (
        C[0, 0] * x + C[0, 1] * y + C[0, 2] * z,
        C[1, 0] * x + C[1, 1] * y + C[1, 2] * z,
        C[2, 0] * x + C[2, 1] * y + C[2, 2] * z,
    )


@njit(cache=True)
def _transposed_times(C, x, y, z):
    """C.T @ (x, y, z)."""
    return (
        C[0, 0] * x + C[1, 0] * y + C[2, 0] * z,
        C[0, 1] * x + C[1, 1] * y + C[2, 1] * z,
        C[0, 2] * x + C[1, 2] * y + C[2, 2] * z,
    )


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
def position_e(earth, t_s, r_i, r_e):
    """Write the position in frame e into r_e: frames.dcm_ie(earth, t_s).T @ r_i."""
    angle = earth.angle_0 + earth.rate * t_s
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = _transposed_times(earth.C_iq, r_i[0], r_i[1], r_i[2])
    r_e[0], r_e[1], r_e[2] = _transposed_times(earth.C_re, c * x + s * y, c * y - s * x, z)


@njit(cache=True)
def _gravity_i(world, t_s, r_e):
    """Gravitation at r_e in inertial components: three numbers, m/s^2."""
    g_e = gravity_e(world.gravity, r_e)
    earth = world.earth
    angle = earth.angle_0 + earth.rate * t_s
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = _times(earth.C_re, g_e[0], g_e[1], g_e[2])
    return _times(earth.C_iq, c * x - s * y, s * x + c * y, z)


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
    return _transposed_times(
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
    nx, ny, nz = _transposed_times(C, x[0], x[1], x[2])
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
def derivative(t_s, x, mode, law, configuration, world, work, rate, aux):
    """Time derivative of the state into rate (19,), f_b and air data into aux (8,).

    work: (4, 3) to work in. In a programmed section omega_ib_b in x is overwritten by the programme's.
    """
    earth, r_e, C = world.earth, work[3], work[:3]
    position_e(earth, t_s, x[0:3], r_e)
    gx, gy, gz = _gravity_i(world, t_s, r_e)
    _, _, height = wgs84.geodetic_from_ecef(r_e)
    density, pressure, _, sound = us76(height)
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
    u, v, w = _transposed_times(C, x[3] - wx, x[4] - wy, x[5] - wz)
    ex, ey, ez = _transposed_times(C, ex, ey, ez)
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
    ax, ay, az = _times(C, fx, fy, fz)
    rate[0:3] = x[3:6]
    rate[3], rate[4], rate[5] = ax + gx, ay + gy, az + gz
    rate[6] = 0.5 * (-x[7] * p - x[8] * q - x[9] * r)
    rate[7] = 0.5 * (x[6] * p + x[8] * r - x[9] * q)
    rate[8] = 0.5 * (x[6] * q + x[9] * p - x[7] * r)
    rate[9] = 0.5 * (x[6] * r + x[7] * q - x[8] * p)
    rate[10], rate[11], rate[12] = alpha_x, alpha_y, alpha_z
    rate[13], rate[14], rate[15] = p, q, r
    rate[16], rate[17], rate[18] = fx, fy, fz
    aux[0], aux[1], aux[2] = fx, fy, fz
    aux[3], aux[4], aux[5], aux[6], aux[7] = mass, mach, q_dynamic, push, height


@njit(cache=True)
def _step(t_s, h, x, mode, law, configuration, world, work, new, aux):
    """One step of the classical Runge-Kutta method from x into new; aux gets f_b and air data at t_s."""
    rate, total, other, small = work[0], work[1], work[2, :AUX], work[3, :12].reshape(4, 3)
    new[:] = x
    total[:] = 0.0
    for stage in range(4):
        at = 0.0 if stage == 0 else (h if stage == 3 else 0.5 * h)
        derivative(t_s + at, new, mode, law, configuration, world, small, rate, aux if stage == 0 else other)
        weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
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
    position_e(world.earth, t_s, x[0:3], r_e)
    if mode == ON_RAIL:
        rail = world.rail
        travel = 0.0
        for j in range(3):
            travel += (r_e[j] - rail.r_e[j]) * rail.direction_e[j]
        return travel - rail.length
    _, _, height = wgs84.geodetic_from_ecef(r_e)
    return -height


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


@njit(cache=True)
def _gravitation(world, t_s, r_i):
    """Gravitation at an inertial position: (3,) m -> (3,) m/s^2, frame i."""
    C_ie = dcm_ie(world.earth, t_s)
    return C_ie @ gravity_e(world.gravity, C_ie.T @ r_i)


@njit(cache=True)
def free_fall(world, t_s, r_i, v_i, t_end):
    """(r_i, v_i) at t_end under gravitation alone; Runge-Kutta-Nystrom with steps of at most 1 s."""
    n = max(1, int(np.ceil(abs(t_end - t_s))))
    h = (t_end - t_s) / n
    r, v = r_i.copy(), v_i.copy()
    for step in range(n):
        t = t_s + step * h
        g1 = _gravitation(world, t, r)
        g2 = _gravitation(world, t + 0.5 * h, r + 0.5 * h * v + 0.125 * h * h * g1)
        g3 = _gravitation(world, t + h, r + h * v + 0.5 * h * h * g2)
        r = r + h * v + h * h / 6.0 * (g1 + 2.0 * g2)
        v = v + h / 6.0 * (g1 + 4.0 * g2 + g3)
    return r, v
