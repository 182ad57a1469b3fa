"""Air of NRLMSIS 2.1 as a table over the height, for one place and time.

In: epoch, place, solar and geomagnetic indices. Out: rows of height, density, pressure and speed of sound.

Model: Emmert et al., Earth and Space Science 8 (2021), e2020EA001321 (2.0), and JGR Space Physics 127 (2022),
e2022JA030896 (2.1), evaluated by pymsis, an optional dependency. The indices are always given: without them
pymsis would fetch them over the network.
"""

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.geometry.elementary import log

BOTTOM, KINK, TOP = -400.0, 150.0e3, 1.0e6  # m; the model reaches a little below the ellipsoid
FINE, COARSE = 200.0, 500.0  # m, steps below and above KINK: log-linear to 1e-4 everywhere
BOLTZMANN = 1.380649e-23  # J/K
GAMMA = 1.4  # ratio of specific heats, of air without its atomic oxygen

MASS_DENSITY, FIRST_GAS, TEMPERATURE = 0, 1, 10  # columns of pymsis; nine gases from FIRST_GAS on


class MissingModelError(UserError, ImportError):
    """NRLMSIS was asked for and pymsis is not installed."""


def table(epoch_iso, latitude, longitude, f107, f107_average, ap):
    """Air above one place at one time, from just below the ellipsoid to 1000 km.

    epoch_iso: UTC, as 2012-06-22T19:18:00Z; latitude, longitude: geodetic, rad; f107: solar flux of the day
    before, f107_average: over 81 days around, both 1e-22 W/(m^2 Hz); ap: daily geomagnetic index.

    Returns (n, 4): height m, ln(density in kg/m^3), ln(pressure in Pa), speed of sound m/s. Pressure is that
    of an ideal gas of all species at the one temperature, the speed of sound that of a diatomic gas of the
    local mean molar mass. It is exact to 90 km; where atomic oxygen prevails, above 200 km, the true one is
    up to 9 % higher, but sound has no meaning any more for a vehicle there.
    """
    try:
        import pymsis
    except ImportError as error:
        raise MissingModelError(
            "the atmosphere NRLMSIS needs pymsis: pip install 'shefex-nav[msis]', or take model: us76"
        ) from error

    height = np.concatenate([np.arange(BOTTOM, KINK, FINE), np.arange(KINK, TOP + 1.0, COARSE)])
    values = pymsis.calculate(
        np.datetime64(epoch_iso.removesuffix("Z"), "s"),
        np.degrees(longitude),
        np.degrees(latitude),
        1e-3 * height,
        [f107],
        [f107_average],
        [[ap] * 7],
        version=2.1,
    ).reshape(len(height), -1)
    density = values[:, MASS_DENSITY].astype(np.float64)
    number = np.nansum(values[:, FIRST_GAS:TEMPERATURE], axis=1, dtype=np.float64)  # NaN: not modelled there
    pressure = number * BOLTZMANN * values[:, TEMPERATURE]
    sound = np.sqrt(GAMMA * pressure / density)
    return np.column_stack([height, log(density), log(pressure), sound])
