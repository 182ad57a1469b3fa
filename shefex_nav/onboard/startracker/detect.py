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

from shefex_nav.records import Detections

BLOCK = 3  # pixels, side of the blocks that are summed
N_BLOCK = BLOCK * BLOCK
SIGMA_QUANTILE = 0.158655  # a normal variable is below its mean minus one sigma with this probability
# One grey value of quantisation in each pixel of a block: noise that no quantile of a flat frame shows.
QUANTISATION_SIGMA = np.sqrt(N_BLOCK / 12.0)


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
    image_dn : (rows, columns) uint8

    Returns
    -------
    Detections, brightest first, at most params.max_objects
    FrameStatistics
    """
    image_dn = repair(np.ascontiguousarray(image_dn), params.bad_pixels)
    table, n, *statistics = _detect_kernel(
        image_dn,
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
    return detections, FrameStatistics(*statistics)


@njit(cache=True)
def repair(image_dn, bad_pixels):
    """Copy of the frame with each bad pixel replaced by the mean of its good neighbours (up to 8)."""
    rows, columns = image_dn.shape
    repaired = image_dn.copy()
    bad = np.zeros(
        rows * columns // 8 + 1, dtype=np.uint8
    )  # one bit a pixel: as large as the frame it were slow
    for k in range(bad_pixels.shape[0]):
        p = bad_pixels[k, 0] * columns + bad_pixels[k, 1]
        bad[p >> 3] |= 1 << (p & 7)
    for k in range(bad_pixels.shape[0]):
        r, c = bad_pixels[k, 0], bad_pixels[k, 1]
        total, n = 0, 0
        for y in range(max(0, r - 1), min(rows, r + 2)):
            for x in range(max(0, c - 1), min(columns, c + 2)):
                p = y * columns + x
                if not bad[p >> 3] >> (p & 7) & 1:
                    total += image_dn[y, x]
                    n += 1
        repaired[r, c] = (total + n // 2) // n if n > 0 else 0
    return repaired


@njit(cache=True)
def block_sums(image_dn):
    """Sum of the 3x3 pixels around each pixel. (rows, columns) uint8 -> int16, zero along the border."""
    rows, columns = image_dn.shape
    blocks = np.empty((rows, columns), dtype=np.int16)
    column = np.empty(columns, dtype=np.int16)
    blocks[0], blocks[rows - 1] = 0, 0
    for r in range(1, rows - 1):
        above, middle, below, sums = image_dn[r - 1], image_dn[r], image_dn[r + 1], blocks[r]
        for c in range(columns):
            column[c] = np.int16(above[c]) + np.int16(middle[c]) + np.int16(below[c])
        sums[0], sums[columns - 1] = 0, 0
        for c in range(1, columns - 1):
            sums[c] = column[c - 1] + column[c] + column[c + 1]
    return blocks


@njit(cache=True)
def tile_statistics(blocks, tile_px):
    """Background and noise of the block sums in each tile, from blocks that do not overlap.

    The background is the median, the noise its distance from the quantile one sigma below: stars and spikes
    raise neither, as they only populate the upper end.

    Parameters
    ----------
    blocks : (rows, columns) int16, block sums
    tile_px : int, multiple of 3

    Returns
    -------
    background, sigma : (tile rows, tile columns) of block sums
    mean_dn : mean grey value of all pixels
    """
    rows, columns = blocks.shape
    n_r, n_c = (rows + tile_px - 1) // tile_px, (columns + tile_px - 1) // tile_px
    background, sigma = np.empty((n_r, n_c)), np.empty((n_r, n_c))
    counts = np.empty(N_BLOCK * 255 + 1, dtype=np.int32)
    total, n_total = 0, 0
    for i in range(n_r):
        for j in range(n_c):
            counts[:] = 0
            n = 0
            for r in range(i * tile_px + 1, min((i + 1) * tile_px, rows - 1), BLOCK):
                row = blocks[r, j * tile_px + 1 : min((j + 1) * tile_px, columns - 1) : BLOCK]
                for value in row:
                    counts[np.uint16(value)] += 1  # unsigned: no check for an index from the end
                    total += value
                n += len(row)
            n_total += n
            if n == 0:  # a sliver of one pixel along the border
                background[i, j], sigma[i, j] = background[max(i - 1, 0), max(j - 1, 0)], np.inf
                continue
            below, k = 0, 0
            quantile = np.zeros(2)
            for which in range(2):
                target = n * (SIGMA_QUANTILE if which == 0 else 0.5)
                while below + counts[k] < target:
                    below += counts[k]
                    k += 1
                quantile[which] = k - 0.5 + (target - below) / counts[k]
            background[i, j] = quantile[1]
            sigma[i, j] = max(quantile[1] - quantile[0], QUANTISATION_SIGMA)
    return background, sigma, total / (N_BLOCK * n_total)


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
    largest = np.int16(-1)
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
    mean_dn, background_dn, noise_dn : as in FrameStatistics
    """
    rows, columns = image_dn.shape
    blocks = block_sums(image_dn)
    background, sigma, mean_dn = tile_statistics(blocks, tile_px)
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
    return table, n_objects, mean_dn, np.median(background) / N_BLOCK, np.median(sigma) / BLOCK
