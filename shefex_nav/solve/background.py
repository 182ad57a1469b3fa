"""What lies under the stars of a picture: its background, its noise, and the edges of what is before the sky.

In: grey values. Out: the picture without its background, by the medians of small tiles, so that clouds are
followed, too.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel

TILE_PX, EVERY = 12, 2  # of the background; pixels that are looked at for it
APART = 1.05  # sigma, between the two quantiles in the mean: number 19 and number 6 of 36 values
BELOW = 0.158655  # of the values, one sigma below the median
AT_ONCE = 32  # columns that the compiler sorts in one go; the rest would be one by one
GREATEST = np.int32(0x7FFFFFFF)  # whole number: all bits but the sign
FLAT_SIGMA = 0.3  # grey steps, noise of a picture without any: rounding hides it
EDGE_SIGMA = 8.0  # of the noise: what bends more from tile to tile has something before the sky
LAG, EDGE_TILES = 2, 12  # tiles, over which it bends; so far from an edge there may be gaps in it


class Below(NamedTuple):
    """The background of a picture, at nodes; in between it is linear, outside of them constant."""

    tiles: np.ndarray  # (n, m) grey values
    at_r: np.ndarray  # (n,) rows of the nodes
    at_c: np.ndarray  # (m,) columns


def flatten(grey, step=None):
    """Picture without its background, and noise and sky of `measured`. (rows, columns) float32"""
    below, noise, sky = measured(grey, step)
    return subtract(grey, below), noise, sky


def measured(grey, step=None):
    """Background of a picture: Below; the noise of one pixel; and what a star has to outshine.

    step : between grey values, before anything was averaged: rounding leaves that much of structure; None:
        `grey_step` of this picture

    The last is the brightest tile in the neighbourhood of an edge, -inf where there is none. The background
    is the median of tiles, smoothed over three of them and interpolated linearly. The noise is the median
    over the tiles of the distance between the median and the quantile one sigma below.
    """
    from scipy.ndimage import maximum_filter

    step = grey_step(grey) if step is None else step
    rows, columns = grey.shape
    n_r, n_c = max(rows // TILE_PX, 1), max(columns // TILE_PX, 1)
    edges_r = np.linspace(0, rows, n_r + 1).astype(int)
    edges_c = np.linspace(0, columns, n_c + 1).astype(int)
    middle, low = tile_quantiles(grey, edges_r, edges_c)
    noise = max(np.median(middle - low) / APART, FLAT_SIGMA * step)
    smooth = smoothed(middle)
    below = Below(smooth, 0.5 * (edges_r[:-1] + edges_r[1:] - 1), 0.5 * (edges_c[:-1] + edges_c[1:] - 1))
    edge = bent(smooth) > EDGE_SIGMA * max(noise, step)
    if not edge.any():
        return below, noise, np.full(edge.shape, -np.inf)
    reach = 2 * EDGE_TILES + 1
    near = maximum_filter(edge, reach, mode="nearest")
    return below, noise, np.where(near, maximum_filter(middle, reach, mode="nearest"), -np.inf)


def bent(tiles):
    """Second difference of each tile with those LAG away, the larger of rows and columns: 0 on any slope."""
    wide = np.pad(tiles, LAG, mode="edge")
    middle = wide[LAG:-LAG, LAG:-LAG]
    rows = np.abs(wide[: -2 * LAG, LAG:-LAG] - 2.0 * middle + wide[2 * LAG :, LAG:-LAG])
    columns = np.abs(wide[LAG:-LAG, : -2 * LAG] - 2.0 * middle + wide[LAG:-LAG, 2 * LAG :])
    return np.maximum(rows, columns)


def grey_step(grey):
    """Smallest difference between two grey values that occur."""
    values = np.unique(grey[:: max(grey.shape[0] // 64, 1)])
    steps = np.diff(values)
    return float(steps.min()) if len(steps) else 1.0


def tile_quantiles(grey, edges_r, edges_c):
    """Median and quantile one sigma below it of every tile: (tiles, tiles), (tiles, tiles).

    Of every EVERY-th row and column: the median of three tiles by three of these is good to 9 % of the noise.

    grey : (rows, columns) float32, finite
    """
    bits = np.ascontiguousarray(grey, dtype=np.float32).view(np.int32)
    return tuple(
        _in_order(keys).view(np.float32).astype(float) for keys in _quantiles(bits, edges_r, edges_c)
    )


@kernel
def _quantiles(bits, edges_r, edges_c):
    """`tile_quantiles` of the bits of float32, as whole numbers in their order.

    The values of a row of tiles are sorted all at once. bits : (rows, columns) int32
    """
    n_r, n_c = len(edges_r) - 1, len(edges_c) - 1
    middle, low = np.empty((n_r, n_c), bits.dtype), np.empty((n_r, n_c), bits.dtype)
    high, wide = (
        _looked_at((edges_r[1:] - edges_r[:-1]).max()),
        _looked_at((edges_c[1:] - edges_c[:-1]).max()),
    )
    column = np.empty((wide, n_c), dtype=np.int64)
    for k in range(wide):
        column[k] = np.minimum(edges_c[:-1] + EVERY * k, edges_c[1:] - 1)
    at_once = -(-n_c // AT_ONCE) * AT_ONCE
    values = np.zeros((high * wide, at_once), bits.dtype)  # of a tile one below the other
    for i in range(n_r):
        rows = _looked_at(edges_r[i + 1] - edges_r[i])
        for r in range(rows):
            line = bits[edges_r[i] + EVERY * r]
            for k in range(wide):
                for j in range(n_c):
                    values[r * wide + k, j] = _key(line[column[k, j]])
            for j in range(n_c):
                for k in range(_looked_at(edges_c[j + 1] - edges_c[j]), wide):
                    values[r * wide + k, j] = GREATEST
        _sort_columns(values[: rows * wide])
        for j in range(n_c):
            n = rows * _looked_at(edges_c[j + 1] - edges_c[j])
            middle[i, j], low[i, j] = values[n // 2, j], values[int(BELOW * n), j]
    return middle, low


@inner
def _key(bits):
    """Whole number in the order of float32 values, from their bits; of negative ones turned over."""
    return bits if bits >= 0 else bits ^ GREATEST


def _in_order(keys):
    """Bits of float32 values from the whole numbers of `_key`, or these of the bits: (n, m) int32."""
    return np.where(keys >= 0, keys, keys ^ GREATEST)


@inner
def _looked_at(n):
    """How many of n pixels in a row are looked at."""
    return (n + EVERY - 1) // EVERY


@inner
def _sort_columns(values):
    """Sort each column, (n, columns): Batcher's merging, which is the same exchanges for whatever values."""
    n, p = values.shape[0], 1
    while p < n:
        k = p
        while k >= 1:
            for j in range(k % p, n - k, 2 * k):
                for i in range(j, min(j + k, n - k)):
                    if i // (2 * p) == (i + k) // (2 * p):
                        _exchange(values[i], values[i + k])
            k //= 2
        p *= 2


@inner
def _exchange(first, second):
    """The smaller of each pair into `first`; so simple that the compiler takes eight of them at a time."""
    for j in range(first.shape[0]):
        x, y = first[j], second[j]
        first[j], second[j] = min(x, y), max(x, y)


@kernel
def smoothed(tiles):
    """Median of each tile (rows, columns) and its neighbours, those at the border repeated."""
    rows, columns = tiles.shape
    smooth, nine = np.empty((rows, columns)), np.empty((9, columns), tiles.dtype)
    for r in range(rows):
        for i in range(3):
            line = tiles[min(max(r + i - 1, 0), rows - 1)]
            for j in range(3):
                for c in range(columns):
                    nine[3 * i + j, c] = line[min(max(c + j - 1, 0), columns - 1)]
        _sort_columns(nine)
        smooth[r] = nine[4]
    return smooth


@kernel
def subtract(grey, below):
    """Picture minus its background, Below. (rows, columns) float32"""
    flat = np.empty(grey.shape, dtype=np.float32)
    lines = new_lines(below, grey.shape[1])
    for r in range(grey.shape[0]):
        take_away(below, lines, r, grey[r], flat[r])
    return flat


class Lines(NamedTuple):
    """What is known of each column, for the pair of nodes that the rows are between."""

    left: np.ndarray  # int64, node before the column
    share: np.ndarray  # of the way to the next
    level: np.ndarray  # float32, background at the node above
    rise: np.ndarray  # float32, from there to the node below
    row: np.ndarray  # (1,) int64, number of the node above, -1 before the first


@inner
def new_lines(below, columns):
    """Lines of a picture with so many columns, before its first row."""
    left, share = np.empty(columns, dtype=np.int64), np.empty(columns)
    for c in range(columns):
        left[c], share[c] = _between(below.at_c, c)
    level, rise = np.empty(columns, dtype=np.float32), np.empty(columns, dtype=np.float32)
    return Lines(left, share, level, rise, np.full(1, -1))


@inner
def take_away(below, lines, r, line, flat):
    """Write row r of a picture less its background to `flat`; in float32, as the picture: eight at a time."""
    i, way = _between(below.at_r, r)
    level, rise = lines.level, lines.rise
    if i != lines.row[0]:
        lines.row[0] = i
        here, then = below.tiles[i], below.tiles[min(i + 1, len(below.at_r) - 1)]
        for c in range(len(line)):
            k, s = lines.left[c], lines.share[c]
            m = min(k + 1, len(below.at_c) - 1)
            first = (1.0 - s) * here[k] + s * here[m]
            level[c], rise[c] = first, (1.0 - s) * then[k] + s * then[m] - first
    share = np.float32(way)
    for c in range(len(line)):
        flat[c] = line[c] - (level[c] + share * rise[c])


@inner
def _between(at, x):
    """Number of the last node before x, and how far x is on the way to the next: constant outside."""
    if x <= at[0] or len(at) == 1:
        return 0, 0.0
    if x >= at[-1]:
        return len(at) - 1, 0.0
    k = np.searchsorted(at, x, side="right") - 1
    return k, (x - at[k]) / (at[k + 1] - at[k])
