"""What a barometer says about the errors: one reading of static pressure, one row.

z = H dx + noise, as in `measurements`. The standard atmosphere has the reading at the height H, a real day
at h. With the pressure p_s of the Standard and the block `baro_scale` of warmth s in `LAYERS`::

    p = p_s(H) + b + c(M) q,   H = h' - e - sum_j s_j t_j(h'),   h' = h - lag v_up

b and e are the two of the block `baro_bias`: of the sensor [Pa], and how much higher the day's pressures lie
at sea level [m]; t_j is the part of layer j below h'; c(M) q is what the flow adds at the port, by its
calibration, against air at rest. A lag of first order senses the pressure of `lag` ago, to first order. The
hydrostatic law gives dp_s/dH = -g rho (US Standard Atmosphere 1976, eq. 33). On the pad, where the place is
known, readings settle b and e together: to first order they are one there, and part with height.

Errors that are no states last: those of the port for `flow_memory`, what the layers leave while the vehicle
crosses a `LEFT_DEPTH` of air, warmth that has no states for the flight.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.environment import atmosphere
from shefex_nav.geometry.elementary import exp
from shefex_nav.onboard.navigation.aid import Linearised

LAYERS = np.array([0.0, 1.5e3, 3.5e3, 6e3, 9e3, 12e3, 16e3, 21e3])  # m, base of each; the last has no top
LAST_TOP = 32e3  # m, of the last layer where its warmth is worked out
LEFT_DEPTH = 1e3  # m [E], a third of a layer: over which what the layers leave goes with itself
FOR_EVER_S = 300.0  # s [E], of errors that do not change in a flight and have no state
# K, of the Standard in the middle of each layer; the warmth of a layer is what the day has on this
TEMPERATURE = np.array([283.28, 271.91, 257.30, 239.46, 220.01, 216.65, 216.65, 223.04])
SURFACE_WEIGHT = 1.225 * atmosphere.G_0  # Pa/m, of air at sea level
AT_REST = 0.1  # m/s, slower is standing still


class Model(NamedTuple):
    """What the filter assumes of a barometer."""

    settings: Any  # instruments.barometer.Barometer
    use: Any  # BarometerUse
    P_scale: np.ndarray  # (8, 8) covariance of the warmth of the layers at the start, `of_layers`


class Air(NamedTuple):
    """Where the vehicle is in the air that the filter assumes."""

    height: float  # m, above the ellipsoid
    climb: float  # m/s
    mach: float  # against air at rest
    dynamic_pressure: float  # Pa


def of_layers(day):
    """Covariance of the mean warmth of the layers on a Day of the barometer: (8, 8)

    Its temperature goes with itself over a depth (first-order Gauss-Markov in height) and has one sigma at
    all heights: s is that over the temperature of a layer.

    Over a layer of t = x depth the mean has the variance 2 s^2 x^-2 (x - 1 + exp(-x)); the mean of one from a
    to b goes with that of a higher one from c to d as the integral of exp(-(v - u)/depth) over both.
    """
    edges = np.array([*LAYERS, LAST_TOP]) / day.depth
    x, s = np.diff(edges), day.temperature / TEMPERATURE
    P = np.diag(2.0 * s**2 * (x - 1.0 + exp(-x)) / x**2)
    for j in range(1, len(x)):
        for i in range(j):
            a, b, c, d = edges[i], edges[i + 1], edges[j], edges[j + 1]
            both = exp(b - c) - exp(a - c) - exp(b - d) + exp(a - d)
            P[i, j] = P[j, i] = s[i] * s[j] * both / (x[i] * x[j])
    return P


def air(here):
    """Air of an aiding.Here."""
    density, _, _, sound = atmosphere.us76(here.height)
    speed2, climb = float(here.v_e @ here.v_e), float(-here.C_en[:, 2] @ here.v_e)
    return Air(here.height, climb, math.sqrt(speed2) / sound, 0.5 * density * speed2)


def thicknesses(height):
    """Part of each layer below a height; below sea level that of the lowest is negative. m -> (8,) m"""
    tops = np.append(LAYERS[1:], np.inf)
    parts = np.clip(height, LAYERS, tops) - LAYERS
    if height < LAYERS[0]:
        parts[0] = height - LAYERS[0]
    return parts


def _layer(height):
    """Number of the layer in which a height lies; the lowest one goes on below sea level."""
    return max(int(np.searchsorted(LAYERS, height, side="right")) - 1, 0)


def white(model):
    """Standard deviation of the white noise of a reading, quanta included, Pa. Model"""
    return math.hypot(model.settings.noise, model.settings.quantum / math.sqrt(12.0))


def at_port(model, mach):
    """Part of the dynamic pressure that the port adds, as calibrated. Model, Mach number"""
    port = model.settings.port
    return 0.0 if port is None else float(np.interp(mach, port.mach, port.coefficient))


class Expected(NamedTuple):
    """A reading as the filter expects it."""

    pressure: float  # Pa
    slope: float  # Pa/m, of the pressure of the Standard at the height where it is read
    parts: np.ndarray  # (8,) m, of the layers below
    stretch: float  # dH/dh'


def expected(model, air, bias, warmth):
    """Expected. Model, Air, values of the blocks baro_bias (2,) and baro_scale (8,)"""
    sensed = air.height - model.settings.lag * air.climb
    parts = thicknesses(sensed)
    level = sensed - bias[1] - float(warmth @ parts)
    density, pressure, _, _ = atmosphere.us76(level)
    g = atmosphere.G_0 * (atmosphere.EARTH_RADIUS / (atmosphere.EARTH_RADIUS + level)) ** 2
    flow = at_port(model, air.mach) * air.dynamic_pressure
    return Expected(pressure + bias[0] + flow, -density * g, parts, 1.0 - float(warmth[_layer(sensed)]))


def expect(model, here, reading):
    """Linearised of one reading: z (1,) Pa, H (1, n). Model, aiding.Here, BarometerReading"""
    around, warmth = air(here), here.value("baro_scale")
    known = np.zeros(len(LAYERS)) if warmth is None else warmth
    told, H = expected(model, around, here.value("baro_bias"), known), here.rows(1)
    steep = told.slope * told.stretch
    H[0, here.columns("position")] = steep * here.up_i
    H[0, here.columns("velocity")] = -model.settings.lag * steep * here.up_i
    H[0, here.columns("baro_bias")] = 1.0, -told.slope
    if warmth is not None:
        H[0, here.columns("baro_scale")] = -told.slope * told.parts
    shared = tuple((np.array([[v]]), lasts_s) for v, lasts_s in lasting(model, around, told, warmth is None))
    R = np.array([[white(model) ** 2]])
    return Linearised(np.array([reading.pressure - told.pressure]), H, R, shared)


def lasting(model, air, told, warmth_too):
    """Errors of a reading that are no states: [(variance Pa^2, s that it lasts)].

    warmth_too : whether that of the layers is none
    """
    settings, use = model.settings, model.use
    flow = at_port(model, air.mach) * settings.port.error if settings.port else 0.0
    layers_s = min(LEFT_DEPTH / max(abs(air.climb), AT_REST), FOR_EVER_S)
    parts = [
        ((math.hypot(flow, use.flow_error) * air.dynamic_pressure) ** 2, use.flow_memory),
        ((told.slope * use.lag_error * settings.lag * air.climb) ** 2, use.flow_memory),
        (told.slope**2 * _left(settings.day, air.height), layers_s),
    ]
    if warmth_too:
        parts.append((told.slope**2 * float(told.parts @ model.P_scale @ told.parts), FOR_EVER_S))
    return parts


def _left(day, height):
    """What the layers leave of the height of a pressure: variance in m^2, on a Day.

    Over the lower part x of a layer t the warmth adds up to I(x), of which the mean of the layer says
    x I(t)/t; with V = var I = 2 s^2 L^2 (x/L - 1 + exp(-x/L)) and the stationary increments of I

        var = V(x) - (x/t) (V(x) + V(t) - V(t - x)) + (x/t)^2 V(t).
    """
    depth = day.depth
    layer = _layer(height)
    top = LAYERS[layer + 1] if layer + 1 < len(LAYERS) else LAST_TOP
    t = float(top - LAYERS[layer])
    x = min(max(height - float(LAYERS[layer]), 0.0), t)

    def grown(y):
        return 2.0 * (y / depth - 1.0 + math.exp(-y / depth))

    share = x / t
    bridge = grown(x) - share * (grown(x) + grown(t) - grown(t - x)) + share**2 * grown(t)
    return max((day.temperature / float(TEMPERATURE[layer]) * depth) ** 2 * bridge, 0.0)


def unfit(model, here, reading):
    """Why a reading is not to be used; '' if it may. Model, aiding.Here, BarometerReading -> str"""
    if reading.at_limit:
        return "not used: the sensor is at an end of its range"
    around = air(here)
    if around.height > model.use.up_to:
        return f"not used: above {1e-3 * model.use.up_to:g} km"
    low, high = model.use.unused_mach
    if low < around.mach < high:
        return f"not used: Mach {around.mach:.2f}, shocks cross the port"
    return ""
