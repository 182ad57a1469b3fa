"""Normalised squared errors, and where they lie if what is said of the errors is right."""

import numpy as np


def nees(errors, P):
    """Normalised squared errors: (..., m), (..., m, m) -> (...)."""
    sigma = np.sqrt(np.einsum("...ii->...i", P))
    with np.errstate(divide="ignore", invalid="ignore"):  # of a sigma of zero: NaN, nothing is known
        scaled = P / (sigma[..., :, None] * sigma[..., None, :])  # correlations: no trouble with units
        normal = np.where(sigma > 0.0, errors / sigma, np.nan)
    return np.einsum("...i,...i->...", normal, np.linalg.solve(scaled, normal[..., None])[..., 0])


def chi2_bounds(dof, probability):
    """Interval that holds a chi-square variable with a probability. Degrees of freedom -> low, high, alike"""
    from scipy.special import gammaincinv  # scipy.stats would take a second to import

    tail = 0.5 * (1.0 - probability)
    return tuple(2.0 * gammaincinv(0.5 * dof, share) for share in (tail, 1.0 - tail))
