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

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.background import SIGMA_QUANTILE
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


@njit(cache=True)
def curvature(length_px, sigma_px):
    """Curvature of the autocorrelation of a streak's profile along and across at its peak, px^-2 each."""
    z = length_px / (2.0 * sigma_px)
    slopes = (1.0 - exp(-z * z)) / (sigma_px * sqrt(pi))
    energy = length_px * erf(z) - 2.0 * sigma_px / sqrt(pi) * (1.0 - exp(-z * z))
    return slopes / energy, 0.5 / sigma_px**2


@njit(cache=True)
def looks(camera, times, omega_c, sigma_px):
    """How densely the maxima of pure noise lie, and how much the streaks differ over the frame.

    Parameters
    ----------
    camera, times, omega_c : as `streak_path.path_of`
    sigma_px : float

    Returns
    -------
    density : float px^-2, mean over the frame of sqrt(lambda_along lambda_across) / (2 pi)^1.5
    longest_px : float
    gradient : float, change of the streak's vector per px of place
    """
    path = np.empty(NUMBERS)
    vectors = np.zeros((GRID, GRID, 2))
    density, longest, gradient = 0.0, 0.0, 0.0
    for i in range(GRID):
        for j in range(GRID):
            x, y = j * (camera.width_px - 1.0) / (GRID - 1), i * (camera.height_px - 1.0) / (GRID - 1)
            place_of_middle(camera, times, omega_c, x, y, path)
            vectors[i, j, 0], vectors[i, j, 1] = path[LENGTH] * path[TX], path[LENGTH] * path[TY]
            longest = max(longest, path[LENGTH])
            along, across = curvature(path[LENGTH], sigma_px)
            density += sqrt(along * across) / (2.0 * pi) ** 1.5 / GRID**2
            if path[LENGTH] < 1.0:
                vectors[i, j] = 0.0  # a spot has no direction
    step_x, step_y = (camera.width_px - 1.0) / (GRID - 1), (camera.height_px - 1.0) / (GRID - 1)
    for i in range(GRID):
        for j in range(GRID):
            if i > 0:
                d = vectors[i, j] - vectors[i - 1, j]
                gradient = max(gradient, np.hypot(d[0], d[1]) / step_y)
            if j > 0:
                d = vectors[i, j] - vectors[i, j - 1]
                gradient = max(gradient, np.hypot(d[0], d[1]) / step_x)
    return density, longest, gradient


@njit(cache=True)
def threshold(density, area_px, wanted):
    """The k, in sigma, above which `wanted` maxima of noise are expected; at least 3.

    density as of `looks`; N = area density k exp(-k^2/2).
    """
    k = 5.0
    for _ in range(50):
        k = sqrt(max(2.0 * np.log(area_px * density * k / wanted), 9.0))
    return k


def tile_side(gradient):
    """Side of a tile in bins whose streaks differ by no more than ALIKE_PX at their ends."""
    for side in TILES:
        if 0.5 * gradient * 0.7071 * side * BIN <= ALIKE_PX:
            return side
    return TILES[-1]


def pad_of(side, longest_px, sigma_px):
    """Empty bins that `candidates` needs around the frame."""
    return side + steps_of(longest_px, 0.0, sigma_px) + 8 + 4 * OVERLAP


@njit(cache=True)
def steps_of(along_px, slope, sigma_px):
    """Rows of bins that a sum takes: a streak over along_px rows of pixels, and the spot's own width."""
    spot = SPOT_SIGMAS * sigma_px / np.sqrt(1.0 + slope * slope)
    return max(1, int(np.rint(np.sqrt(along_px * along_px + spot * spot) / BIN)))


@njit(cache=True)
def candidates(bins, shape, pad, side, camera, times, omega_c, sigma_px, least):
    """Maxima of the frame filtered along the streaks.

    Parameters
    ----------
    bins : (rows + 2 pad, columns + 2 pad) float32 of `binned.in_noise`
    shape : (rows, columns) of bins in the frame
    pad : int, at least `pad_of`
    side : int, side of a tile in bins, of `tile_side`
    camera, times, omega_c : as `streak_path.path_of`
    sigma_px : float, width of a spot
    least : float, threshold in sigma of the filtered noise

    Returns
    -------
    (n, 3) value in sigma of the filtered noise, middle of the streak x, y [px]; best first, ridges thinned
    noise : standard deviation of the filtered frame against white noise, measured
    """
    raw, n_raw = np.empty((MOST_RAW, 5)), 0
    histogram = np.zeros(HISTOGRAM, dtype=np.int64)
    turned = bins[:1, :1]
    have_turned = False
    path = np.empty(NUMBERS)
    for r0 in range(0, shape[0], side):
        for c0 in range(0, shape[1], side):
            r1, c1 = min(r0 + side, shape[0]), min(c0 + side, shape[1])
            x, y = BIN * 0.5 * (c0 + c1) - 0.5, BIN * 0.5 * (r0 + r1) - 0.5
            place_of_middle(camera, times, omega_c, x, y, path)
            dx, dy = path[LENGTH] * path[TX], path[LENGTH] * path[TY]
            begin = n_raw
            if abs(dy) >= abs(dx):
                slope = dx / dy
                tile = (r0, r1, c0, c1)
                n_raw = _filter_tile(
                    bins, shape, pad, tile, slope, abs(dy), sigma_px, 0.9 * least, raw, n_raw, histogram
                )
            else:
                if not have_turned:
                    turned, have_turned = _transposed(bins), True
                tile = (c0, c1, r0, r1)
                slope = dy / dx
                turned_shape = (shape[1], shape[0])
                n_raw = _filter_tile(
                    turned,
                    turned_shape,
                    pad,
                    tile,
                    slope,
                    abs(dx),
                    sigma_px,
                    0.9 * least,
                    raw,
                    n_raw,
                    histogram,
                )
                for k in range(begin, n_raw):
                    raw[k, 1], raw[k, 2] = raw[k, 2], raw[k, 1]
            for k in range(begin, n_raw):
                raw[k, 3], raw[k, 4] = dx, dy
    noise, level = _spread(histogram)
    return _thinned(raw[:n_raw], noise, level, least, sigma_px), noise


@njit(cache=True)
def _transposed(bins):
    """Rows and columns exchanged, block by block as the cache likes it."""
    rows, columns = bins.shape
    out = np.empty((columns, rows), dtype=bins.dtype)
    for r0 in range(0, rows, 16):
        for c0 in range(0, columns, 16):
            for c in range(c0, min(c0 + 16, columns)):
                for r in range(r0, min(r0 + 16, rows)):
                    out[c, r] = bins[r, c]
    return out


@njit(cache=True)
def _filter_tile(bins, shape, pad, tile, slope, along_px, sigma_px, least, raw, n_raw, histogram):
    """Sums along the rows' order for streaks that pass `slope` columns a row; maxima go to raw.

    Line u is at column u + slope (row - middle row of the tile). Returns the new length of raw.
    """
    r0, r1, c0, c1 = tile
    n = steps_of(along_px, slope, sigma_px)
    middle = 0.5 * (r0 + r1 - 1)
    drift = abs(slope) * (0.5 * (r1 - r0) + 1.0 + OVERLAP) + OVERLAP
    u0 = int(np.floor(c0 - drift)) - 2
    n_lines = int(np.ceil(c1 + drift)) + 2 - u0
    first = r0 - (n - 1) // 2 - 1 - OVERLAP  # first row of the first sum; its middle is before the tile
    n_sums = r1 - r0 + 2 + 2 * OVERLAP + (n - 1) % 2
    values = np.empty((n_sums, n_lines), dtype=np.float32)
    across = np.float32(exp(-0.5 / (sigma_px**2 * (1.0 + slope * slope) / BIN**2 + BIN_VARIANCE)))
    _sums(bins, pad, slope, middle, first, n, u0, across, values)
    half_columns = 0.5 * abs(slope) * n
    inside = first >= 0 and first + n_sums + n <= shape[0]
    inside = inside and u0 - drift - half_columns >= 0 and u0 + n_lines + drift + half_columns < shape[1]
    if not inside:
        _part_inside(shape, slope, middle, first, n, u0, values)
    for k in range(1, n_sums - 1, SAMPLE_EVERY):
        for i in range(2, n_lines - 2, SAMPLE_EVERY):
            if values[k, i] != 0.0:
                step = int(values[k, i] / STEP + 0.5 * HISTOGRAM)
                histogram[min(max(step, 0), HISTOGRAM - 1)] += 1
    return _maxima(values, least, tile, slope, middle, first + 0.5 * (n - 1), u0, raw, n_raw)


@njit(cache=True)
def _sums(bins, pad, slope, middle, first, n, u0, across, values):
    """Write the sums of n rows, three lines weighted (across, 1, across), in units of white noise."""
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


@njit(cache=True)
def _part_inside(shape, slope, middle, first, n, u0, values):
    """Weigh sums that the border cuts against the noise of the part inside; too small a part is no sum."""
    n_lines = values.shape[1]
    low, high = np.empty(n_lines, dtype=np.int32), np.empty(n_lines, dtype=np.int32)
    for i in range(n_lines):
        column = u0 + i  # at the middle row
        low[i], high[i] = 0, shape[0] - 1
        if abs(slope) > 1e-9:
            one = middle + (0.0 - column) / slope
            two = middle + (shape[1] - 1.0 - column) / slope
            low[i] = max(0.0, np.ceil(min(max(min(one, two), -1e6), 1e6)))
            high[i] = min(shape[0] - 1.0, np.floor(min(max(max(one, two), -1e6), 1e6)))
        elif column < 0 or column > shape[1] - 1:
            high[i] = -1
    weight = np.zeros(n + 1, dtype=np.float32)
    for count in range(n + 1):
        weight[count] = np.sqrt(n / count) if count >= max(LEAST_PART * n, 1.0) else 0.0
    for k in range(values.shape[0]):
        top, bottom, row = np.int32(first + k), np.int32(first + k + n - 1), values[k]
        for i in range(n_lines):
            count = min(high[i], bottom) - max(low[i], top) + 1
            row[i] *= weight[np.uint32(max(count, 0))]


@njit(cache=True)
def _maxima(values, least, tile, slope, middle, first_middle, u0, raw, n_raw):
    """Append maxima above `least` whose middle is in the tile: value, x, y [px]; new length."""
    _, _, c0, c1 = tile
    r0, r1 = tile[0], tile[1]
    for k in range(1, values.shape[0] - 1):
        before, here, after = values[k - 1], values[k], values[k + 1]
        row = first_middle + k
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


@njit(cache=True)
def _spread(histogram):
    """Standard deviation and median of the filtered frame from quantiles that stars do not raise."""
    n = histogram.sum()
    below, k = 0, 0
    quantile = np.zeros(2)
    for which in range(2):
        target = n * (SIGMA_QUANTILE if which == 0 else 0.5)
        while below + histogram[k] < target:
            below += histogram[k]
            k += 1
        share = (target - below) / histogram[k] if histogram[k] > 0 else 0.0
        quantile[which] = (k + share - 0.5 * HISTOGRAM) * STEP
    return max(quantile[1] - quantile[0], 0.5), quantile[1]


@njit(cache=True)
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
