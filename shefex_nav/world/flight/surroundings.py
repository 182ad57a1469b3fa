"""What surrounds the vehicle: the rotating Earth below it, its gravitation, air and wind, the launch rail.

In: inertial positions. Out: position and height over the Earth, gravitation, air, the free fall ahead.

Gravitation is the sum of a closed form with J2, evaluated wherever the integration asks for it, and of what
the harmonics have beyond it, evaluated where a step begins and where it will end, and linear in between. That
remainder is below 1e-3 m/s^2 and changes over R/n, 530 km at degree 12: in a step of 0.05 s, 400 m in
orbit, the line is off by at most 1e-3 (400 m / 530 km)^2 / 8 = 7e-11 m/s^2, to either side in turn.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.environment.atmosphere import us76
from shefex_nav.environment.gravity import GravityModel, gravity_e
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import EarthRotation, dcm_ie, inertial_from_ecef
from shefex_nav.geometry.rotation import quat_from_dcm, quat_multiply
from shefex_nav.world.flight.scene import mixed, place


class Rail(NamedTuple):
    """The launch rail, fixed to the Earth."""

    r_e: np.ndarray  # (3,) m, IMU before lift-off
    direction_e: np.ndarray  # (3,) unit
    length: float  # m, travel until the vehicle is free


class World(NamedTuple):
    """What surrounds the vehicle. Arrays are writable, C-contiguous and of its own."""

    gravity: GravityModel
    coarse: np.ndarray  # (3,) GM m^3/s^2, radius m, J2 of the closed form
    earth: EarthRotation
    shape: np.ndarray  # (2,) semi-major axis m, first eccentricity squared: the ellipsoid of heights and wind
    rail: Rail
    air: np.ndarray  # (n, 4) height m, ln(density), ln(pressure), speed of sound m/s; n = 0: US76
    density_factor: float
    wind: np.ndarray  # (m, 1 + 2 k) height m, wind to north m/s, to east m/s at each time; m = 0: none
    wind_times: np.ndarray  # (k,) s; k = 1: always the same


def surround(gravity, earth, rail, air, wind, wind_times=(0.0,)):
    """World of a field, an EarthRotation, a Rail, `params.Air` and a wind, on the WGS 84 ellipsoid.

    wind, wind_times : (m, 1 + 2 k) and (k,), as of `params.FlightParams`
    """

    def own(values):
        return np.array(values, dtype=float, order="C")

    def increasing(table, columns, what):
        table = own(table).reshape(-1, columns)
        if np.any(np.diff(table[:, 0]) <= 0.0):
            raise ValueError(f"the {what} have to increase")
        return table

    if len(air.table) == 1:
        raise ValueError("a table of the air has two heights at least")
    turning = EarthRotation(own(earth.C_iq), own(earth.C_re), float(earth.angle_0), float(earth.rate))
    return World(
        gravity=gravity,
        coarse=closed_form(gravity),
        earth=turning,
        shape=np.array([wgs84.A, wgs84.E2]),
        rail=Rail(own(rail.r_e), own(rail.direction_e), float(rail.length)),
        air=increasing(air.table, 4, "heights of the air"),
        density_factor=float(air.density_factor),
        wind=increasing(wind, 1 + 2 * len(wind_times), "heights of the wind"),
        wind_times=increasing(wind_times, 1, "times of the wind").ravel(),
    )


def closed_form(gravity):
    """(3,) GM, radius and J2 of a GravityModel: its own, so that little is left for the remainder."""
    # the harmonic (3, 0), fourth in the order of the terms, gets J2 (n + 1) along z from C_20
    j2 = gravity.p[3, 2] / 3.0 if gravity.degree >= 2 else 0.0
    return np.array([gravity.gm, gravity.radius, j2])


@inner(forceinline=True)
def times(C, x, y, z):
    """C @ (x, y, z)."""
    return (
        C[0, 0] * x + C[0, 1] * y + C[0, 2] * z,
        C[1, 0] * x + C[1, 1] * y + C[1, 2] * z,
        C[2, 0] * x + C[2, 1] * y + C[2, 2] * z,
    )


@inner(forceinline=True)
def transposed_times(C, x, y, z):
    """C.T @ (x, y, z)."""
    return (
        C[0, 0] * x + C[1, 0] * y + C[2, 0] * z,
        C[0, 1] * x + C[1, 1] * y + C[2, 1] * z,
        C[0, 2] * x + C[1, 2] * y + C[2, 2] * z,
    )


@inner(forceinline=True)
def earth_angle(s, t_s):
    """Cosine and sine of the Earth rotation angle at a mission time. s: of the Scene, or an EarthRotation."""
    angle = s.angle_0 + s.rate * t_s
    return np.cos(angle), np.sin(angle)


@inner(forceinline=True)
def position_e(s, turn, x, y, z):
    """Position in frame e: dcm_ie(earth, t_s).T @ (x, y, z), with turn = turned(s, t_s); three numbers."""
    x, y, z = transposed_times(s.C_iq, x, y, z)
    return transposed_times(s.C_re, turn[0] * x + turn[1] * y, turn[0] * y - turn[1] * x, z)


@inner(forceinline=True)
def to_inertial(s, turn, x, y, z):
    """Components in frame i of a vector in frame e: three numbers."""
    x, y, z = times(s.C_re, x, y, z)
    return times(s.C_iq, turn[0] * x - turn[1] * y, turn[1] * x + turn[0] * y, z)


@inner(error_model="numpy", forceinline=True)
def level(a, e2, x, y, z):
    """Height [m] above an ellipsoid, and sine and cosine of the geodetic latitude, of a position in frame e.

    a, e2: semi-major axis m and first eccentricity squared. Bowring's latitude in its first iteration and
    without angles. Its error enters the height squared and stays below the rounding up to 1000 km.
    """
    b = a * np.sqrt(1.0 - e2)
    across = np.sqrt(x * x + y * y)
    s, c = z * a, across * b  # of the parametric latitude, times their norm
    norm = 1.0 / np.sqrt(s * s + c * c)
    s, c = s * norm, c * norm
    s, c = z + e2 / (1.0 - e2) * b * s**3, across - e2 * a * c**3  # of the geodetic one
    norm = 1.0 / np.sqrt(s * s + c * c)
    s, c = s * norm, c * norm
    return across * c + z * s - a * np.sqrt(1.0 - e2 * s * s), s, c


@kernel
def height(shape, r_e):
    """Height [m] above the ellipsoid `World.shape` of a position (3,) m, frame e."""
    h, _, _ = level(shape[0], shape[1], r_e[0], r_e[1], r_e[2])
    return h


@inner(error_model="numpy", forceinline=True)
def coarse_gravity(s, x, y, z):
    """The closed form with J2 at a position in frame e: three numbers, m/s^2, frame e.

    g = -GM/r^3 (1 + 3/2 J2 (R/r)^2 ((1, 1, 3) - 5 (z/r)^2)) r, component by component.
    """
    r2 = x * x + y * y + z * z
    k = 1.5 * s.j2 * s.radius**2 / r2
    s2 = z * z / r2
    c = -s.gm / (r2 * np.sqrt(r2))
    across = c * (1.0 + k * (1.0 - 5.0 * s2))
    return across * x, across * y, c * (1.0 + k * (3.0 - 5.0 * s2)) * z


@inner
def fine_gravity_i(gravity, s, t_s, x, y, z):
    """What the closed form lacks of a GravityModel at an inertial position: three numbers, m/s^2, frame i."""
    turn = earth_angle(s, t_s)
    x, y, z = position_e(s, turn, x, y, z)
    g = gravity_e(gravity, np.array([x, y, z]))
    gx, gy, gz = coarse_gravity(s, x, y, z)
    return to_inertial(s, turn, g[0] - gx, g[1] - gy, g[2] - gz)


@kernel(error_model="numpy", forceinline=True)
def air(s, tables, height_m):
    """(density kg/m^3, pressure Pa, speed of sound m/s) at a height [m]. s, tables: of the Scene.

    A table holds its first row below its first height, and ends in the vacuum above its last.
    """
    if s.air_n == 0:
        density, pressure, _, sound = us76(height_m)
        return s.density_factor * density, pressure, sound
    end = s.air_at + 4 * (s.air_n - 1)
    if height_m > tables[end]:
        return 0.0, 0.0, tables[end + 3]
    k, part = place(tables, s.air_at, s.air_n, 4, height_m)
    at = s.air_at + 4 * k
    density, pressure = np.exp(mixed(tables, at + 1, 4, part)), np.exp(mixed(tables, at + 2, 4, part))
    return s.density_factor * density, pressure, mixed(tables, at + 3, 4, part)


@inner(error_model="numpy", forceinline=True)
def wind_e(s, tables, t_s, height_m, sine, cosine, x, y):
    """Wind in frame e, three numbers, m/s; constant beyond the ends of its table. s, tables: of the Scene.

    sine, cosine: of the geodetic latitude, with the height from `level`; x, y: m, position in frame e.
    """
    width, j, later = 1 + 2 * s.wind_times_n, 0, 0.0
    if s.wind_times_n > 1:
        j, later = place(tables, s.wind_times_at, s.wind_times_n, 1, t_s)
    k, part = place(tables, s.wind_at, s.wind_n, width, height_m)
    at = s.wind_at + width * k + 1 + 2 * j
    north, east = mixed(tables, at, width, part), mixed(tables, at + 1, width, part)
    if later > 0.0:
        north += later * (mixed(tables, at + 2, width, part) - north)
        east += later * (mixed(tables, at + 3, width, part) - east)
    across = np.sqrt(x * x + y * y)
    cl, sl = (x / across, y / across) if across > 0.0 else (1.0, 0.0)
    return -sine * cl * north - sl * east, -sine * sl * north + cl * east, cosine * north


@kernel
def rest_on_earth(earth, r_e, q_eb, t_s, states):
    """Write r_i, v_i, q_ib of a body fixed to the Earth at the times t_s (n,) into states[:, 0:10]."""
    for k in range(t_s.size):
        states[k, 0:3], states[k, 3:6] = inertial_from_ecef(earth, t_s[k], r_e, np.zeros(3))
        states[k, 6:10] = quat_multiply(quat_from_dcm(dcm_ie(earth, t_s[k])), q_eb)


@inner
def _gravitation(world, t_s, r_i):
    """All of the gravitation at an inertial position: (3,) m -> (3,) m/s^2, frame i."""
    C_ie = dcm_ie(world.earth, t_s)
    return C_ie @ gravity_e(world.gravity, C_ie.T @ r_i)


@kernel
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
