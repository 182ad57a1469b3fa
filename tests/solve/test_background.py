"""The background of a picture: quantiles of tiles."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from shefex_nav.solve import background


@pytest.mark.parametrize("spread", [3.0, 200.0, 1e4])
@pytest.mark.parametrize("whole", [True, False], ids=["whole", "fractions"])
def test_quantiles_are_those_of_sorted_values(spread, whole):
    """Of either sign, whole or not; tiles of unlike sizes."""
    grey = np.random.default_rng(1).normal(0.0, spread, (70, 111))
    grey = (np.rint(grey) if whole else grey).astype(np.float32)
    rows, columns = np.array([0, 24, 47, 70]), np.array([0, 25, 60, 111])
    middle, low = background.tile_quantiles(grey, rows, columns)
    for i in range(3):
        for j in range(3):
            tile = np.sort(grey[rows[i] : rows[i + 1] : 2, columns[j] : columns[j + 1] : 2].ravel())
            assert middle[i, j] == tile[len(tile) // 2]
            assert low[i, j] == tile[int(0.158655 * len(tile))]


@pytest.mark.parametrize("shape", [(1, 1), (2, 5), (30, 41)])
def test_smoothed_tiles_are_medians_of_nine(shape):
    tiles = np.random.default_rng(2).normal(size=shape)
    np.testing.assert_array_equal(background.smoothed(tiles), median_filter(tiles, 3, mode="nearest"))


def test_a_background_between_tiles_is_linear():
    """Known at two rows and three columns: a plane comes back, constant outside; by NumPy's interpolation."""
    at_r, at_c = np.array([5.0, 15.0]), np.array([3.5, 10.0, 20.0])
    tiles = np.array([[100.0, 120.0, 90.0], [80.0, 300.0, 95.0]])
    flat = background.subtract(np.zeros((20, 24), dtype=np.float32), background.Below(tiles, at_r, at_c))
    rows = np.array([np.interp(np.arange(24), at_c, line) for line in tiles])
    wanted = np.array([np.interp(np.arange(20), at_r, column) for column in rows.T]).T
    np.testing.assert_allclose(-flat, wanted, rtol=1e-6)
