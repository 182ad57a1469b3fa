"""What share of Gaussian errors lies within a limit, and within which limit a share of them lies.

Of a vector the length counts, of an attitude the largest angle about an axis, as in `report.requirements`.
"""

from math import erf, pi, sqrt

import numpy as np

NODES = np.polynomial.legendre.leggauss(40)  # of each of two integrals, and their weights
FARTHEST = 9.0  # sigmas; beyond it there is nothing


def length(variances, limit):
    """Probability that a Gaussian vector is not longer than a limit. (3,) principal variances, float

    The direction of the smallest variance is integrated in closed form; of the other two each by Gauss's rule
    over the angle whose sine is their share of what is left of the limit, which has no edge at its end.
    """
    third, second, first = np.sqrt(np.sort(np.maximum(variances, 0.0)))
    if limit <= 0.0:
        return 0.0
    if first == 0.0:
        return 1.0
    x, weight_x = _nodes(first, np.array(limit))
    left = np.sqrt(np.maximum(limit**2 - x**2, 0.0))
    y, weight_y = _nodes(second, left)
    rest = np.sqrt(np.maximum(left[:, None] ** 2 - y**2, 0.0))
    from scipy.special import erf as errors

    inside = errors(rest / (sqrt(2.0) * third)) if third > 0.0 else np.ones_like(rest)
    return float(min(1.0, weight_x @ (weight_y * inside).sum(axis=1)))


def _nodes(sigma, limit):
    """Places within +-limit and their weights of a normal distribution: (..., n) twice. limit : (...)"""
    at, weight = NODES
    limit = np.asarray(limit)[..., None]
    if sigma == 0.0:
        return np.zeros(limit.shape), np.ones(limit.shape)
    share = np.minimum(1.0, FARTHEST * sigma / np.maximum(limit, 1e-300))
    widest = np.arcsin(share)
    place = limit * np.sin(widest * at)
    density = np.exp(-0.5 * (place / sigma) ** 2) / (sqrt(2.0 * pi) * sigma)
    return place, density * limit * np.cos(widest * at) * widest * weight


def axes(variances, limit):
    """Probability that no component is larger than a limit, at least: as if independent (Sidak 1967).

    (3,) variances about the axes, float -> float
    """
    found = 1.0
    for variance in variances:
        found *= erf(limit / sqrt(2.0 * variance)) if variance > 0.0 else 1.0
    return found


def least_limit(probability, share, variances):
    """The limit within which a share of errors lies.

    probability : `length` or `axes`;  share : below 1;  variances : (3,)
    """
    from scipy.optimize import brentq

    high = sqrt(max(float(np.sum(variances)), 0.0))
    if high == 0.0:
        return 0.0
    while probability(variances, high) < share:
        high *= 2.0
    return float(
        brentq(lambda limit: probability(variances, limit) - share, 0.0, high, rtol=1e-9, xtol=1e-12 * high)
    )
