"""Charge that particles leave in single frames: upsets of one pixel or a few, and trails of protons.

In: how many, how strong, where. Out: `Hits`, pixels and the mean charge that each gets. It does not pass
through the lens: an upset is as small as its charge spreads by diffusion, a trail is a straight line that
leaves in each pixel charge in proportion to its way there. A trail belongs to one frame as a whole: particles
take no time.

Sizes and charges are engineering values [E]. For scale: a proton of 100 MeV leaves about 370 electrons in a
micrometre of silicon (stopping power 5.8 MeV cm^2/g, 3.65 eV for each electron).
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.elementary import exp, log
from shefex_nav.world.camera.render import add_charge

DIFFUSION_PX = 0.3  # sigma of the charge of an upset [E]
REACH_PX = 2  # half width of its patch


class Hits(NamedTuple):
    """Charge of particles in one frame; a pixel may occur more than once."""

    pixel: np.ndarray  # (n,) index into the flattened frame
    electrons: np.ndarray  # (n,)


NO_HITS = Hits(np.empty(0, np.int64), np.empty(0))


def upsets(width_px, height_px, xy_px, electrons):
    """Hits of particles that come down steeply.

    Parameters
    ----------
    width_px, height_px : int, of the detector
    xy_px : (n, 2) where they hit
    electrons : (n,) charge of each
    """
    offsets = np.arange(-REACH_PX, REACH_PX + 1)
    centre = np.floor(np.asarray(xy_px, dtype=float) + 0.5).astype(np.int64)  # (n, 2)
    pixels = centre[:, None, :] + offsets[None, :, None]  # (n, 5, 2) columns and rows
    within = pixels - np.asarray(xy_px)[:, None, :]
    shares = _normal((within + 0.5) / DIFFUSION_PX) - _normal((within - 0.5) / DIFFUSION_PX)
    charge = np.asarray(electrons)[:, None, None] * shares[:, :, None, 1] * shares[:, None, :, 0]
    columns, rows = pixels[:, None, :, 0], pixels[:, :, None, 1]
    inside = (columns >= 0) & (columns < width_px) & (rows >= 0) & (rows < height_px) & (charge >= 1.0)
    return Hits((rows * width_px + columns)[inside], charge[inside])


def _normal(x):
    """Distribution function of the standard normal distribution."""
    from math import erfc, sqrt

    return 0.5 * np.vectorize(erfc, otypes=[float])(-x / sqrt(2.0))


def trail(width_px, height_px, from_px, to_px, electrons_per_px):
    """Hits of one particle that flies along the detector.

    Parameters
    ----------
    width_px, height_px : int, of the detector
    from_px, to_px : (2,) ends of its way
    electrons_per_px : float, charge for one pixel's width of the way
    """
    from_px, way = np.asarray(from_px, dtype=float), np.subtract(to_px, from_px)
    cuts = [np.zeros(1), np.ones(1)]  # where it passes from pixel to pixel, as a part of the way
    for start, length in zip(from_px, way, strict=True):
        if length != 0.0:
            low, high = np.sort([start, start + length])
            edges = np.arange(np.ceil(low - 0.5), np.floor(high - 0.5) + 1.0) + 0.5
            cuts.append((edges - start) / length)
    cuts = np.sort(np.clip(np.concatenate(cuts), 0.0, 1.0))
    middle = from_px + 0.5 * (cuts[1:] + cuts[:-1])[:, None] * way
    column, row = np.floor(middle + 0.5).astype(np.int64).T
    charge = electrons_per_px * np.hypot(*way) * np.diff(cuts)
    inside = (column >= 0) & (column < width_px) & (row >= 0) & (row < height_px) & (charge > 0.0)
    return Hits((row * width_px + column)[inside], charge[inside])


def joined(hits):
    """One Hits of several."""
    return Hits(np.concatenate([h.pixel for h in hits]), np.concatenate([h.electrons for h in hits]))


def of_frame(settings, detector, rng):
    """Draw the particles of one frame, anywhere on the detector. Artefacts, Detector, Generator -> Hits.

    Their numbers are Poisson distributed, charges and lengths spread evenly in the logarithm.
    """
    if settings.upsets_per_frame == 0.0 and settings.trails_per_frame == 0.0:
        return NO_HITS
    size = np.array([detector.columns, detector.rows])
    weight = log((settings.particle_weakest, settings.particle_strongest))
    n = rng.poisson(settings.upsets_per_frame)
    places = rng.uniform(-0.5, size - 0.5, (n, 2))
    found = [upsets(*size, places, exp(rng.uniform(*weight, n)))]
    for _ in range(rng.poisson(settings.trails_per_frame)):
        start, angle = rng.uniform(-0.5, size - 0.5), rng.uniform(0.0, 2.0 * np.pi)
        length_px = math.exp(rng.uniform(0.0, math.log(settings.trail_longest)))
        end = start + length_px * np.array([np.cos(angle), np.sin(angle)])
        found.append(trail(*size, start, end, math.exp(rng.uniform(*weight))))
    return joined(found)


def add_hits(light, hits):
    """Add their charge to the light of a frame, in place. Light, Hits."""
    add_charge(light, hits.pixel, hits.electrons)
