"""Position and velocity by least squares out of GpsRanges, written down for tests alone."""

import numpy as np

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry import wgs84


def geometry_at(ranges, r_e):
    """Distances, lines of sight and least-squares matrix from a place."""
    d = ranges.r_es_e - r_e
    rho = np.linalg.norm(d, axis=1)
    u = d / rho[:, None]
    return rho, u, np.column_stack([-u, np.ones(len(rho))])


def solved_position(ranges, start_e):
    """Least-squares position and clock out of the pseudoranges alone."""
    x = np.append(start_e, 0.0)
    for _ in range(8):
        rho, _, H = geometry_at(ranges, x[:3])
        x = x + np.linalg.lstsq(H, ranges.pseudorange - rho - x[3], rcond=None)[0]
    return x[:3]


def solved_velocity(ranges, r_e):
    """Least-squares velocity out of the range rates, seen from r_e."""
    _, u, H = geometry_at(ranges, r_e)
    omega = np.array([0.0, 0.0, wgs84.OMEGA])
    v_s = ranges.v_es_e + np.cross(omega, ranges.r_es_e)
    factor = 1.0 + np.sum(u * v_s, axis=1) / SPEED_OF_LIGHT
    known = np.sum(u * (v_s - np.cross(omega, r_e)), axis=1) / factor
    H[:, :3] /= factor[:, None]
    return np.linalg.lstsq(H, ranges.range_rate - known, rcond=None)[0][:3]
