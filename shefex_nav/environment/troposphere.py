"""Delay of the signal in the neutral air, of a standard atmosphere by height.

Zenith delays at sea level: 2.307 m of the dry air, 0.0022768 m/hPa of Saastamoinen (1972) at 1013.25 hPa,
and 0.12 m of the water vapour [E] of a temperate or cold place. Both fall off exponentially with height: the
dry part, as the pressure does, by the mean scale height of the first 10 km of the US Standard Atmosphere, the
vapour by its 2 km. A slanting ray has the mapping function of Black and Eisner (1984, as in RTCA DO-229,
appendix A.4.2.4)::

    m(E) = 1.001/sqrt(0.002001 + sin^2 E)

within 2 % above 4 degrees; at the horizon it is finite but a third too small.
"""

import numpy as np

from shefex_nav.geometry.elementary import exp

DRY_ZENITH = 2.307  # m at sea level
DRY_HEIGHT = 7.5e3  # m
WET_ZENITH = 0.12  # m [E]
WET_HEIGHT = 2.0e3  # m


def zenith_delay(height):
    """Zenith delay above a height, m -> m; a tenth of a millimetre at 75 km."""
    h = np.asarray(height, dtype=float)
    return DRY_ZENITH * exp(-h / DRY_HEIGHT) + WET_ZENITH * exp(-h / WET_HEIGHT)


def mapping(elevation):
    """Slant over zenith delay, of a ray that leads upwards."""
    return 1.001 / np.sqrt(0.002001 + np.sin(elevation) ** 2)


def delay(height, elevation, lowest):
    """Delay along rays, of which those that lead down pass through thicker air at their lowest point.

    Such a ray is two horizontal ones from its lowest point up, less the part above the receiver.

    Parameters
    ----------
    height : m, of the receiver
    elevation : rad, of the satellite there
    lowest : m, height of the lowest point of the ray (`gnss.lowest_height`)

    Returns
    -------
    m
    """
    up = mapping(np.abs(elevation)) * zenith_delay(height)
    return np.where(np.asarray(elevation) >= 0.0, up, 2.0 * mapping(0.0) * zenith_delay(lowest) - up)
