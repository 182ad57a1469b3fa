"""The background of a picture: quantiles of tiles."""

import numpy as np
import pytest

from shefex_nav.solve import background


@pytest.mark.parametrize("spread", [3.0, 200.0, 1e4])
@pytest.mark.parametrize("whole", [True, False], ids=["whole", "fractions"])
def test_quantiles_are_those_of_sorted_values(spread, whole):
    """Counted, and selected where the values are too many or no whole numbers."""
    grey = np.random.default_rng(1).normal(0.0, spread, (70, 111))
    grey = (np.rint(grey) if whole else grey).astype(np.float32)
    rows, columns = np.array([0, 24, 47, 70]), np.array([0, 25, 60, 111])
    middle, low = background.tile_quantiles(grey, rows, columns)
    for i in range(3):
        for j in range(3):
            tile = np.sort(grey[rows[i] : rows[i + 1] : 2, columns[j] : columns[j + 1] : 2].ravel())
            assert middle[i, j] == tile[len(tile) // 2]
            assert low[i, j] == tile[int(0.158655 * len(tile))]
