"""The background of a picture: quantiles of tiles."""

import numpy as np
import pytest
from scipy.ndimage import median_filter

from shefex_nav.solve import background, field


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


FULL = 5000.0
VALUES = (  # above the background, grey values in 8 bits and in 16 with a gain of one
    (-30.0, 0, 0),
    (-20.25, 0, 0),
    (-19.75, 0, 8),
    (-19.5, 1, 16),
    (0.0, 20, 640),
    (0.25, 20, 648),
    (0.484375, 20, 656),  # 655.5 and up
    (0.46875, 20, 655),
    (0.5, 21, 656),
    (234.25, 254, 8136),
    (234.5, 255, 8144),
    (2000.0, 255, 64640),
    (2028.0, 255, 65534),  # 65536 would be none of 16 bits
    (FULL - 1.0, 255, 65534),
)


@pytest.mark.parametrize("level", [0.0, 100.0])
def test_frames_are_rounded_and_end_at_black_and_white(level):
    """8 bits, and steps of a 32nd in 16, the last of which is for saturated pixels."""
    above, coarse, fine = (np.array(column) for column in zip(*VALUES, strict=True))
    grey = (level + np.tile(above, (4, 5))).astype(np.float32)
    below = background.Below(np.full((1, 1), level), np.zeros(1), np.zeros(1))
    flat, frame, finer = field.frames_of(grey, below, FULL + level, 1.0)
    np.testing.assert_array_equal(flat, np.tile(above, (4, 5)))
    np.testing.assert_array_equal(frame, np.tile(coarse, (4, 5)))
    np.testing.assert_array_equal(finer, np.tile(fine, (4, 5)))
    assert frame.dtype == np.uint8 and finer.dtype == np.uint16
    doubled = field.frames_of(level + 0.5 * (grey - level), below, FULL + level, 2.0)
    np.testing.assert_array_equal(doubled[1], frame)
    np.testing.assert_array_equal(doubled[2], finer)


def test_a_pixel_is_saturated_by_what_was_seen_whatever_the_background():
    grey = np.full((3, 4), 90.0, dtype=np.float32)
    grey[1, 2] = 100.0
    bright = background.Below(np.full((1, 1), 130.0), np.zeros(1), np.zeros(1))
    for full, wanted in ((100.0, 65535), (100.5, 0)):
        _, frame, fine = field.frames_of(grey, bright, full, 1.0)
        assert fine[1, 2] == wanted and frame[1, 2] == 0 and np.delete(fine.ravel(), 6).max() == 0
