"""The two scans, and the published centroids."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from star_fields import DETECT, MODEL, digitise, signal, spot
from test_fit import KNOWN, SETTINGS, SHAPE, errors

from shefex_nav.onboard.startracker import scan
from shefex_nav.onboard.startracker.background import (
    N_BLOCK,
    SIGMA_QUANTILE,
    block_sums,
    tile_statistics,
)
from shefex_nav.onboard.startracker.objects import detect, rules


def frame(seed, n_stars=25):
    rng = np.random.default_rng(seed)
    light = np.zeros(SHAPE)
    for x, y in rng.uniform([20, 20], [640, 470], (n_stars, 2)):
        spot(light, x, y, signal(rng.uniform(1.5, 5.5)))
    return digitise(rng, light)


def scanned(method, image, params):
    blocks = block_sums(image)
    background, sigma, _ = tile_statistics(blocks, params.tile)
    return method(image, blocks, background, sigma, rules(params))


@pytest.mark.parametrize("method", [scan.sequential, scan.maximum_search])
def test_objects_are_the_connected_regions_above_the_threshold(method):
    """Against scipy's labels, with one tile for the whole frame."""
    image = frame(20)
    params = replace(DETECT, tile=660, most_objects=200, largest_peak=1.0)
    blocks = block_sums(image).astype(np.int64)
    background, sigma, _ = tile_statistics(block_sums(image), 660)
    labels, n = ndimage.label(blocks > np.floor(background + 3.5 * sigma)[0, 0], np.ones((3, 3)))
    peaks = ndimage.maximum(blocks, labels, np.arange(1, n + 1))
    sizes = ndimage.sum_labels(np.ones_like(blocks), labels, np.arange(1, n + 1))
    rows, columns = np.array(ndimage.find_objects(labels), dtype=object).T
    inner = [
        r.start > 1 and c.start > 1 and r.stop < SHAPE[0] - 1 and c.stop < SHAPE[1] - 1
        for r, c in zip(rows, columns, strict=True)
    ]
    is_object = (peaks > np.floor(background + 5.5 * sigma)[0, 0]) & (sizes >= 5) & (sizes <= 400) & inner
    table = scanned(method, image, params)
    assert sorted(table[:, scan.PIXELS]) == sorted(sizes[is_object])
    light = image - background[0, 0] / 9.0
    fluxes = ndimage.sum_labels(light, labels, np.flatnonzero(is_object) + 1)
    np.testing.assert_allclose(table[:, scan.FLUX], np.sort(fluxes)[::-1], rtol=1e-12)


def test_maximum_search_stops_at_the_length_of_its_table():
    """... with the highest peaks, while the sequential scan keeps the brightest objects."""
    image = frame(21)
    few = replace(DETECT, most_objects=8)
    peaks = scanned(scan.maximum_search, image, few)
    everything = scanned(scan.sequential, image, replace(DETECT, most_objects=200))
    assert len(peaks) == 8
    np.testing.assert_allclose(
        scanned(scan.sequential, image, few)[:, scan.FLUX], everything[:8, scan.FLUX], rtol=1e-12
    )
    assert (peaks[:, scan.FLUX] >= 0.5 * everything[7, scan.FLUX]).all()


@pytest.mark.parametrize("name", ["scan", "centroid"])
def test_unknown_methods_are_refused(name):
    with pytest.raises(ValueError, match=f"{name}: 'guess' is not known; choose from: "):
        detect(replace(DETECT, **{name: "guess"}), MODEL, np.zeros(SHAPE, np.uint8))


@pytest.mark.parametrize(
    "method, limit_px",
    [("weighted", 0.04), ("centre_of_mass", 0.06), ("gaussian_interpolation", 0.09)],
)
def test_published_centroids(method, limit_px):
    """3000 electrons in spots of 1 px, bound 0.026 px: no bias, and a covariance that is not far off."""
    error, nees = errors(replace(SETTINGS, centroid=method), range(2), 3000.0)
    assert np.sqrt((error**2).mean()) < limit_px
    assert (np.abs(error.mean(axis=0)) < 4.0 * limit_px / np.sqrt(len(error))).all()
    assert 1.3 < nees.mean() < 3.5


def test_centre_of_mass_against_its_formula():
    image = frame(22)
    found, _ = detect(replace(DETECT, centroid="centre_of_mass"), MODEL, image)
    background = tile_statistics(block_sums(image), 72)[0] / 9.0
    x, y = found.xy_px[0]
    r_0, c_0 = int(y) - 4, int(x) - 4
    near = image[r_0 : r_0 + 10, c_0 : c_0 + 10]
    row, column = np.unravel_index(near.argmax(), near.shape)
    row, column = row + r_0, column + c_0
    light = image[row - 3 : row + 4, column - 3 : column + 4] - background[row // 72, column // 72]
    yy, xx = np.mgrid[row - 3 : row + 4, column - 3 : column + 4]
    expected = [(light * xx).sum() / light.sum(), (light * yy).sum() / light.sum()]
    np.testing.assert_allclose(found.xy_px[0], expected, atol=0.02)  # the tile's edge may lie in between


def test_interpolation_of_a_spot_without_noise():
    """The series to the second order is off by 0.03 px where two pixels are equal, and less elsewhere."""
    for offset in np.linspace(-0.5, 0.5, 11):
        light = np.zeros((61, 61))
        spot(light, 30.0 + offset, 30.0, 4e5, 1.0)
        image = np.rint(light / 4.0 + 100.0 + np.random.default_rng(1).normal(0, 1, (61, 61))).astype(
            np.uint16
        )
        settings = replace(SETTINGS, centroid="gaussian_interpolation", saturation=65535.0, tile=60)
        found, _ = detect(settings, KNOWN, image)
        np.testing.assert_allclose(found.xy_px[0], [30.0 + offset, 30.0], atol=0.035)


@pytest.mark.parametrize(
    "level, scatter, spoilt",
    [(60, 3.0, False), (500, 40.0, True), (20000, 1200.0, True), (60, 0.2, False), (0, 0.0, True)],
)
def test_background_of_deep_frames_is_the_quantile(level, scatter, spoilt):
    """Counted near the least value of a tile or selected beyond: the same quantiles, of any spread."""
    rng, tile = np.random.default_rng(3), 48
    image = np.clip(rng.normal(level, scatter, (300, 333)), 0, 65535).round().astype(np.uint16)
    if spoilt:
        image[::37, ::41], image[::29, ::31] = 0, 65535
    blocks = block_sums(image)
    background, sigma, _ = tile_statistics(blocks, tile)
    for i, j in np.ndindex(background.shape):
        rows = slice(i * tile + 1, min((i + 1) * tile, 299), 3)
        columns = slice(j * tile + 1, min((j + 1) * tile, 332), 3)
        values = np.sort(blocks[rows, columns].ravel())
        if not len(values):
            continue
        quantiles = []
        for share in (0.5, SIGMA_QUANTILE):
            k = values[int(np.ceil(share * len(values))) - 1]
            below, equal = (values < k).sum(), (values == k).sum()
            quantiles.append(k - 0.5 + (share * len(values) - below) / equal)
        assert background[i, j] == quantiles[0]
        assert sigma[i, j] == max(quantiles[0] - quantiles[1], np.sqrt(N_BLOCK / 12.0))
