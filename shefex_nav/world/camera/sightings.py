"""What a star tracker finds in a picture that is not drawn: statistics in the place of rendering.

In: the true sky, camera and trajectory, and a `SightingModel` that was fitted to rendered pictures. Out, at
the same instants as pictures: a `Frame` without pixels, its `FrameTruth`, and a `Sighting`, the objects that
the detection finds. Where the stars of the field stand, how they move during the exposure, the sky background
and all that is constant in a run (mounting, focal length, principal point, brightness of each star) are those
of the rendered picture. Fitted are which sources are found and how well their centroids are measured.

The form of both is that of a Gaussian spot in noise: a star of E electrons, drawn out by its motion to the
standard deviations w along and s across, in pixels with the noise n.

The detection searches sums of 3x3 pixels. The middle one of a star holds B electrons of it (a spot that a
uniform streak of the length L draws out, over a square in its middle), with the deviation sqrt(9 n^2 + B); a
search begins where a sum is k times 3 n above the background. So the star is found with the probability

    Phi(d0 + d1 z + d2 p(L)),    z = (B - 3 k n) / sqrt(9 n^2 + B),    p(L) = x^2 exp(2 - 2 x),  x = L / 13

where d1 would be 1. The last term is what rendered pictures show: with its length a streak has more places
that each may be enough, until it breaks up into pieces that are not where the star is; p is 1 at most.
A streak that runs over the border is not found.

No unbiased centroid has less variance along a direction a, with b the one across, than the larger of
w_a^2 / E (the star's own shot noise) and 8 pi w_a^3 w_b (n / E)^2 (that of the background); see Winick, J.
Opt. Soc. Am. A 3 (1986) 1809. There the widths are those of the spot as pixels see it, w^2 + 1/12. A spot
that is sharper than about 0.6 pixels is not told by its pixels: what they leave out of it has a power that
goes with exp(-4 pi^2 s^2), the square of the spot's transfer function at one cycle a pixel. The fit says how
much of each, and what else, the real chain has.

Clutter is what is found and is no source of the sky: spots of a frame, hot pixels that no list has, and, the
more the longer the streaks, pieces of those that break up. It is counted by the exposure control; a wrong fix
that it causes is in the table of identification.
"""

from math import erf, erfc, exp, pi, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.pinhole import turn_slopes
from shefex_nav.records import Detections
from shefex_nav.world.camera.undrawn import EDGE_PX

BLOCK = 3  # pixels, side of the sums that the detection searches (onboard.startracker.background)
PIXEL_VARIANCE = 1.0 / 12.0  # px^2 per axis
SHARP_PX = 0.5
TERMS = 4  # of a variance
PLACES_PX = 13.0  # streaks of this length are found most easily for the light in their middle
BROKEN_PX = 20.0  # as long are streaks that break up as often as they will
NOTHING = Detections(
    np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2, 2))
)


class SightingModel(NamedTuple):
    """What rendered pictures showed of sources that are found; fitted by `shefex-nav characterise`."""

    detection: np.ndarray  # (3,) d: a source is found with the probability Phi(d . features)
    border_px: float  # a source whose streak ends nearer to the border is not found
    noise: np.ndarray  # (4,) of the variance of a centroid: of each of its `terms`
    reported: np.ndarray  # (4,) of the variance that is reported with it
    clutter: np.ndarray  # (2,) mean number of other objects: always; more with long streaks, `broken`
    saturation_electrons: float  # light in the brightest pixel above which a source counts as saturated
    mean_offset_dn: float  # of the frame's mean grey value against the one expected


class Sighting(NamedTuple):
    """What the detection finds in one frame."""

    detections: Detections
    hip: np.ndarray  # (n,) Hipparcos number of the catalogue star that it is, 0 for anything else
    mean_dn: float  # mean grey value of the frame


class Chances(NamedTuple):
    """Random numbers of one frame for each source, and what they are used with."""

    normal: np.ndarray  # (n, 2)
    uniform: np.ndarray  # (n,)


def sight(model, camera, film, scene, rng, detection):
    """What the detection finds, and where it says it is.

    Parameters
    ----------
    model : SightingModel
    camera : Camera
    film, scene : Exposure, (hip, xy_px, electrons) of `undrawn.look`
    rng : Generator
    detection : its settings: the brightest `most_objects` are kept; a search begins `seed_sigma` above the
        background; a frame whose mean is the grey value of `saturation` or more shows no stars

    Returns
    -------
    Sighting, brightest object first
    """
    hole, most_dn = camera.pinhole, 2.0**camera.settings.detector.bits - 1.0
    mean_dn = min(film.mean_dn + model.mean_offset_dn, most_dn)
    if mean_dn >= detection.saturation:
        return Sighting(NOTHING, np.zeros(0, dtype=np.int64), float(mean_dn))
    chances = Chances(rng.standard_normal((len(scene[0]), 2)), rng.random(len(scene[0])))
    clutter = rng.poisson(model.clutter[0] + model.clutter[1] * broken(rotation_px(hole, film)))
    places = rng.random((clutter, 2))
    hip, *detections = _sight_kernel(
        model, hole, film, scene, chances, places, detection.seed_sigma, detection.most_objects
    )
    return Sighting(Detections(*detections), hip, float(mean_dn))


def rotation_px(hole, film):
    """By how much the camera turns during an exposure."""
    return hole.focal_length_px * sqrt(film.omega_c @ film.omega_c) * film.exposure_s


def broken(length_px):
    """Share of the clutter of long streaks that streaks of a length have: 0 for none, 1 from BROKEN_PX on."""
    return np.minimum(length_px / BROKEN_PX, 1.0) ** 2


@kernel
def shape(hole, film, x_px, y_px):
    """The spot of a star: standard deviations along its streak and across, and the streak's direction.

    Pinhole, Exposure, place of the star -> (along_px, across_px, unit vector x, y)
    """
    x, y = (x_px - hole.cx_px) / hole.focal_length_px, (y_px - hole.cy_px) / hole.focal_length_px
    dx, dy = turn_slopes(x, y)
    way = film.exposure_s * hole.focal_length_px
    w = film.omega_c
    along_x = way * (dx[0] * w[0] + dx[1] * w[1] + dx[2] * w[2])
    along_y = way * (dy[0] * w[0] + dy[1] * w[1] + dy[2] * w[2])
    length = np.sqrt(along_x * along_x + along_y * along_y)
    s = film.psf_sigma_px
    if length < 1e-9:
        return s, s, 1.0, 0.0
    return np.sqrt(s * s + length * length / 12.0), s, along_x / length, along_y / length


@inner
def streak_px(along_px, across_px):
    """Length of a streak with these standard deviations, `shape`."""
    return sqrt(max(12.0 * (along_px**2 - across_px**2), 0.0))


@kernel
def margin_px(place, spot, size):
    """From the nearer end of a streak to the border. Its middle, its `shape`, (width, height) in pixels"""
    along, across, ex, ey = spot
    half = 0.5 * streak_px(along, across)
    x, y = (
        min(place[0] + EDGE_PX, size[0] - EDGE_PX - place[0]),
        min(place[1] + EDGE_PX, size[1] - EDGE_PX - place[1]),
    )
    return min(x - abs(ex) * half, y - abs(ey) * half)


@kernel
def terms(along_px, across_px, electrons, noise):
    """Parts of the variance of a centroid along the streak and across it [px^2].

    Each (1, shot noise, background, sharpness): that of 1 is for all stars; sharpness is 1 at half a pixel.
    """
    along2, across2 = along_px**2 + PIXEL_VARIANCE, across_px**2 + PIXEL_VARIANCE
    both = 8.0 * pi * sqrt(along2 * across2) * (noise / electrons) ** 2
    sharp = exp(-4.0 * pi**2 * (across_px**2 - SHARP_PX**2))
    return (
        (1.0, along2 / electrons, both * along2, sharp),
        (1.0, across2 / electrons, both * across2, sharp),
    )


@kernel
def contrast(along_px, across_px, electrons, noise):
    """q, by how much the brightest pixel of a star stands out of the noise."""
    return electrons / (2.0 * pi * along_px * across_px * noise)


@kernel
def features(along_px, across_px, electrons, noise, seed_sigma):
    """What a star is found by: (1, z, p(L)), as at the head of this file."""
    length = streak_px(along_px, across_px)
    half = 0.5 * BLOCK
    if length < 1e-3 * across_px:
        part = erf(half / (sqrt(2.0) * across_px))
    else:
        part = _area(half + 0.5 * length, across_px) - _area(half - 0.5 * length, across_px)
        part /= length
    block = electrons * part * erf(half / (sqrt(2.0) * across_px))
    floor = BLOCK * noise
    z = (block - seed_sigma * floor) / sqrt(floor**2 + block)
    x = length / PLACES_PX
    return 1.0, z, x * x * exp(2.0 - 2.0 * x)


@inner
def _area(x, sigma):
    """Integral of erf(x / (sqrt(2) sigma)) from 0, and a constant."""
    return x * erf(x / (sqrt(2.0) * sigma)) + sigma * sqrt(2.0 / pi) * exp(-0.5 * (x / sigma) ** 2)


@kernel
def _sight_kernel(model, hole, film, scene, chances, places, seed_sigma, most):
    """Hipparcos numbers, and fields of Detections, of the brightest `most` objects, brightest first.

    scene : as of `sight`
    places : (m, 2) uniform, of objects that are no source, anywhere: as bright as it takes, the first to go
        if the table is full
    """
    hip, xy_px, electrons = scene
    found, seen_px, P_px, saturated = _sources(model, hole, film, xy_px, electrons, chances, seed_sigma)
    sources, m = np.flatnonzero(found), places.shape[0]
    least = seed_sigma * BLOCK * film.noise_electrons
    light = np.concatenate((electrons[sources], np.full(m, least)))
    rows = np.argsort(-light, kind="mergesort")[:most]  # stable
    n = rows.size
    names, n_saturated, whole = np.zeros(n, np.int64), np.zeros(n, np.int64), hole.width_px * hole.height_px
    out_px, P_out_px = np.empty((n, 2)), np.zeros((n, 2, 2))
    spot = film.psf_sigma_px, film.psf_sigma_px, least, film.noise_electrons
    variance = np.dot(model.reported, np.array(terms(*spot)[0]))
    for k in range(n):
        if rows[k] < sources.size:
            j = sources[rows[k]]
            names[k], out_px[k], P_out_px[k] = hip[j], seen_px[j], P_px[j]
            n_saturated[k] = whole if saturated[j] else 0
        else:
            j = rows[k] - sources.size
            for i in range(2):
                side = hole.width_px if i == 0 else hole.height_px
                out_px[k, i] = model.border_px - EDGE_PX + (side - 2.0 * model.border_px) * places[j, i]
                P_out_px[k, i, i] = variance
    return names, out_px, light[rows] / film.electrons_per_dn, np.zeros(n, np.int64), n_saturated, P_out_px


@inner
def _sources(model, hole, film, xy_px, electrons, chances, seed_sigma):
    """(found, measured places, reported covariances, is saturated) of n sources of the sky."""
    n, size = electrons.size, (hole.width_px, hole.height_px)
    found, saturated = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    seen_px, P_px = xy_px.copy(), np.zeros((n, 2, 2))
    for k in range(n):
        if electrons[k] <= 0.0:
            continue
        along, across, ex, ey = shape(hole, film, xy_px[k, 0], xy_px[k, 1])
        if margin_px(xy_px[k], (along, across, ex, ey), size) <= model.border_px:
            continue
        one, z, places = features(along, across, electrons[k], film.noise_electrons, seed_sigma)
        t = model.detection[0] * one + model.detection[1] * z + model.detection[2] * places
        found[k] = chances.uniform[k] < 0.5 * erfc(-t / sqrt(2.0))
        saturated[k] = electrons[k] / (2.0 * pi * along * across) > model.saturation_electrons
        t_along, t_across = terms(along, across, electrons[k], film.noise_electrons)
        true_a, true_b, said_a, said_b = 0.0, 0.0, 0.0, 0.0
        for m in range(TERMS):
            true_a += model.noise[m] * t_along[m]
            true_b += model.noise[m] * t_across[m]
            said_a += model.reported[m] * t_along[m]
            said_b += model.reported[m] * t_across[m]
        a, b = np.sqrt(true_a) * chances.normal[k, 0], np.sqrt(true_b) * chances.normal[k, 1]
        seen_px[k, 0] += a * ex - b * ey
        seen_px[k, 1] += a * ey + b * ex
        P_px[k, 0, 0] = said_a * ex * ex + said_b * ey * ey
        P_px[k, 1, 1] = said_a * ey * ey + said_b * ex * ex
        P_px[k, 0, 1] = P_px[k, 1, 0] = (said_a - said_b) * ex * ey
    return found, seen_px, P_px, saturated
