"""The error ellipse of each centroid, in units of the error of an ordinary star.

In: the covariance of each centroid. Out: the same relative to sigma_px^2, its inverse and its area. A
distance in pixels that is weighted with the inverse is as many sigma_px as the Mahalanobis distance is
sigmas, so all gates, noise scales and tails of the identification, which are multiples of sigma_px, hold for
a streak as they do for a spot.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import triples as t3

LEAST = 0.3  # sigma_px; no axis is believed to be shorter, as lens and catalogue have errors, too [E]
LONGEST_PX = 10.0  # nor longer


class Ellipses(NamedTuple):
    """Errors of n centroids. None in its place: round, sigma_px for all, and the plain formulas."""

    spread: np.ndarray  # (n, 3) xx, xy, yy of the covariance, in sigma_px^2
    weight: np.ndarray  # (n, 3) of its inverse
    log_area: np.ndarray  # (n,) ln sqrt det of the spread


def checked(P_px, n, name="P_px"):
    """Covariances (n, 2, 2) px^2 as an array of our own layout, or a ValueError that says what is wrong."""
    P = np.ascontiguousarray(P_px, dtype=np.float64)
    if P.shape != (n, 2, 2):
        raise ValueError(f"{name}: expected shape ({n}, 2, 2), got {P.shape}")
    finite, k = _first_bad(P)
    if not finite:
        raise ValueError(f"{name}: contains NaN or infinite values")
    if k >= 0:
        raise ValueError(f"{name}: expected positive definite matrices, got {P[k].tolist()} for centroid {k}")
    return P


@inner
def are_covariances(P, n):
    """Whether an array of three dimensions holds n covariances."""
    if P.shape != (n, 2, 2):
        return False
    finite, bad = _first_bad(P)
    return finite and bad < 0


@kernel
def _first_bad(P):
    """Whether all of P (n, 2, 2) is finite; the first matrix that is not positive definite, or -1."""
    bad = -1
    for k in range(P.shape[0] - 1, -1, -1):
        xx, xy, yx, yy = P[k, 0, 0], P[k, 0, 1], P[k, 1, 0], P[k, 1, 1]
        if not (np.isfinite(xx) and np.isfinite(xy) and np.isfinite(yx) and np.isfinite(yy)):
            return False, -1
        symmetric = np.abs(xy - yx) <= 1e-9 * (np.abs(xx) + np.abs(yy))
        if not (symmetric and xx > 0.0 and yy > 0.0 and xx * yy - xy * yx > 0.0):
            bad = k
    return True, bad


@kernel
def ellipses_of(P_px, sigma_px):
    """Ellipses of covariances (n, 2, 2) px^2; axes within LEAST and LONGEST_PX.

    A star whose error is larger than its shortened ellipse says may fall outside the gates and be lost. A
    false detection gains nothing: it falls into a smaller ellipse less often, by as much as it counts for
    more there, since the density stays normalised.
    """
    n = P_px.shape[0]
    spread, weight, log_areas = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
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
        log_areas[k] = 0.5 * np.log(det)
    return Ellipses(spread, weight, log_areas)


@inner
def apart(a, i, b, j):
    """By how much place i of a is right of and below place j of b, (n, 2) each."""
    return a[i, 0] - b[j, 0], a[i, 1] - b[j, 1]


@inner
def weigh(ellipses, k, x, y):
    """W (x, y), W the weight of centroid k."""
    if ellipses is None:
        return x, y
    W = ellipses.weight
    return W[k, 0] * x + W[k, 1] * y, W[k, 1] * x + W[k, 2] * y


@inner
def weighted2(ellipses, k, dx, dy):
    """Squared distance (dx, dy) from centroid k, px^2 of an ordinary star."""
    if ellipses is None:
        return dx**2 + dy**2
    W = ellipses.weight
    return W[k, 0] * dx * dx + 2.0 * W[k, 1] * dx * dy + W[k, 2] * dy * dy


@kernel
def log_area(ellipses, k):
    """ln of the area of the ellipse of centroid k over that of an ordinary star."""
    return 0.0 if ellipses is None else ellipses.log_area[k]


@inner
def factor(ellipses, k):
    """p, q, r of the weight's factor: W = R' R, R = [[p, q], [0, r]]."""
    if ellipses is None:
        return 1.0, 0.0, 1.0
    W = ellipses.weight
    p = np.sqrt(W[k, 0])
    q = W[k, 1] / p
    return p, q, np.sqrt(W[k, 2] - q * q)


@inner
def with_own(ellipses, k, variance, xx, xy, yy):
    """A covariance with the error of an ordinary star in it, with that of centroid k instead."""
    if ellipses is None:
        return xx, xy, yy
    S = ellipses.spread
    return xx + variance * (S[k, 0] - 1.0), xy + variance * S[k, 1], yy + variance * (S[k, 2] - 1.0)


@inner
def along(ellipses, i, j, dx, dy):
    """Mean of the variances of centroids i and j along the line (dx, dy), in sigma_px^2."""
    if ellipses is None:
        return 1.0
    S = ellipses.spread
    xx, xy, yy = t3.plus(t3.row(S, i), 1.0, t3.row(S, j))
    return 0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy) / (dx * dx + dy * dy)


@inner
def between2(ellipses, i, j, dx, dy):
    """Squared distance (dx, dy) between centroids i and j, weighted with the mean of their covariances."""
    if ellipses is None:
        return dx**2 + dy**2
    S = ellipses.spread
    xx, xy, yy = t3.scaled(0.5, t3.plus(t3.row(S, i), 1.0, t3.row(S, j)))
    return (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
