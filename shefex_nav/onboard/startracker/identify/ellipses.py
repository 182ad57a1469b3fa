"""The error ellipse of each centroid, in units of the error of an ordinary star.

In: the covariance of each centroid. Out: the same relative to sigma_px^2, its inverse and its area. A
distance in pixels that is weighted with the inverse is as many sigma_px as the Mahalanobis distance is
sigmas, so all gates, noise scales and tails of the identification, which are multiples of sigma_px, hold for
a streak as they do for a spot.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

LEAST = 0.3  # sigma_px; no axis is believed to be shorter, as lens and catalogue have errors, too [E]
LONGEST_PX = 10.0  # nor longer: beyond, a centroid says nothing


class Ellipses(NamedTuple):
    """Errors of n centroids; all as one where they are round."""

    are_round: bool  # sigma_px for all: spread and weight are unit matrices
    spread: np.ndarray  # (n, 3) xx, xy, yy of the covariance, in sigma_px^2
    weight: np.ndarray  # (n, 3) of its inverse
    log_area: np.ndarray  # (n,) ln sqrt det of the spread


def checked(P_px, n, name="P_px"):
    """Covariances (n, 2, 2) px^2 as an array of our own layout, or a ValueError that says what is wrong."""
    P = np.ascontiguousarray(P_px, dtype=np.float64)
    if P.shape != (n, 2, 2):
        raise ValueError(f"{name}: expected shape ({n}, 2, 2), got {P.shape}")
    if not np.isfinite(P).all():
        raise ValueError(f"{name}: contains NaN or infinite values")
    xx, yy, xy, yx = P[:, 0, 0], P[:, 1, 1], P[:, 0, 1], P[:, 1, 0]
    symmetric = np.abs(xy - yx) <= 1e-9 * (np.abs(xx) + np.abs(yy))
    bad = ~(symmetric & (xx > 0.0) & (yy > 0.0) & (xx * yy - xy * yx > 0.0))
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        raise ValueError(f"{name}: expected positive definite matrices, got {P[k].tolist()} for centroid {k}")
    return P


@njit(cache=True)
def round_ones(n):
    """Ellipses of n centroids with the error sigma_px."""
    unit = np.zeros((n, 3))
    unit[:, 0] = unit[:, 2] = 1.0
    return Ellipses(True, unit, unit, np.zeros(n))


@njit(cache=True)
def ellipses_of(P_px, n, sigma_px):
    """Ellipses of the first n covariances P_px (m, 2, 2) px^2; axes within LEAST and LONGEST_PX."""
    spread, weight, log_area = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    least, most = LEAST**2, max((LONGEST_PX / sigma_px) ** 2, 1.0)
    for k in range(n):
        xx, yy = P_px[k, 0, 0] / sigma_px**2, P_px[k, 1, 1] / sigma_px**2
        xy = 0.5 * (P_px[k, 0, 1] + P_px[k, 1, 0]) / sigma_px**2
        middle, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
        radius = np.sqrt(half * half + xy * xy)
        long, short = min(max(middle + radius, least), most), min(max(middle - radius, least), most)
        shrink = 0.5 * (long - short) / radius if radius > 0.0 else 0.0
        middle, half, xy = 0.5 * (long + short), half * shrink, xy * shrink
        det = long * short
        spread[k, 0], spread[k, 1], spread[k, 2] = middle + half, xy, middle - half
        weight[k, 0], weight[k, 1], weight[k, 2] = (middle - half) / det, -xy / det, (middle + half) / det
        log_area[k] = 0.5 * np.log(det)
    return Ellipses(False, spread, weight, log_area)


@njit(cache=True)
def weighted2(weight, k, dx, dy):
    """Squared distance from centroid k, px^2 of an ordinary star."""
    return weight[k, 0] * dx * dx + 2.0 * weight[k, 1] * dx * dy + weight[k, 2] * dy * dy


@njit(cache=True)
def along(spread, i, j, dx, dy):
    """Mean of the variances of centroids i and j along the line (dx, dy), in sigma_px^2."""
    a, b, c = spread[i, 0] + spread[j, 0], spread[i, 1] + spread[j, 1], spread[i, 2] + spread[j, 2]
    return 0.5 * (a * dx * dx + 2.0 * b * dx * dy + c * dy * dy) / (dx * dx + dy * dy)


@njit(cache=True)
def between2(spread, i, j, dx, dy):
    """Squared distance (dx, dy) between centroids i and j, weighted with the mean of their covariances."""
    xx, xy = 0.5 * (spread[i, 0] + spread[j, 0]), 0.5 * (spread[i, 1] + spread[j, 1])
    yy = 0.5 * (spread[i, 2] + spread[j, 2])
    return (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
