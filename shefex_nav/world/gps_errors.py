"""Errors of the ranges that a receiver's channels measure, beyond the thermal noise, and its clock.

What is left after the receiver has taken out what it knows: it corrects with the same models of ionosphere
and troposphere that give the mean of the truth here, so that a share of each remains. All errors are drawn
per satellite of the constellation, tracked or not.

Clock and orbit of a satellite against its message swing slowly, with a and b drawn for each::

    e = sigma (a cos w t + b sin w t),   w = sigma_rate/sigma

so that error and rate have their sigmas at any time, as the errors of messages have that are renewed every
two hours; a rate for ever would leave them behind within one. 0.8 m and 0.5 mm/s make a period of 2.8 h.

The ionosphere delays the code and advances the carrier, from which the range rate comes, by as much (Groves,
2nd ed., section 9.3.2).

The clock has two states, driven by white noise of frequency and by its random walk::

    db/dt = d + w_f,   dd/dt = w_g,   S_f = c^2 h_0/2,   S_g = 2 pi^2 c^2 h_-2

(Brown and Hwang, Introduction to Random Signals and Applied Kalman Filtering, 4th ed., section 9.3.)
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gnss, ionosphere, troposphere
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.elementary import arctan2
from shefex_nav.world import noise

COMMON_SHARE = 0.5  # [E] of the variance left by the ionosphere's model: an error of all satellites alike


class RangeErrors(NamedTuple):
    """Errors of n satellites at m epochs, and what a receiver knows of their sizes.

    The first row is of the range (m, m^2), the second of the range rate (m/s, m^2/s^2).
    """

    error: np.ndarray  # (2, m, n)
    variance: np.ndarray  # (2, m, n)
    shared: np.ndarray  # (k, 2, m, n) what each of k errors that all satellites share does to them, one sigma

    @property
    def sigmas(self):
        """Of the range, the satellite's own and of what all share: (2, m, n) m."""
        shared = (self.shared[:, 0] ** 2).sum(axis=0)
        return np.sqrt(np.stack([np.maximum(self.variance[0] - shared, 0.0), shared]))


def range_errors(settings, gps_start_s, t_s, r_ea_e, u_e, rng):
    """Errors that last, of every satellite at every epoch.

    Parameters
    ----------
    settings : gps_settings.RangeErrors
    gps_start_s : s, GPS time of mission time zero
    t_s : (m,) s, equally spaced
    r_ea_e, u_e : (m, 3) m, antenna; (m, n, 3) lines of sight
    rng : Generator

    Returns
    -------
    RangeErrors
    """
    m, n = u_e.shape[:2]
    satellite = rng.standard_normal((2, n))
    of_air, common, own = rng.standard_normal(), rng.standard_normal(), rng.standard_normal(n)
    white = rng.standard_normal((m, n))

    drawn = settings.satellite
    of_range, of_rate = (drawn.range, drawn.rate) if drawn else (0.0, 0.0)
    error, rate = _of_satellites(of_range, of_rate, satellite, (t_s - t_s[0])[:, None])
    variance, rate_variance = np.full((m, n), of_range**2), np.full((m, n), of_rate**2)

    delays = []  # what is left of each, its factor, its share that is of all alike, its sign in the rate
    if settings.ionosphere:
        left = np.sqrt(COMMON_SHARE) * common + np.sqrt(1.0 - COMMON_SHARE) * own
        delay = ionospheric_delay(settings.ionosphere, gps_start_s + t_s, r_ea_e, u_e)
        delays.append((settings.ionosphere.residual * delay, left, COMMON_SHARE, -1.0))
    if settings.troposphere:
        delay = settings.troposphere.residual * tropospheric_delay(r_ea_e, u_e)
        delays.append((delay, of_air, 1.0, 1.0))
    shared = np.zeros((len(delays), 2, m, n))
    for k, (D, factor, share, sign) in enumerate(delays):
        D_rate = sign * np.gradient(D, t_s, axis=0) if m > 1 else np.zeros_like(D)
        error, rate = error + D * factor, rate + D_rate * factor
        variance, rate_variance = variance + D**2, rate_variance + D_rate**2
        shared[k] = math.sqrt(share) * np.stack([D, D_rate])

    if settings.multipath:
        step_s = t_s[1] - t_s[0] if m > 1 else 1.0
        correlation = math.exp(-step_s / settings.multipath.time)
        error = error + settings.multipath.range * noise.gauss_markov(correlation, white)
        variance = variance + settings.multipath.range**2
    return RangeErrors(np.stack([error, rate]), np.stack([variance, rate_variance]), shared)


def _of_satellites(of_range, of_rate, drawn, elapsed_s):
    """Errors of clock and orbit, and their rates: (m, n) m, m/s.

    of_range, of_rate : sigmas, m, m/s;  drawn : (2, n) standard normal;  elapsed_s : (m, 1)
    """
    angle = of_rate / of_range * elapsed_s if of_rate else 0.0 * elapsed_s
    c, s = np.cos(angle), np.sin(angle)
    return of_range * (c * drawn[0] + s * drawn[1]), of_rate * (c * drawn[1] - s * drawn[0])


def ionospheric_delay(settings, gps_s, r_ea_e, u_e):
    """Delay of the code at L1 by the broadcast model, less what of the layer is below: (m, n) m.

    settings : gps_settings.Ionosphere;  gps_s : (m,) s, GPS time;  r_ea_e, u_e : (m, 3) m, (m, n, 3)
    """
    latitude, longitude, height = geodetic(r_ea_e)
    elevation, azimuth = gnss.elevation(r_ea_e, u_e), azimuths(latitude, longitude, u_e)
    ground = ionosphere.klobuchar(
        settings.alpha, settings.beta, latitude, longitude, elevation, azimuth, gps_s[:, None]
    )
    return ground * ionosphere.slant_share(np.maximum(height, 0.0), elevation)


def tropospheric_delay(r_ea_e, u_e):
    """Delay in the air: (m, n) m. Rays that the Earth blocks have no meaning, but a bound."""
    _, _, height = geodetic(r_ea_e)
    lowest = np.maximum(gnss.lowest_height(r_ea_e, u_e), 0.0)
    return troposphere.delay(np.maximum(height, 0.0), gnss.elevation(r_ea_e, u_e), lowest)


def geodetic(r_e):
    """Latitude, longitude and height of positions (m, 3): (m, 1) each."""
    return np.array([wgs84.geodetic_from_ecef(r) for r in r_e]).T[..., None]


def azimuths(latitude, longitude, u_e):
    """Azimuth of lines of sight, from north over east. (m, 1), (m, 1), (m, n, 3) -> (m, n) rad."""
    sp, cp, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    north = -sp * cl * u_e[..., 0] - sp * sl * u_e[..., 1] + cp * u_e[..., 2]
    east = -sl * u_e[..., 0] + cl * u_e[..., 1]
    return arctan2(east, north)


def clock(settings, t_s, rng):
    """Bias and drift of the receiver's clock. gps_settings.Clock, (m,) s, Generator -> (m,) m, (m,) m/s."""
    start, white = rng.standard_normal(2), rng.standard_normal((len(t_s), 2))
    bias, drift = np.empty(len(t_s)), np.empty(len(t_s))
    b, d = np.array(settings.sigmas) * start
    for k in range(len(t_s)):
        if k:
            T = t_s[k] - t_s[k - 1]
            w_b, w_d = factor(clock_noise(*settings.densities, T)) @ white[k]
            b, d = b + d * T + w_b, d + w_d
        bias[k], drift[k] = b, d
    return bias, drift


def clock_noise(white, walk, T):
    """Covariance that the clock's noise has gathered in T seconds: (2, 2)."""
    return np.array(
        [[white * T + walk * T**3 / 3.0, walk * T**2 / 2.0], [walk * T**2 / 2.0, walk * T]],
    )


def factor(Q):
    """Lower triangular L with L L^T = Q, (2, 2), which may be singular."""
    a = np.sqrt(Q[0, 0])
    b = Q[1, 0] / a if a > 0.0 else 0.0
    return np.array([[a, 0.0], [b, np.sqrt(max(Q[1, 1] - b * b, 0.0))]])
