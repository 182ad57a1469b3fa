"""Clusters of the Improved Multi-Poles paper against slow references, and what its background must stand."""

from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from star_fields import DETECT

from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.papers.impa.methods import clusters
from shefex_nav.papers.impa.methods.clusters import find, fuse, runs


def settings_with(threshold, saturation, window=256):
    """Settings of the detection: electrons, DN, pixels."""
    run_length = replace(DETECT.run_length, threshold=threshold, window=window)
    return replace(DETECT, saturation=saturation, run_length=run_length)


CAMERA = CameraModel(electrons_per_dn=16.0)
PAPER, STREAKS = settings_with(500.0, 4095.0), settings_with(480.0, 255.0, 64)
NOISE_DN = 5.8  # of the paper's camera, 93 electrons


def noisy(rng, shape=(160, 160), level=413.0):
    return np.rint(rng.normal(level, NOISE_DN, shape)).astype(np.uint16)


def slow_bright_pixels(image, settings):
    """{(row, column): energy}: each pixel against the mean of the window of (cut) pixels before it."""
    rows, columns = image.shape
    size, tau_pre_dn = settings.run_length.window, settings.run_length.threshold / CAMERA.electrons_per_dn
    clip = max(1, round(clusters.CLIP * tau_pre_dn))
    window = deque([int(np.median(image[0]))] * size, maxlen=size)
    bright = {}
    for r in range(rows):
        for c in range(columns) if r % 2 == 0 else range(columns - 1, -1, -1):
            value, mean = int(image[r, c]), sum(window) / size
            if value > mean + tau_pre_dn:
                bright[r, c] = value - mean
            level = int(np.floor(mean + 0.5))
            window.append(min(max(value, level - clip), level + clip))
    return bright


def slow_clusters(bright, shape):
    """[(centroid x, y, energy, set of pixels)], brightest first."""
    energy = np.zeros(shape)
    for (r, c), value in bright.items():
        energy[r, c] = value
    label, n = ndimage.label(energy > 0, structure=np.ones((3, 3)))
    out = []
    for k in range(1, n + 1):
        r, c = np.nonzero(label == k)
        if len(r) > 1:
            w = energy[r, c]
            place = (w @ c) / w.sum(), (w @ r) / w.sum()
            out.append((*place, w.sum(), set(zip(r.tolist(), c.tolist(), strict=True))))
    return sorted(out, key=lambda cluster: -cluster[2])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("share, window", [(0.02, 16), (0.2, 64), (0.45, 32)])
def test_against_flood_fill(dtype, share, window):
    """From single pixels to a maze of runs; the frame is wider than high, so that no axes are swapped."""
    rng = np.random.default_rng(int(1000 * share))
    settings = settings_with(200.0, 200.0, window)
    for shape in ((40, 57), (1, 30), (25, 1), (2, 2)):
        image = rng.integers(30, 40, shape).astype(dtype)
        bright = rng.random(shape) < share
        image[bright] = rng.integers(60, 255, bright.sum())
        found, expected = (
            find(settings, CAMERA, image),
            slow_clusters(slow_bright_pixels(image, settings), shape),
        )
        assert len(found.energy_dn) == len(expected)
        for k, (x, y, energy, pixels) in enumerate(expected):
            mine = found.pixels[found.begin[k] : found.begin[k + 1]]
            np.testing.assert_allclose((*found.xy_px[k], found.energy_dn[k]), (x, y, energy), rtol=1e-12)
            assert set(map(tuple, mine.tolist())) == pixels
            r, c = np.array(sorted(pixels)).T
            box = found.first_row, found.last_row, found.first_column, found.last_column
            assert [edge[k] for edge in box] == [r.min(), r.max(), c.min(), c.max()]
            assert found.n_saturated[k] == (image[r, c] >= 200).sum()
        assert found.begin[-1] == len(found.pixels)
        np.testing.assert_allclose(found.mean_dn, image.mean())


def test_runs_of_a_list_of_pixels():
    pixels = np.array([[0, 3], [0, 4], [0, 6], [1, 6], [1, 7], [3, 0]])
    row, first, last, member = runs(pixels)
    np.testing.assert_array_equal(np.column_stack((row, first, last)),
                                  [[0, 3, 4], [0, 6, 6], [1, 6, 7], [3, 0, 0]])  # fmt: skip
    np.testing.assert_array_equal(member, [0, 0, 1, 2, 2, 3])


def test_touching_at_a_corner_is_one_object_and_a_single_pixel_is_none():
    image = np.full((20, 20), 100, dtype=np.uint16)
    image[5, 5] = image[6, 6] = image[7, 5] = 300  # a chain of corners
    image[12, 3] = 900  # alone
    found = find(PAPER, CAMERA, image)
    assert len(found.energy_dn) == 1 and found.begin[1] == 3
    np.testing.assert_allclose(found.xy_px[0], [16.0 / 3.0, 6.0], atol=0.02)


def test_noise_makes_no_objects_and_is_measured():
    rng = np.random.default_rng(1)
    frames = [noisy(rng, (512, 512)) for _ in range(12)]
    found = [find(PAPER, CAMERA, frame) for frame in frames]
    assert sum(len(f.energy_dn) for f in found) == 0  # two neighbours beyond 5.4 sigma
    noise = np.mean([f.noise_dn for f in found])
    assert abs(noise / np.hypot(NOISE_DN, np.sqrt(1.0 / 12.0)) - 1.0) < 0.01  # 400 000 differences: 0.2 %
    assert all(abs(f.background_dn - 413.0) < 0.3 for f in found)


def test_a_bright_star_neither_hides_itself_nor_its_neighbours():
    """7 x 7 saturated pixels would lift a plain average of 256 by 100 DN; faint stars on both sides."""
    image = noisy(np.random.default_rng(2))
    faint = [(80, 70), (80, 95), (81, 60), (82, 100), (85, 81)]
    for r, c in faint:
        image[r : r + 2, c : c + 2] += 60
    image[78:85, 79:86] = 4095
    found = find(PAPER, CAMERA, image)
    assert found.n_saturated[0] == 49
    boxes = list(zip(found.first_row.tolist(), found.first_column.tolist(), strict=True))
    for place in faint[:4]:
        assert place in boxes
    for k in range(1, len(found.energy_dn)):  # the faint ones keep their light
        if (found.first_row[k], found.first_column[k]) in faint[:4]:
            assert abs(found.energy_dn[k] - 240.0) < 4.0 * NOISE_DN * 2.0 + 4 * 6.0


def test_streak_along_the_rows_keeps_its_energy():
    """50 pixels along the way of the average lift it by 5 per cent of tau_pre, not by their own light."""
    image = np.full((60, 200), 400, dtype=np.uint16)
    image[30:33, 70:120] += 100
    found = find(PAPER, CAMERA, image)
    assert len(found.energy_dn) == 1 and found.begin[1] == 150
    assert 0.97 < found.energy_dn[0] / 15000.0 <= 1.0
    np.testing.assert_allclose(found.xy_px[0], [94.5, 31.0], atol=0.05)


@pytest.mark.parametrize("step_dn", [300, -300])
def test_follows_a_step_of_stray_light(step_dn):
    """Ten tau_pre in one row: behind a few rows all is as before, and no later row is touched."""
    image = noisy(np.random.default_rng(3), (120, 256), 600.0)
    image[40:] = (image[40:].astype(int) + step_dn).astype(np.uint16)
    image[100:103, 50:53] += 80
    found = find(PAPER, CAMERA, image)
    late = found.last_row > 60
    assert late.sum() == 1 and abs(found.xy_px[late, 0][0] - 51.0) < 0.3
    assert (found.last_row[~late] < 60).all()


def test_slow_gradient_makes_no_objects():
    """A quarter of tau_pre over the window, along the rows and across them."""
    columns, rows = np.meshgrid(np.arange(512), np.arange(256))
    light = np.random.default_rng(4).normal(300.0 + 0.03 * columns + 0.1 * rows, NOISE_DN)
    assert len(find(PAPER, CAMERA, np.rint(light).astype(np.uint16)).energy_dn) == 0


def test_what_is_no_frame_is_refused():
    image = np.zeros((8, 8), dtype=np.uint8)
    for bad in (image.astype(float), image[0], image.astype(np.int32)):
        with pytest.raises(ValueError, match="uint8 or uint16"):
            find(PAPER, CAMERA, bad)
    for window in (0, 100, -4):
        with pytest.raises(ValueError, match="power of two"):
            find(settings_with(500.0, 4095.0, window), CAMERA, image)
    with pytest.raises(ValueError, match="tau_pre"):
        find(settings_with(0.0, 4095.0), CAMERA, image)


# ------------------------------------------------------------------------------------------- fusion


def slow_fuse(first, second, distance_px):
    """All distances of all pixels."""

    def members(found):
        return [found.pixels[a:b] for a, b in zip(found.begin[:-1], found.begin[1:], strict=True)]

    table = np.array(
        [
            [np.linalg.norm(p[:, None] - q[None], axis=2).min() for q in members(second)]
            for p in members(first)
        ]
    )
    claims = {}
    for i in range(len(table)):
        j = table[i].argmin()
        if table[i, j] < distance_px and table[i, j] < claims.get(j, (np.inf, -1))[0]:
            claims[j] = table[i, j], i
    return np.array([(claims[j][1], j) for j in sorted(claims)]).reshape(-1, 2)


@pytest.mark.parametrize("distance_px", [1.0, 2.0, 5.0])
def test_fusion_against_all_pixel_distances(distance_px):
    rng = np.random.default_rng(5)
    frames = []
    for _ in range(2):
        image = np.full((90, 110), 40, dtype=np.uint8)
        for _ in range(25):
            r, c, h, w = rng.integers([2, 2, 1, 2], [80, 95, 6, 9])
            image[r : r + h, c : c + w] = rng.integers(100, 250)
        frames.append(find(STREAKS, CAMERA, image))
    found = fuse(*frames, distance_px)
    np.testing.assert_array_equal(found, slow_fuse(*frames, distance_px))
    assert len(found) > 1
    assert len(set(found[:, 0])) == len(set(found[:, 1])) == len(found)


def streak(first_column, length, row=20, shape=(50, 120)):
    image = np.full(shape, 100, dtype=np.uint8)
    image[row : row + 3, first_column : first_column + length] = 200
    return find(STREAKS, CAMERA, image)


def test_fusion_joins_streaks_that_follow_each_other_at_any_length():
    """Centroids 40 pixels apart, pixels one apart; and d_f is a strict limit."""
    first, second = streak(10, 40), streak(50, 40)
    np.testing.assert_array_equal(fuse(first, second, 2.0), [[0, 0]])
    assert len(fuse(streak(10, 40), streak(51, 40), 2.0)) == 0
    assert len(fuse(streak(10, 40), streak(51, 40), 2.01)) == 1


def test_fusion_with_nothing():
    nothing, one = find(PAPER, CAMERA, np.zeros((9, 9), dtype=np.uint8)), streak(10, 5)
    for pair in ((nothing, one), (one, nothing), (nothing, nothing)):
        assert fuse(*pair, 2.0).shape == (0, 2)
