"""Clusters of bright pixels, as the Improved Multi-Poles paper finds its stars (section 2).

In: one frame. Out: `Clusters`, brightest first, and which of them are the same star in the next frame.

    zigzag moving average -> pixels above it by tau_pre -> runs along the rows -> touching runs are a cluster,
    a single pixel is none -> energy-weighted centroid (equations 1 and 2)

The background of a pixel is the mean of the `window` pixels before it on a way that runs through the rows
in turn from left to right and from right to left, so that the way never jumps. A star must not be its own
background: ahead of it the average knows nothing of it, but within and behind it, for a window's length, its
light would lift the threshold (a star of magnitude 0 by more than tau_pre itself, and the trail lies on the
other side in every other row). So each pixel enters the average with at most CLIP tau_pre above or below the
present one: a streak of 50 pixels along the way lifts a window of 256 by 5 per cent of tau_pre, noise is cut
alike on both sides, and the average still climbs an edge of stray light of ten tau_pre within about ten
windows, a few rows.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel

CLIP = 0.25  # of tau_pre: how far a pixel may pull the average [E]
CUT_PX = 0.36  # error of a centroid cut at the threshold, over the root of its number of pixels; measured [E]
SAMPLED_ROWS = 8  # every so many rows the noise is measured


class Clusters(NamedTuple):
    """Objects of one frame, brightest first; n of them with m pixels in all."""

    xy_px: np.ndarray  # (n, 2) energy-weighted
    energy_dn: np.ndarray  # (n,) sum above the background
    first_row: np.ndarray  # (n,) int64
    last_row: np.ndarray  # (n,) int64
    first_column: np.ndarray  # (n,) int64
    last_column: np.ndarray  # (n,) int64
    n_saturated: np.ndarray  # (n,) int64 pixels
    sigma_px: (
        np.ndarray
    )  # (n, 2) standard deviation of xy_px: noise of the pixels, and which of them there are
    pixels: np.ndarray  # (m, 2) int64 row, column; those of cluster k are pixels[begin[k]:begin[k + 1]]
    begin: np.ndarray  # (n + 1,) int64
    mean_dn: float  # of the frame
    background_dn: float  # mean of the moving average at the ends of the rows
    noise_dn: float  # standard deviation of a pixel, from neighbours that differ by less than tau_pre


def find(settings, camera, image_dn):
    """Clusters of a frame.

    Parameters
    ----------
    settings : Detection; tau_pre is the threshold of its run_length
    camera : CameraModel; of it `electrons_per_dn`
    image_dn : (rows, columns) uint8 or uint16

    Returns
    -------
    Clusters

    Raises
    ------
    ValueError : not such a frame, a window that is no power of two, a threshold that is not positive
    """
    image_dn = np.ascontiguousarray(image_dn)
    if image_dn.ndim != 2 or image_dn.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"image: expected grey values of shape (rows, columns), uint8 or uint16, "
            f"got {image_dn.dtype} of shape {image_dn.shape}"
        )
    window, tau_pre_dn = settings.run_length.window, settings.run_length.threshold / camera.electrons_per_dn
    shift = int(window).bit_length() - 1
    if window != 1 << max(shift, 0):
        raise ValueError(f"moving average: a window of {window} pixels is not a power of two")
    if not tau_pre_dn > 0.0:
        raise ValueError(f"tau_pre must be positive, got {tau_pre_dn}")
    clip_dn = max(1, round(CLIP * tau_pre_dn))
    first_level = int(np.median(image_dn[0]))
    pixels, energy_dn, statistics = _bright_pixels_kernel(
        image_dn, shift, float(tau_pre_dn), clip_dn, first_level
    )
    label, n = _clusters_kernel(*runs(pixels))
    noise_dn = statistics[2]
    table = _measure_kernel(image_dn, int(settings.saturation), pixels, energy_dn, noise_dn, label, n)
    return Clusters(*table, *statistics)


@inner
def _scan_row(row, back, average, shift, limit, clip_dn, column, energy_dn):
    """Go along one row, list the bright pixels with their energies; how many, and the moving average.

    As long as the level, which is the average rounded, stays the same, a pixel waits for the one before it
    only with one sum: hence the two loops.

    row : (n,), gone through from its end if `back`
    average : its window, the place in it of the oldest value, the sum of the window
    """
    window, oldest, total = average
    size, k = 1 << shift, np.uint64(oldest)
    mask, one = np.uint64(size - 1), np.uint64(1)
    columns, n, passed = len(row), 0, 0
    at, step = (columns - 1, -1) if back else (0, 1)
    while passed < columns:
        level = (total + (size >> 1)) >> shift
        low_dn, high_dn = level - clip_dn, level + clip_dn
        least = (level << shift) - (size >> 1)  # sum of this level
        while passed < columns and least <= total < least + size:
            value = np.int64(row[np.uint64(at)])
            if (value << shift) - total > limit:
                column[n], energy_dn[n] = at, value - total / size
                n += 1
            entry = min(max(value, low_dn), high_dn)
            total += entry - window[k]
            window[k] = entry
            k = (k + one) & mask
            at += step
            passed += 1
    return n, (window, np.int64(k), total)


@kernel
def _bright_pixels_kernel(image_dn, shift, tau_pre_dn, clip_dn, first_level):
    """Pixels above the moving average by more than tau_pre, row by row from left to right.

    All in integers: the window holds 1 << shift grey values and its sum is exact. It begins full of
    first_level.

    Returns
    -------
    pixels : (m, 2) row, column
    energy_dn : (m,) above the average
    statistics : mean of the frame, mean of the average at the ends of the rows, noise
    """
    rows, columns = image_dn.shape
    limit = np.int64(np.floor(tau_pre_dn * (1 << shift)))
    average = np.full(1 << shift, first_level, dtype=np.int64), 0, first_level << shift
    pixels, energy_dn = np.empty((columns, 2), dtype=np.int64), np.empty(columns)
    hit, hit_dn = np.empty(columns, dtype=np.int64), np.empty(columns)
    m, light, levels, squares, n_squares = 0, 0, 0, 0, 1
    for r in range(rows):
        back = r % 2 == 1
        n, average = _scan_row(image_dn[r], back, average, shift, limit, clip_dn, hit, hit_dn)
        if m + n > len(energy_dn):
            pixels = np.concatenate((pixels, np.empty_like(pixels)))
            energy_dn = np.concatenate((energy_dn, np.empty_like(energy_dn)))
        for h in range(n):
            place = m + n - 1 - h if back else m + h
            pixels[place, 0], pixels[place, 1] = r, hit[h]
            energy_dn[place] = hit_dn[h]
        m += n
        levels += average[2]
        for c in range(columns):
            light += np.int64(image_dn[r, c])
        if r % SAMPLED_ROWS == 0:
            for c in range(1, columns):
                difference = np.int64(image_dn[r, c]) - np.int64(image_dn[r, c - 1])
                if abs(difference) <= tau_pre_dn:
                    squares += difference * difference
                    n_squares += 1
    statistics = light / (rows * columns), levels / (rows << shift), np.sqrt(0.5 * squares / n_squares)
    return pixels[:m], energy_dn[:m], statistics


@kernel
def runs(pixels):
    """Run-length code of a list of pixels in the order of rows and columns.

    Returns
    -------
    row, first, last : (n,) int64, columns first ... last of the row
    member : (m,) int64 run of each pixel
    """
    m = len(pixels)
    row, first, last = np.empty(m, np.int64), np.empty(m, np.int64), np.empty(m, np.int64)
    member = np.empty(m, dtype=np.int64)
    n = 0
    for p in range(m):
        r, c = pixels[p, 0], pixels[p, 1]
        if n > 0 and row[n - 1] == r and last[n - 1] == c - 1:
            last[n - 1] = c
        else:
            row[n] = r
            first[n] = last[n] = c
            n += 1
        member[p] = n - 1
    return row[:n], first[:n], last[:n], member


@inner
def _root(parent, a):
    """The run that stands for the cluster of run a; the way to it is shortened."""
    while parent[a] != a:
        parent[a] = parent[parent[a]]
        a = parent[a]
    return a


@kernel
def _clusters_kernel(row, first, last, member):
    """Runs that touch, also at a corner, are one cluster; single pixels are none (union-find over the runs).

    Returns
    -------
    label : (m,) cluster of each pixel, -1 for an isolated one
    n : int, clusters, in the order of their first pixels
    """
    parent = np.arange(len(row))
    above = 0  # first run of the row before that may still touch
    for a in range(len(row)):
        while above < a and (row[above] < row[a] - 1 or (row[above] < row[a] and last[above] < first[a] - 1)):
            above += 1
        b = above
        while b < a and row[b] == row[a] - 1 and first[b] <= last[a] + 1:
            parent[_root(parent, b)] = _root(parent, a)
            b += 1
    n_pixels = np.zeros(len(row), dtype=np.int64)
    for p in range(len(member)):
        n_pixels[_root(parent, member[p])] += 1
    number = np.full(len(row), -1, dtype=np.int64)
    label = np.full(len(member), -1, dtype=np.int64)
    n = 0
    for p in range(len(member)):
        root = _root(parent, member[p])
        if n_pixels[root] > 1:
            if number[root] < 0:
                number[root] = n
                n += 1
            label[p] = number[root]
    return label, n


@kernel
def _measure_kernel(image_dn, saturation_dn, pixels, energy_dn, noise_dn, label, n):
    """The columns of Clusters up to `begin`, brightest first."""
    energy, sums = np.zeros(n), np.zeros((n, 2))
    n_pixels, n_saturated = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    for p in range(len(label)):
        k = label[p]
        if k >= 0:
            r, c = pixels[p, 0], pixels[p, 1]
            energy[k] += energy_dn[p]
            sums[k, 0] += energy_dn[p] * c
            sums[k, 1] += energy_dn[p] * r
            n_pixels[k] += 1
            n_saturated[k] += image_dn[r, c] >= saturation_dn
    order = np.argsort(-energy, kind="mergesort")
    place = np.empty(n, dtype=np.int64)  # of the cluster with this label
    begin = np.zeros(n + 1, dtype=np.int64)
    for k in range(n):
        place[order[k]] = k
        begin[k + 1] = begin[k] + n_pixels[order[k]]
    xy_px = np.empty((n, 2))
    for k in range(n):
        xy_px[k] = sums[order[k]] / energy[order[k]]
    box = np.empty((4, n), dtype=np.int64)  # first row, last row, first column, last column
    box[0], box[1], box[2], box[3] = image_dn.shape[0], -1, image_dn.shape[1], -1
    sorted_pixels, filled = np.empty((begin[n], 2), dtype=np.int64), begin[:n].copy()
    spread = np.zeros((n, 2))
    for p in range(len(label)):
        if label[p] >= 0:
            k, r, c = place[label[p]], pixels[p, 0], pixels[p, 1]
            sorted_pixels[filled[k]] = pixels[p]
            filled[k] += 1
            box[0, k], box[1, k] = min(box[0, k], r), max(box[1, k], r)
            box[2, k], box[3, k] = min(box[2, k], c), max(box[3, k], c)
            spread[k, 0] += (c - xy_px[k, 0]) ** 2
            spread[k, 1] += (r - xy_px[k, 1]) ** 2
    energy = energy[order]
    sigma_px = np.empty((n, 2))
    for k in range(n):
        sigma_px[k] = np.sqrt(
            noise_dn**2 * spread[k] / energy[k] ** 2 + CUT_PX**2 / (begin[k + 1] - begin[k])
        )
    return xy_px, energy, box[0], box[1], box[2], box[3], n_saturated[order], sigma_px, sorted_pixels, begin


def fuse(first, second, distance_px):
    """Which clusters of two frames are one star: cluster fusion, section 2.3.

    Each cluster of the first frame is given the nearest one of the second, by the smallest distance between
    a pixel of the one and a pixel of the other: where the exposures are contiguous a streak begins where the
    one before has ended, however long it is. Nearest must be less than distance_px. A cluster of the second
    frame that several claim (a streak that broke) goes to the nearest of them.

    Parameters
    ----------
    first, second : Clusters of two frames in succession
    distance_px : float, d_f

    Returns
    -------
    (m, 2) int64 rows of first and second, in the order of `second`: each at most once
    """
    return _fuse_kernel(_boxes(first), first.pixels, first.begin,
                        _boxes(second), second.pixels, second.begin, float(distance_px))  # fmt: skip


def _boxes(clusters):
    """(n, 4) first row, last row, first column, last column."""
    return np.column_stack(
        (clusters.first_row, clusters.last_row, clusters.first_column, clusters.last_column)
    )


@kernel
def _fuse_kernel(boxes_1, pixels_1, begin_1, boxes_2, pixels_2, begin_2, distance_px):
    """As `fuse`; only clusters whose boxes are near are looked at pixel by pixel."""
    n_1, n_2 = len(boxes_1), len(boxes_2)
    partner, partner_d2 = np.full(n_2, -1, dtype=np.int64), np.full(n_2, np.inf)
    limit2 = distance_px * distance_px
    for i in range(n_1):
        nearest, nearest_d2 = -1, limit2
        for j in range(n_2):
            rows = max(0, boxes_2[j, 0] - boxes_1[i, 1], boxes_1[i, 0] - boxes_2[j, 1])
            columns = max(0, boxes_2[j, 2] - boxes_1[i, 3], boxes_1[i, 2] - boxes_2[j, 3])
            if rows * rows + columns * columns >= nearest_d2:
                continue
            for p in range(begin_1[i], begin_1[i + 1]):
                for q in range(begin_2[j], begin_2[j + 1]):
                    dr, dc = pixels_1[p, 0] - pixels_2[q, 0], pixels_1[p, 1] - pixels_2[q, 1]
                    if dr * dr + dc * dc < nearest_d2:
                        nearest, nearest_d2 = j, float(dr * dr + dc * dc)
        if nearest >= 0 and nearest_d2 < partner_d2[nearest]:
            partner[nearest], partner_d2[nearest] = i, nearest_d2
    found = np.flatnonzero(partner >= 0)
    out = np.empty((len(found), 2), dtype=np.int64)
    for k in range(len(found)):
        out[k, 0], out[k, 1] = partner[found[k]], found[k]
    return out


# --- what a pixel weighs in a centroid: a switch of equation (1) ---
#
# As printed E(p), the charge of the pixel above the background. All alike 1: the centroid is the middle of
# the pixels above the threshold, which is what routines that list the properties of regions call the
# centroid where they are not given the picture. Which pixels there are, extents and energy stay as they were.

AS_PRINTED, ALIKE = "weights as printed", "pixels all alike"
WEIGHTS = (AS_PRINTED, ALIKE)


def weighted(weights, clusters):
    """Clusters with the centroids of a reading.

    Parameters
    ----------
    weights : one of WEIGHTS
    clusters : Clusters of a frame, as `clusters.find` has them

    Returns
    -------
    Clusters

    Raises
    ------
    ValueError : no such weights
    """
    if weights not in WEIGHTS:
        raise ValueError(f"weights: {weights!r} is not known; choose from: {', '.join(WEIGHTS)}")
    if weights == AS_PRINTED:
        return clusters
    n_pixels = np.diff(clusters.begin)
    which = np.repeat(np.arange(len(n_pixels)), n_pixels)
    sums = (np.bincount(which, place, len(n_pixels)) for place in clusters.pixels.T[::-1])
    return clusters._replace(xy_px=np.column_stack([one / n_pixels for one in sums]))
