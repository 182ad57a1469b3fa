"""Records of one instant, found in two sorted arrays of times."""

import numpy as np

SAME_TIME_S = 1e-6  # two records of one tick


def same_times(t_a, t_b):
    """Indices into two sorted arrays of the times they have in common."""
    if not len(t_a) or not len(t_b):
        return np.zeros(0, int), np.zeros(0, int)
    k = np.searchsorted(t_b, t_a - SAME_TIME_S).clip(0, len(t_b) - 1)
    both = np.abs(t_b[k] - t_a) <= SAME_TIME_S
    return np.flatnonzero(both), k[both]
