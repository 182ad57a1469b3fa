"""Barometer: static pressure of the air at the vehicle, as its port senses it and its sensor reports it.

The air is that of the scenario, on a day of its own: a level of pressure that the model of the air has at the
height H lies at

    h(H) = H + e_0 + integral from 0 to H of s(H') dH',    s = dT/T,

e_0 from the day's pressure at sea level, s from its temperature: T that of the model at H', dT first-order
Gauss-Markov in height, of the same sigma everywhere. Only the barometer senses the day; the forces of the air
are those of the model. At the port a part of the dynamic pressure q adds to the static one,

    p = p_air + c(M) (1 + d) q,

c over the Mach number as calibrated, d the error of that calibration (Gracey, Measurement of aircraft speed
and altitude, NASA RP-1046, chapters 5 and 6). The sensor follows with a lag of first order, has a bias, one
that wanders (Gauss-Markov) and white noise. Range and quanta are in `instruments.barometer`.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.compiled import kernel
from shefex_nav.environment import atmosphere
from shefex_nav.geometry import frames, wgs84
from shefex_nav.geometry.elementary import exp
from shefex_nav.world.noise import gauss_markov

DAY_STEP, DAY_TOP = 100.0, 60e3  # m, of the table of a day; above it the day has the temperature of the model
MODES = 60  # of the warmth of a day, where it is told by modes
SURFACE_DENSITY = 1.225  # kg/m^3, of the Standard at sea level
STANDARD = np.zeros((0, 4))  # as table of the air: US76


class Errors(NamedTuple):
    """What was drawn for one run."""

    bias: float  # Pa
    port: float  # d of the module's text
    level_m: float  # e_0
    warmth: np.ndarray  # (m,) s at the heights 0, DAY_STEP, ...


class Pressures(NamedTuple):
    """What the sensor senses at some samples of a flight, and what is wrong with it."""

    sensed: np.ndarray  # (n,) Pa, before quanta and range
    errors: Errors


def measure(settings, truth, k, rng):
    """Pressures at the samples k (n,) of a trajectory.

    Parameters
    ----------
    settings : instruments.barometer.Barometer
    truth : with trajectory, earth and air (n, 4) as `flight.params.Air.table`; n = 0: US76
    k : (n,) int, equally spaced
    rng : Generator; as many numbers are drawn whatever `settings` says but for its rate

    Returns
    -------
    Pressures
    """
    trajectory = truth.trajectory
    errors, dt_s = draw_errors(settings, rng, truth.air), 1.0 / IMU_HZ
    heights = _heights(trajectory.t_s, trajectory.r_i, *truth.earth)
    port = _pressures(of_the_day(errors, heights), truth.air)
    if settings.port is not None:
        coefficient = np.interp(trajectory.mach, settings.port.mach, settings.port.coefficient)
        port = port + coefficient * (1.0 + errors.port) * trajectory.dynamic_pressure_pa
    sensed = lagged(port, settings.lag, dt_s)
    white = rng.standard_normal((len(k), 2))
    every = k[0] if len(k) else 1
    wander = gauss_markov(exp(-every * dt_s / settings.drift_time), white[:, :1])[:, 0]
    return Pressures(sensed[k] + errors.bias + settings.drift * wander + settings.noise * white[:, 1], errors)


def draw_errors(settings, rng, air=STANDARD):
    """What is constant in a run. air : as of `measure` -> Errors"""
    bias, port, level = rng.standard_normal(3)
    white, day = rng.standard_normal((round(DAY_TOP / DAY_STEP), 1)), settings.day
    warmth = gauss_markov(exp(-DAY_STEP / day.depth), white)[:, 0]
    share = _scatter_of_warmth(day, air)
    return Errors(
        settings.bias * bias, _of_port(settings) * port, _scatter_of_level(day) * level, share * warmth
    )


def _scatter_of_level(day):
    """Of the level of the day at sea level, m."""
    return day.pressure / (SURFACE_DENSITY * atmosphere.G_0)


def _scatter_of_warmth(day, air):
    """Of s, in the middle of each step of the table. air : as of `measure` -> (m,)"""
    heights = DAY_STEP * (np.arange(round(DAY_TOP / DAY_STEP)) + 0.5)
    return day.temperature / _temperatures(heights, air)


def _of_port(settings):
    """Of the calibration of the port."""
    return 0.0 if settings.port is None else settings.port.error


def drawn(settings):
    """What is drawn for a run: (name, sigma of each element, correlation time), ...; the warmth in modes."""
    one = np.ones(1)
    return (
        ("bias", settings.bias * one, np.inf),
        ("drift", settings.drift * one, settings.drift_time),
        ("port", _of_port(settings) * one, np.inf),
        ("level", _scatter_of_level(settings.day) * one, np.inf),
        ("warmth", np.ones(MODES), np.inf),
    )


def modes_of_warmth(day, air=STANDARD):
    """The warmth of a day as a sum of modes, the weights of which are independent and of unit variance.

    They are the strongest of what the warmth makes of heights, the integral of it: `MODES` of them.
    settings Day, air as of `measure` -> (MODES, m), m as of `Errors.warmth`
    """
    m = round(DAY_TOP / DAY_STEP)
    apart = np.abs(np.arange(m)[:, None] - np.arange(m))
    share = _scatter_of_warmth(day, air)
    covariance = np.outer(share, share) * exp(-apart * DAY_STEP / day.depth)
    summed = np.cumsum(np.cumsum(covariance, axis=0), axis=1)
    values, vectors = np.linalg.eigh(summed)
    strongest = vectors[:, : -MODES - 1 : -1] * np.sqrt(np.maximum(values[: -MODES - 1 : -1], 0.0))
    return np.diff(strongest, axis=0, prepend=0.0).T


def sensed_pressure(settings, truth, modes, place, errors):
    """What the sensor senses at a place without white noise: (1,) Pa.

    The lag is that of a pressure that changes evenly. Mach number and dynamic pressure are those of the true
    flight: who does not know the wind learns no velocity from them.

    settings, truth : as of `measure`;  modes : of `modes_of_warmth`;  place : instrument.Place
    errors : {name of `drawn`: (size,)}
    """
    t_s, r_i = place.t_s - settings.lag, place.r_i - settings.lag * place.v_i
    bias, port, level = (float(errors[name][0]) for name in ("bias", "port", "level"))
    day = Errors(bias, port, level, errors["warmth"] @ modes)
    heights = _heights(np.array([t_s]), r_i[None], *truth.earth)
    pressure = _pressures(of_the_day(day, heights), truth.air)
    if settings.port is not None:
        mach, q = (one[place.k] for one in (truth.trajectory.mach, truth.trajectory.dynamic_pressure_pa))
        coefficient = np.interp(mach, settings.port.mach, settings.port.coefficient)
        pressure = pressure + coefficient * (1.0 + day.port) * q
    return pressure + day.bias + errors["drift"]


def of_the_day(errors, heights):
    """Height at which the model of the air has the pressure that the day has at a height. (N,) m -> (N,) m

    Below sea level and above `DAY_TOP` the day is the model, moved.
    """
    levels = DAY_STEP * np.arange(len(errors.warmth) + 1)
    lie = levels + errors.level_m + np.concatenate([[0.0], DAY_STEP * np.cumsum(errors.warmth)])
    found = np.interp(heights, lie, levels)
    below, above = heights < lie[0], heights > lie[-1]
    found[below] = heights[below] - lie[0]
    found[above] = heights[above] - lie[-1] + levels[-1]
    return found


def lagged(pressure, lag_s, dt_s):
    """What a sensor of first order senses of a pressure (N,), at rest before the first sample.

    dy/dt = (p - y)/lag by the trapezoidal rule.
    """
    if lag_s == 0.0:
        return pressure
    out = np.empty(len(pressure))
    _lag(dt_s / (2.0 * lag_s + dt_s), (2.0 * lag_s - dt_s) / (2.0 * lag_s + dt_s), pressure, out)
    return out


@kernel
def _lag(b, keeps, pressure, out):
    """y[k] = keeps y[k-1] + b (p[k] + p[k-1]); both were p[0] for ever. (N,) -> (N,) is written"""
    memory = (b + keeps) * pressure[0]  # what the last input and output leave for the next output
    for k in range(len(pressure)):
        out[k] = memory + b * pressure[k]
        memory = b * pressure[k] + keeps * out[k]


@kernel
def _heights(t_s, r_i, C_iq, C_re, angle_0, rate):
    """Heights above the ellipsoid. (N,) s, (N, 3) m, fields of an EarthRotation -> (N,) m"""
    earth, out = frames.EarthRotation(C_iq, C_re, angle_0, rate), np.empty(len(t_s))
    for k in range(len(t_s)):
        r_e = np.ascontiguousarray(frames.dcm_ie(earth, t_s[k]).T) @ r_i[k]
        out[k] = wgs84.geodetic_from_ecef(r_e)[2]
    return out


def _pressures(heights, air):
    """Pressure of the model of the air. (N,) m; air as of `measure` -> (N,) Pa

    A table holds its first row below its first height, and ends in the vacuum above its last.
    """
    if not len(air):
        return _standard(heights)
    return np.where(heights > air[-1, 0], 0.0, exp(np.interp(heights, air[:, 0], air[:, 2])))


def _temperatures(heights, air):
    """Temperature of the model of the air, K; above a table that of its last row. As `_pressures`"""
    if not len(air):
        return np.array([atmosphere.us76(height)[2] for height in heights.tolist()])
    ratio = exp(np.interp(heights, air[:, 0], air[:, 2]) - np.interp(heights, air[:, 0], air[:, 1]))
    return ratio * atmosphere.M_0 / atmosphere.R_STAR


@kernel
def _standard(heights):
    """Pressure of US76. (N,) m -> (N,) Pa"""
    out = np.empty(len(heights))
    for k in range(len(heights)):
        out[k] = atmosphere.us76(heights[k])[1]
    return out
