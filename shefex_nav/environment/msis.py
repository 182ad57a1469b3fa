"""Air of NRLMSIS 2.1 over the height, for one place and time.

In: heights, epoch, place, solar and geomagnetic indices. Out: density and pressure.

Model: Emmert et al., Earth and Space Science 8 (2021), e2020EA001321 (2.0), and JGR Space Physics 127 (2022),
e2022JA030896 (2.1), evaluated by pymsis, an optional dependency. The indices are always given: without them
pymsis would fetch them over the network.
"""

import numpy as np

from shefex_nav.environment.models import Air
from shefex_nav.errors import UserError

BOLTZMANN = 1.380649e-23  # J/K

MASS_DENSITY, FIRST_GAS, TEMPERATURE = 0, 1, 10  # columns of pymsis; nine gases from FIRST_GAS on


class MissingModelError(UserError, ImportError):
    """NRLMSIS was asked for and pymsis is not installed."""


def air(height, site):
    """Air above one place at one time.

    (n,) m; models.Site with the settings models.Msis -> models.Air

    Pressure is that of an ideal gas of all species at the one temperature, the speed of sound that of a
    diatomic gas of the local mean molar mass. It is exact to 90 km; where atomic oxygen prevails, above
    200 km, the true one is up to 9 % higher, but sound has no meaning any more for a vehicle there.
    """
    try:
        import pymsis
    except ImportError as error:
        raise MissingModelError(
            "the atmosphere NRLMSIS needs pymsis: pip install 'shefex-nav[msis]', or take model: us76"
        ) from error

    indices = site.settings
    values = pymsis.calculate(
        np.datetime64(site.epoch.removesuffix("Z"), "s"),
        np.degrees(site.longitude),
        np.degrees(site.latitude),
        1e-3 * height,
        [indices.f107],
        [indices.f107_average],
        [[indices.ap] * 7],
        version=2.1,
    ).reshape(len(height), -1)
    density = values[:, MASS_DENSITY].astype(np.float64)
    number = np.nansum(values[:, FIRST_GAS:TEMPERATURE], axis=1, dtype=np.float64)  # NaN: not modelled there
    return Air(density, number * BOLTZMANN * values[:, TEMPERATURE])
