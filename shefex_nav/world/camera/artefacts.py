"""What is in the frames besides catalogue stars: bad pixels, false objects, planets.

In: settings of the camera (Artefacts, Detector) and a random generator. Out: lists drawn once per run (bad
pixels, objects that are in no catalogue) or per frame (spikes).
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import silicon_magnitude
from shefex_nav.geometry.elementary import exp, log

# B-V of Mercury, Venus, Mars, Jupiter, Saturn (Allen's Astrophysical Quantities, 4th ed., table 12.10)
PLANET_BV = np.array([0.93, 0.82, 1.36, 0.83, 1.04])
FULL_MOON_VMAG = -12.74  # mean full Moon (Allen, 4th ed., section 12.12)
MOON_BV = 0.92
SMEAR_PX = 3.0  # over which the charge behind a hot pixel falls by a factor e [E]
MOON_DISTANCE = 384.4e6  # m, mean


class BadPixels(NamedTuple):
    """Defects of this run's detector, as indices into the flattened frame."""

    hot: np.ndarray  # (n,) pixels with extra dark current
    hot_rate: np.ndarray  # (n,) electrons/s
    dead: np.ndarray  # (m,) pixels that collect nothing
    smeared: np.ndarray  # (s,) pixels behind hot ones that get some of their charge
    smeared_rate: np.ndarray  # (s,) electrons/s
    known: np.ndarray  # (k, 2) row, column of those found before flight


def bad_pixels(settings, detector, rng):
    """Draw the detector's defects; the last `unknown_bad_pixels` hot ones appeared after the calibration.

    Their dark currents are spread evenly in the logarithm from `hot_pixel_weakest` to `hot_pixel_strongest`.
    A part of the charge of each, `hot_pixel_smear`, stays behind when its column is moved to the read-out.
    """
    n_hot = settings.hot_pixels + settings.unknown_bad_pixels
    n_pixels = detector.columns * detector.rows
    pixels = rng.choice(n_pixels, n_hot + settings.dead_pixels, replace=False)
    hot, dead = pixels[:n_hot], pixels[n_hot:]
    rates = exp(rng.uniform(*log((settings.hot_pixel_weakest, settings.hot_pixel_strongest)), n_hot))
    known = np.sort(np.concatenate([hot[: settings.hot_pixels], dead]))
    rows_columns = np.column_stack(np.divmod(known, detector.columns))
    smear = settings.hot_pixel_smear
    smeared, smeared_rate = _smear(smear, detector, hot, rates)
    return BadPixels(hot, (1.0 - smear) * rates, dead, smeared, smeared_rate, rows_columns)


def _smear(smear, detector, hot, rates):
    """Pixels that follow hot ones in their columns, and their share of the rates: falls off exponentially."""
    if smear == 0.0:
        return np.empty(0, np.int64), np.empty(0)
    behind = np.arange(1, int(5.0 * SMEAR_PX) + 1)
    share = exp(-behind / SMEAR_PX)
    pixels = hot[:, None] + detector.columns * behind
    charge = smear * rates[:, None] * share / share.sum()
    inside = pixels < detector.columns * detector.rows
    return pixels[inside], charge[inside]


def false_objects(settings, rng):
    """Point sources on the whole sky that no catalogue lists: directions (n, 3), magnitudes (n,)."""
    u_i = rng.standard_normal((settings.false_objects, 3))
    u_i /= np.linalg.norm(u_i, axis=1, keepdims=True)
    return u_i, magnitudes(settings, settings.false_objects, rng)


def magnitudes(settings, n, rng):
    """Magnitudes of n objects that no catalogue lists: (n,)."""
    return rng.uniform(settings.false_brightest, settings.false_faintest, n)


def spikes(settings, detector, rng):
    """Spots of one frame that are no stars (debris, particle hits): positions (n, 2) px, magnitudes (n,).

    Their number is Poisson distributed; they sit still for the exposure.
    """
    n = rng.poisson(settings.spikes_per_frame)
    if n == 0:
        return np.empty((0, 2)), np.empty(0)
    xy_px = rng.uniform([-0.5, -0.5], [detector.columns - 0.5, detector.rows - 0.5], (n, 2))
    return xy_px, magnitudes(settings, n, rng)


def planet_magnitudes(bodies):
    """Magnitudes of the planets in the band of a silicon detector: (5,)."""
    return silicon_magnitude(bodies.planet_vmag, PLANET_BV)


def full_moon_magnitude(bodies):
    """Magnitude in the band of a silicon detector that the Moon would have if it were full."""
    vmag = FULL_MOON_VMAG + 5.0 * math.log10(np.linalg.norm(bodies.moon_r_i) / MOON_DISTANCE)
    return silicon_magnitude(np.array([vmag]), np.array([MOON_BV]))[0]
