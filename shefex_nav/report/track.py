"""The flown path as seen from the Earth."""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
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
