"""Barometer: static pressure of the air at the vehicle, as its port feels it and its sensor reports it.

The air is that of the scenario, on a day of its own: a level of pressure that the model of the air has at the
height H lies at

    h(H) = H + e_0 + integral from 0 to H of s(H') dH',    s = dT/T,

e_0 from the day's pressure at sea level, s from its temperature, first-order Gauss-Markov in height. Only the
barometer feels the day; the forces of the air are those of the model. At the port a part of the
dynamic pressure q adds to the static one,

    p = p_air + c(M) (1 + d) q,

c over the Mach number as calibrated, d the error of that calibration (Gracey, Measurement of aircraft speed
and altitude, NASA RP-1046, chapters 5 and 6). The sensor follows with a lag of first order, has a bias, one
that wanders (Gauss-Markov) and white noise, and its readings are limited and counted in whole quanta.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.compiled import kernel
from shefex_nav.environment import atmosphere
from shefex_nav.geometry import frames, wgs84
from shefex_nav.records import BarometerReading
from shefex_nav.world.noise import gauss_markov

DAY_STEP, DAY_TOP = 100.0, 60e3  # m, of the table of a day; above it the day has the temperature of the model
SURFACE_PRESSURE, SURFACE_DENSITY = 101325.0, 1.225  # Pa, kg/m^3, of the Standard at sea level
SURFACE_TEMPERATURE = 288.15  # K


class BarometerParams(NamedTuple):
    """Sensor, port and day; sigmas are one standard deviation of what is drawn per run."""

    rate: float  # Hz, a divisor of 100
    latency_s: float  # from the instant measured to the reading on board
    bias: float  # Pa
    drift: float  # Pa, bias that wanders
    drift_time_s: float  # its correlation time
    noise: float  # Pa, of one reading, white
    lag_s: float  # time constant of line and sensor
    quantum: float  # Pa; 0: none
    lowest: float  # Pa, range of the sensor
    highest: float  # Pa
    port_mach: np.ndarray  # (k,) increasing
    port_coefficient: np.ndarray  # (k,) part of the dynamic pressure at the port, as calibrated
    port_error: float  # of the coefficient, as a share of it
    day_pressure: float  # Pa, at sea level
    day_temperature: float  # K, against the model
    day_depth: float  # m, over which the temperature of the day goes with itself
    air: np.ndarray  # (n, 4) as `flight.params.Air.table`; n = 0: US76


class Errors(NamedTuple):
    """What was drawn for one run."""

    bias: float  # Pa
    port: float  # d of the module's text
    level_m: float  # e_0
    warmth: np.ndarray  # (m,) s at the heights 0, DAY_STEP, ...


class BarometerData(NamedTuple):
    """Readings of a flight, and what is wrong with them."""

    readings: list  # of BarometerReading
    errors: Errors


def measure(params, trajectory, earth, rng):
    """Readings along a trajectory.

    Parameters
    ----------
    params : BarometerParams
    trajectory : Trajectory
    earth : EarthRotation
    rng : Generator; as many numbers are drawn whatever `params` says but for its rate

    Returns
    -------
    BarometerData
    """
    errors, dt_s = draw_errors(params, rng), 1.0 / IMU_HZ
    heights = _heights(trajectory.t_s, trajectory.r_i, *earth)
    static = _pressures(of_the_day(errors, heights), params.air)
    coefficient = np.interp(trajectory.mach, params.port_mach, params.port_coefficient)
    port = static + coefficient * (1.0 + errors.port) * trajectory.dynamic_pressure_pa
    felt = lagged(port, params.lag_s, dt_s)
    every = round(IMU_HZ / params.rate)
    k = np.arange(every, len(trajectory.t_s), every)
    white = rng.standard_normal((len(k), 2))
    wander = gauss_markov(np.exp(-every * dt_s / params.drift_time_s), white[:, :1])[:, 0]
    read = felt[k] + errors.bias + params.drift * wander + params.noise * white[:, 1]
    counted = np.round(read / params.quantum) * params.quantum if params.quantum else read
    pressure = np.clip(counted, params.lowest, params.highest)
    at_limit = (counted <= params.lowest) | (counted >= params.highest)
    times = trajectory.t_s[k].tolist()
    readings = [
        BarometerReading(t_s, t_s + params.latency_s, value, limit)
        for t_s, value, limit in zip(times, pressure.tolist(), at_limit.tolist(), strict=True)
    ]
    return BarometerData(readings, errors)


def draw_errors(params, rng):
    """What is constant in a run. -> Errors"""
    bias, port, level = rng.standard_normal(3)
    white = rng.standard_normal((round(DAY_TOP / DAY_STEP), 1))
    warmth = gauss_markov(np.exp(-DAY_STEP / params.day_depth), white)[:, 0]
    metres = params.day_pressure / (SURFACE_DENSITY * atmosphere.G_0)
    share = params.day_temperature / SURFACE_TEMPERATURE
    return Errors(params.bias * bias, params.port_error * port, metres * level, share * warmth)


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
    """What a sensor of first order feels of a pressure (N,), at rest before the first sample.

    dy/dt = (p - y)/lag by the trapezoidal rule.
    """
    if lag_s == 0.0:
        return pressure
    from scipy.signal import lfilter

    b, keeps = dt_s / (2.0 * lag_s + dt_s), (2.0 * lag_s - dt_s) / (2.0 * lag_s + dt_s)
    # the filter's memory of an input and an output that were pressure[0] for ever
    return lfilter([b, b], [1.0, -keeps], pressure, zi=[(b + keeps) * pressure[0]])[0]


@kernel
def _heights(t_s, r_i, C_iq, C_re, angle_0, rate):
    """Heights above the ellipsoid. (N,) s, (N, 3) m, fields of an EarthRotation -> (N,) m"""
    earth, out = frames.EarthRotation(C_iq, C_re, angle_0, rate), np.empty(len(t_s))
    for k in range(len(t_s)):
        r_e = np.ascontiguousarray(frames.dcm_ie(earth, t_s[k]).T) @ r_i[k]
        out[k] = wgs84.geodetic_from_ecef(r_e)[2]
    return out


def _pressures(heights, air):
    """Pressure of the model of the air. (N,) m; air as in BarometerParams -> (N,) Pa

    A table holds its first row below its first height, and ends in the vacuum above its last.
    """
    if not len(air):
        return _standard(heights)
    return np.where(heights > air[-1, 0], 0.0, np.exp(np.interp(heights, air[:, 0], air[:, 2])))


@kernel
def _standard(heights):
    """Pressure of US76. (N,) m -> (N,) Pa"""
    out = np.empty(len(heights))
    for k in range(len(heights)):
        out[k] = atmosphere.us76(heights[k])[1]
    return out
