"""What of a flight the inertial measurement unit cannot show: rates and forces beyond its ranges.

In: the largest rate and specific force about each body axis, second by second, of the rigid body: vibration
comes on top. At the end of its range a sensor keeps silent about the rest, and the attitude, or the velocity,
is unknown by what it may have missed.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment.constants import STANDARD_GRAVITY

STRETCH_S = 1.0
AXES = "xyz"


class Motion(NamedTuple):
    """Largest values of each stretch of `STRETCH_S`."""

    t_s: np.ndarray  # (M,) of its begin
    rate: np.ndarray  # (M, 3) rad/s
    force: np.ndarray  # (M, 3) m/s^2


def motion(t_s, omega_b, f_b):
    """Motion of samples. (N,) s, (N, 3) rad/s, (N, 3) m/s^2"""
    number = np.floor((t_s - t_s[0]) / STRETCH_S).astype(int)
    first = np.flatnonzero(np.diff(number, prepend=-1))
    return Motion(
        t_s[first],
        np.maximum.reduceat(np.abs(omega_b), first, axis=0),
        np.maximum.reduceat(np.abs(f_b), first, axis=0),
    )


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
