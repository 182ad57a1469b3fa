"""Matched filter along the streaks of a turning camera.

In: bins in units of their noise, and the motion. Out: candidates, the places where the sum along the streak
that a star would draw there stands out, best first.

Within a tile all streaks are as the one in its middle. The sum runs along sheared lines, one row of bins is
added and one taken away at each step, so its cost does not grow with the length of the streaks; between two
columns the shear interpolates. A weighted sum of three neighbouring lines is the match across. The border is
no loss: a streak that is cut by it is weighed against the noise of the part that lies in the frame.

The number of maxima above k that noise makes follows from the curvature of the filter's autocorrelation
(Longuet-Higgins 1957; Adler & Hasofer 1976):
N = A sqrt(lambda_along lambda_across) k exp(-k^2/2) / (2 pi)^1.5.
"""

from math import erf, exp, pi, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.background import SIGMA_QUANTILE, place_of_quantile
from shefex_nav.onboard.startracker.binned import BIN
from shefex_nav.onboard.startracker.streak_path import LENGTH, NUMBERS, TX, TY, place_of_middle

TILES = (64, 32, 16)  # bins, sides of a tile; the largest whose streaks are all alike is taken
ALIKE_PX = 0.75  # the ends of a streak in the corner of a tile may be this far off
GRID = 5  # places per axis at which the streaks of a frame are looked at
SPOT_SIGMAS = 2.8  # the box of this many sigmas is the best for a Gaussian
BIN_VARIANCE = 1.0 / 12.0 + 1.0 / 6.0  # bins^2: of the bin itself, and of the interpolation between two
LEAST_PART = 0.4  # of a streak in the frame; what has less gets no candidate
HISTOGRAM = 512  # steps of the filtered values
STEP = 1.0 / 24.0  # sigma
SAMPLE_EVERY = 3
OVERLAP = 2  # bins, of tiles: a streak between two, seen askew by each, must not be left to the other
MOST_RAW = 20000  # maxima
MOST_CANDIDATES = 400
SAME_BINS = 2.0  # closer than that along and across are the maxima of one streak
FLAT_LINES = 1.5  # the ridge along a bright streak is this wide, in bins, on each side

# columns of a candidate
VALUE, MIDDLE_X, MIDDLE_Y = range(3)


@inner
def curvature(length_px, sigma_px):
    """Curvature of the autocorrelation of a streak's profile along and across at its peak, px^-2 each."""
    z = length_px / (2.0 * sigma_px)
    slopes = (1.0 - exp(-z * z)) / (sigma_px * sqrt(pi))
    energy = length_px * erf(z) - 2.0 * sigma_px / sqrt(pi) * (1.0 - exp(-z * z))
    return slopes / energy, 0.5 / sigma_px**2


class Looks(NamedTuple):
    """What the streaks of a frame look like."""

    density: float  # px^-2, of the maxima of noise: mean of sqrt(lambda_along lambda_across) / (2 pi)^1.5
    longest_px: float
    gradient: float  # change of the streak's vector per px of place


class Grid(NamedTuple):
    """Bins of a frame and how they are searched."""

    rows: int  # of the frame
    columns: int
    pad: int  # empty bins around the frame
    side: int  # of a tile
    most_steps: int  # rows of a sum, for which the empty bins suffice


class Tile(NamedTuple):
    """Bins of a frame in rows r0 ... r1 - 1, columns c0 ... c1 - 1, in which all streaks are alike."""

    r0: int
    r1: int
    c0: int
    c1: int
    streak_px: tuple  # from end to end: columns, rows


class Lines(NamedTuple):
    """Sheared lines of a tile: line u is at column u + slope (row - middle), u = u0, u0 + 1 ..."""

    slope: float
    middle: float  # row
    first: int  # row of the first sum; sum k takes the rows first + k ... first + k + n - 1
    n: int
    u0: int


@kernel
def looks(turning, sigma_px):
    """What streaks look like at places all over a frame. Turning, width of a spot -> Looks.

    The density is 0 where there is no streak at all: all stars are too fast (`streak_path.path_of`).
    """
    path, vectors = np.empty(NUMBERS), np.full((GRID, GRID, 2), np.nan)
    density, longest = 0.0, 0.0
    step_x, step_y = (
        (turning.camera.width_px - 1.0) / (GRID - 1),
        (turning.camera.height_px - 1.0) / (GRID - 1),
    )
    for i in range(GRID):
        for j in range(GRID):
            x, _ = place_of_middle(turning, j * step_x, i * step_y, path)
            if not np.isfinite(x):
                continue
            length = path[LENGTH]
            longest = max(longest, length)
            along, across = curvature(length, sigma_px)
            density += sqrt(along * across) / (2.0 * pi) ** 1.5 / GRID**2
            shown = length if length >= 1.0 else 0.0  # a spot has no direction
            vectors[i, j, 0], vectors[i, j, 1] = shown * path[TX], shown * path[TY]
    return Looks(
        density, longest, max(_steepest(vectors, step_x), _steepest(vectors.transpose(1, 0, 2), step_y))
    )


@inner
def _steepest(vectors, step_px):
    """Greatest change along the second axis, per px; NaN vectors do not count."""
    steepest = 0.0
    for i in range(vectors.shape[0]):
        for j in range(1, vectors.shape[1]):
            d = vectors[i, j] - vectors[i, j - 1]
            change = np.hypot(d[0], d[1]) / step_px
            if change > steepest:
                steepest = change
    return steepest


@kernel
def threshold(density, area_px, wanted):
    """The k, in sigma, above which `wanted` maxima of noise are expected; at least 3.

    density as of `looks`; N = area density k exp(-k^2/2).
    """
    k = 5.0
    for _ in range(50):
        k = sqrt(max(2.0 * np.log(area_px * density * k / wanted), 9.0))
    return k


def grid_of(shape, seen, sigma_px):
    """Grid for a frame of shape (rows, columns) bins with streaks that look as `seen` (Looks).

    The tiles are the largest whose streaks differ by no more than ALIKE_PX at their ends.
    """
    side = TILES[-1]
    for wanted in TILES[::-1]:
        if 0.5 * seen.gradient * 0.7071 * wanted * BIN <= ALIKE_PX:
            side = wanted
    most_steps = steps_of(seen.longest_px, 0.0, sigma_px) + 4
    return Grid(shape[0], shape[1], side + most_steps + 4 + 4 * OVERLAP, side, most_steps)


@kernel
def steps_of(along_px, slope, sigma_px):
    """Rows of bins that a sum takes: a streak over along_px rows of pixels, and the spot's own width."""
    spot = SPOT_SIGMAS * sigma_px / np.sqrt(1.0 + slope * slope)
    return max(1, int(np.rint(np.sqrt(along_px * along_px + spot * spot) / BIN)))


@kernel
def candidates(bins, grid, turning, sigma_px, least):
    """Maxima of the frame filtered along the streaks.

    Parameters
    ----------
    bins : Bins of `binned.in_noise`
    grid : Grid
    turning : Turning
    sigma_px : float, width of a spot
    least : float, threshold in sigma of the filtered noise

    Returns
    -------
    (n, 3) value in sigma of the filtered noise, middle of the streak x, y [px]; best first, ridges thinned
    noise : standard deviation of the filtered frame against white noise, measured
    """
    raw, n_raw, histogram = np.empty((MOST_RAW, 5)), 0, np.zeros(HISTOGRAM, dtype=np.int64)
    is_turned, turned_grid = False, Grid(grid.columns, grid.rows, grid.pad, grid.side, grid.most_steps)
    path, side, low = np.empty(NUMBERS), grid.side, 0.9 * least
    for r0 in range(0, grid.rows, side):
        for c0 in range(0, grid.columns, side):
            r1, c1, begin = min(r0 + side, grid.rows), min(c0 + side, grid.columns), n_raw
            x, _ = place_of_middle(turning, BIN * 0.5 * (c0 + c1) - 0.5, BIN * 0.5 * (r0 + r1) - 0.5, path)
            if not np.isfinite(x):
                continue
            dx, dy = path[LENGTH] * path[TX], path[LENGTH] * path[TY]
            if abs(dy) >= abs(dx):
                tile = Tile(r0, r1, c0, c1, (dx, dy))
                n_raw = _filter_tile(bins.upright, grid, tile, sigma_px, low, raw, n_raw, histogram)
            else:
                if not is_turned:
                    _transpose(bins.upright, bins.turned)
                    is_turned = True
                tile = Tile(c0, c1, r0, r1, (dy, dx))
                n_raw = _filter_tile(bins.turned, turned_grid, tile, sigma_px, low, raw, n_raw, histogram)
                for k in range(begin, n_raw):
                    raw[k, 1], raw[k, 2] = raw[k, 2], raw[k, 1]
            for k in range(begin, n_raw):
                raw[k, 3], raw[k, 4] = dx, dy
    noise, level = _spread(histogram)
    return _thinned(raw[:n_raw], noise, level, least, sigma_px), noise


@inner
def _transpose(bins, out):
    """Write rows and columns exchanged, block by block as the cache likes it."""
    rows, columns = bins.shape
    for r0 in range(0, rows, 16):
        for c0 in range(0, columns, 16):
            for c in range(c0, min(c0 + 16, columns)):
                for r in range(r0, min(r0 + 16, rows)):
                    out[c, r] = bins[r, c]


@inner
def _filter_tile(bins, grid, tile, sigma_px, least, raw, n_raw, histogram):
    """Sums along the order of the rows, for the streaks of a tile; maxima go to raw, the values to histogram.

    Returns the new length of raw. A tile whose streaks are longer than the empty bins allow is left out.
    """
    r0, r1, c0, c1, (across_px, along_px) = tile
    slope = across_px / along_px
    n = steps_of(abs(along_px), slope, sigma_px)
    if n > grid.most_steps:
        return n_raw
    drift = abs(slope) * (0.5 * (r1 - r0) + 1.0 + OVERLAP) + OVERLAP
    u0 = int(np.floor(c0 - drift)) - 2
    first = r0 - (n - 1) // 2 - 1 - OVERLAP  # the middle of its sum is before the tile
    lines = Lines(slope, 0.5 * (r0 + r1 - 1), first, n, u0)
    n_sums, n_lines = r1 - r0 + 2 + 2 * OVERLAP + (n - 1) % 2, int(np.ceil(c1 + drift)) + 2 - u0
    values = np.empty((n_sums, n_lines), dtype=np.float32)
    across = np.float32(exp(-0.5 / (sigma_px**2 * (1.0 + slope * slope) / BIN**2 + BIN_VARIANCE)))
    _sums(bins, grid.pad, lines, across, values)
    half_columns = 0.5 * abs(slope) * n
    inside = first >= 0 and first + n_sums + n <= grid.rows
    inside = inside and u0 - drift - half_columns >= 0 and u0 + n_lines + drift + half_columns < grid.columns
    if not inside:
        _part_inside(grid, lines, values)
    for k in range(1, n_sums - 1, SAMPLE_EVERY):
        for i in range(2, n_lines - 2, SAMPLE_EVERY):
            if values[k, i] != 0.0:
                step = int(values[k, i] / STEP + 0.5 * HISTOGRAM)
                histogram[min(max(step, 0), HISTOGRAM - 1)] += 1
    return _maxima(values, least, tile, lines, raw, n_raw)


@inner
def _sums(bins, pad, lines, across, values):
    """Write the sums of n rows, three lines weighted (across, 1, across), in units of white noise."""
    slope, middle, first, n, u0 = lines
    n_sums, n_lines = values.shape
    total = np.zeros(n_lines, dtype=np.float32)
    own, shared = 0.0, 0.0  # variance of a line, and covariance with the next one
    for step in range(n_sums + n - 1):
        row = first + step
        place = u0 + slope * (row - middle)
        base = int(np.floor(place))
        f = np.float32(place - base)
        g = np.float32(1.0) - f
        own += g * g + f * f
        shared += g * f
        new = bins[row + pad, base + pad : base + pad + n_lines + 1]
        if step < n:
            for i in range(n_lines):
                total[i] += g * new[i] + f * new[i + 1]
        else:
            place = u0 + slope * (row - n - middle)
            base = int(np.floor(place))
            f_old = np.float32(place - base)
            g_old = np.float32(1.0) - f_old
            own -= g_old * g_old + f_old * f_old
            shared -= g_old * f_old
            old = bins[row - n + pad, base + pad : base + pad + n_lines + 1]
            for i in range(n_lines):
                total[i] += g * new[i] + f * new[i + 1] - (g_old * old[i] + f_old * old[i + 1])
        if step >= n - 1:
            out = values[step - n + 1]
            scale = np.float32(1.0 / np.sqrt(own * (1.0 + 2.0 * across**2) + 4.0 * across * shared))
            out[0] = out[n_lines - 1] = np.float32(0.0)
            side = across * scale
            for i in range(1, n_lines - 1):
                out[i] = scale * total[i] + side * (total[i - 1] + total[i + 1])


@inner
def _part_inside(grid, lines, values):
    """Weigh sums that the border cuts against the noise of the part inside; too small a part is no sum."""
    slope, middle, first, n, u0 = lines
    n_lines = values.shape[1]
    low, high = np.empty(n_lines, dtype=np.int32), np.empty(n_lines, dtype=np.int32)
    for i in range(n_lines):
        column = u0 + i  # at the middle row
        low[i], high[i] = 0, grid.rows - 1
        if abs(slope) > 1e-9:
            one = middle + (0.0 - column) / slope
            two = middle + (grid.columns - 1.0 - column) / slope
            low[i] = max(0.0, np.ceil(min(max(min(one, two), -1e6), 1e6)))
            high[i] = min(grid.rows - 1.0, np.floor(min(max(max(one, two), -1e6), 1e6)))
        elif column < 0 or column > grid.columns - 1:
            high[i] = -1
    weight = np.zeros(n + 1, dtype=np.float32)
    for count in range(n + 1):
        weight[count] = np.sqrt(n / count) if count >= max(LEAST_PART * n, 1.0) else 0.0
    for k in range(values.shape[0]):
        top, bottom, row = np.int32(first + k), np.int32(first + k + n - 1), values[k]
        for i in range(n_lines):
            count = min(high[i], bottom) - max(low[i], top) + 1
            row[i] *= weight[np.uint32(max(count, 0))]


@inner
def _maxima(values, least, tile, lines, raw, n_raw):
    """Append maxima above `least` whose middle is in the tile: value, x, y [px]; new length."""
    r0, r1, c0, c1, _ = tile
    slope, middle, first, n, u0 = lines
    for k in range(1, values.shape[0] - 1):
        before, here, after = values[k - 1], values[k], values[k + 1]
        row = first + 0.5 * (n - 1) + k
        if row < r0 - OVERLAP or row >= r1 + OVERLAP:
            continue
        shift = slope * (row - middle) + u0
        for i in range(1, values.shape[1] - 1):
            v = here[i]
            if v <= least:
                continue
            if v < here[i - 1] or v <= here[i + 1] or v < before[i] or v <= after[i]:
                continue
            if v < before[i - 1] or v < before[i + 1] or v <= after[i - 1] or v <= after[i + 1]:
                continue
            column = i + shift
            if column < c0 - OVERLAP or column >= c1 + OVERLAP or n_raw == raw.shape[0]:
                continue
            raw[n_raw, 0] = v
            raw[n_raw, 1], raw[n_raw, 2] = BIN * column + 0.5, BIN * row + 0.5
            n_raw += 1
    return n_raw


@inner
def _spread(histogram):
    """Standard deviation and median of the filtered frame from quantiles that stars do not raise."""
    n = histogram.sum()
    first, part_first, below = place_of_quantile(histogram, n * SIGMA_QUANTILE, 0, 0)
    middle, part_middle, _ = place_of_quantile(histogram, n * 0.5, first, below)
    low = (first + part_first - 0.5 * HISTOGRAM) * STEP
    level = (middle + part_middle - 0.5 * HISTOGRAM) * STEP
    return max(level - low, 0.5), level


@inner
def _thinned(raw, noise, level, least, sigma_px):
    """Best first, in units of the measured noise, without the bumps on the ridge of a brighter one.

    The filtered image of a streak falls linearly over its length on both sides.
    """
    order = np.argsort(-raw[:, 0])
    kept, n = np.empty((MOST_CANDIDATES, 5)), 0
    wide = sigma_px + BIN * FLAT_LINES
    for row in order:
        value = (raw[row, 0] - max(level, 0.0)) / noise
        if value < least or n == MOST_CANDIDATES:
            break
        is_bump = False
        for j in range(n):
            ex, ey = raw[row, 1] - kept[j, 1], raw[row, 2] - kept[j, 2]
            length = np.hypot(kept[j, 3], kept[j, 4])
            reach = length + SPOT_SIGMAS * sigma_px + BIN
            along = abs(ex * kept[j, 3] + ey * kept[j, 4]) / length
            across = abs(ey * kept[j, 3] - ex * kept[j, 4]) / length
            if along < SAME_BINS * BIN and across < SAME_BINS * BIN:
                is_bump = True  # the same, of the next tile
                break
            if along < reach and across < 3.0 * wide:
                ridge = kept[j, 0] * (1.0 - along / reach) * np.exp(-0.5 * (across / wide) ** 2)
                if value < ridge + least:
                    is_bump = True
                    break
        if not is_bump:
            kept[n, 0], kept[n, 1:] = value, raw[row, 1:]
            n += 1
    return kept[:n, :3].copy()
