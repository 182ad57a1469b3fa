"""Point-like objects in a picture of the night sky, by the detection that flies.

In: grey values of any range over any background. Out: centroids with a covariance each and brightnesses,
brightest first. Large pictures are binned. What varies over tiles of the picture (sky glow, clouds,
vignetting) is taken away, the noise is brought to a few grey values, so that the detection of the star
tracker can be used as it is. Its fit of the spots sees finer grey values, up to where the picture itself is
saturated: of a bright star the slopes are fitted. Gaps between leaves and the like have no sky around them,
or do not stand out of what is near them (`foreground`): the former are dropped, the latter are marked.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.onboard.startracker import fit
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.objects import detect
from shefex_nav.onboard.startracker.scan import BACKGROUND, FLUX, NOISE, PIXELS, X, Y
from shefex_nav.onboard.startracker.settings import Detection
from shefex_nav.onboard.startracker.spot import Picture
from shefex_nav.solve import foreground
from shefex_nav.solve.background import FLAT_SIGMA, grey_step, measured, new_lines, take_away

LARGEST_PX = 2048  # of the longer side; larger pictures are binned
BLACK_DN, NOISE_DN, WHITE_DN = 20.0, 3.0, 255.0  # of the 8-bit frame
APERTURE_PX = 1.0  # beyond the radius of an object, for its brightness
RING_SIGMA, RING_HEIGHT = 5.0, 0.1  # of the noise, of an object's height: a pixel beyond is no sky
RING_SHARE = 0.25  # of the pixels around an object that may be none
PROMINENT = 5.0  # of the scatter around it, height of a star
COMPANY = 0.06  # of the picture's size: so near a gap has other gaps
FINER, FULL_DN = 32, 65535  # grey values of the fit for one of the detection; a saturated pixel there
FULL_SHARE = 0.97  # of the brightest pixel's height: what is above is saturated, as JPEG rings a little
BLOB_SHARE = 0.06  # of its radius, error of the place of a star that is mostly saturated
CORE_PX = 1.5  # radius around the middle that has to stand out
CROWDED, FAINT = 0, 1  # no sky around it; no more than the noise in its middle

DETECTION = Detection(
    scan="sequential",
    centroid="fit",
    tile=72,
    seed_sigma=5.5,
    grow_sigma=3.5,
    fewest_pixels=5,
    most_pixels=1500,
    largest_peak=0.85,
    most_objects=1000,
    saturation=255.0,
    run_length=None,
)
BINNED = replace(DETECTION, fewest_pixels=3, largest_peak=1.0)  # a sharp star is hardly more than a pixel


class Field(NamedTuple):
    """What was found in a picture."""

    xy_px: np.ndarray  # (n, 2) centroids in pixels of the picture as it is
    P_px: np.ndarray  # (n, 2, 2) px^2, their covariance by the noise of the pixels
    flux: np.ndarray  # (n,) descending, grey values
    saturated: np.ndarray  # (n,) bool, in the middle
    in_sky: np.ndarray  # (n,) bool, nothing of `foreground` speaks against it
    n_pixels: np.ndarray  # (n,) of the binned picture
    binning: int
    noise: float  # grey values, of one binned pixel
    refused_px: np.ndarray  # (m, 2) places of objects that are none of the above
    refused_for: np.ndarray  # (m,) CROWDED or FAINT


def find(grey):
    """Point-like objects of a picture. (rows, columns) grey values -> Field."""
    binning = int(np.ceil(max(grey.shape) / LARGEST_PX))
    step = grey_step(grey)
    if binning > 1:
        grey = binned(grey, binning)
    below, noise, sky = measured(grey, step)
    darkest, brightest = float(grey.min()), float(grey.max())
    full = darkest + FULL_SHARE * (brightest - darkest)
    flat, frame, fine = frames_of(grey, below, full, NOISE_DN / noise)
    found, at_full, fitted_flux = detected(frame, fine, noise, DETECTION if binning == 1 else BINNED)
    radius_px = np.sqrt(found.n_pixels / np.pi)
    flux = aperture(flat, found.xy_px, radius_px + APERTURE_PX)
    flux[at_full] = np.maximum(flux, fitted_flux)[at_full]
    # the tiles of the detection see no noise where rounding has left a picture without any
    core = aperture(flat, found.xy_px, np.full(len(flux), CORE_PX))
    limit = np.maximum(RING_SIGMA * noise, RING_HEIGHT * core / (np.pi * CORE_PX**2))
    lonely = foreground.crowding(flat, found.xy_px, radius_px, limit) < RING_SHARE
    clear = core > DETECTION.seed_sigma * np.sqrt(np.pi) * CORE_PX * noise
    good = lonely & clear & (flux > 0.0)
    in_sky = good & foreground.brighter_than_sky(grey, found.xy_px, sky, noise)
    floor = max(noise / 3.0, FLAT_SIGMA * step)  # of a mean of nine; a block of a JPEG is rounded as one
    in_sky &= foreground.prominence(flat, found.xy_px, radius_px, floor) > PROMINENT
    in_sky &= ~foreground.among_others(found.xy_px, core, in_sky, COMPANY * np.sqrt(flat.size))
    order = np.argsort(-flux, kind="stable")
    order, others = order[good[order]], np.flatnonzero(~good)
    bright = order[in_sky[order]]
    in_sky[bright] = ~foreground.in_line(found.xy_px[bright], len(bright))
    in_sky = in_sky[order]
    xy_px = found.xy_px * binning + 0.5 * (binning - 1)
    return Field(
        np.ascontiguousarray(xy_px[order]), binning**2 * found.P_px[order], flux[order], at_full[order],
        in_sky, found.n_pixels[order], binning, float(noise), xy_px[others],
        np.where(lonely[others], FAINT, CROWDED),
    )  # fmt: skip


def detected(frame, fine, noise, settings):
    """Objects of a picture without its background: Detections, which are saturated, flux of the fit [grey].

    The scan sees 8 bits; the fit of the spots sees FINER steps, up to where the picture itself is saturated.
    """
    fitted = []

    def centres(settings, camera, image_dn, table):
        table = table.copy()
        table[:, NOISE] = np.maximum(table[:, NOISE], NOISE_DN)  # more than is left where JPEG smooths
        table[:, [FLUX, BACKGROUND, NOISE]] *= FINER
        spot = Picture(fine, camera.bad_pixels, FULL_DN, 0.0)
        xy_px, flux, P_px = fit.centroids(spot, table, float(camera.psf_sigma))
        at_full = saturated_pixels(fine, table[:, [X, Y]]) > 0
        fitted.extend((at_full, flux))
        blob = BLOB_SHARE**2 * table[:, PIXELS] / np.pi * at_full
        return xy_px, flux, P_px + blob[:, None, None] * np.eye(2)

    found, _ = detect(settings, CameraModel(), frame, centres)
    at_full, flux = fitted
    turn = np.argsort(-flux, kind="mergesort")  # as `detect` sorts them
    return found, at_full[turn], flux[turn] * noise / (FINER * NOISE_DN)


@kernel
def frames_of(grey, below, full, gain):
    """Picture without its background, 8-bit frame of the detection, 16-bit frame of the fit, in one pass.

    The noise of the second is NOISE_DN, that of the third FINER times that. In float32, as the picture: eight
    pixels at a time.
    """
    rows, columns = grey.shape
    flat = np.empty((rows, columns), dtype=np.float32)
    frame, fine = np.empty((rows, columns), dtype=np.uint8), np.empty((rows, columns), dtype=np.uint16)
    black, gain, half, finer = np.float32(BLACK_DN), np.float32(gain), np.float32(0.5), np.float32(FINER)
    full, least = np.float32(full), np.float32(0.0)
    white, most = np.float32(WHITE_DN), np.float32(FULL_DN - 1.0)
    lines = new_lines(below, columns)
    for r in range(rows):
        seen, line, coarse, deep = grey[r], flat[r], frame[r], fine[r]
        take_away(below, lines, r, seen, line)
        for c in range(columns):
            value = black + gain * line[c]
            dn, fine_dn = value + half, finer * value + half
            dn = dn if dn > least else least
            fine_dn = fine_dn if fine_dn > least else least
            coarse[c] = np.int32(dn if dn < white else white)
            fine_dn = fine_dn if fine_dn < most else most
            deep[c] = np.int32(FULL_DN) if seen[c] >= full else np.int32(fine_dn)
    return flat, frame, fine


@kernel
def saturated_pixels(fine, xy_px):
    """How many of the nine pixels in the middle of each object are saturated. -> (n,)"""
    n = np.zeros(xy_px.shape[0], dtype=np.int64)
    for k in range(xy_px.shape[0]):
        column, row = int(xy_px[k, 0] + 0.5), int(xy_px[k, 1] + 0.5)
        for r in range(max(row - 1, 0), min(row + 2, fine.shape[0])):
            for c in range(max(column - 1, 0), min(column + 2, fine.shape[1])):
                n[k] += fine[r, c] >= FULL_DN
    return n


def binned(grey, n):
    """Mean of blocks of n x n pixels; what is left over at the right and the lower border is cut."""
    rows, columns = grey.shape[0] // n, grey.shape[1] // n
    blocks = grey[: rows * n, : columns * n].reshape(rows, n, columns, n)
    return blocks.mean(axis=(1, 3), dtype=np.float32)


@kernel
def aperture(flat, xy_px, radius_px):
    """Sum of the grey values within the radius of each object. -> (n,)."""
    total = np.zeros(xy_px.shape[0])
    rows, columns = flat.shape
    for k in range(xy_px.shape[0]):
        x, y, radius = xy_px[k, 0], xy_px[k, 1], radius_px[k]
        for r in range(max(int(y - radius), 0), min(int(y + radius) + 2, rows)):
            for c in range(max(int(x - radius), 0), min(int(x + radius) + 2, columns)):
                if (c - x) ** 2 + (r - y) ** 2 <= radius * radius:
                    total[k] += flat[r, c]
    return total
