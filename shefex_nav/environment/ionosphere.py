"""Delay of the L1 signal in the ionosphere: the broadcast model of GPS, and how much of it is overhead.

The broadcast (Klobuchar) model is made for receivers on the ground: IS-GPS-200, section 20.3.3.5.2.5. For a
vehicle inside the layer it is multiplied by what its own ray meets of the electrons, over what the ray of
the same elevation from the ground meets (`slant_share`), both added up along the rays through an
alpha-Chapman layer (Rishbeth & Garriott, Introduction to Ionospheric Physics, section 3.4)::

    N(z) ~ exp((1 - z - exp(-z))/2),   z = (h - h_max)/H

To the zenith that is the part of the layer above the vehicle, erf(exp(-z/2)/sqrt(2)). A slanting ray that
starts inside the layer stays longer in what is left of it than one from the ground, which is steeper by the
time it gets there: low rays meet more, at 300 km towards the horizon twice what the ground does. Rays that
lead down pass the layer twice, also from orbits far above it, where rays that lead up meet nothing. Little is
below 150 km and nothing to speak of above 900 km.
"""

import numpy as np

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry.elementary import exp, power

PEAK_HEIGHT = 350e3  # m, of the F layer, where the broadcast model has its shell
SCALE_HEIGHT = 60e3  # m [E] of the neutral gas there; the layer's own is twice as large above its peak
FLOOR_S = 5e-9  # zenith delay at night
LOWEST_ELEVATION = 0.0  # rad; the broadcast model is not made for rays that lead downwards
EARTH_RADIUS = 6371e3  # m; a sphere will do here
STEP, FURTHEST = 20e3, 6000e3  # m along a ray; the step is a third of the scale height
REACH = 3400e3  # m on both sides of the lowest point; from the ground it is 850 km up, from the peak 1160


def klobuchar(alpha, beta, latitude, longitude, elevation, azimuth, gps_s):
    """Delay on the ground by the broadcast model.

    Parameters
    ----------
    alpha : (4,) s, s/semicircle, ... of the amplitude, as broadcast
    beta : (4,) s, s/semicircle, ... of the period
    latitude, longitude : rad, geodetic, of the receiver
    elevation, azimuth : rad, of the satellite; elevations below zero count as zero
    gps_s : s, GPS time (of the day or since any midnight)

    Returns
    -------
    m, at L1; angles may be arrays of shapes that go together
    """
    E = np.maximum(elevation, LOWEST_ELEVATION) / np.pi
    earth_angle = 0.0137 / (E + 0.11) - 0.022  # semicircles, as all angles here
    lat_i = np.clip(latitude / np.pi + earth_angle * np.cos(azimuth), -0.416, 0.416)
    lon_i = longitude / np.pi + earth_angle * np.sin(azimuth) / np.cos(lat_i * np.pi)
    lat_m = lat_i + 0.064 * np.cos((lon_i - 1.617) * np.pi)
    local_s = np.mod(43200.0 * lon_i + gps_s, 86400.0)
    amplitude_s = np.maximum(np.polyval(np.asarray(alpha)[::-1], lat_m), 0.0)
    period_s = np.maximum(np.polyval(np.asarray(beta)[::-1], lat_m), 72000.0)
    x = 2.0 * np.pi * (local_s - 50400.0) / period_s
    day_s = np.where(np.abs(x) < 1.57, amplitude_s * (1.0 - x**2 / 2.0 + power(x, 4.0) / 24.0), 0.0)
    return SPEED_OF_LIGHT * obliquity(elevation) * (FLOOR_S + day_s)


def obliquity(elevation):
    """Slant over zenith delay, of the broadcast model."""
    return 1.0 + 16.0 * power(0.53 - np.maximum(elevation, LOWEST_ELEVATION) / np.pi, 3.0)


def slant_share(height, elevation):
    """What a ray meets, over what the ray of the same elevation (of zero, if it leads down) from the ground.

    height : m, of the receiver;  elevation : rad; both of shapes that go together -> factor on `klobuchar`
    """
    return electrons(height, elevation) / electrons(0.0, np.maximum(elevation, LOWEST_ELEVATION))


def electrons(height, elevation):
    """The layer added up along straight rays from a height, m and rad; 1 from the ground to the zenith.

    A ray from far above is added up from `REACH` before its lowest point on; one that the Earth blocks from
    where that of the horizon is, so that the sum is continuous there.
    """
    radius, sine = EARTH_RADIUS + np.asarray(height, dtype=float), np.sin(elevation)
    horizon = np.sqrt(np.maximum(radius**2 - EARTH_RADIUS**2, 0.0))
    lowest = np.minimum(-radius * sine, horizon)  # m along the ray
    start = np.maximum(lowest - REACH, 0.0)
    total = 0.0
    for gone in np.arange(0.0, 2.0 * REACH, STEP):
        s = start + gone
        h = np.sqrt(radius**2 + s**2 + 2.0 * radius * s * sine) - EARTH_RADIUS
        z = np.maximum((h - PEAK_HEIGHT) / SCALE_HEIGHT, -10.0)
        N = (0.5 if gone == 0.0 else 1.0) * exp(0.5 * (1.0 - z - exp(-z)))
        total = total + np.where((gone < FURTHEST) | (s < lowest + REACH), N, 0.0)
    return total * STEP / (SCALE_HEIGHT * np.sqrt(2.0 * np.pi * np.e))
