"""Point-like objects in a picture of the night sky, by the detection that flies.

In: grey values of any range over any background. Out: centroids and brightnesses, brightest first. Large
pictures are binned. What varies over tiles of the picture (sky glow, clouds, vignetting) is taken away, the
noise is brought to a few grey values, so that the detection of the star tracker can be used as it is. Gaps
between leaves and the like have no sky around them or are not brighter than the sky near them: the former
are dropped, the latter are marked.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.detect import detect
from shefex_nav.onboard.startracker.settings import Detection

LARGEST_PX = 2048  # of the longer side; larger pictures are binned
TILE_PX = 24  # of the background
BLACK_DN, NOISE_DN, WHITE_DN = 20.0, 3.0, 255.0  # of the 8-bit frame
APERTURE_PX = 1.0  # beyond the radius of an object, for its brightness
RING_PX = (2.0, 5.5)  # around an object and its radius; a star has the sky there
RING_SIGMA, RING_SHARE = 5.0, 0.25  # a pixel is not sky beyond this noise; so many of them may be
EDGE_SIGMA = 8.0  # of the noise: neighbouring tiles that differ by more have something before the sky
EDGE_TILES = 6  # so far from such an edge there may be gaps in it
ABOVE_SIGMA = 5.0  # of the noise, the peak of a star over the brightest tile there
FLAT_SIGMA = 0.3  # grey steps, noise of a picture without any: rounding hides it

DETECTION = Detection(
    scan="sequential",
    centroid="fit",
    tile=72,
    seed_sigma=5.5,
    grow_sigma=3.5,
    fewest_pixels=5,
    most_pixels=600,
    largest_peak=0.85,
    most_objects=1000,
    saturation=255.0,
    run_length=None,
)


class Field(NamedTuple):
    """What was found in a picture."""

    xy_px: np.ndarray  # (n, 2) centroids in pixels of the picture as it is
    flux: np.ndarray  # (n,) descending, grey values
    in_sky: np.ndarray  # (n,) bool, no gap in a foreground: brighter than the sky around it
    n_pixels: np.ndarray  # (n,) of the binned picture
    binning: int
    noise: float  # grey values, of one binned pixel


def find(grey):
    """Point-like objects of a picture. (rows, columns) grey values -> Field."""
    binning = int(np.ceil(max(grey.shape) / LARGEST_PX))
    if binning > 1:
        grey = binned(grey, binning)
    flat, noise, sky = flatten(grey)
    frame = np.clip(np.rint(BLACK_DN + NOISE_DN / noise * flat), 0.0, WHITE_DN).astype(np.uint8)
    found, _ = detect(DETECTION, CameraModel(), frame)
    radius_px = np.sqrt(found.n_pixels / np.pi)
    flux = aperture(flat, found.xy_px, radius_px + APERTURE_PX)
    lonely = crowding(flat, found.xy_px, radius_px, RING_SIGMA * noise) < RING_SHARE
    order = np.argsort(-flux, kind="stable")
    order = order[(flux[order] > 0.0) & lonely[order]]
    in_sky = brighter_than_sky(grey, found.xy_px, sky, noise)[order]
    xy_px = found.xy_px[order] * binning + 0.5 * (binning - 1)
    return Field(
        np.ascontiguousarray(xy_px), flux[order], in_sky, found.n_pixels[order], binning, float(noise)
    )


def binned(grey, n):
    """Mean of blocks of n x n pixels; what is left over at the right and the lower border is cut."""
    rows, columns = grey.shape[0] // n, grey.shape[1] // n
    blocks = grey[: rows * n, : columns * n].reshape(rows, n, columns, n)
    return blocks.mean(axis=(1, 3), dtype=np.float32)


def flatten(grey):
    """Picture without its background, the noise of one pixel, and what a star has to outshine.

    The last is the brightest tile in the neighbourhood of an edge, -inf where there is none. The background
    is the median of tiles, smoothed over three of them and interpolated linearly. The noise is the median
    over the tiles of the distance between the median and the quantile one sigma below.
    """
    from scipy.ndimage import maximum_filter, median_filter, minimum_filter

    rows, columns = grey.shape
    n_r, n_c = max(rows // TILE_PX, 1), max(columns // TILE_PX, 1)
    edges_r = np.linspace(0, rows, n_r + 1).astype(int)
    edges_c = np.linspace(0, columns, n_c + 1).astype(int)
    middle, low = tile_quantiles(grey, edges_r, edges_c)
    noise = max(np.median(middle - low), FLAT_SIGMA * grey_step(grey))
    smooth = median_filter(middle, 3, mode="nearest")
    flat = subtract(
        grey, smooth, 0.5 * (edges_r[:-1] + edges_r[1:] - 1), 0.5 * (edges_c[:-1] + edges_c[1:] - 1)
    )
    edge = (
        maximum_filter(smooth, 3, mode="nearest") - minimum_filter(smooth, 3, mode="nearest")
        > EDGE_SIGMA * noise
    )
    reach = 2 * EDGE_TILES + 1
    near = maximum_filter(edge, reach, mode="nearest")
    return flat, noise, np.where(near, maximum_filter(middle, reach, mode="nearest"), -np.inf)


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
    """Median and quantile one sigma below it of every tile: (tiles, tiles), (tiles, tiles)."""
    n_r, n_c = len(edges_r) - 1, len(edges_c) - 1
    middle, low = np.empty((n_r, n_c)), np.empty((n_r, n_c))
    for i in range(n_r):
        for j in range(n_c):
            values = grey[edges_r[i] : edges_r[i + 1], edges_c[j] : edges_c[j + 1]].copy().ravel()
            values.sort()
            middle[i, j] = values[len(values) // 2]
            low[i, j] = values[int(0.158655 * len(values))]
    return middle, low


@kernel
def subtract(grey, tiles, at_r, at_c):
    """Picture minus a background that is known at the rows at_r and the columns at_c."""
    rows, columns = grey.shape
    flat = np.empty((rows, columns), dtype=np.float32)
    left, share = np.empty(columns, dtype=np.int64), np.empty(columns)
    for c in range(columns):
        left[c], share[c] = _between(at_c, c)
    line = np.empty(len(at_c) + 1)
    for r in range(rows):
        i, s = _between(at_r, r)
        below = min(i + 1, len(at_r) - 1)
        for j in range(len(at_c)):
            line[j] = (1.0 - s) * tiles[i, j] + s * tiles[below, j]
        line[len(at_c)] = line[len(at_c) - 1]
        for c in range(columns):
            j = left[c]
            flat[r, c] = grey[r, c] - ((1.0 - share[c]) * line[j] + share[c] * line[j + 1])
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
                    other += abs(flat[r, c]) > limit
        share[k] = other / max(total, 1)
    return share
