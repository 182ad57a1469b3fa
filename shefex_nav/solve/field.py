"""Point-like objects in a picture of the night sky, by the detection that flies.

In: grey values of any range over any background. Out: centroids with a covariance each and brightnesses,
brightest first. Large pictures are binned. What varies over tiles of the picture (sky glow, clouds,
vignetting) is taken away, the noise is brought to a few grey values, so that the detection of the star
tracker can be used as it is. Its fit of the spots sees finer grey values, up to where the picture itself is
saturated: of a bright star the slopes are fitted. Gaps between leaves and the like have no sky around them or
are not brighter than the sky near them: the former are dropped, the latter are marked.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker import fit
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.detect import detect
from shefex_nav.onboard.startracker.scan import BACKGROUND, FLUX, NOISE, PIXELS, X, Y
from shefex_nav.onboard.startracker.settings import Detection
from shefex_nav.onboard.startracker.spot import Picture

LARGEST_PX = 2048  # of the longer side; larger pictures are binned
TILE_PX, EVERY = 12, 2  # of the background; pixels that are looked at for it
COUNTED = 512  # whole grey values of a tile that are counted, in the place of being sorted
BLACK_DN, NOISE_DN, WHITE_DN = 20.0, 3.0, 255.0  # of the 8-bit frame
APERTURE_PX = 1.0  # beyond the radius of an object, for its brightness
RING_PX = (2.0, 5.5)  # around an object and its radius; a star has the sky there
RING_SIGMA, RING_HEIGHT, RING_SHARE = 5.0, 0.1, 0.25  # a pixel is not sky beyond this noise; so many of them may be
EDGE_SIGMA = 8.0  # of the noise: neighbouring tiles that differ by more have something before the sky
EDGE_TILES = 12  # so far from such an edge there may be gaps in it
ABOVE_SIGMA = 5.0  # of the noise, the peak of a star over the brightest tile there
FINER, FULL_DN = 32, 65535  # grey values of the fit for one of the detection; a saturated pixel there
FULL_SHARE = 0.97  # of the brightest pixel's height: what is above is saturated, as JPEG rings a little
BLOB_SHARE = 0.06  # of its radius, error of the place of a star that is mostly saturated
CORE_PX = 1.5  # radius around the middle that has to stand out
MOST_IN_LINE, LINE_PX, LINE_OF = 80, 2.0, 8  # brightest objects; so many within this of a line are a trail
CROWDED, FAINT = 0, 1  # no sky around it; no more than the noise in its middle
PROMINENT, AROUND_PX, EVERY_PX = 5.0, 42, 6
LAG = 2
MANY, REACH, COMPARABLE = 4, 0.06, 0.5
FLAT_SIGMA = 0.3  # grey steps, noise of a picture without any: rounding hides it

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


BINNED = replace(DETECTION, fewest_pixels=3, largest_peak=1.0)


class Field(NamedTuple):
    """What was found in a picture."""

    xy_px: np.ndarray  # (n, 2) centroids in pixels of the picture as it is
    P_px: np.ndarray  # (n, 2, 2) px^2, their covariance by the noise of the pixels
    flux: np.ndarray  # (n,) descending, grey values
    saturated: np.ndarray  # (n,) bool, in the middle
    in_sky: np.ndarray  # (n,) bool, no gap in a foreground: brighter than the sky around it
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
    flat, noise, sky = flatten(grey, step)
    found, at_full, fitted_flux = detected(flat, grey, noise, DETECTION if binning == 1 else BINNED)
    radius_px = np.sqrt(found.n_pixels / np.pi)
    flux = aperture(flat, found.xy_px, radius_px + APERTURE_PX)
    flux[at_full] = np.maximum(flux, fitted_flux)[at_full]
    # the tiles of the detection see no noise where rounding has left a picture without any
    core = aperture(flat, found.xy_px, np.full(len(flux), CORE_PX))
    limit = np.maximum(RING_SIGMA * noise, RING_HEIGHT * core / (np.pi * CORE_PX**2))
    lonely = crowding(flat, found.xy_px, radius_px, limit) < RING_SHARE
    clear = core > DETECTION.seed_sigma * np.sqrt(np.pi) * CORE_PX * noise
    order = np.argsort(-flux, kind="stable")
    good = lonely & clear & (flux > 0.0)
    order, others = order[good[order]], np.flatnonzero(~good)
    in_sky = good & brighter_than_sky(grey, found.xy_px, sky, noise)
    in_sky &= prominence(flat, found.xy_px, radius_px, max(FLAT_SIGMA * step, noise / 3.0)) > PROMINENT
    in_sky &= ~among_others(found.xy_px, core, in_sky, REACH * np.sqrt(flat.size))
    in_sky = in_sky[order]
    in_sky &= ~in_line(found.xy_px[order][:MOST_IN_LINE], len(order))
    xy_px = found.xy_px * binning + 0.5 * (binning - 1)
    return Field(
        np.ascontiguousarray(xy_px[order]), binning**2 * found.P_px[order], flux[order], at_full[order],
        in_sky, found.n_pixels[order], binning, float(noise), xy_px[others],
        np.where(lonely[others], FAINT, CROWDED),
    )  # fmt: skip


def detected(flat, grey, noise, settings):
    """Objects of a picture without its background: Detections, which are saturated, flux of the fit [grey].

    The scan sees 8 bits; the fit of the spots sees FINER steps, up to where the picture itself is saturated.
    """
    full = float(grey.min()) + FULL_SHARE * float(grey.max() - grey.min())
    frame, fine = frames_of(flat, grey, full, NOISE_DN / noise)
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
def frames_of(flat, grey, full, gain):
    """8-bit frame of the detection and 16-bit frame of the fit: their noise is NOISE_DN, and FINER times."""
    rows, columns = flat.shape
    frame, fine = np.empty((rows, columns), dtype=np.uint8), np.empty((rows, columns), dtype=np.uint16)
    for r in range(rows):
        for c in range(columns):
            value = BLACK_DN + gain * flat[r, c] + 0.5
            frame[r, c] = min(max(value, 0.0), WHITE_DN)
            value = FINER * (value - 0.5) + 0.5
            fine[r, c] = FULL_DN if grey[r, c] >= full else min(max(value, 0.0), FULL_DN - 1.0)
    return frame, fine


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


def flatten(grey, step=None):
    """Picture without its background, the noise of one pixel, and what a star has to outshine.

    step : between grey values, before anything was averaged: rounding leaves that much of structure

    The last is the brightest tile in the neighbourhood of an edge, -inf where there is none. The background
    is the median of tiles, smoothed over three of them and interpolated linearly. The noise is the median
    over the tiles of the distance between the median and the quantile one sigma below.
    """
    from scipy.ndimage import maximum_filter, median_filter

    rows, columns = grey.shape
    n_r, n_c = max(rows // TILE_PX, 1), max(columns // TILE_PX, 1)
    edges_r = np.linspace(0, rows, n_r + 1).astype(int)
    edges_c = np.linspace(0, columns, n_c + 1).astype(int)
    middle, low = tile_quantiles(grey, edges_r, edges_c)
    noise = max(np.median(middle - low), FLAT_SIGMA * (grey_step(grey) if step is None else step))
    smooth = median_filter(middle, 3, mode="nearest")
    flat = subtract(
        grey, smooth, 0.5 * (edges_r[:-1] + edges_r[1:] - 1), 0.5 * (edges_c[:-1] + edges_c[1:] - 1)
    )
    edge = bent(smooth) > EDGE_SIGMA * max(noise, grey_step(grey) if step is None else step)
    reach = 2 * EDGE_TILES + 1
    near = maximum_filter(edge, reach, mode="nearest")
    return flat, noise, np.where(near, maximum_filter(middle, reach, mode="nearest"), -np.inf)


def bent(tiles):
    """Largest second difference of each tile with those LAG away, along rows and columns: no slope has any."""
    wide = np.pad(tiles, LAG, mode="edge")
    inner = wide[LAG:-LAG, LAG:-LAG]
    rows = np.abs(wide[: -2 * LAG, LAG:-LAG] - 2.0 * inner + wide[2 * LAG :, LAG:-LAG])
    columns = np.abs(wide[LAG:-LAG, : -2 * LAG] - 2.0 * inner + wide[LAG:-LAG, 2 * LAG :])
    return np.maximum(rows, columns)


@kernel
def among_others(xy_px, height, trusted, reach_px):
    """Which trusted objects are among many that are none and no fainter. -> (n,) bool."""
    n = xy_px.shape[0]
    among = np.zeros(n, dtype=np.bool_)
    for k in range(n):
        if not trusted[k]:
            continue
        own, others = 0, 0
        for m in range(n):
            near = (xy_px[m, 0] - xy_px[k, 0]) ** 2 + (xy_px[m, 1] - xy_px[k, 1]) ** 2 < reach_px**2
            if near and height[m] > COMPARABLE * height[k]:
                if trusted[m]:
                    own += 1
                else:
                    others += 1
        among[k] = others >= MANY and others > 2 * own
    return among


def brighter_than_sky(grey, xy_px, sky, noise):
    """Whether the brightest pixel around each centroid is above the sky of its tile. -> (n,) bool."""
    if len(xy_px) == 0:
        return np.zeros(0, dtype=bool)
    column, row = np.rint(xy_px).astype(int).T
    near = [(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]  # detections are not at the border
    peak = np.max([grey[r, c] for r, c in near], axis=0)
    tile = row * sky.shape[0] // grey.shape[0], column * sky.shape[1] // grey.shape[1]
    return peak > sky[tile] + ABOVE_SIGMA * noise


def grey_step(grey):
    """Smallest difference between two grey values that occur."""
    values = np.unique(grey[:: max(grey.shape[0] // 64, 1)])
    steps = np.diff(values)
    return float(steps.min()) if len(steps) else 1.0


@kernel
def tile_quantiles(grey, edges_r, edges_c):
    """Median and quantile one sigma below it of every tile: (tiles, tiles), (tiles, tiles).

    Of every EVERY-th row and column: the median of three tiles by three of these is good to 4 % of the noise.
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
                middle[i, j] = _nth(values, middle_rank, n)
                low[i, j] = _nth(values, low_rank, middle_rank + 1)  # the lower half comes first now
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
def _nth(values, k, n):
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


@kernel
def in_line(xy_px, n):
    """Which of n objects are beads of a trail, of an aircraft or a satellite; the first are given. -> (n,).

    Of 80 objects anywhere in a picture 0.4 are within 2 px of the line through two: eight are none by chance.
    """
    beads, m = np.zeros(n, dtype=np.bool_), xy_px.shape[0]
    for i in range(m):
        for j in range(i):
            dx, dy = xy_px[j, 0] - xy_px[i, 0], xy_px[j, 1] - xy_px[i, 1]
            reach = LINE_PX * np.sqrt(dx * dx + dy * dy)
            near = 0
            for k in range(m):
                near += abs(dx * (xy_px[k, 1] - xy_px[i, 1]) - dy * (xy_px[k, 0] - xy_px[i, 0])) < reach
            if near >= LINE_OF:
                for k in range(m):
                    if abs(dx * (xy_px[k, 1] - xy_px[i, 1]) - dy * (xy_px[k, 0] - xy_px[i, 0])) < reach:
                        beads[k] = True
    return beads


@kernel
def crowding(flat, xy_px, radius_px, limit):
    """Share of the pixels around each object that differ from the background by the limit. -> (n,)."""
    share = np.zeros(xy_px.shape[0])
    rows, columns = flat.shape
    for k in range(xy_px.shape[0]):
        x, y = xy_px[k, 0], xy_px[k, 1]
        inner, outer = radius_px[k] + RING_PX[0], radius_px[k] + RING_PX[1]
        other, total = 0, 0
        for r in range(max(int(y - outer), 0), min(int(y + outer) + 2, rows)):
            for c in range(max(int(x - outer), 0), min(int(x + outer) + 2, columns)):
                d2 = (c - x) ** 2 + (r - y) ** 2
                if inner * inner <= d2 <= outer * outer:
                    total += 1
                    other += abs(flat[r, c]) > limit[k]
        share[k] = other / max(total, 1)
    return share


@kernel
def prominence(flat, xy_px, radius_px, floor):
    """Mean of the nine pixels in the middle of each object, less that of its surroundings, over their scatter. -> (n,)"""
    rows, columns = flat.shape
    out = np.zeros(xy_px.shape[0])
    means = np.empty((2 * AROUND_PX // EVERY_PX + 1) ** 2)
    for k in range(xy_px.shape[0]):
        column, row, m = int(xy_px[k, 0] + 0.5), int(xy_px[k, 1] + 0.5), 0
        far2 = (radius_px[k] + 3.0) ** 2
        for i in range(-AROUND_PX, AROUND_PX + 1, EVERY_PX):
            for j in range(-AROUND_PX, AROUND_PX + 1, EVERY_PX):
                if i * i + j * j < far2:
                    continue
                r, c = row + i, column + j
                if r < 1 or c < 1 or r > rows - 2 or c > columns - 2:
                    continue
                means[m] = _nine(flat, r, c)
                m += 1
        if m < 20 or row < 1 or column < 1 or row > rows - 2 or column > columns - 2:
            continue
        middle = np.median(means[:m])
        for i in range(m):
            means[i] = abs(means[i] - middle)
        scatter = np.partition(means[:m], int(0.9 * m))[int(0.9 * m)] / 1.645
        out[k] = (_nine(flat, row, column) - middle) / max(scatter, floor)
    return out


@inner
def _nine(flat, row, column):
    total = 0.0
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            total += flat[r, c]
    return total / 9.0
