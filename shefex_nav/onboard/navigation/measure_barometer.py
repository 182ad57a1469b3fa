"""What a barometer says about the errors: one reading of static pressure, one row.

z = H dx + noise, as in `measurements`. The standard atmosphere has the reading at the height H, a real day
at h. With the pressure p_s of the Standard and the block `baro_scale` of warmth s in `LAYERS`::

    p = p_s(H) + b + c(M) q,   H = h' - e - sum_j s_j t_j(h'),   h' = h - lag v_up

b and e are the two of the block `baro_bias`: of the sensor [Pa], and how much higher the day's pressures lie
at sea level [m]; t_j is the part of layer j below h'; c(M) q is what the flow adds at the port, by its
calibration, against air at rest. A lag of first order feels the pressure of `lag` ago, to first order. The
hydrostatic law gives dp_s/dH = -g rho (US Standard Atmosphere 1976, eq. 33). On the pad, where the place is
known, readings settle b and e together: to first order they are one there, and part with height.

Errors that are no states last: those of the port for `flow_memory_s`, what the layers leave while the vehicle
crosses a `LEFT_DEPTH` of air, warmth that has no states for the flight. One reading is judged by the gate
with their variance; together readings say less than each by itself, so one that follows on another corrects
the state with more (`counts`, see `measurements.lasting_factor`).
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.environment import atmosphere
from shefex_nav.geometry import frames, wgs84
from shefex_nav.onboard.navigation.measurements import lasting_factor
from shefex_nav.onboard.navigation.state import POS, VEL, X_BARO_BIAS, X_BARO_SCALE, X_R, X_V

LAYERS = np.array([0.0, 2e3, 4.5e3, 8e3, 12e3, 18e3])  # m, base of each; the last has no top
LAST_TOP = 32e3  # m, of the last layer where its warmth is worked out
LEFT_DEPTH = 2e3  # m [E], half of a layer: over which what the layers leave goes with itself
FOR_EVER_S = 300.0  # s [E], of errors that do not change in a flight and have no state
SURFACE_TEMPERATURE = 288.15  # K
SURFACE_WEIGHT = 1.225 * atmosphere.G_0  # Pa/m, of air at sea level
AT_REST = 0.1  # m/s, slower is standing still
SIGMAS = 3.0  # of the noise, within which two readings agree


class BarometerModel(NamedTuple):
    """What the filter assumes of a barometer; sigmas are standard deviations."""

    noise: float  # Pa, white, quanta included
    lag_s: float
    lag_error: float  # of the lag, as a share of it
    port_mach: np.ndarray  # (k,)
    port_coefficient: np.ndarray  # (k,) part of the dynamic pressure at the port
    port_error: float  # of the coefficient, as a share of it
    flow_error: float  # part of the dynamic pressure, besides
    flow_memory_s: float
    layer_error: float  # m
    P_scale: np.ndarray  # (6, 6) covariance of the warmth of the layers at the start
    up_to: float  # m, not used above
    unused_mach: tuple  # Mach numbers between which it is not used
    release: tuple  # rejections, s, after which readings are a new bias


class Air(NamedTuple):
    """Where the vehicle is in the air that the filter assumes."""

    height: float  # m, above the ellipsoid
    up_i: np.ndarray  # (3,) unit
    climb: float  # m/s
    mach: float  # against air at rest
    dynamic_pressure: float  # Pa


class Offset(NamedTuple):
    """A reading against the filter, for the comparison with the next."""

    t_valid_s: float
    z: float  # Pa
    noise: float  # Pa


def of_layers(temperature, depth):
    """Covariance of the mean warmth of the layers, for a temperature of the day in K that goes with itself
    over `depth` (first-order Gauss-Markov in height): (6, 6)

    Over a layer of t = x depth the mean has the variance 2 s^2 x^-2 (x - 1 + exp(-x)); the mean of one from a
    to b goes with that of a higher one from c to d as the integral of exp(-(v - u)/depth) over both.
    """
    edges = np.array([*LAYERS, LAST_TOP]) / depth
    x, s2 = np.diff(edges), (temperature / SURFACE_TEMPERATURE) ** 2
    P = np.diag(2.0 * s2 * (x - 1.0 + np.exp(-x)) / x**2)
    for j in range(1, len(x)):
        for i in range(j):
            a, b, c, d = edges[i], edges[i + 1], edges[j], edges[j + 1]
            both = np.exp(b - c) - np.exp(a - c) - np.exp(b - d) + np.exp(a - d)
            P[i, j] = P[j, i] = s2 * both / (x[i] * x[j])
    return P


def air(earth, t_s, x):
    """Air of packed values x at a mission time, with EarthRotation `earth`."""
    C_ie = frames.dcm_ie(earth, t_s)
    r_e, v_e = frames.ecef_from_inertial(earth, t_s, x[X_R], x[X_V])
    latitude, longitude, height = wgs84.geodetic_from_ecef(r_e)
    up_e = -wgs84.dcm_en(latitude, longitude)[:, 2]
    density, _, _, sound = atmosphere.us76(height)
    speed2 = float(v_e @ v_e)
    return Air(height, C_ie @ up_e, float(up_e @ v_e), math.sqrt(speed2) / sound, 0.5 * density * speed2)


def thicknesses(height):
    """Part of each layer below a height; below sea level that of the lowest is negative. m -> (6,) m"""
    tops = np.append(LAYERS[1:], np.inf)
    parts = np.clip(height, LAYERS, tops) - LAYERS
    if height < LAYERS[0]:
        parts[0] = height - LAYERS[0]
    return parts


class Expected(NamedTuple):
    """A reading as the filter expects it."""

    pressure: float  # Pa
    slope: float  # Pa/m, of the pressure of the Standard at the height where it is read
    parts: np.ndarray  # (6,) m, of the layers below
    stretch: float  # dH/dh'


def expected(model, x, here):
    """Expected. BarometerModel, packed values, Air"""
    felt = here.height - model.lag_s * here.climb
    parts, warmth = thicknesses(felt), x[X_BARO_SCALE]
    level = felt - x[X_BARO_BIAS.start + 1] - float(warmth @ parts)
    density, pressure, _, _ = atmosphere.us76(level)
    g = atmosphere.G_0 * (atmosphere.EARTH_RADIUS / (atmosphere.EARTH_RADIUS + level)) ** 2
    layer = max(int(np.searchsorted(LAYERS, felt, side="right")) - 1, 0)
    flow = float(np.interp(here.mach, model.port_mach, model.port_coefficient)) * here.dynamic_pressure
    return Expected(pressure + x[X_BARO_BIAS.start] + flow, -density * g, parts, 1.0 - float(warmth[layer]))


def linearise(nav, now, fix):
    """As `sensors.Linearise`."""
    here = air(nav.earth, now.t_s, now.x)
    return reading(nav.layout, nav.params.barometer, now.x, here, fix)


def reading(layout, model, x, here, fix):
    """One reading.

    Parameters
    ----------
    layout : Layout
    model : BarometerModel
    x : packed values at the instant of the reading
    here : Air of them
    fix : BarometerReading

    Returns
    -------
    z : (1,) Pa;  H : (1, n);  R : (1, 1) Pa^2, of this reading by itself
    """
    told, H = expected(model, x, here), np.zeros((1, layout.n))
    steep = told.slope * told.stretch
    H[0, POS] = steep * here.up_i
    H[0, VEL] = -model.lag_s * steep * here.up_i
    if place := layout.places["baro_bias"]:
        H[0, place] = 1.0, -told.slope
    if place := layout.places["baro_scale"]:
        H[0, place] = -told.slope * told.parts
    variance = model.noise**2 + sum(part[0] for part in lasting(layout, model, here, told))
    return np.array([fix.pressure - told.pressure]), H, np.array([[variance]])


def lasting(layout, model, here, told):
    """Errors of a reading that are no states: [(variance Pa^2, s that it lasts)]."""
    flow = float(np.interp(here.mach, model.port_mach, model.port_coefficient)) * model.port_error
    layers_s = min(LEFT_DEPTH / max(abs(here.climb), AT_REST), FOR_EVER_S)
    parts = [
        ((math.hypot(flow, model.flow_error) * here.dynamic_pressure) ** 2, model.flow_memory_s),
        ((told.slope * model.lag_error * model.lag_s * here.climb) ** 2, model.flow_memory_s),
        ((told.slope * _left(model, here.height)) ** 2, layers_s),
    ]
    if layout.places["baro_scale"] is None:
        parts.append((told.slope**2 * float(told.parts @ model.P_scale @ told.parts), FOR_EVER_S))
    return parts


def _left(model, height):
    """What the layers leave of the height of a pressure, m: nothing at sea level, grown within a layer."""
    return model.layer_error * min(abs(height) / LAYERS[1], 1.0)


def counts(nav, fix, R):
    """R with which a reading that has passed the gate corrects the state, (1, 1) Pa^2: see the module's text.

    fusion.Filter on its way, which has reached the instant of the reading; it remembers that instant
    """
    model, x, gap_s = nav.params.barometer, nav.history.x, fix.t_valid_s - nav.history.reading_s
    nav.history.reading_s = fix.t_valid_s
    here = air(nav.earth, fix.t_valid_s, x)
    variance = model.noise**2
    for one, lasts_s in lasting(nav.layout, model, here, expected(model, x, here)):
        variance += one * lasting_factor(1.0, lasts_s, gap_s)
    return np.array([[variance]])


def unfit(nav, t_s, x, fix):
    """Why a reading is not to be used at packed values x; '' if it may. fusion.Filter, s -> str"""
    model = nav.params.barometer
    if fix.at_limit:
        return "not used: the sensor is at an end of its range"
    here = air(nav.earth, t_s, x)
    if here.height > model.up_to:
        return f"not used: above {1e-3 * model.up_to:g} km"
    low, high = model.unused_mach
    if low < here.mach < high:
        return f"not used: Mach {here.mach:.2f}, shocks cross the port"
    return ""


def offsets_agree(earlier, later):
    """Whether two rejected readings, Offset each, are off by the same pressure, which a new bias is."""
    noise = math.hypot(earlier.noise, later.noise)
    return 0.0 < later.t_valid_s - earlier.t_valid_s and abs(later.z - earlier.z) <= SIGMAS * noise
