"""Devices that act once: yo-yo despin, spin motors, separation, parachute.

In: their parameters and the state in which they find the vehicle. Out: the rows of a `vehicle.Configuration`
that describe their action, and the velocities and rates that a separation leaves.

Yo-yo: two masses of together m on cords that were wound around a cylinder of radius R fly off and draw the
spin out of the vehicle. J. V. Fedor, Theory and design curves for a yo-yo de-spin mechanism for
satellites, NASA TN D-708 (1961). While the cord of free length l leaves
the cylinder along its tangent, conservation of energy and of angular momentum make it unwind at the constant
rate omega_0 of the spin before, l = R omega_0 t, whatever the masses, and leave the spin
    omega = omega_0 (K - l^2) / (K + l^2),   K = R^2 + I_x/m.
The cords let go when they are off the cylinder, still tangential. The masses are not part of the mass and
inertia of the vehicle as described: they weigh less than those are known. The unwinding is taken to happen
about the roll axis alone.
"""

import numpy as np

from shefex_nav.compiled import inner

NEVER = np.inf


@inner
def yo_yo_spin(yo_yo, t_s):
    """Spin over the spin at release, and its time derivative [1/s], of a row of `yo_yo_row` at t_s."""
    start, end, spin, k = yo_yo[0], yo_yo[1], yo_yo[2], yo_yo[3]
    if not start <= t_s < end:
        return 1.0, 0.0
    s = spin * (t_s - start)  # unwound length over R
    return (k - s * s) / (k + s * s), -4.0 * k * spin * s / (k + s * s) ** 2


@inner
def yo_yo_acceleration(yo_yo, t_s):
    """Roll acceleration [rad/s^2] at t_s by a yo-yo (4,); zero before its release and once it is off."""
    _, slope = yo_yo_spin(yo_yo, t_s)
    return yo_yo[2] * slope if slope != 0.0 else 0.0


def yo_yo_row(yo_yo, spin, i_roll):
    """(4,) release s, off s, spin at release rad/s, K/R^2 of a YoYo released at a spin; None: never.

    i_roll: kg m^2 of the vehicle about its roll axis, without the masses.
    """
    if yo_yo is None:
        return np.array([NEVER, NEVER, 0.0, 2.0])
    unwinding_s = yo_yo.cord_length / (yo_yo.radius * abs(spin))
    k = 1.0 + i_roll / (yo_yo.mass * yo_yo.radius**2)
    return np.array([yo_yo.at, yo_yo.at + unwinding_s, float(spin), k])


def spin_left(row):
    """Share of the spin left when the cords of a `yo_yo_row` are off; negative: the other way round."""
    release, off, spin, k = row
    unwound2 = (spin * (off - release)) ** 2
    return (k - unwound2) / (k + unwound2)


def spin_motor_rows(spin_motors):
    """(k, 3) start s, end s, roll torque N m."""
    if spin_motors is None:
        return np.zeros((0, 3))
    m = spin_motors
    return np.array([[m.at, m.at + m.duration, m.torque]], dtype=float)


def parachute_row(parachute, t_open=NEVER):
    """(5,) opening s, inflation s, drag area m^2, station of its lines m, reserved; opens at t_open."""
    if parachute is None:
        return np.array([NEVER, 1.0, 0.0, 0.0, 0.0])
    p = parachute
    return np.array([min(p.opens_at, t_open), p.inflation, p.drag_area, p.station, 0.0], dtype=float)


def kick(x, C_ib, speed, rate_b, lever_b):
    """Give the vehicle a speed along its roll axis and a change of its rate, at once; x (19,) in place.

    The speed [m/s] is that of the centre of mass, which lies at lever_b (3,) m from the IMU; the IMU, whose
    state this is, goes the other way when the body starts to turn about the centre of mass. What the IMU
    gains in velocity its accelerometers have sensed: it enters their increment.
    """
    gain_b = np.array([speed, 0.0, 0.0]) - np.cross(rate_b, lever_b)
    x[3:6] += C_ib @ gain_b
    x[10:13] += rate_b
    x[16:19] += gain_b
