"""What surrounds the vehicle: the rotating Earth below it, its gravitation, the launch rail.

In: inertial positions. Out: position and height over the Earth, gravitation, the free fall ahead.

Gravitation is the sum of the closed form with J2, evaluated wherever the integration asks for it, and of what
the harmonics have beyond it, evaluated once in the middle of a step and held for its length. That is below
1e-3 m/s^2 and changes over R/n, about 500 km at degree 12, while the vehicle moves by 8 m: half a step from
the middle it is off by 1e-8 m/s^2, with opposite signs before and after. What is left after a step is of
second order, about 1e-3 (8 m / 500 km)^2 / 24 = 1e-14 m/s^2.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.gravity import gravity_e, gravity_j2_e
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import dcm_ie, inertial_from_ecef
from shefex_nav.geometry.rotation import quat_from_dcm, quat_multiply


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
def times(C, x, y, z):
    """C @ (x, y, z)."""
    return (
        C[0, 0] * x + C[0, 1] * y + C[0, 2] * z,
        C[1, 0] * x + C[1, 1] * y + C[1, 2] * z,
        C[2, 0] * x + C[2, 1] * y + C[2, 2] * z,
    )


@njit(cache=True)
def transposed_times(C, x, y, z):
    """C.T @ (x, y, z)."""
    return (
        C[0, 0] * x + C[1, 0] * y + C[2, 0] * z,
        C[0, 1] * x + C[1, 1] * y + C[2, 1] * z,
        C[0, 2] * x + C[1, 2] * y + C[2, 2] * z,
    )


@njit(cache=True)
def turned(earth, t_s):
    """Cosine and sine of the Earth rotation angle at a mission time."""
    angle = earth.angle_0 + earth.rate * t_s
    return np.cos(angle), np.sin(angle)


@njit(cache=True)
def position_e(earth, c, s, x, y, z, r_e):
    """Write the position in frame e into r_e: dcm_ie(earth, t_s).T @ (x, y, z), with c, s = turned(...)."""
    x, y, z = transposed_times(earth.C_iq, x, y, z)
    r_e[0], r_e[1], r_e[2] = transposed_times(earth.C_re, c * x + s * y, c * y - s * x, z)


@njit(cache=True)
def height(r_e):
    """Height above the ellipsoid [m] of a position (3,) m, frame e: that of wgs84.geodetic_from_ecef.

    Bowring's latitude in its first iteration and without angles. Its error enters the height squared and
    stays below the rounding up to 1000 km.
    """
    across, z = np.sqrt(r_e[0] ** 2 + r_e[1] ** 2), r_e[2]
    s, c = z * wgs84.A, across * wgs84.B  # of the parametric latitude, times their norm
    norm = np.sqrt(s * s + c * c)
    s, c = s / norm, c / norm
    s, c = z + wgs84.EP2 * wgs84.B * s**3, across - wgs84.E2 * wgs84.A * c**3  # of the geodetic one
    norm = np.sqrt(s * s + c * c)
    s, c = s / norm, c / norm
    return across * c + z * s - wgs84.A * np.sqrt(1.0 - wgs84.E2 * s * s)


@njit(cache=True)
def _to_inertial(earth, c, s, g_e):
    """Components in frame i of g_e: three numbers."""
    x, y, z = times(earth.C_re, g_e[0], g_e[1], g_e[2])
    return times(earth.C_iq, c * x - s * y, s * x + c * y, z)


@njit(cache=True)
def coarse_gravity_i(earth, c, s, r_e):
    """The closed form with J2 in inertial components: three numbers, m/s^2."""
    return _to_inertial(earth, c, s, gravity_j2_e(r_e))


@njit(cache=True)
def fine_gravity_i(world, t_s, x, y, z, r_e):
    """What the closed form lacks at an inertial position: three numbers, m/s^2. r_e: (3,) to work in."""
    c, s = turned(world.earth, t_s)
    position_e(world.earth, c, s, x, y, z, r_e)
    return _to_inertial(world.earth, c, s, gravity_e(world.gravity, r_e) - gravity_j2_e(r_e))


@njit(cache=True)
def rest_on_earth(earth, r_e, q_eb, t_s, states):
    """Write r_i, v_i, q_ib of a body fixed to the Earth at the times t_s (n,) into states[:, 0:10]."""
    for k in range(t_s.size):
        states[k, 0:3], states[k, 3:6] = inertial_from_ecef(earth, t_s[k], r_e, np.zeros(3))
        states[k, 6:10] = quat_multiply(quat_from_dcm(dcm_ie(earth, t_s[k])), q_eb)


@njit(cache=True)
def _gravitation(world, t_s, r_i):
    """All of the gravitation at an inertial position: (3,) m -> (3,) m/s^2, frame i."""
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
