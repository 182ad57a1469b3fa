"""Pairwise sums in compiled code: NumPy's to the last digit, and near the exact ones."""

import math

import numpy as np
import pytest

from shefex_nav.geometry.sums import BLOCK, pairwise


@pytest.mark.parametrize("n", [0, 1, 7, 8, 9, 57, 60, 64, BLOCK, BLOCK + 1, 177, 180, 2 * BLOCK])
def test_a_pairwise_sum_is_that_of_numpy(n):
    rng = np.random.default_rng(n)
    for _ in range(50):
        a = rng.standard_normal(n) * 10.0 ** rng.uniform(-3.0, 3.0, n)
        assert pairwise(a) == a.sum()
        assert abs(pairwise(a) - math.fsum(a)) <= 40 * np.finfo(float).eps * np.abs(a).sum()
