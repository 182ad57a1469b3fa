"""What lies under the stars of a picture: its background, its noise, and the edges of what is before the sky.

In: grey values. Out: the picture without its background, by the medians of small tiles, so that clouds are
followed, too.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel

TILE_PX, EVERY = 12, 2  # of the background; pixels that are looked at for it
APART = 1.05  # sigma, between the two quantiles in the mean: number 19 and number 6 of 36 values
COUNTED = 512  # whole grey values of a tile that are counted, in the place of being sorted
FLAT_SIGMA = 0.3  # grey steps, noise of a picture without any: rounding hides it
EDGE_SIGMA = 8.0  # of the noise: what bends more from tile to tile has something before the sky
LAG, EDGE_TILES = 2, 12  # tiles, over which it bends; so far from an edge there may be gaps in it


def flatten(grey, step=None):
    """Picture without its background, the noise of one pixel, and what a star has to outshine.

    step : between grey values, before anything was averaged: rounding leaves that much of structure; None:
        `grey_step` of this picture

    The last is the brightest tile in the neighbourhood of an edge, -inf where there is none. The background
    is the median of tiles, smoothed over three of them and interpolated linearly. The noise is the median
    over the tiles of the distance between the median and the quantile one sigma below.
    """
    from scipy.ndimage import maximum_filter, median_filter

    step = grey_step(grey) if step is None else step
    rows, columns = grey.shape
    n_r, n_c = max(rows // TILE_PX, 1), max(columns // TILE_PX, 1)
    edges_r = np.linspace(0, rows, n_r + 1).astype(int)
    edges_c = np.linspace(0, columns, n_c + 1).astype(int)
    middle, low = tile_quantiles(grey, edges_r, edges_c)
    noise = max(np.median(middle - low) / APART, FLAT_SIGMA * step)
    smooth = median_filter(middle, 3, mode="nearest")
    flat = subtract(
        grey, smooth, 0.5 * (edges_r[:-1] + edges_r[1:] - 1), 0.5 * (edges_c[:-1] + edges_c[1:] - 1)
    )
    edge = bent(smooth) > EDGE_SIGMA * max(noise, step)
    reach = 2 * EDGE_TILES + 1
    near = maximum_filter(edge, reach, mode="nearest")
    return flat, noise, np.where(near, maximum_filter(middle, reach, mode="nearest"), -np.inf)


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


@kernel
def tile_quantiles(grey, edges_r, edges_c):
    """Median and quantile one sigma below it of every tile: (tiles, tiles), (tiles, tiles).

    Of every EVERY-th row and column: the median of three tiles by three of these is good to 9 % of the noise.
    """
    n_r, n_c = len(edges_r) - 1, len(edges_c) - 1
    middle, low = np.empty((n_r, n_c)), np.empty((n_r, n_c))
    values = np.empty(((edges_r[1:] - edges_r[:-1]).max()) * (edges_c[1:] - edges_c[:-1]).max(), grey.dtype)
    count = np.empty(COUNTED, dtype=np.int64)
    for i in range(n_r):
        for j in range(n_c):
            n, darkest, brightest, whole = 0, np.inf, -np.inf, True
            for r in range(edges_r[i], edges_r[i + 1], EVERY):
                for c in range(edges_c[j], edges_c[j + 1], EVERY):
                    value = grey[r, c]
                    values[n] = value
                    darkest, brightest = min(darkest, value), max(brightest, value)
                    whole = whole and value == np.floor(value)
                    n += 1
            middle_rank, low_rank = n // 2, int(0.158655 * n)
            if whole and brightest - darkest < COUNTED:
                count[: int(brightest - darkest) + 1] = 0
                for m in range(n):
                    count[int(values[m] - darkest)] += 1
                middle[i, j], low[i, j] = darkest + _at(count, middle_rank), darkest + _at(count, low_rank)
            else:
                middle[i, j] = nth(values, middle_rank, n)
                low[i, j] = nth(values, low_rank, middle_rank + 1)  # the lower half comes first now
    return middle, low


@inner
def _at(count, rank):
    """Which value has a rank, counted from 0. count : how often 0, 1, ... occur"""
    value, below = 0, count[0]
    while below <= rank:
        value += 1
        below += count[value]
    return value


@inner
def nth(values, k, n):
    """Number k, counted from 0, of the first n values in ascending order; those before it become no larger.

    Hoare's selection: only the side of the pivot that holds it is looked at again.
    """
    low, high = 0, n - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    return values[k]


@kernel
def subtract(grey, tiles, at_r, at_c):
    """Picture minus a background that is known at the rows at_r and the columns at_c."""
    rows, columns = grey.shape
    flat = np.empty((rows, columns), dtype=np.float32)
    left, share = np.empty(columns, dtype=np.int64), np.empty(columns)
    for c in range(columns):
        left[c], share[c] = _between(at_c, c)
    first = np.searchsorted(left, np.arange(len(at_c) + 1))  # columns of each pair of nodes, one by one
    for r in range(rows):
        i, s = _between(at_r, r)
        below = min(i + 1, len(at_r) - 1)
        for j in range(len(at_c)):
            k = min(j + 1, len(at_c) - 1)
            here = (1.0 - s) * tiles[i, j] + s * tiles[below, j]
            then = (1.0 - s) * tiles[i, k] + s * tiles[below, k]
            for c in range(first[j], first[j + 1]):
                flat[r, c] = grey[r, c] - ((1.0 - share[c]) * here + share[c] * then)
    return flat


@inner
def _between(at, x):
    """Number of the last node before x, and how far x is on the way to the next: constant outside."""
    if x <= at[0] or len(at) == 1:
        return 0, 0.0
    if x >= at[-1]:
        return len(at) - 1, 0.0
    k = np.searchsorted(at, x, side="right") - 1
    return k, (x - at[k]) / (at[k + 1] - at[k])
