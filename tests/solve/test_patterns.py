"""Tables of triangles and lists of stars against their obvious definitions."""

from itertools import combinations

import numpy as np
import pytest

from shefex_nav.environment.stars import photocentres, select
from shefex_nav.onboard.startracker import tables
from shefex_nav.solve import patterns


@pytest.fixture(scope="module")
def stars():
    catalogue = patterns.catalogue(2020.0)
    return select(catalogue, catalogue.vmag <= 4.5)


def test_lists_of_stars_are_those_of_the_star_tracker(stars):
    reference = tables.by_direction(stars.u_i, np.sort(stars.vmag), 0.2)
    start, row = patterns.sky_lists(stars.u_i, 0.2)
    np.testing.assert_array_equal(start, reference.start)
    np.testing.assert_array_equal(row, reference.row)


def test_merged_stars_are_photocentres(stars):
    radius = np.radians(0.3)
    merged, reference = patterns.merged(stars, 4.0, radius), photocentres(stars, 4.0, radius)
    assert set(merged.hip) == set(reference.hip)
    a, b = np.argsort(merged.hip), np.argsort(reference.hip)
    np.testing.assert_allclose(merged.u_i[a], reference.u_i[b], atol=1e-15)
    np.testing.assert_allclose(merged.vmag[a], reference.vmag[b], atol=1e-12)
    assert (np.diff(merged.vmag) >= 0.0).all()


def test_chosen_stars_have_few_brighter_neighbours(stars):
    order = np.argsort(stars.vmag, kind="stable")
    u_i = np.ascontiguousarray(stars.u_i[order])
    chosen = patterns.choose(u_i, np.argsort(u_i[:, 2], kind="stable"), 0.15, 4)
    near = u_i @ u_i.T > np.cos(0.15)
    brighter = np.array([near[k, :k].sum() for k in range(len(u_i))])
    np.testing.assert_array_equal(chosen, brighter < 4)


def test_triangles_of_a_band():
    """Each has its sides in order, opposite their corners, in its cell; and none is missing."""
    band = patterns.band(6, 2020.0)
    u = band.u_i[band.corner]
    sides = np.stack(
        [np.linalg.norm(u[:, (k + 1) % 3] - u[:, (k + 2) % 3], axis=1) for k in range(3)], axis=1
    )
    np.testing.assert_allclose(sides[:, 0], band.shape[:, 0])
    np.testing.assert_allclose(sides[:, 1:] / sides[:, :1], band.shape[:, 1:])
    assert (np.diff(sides, axis=1) <= 1e-12).all()
    left = np.linalg.det(u) < 0.0
    cell = [
        patterns.cell_of_shape(*shape, bool(hand))
        for shape, hand in zip(band.shape[:, 1:], left, strict=True)
    ]
    assert (np.diff(cell) >= 0).all() and band.cell[-1] == len(cell)
    np.testing.assert_array_equal(np.searchsorted(cell, np.arange(len(band.cell))), band.cell)
    used = np.unique(band.corner)
    near = used[band.u_i[used] @ band.u_i[used[0]] > np.cos(0.35)]
    expected = 0
    for three in combinations(near, 3):
        lengths = sorted(np.linalg.norm(band.u_i[a] - band.u_i[b]) for a, b in combinations(three, 2))
        fits = patterns.SHORTEST * band.low <= lengths[2] <= patterns.LONGEST * band.high
        expected += fits and lengths[0] >= patterns.SLIVER * lengths[2]
    assert expected == np.isin(band.corner, near).all(axis=1).sum() > 50


@pytest.mark.parametrize("fov_deg", [5.0, 11.4, 25.0, 35.0])
def test_bands_cover_the_field(fov_deg):
    size = np.radians(fov_deg)
    numbers = patterns.bands(size / 1.2, size * 1.2)
    low = [patterns.SMALLEST * patterns.RATIO**n for n in numbers]
    assert min(low) <= size / 1.2 and max(low) * patterns.RATIO >= size * 1.2
