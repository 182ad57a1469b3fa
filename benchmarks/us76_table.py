"""Makes the table of the US Standard Atmosphere 1976 above 86 km anew, from the equations of the Standard.

uv run python benchmarks/us76_table.py

Writes shefex_nav/data/us76_upper.f8. Equation and table numbers are those of NOAA-S/T 76-1562. Temperatures
are those of `environment.atmosphere`, which has them in closed form.
"""

from pathlib import Path

import numpy as np

import shefex_nav
from shefex_nav.environment.atmosphere import EARTH_RADIUS, G_0, M_0, R_STAR, STEP, TOP, Z_86, us76
from shefex_nav.geometry.elementary import exp, log, power

PATH = Path(shefex_nav.__file__).parent / "data" / "us76_upper.f8"
AVOGADRO = 6.022169e26  # 1/kmol, table 2
FINE = 5  # integration steps per STEP
JUMP = 100.0  # km, where the mean molar mass of the mixture drops, section 1.3.3


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
GASES = {
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
    molar, n_86, alpha, a, b, q1, q2, u1, u2, w1, w2 = GASES[gas]
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
    temperature = np.array([us76(one)[2] for one in height])
    slope = np.gradient(temperature, step)
    gravity = G_0 * (EARTH_RADIUS / (EARTH_RADIUS + height)) ** 2
    grid = (z, step, temperature, slope, gravity)
    molar, n_86 = GASES["N2"]
    n = {}
    pull = gravity / (R_STAR * temperature)
    weight = _cumulative_of_two(M_0 * pull, molar * pull, z, step)
    n["N2"] = n_86 * temperature[0] / temperature * exp(-weight)
    n["O"], n["O2"] = (_diffused(gas, *grid, n["N2"], molar) for gas in ("O", "O2"))
    background = n["N2"] + n["O"] + n["O2"]
    mixed = sum(GASES[gas][0] * n[gas] for gas in ("N2", "O", "O2")) / background
    n["Ar"], n["He"] = (_diffused(gas, *grid, background, mixed) for gas in ("Ar", "He"))
    n_h = _hydrogen(*grid, background + n["Ar"] + n["He"])
    density = (sum(GASES[gas][0] * n[gas] for gas in n) + 1.00797 * n_h) / AVOGADRO
    pressure = (sum(n.values()) + n_h) * R_STAR / AVOGADRO * temperature
    return log(np.stack([density, pressure]))[:, ::FINE].copy()


if __name__ == "__main__":
    upper_table().tofile(PATH)
