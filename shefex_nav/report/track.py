"""The flown path as seen from the Earth, and distances over it."""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import ecef_from_inertial
from shefex_nav.geometry.wgs84 import geodetic_from_ecef


class Track(NamedTuple):
    """Earth-fixed truth over N samples."""

    r_e: np.ndarray  # (N, 3) m
    v_e: np.ndarray  # (N, 3) m/s, relative to the rotating Earth
    latitude: np.ndarray  # (N,) rad, geodetic
    longitude: np.ndarray  # (N,) rad
    height: np.ndarray  # (N,) m above the ellipsoid


def earth_fixed(earth, truth):
    """Track of a TruthSample of arrays."""
    return Track(*_track_kernel(earth, truth.t_s, truth.r_i, truth.v_i))


@kernel
def _track_kernel(earth, t_s, r_i, v_i):
    n = t_s.shape[0]
    r_e, v_e = np.empty((n, 3)), np.empty((n, 3))
    latitude, longitude, height = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        r, v = ecef_from_inertial(earth, t_s[k], r_i[k], v_i[k])
        r_e[k], v_e[k] = r, v
        latitude[k], longitude[k], height[k] = geodetic_from_ecef(r)
    return r_e, v_e, latitude, longitude, height


def ground_distance(latitude_1, longitude_1, latitude_2, longitude_2, *, a=wgs84.A, f=wgs84.F):
    """Length [m] of the geodesic between two points on the ellipsoid; coordinates in rad.

    T. Vincenty, Direct and inverse solutions of geodesics on the ellipsoid with application of nested
    equations, Survey Review XXIII 176, 1975.

    ValueError for nearly antipodal points, where the iteration has no solution.
    """
    u1 = math.atan((1.0 - f) * math.tan(latitude_1))  # reduced latitudes
    u2 = math.atan((1.0 - f) * math.tan(latitude_2))
    s1, c1, s2, c2 = math.sin(u1), math.cos(u1), math.sin(u2), math.cos(u2)
    difference = math.remainder(longitude_2 - longitude_1, 2.0 * math.pi)
    lam = difference  # on the auxiliary sphere
    for _ in range(100):
        sin_lam, cos_lam = math.sin(lam), math.cos(lam)
        sin_sigma = math.hypot(c2 * sin_lam, c1 * s2 - s1 * c2 * cos_lam)
        if sin_sigma == 0.0:
            return 0.0
        cos_sigma = s1 * s2 + c1 * c2 * cos_lam
        sigma = math.atan2(sin_sigma, cos_sigma)
        sin_alpha = c1 * c2 * sin_lam / sin_sigma
        cos2_alpha = 1.0 - sin_alpha**2
        cos_2m = cos_sigma - 2.0 * s1 * s2 / cos2_alpha if cos2_alpha > 1e-15 else 0.0  # along the equator
        c = f / 16.0 * cos2_alpha * (4.0 + f * (4.0 - 3.0 * cos2_alpha))
        inner = cos_2m + c * cos_sigma * (2.0 * cos_2m**2 - 1.0)
        last, lam = lam, difference + (1.0 - c) * f * sin_alpha * (sigma + c * sin_sigma * inner)
        if abs(lam - last) < 1e-13:
            break
    else:
        raise ValueError("the points are too nearly antipodal")
    b = a * (1.0 - f)
    u_squared = cos2_alpha * (a**2 - b**2) / b**2
    big_a = 1.0 + u_squared / 16384.0 * (
        4096.0 + u_squared * (-768.0 + u_squared * (320.0 - 175.0 * u_squared))
    )
    big_b = u_squared / 1024.0 * (256.0 + u_squared * (-128.0 + u_squared * (74.0 - 47.0 * u_squared)))
    third = big_b / 6.0 * cos_2m * (4.0 * sin_sigma**2 - 3.0) * (4.0 * cos_2m**2 - 3.0)
    delta = big_b * sin_sigma * (cos_2m + big_b / 4.0 * (cos_sigma * (2.0 * cos_2m**2 - 1.0) - third))
    return b * big_a * (sigma - delta)
