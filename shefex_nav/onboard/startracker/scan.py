"""Objects in a frame: two ways to scan it, one way to grow what was hit.

In: block sums, and their background and noise in tiles. Out: a table of objects, brightest first, each with
a first centroid. The two scans are those of the SHEFEX-2 star tracker (section 3.2): `sequential` passes over
the frame once and stops at every block above the threshold; `maximum_search` looks through the whole frame
for the greatest block again and again. From there an object is grown over its neighbours; the paper does that
by recursion, here a list of pixels is its own queue, which has no depth limit.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.background import BLOCK, N_BLOCK

# columns of the table of objects
X, Y, FLUX, PIXELS, SATURATED, BACKGROUND, NOISE, XX, XY, YY = range(10)
COLUMNS = 10
# and of a scan whose objects end at a threshold: covariance of the centre by what was cut off [px^2]
CUT = slice(COLUMNS, COLUMNS + 3)  # xx, xy, yy


class Rules(NamedTuple):
    """By what a scan finds and takes objects."""

    tile_px: int  # side of a tile of background and noise
    seed_sigma: float  # of the noise of a block, above which an object begins
    grow_sigma: float  # likewise, above which a block beside one belongs to it
    min_pixels: int
    max_pixels: int
    max_peak_fraction: float  # of the light in the brightest pixel
    saturation_dn: int
    max_objects: int


@kernel
def sequential(image_dn, blocks, background, sigma, rules):
    """One pass over the frame; objects that have been taken are marked in `blocks`.

    Parameters
    ----------
    image_dn : (rows, columns) uint8 or uint16
    blocks : (rows, columns) block sums, changed
    background, sigma : of the blocks in tiles
    rules : Rules

    Returns
    -------
    (n, COLUMNS) objects, brightest first
    """
    (rows, columns), tile_px = blocks.shape, rules.tile_px
    seed_limit, grow_limit, tile, pixels, table = _prepared(blocks, background, sigma, rules)
    n_objects = 0
    for r in range(1, rows - 1):
        i = tile[r]
        for j in range(seed_limit.shape[1]):
            limit = seed_limit[i, j]
            begin, end = max(1, j * tile_px), min((j + 1) * tile_px, columns - 1)
            if _maximum(blocks[r, begin:end]) <= limit:
                continue
            for c in range(begin, end):
                if blocks[r, c] > limit:
                    n = _grow(blocks, grow_limit, tile, r, c, pixels)
                    level, noise = background[i, j], sigma[i, j]
                    n_objects = _take(image_dn, blocks, level, noise, pixels[:n], rules, table, n_objects)
    return table[:n_objects]


@kernel
def maximum_search(image_dn, blocks, background, sigma, rules):
    """The greatest block above its background, again and again, until none is left or the table is full.

    As `sequential`, with which it shares all but the order: it needs a pass for every object, and its table
    is never too short for the object with the highest peak.
    """
    (rows, columns), tile_px = blocks.shape, rules.tile_px
    level_of = np.floor(background).astype(np.int64)
    seed_limit, grow_limit, tile, pixels, table = _prepared(blocks, background, sigma, rules)
    n_objects = 0
    while n_objects < rules.max_objects:
        highest, row, column = -1, -1, -1
        for r in range(1, rows - 1):
            i = tile[r]
            for j in range(seed_limit.shape[1]):
                begin, end = max(1, j * tile_px), min((j + 1) * tile_px, columns - 1)
                largest = np.int64(_maximum(blocks[r, begin:end]))
                if largest > seed_limit[i, j] and largest - level_of[i, j] > highest:
                    highest, row = largest - level_of[i, j], r
                    column = begin + np.argmax(blocks[r, begin:end])
        if row < 0:
            break
        n = _grow(blocks, grow_limit, tile, row, column, pixels)
        i, j = tile[row], tile[column]
        level, noise = background[i, j], sigma[i, j]
        n_objects = _take(image_dn, blocks, level, noise, pixels[:n], rules, table, n_objects)
    return table[:n_objects]


@inner
def _prepared(blocks, background, sigma, rules):
    """What a scan begins with: limits of seeds and of what is grown in each tile; row or column of tiles of
    each row or column of pixels; room for the pixels of an object, and for the table of objects.
    """
    rows, columns = blocks.shape
    seed_limit = np.floor(background + rules.seed_sigma * sigma).astype(np.int64)
    grow_limit = np.floor(background + rules.grow_sigma * sigma).astype(np.int64)
    tile = np.arange(max(rows, columns)) // rules.tile_px
    pixels, table = np.empty((rows * columns, 2), dtype=np.int32), np.empty((rules.max_objects, COLUMNS))
    return seed_limit, grow_limit, tile, pixels, table


@inner
def _maximum(blocks):
    """Largest of some blocks; so simple that the compiler takes 16 of them at a time."""
    largest = blocks.dtype.type(-1)
    for k in range(blocks.shape[0]):
        largest = max(largest, blocks[k])
    return largest


@inner
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


@inner
def _take(image_dn, blocks, level, noise, pixels, rules, table, n_objects):
    """Measure a grown object and, if it may be a star, put it into the table; new length of the table.

    x = sum(w I x) / sum(w I), I a pixel above the background, w its block above the background. The plain
    centre of mass of a star cut at a threshold is drawn to the pixel grid, and over a wide window it is
    noisy; the weight, which is the star's own smoothed shape, goes to zero at the cut and takes streaks as
    they come.
    """
    n = pixels.shape[0]
    if n < rules.min_pixels or n > rules.max_pixels:
        return n_objects
    rows, columns = image_dn.shape
    r_0, c_0 = pixels[0, 0], pixels[0, 1]
    sum_w, sum_x, sum_y, sum_xx, sum_xy, sum_yy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    flux, peak, n_saturated = 0.0, 0.0, 0
    for k in range(n):
        r, c = pixels[k, 0], pixels[k, 1]
        if r == 1 or c == 1 or r == rows - 2 or c == columns - 2:
            return n_objects  # cut off by the border
        value = image_dn[r, c] - level / N_BLOCK
        weight = value * (-1 - blocks[r, c] - level)
        dx, dy = c - c_0, r - r_0
        sum_w += weight
        sum_x += weight * dx
        sum_y += weight * dy
        sum_xx += weight * dx * dx
        sum_xy += weight * dx * dy
        sum_yy += weight * dy * dy
        flux += value
        peak = max(peak, value)
        n_saturated += image_dn[r, c] >= rules.saturation_dn
    if sum_w <= 0.0 or peak > rules.max_peak_fraction * flux:
        return n_objects
    k = _insert(table, n_objects, flux)
    if k < 0:
        return n_objects
    dx, dy = sum_x / sum_w, sum_y / sum_w
    table[k, X], table[k, Y], table[k, FLUX] = c_0 + dx, r_0 + dy, flux
    table[k, PIXELS], table[k, SATURATED] = n, n_saturated
    table[k, BACKGROUND], table[k, NOISE] = level / N_BLOCK, noise / BLOCK
    table[k, XX], table[k, YY] = sum_xx / sum_w - dx * dx, sum_yy / sum_w - dy * dy
    table[k, XY] = sum_xy / sum_w - dx * dy
    return min(n_objects + 1, table.shape[0])


@inner
def _insert(table, n, flux):
    """Make room in the table sorted by flux, losing the faintest when it is full; row, -1 if too faint."""
    if n == table.shape[0]:
        if n == 0 or flux <= table[n - 1, FLUX]:
            return -1
        n -= 1
    k = n
    while k > 0 and table[k - 1, FLUX] < flux:
        table[k] = table[k - 1]
        k -= 1
    return k


# ----------------------------------------------------------------------------------------------------------
# The centroid that the scan itself takes, with its covariance.


LEAST_VARIANCE = 1.0 / 12.0  # px^2, of one pixel
CLIPPED_PX = 0.04  # by which saturation draws a centre of mass to the grid; spots of 0.6 to 1.2 px [E]


@kernel
def weighted(table, dn_per_electron):
    """Centroids of the scan as they are.

    Parameters
    ----------
    table : (n, scan.COLUMNS) objects
    dn_per_electron : float, 0 where the shot noise of the stars is not known

    Returns
    -------
    xy_px (n, 2), flux_dn (n,), P_px (n, 2, 2)
    """
    n = table.shape[0]
    xy_px, flux, P_px = np.empty((n, 2)), np.empty(n), np.empty((n, 2, 2))
    for k in range(n):
        xy_px[k, 0], xy_px[k, 1], flux[k] = table[k, X], table[k, Y], table[k, FLUX]
        P_px[k] = weighted_covariance(table[k], dn_per_electron)
    return xy_px, flux, P_px


def lost_covariance(table):
    """What light that is missing adds to the covariance of `weighted`: (n, 2, 2) px^2.

    That of saturated pixels, and of a scan whose objects end at a threshold that of the pixels below it.
    """
    P_px = np.where(table[:, SATURATED] > 0.0, CLIPPED_PX**2, 0.0)[:, None, None] * np.eye(2)
    if table.shape[1] > COLUMNS:  # else the weight of the pixels goes to zero there
        P_px += table[:, CUT][:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    return P_px


def few_pixels(table, psf_sigma):
    """By how much `weighted_covariance` is too small for faint objects, (n,): at least 1.

    Of a star that hardly stands out only its middle is above the threshold: its pixels are too few and its
    moments too small, and it would be known better than all the light of its spot allows. That bound, in
    even noise, is 8 pi sigma^4 noise^2 / flux^2; for a streak it is only less than it might be.

    psf_sigma : px, of the spots
    """
    if table.shape[1] > COLUMNS:  # what the threshold cuts off is counted: `lost_covariance`
        return np.ones(len(table))
    whole = 8.0 * np.pi * (psf_sigma**2 + LEAST_VARIANCE) ** 2
    xx, yy = np.maximum(2.0 * table[:, [XX, YY]], LEAST_VARIANCE).T
    return np.maximum(whole / (table[:, PIXELS] * np.sqrt(xx * yy)), 1.0)


@inner
def weighted_covariance(star, dn_per_electron):
    """Covariance of a centroid of the scan: 2 (2 M) / SNR^2, M the moments of spot times weight, about S/2.

    For a Gaussian spot in even noise the matched filter has 8 pi sigma^4 noise^2 / flux^2; the grown pixels
    are about 8 pi sigma^2 of them.
    """
    noise_to_signal = (star[NOISE] ** 2 * star[PIXELS] + star[FLUX] * dn_per_electron) / star[FLUX] ** 2
    xx, yy = max(2.0 * star[XX], LEAST_VARIANCE), max(2.0 * star[YY], LEAST_VARIANCE)
    most = 0.9 * np.sqrt(xx * yy)  # the moments of a faint object may be anything
    xy = min(max(2.0 * star[XY], -most), most)
    return noise_to_signal * np.array([[xx, xy], [xy, yy]])
