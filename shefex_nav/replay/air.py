"""What a replay with a barometer says of heights: by the pressure alone, and by the filter."""

import numpy as np

from shefex_nav.environment import atmosphere
from shefex_nav.geometry import frames, wgs84
from shefex_nav.instruments import state_sizes
from shefex_nav.onboard.navigation import measure_barometer
from shefex_nav.onboard.navigation.blocks import OPTIONAL
from shefex_nav.onboard.navigation.state import POS

TABLE_M = np.arange(-1000.0, 80001.0, 20.0)  # geometric heights
BEFORE_S = 0.5  # [E] of readings that are of the start, where the data begin with it


def pressure_altitude(pressure):
    """Geopotential altitude in the US Standard Atmosphere of static pressures. (N,) Pa -> (N,) m"""
    logs = np.log([atmosphere.us76(height)[1] for height in TABLE_M])
    geometric = np.interp(-np.log(pressure), -logs, TABLE_M)
    return atmosphere.EARTH_RADIUS * geometric / (atmosphere.EARTH_RADIUS + geometric)


def highest(readings, alignment, data):
    """JSON object about the greatest pressure altitude above the start; None without readings.

    readings : of the barometer in the data set;  alignment : Alignment;  data : RunData of the replay
    """
    if not readings or data.covariance is None or not len(data.covariance.t_s):
        return None
    t_s, pressure = (np.array([getattr(one, name) for one in readings]) for name in ("t_valid_s", "pressure"))
    still = t_s <= max(alignment.t_valid_s, t_s[0] + BEFORE_S)
    altitude = pressure_altitude(pressure)
    above = altitude - altitude[still].mean()
    later = t_s >= data.nav.t_s[0]
    top = int(np.argmax(np.where(later, above, -np.inf)))
    earth = data.mission.earth
    k = int(np.argmin(np.abs(data.nav.t_s - t_s[top])))
    start_e, _ = frames.ecef_from_inertial(earth, alignment.t_valid_s, alignment.r_i, alignment.v_i)
    heights = [wgs84.geodetic_from_ecef(r_e)[2] for r_e in (start_e, data.nav.r_e[k])]
    j = int(np.argmin(np.abs(data.covariance.t_s - data.nav.t_s[k])))
    warmth, sigma_warmth = _warmth(data.covariance, j, heights[1])
    return {
        "t_s": float(t_s[top]),
        "pressure_altitude_m": float(above[top]),
        "height_m": heights[1] - heights[0],
        "sigma_height_m": _sigma_height(earth, data, k, j),
        "warmer_by": warmth,
        "sigma_warmer_by": sigma_warmth,
    }


def _sigma_height(earth, data, k, j):
    """1 sigma of the height [m] at sample k of the solution, j of the covariances."""
    r_e, t_s = data.nav.r_e[k], data.nav.t_s[k]
    up_e = -wgs84.level_axes(r_e)[:, 2]
    up_i = frames.dcm_ie(earth, t_s) @ up_e
    return float(np.sqrt(up_i @ data.covariance.P[j][POS, POS] @ up_i))


def _warmth(covariance, j, height):
    """Mean share by which the air below a height [m] is warmer than the Standard, and its 1 sigma; None, None
    where it is not estimated. The layers' errors are counted as one."""
    states = covariance.states[j].split()
    if "baro_scale" not in states:
        return None, None
    sizes = OPTIONAL | state_sizes()
    first = sum(sizes[name] for name in states[: states.index("baro_scale")])
    block = slice(first, first + sizes["baro_scale"])
    parts = measure_barometer.thicknesses(height)
    weights = parts / parts.sum()
    return float(weights @ covariance.estimates[j][block]), float(weights @ covariance.sigmas[j][block])
