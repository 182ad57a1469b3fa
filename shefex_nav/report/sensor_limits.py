"""What of a flight IMU and GPS receiver cannot show: beyond their limits, or below the counts of the gyros.

In: the largest rate and specific force about each body axis, second by second, of the rigid body: vibration
comes on top. At the end of its range a sensor keeps silent about the rest, and the attitude, or the velocity,
is unknown by what it may have missed. A receiver with limits of speed and height keeps silent beyond them.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.geometry import wgs84

AXES = "xyz"
TURNS = 5  # that a spin lasts
STEP_S = 1.0


class Motion(NamedTuple):
    """Largest values of each stretch of `STEP_S`."""

    t_s: np.ndarray  # (M,) of its begin
    rate: np.ndarray  # (M, 3) rad/s
    force: np.ndarray  # (M, 3) m/s^2


def motion(t_s, omega_b, f_b):
    """Motion of samples. (N,) s, (N, 3) rad/s, (N, 3) m/s^2"""
    first = _seconds(t_s)
    return Motion(
        t_s[first],
        np.maximum.reduceat(np.abs(omega_b), first, axis=0),
        np.maximum.reduceat(np.abs(f_b), first, axis=0),
    )


def _seconds(t_s):
    """Indices of the first sample of each `STEP_S`."""
    number = np.floor((t_s - t_s[0]) / STEP_S).astype(int)
    return np.flatnonzero(np.diff(number, prepend=-1))


def beyond(imu, flown):
    """Warnings: (path in the scenario, text) of each triad whose range a flight exceeds.

    imu : section of the scenario;  flown : Motion
    """
    for name, values, unit, scale, consequence in (
        ("gyro", flown.rate, "deg/s", np.degrees(1.0), "the attitude about it is unknown from then on"),
        ("accelerometer", flown.force, "gee", 1.0 / STANDARD_GRAVITY, "the velocity is wrong by the rest"),
    ):
        limit = getattr(imu, name).range
        over = values > limit
        if not over.any():
            continue
        k = int(np.argmax(values.max(axis=0)))
        begin_s, peak_s = flown.t_s[np.argmax(over.any(axis=1))], flown.t_s[np.argmax(values[:, k])]
        words = f"{scale * limit:.4g} {unit} is exceeded at instants of {over.any(axis=1).sum():d} seconds"
        words += ", vibration apart" if name == "accelerometer" else ""
        reached = f"axis {AXES[k]} reaches {scale * values[:, k].max():.4g} {unit} at T{peak_s:+.0f} s"
        words = (
            f"{words}, first at T{begin_s:+.0f} s: {reached}; {consequence}, until another sensor shows it"
        )
        yield ("imu", name, "range"), words


def coarse(imu, flown):
    """Warnings, as of `beyond`, of counts of the gyros that stay the same for a whole turn of the body.

    A remainder of a count is counted when the body has turned. White noise of density N^2 makes a new one
    of it in q^2/(2 pi^2 N^2) (`onboard.navigation.process_noise`). Where that is longer than a turn, a spin
    meets the same counts at each turn: what is rounded away adds up instead of averaging out.
    """
    quantum, walk = imu.gyro.quantum, imu.gyro.random_walk
    spin = np.sort(flown.rate.max(axis=1))[::-1]
    lasts_s = STEP_S * np.arange(1, len(spin) + 1)
    spin = spin[spin * lasts_s >= 2.0 * np.pi * TURNS]
    if not len(spin) or quantum <= (limit := walk * np.sqrt(4.0 * np.pi**3 / spin[0])):
        return
    words = (
        f"at a spin of {np.degrees(spin[0]):.0f} deg/s, counts above {np.degrees(limit) * 3600.0:.2g} arcsec "
    )
    words += "are the same turn after turn, since the noise does not mix them: what they leave out adds up, "
    yield ("imu", "gyro", "quantum"), words + "and the attitude error may be many times what `trade` predicts"


class Track(NamedTuple):
    """Where a vehicle was, second by second."""

    t_s: np.ndarray  # (M,)
    r_i: np.ndarray  # (M, 3) m
    v_i: np.ndarray  # (M, 3) m/s


def track(t_s, r_i, v_i):
    """Track of samples. (N,) s, (N, 3) m, (N, 3) m/s"""
    first = _seconds(t_s)
    return Track(t_s[first], r_i[first], v_i[first])


def beyond_gps(gps, flown):
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
