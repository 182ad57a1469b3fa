"""Allan deviation of a gyro or accelerometer triad at rest: what its settings amount to.

With random walk N, in-run bias of sigma B and correlation time T (first-order Gauss-Markov) and quantum q,
over the averaging time tau and with x = tau/T (IEEE Std 952-1997, annex C)::

    sigma^2(tau) = N^2/tau + (2 B^2/x) (1 - (3 - 4 exp(-x) + exp(-2 x))/(2 x)) + q^2/(4 tau^2)

A data sheet's bias instability is the lowest point of that curve. Flicker noise, which real sensors have,
keeps the curve level; a Gauss-Markov bias lifts it to 0.617 B at 1.9 T and lets it fall beyond, so the lowest
point is sought up to there.
"""

import numpy as np

from shefex_nav.geometry.elementary import exp

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
