"""The GPS constellation as it was laid out: 24 slots on circular orbits, and paths of their signals.

Six planes of four satellites, kept on station so that each repeats its ground track every sidereal day
(GPS Standard Positioning Service Performance Standard, October 2001, table 3-1 and appendix A). About 31
satellites flew in 2012, so the geometry here is a little pessimistic. All arrays are in frame e.
"""

from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import wgs84

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
    """Circular orbits with regressing nodes, at t = 0 of the mission."""

    node: np.ndarray  # (n,) rad, longitude of the ascending node, from Greenwich
    node_rate: float  # rad/s, relative to the rotating Earth
    latitude: np.ndarray  # (n,) rad, argument of latitude
    latitude_rate: float  # rad/s
    inclination: float  # rad
    radius: float  # m


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


def positions_e(constellation, t_s):
    """Where the satellites are. (m,) s since t = 0 -> (m, n, 3) m."""
    t_s = np.asarray(t_s)[:, None]
    node = constellation.node + constellation.node_rate * t_s
    u = constellation.latitude + constellation.latitude_rate * t_s
    ci, si = np.cos(constellation.inclination), np.sin(constellation.inclination)
    x = np.cos(u) * np.cos(node) - np.sin(u) * ci * np.sin(node)
    y = np.cos(u) * np.sin(node) + np.sin(u) * ci * np.cos(node)
    return constellation.radius * np.stack([x, y, np.sin(u) * si], axis=-1)


def lines_of_sight_e(r_ea_e, satellites_e):
    """Unit vectors from receivers to satellites. (m, 3), (m, n, 3) -> (m, n, 3)."""
    d = satellites_e - r_ea_e[:, None, :]
    return d / np.linalg.norm(d, axis=-1, keepdims=True)


def elevation(r_ea_e, u_e):
    """Angle of lines of sight above the local horizontal. (m, 3), (m, n, 3) -> (m, n) rad."""
    up = r_ea_e / np.array([wgs84.A**2, wgs84.A**2, wgs84.B**2])  # normal of the ellipsoid through the point
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    return np.arcsin(np.clip(np.einsum("mnk,mk->mn", u_e, up), -1.0, 1.0))


def lowest_height(r_ea_e, u_e):
    """Height above the ellipsoid of the lowest point of lines of sight. (m, 3), (m, n, 3) -> (m, n) m.

    Scaling z by A/B makes the ellipsoid a sphere and keeps lines straight; heights come out up to
    0.4 percent too large. A path that leads upwards from the receiver is lowest at the receiver.
    """
    stretch = np.array([1.0, 1.0, wgs84.A / wgs84.B])
    r, u = (r_ea_e * stretch)[:, None, :], u_e * stretch
    ahead = np.maximum(0.0, -np.sum(r * u, axis=-1) / np.sum(u * u, axis=-1))
    return np.linalg.norm(r + ahead[..., None] * u, axis=-1) - wgs84.A
