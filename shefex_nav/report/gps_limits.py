"""What of a flight a GPS receiver with limits of speed and height keeps silent about."""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import wgs84

STEP_S = 1.0


class Track(NamedTuple):
    """Where a vehicle was, second by second."""

    t_s: np.ndarray  # (M,)
    r_i: np.ndarray  # (M, 3) m
    v_i: np.ndarray  # (M, 3) m/s


def track(t_s, r_i, v_i):
    """Track of samples. (N,) s, (N, 3) m, (N, 3) m/s"""
    number = np.floor((t_s - t_s[0]) / STEP_S).astype(int)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    return Track(t_s[first], r_i[first], v_i[first])


def beyond(gps, flown):
    """Warnings: (path in the scenario, text) of each limit that a flight exceeds.

    gps : section of the scenario;  flown : Track. The Earth's axis is taken for the inertial z axis.
    """
    for key, scale, unit, values in (
        ("highest_speed", 1.0, "m/s", _speed),
        ("highest_height", 1e-3, "km", heights),
    ):
        limit = getattr(gps, key)
        if not np.isfinite(limit):
            continue
        reached = values(flown)
        over = reached > limit
        if over.any():
            begin_s, total_s = flown.t_s[np.argmax(over)], STEP_S * over.sum()
            words = f"{scale * limit:g} {unit} is exceeded for {total_s:.0f} s, first at T{begin_s:+.0f} s"
            yield (
                ("gps", key),
                f"{words}, up to {scale * reached.max():.4g} {unit}: no fixes and no ranges then",
            )


def _speed(flown):
    """Over the ground. Track -> (M,) m/s"""
    ground = np.cross([0.0, 0.0, wgs84.OMEGA], flown.r_i)
    return np.linalg.norm(flown.v_i - ground, axis=1)


def heights(flown):
    """Over the ellipsoid. Track -> (M,) m"""
    return np.array([wgs84.geodetic_from_ecef(r)[2] for r in flown.r_i])
