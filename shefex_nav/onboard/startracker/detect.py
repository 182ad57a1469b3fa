"""From the grey values of a frame to a table of point objects.

In: one frame. Out: `Detections`, brightest first, and the statistics of the frame. The steps of the
SHEFEX-2 star tracker (section 3.2): bad pixels are taken out, one pass over the frame stops at the first
pixel above the threshold, the object there is grown and its centre of mass enters a table sorted by
intensity. Two things differ from the paper: objects grow with a list of pixels instead of recursion, which
has no depth limit, and threshold and growth work on sums of 3x3 pixels, a short matched filter: a star that
is smeared over 4 pixels keeps twice the signal-to-noise ratio of its brightest pixel.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.background import N_BLOCK, block_sums, medians, repair, tile_statistics
from shefex_nav.records import Detections


class DetectParams(NamedTuple):
    """Settings of the detection."""

    bad_pixels: np.ndarray  # (n, 2) int64 row, column of pixels known to be bad
    tile_px: int  # background and noise are taken in square tiles of this side
    seed_sigma: float  # an object starts where a block is this far above the background
    grow_sigma: float  # and grows while blocks are this far above it
    min_pixels: int  # smaller objects are noise
    max_pixels: int  # larger ones are no stars
    max_peak_fraction: float  # of the light in one pixel; more is a hot pixel, the lens cannot do it
    max_objects: int  # length of the table
    saturation_dn: int  # grey value of a saturated pixel


class FrameStatistics(NamedTuple):
    """What a frame looks like as a whole."""

    mean_dn: float
    background_dn: float  # median over the tiles
    noise_dn: float  # standard deviation of one pixel, median over the tiles


def detect(params, image_dn):
    """Objects in a frame.

    Parameters
    ----------
    params : DetectParams
    image_dn : (rows, columns) uint8 or uint16; saturation_dn in the same grey values

    Returns
    -------
    Detections, brightest first, at most params.max_objects
    FrameStatistics
    """
    image_dn = np.ascontiguousarray(image_dn)
    if image_dn.ndim != 2 or image_dn.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"image: expected grey values of shape (rows, columns), uint8 or uint16, "
            f"got {image_dn.dtype} of shape {image_dn.shape}"
        )
    image_dn = repair(image_dn, params.bad_pixels)
    blocks = block_sums(image_dn)
    background, sigma, mean_dn = tile_statistics(blocks, params.tile_px)
    table, n = _detect_kernel(
        image_dn,
        blocks,
        background,
        sigma,
        params.tile_px,
        params.seed_sigma,
        params.grow_sigma,
        params.min_pixels,
        params.max_pixels,
        params.max_peak_fraction,
        params.saturation_dn,
        params.max_objects,
    )
    table = table[:n]
    detections = Detections(
        np.ascontiguousarray(table[:, :2]),
        table[:, 2].copy(),
        table[:, 3].astype(np.int64),
        table[:, 4].astype(np.int64),
    )
    statistics = FrameStatistics(mean_dn, *medians(background, sigma))
    return detections, statistics


@njit(cache=True)
def _grow(blocks, limit, tile, seed_r, seed_c, pixels):
    """List the connected blocks above their tile's limit in `pixels`; returns how many.

    The list is its own queue. A block that has been taken is marked by -1 - value. `tile` is the row or
    column of tiles of each row or column of pixels: looked up, as nine divisions a pixel were the most costly
    part.
    """
    rows, columns = blocks.shape
    pixels[0, 0], pixels[0, 1] = seed_r, seed_c
    blocks[seed_r, seed_c] = -1 - blocks[seed_r, seed_c]
    n, k = 1, 0
    while k < n:
        r, c = pixels[k, 0], pixels[k, 1]
        k += 1
        for y in range(max(1, r - 1), min(rows - 1, r + 2)):
            for x in range(max(1, c - 1), min(columns - 1, c + 2)):
                if blocks[y, x] > limit[tile[y], tile[x]]:
                    blocks[y, x] = -1 - blocks[y, x]
                    pixels[n, 0], pixels[n, 1] = y, x
                    n += 1
    return n


@njit(cache=True)
def _centroid(image_dn, blocks, background, pixels, n, saturation_dn):
    """Centre of light of a grown object: x, y, flux, peak, saturated pixels, touches the border.

    x = sum(w I x) / sum(w I), I a pixel above the background, w its block above the background. The plain
    centre of mass of a star cut at a threshold is drawn to the pixel grid, and over a wide window it is
    noisy; the weight, which is the star's own smoothed shape, goes to zero at the cut and takes streaks as
    they come. For a Gaussian spot in background noise it is as good as least squares.
    """
    rows, columns = image_dn.shape
    sum_w, sum_x, sum_y, flux, peak = 0.0, 0.0, 0.0, 0.0, 0.0
    n_saturated = 0
    touches = False
    for k in range(n):
        r, c = pixels[k, 0], pixels[k, 1]
        value = image_dn[r, c] - background / N_BLOCK
        weight = value * (-1 - blocks[r, c] - background)
        sum_w += weight
        sum_x += weight * c
        sum_y += weight * r
        flux += value
        peak = max(peak, value)
        n_saturated += image_dn[r, c] >= saturation_dn
        touches = touches or r == 1 or c == 1 or r == rows - 2 or c == columns - 2
    if sum_w <= 0.0:
        return 0.0, 0.0, 0.0, peak, n_saturated, True
    return sum_x / sum_w, sum_y / sum_w, flux, peak, n_saturated, touches


@njit(cache=True)
def _maximum(blocks):
    """Largest of some blocks; so simple that the compiler takes 16 of them at a time."""
    largest = blocks.dtype.type(-1)
    for k in range(blocks.shape[0]):
        largest = max(largest, blocks[k])
    return largest


@njit(cache=True)
def _insert(table, n, x, y, flux, n_pixels, n_saturated):
    """Put an object into the table sorted by flux, losing the faintest when it is full; new length."""
    if n == table.shape[0]:
        if n == 0 or flux <= table[n - 1, 2]:
            return n
        n -= 1
    k = n
    while k > 0 and table[k - 1, 2] < flux:
        table[k] = table[k - 1]
        k -= 1
    table[k, 0], table[k, 1], table[k, 2] = x, y, flux
    table[k, 3], table[k, 4] = n_pixels, n_saturated
    return n + 1


@njit(cache=True)
def _detect_kernel(
    image_dn,
    blocks,
    background,
    sigma,
    tile_px,
    seed_sigma,
    grow_sigma,
    min_pixels,
    max_pixels,
    max_peak_fraction,
    saturation_dn,
    max_objects,
):
    """One pass over the frame; objects that have been taken are marked in `blocks`.

    Returns
    -------
    table : (max_objects, 5) x, y, flux, pixels, saturated pixels
    n : int, length of the table
    """
    rows, columns = image_dn.shape
    seed_limit = np.floor(background + seed_sigma * sigma).astype(np.int64)
    grow_limit = np.floor(background + grow_sigma * sigma).astype(np.int64)
    tile = np.arange(max(rows, columns)) // tile_px
    pixels = np.empty((rows * columns, 2), dtype=np.int32)
    table = np.empty((max_objects, 5))
    n_objects = 0
    for r in range(1, rows - 1):
        i = tile[r]
        for j in range(seed_limit.shape[1]):
            limit = seed_limit[i, j]
            begin, end = max(1, j * tile_px), min((j + 1) * tile_px, columns - 1)
            if _maximum(blocks[r, begin:end]) <= limit:
                continue
            for c in range(begin, end):
                if blocks[r, c] <= limit:
                    continue
                n = _grow(blocks, grow_limit, tile, r, c, pixels)
                if n < min_pixels or n > max_pixels:
                    continue
                x, y, flux, peak, n_saturated, touches = _centroid(
                    image_dn, blocks, background[i, j], pixels, n, saturation_dn
                )
                if not touches and peak <= max_peak_fraction * flux:
                    n_objects = _insert(table, n_objects, x, y, flux, n, n_saturated)
    return table, n_objects
