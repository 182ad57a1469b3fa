"""Normalised squared errors."""

import numpy as np


def nees(errors, P):
    """Normalised squared errors: (..., m), (..., m, m) -> (...)."""
    sigma = np.sqrt(np.einsum("...ii->...i", P))
    scaled = P / (sigma[..., :, None] * sigma[..., None, :])  # correlations: no trouble with units
    normal = errors / sigma
    return np.einsum("...i,...i->...", normal, np.linalg.solve(scaled, normal[..., None])[..., 0])
