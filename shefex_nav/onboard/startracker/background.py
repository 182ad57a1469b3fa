"""What a frame looks like without its stars: bad pixels taken out, background and noise in square tiles.

In: one frame of 8 or 16 bits. Out: the sums of 3x3 pixels on which objects are searched, and their level and
scatter in each tile. The sums are a short matched filter: a star that is smeared over 4 pixels keeps twice
the signal-to-noise ratio of its brightest pixel.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel

BLOCK = 3  # pixels, side of the blocks that are summed
N_BLOCK = BLOCK * BLOCK
SIGMA_QUANTILE = 0.158655  # a normal variable is below its mean minus one sigma with this probability
NARROW = 4096  # block sums: the sky of a tile is seldom wider
# Where the sky is so near grey value 0 that its noise is cut off there: mean over sigma of a pixel by median
# and quantile of the block sums, and the true sigma over that one, for a mean of -0.5, -0.25 ... 3 sigma
# before the cut. Distribution of the sum of nine normal variables of which negative ones are 0.
CUT_OFF = np.array([
    [0.5027, 2.8393], [0.6060, 2.2727], [0.7161, 1.8810], [0.8364, 1.6086], [0.9685, 1.4168],
    [1.1137, 1.2811], [1.2731, 1.1855], [1.4472, 1.1189], [1.6362, 1.0735], [1.8394, 1.0435],
    [2.0555, 1.0245], [2.2824, 1.0131], [2.5177, 1.0066], [2.7590, 1.0031], [3.0043, 1.0],
])  # fmt: skip
SMOOTH = 1.5  # times the noise between neighbours, spread of a tile from which on it is no noise [E]


class FrameStatistics(NamedTuple):
    """What a frame looks like as a whole."""

    mean_dn: float
    background_dn: float  # median over the tiles
    noise_dn: float  # standard deviation of one pixel, median over the tiles


def survey(image_dn, bad_pixels, tile_px):
    """All of this file that a search for objects needs of a frame, in one compiled call.

    Returns
    -------
    repaired : the frame without its bad pixels
    blocks : as `block_sums`
    background, sigma, mean_dn : as `tile_statistics`
    background_dn, noise_dn : of one pixel, medians over the tiles
    """
    repaired, blocks = np.empty_like(image_dn), _blocks_for(image_dn)
    return repaired, blocks, *_survey_kernel(image_dn, bad_pixels, tile_px, repaired, blocks)


@kernel
def _survey_kernel(image_dn, bad_pixels, tile_px, repaired, blocks):
    """`survey` but for the two that are written."""
    repair(image_dn, bad_pixels, repaired)
    _block_sums_kernel(repaired, blocks)
    background, sigma, mean_dn = tile_statistics(blocks, tile_px)
    return background, sigma, mean_dn, np.median(background) / N_BLOCK, np.median(sigma) / BLOCK


@kernel
def bad_map(rows, columns, bad_pixels):
    """One bit a pixel, set for the (n, 2) row, column of bad ones; as large as the frame it were slow."""
    bad = np.zeros(rows * columns // 8 + 1, dtype=np.uint8)
    for k in range(bad_pixels.shape[0]):
        p = bad_pixels[k, 0] * columns + bad_pixels[k, 1]
        bad[p >> 3] |= 1 << (p & 7)
    return bad


@inner(forceinline=True)
def is_bad(bad, p):
    """Whether pixel p of a frame, row by row, is bad. bad : of `bad_map`"""
    return bad[p >> 3] >> (p & 7) & 1 != 0


@inner
def repair(image_dn, bad_pixels, repaired):
    """Write a copy of the frame with each bad pixel replaced by the mean of its good neighbours (up to 8)."""
    rows, columns = image_dn.shape
    for r in range(rows):
        row, row_kept = image_dn[r], repaired[r]  # an assignment of arrays takes ten times as long
        for c in range(columns):
            row_kept[c] = row[c]
    bad = bad_map(rows, columns, bad_pixels)
    for k in range(bad_pixels.shape[0]):
        r, c = bad_pixels[k, 0], bad_pixels[k, 1]
        total, n = 0, 0
        for y in range(max(0, r - 1), min(rows, r + 2)):
            for x in range(max(0, c - 1), min(columns, c + 2)):
                if not is_bad(bad, y * columns + x):
                    total += np.int64(image_dn[y, x])
                    n += 1
        repaired[r, c] = (total + n // 2) // n if n > 0 else 0


def block_sums(image_dn):
    """Sum of the 3x3 pixels around each pixel, zero along the border.

    (rows, columns) uint8 -> int16; uint16 -> int32.
    """
    blocks = _blocks_for(image_dn)
    _block_sums_kernel(image_dn, blocks)
    return blocks


def _blocks_for(image_dn):
    """Room for the sums of a frame."""
    return np.empty(image_dn.shape, dtype=np.int16 if image_dn.dtype == np.uint8 else np.int32)


@kernel
def _block_sums_kernel(image_dn, blocks):
    """Write the sums to blocks; in its own narrow type, of which the compiler takes many at a time."""
    rows, columns = image_dn.shape
    narrow = blocks.dtype.type
    column = np.empty(columns, dtype=blocks.dtype)
    blocks[0], blocks[rows - 1] = 0, 0
    for r in range(1, rows - 1):
        above, middle, below, sums = image_dn[r - 1], image_dn[r], image_dn[r + 1], blocks[r]
        for c in range(columns):
            column[c] = narrow(above[c]) + narrow(middle[c]) + narrow(below[c])
        sums[0], sums[columns - 1] = 0, 0
        for c in range(1, columns - 1):
            sums[c] = column[c - 1] + column[c] + column[c + 1]


@kernel
def tile_statistics(blocks, tile_px):
    """Background and noise of the block sums in each tile, from blocks that do not overlap.

    The background is the median, the noise its distance from the quantile one sigma below: stars and spikes
    raise neither, as they only populate the upper end. Both are quantiles of a continuous variable of which
    a block shows the nearest whole number. Where grey value 0 cuts the noise off, `whole_sigma`
    makes it whole. A 16-bit frame has half a million possible values: those within NARROW of the least of a
    tile are counted, a quantile beyond them is selected.

    Parameters
    ----------
    blocks : (rows, columns) block sums of `block_sums`
    tile_px : int, multiple of 3

    Returns
    -------
    background, sigma : (tile rows, tile columns) of block sums
    mean_dn : mean grey value of all pixels
    """
    rows, columns = blocks.shape
    n_r, n_c = (rows + tile_px - 1) // tile_px, (columns + tile_px - 1) // tile_px
    background, sigma = np.empty((n_r, n_c)), np.empty((n_r, n_c))
    values = np.empty((tile_px // BLOCK + 1) ** 2, dtype=np.int32)
    counts, inside = np.empty(NARROW, dtype=np.int32), blocks[1 : rows - 1, 1 : columns - 1]
    total, n_total = 0, 0
    for i in range(n_r):
        for j in range(n_c):
            sums, n = inside[i * tile_px : (i + 1) * tile_px - 1, j * tile_px : (j + 1) * tile_px - 1], 0
            for r in range(0, sums.shape[0], BLOCK):
                for value in sums[r, ::BLOCK]:
                    values[n] = value
                    total += value
                    n += 1
            n_total += n
            if n == 0:  # a sliver of one pixel along the border
                background[i, j], sigma[i, j] = background[max(i - 1, 0), max(j - 1, 0)], np.inf
                continue
            least = _count(values[:n], counts)
            background[i, j] = _counted(values[:n], counts, least, 0.5)
            below = _counted(values[:n], counts, least, SIGMA_QUANTILE)
            sigma[i, j] = whole_sigma(background[i, j], background[i, j] - below, N_BLOCK, sums, BLOCK)
    return background, sigma, total / (N_BLOCK * n_total)


@inner
def place_of_quantile(counts, target, k, below):
    """Where so many of counted values lie below: the step, the share of it; how many lie below the step.

    k, below : step from which on it may be, and how many lie below that
    """
    while below + counts[k] < target:
        below += counts[k]
        k += 1
    return k, (target - below) / counts[k] if counts[k] > 0 else 0.0, below


@inner
def whole_sigma(middle, seen, n, sums, every):
    """Noise of sums of n pixels by their median and its distance from the quantile one sigma below.

    Where grey value 0 cuts the noise off by CUT_OFF, that of nine; of four it is the same to 3 %. Under a
    star nothing is cut off, and the noise is that of a pixel as it is. A dark tile with straylight across
    spreads as widely, and nothing of its noise need be missing.

    sums : (rows, columns) of the tile, of which every so many share no pixel
    """
    last = len(CUT_OFF) - 1
    least = np.sqrt(n / 12.0)  # one grey value of quantisation in each: noise that no quantile shows
    ratio = middle / (np.sqrt(n) * max(seen, least))
    if seen <= least or ratio >= CUT_OFF[last, 0] or seen > SMOOTH * _between_neighbours(sums, every):
        return max(seen, least)
    k = 1
    while ratio > CUT_OFF[k, 0]:
        k += 1
    before, step = CUT_OFF[k - 1], CUT_OFF[k] - CUT_OFF[k - 1]
    share = max(ratio - before[0], 0.0) / step[0]  # what lies below 0 by more than half a sigma: as that
    return seen * (before[1] + share * step[1])


@inner
def _between_neighbours(sums, every):
    """Noise of sums by the mean difference of neighbours, 2 / sqrt(pi) of it where it is normal."""
    total, n = 0.0, 0
    for r in range(0, sums.shape[0], every):
        for c in range(every, sums.shape[1], every):
            total += abs(float(sums[r, c]) - float(sums[r, c - every]))
            n += 1
    return 0.5 * np.sqrt(np.pi) * total / max(n, 1)


@inner
def _count(values, counts):
    """Write how often each of the values from the least on occurs; returns the least."""
    least = values[0]
    for value in values:
        least = min(least, value)
    counts[:] = 0
    for value in values:
        if value - least < len(counts):
            counts[np.uint32(value - least)] += 1  # unsigned: no check for an index from the end
    return least


@inner
def _counted(values, counts, least, fraction):
    """As `_quantile`, of values that `_count` has counted."""
    target, below = fraction * len(values), 0
    for k in range(len(counts)):
        if below + counts[k] >= target:
            return least + k - 0.5 + (target - below) / counts[k]
        below += counts[k]
    return _quantile(values, fraction)


@inner
def _quantile(values, fraction):
    """Quantile of whole numbers k, each of which stands for an even spread over k - 1/2 ... k + 1/2."""
    target = fraction * len(values)
    k = np.partition(values, int(np.ceil(target)) - 1)[int(np.ceil(target)) - 1]
    below, equal = 0, 0
    for value in values:
        below += value < k
        equal += value == k
    return k - 0.5 + (target - below) / equal
