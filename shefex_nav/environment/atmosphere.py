"""US Standard Atmosphere 1976, from the ground to 1000 km.

In: geometric height. Out: density, pressure, temperature, speed of sound.

Source: NOAA-S/T 76-1562 (the Standard), whose equation and table numbers are given. Below 86 km the seven
layers are evaluated in closed form; above, density and pressure are interpolated in their logarithms. Their
table, data/us76_upper.f8, is what `upper_table` gives: the diffusion equations of the Standard, integrated
for its six gases. It is kept because every start would need a tenth of a second for it, and because the last
digits of what NumPy computes depend on the processor.
"""

import math
from importlib import resources

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.elementary import exp, log, power

R_STAR = 8314.32  # J/(kmol K), table 2
M_0 = 28.9644  # kg/kmol at sea level, table 2
G_0 = 9.80665  # m/s^2, table 2
EARTH_RADIUS = 6356766.0  # m, r_0 of table 2
GAMMA = 1.4  # ratio of specific heats, table 2
AVOGADRO = 6.022169e26  # 1/kmol, table 2
TOP = 1.0e6  # m, end of the Standard
Z_86 = 86.0e3  # m, where the mixed layers end
STEP = 125.0  # m, grid of the interpolation above 86 km: log-linear to 3e-5
FINE = 5  # integration steps per STEP
JUMP = 100.0  # km, where the mean molar mass of the mixture drops, section 1.3.3

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


@kernel
def _upper_temperatures(height):
    """The same of heights (n,)."""
    out = np.empty(len(height))
    for k in range(len(height)):
        out[k] = upper_temperature(height[k])
    return out


def _cumulative(values, step):
    """Integral from the first to every grid point: trapezoids with their end-point correction."""
    slope = np.gradient(values, step, edge_order=2)
    pieces = 0.5 * step * (values[1:] + values[:-1]) - step**2 / 12.0 * (slope[1:] - slope[:-1])
    return np.concatenate([[0.0], np.cumsum(pieces)])


def _cumulative_of_two(below, above, z, step):
    """As `_cumulative`, of `below` up to the jump and of `above` from there on."""
    at = np.searchsorted(z, JUMP)
    lower, upper = _cumulative(below[: at + 1], step), _cumulative(above[at:], step)
    return np.concatenate([lower, lower[-1] + upper[1:]])


# Per gas: molar mass kg/kmol, number density at 86 km 1/m^3, thermal diffusion alpha, diffusion a 1/(m s)
# and b, transport Q, q 1/km^3, U, u km, W, w 1/km^3 (tables 3, 6, 7, 9)
_GASES = {
    "N2": (28.0134, 1.129794e20),
    "O": (15.9994, 8.6e16, 0.0, 6.986e20, 0.750,
          -5.809644e-4, -3.416248e-3, 56.90311, 97.0, 2.706240e-5, 5.008765e-4),
    "O2": (31.9988, 3.030898e19, 0.0, 4.863e20, 0.750, 1.366212e-4, 0.0, 86.0, 0.0, 8.333333e-5, 0.0),
    "Ar": (39.948, 1.351400e18, 0.0, 4.487e20, 0.870, 9.434079e-5, 0.0, 86.0, 0.0, 8.333333e-5, 0.0),
    "He": (4.0026, 7.5817e14, -0.40, 1.700e21, 0.691, -2.457369e-4, 0.0, 86.0, 0.0, 6.666667e-4, 0.0),
}  # fmt: skip


def _diffused(gas, z, step, temperature, slope, gravity, background, mixed):
    """Number density of O, O2, Ar or He on the grid z [km], equations 36 and 37.

    background: number density of the gas it diffuses through; mixed: molar mass of the turbulent mixture
    above the jump, M_0 below it.
    """
    molar, n_86, alpha, a, b, q1, q2, u1, u2, w1, w2 = _GASES[gas]
    with np.errstate(divide="ignore", over="ignore"):
        eddy = np.where(z < 95.0, 120.0, 0.0)  # m^2/s, equation 7
        inside = (z >= 95.0) & (z < 115.0)
        eddy[inside] = 120.0 * exp(1.0 - 400.0 / (400.0 - (z[inside] - 95.0) ** 2))
    molecular = a / background * power(temperature / 273.15, b)  # m^2/s, equation 8
    share = molecular / (molecular + eddy)
    below, above = (
        gravity / (R_STAR * temperature) * share
        * (molar + mixture * eddy / molecular + alpha * R_STAR / gravity * slope)
        for mixture in (M_0, mixed)
    )  # fmt: skip
    flow = q1 * (z - u1) ** 2 * exp(-w1 * power(z - u1, 3.0))  # 1/km
    flow = flow + np.where(z <= u2, q2 * (u2 - z) ** 2 * exp(-w2 * power(np.maximum(u2 - z, 0.0), 3.0)), 0.0)
    exponent = _cumulative_of_two(below, above, z, step) + _cumulative(1e-3 * flow, step)
    return n_86 * temperature[0] / temperature * exp(-exponent)


def _hydrogen(z, step, temperature, slope, gravity, background):
    """Number density of H on the grid z [km], equations 39 and 40; the Standard has none below 150 km."""
    alpha, a, b, flux = -0.25, 3.305e21, 0.5, 7.2e11  # tables 2 and 6; flux 1/(m^2 s)
    at_500 = np.searchsorted(z, 500.0)
    tau = _cumulative(gravity * 1.00797 / (R_STAR * temperature), step)
    tau -= tau[at_500]
    scale = power(temperature / temperature[at_500], 1.0 + alpha) * exp(tau)
    escape = _cumulative(flux / (a / background * power(temperature / 273.15, b)) * scale, step)
    escape -= escape[at_500]
    return np.where((z >= 150.0), (8.0e10 - np.where(z <= 500.0, escape, 0.0)) / scale, 0.0)


def upper_table():
    """Logarithms of density [kg/m^3] and pressure [Pa] from 86 km to 1000 km every STEP: (2, n)."""
    step = STEP / FINE
    height = np.arange(Z_86, TOP + 0.5 * step, step)
    z = 1e-3 * height
    temperature = _upper_temperatures(height)
    slope = np.gradient(temperature, step)
    gravity = G_0 * (EARTH_RADIUS / (EARTH_RADIUS + height)) ** 2
    grid = (z, step, temperature, slope, gravity)
    molar, n_86 = _GASES["N2"]
    n = {}
    pull = gravity / (R_STAR * temperature)
    weight = _cumulative_of_two(M_0 * pull, molar * pull, z, step)
    n["N2"] = n_86 * temperature[0] / temperature * exp(-weight)
    n["O"], n["O2"] = (_diffused(gas, *grid, n["N2"], molar) for gas in ("O", "O2"))
    background = n["N2"] + n["O"] + n["O2"]
    mixed = sum(_GASES[gas][0] * n[gas] for gas in ("N2", "O", "O2")) / background
    n["Ar"], n["He"] = (_diffused(gas, *grid, background, mixed) for gas in ("Ar", "He"))
    n_h = _hydrogen(*grid, background + n["Ar"] + n["He"])
    density = (sum(_GASES[gas][0] * n[gas] for gas in n) + 1.00797 * n_h) / AVOGADRO
    pressure = (sum(n.values()) + n_h) * R_STAR / AVOGADRO * temperature
    return log(np.stack([density, pressure]))[:, ::FINE].copy()


def _kept_table():
    """What `upper_table` gives, from its file."""
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
