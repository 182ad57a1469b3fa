"""Light of a star of magnitude 0 at the entrance of a lens, and how much of it a detector counts.

The star is of type A0, as Vega, for which all magnitudes are equal. Its flux in the bands B, V, R and I is
that of Bessell, PASP 91, 589 (1979), in J that of Campins, Rieke and Lebofsky, AJ 90, 896 (1985); between
them and below B the logarithm of the flux per frequency is a straight line over that of the wavelength. A
band of the relative width w holds F w/h photons, F in W/m^2/Hz; in V that are 8.8e9 in a second and square
metre.

A bare silicon detector sees more than V. Its response over the wavelength, 1 at 550 nm where data sheets give
the quantum efficiency, is [E] that of detectors with front-side illumination and microlenses::

    flux = photons in V  x  factor of the band  x  area of the pupil  x  transmission  x  quantum efficiency
    factor of the band = integral of photons x response over photons in V

It is 4.0 for silicon, and 1 behind a V filter.
"""

import math
from functools import cache

import numpy as np

PLANCK = 6.62607015e-34  # J s, exact: SI
JANSKY = 1e-26  # W/m^2/Hz
WAVELENGTHS = np.array([440e-9, 550e-9, 640e-9, 790e-9, 1260e-9])  # m, of B, V, R, I, J
FLUXES = JANSKY * np.array([4260.0, 3640.0, 3080.0, 2550.0, 1600.0])  # W/m^2/Hz
V_BAND = 0.16  # width over wavelength
RESPONSE = np.array([  # [E] nm, relative quantum efficiency
    [350.0, 0.0], [400.0, 0.60], [450.0, 0.85], [500.0, 0.97], [550.0, 1.0], [600.0, 0.95], [650.0, 0.86],
    [700.0, 0.74], [750.0, 0.60], [800.0, 0.47], [850.0, 0.34], [900.0, 0.22], [950.0, 0.12], [1000.0, 0.05],
    [1050.0, 0.0],
])  # fmt: skip
BANDS = ("silicon", "V")
STEP = 1e-9  # m, of the integral


def photons(wavelength):
    """Photons of the star in a second, square metre and metre of wavelength. (n,) m -> (n,)"""
    x, known, fluxes = _logs(wavelength), _logs(WAVELENGTHS), _logs(FLUXES)
    k = np.clip(np.searchsorted(known, x) - 1, 0, len(known) - 2)
    slope = np.diff(fluxes) / np.diff(known)
    flux = [math.exp(one) for one in fluxes[k] + slope[k] * (x - known[k])]
    return np.array(flux) / (PLANCK * wavelength)


def _logs(values):
    """Natural logarithms as the C library has them, on all processors alike, before kernels are there."""
    return np.array([math.log(one) for one in values])


def photons_in_v():
    """Photons of the star in a second and square metre, in V."""
    return float(FLUXES[1]) * V_BAND / PLANCK


@cache
def factor(band):
    """Photons that count in one of the BANDS, over those in V."""
    if band == "V":
        return 1.0
    wavelength = np.arange(1e-9 * RESPONSE[0, 0], 1e-9 * RESPONSE[-1, 0], STEP) + 0.5 * STEP
    response = np.interp(1e9 * wavelength, *RESPONSE.T)
    return float(np.sum(photons(wavelength) * response) * STEP) / photons_in_v()


def zero_magnitude_flux(band, aperture, transmission, quantum_efficiency):
    """Electrons in a second from a star of magnitude 0. aperture : m, diameter of the pupil"""
    area = 0.25 * math.pi * aperture**2
    return photons_in_v() * factor(band) * area * transmission * quantum_efficiency
