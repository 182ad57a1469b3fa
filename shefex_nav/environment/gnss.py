"""GPS satellites on their orbits, and paths of their signals. All arrays are in frame e.

A `Constellation` comes from an almanac (`environment.yuma`), or is the one that was laid out: 24 slots on
circular orbits, six planes of four satellites, kept on station so that each repeats its ground track every
sidereal day (GPS Standard Positioning Service Performance Standard, October 2001, table 3-1 and appendix A).
About 31 satellites flew in 2012, so its geometry is a little pessimistic.
"""

from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import wgs84
from shefex_nav.geometry.elementary import arcsin, arctan2

SEMI_MAJOR_AXIS = 26_559.7e3  # m
INCLINATION = np.deg2rad(55.0)
NODE_RATE = np.deg2rad(-4.4874e-7)  # rad/s, inertial; SPS PS appendix A, table A-2-1
# right ascension of the ascending node of planes A to F, and argument of latitude of their slots 1 to 4
NODES_DEG = np.array([272.847, 332.847, 32.847, 92.847, 152.847, 212.847])
SLOTS_DEG = np.array(
    [
        [268.126, 161.786, 11.676, 41.806],
        [80.956, 173.336, 309.976, 204.376],
        [111.876, 11.796, 339.666, 241.556],
        [135.226, 265.446, 35.156, 167.356],
        [197.046, 302.596, 66.066, 333.686],
        [238.886, 345.226, 105.206, 135.346],
    ]
)
REFERENCE = datetime(1993, 7, 1, tzinfo=UTC)  # the instant of the table
GREENWICH_HOUR_ANGLE = np.deg2rad(
    15.0 * (18.0 + 36.0 / 60.0 + 14.4 / 3600.0)
)  # rad, then; 18 h 36 min 14.4 s


class Constellation(NamedTuple):
    """Kepler orbits with regressing nodes, at t = 0 of the mission; a number stands for all satellites."""

    node: np.ndarray  # (n,) rad, longitude of the ascending node, from Greenwich
    node_rate: float | np.ndarray  # rad/s, relative to the rotating Earth
    latitude: np.ndarray  # (n,) rad, mean argument of latitude: perigee + mean anomaly
    latitude_rate: float | np.ndarray  # rad/s, mean motion
    inclination: float | np.ndarray  # rad
    radius: float | np.ndarray  # m, semi-major axis
    eccentricity: float | np.ndarray = 0.0
    perigee: float | np.ndarray = 0.0  # rad, argument of perigee
    prn: np.ndarray | None = None  # (n,) int, ascending; None: 1 to n


def nominal_24(epoch_utc):
    """The nominal constellation with t = 0 at a UTC instant (ISO 8601, such as 2012-06-22T19:18:00Z).

    Days of UTC count turns of the Earth, so leap seconds drop out. A repeating ground track means two
    orbits per turn of the Earth against the node, which fixes the rate of the argument of latitude better
    than the semi-major axis would over years.
    """
    epoch = datetime.fromisoformat(epoch_utc)
    if epoch.tzinfo is None:
        epoch = epoch.replace(tzinfo=UTC)
    elapsed_s = (epoch - REFERENCE).total_seconds()
    node_rate = NODE_RATE - wgs84.OMEGA
    latitude_rate = -2.0 * node_rate
    node = np.repeat(np.deg2rad(NODES_DEG) - GREENWICH_HOUR_ANGLE, SLOTS_DEG.shape[1]) + node_rate * elapsed_s
    latitude = np.deg2rad(SLOTS_DEG.ravel()) + latitude_rate * elapsed_s
    return Constellation(
        node % (2.0 * np.pi), node_rate, latitude % (2.0 * np.pi), latitude_rate, INCLINATION, SEMI_MAJOR_AXIS
    )


def numbers(constellation):
    """PRN of each satellite, (n,) int."""
    return np.arange(1, len(constellation.node) + 1) if constellation.prn is None else constellation.prn


def positions_e(constellation, t_s):
    """Where the satellites are. (m,) s since t = 0, or (m, n) one for each satellite -> (m, n, 3) m."""
    node, u, r, _, _ = _in_orbit(constellation, t_s)
    return r * _direction(constellation.inclination, node, u)


def states_e(constellation, t_s):
    """Positions and velocities relative to the Earth, t_s as in `positions_e`. -> (m, n, 3) m, m/s"""
    node, u, r, u_rate, r_rate = _in_orbit(constellation, t_s)
    i = constellation.inclination
    along = _direction(i, node, u)
    ahead = _direction(i, node, u + 0.5 * np.pi)  # d(along)/du
    turn = np.stack(
        [-along[..., 1], along[..., 0], np.zeros_like(along[..., 0])], axis=-1
    )  # d(along)/d(node)
    node_rate = np.broadcast_to(constellation.node_rate, u.shape)[..., None]
    return r * along, r_rate * along + r * (u_rate * ahead + node_rate * turn)


def _direction(inclination, node, u):
    """Unit vectors at the argument of latitude u, (m, n) -> (m, n, 3)."""
    ci, si = np.cos(inclination), np.sin(inclination)
    x = np.cos(u) * np.cos(node) - np.sin(u) * ci * np.sin(node)
    y = np.cos(u) * np.sin(node) + np.sin(u) * ci * np.cos(node)
    return np.stack([x, y, np.sin(u) * si], axis=-1)


def _in_orbit(constellation, t_s):
    """Node and argument of latitude (m, n) rad, radius and both rates (m, n, 1) or numbers, in m and s.

    Two-body motion in the orbital plane (IS-GPS-200, table 20-IV, without its harmonic corrections, which an
    almanac does not have).
    """
    t_s = np.asarray(t_s, dtype=float)
    t_s = t_s if t_s.ndim == 2 else t_s[:, None]
    node = constellation.node + constellation.node_rate * t_s
    mean = constellation.latitude + constellation.latitude_rate * t_s
    if not np.any(constellation.eccentricity):
        rate = np.broadcast_to(constellation.latitude_rate, mean.shape)[..., None]
        radius = constellation.radius
        return node, mean, radius if np.ndim(radius) == 0 else radius[:, None], rate, np.zeros_like(rate)
    e, a = constellation.eccentricity, constellation.radius
    anomaly = eccentric_anomaly(mean - constellation.perigee, e)
    cosine, sine = np.cos(anomaly), np.sin(anomaly)
    root = np.sqrt(1.0 - np.square(e))
    u = arctan2(root * sine, cosine - e) + constellation.perigee
    near = 1.0 - e * cosine
    u_rate = constellation.latitude_rate * root / near**2
    r_rate = a * e * sine * constellation.latitude_rate / near
    return node, u, (a * near)[..., None], u_rate[..., None], r_rate[..., None]


def eccentric_anomaly(mean_anomaly, eccentricity):
    """E of Kepler's equation E - e sin E = M by Newton's method; e up to 0.5. rad -> rad, same turn."""
    E = mean_anomaly + eccentricity * np.sin(mean_anomaly)
    for _ in range(6):  # errors go 0.1, 1e-2, 1e-4, 1e-8, rounding for the largest e
        E = E - (E - eccentricity * np.sin(E) - mean_anomaly) / (1.0 - eccentricity * np.cos(E))
    return E


def lines_of_sight_e(r_ea_e, satellites_e):
    """Unit vectors from receivers to satellites. (m, 3), (m, n, 3) -> (m, n, 3)."""
    d = satellites_e - r_ea_e[:, None, :]
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def elevation(r_ea_e, u_e):
    """Angle of lines of sight above the local horizontal. (m, 3), (m, n, 3) -> (m, n) rad."""
    up = r_ea_e / np.array([wgs84.A**2, wgs84.A**2, wgs84.B**2])  # normal of the ellipsoid through the point
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    return arcsin(np.clip(np.einsum("mnk,mk->mn", u_e, up), -1.0, 1.0))


def lowest_height(r_ea_e, u_e):
    """Height above the ellipsoid of the lowest point of lines of sight. (m, 3), (m, n, 3) -> (m, n) m.

    Scaling z by A/B makes the ellipsoid a sphere and keeps lines straight; heights come out up to
    0.4 percent too large. A path that leads upwards from the receiver is lowest at the receiver.
    """
    stretch = np.array([1.0, 1.0, wgs84.A / wgs84.B])
    r, u = (r_ea_e * stretch)[:, None, :], u_e * stretch
    ahead = np.maximum(0.0, -np.sum(r * u, axis=-1) / np.sum(u * u, axis=-1))
    return np.linalg.norm(r + ahead[..., None] * u, axis=-1) - wgs84.A
