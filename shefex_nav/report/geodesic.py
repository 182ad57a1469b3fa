"""Shortest distance over the ellipsoid: Vincenty's inverse solution.

T. Vincenty, Direct and inverse solutions of geodesics on the ellipsoid with application of nested equations,
Survey Review XXIII 176, 1975.
"""

import math

from shefex_nav.geometry import wgs84


def distance(latitude_1, longitude_1, latitude_2, longitude_2, *, a=wgs84.A, f=wgs84.F):
    """Length [m] of the geodesic between two points on the ellipsoid; coordinates in rad.

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
