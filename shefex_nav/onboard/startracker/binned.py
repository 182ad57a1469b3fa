"""A frame in bins of 2x2 pixels, in units of its own noise: what the search for streaks works on.

In: the frame and the pixels known to be bad. Out: level and noise of the bins in tiles, and the bins as
signal-to-noise ratios. Level and noise are quantiles as in `background`: stars raise neither. The level is
interpolated between the middles of the tiles, as a step of it at the border of two would look like a streak.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.background import SIGMA_QUANTILE, is_bad, place_of_quantile, whole_sigma

BIN = 2  # px
N_BIN = BIN * BIN
LEAST_TILE_PX = 96  # of 2304 bins the median is good to 0.026 sigma; a streak sums up over fifty of them
QUANTISATION_SIGMA = np.sqrt(N_BIN / 12.0)  # one grey value in each pixel: noise that a flat frame hides
SAMPLE = 97  # bins that tell the range of the grey values of a tile
LEVELS = 2048  # steps of that range
PER_SIGMA = 64.0  # steps per sigma of the sample


class Level(NamedTuple):
    """Background and noise of one PIXEL in square tiles."""

    tile: int  # side of a tile in bins
    background: np.ndarray  # (tile rows, tile columns) DN
    noise: np.ndarray  # (tile rows, tile columns) DN, standard deviation


class Bins(NamedTuple):
    """A frame in units of its noise, with empty bins on each side."""

    upright: np.ndarray  # (rows + 2 pad, columns + 2 pad) float32
    turned: np.ndarray  # (columns + 2 pad, rows + 2 pad) float32, room for its transpose


def level_of(image_dn, bad, tile_px):
    """Sums of 2x2 pixels, level and noise in tiles, and mean grey value of a frame.

    Parameters
    ----------
    image_dn : (rows, columns) uint8 or uint16
    bad : (rows * columns // 8 + 1,) uint8 of `bad_map`
    tile_px : int, wanted side of a tile

    Returns
    -------
    sums : (rows // 2, columns // 2) int32; a bad pixel counts as the mean of the good ones of its bin
    level : Level
    mean_dn : float
    """
    tile = max(int(tile_px), LEAST_TILE_PX) // BIN
    sums = np.empty((image_dn.shape[0] // BIN, image_dn.shape[1] // BIN), dtype=np.int32)
    total = _bin_kernel(image_dn, sums)
    _repair_kernel(image_dn, bad, sums)
    background, sigma = _tiles_kernel(sums, tile)
    return sums, Level(tile, background / N_BIN, sigma / BIN), total / (N_BIN * sums.size)


@kernel
def _bin_kernel(image_dn, sums):
    """Write the sums; returns the sum of all."""
    total = 0
    for r in range(sums.shape[0]):
        upper, lower, row = image_dn[2 * r], image_dn[2 * r + 1], sums[r]
        part = np.int64(0)
        for c in range(sums.shape[1]):
            value = np.int32(upper[2 * c]) + np.int32(upper[2 * c + 1])
            value += np.int32(lower[2 * c]) + np.int32(lower[2 * c + 1])
            row[c] = value
            part += value
        total += part
    return total


@kernel
def _repair_kernel(image_dn, bad, sums):
    """Bins with bad pixels get four times the mean of their good ones, or of a neighbour bin."""
    columns = image_dn.shape[1]
    for byte in range(bad.shape[0]):
        if bad[byte] == 0:
            continue
        for bit in range(8):
            if not bad[byte] >> bit & 1:
                continue
            r, c = (8 * byte + bit) // columns // BIN, (8 * byte + bit) % columns // BIN
            if r >= sums.shape[0] or c >= sums.shape[1]:
                continue
            total, n = 0, 0
            for y in range(2 * r, 2 * r + 2):
                for x in range(2 * c, 2 * c + 2):
                    if not is_bad(bad, y * columns + x):
                        total += np.int64(image_dn[y, x])
                        n += 1
            sums[r, c] = (4 * total + n // 2) // n if n > 0 else sums[r, c - 1 if c > 0 else c + 1]


@kernel
def _tiles_kernel(sums, tile):
    """Median, and its distance from the quantile one sigma below, of the sums in each tile."""
    rows, columns = sums.shape
    n_r, n_c = max(1, rows // tile), max(1, columns // tile)  # the last one takes what is left over
    background, sigma = np.empty((n_r, n_c)), np.empty((n_r, n_c))
    counts = np.empty(LEVELS, dtype=np.int32)
    for i in range(n_r):
        for j in range(n_c):
            bottom = (i + 1) * tile if i < n_r - 1 else rows
            right = (j + 1) * tile if j < n_c - 1 else columns
            part = sums[i * tile : bottom, j * tile : right]
            background[i, j], low = _two_quantiles(part, counts)
            sigma[i, j] = whole_sigma(background[i, j], background[i, j] - low, N_BIN, part, 1)
    return background, sigma


@inner
def _two_quantiles(part, counts):
    """Median and lower one-sigma quantile of whole numbers, counted in steps around those of a sample."""
    rows, columns = part.shape
    n = rows * columns
    sample = np.empty(min(SAMPLE, n))
    for k in range(sample.shape[0]):
        p = (k * n) // sample.shape[0]
        sample[k] = part[p // columns, p % columns]
    sample.sort()
    middle = sample[sample.shape[0] // 2]
    spread = max(middle - sample[int(SIGMA_QUANTILE * sample.shape[0])], QUANTISATION_SIGMA)
    shift = max(0, int(np.floor(np.log2(spread / PER_SIGMA)))) if spread > PER_SIGMA else 0
    low = np.int32(middle) - np.int32((LEVELS // 2) << shift)
    counts[:] = 0
    for r in range(rows):
        for value in part[r]:
            step = (value - low) >> shift
            counts[np.uint32(min(max(step, 0), LEVELS - 1))] += 1
    first, part_first, below = place_of_quantile(counts, n * SIGMA_QUANTILE, 0, 0)
    middle, part_middle, _ = place_of_quantile(counts, n * 0.5, first, below)
    step = 1 << shift
    return low + (middle + part_middle) * step - 0.5, low + (first + part_first) * step - 0.5


def in_noise(sums, level, clip, pad):
    """Bins above the background over their noise, cut off at clip, with `pad` empty bins on each side.

    Parameters
    ----------
    sums : (rows, columns) int32
    level : Level
    clip : float, in sigma of a bin; no single bin counts for more
    pad : int

    Returns
    -------
    Bins, `turned` not written
    """
    rows, columns = sums.shape[0] + 2 * pad, sums.shape[1] + 2 * pad
    # one block: smaller ones go back to the system after each frame, and to get them anew takes time
    block = np.empty((2, rows * columns), dtype=np.float32)
    out = block[0].reshape(rows, columns)
    out[:pad] = out[-pad:] = 0.0
    out[:, :pad] = out[:, -pad:] = 0.0
    _in_noise_kernel(sums, N_BIN * level.background, 1.0 / (BIN * level.noise), level.tile, clip, pad, out)
    return Bins(out, block[1].reshape(columns, rows))


@inner
def _between_tiles(place, tile, n):
    """Tile before a place, and the weight of the next one."""
    at = min(max((place + 0.5) / tile - 0.5, 0.0), n - 1.0)
    first = min(int(at), max(n - 2, 0))
    return first, at - first


@inner
def interpolated(table, tile, row, column):
    """A table of tiles at a bin."""
    i, u = _between_tiles(row, tile, table.shape[0])
    j, v = _between_tiles(column, tile, table.shape[1])
    i_next, j_next = min(i + 1, table.shape[0] - 1), min(j + 1, table.shape[1] - 1)
    upper = table[i, j] + v * (table[i, j_next] - table[i, j])
    lower = table[i_next, j] + v * (table[i_next, j_next] - table[i_next, j])
    return upper + u * (lower - upper)


@kernel
def _in_noise_kernel(sums, background, weight, tile, clip, pad, out):
    """Write the bins to the middle of `out`; background and 1 / noise of the sums in tiles."""
    rows, columns = sums.shape
    n_r, n_c = background.shape
    b, w = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    first, part = np.empty(columns, dtype=np.int64), np.empty(columns)
    for c in range(columns):
        first[c], part[c] = _between_tiles(c, tile, n_c)
    most = np.float32(clip)
    for r in range(rows):
        i, u = _between_tiles(r + 1.5, tile, n_r)
        i_next = min(i + 1, n_r - 1)
        if r % 4 == 0:
            for c in range(columns):
                j, j_next, v = first[c], min(first[c] + 1, n_c - 1), part[c]
                one, two = (1.0 - u) * (1.0 - v), (1.0 - u) * v
                three, four = u * (1.0 - v), u * v
                b[c] = one * background[i, j] + two * background[i, j_next]
                b[c] += three * background[i_next, j] + four * background[i_next, j_next]
                w[c] = one * weight[i, j] + two * weight[i, j_next]
                w[c] += three * weight[i_next, j] + four * weight[i_next, j_next]
        row, to = sums[r], out[r + pad, pad : pad + columns]
        for c in range(columns):
            to[c] = min((np.float32(row[c]) - b[c]) * w[c], most)
