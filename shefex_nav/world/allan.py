"""Allan deviation of a gyro or accelerometer triad at rest: what its settings amount to.

With random walk N, in-run bias of sigma B and correlation time T (first-order Gauss-Markov) and quantum q,
over the averaging time tau and with x = tau/T (IEEE Std 952-1997, annex C)::

    sigma^2(tau) = N^2/tau + (2 B^2/x) (1 - (3 - 4 exp(-x) + exp(-2 x))/(2 x)) + q^2/(4 tau^2)

A data sheet's bias instability is the lowest point of that curve. Flicker noise, which real sensors have,
keeps the curve level; a Gauss-Markov bias lifts it to 0.617 B at 1.9 T and lets it fall beyond, so the lowest
point is sought up to there.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.elementary import exp
from shefex_nav.settings import changed
from shefex_nav.world import imu

PEAK = 1.89  # averaging time over correlation time at which a Gauss-Markov process deviates most


def deviation(triad, tau_s):
    """Allan deviation, rad/s or m/s^2.

    triad : settings.Gyro or settings.Accelerometer;  tau_s : (n,) s -> (n,)
    """
    x = tau_s / triad.in_run_bias_time
    bracket = 1.0 - (3.0 - 4.0 * exp(-x) + exp(-2.0 * x)) / (2.0 * x)
    bracket = np.where(x < 1e-3, x * x / 3.0, bracket)  # where its digits cancel
    wander = 2.0 * triad.in_run_bias**2 / x * bracket
    return np.sqrt(triad.random_walk**2 / tau_s + wander + 0.25 * (triad.quantum / tau_s) ** 2)


def floor(triad):
    """Lowest Allan deviation of a triad, and the averaging time, s, at which it has it."""
    tau_s = PEAK * triad.in_run_bias_time * np.geomspace(1e-6, 1.0, 4000)
    curve = deviation(triad, tau_s)
    lowest = int(np.argmin(curve))
    return float(curve[lowest]), float(tau_s[lowest])


class Still(NamedTuple):
    """A unit at rest, as `imu.measure` wants a trajectory; row 0 is before the first sample."""

    t_s: np.ndarray  # (n + 1,)
    burning: np.ndarray  # (n + 1,) 0: no stage
    dtheta_b: np.ndarray  # (n + 1, 3) rad, zero
    dv_b: np.ndarray  # (n + 1, 3) m/s, zero


def at_rest(settings, n, dt_s, rng):
    """What a unit reports in n samples of any length without motion, gravity and vibration.

    settings : settings.Imu;  rng : Generator -> (n, 3) rad, (n, 3) m/s
    """
    calm = {"boost": (0.0,), "coast": 0.0, "angular": 0.0,
            "lowest_frequency": 1e-6 / dt_s, "highest_frequency": 1.0 / dt_s}  # fmt: skip
    settings = changed(settings, {f"vibration.{key}": value for key, value in calm.items()})
    nothing = np.zeros((n + 1, 3))
    still = Still(np.arange(n + 1) * dt_s, np.zeros(n + 1, dtype=int), nothing, nothing)
    data = imu.measure(settings, still, rng)
    return data.dtheta_b[1:], data.dv_b[1:]


def measured(increments, dt_s, tau_s):
    """Overlapping Allan deviation of a series.

    Parameters
    ----------
    increments : (n, m) integrals of rate or specific force over samples of dt_s, a series a column
    tau_s : averaging times, rounded to whole samples

    Returns
    -------
    tau_s : (k,) s, as taken
    deviation : (k, m)
    """
    phase = np.concatenate([np.zeros((1, increments.shape[1])), np.cumsum(increments, axis=0)])
    counts = np.unique(np.maximum(1, np.rint(np.asarray(tau_s) / dt_s).astype(int)))
    found = [
        np.sqrt(0.5 * np.mean((phase[2 * k :] - 2.0 * phase[k:-k] + phase[: -2 * k]) ** 2, axis=0))
        / (k * dt_s)
        for k in counts
    ]
    return counts * dt_s, np.array(found)
