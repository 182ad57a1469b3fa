"""US Standard Atmosphere 1976, from the ground to 1000 km.

In: geometric height. Out: density, pressure, temperature, speed of sound.

Source: NOAA-S/T 76-1562 (the Standard), whose equation and table numbers are given. Below 86 km the seven
layers are evaluated in closed form; above, density and pressure are interpolated in their logarithms. Their
table, data/us76_upper.f8, holds the diffusion equations of the Standard, integrated for its six gases by
benchmarks/us76_table.py. It is kept because every start would need a tenth of a second for it, and because
the last digits of what NumPy computes depend on the processor.
"""

import math
from importlib import resources

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.elementary import log

R_STAR = 8314.32  # J/(kmol K), table 2
M_0 = 28.9644  # kg/kmol at sea level, table 2
G_0 = 9.80665  # m/s^2, table 2
EARTH_RADIUS = 6356766.0  # m, r_0 of table 2
GAMMA = 1.4  # ratio of specific heats, table 2
TOP = 1.0e6  # m, end of the Standard
Z_86 = 86.0e3  # m, where the mixed layers end
STEP = 125.0  # m, grid of the interpolation above 86 km: log-linear to 3e-5

# Base of each layer: geopotential height m, lapse of the molecular-scale temperature K/m (table 4)
LAYER_H = np.array([0.0, 11e3, 20e3, 32e3, 47e3, 51e3, 71e3])
LAYER_LAPSE = np.array([-6.5e-3, 0.0, 1.0e-3, 2.8e-3, 0.0, -2.8e-3, -2.0e-3])
# M/M_0 from 80 km to 86 km in steps of 500 m (table 8)
MOLECULAR_RATIO = np.array(
    [
        1.0, 0.999996, 0.999989, 0.999971, 0.999941, 0.999909, 0.999870,
        0.999829, 0.999786, 0.999741, 0.999694, 0.999641, 0.999579,
    ]
)  # fmt: skip


def _layer_bases():
    """Temperature K and pressure Pa at the base of each layer, equations 23 and 33."""
    temperature, pressure = np.empty(7), np.empty(7)
    temperature[0], pressure[0] = 288.15, 101325.0
    for b in range(6):
        thickness = LAYER_H[b + 1] - LAYER_H[b]
        temperature[b + 1] = temperature[b] + LAYER_LAPSE[b] * thickness
        gradient = G_0 * M_0 / R_STAR
        if LAYER_LAPSE[b] == 0.0:
            ratio = math.exp(-gradient * thickness / temperature[b])
        else:
            ratio = (temperature[b] / temperature[b + 1]) ** (gradient / LAYER_LAPSE[b])
        pressure[b + 1] = pressure[b] * ratio
    return temperature, pressure


LAYER_T, LAYER_P = _layer_bases()


@inner
def upper_temperature(height):
    """Kinetic temperature [K] above 86 km, equations 25, 27, 29 and 31; height in m."""
    z = 1e-3 * height
    if z <= 91.0:
        return 186.8673
    if z <= 110.0:
        return 263.1905 - 76.3232 * np.sqrt(1.0 - ((z - 91.0) / 19.9429) ** 2)
    if z <= 120.0:
        return 240.0 + 12.0 * (z - 110.0)
    xi = (z - 120.0) * (6356.766 + 120.0) / (6356.766 + z)
    return 1000.0 - (1000.0 - 360.0) * np.exp(-0.01875 * xi)


def _kept_table():
    """Logarithms of density [kg/m^3] and pressure [Pa] from 86 km to 1000 km every STEP: (2, n)."""
    file = resources.files("shefex_nav") / "data" / "us76_upper.f8"
    return np.frombuffer(file.read_bytes(), dtype="<f8").reshape(2, -1).astype(float)


UPPER = _kept_table()


@kernel
def us76(height_m):
    """(density kg/m^3, pressure Pa, temperature K, speed of sound m/s) at a geometric height [m].

    Below the ground the first layer is continued; above 1000 km the density and the pressure are zero. Above
    86 km sound is given the speed it would have in air of the composition at 86 km: the Standard defines none
    there, and a Mach number is still wanted where the entry begins.
    """
    if np.isnan(height_m):  # a motion without a solution; it has no row in the table
        return np.nan, np.nan, np.nan, np.nan
    if height_m < Z_86:
        h = EARTH_RADIUS * height_m / (EARTH_RADIUS + height_m)
        b = 0
        while b < 6 and h >= LAYER_H[b + 1]:
            b += 1
        t_molecular = LAYER_T[b] + LAYER_LAPSE[b] * (h - LAYER_H[b])
        if LAYER_LAPSE[b] == 0.0:
            pressure = LAYER_P[b] * np.exp(-G_0 * M_0 / R_STAR * (h - LAYER_H[b]) / LAYER_T[b])
        else:
            pressure = LAYER_P[b] * (LAYER_T[b] / t_molecular) ** (G_0 * M_0 / (R_STAR * LAYER_LAPSE[b]))
        ratio = 1.0
        if height_m > 80.0e3:
            x = (height_m - 80.0e3) / 500.0
            k = min(int(x), 11)
            ratio = MOLECULAR_RATIO[k] + (x - k) * (MOLECULAR_RATIO[k + 1] - MOLECULAR_RATIO[k])
        density = pressure * M_0 / (R_STAR * t_molecular)
        return density, pressure, t_molecular * ratio, np.sqrt(GAMMA * R_STAR * t_molecular / M_0)
    temperature = upper_temperature(height_m)
    sound = np.sqrt(GAMMA * R_STAR * temperature / (M_0 * MOLECULAR_RATIO[12]))
    if height_m > TOP:
        return 0.0, 0.0, temperature, sound
    x = (height_m - Z_86) / STEP
    k = min(int(x), UPPER.shape[1] - 2)
    part = x - k
    density = np.exp(UPPER[0, k] + part * (UPPER[0, k + 1] - UPPER[0, k]))
    pressure = np.exp(UPPER[1, k] + part * (UPPER[1, k + 1] - UPPER[1, k]))
    return density, pressure, temperature, sound


def pressure_height(pressure):
    """Geometric height at which the Standard has a pressure, from 2 km below sea level to 86 km.

    (N,) Pa -> (N,) m; NaN for a pressure that it has nowhere there
    """
    levels = np.arange(-2e3, Z_86, 25.0)  # log-linear in between: to a millimetre
    told = np.array([math.log(us76(level)[1]) for level in levels])
    with np.errstate(divide="ignore", invalid="ignore"):
        wanted = log(np.asarray(pressure, dtype=float))
    return np.interp(-wanted, -told, levels, left=np.nan, right=np.nan)
