"""The WGS 84 ellipsoid: constants, geodetic coordinates, the local level frame, the horizon.

Source of the constants: NIMA TR8350.2, third edition.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry.rotation import rows

A = 6378137.0  # m, semi-major axis
F = 1.0 / 298.257223563  # flattening
B = A * (1.0 - F)  # m, semi-minor axis
E2 = F * (2.0 - F)  # first eccentricity squared
EP2 = E2 / (1.0 - E2)  # second eccentricity squared
GM = 3.986004418e14  # m^3/s^2
OMEGA = 7.292115e-5  # rad/s, rotation rate of the Earth


@kernel
def ecef_from_geodetic(latitude, longitude, height):
    """Position from geodetic latitude, longitude [rad] and height [m]: (3,) m, frame e."""
    s, c = np.sin(latitude), np.cos(latitude)
    n = A / np.sqrt(1.0 - E2 * s * s)
    return np.array(
        [
            (n + height) * c * np.cos(longitude),
            (n + height) * c * np.sin(longitude),
            (n * (1.0 - E2) + height) * s,
        ]
    )


@kernel
def geodetic_from_ecef(r_e):
    """Geodetic latitude, longitude [rad] and height [m] of a position (3,) m, frame e.

    Bowring's parametric latitude, iterated three times: from the surface to several Earth radii the error
    is then below the rounding (3e-9 m).
    """
    x, y, z = r_e[0], r_e[1], r_e[2]
    p = np.sqrt(x * x + y * y)
    beta = np.arctan2(z * A, p * B)
    latitude = 0.0
    for _ in range(3):
        sb, cb = np.sin(beta), np.cos(beta)
        latitude = np.arctan2(z + EP2 * B * sb**3, p - E2 * A * cb**3)
        beta = np.arctan2((1.0 - F) * np.sin(latitude), np.cos(latitude))
    s, c = np.sin(latitude), np.cos(latitude)
    n = A / np.sqrt(1.0 - E2 * s * s)
    height = p * c + z * s - A * A / n  # holds at the poles too
    return latitude, np.arctan2(y, x), height


@kernel
def dcm_en(latitude, longitude):
    """C_en: components in north-east-down to components in e. rad, rad -> (3, 3)."""
    sp, cp = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    return rows((-sp * cl, -sl, -cp * cl), (-sp * sl, cl, -cp * sl), (cp, 0.0, -sp))


def level_axes(r_e):
    """C_en at a position (3,) m, frame e: (3, 3)."""
    latitude, longitude, _ = geodetic_from_ecef(r_e)
    return dcm_en(latitude, longitude)


@kernel
def dcm_el(latitude, longitude):
    """C_el: components in east-north-up at the launch site to components in e. rad -> (3, 3)."""
    sp, cp = np.sin(latitude), np.cos(latitude)
    sl, cl = np.sin(longitude), np.cos(longitude)
    return rows((-sl, -sp * cl, cp * cl), (cl, -sp * sl, cp * sl), (0.0, cp, sp))


@kernel
def limb_angle(r_e, direction_e):
    """Angle between a direction and the nearest point of the Earth's limb [rad]; negative below it.

    The ellipsoid becomes a unit sphere when z is scaled by A/B; the limb is the tangent cone there. The
    angle is measured in the plane of the direction and the (geocentric) nadir, in true space. On the surface
    and below it, where coasts with a sunken geoid lie, the limb is the tangent plane.
    """
    scale = np.array([1.0 / A, 1.0 / A, 1.0 / B])
    nadir = -r_e / np.sqrt((r_e**2).sum())
    u = direction_e / np.sqrt((direction_e**2).sum())
    cos_to_nadir = (u * nadir).sum()
    angle = np.arccos(min(1.0, max(-1.0, cos_to_nadir)))
    across = u - cos_to_nadir * nadir
    norm = np.sqrt((across**2).sum())
    if norm < 1e-12:
        across = perpendicular(nadir)
        norm = 1.0
    across = across / norm
    # scaled, the plane cuts a unit circle out; e_1 towards its centre, e_2 across, the tangent between them
    n, a = nadir * scale, across * scale
    length = np.sqrt((n**2).sum())
    e_1 = n / length
    along = (a * e_1).sum()
    e_2 = a - along * e_1
    width = np.sqrt((e_2**2).sum())
    s = min(1.0, 1.0 / np.sqrt(((r_e * scale) ** 2).sum()))
    c = np.sqrt(1.0 - s * s)
    # c e_1 + s e_2/width = x nadir + y across, scaled
    return angle - np.arctan2(s / width, (c - s * along / width) / length)


@kernel
def perpendicular(v):
    """Some unit vector across the unit vector v. (3,) -> (3,)."""
    k = np.argmin(np.abs(v))
    w = -v[k] * v
    w[k] += 1.0
    return w / np.sqrt((w**2).sum())
