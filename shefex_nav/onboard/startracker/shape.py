"""How a star looks in this frame: the width of its spot and the streak that the motion makes of it.

In: the frame and its objects. Out: `Shape`, one for all stars of the frame. Nothing is known beforehand: the
second moments of the brightest objects tell it, and their median is not disturbed by the odd double star or
particle hit.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.onboard.startracker.scan import BACKGROUND, FLUX, NOISE, PIXELS, SATURATED, XX, XY, YY, X, Y

MOST_STARS = 9  # brightest ones that are measured
LEAST_SIGNAL = 8.0  # of an object, in noise; what is fainter may be noise itself
ROUNDS = 2
BLOCK_VARIANCE = 2.0 / 3.0  # px^2 per axis, of the 3x3 pixels of a block
PIXEL_VARIANCE = 1.0 / 12.0  # px^2 per axis, of one pixel
LEAST_SIGMA = 0.3  # px; a narrower spot lies in one pixel and has no shape
STEP_SIGMAS = 1.6  # two spots this far apart, in sigmas, add up to a smooth ridge


class Shape(NamedTuple):
    """A Gaussian spot drawn along a straight line; plain numbers, passed on to compiled code."""

    sigma_px: float
    streak_x: float  # px, from one end of the streak to the other
    streak_y: float


@njit(cache=True)
def measure(image_dn, table, saturation_dn, default_sigma_px):
    """Shape of the stars in a frame. Frame, objects, DN, px -> Shape.

    default_sigma_px is the width where the frame shows no clear star that is not saturated.
    """
    n = 0
    chosen = np.empty(MOST_STARS, dtype=np.int64)
    for k in range(table.shape[0]):
        signal_to_noise = table[k, FLUX] / (table[k, NOISE] * np.sqrt(table[k, PIXELS]))
        if table[k, SATURATED] == 0 and signal_to_noise > LEAST_SIGNAL and n < MOST_STARS:
            chosen[n] = k
            n += 1
    if n == 0:
        return Shape(default_sigma_px, 0.0, 0.0)
    moments = np.empty((3, n))
    for k in range(n):
        star = chosen[k]
        moments[:, k] = _unweighted(table[star, XX], table[star, XY], table[star, YY])
    cov = _median(moments)
    for _ in range(ROUNDS):
        n_good = 0
        for k in range(n):
            is_good, xx, xy, yy = _weighted(image_dn, table[chosen[k]], cov, saturation_dn)
            if is_good:
                moments[0, n_good], moments[1, n_good], moments[2, n_good] = xx, xy, yy
                n_good += 1
        if n_good == 0:
            break
        cov = _median(moments[:, :n_good])
    return _from_covariance(cov)


@njit(cache=True)
def _eigen(xx, xy, yy):
    """Eigenvalues of a symmetric matrix, great and small, and the direction of the great one."""
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    radius = np.hypot(half, xy)
    return mean + radius, mean - radius, 0.5 * np.arctan2(xy, half)


@njit(cache=True)
def _unweighted(xx, xy, yy):
    """Moments of a Gaussian from those that the scan took, weighted with the spot smoothed over a block.

    Along an axis the product of spot, variance s, and weight, variance s + 2/3, has the variance
    m = s (s + 2/3) / (2 s + 2/3); solved for s.
    """
    great, small, angle = _eigen(xx, xy, yy)
    b = BLOCK_VARIANCE
    s_great = great - 0.5 * b + np.sqrt((great - 0.5 * b) ** 2 + b * great) if great > 0.0 else 0.0
    s_small = small - 0.5 * b + np.sqrt((small - 0.5 * b) ** 2 + b * small) if small > 0.0 else 0.0
    return _symmetric(s_great, s_small, angle)


@njit(cache=True)
def _symmetric(great, small, angle):
    """(xx, xy, yy) of a matrix with these eigenvalues."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([great * c * c + small * s * s, (great - small) * c * s, great * s * s + small * c * c])


@njit(cache=True)
def _median(moments):
    """Median of each moment over the stars, made positive definite: (3,)."""
    great, small, angle = _eigen(np.median(moments[0]), np.median(moments[1]), np.median(moments[2]))
    least = LEAST_SIGMA**2 + PIXEL_VARIANCE
    return _symmetric(max(great, least), max(small, least), angle)


@njit(cache=True)
def _weighted(image_dn, star, cov, saturation_dn):
    """Moments of one object under a Gaussian window of covariance W: whether they are good, xx, xy, yy.

    Spot S and window W together have the covariance m = (1/S + 1/W)^-1, and near S = W that is
    m = W/2 + (S - W)/4 (adaptive moments: Bernstein & Jarvis 2002, AJ 123, 583).
    """
    rows, columns = image_dn.shape
    det = cov[0] * cov[2] - cov[1] ** 2
    a, b, c = cov[2] / det, -cov[1] / det, cov[0] / det
    reach_x, reach_y = int(3.0 * np.sqrt(cov[0])) + 1, int(3.0 * np.sqrt(cov[2])) + 1
    middle_x, middle_y = int(np.rint(star[X])), int(np.rint(star[Y]))
    if middle_x < reach_x or middle_x + reach_x >= columns:
        return False, 0.0, 0.0, 0.0
    if middle_y < reach_y or middle_y + reach_y >= rows:
        return False, 0.0, 0.0, 0.0
    sums = np.zeros(6)
    for r in range(middle_y - reach_y, middle_y + reach_y + 1):
        for col in range(middle_x - reach_x, middle_x + reach_x + 1):
            dx, dy = col - star[X], r - star[Y]
            distance = a * dx * dx + 2.0 * b * dx * dy + c * dy * dy
            if distance > 9.0:
                continue
            if image_dn[r, col] >= saturation_dn:
                return False, 0.0, 0.0, 0.0
            light = np.exp(-0.5 * distance) * (image_dn[r, col] - star[BACKGROUND])
            sums[0] += light
            sums[1] += light * dx
            sums[2] += light * dy
            sums[3] += light * dx * dx
            sums[4] += light * dx * dy
            sums[5] += light * dy * dy
    if sums[0] <= 0.0:
        return False, 0.0, 0.0, 0.0
    x, y = sums[1] / sums[0], sums[2] / sums[0]
    xx = 4.0 * (sums[3] / sums[0] - x * x) - cov[0]
    xy = 4.0 * (sums[4] / sums[0] - x * y) - cov[1]
    yy = 4.0 * (sums[5] / sums[0] - y * y) - cov[2]
    return True, xx, xy, yy


@njit(cache=True)
def _from_covariance(cov):
    """Spot and streak of a covariance: a line of length L adds L^2/12 along itself."""
    great, small, angle = _eigen(cov[0], cov[1], cov[2])
    sigma = np.sqrt(max(small - PIXEL_VARIANCE, LEAST_SIGMA**2))
    length = np.sqrt(12.0 * max(great - small, 0.0))
    return Shape(sigma, length * np.cos(angle), length * np.sin(angle))
