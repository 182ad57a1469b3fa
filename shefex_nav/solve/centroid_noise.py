"""How large errors of centroids are, by their residuals: a multiple of what is said, and a floor. Compiled.

In: residuals of stars and the covariances that their centroids are said to have. Out: the multiple of these
and the variance that all have besides, of largest likelihood (`lens` says what makes them).
"""

import numpy as np

from shefex_nav.compiled import inner, kernel

MULTIPLES = tuple(2.0 ** (0.5 * n) for n in range(-4, 13))  # of the covariances of the centroids
LEAST_FLOOR_PX = 0.01  # error of any centroid beside the one that it is said to have
MOST_FLOOR_PX = 8.0
ROOT_STEPS, ROOT = 40, 1e-10  # of the search for the floor: bound, and relative change that ends it


@inner
def axes_of(P_px):
    """Eigenvalues (n, 2) and the cosines and sines (n, 2) of the first axis, of covariances (n, 2, 2)."""
    values, turn = np.empty((len(P_px), 2)), np.empty((len(P_px), 2))
    for n in range(len(P_px)):
        a, b, c = P_px[n, 0, 0], P_px[n, 0, 1], P_px[n, 1, 1]
        half, angle = np.hypot(0.5 * (a - c), b), 0.5 * np.arctan2(2.0 * b, a - c)
        values[n, 0], values[n, 1] = 0.5 * (a + c) + half, 0.5 * (a + c) - half
        turn[n, 0], turn[n, 1] = np.cos(angle), np.sin(angle)
    return values, turn


@inner
def floor_of(along2, values, multiple, dof):
    """Variance [px^2] that, added to multiples of `values`, makes chi squared its degrees of freedom.

    along2 : (n, 2) squared residuals along the axes of the covariances. Newton's method for 1 / chi^2, which
    grows ever more slowly with the variance: no step is too long.
    """
    floor2, highest = LEAST_FLOOR_PX**2, MOST_FLOOR_PX**2
    for _ in range(ROOT_STEPS):
        chi2, slope = 0.0, 0.0
        for n in range(along2.shape[0]):
            for a in range(2):
                whole = multiple * values[n, a] + floor2
                chi2 += along2[n, a] / whole
                slope += along2[n, a] / (whole * whole)
        if chi2 <= dof:
            break
        step = chi2 * (chi2 / dof - 1.0) / slope
        floor2 += step
        if floor2 >= highest:
            return highest
        if step < ROOT * floor2:
            break
    return floor2


@inner
def noise_of(along2, values, n_lens):
    """Multiple of the covariances and variance of the floor [px^2] of largest likelihood.

    Each multiple has the floor that makes chi squared what its degrees of freedom say. n_lens : of those
    that the unknowns take
    """
    m = along2.shape[0]
    dof = max(2.0 * m - n_lens, 1.0)
    least, best, best_floor = np.inf, 1.0, 0.0
    for multiple in MULTIPLES:
        floor2 = floor_of(along2, values, multiple, dof)
        log_sum, chi2 = 0.0, 0.0
        for n in range(m):
            for a in range(2):
                whole = multiple * values[n, a] + floor2
                log_sum += np.log(whole)
                chi2 += along2[n, a] / whole
        # minus twice the logarithm of the restricted likelihood, the unknowns' share left out
        cost = (1.0 - n_lens / (2.0 * m)) * log_sum + chi2
        if cost < least:
            least, best, best_floor = cost, multiple, floor2
    return best, best_floor


@kernel
def noise_seen(residual_px, P_px, n_lens):
    """`noise_of` by residuals (n, 2) [px] and covariances (n, 2, 2) [px^2]."""
    values, turn = axes_of(P_px)
    along2 = np.empty((len(P_px), 2))
    for n in range(len(P_px)):
        rx, ry = residual_px[n, 0], residual_px[n, 1]
        along2[n, 0] = (turn[n, 0] * rx + turn[n, 1] * ry) ** 2
        along2[n, 1] = (turn[n, 0] * ry - turn[n, 1] * rx) ** 2
    return noise_of(along2, values, n_lens)
