"""The noise of the detector against its exact distribution."""

import numpy as np
import pytest
from camera_bench import CLEAN
from scipy import stats

from shefex_nav.world.camera import detector

N_PIXELS = 659 * 493


def reference_distribution(params, gain_db, mean):
    """P(grey <= k) as the plain double sum over electron counts and read noise."""
    well = int(params.full_well_electrons)
    n = np.arange(0, min(well, int(mean + 12 * np.sqrt(mean) + 60)) + 1)
    probability = stats.poisson.pmf(n, mean)
    probability[-1] += stats.poisson.sf(n[-1], mean)
    per_dn = detector.electrons_per_dn(params, gain_db)
    edges = (np.arange(255) + 0.5 - params.black_level_dn) * per_dn
    cdf = (
        probability[:, None] * stats.norm.cdf(edges[None] - n[:, None], scale=params.read_noise_electrons)
    ).sum(0)
    return np.append(cdf, 1.0)


@pytest.mark.parametrize(
    ("mean", "gain_db", "changes"),
    [
        (20.0, 24.0, {}),
        (0.0, 24.0, {}),
        (0.03, 36.0, {}),
        (700.0, 24.0, {}),
        (9000.0, 0.0, {}),
        (29800.0, 0.0, {}),  # part of the pixels reach the full well
        (300.0, 24.0, {"full_well_electrons": 310.0}),
        (1e6, 24.0, {}),
        (20.0, 24.0, {"black_level_dn": 0.0}),  # clipped below
        (20.0, 24.0, {"read_noise_electrons": 1.0}),
    ],
)
def test_distribution_against_the_double_sum(mean, gain_db, changes):
    params = CLEAN._replace(**changes)
    cdf = detector.grey_distribution(params, gain_db, mean)
    np.testing.assert_allclose(cdf, reference_distribution(params, gain_db, mean), atol=1e-12)


def test_gain_in_decibels():
    assert detector.electrons_per_dn(CLEAN, 0.0) == 118.0
    assert detector.electrons_per_dn(CLEAN, 24.0) == pytest.approx(7.4, abs=0.05)


def chi_square(counts, probabilities):
    """p-value of counts against probabilities, cells with few expected counts joined at both ends."""
    expected = counts.sum() * probabilities
    kept = expected >= 10.0
    first, last = np.flatnonzero(kept)[[0, -1]]
    assert kept[first : last + 1].all()
    join = lambda x: np.concatenate([[x[: first + 1].sum()], x[first + 1 : last], [x[last:].sum()]])  # noqa: E731
    observed, expected = join(counts.astype(float)), join(expected)
    return stats.chi2.sf(((observed - expected) ** 2 / expected).sum(), len(observed) - 1)


@pytest.mark.parametrize(("mean", "gain_db", "seed"), [(20.0, 24.0, 11), (150.0, 24.0, 12), (14.0, 12.0, 13)])
def test_background_follows_its_exact_distribution_into_the_tails(mean, gain_db, seed):
    """65 million pixels: cells rounded to 2^-16 would miss by hundreds of chi-square units."""
    rng = np.random.default_rng(seed)
    cdf = detector.grey_distribution(CLEAN, gain_db, mean)
    probabilities = np.diff(cdf, prepend=0.0)
    counts = np.zeros(256, dtype=np.int64)
    for _ in range(200):
        counts += np.bincount(detector.background(N_PIXELS, detector.cells(cdf), rng), minlength=256)
    assert chi_square(counts, probabilities) > 1e-3
    # beyond 4.2 sigma, where a table without second draws ends, and beyond 5 sigma
    for tail in (1.3e-5, 2.9e-7):
        high = np.flatnonzero(1.0 - cdf < tail)[0] + 1
        expected = counts.sum() * (1.0 - cdf[high - 1])
        assert stats.poisson.interval(0.9999, expected)[0] <= counts[high:].sum()
        assert counts[high:].sum() <= stats.poisson.interval(0.9999, expected)[1]


@pytest.mark.parametrize(("mean", "gain_db"), [(20.0, 24.0), (700.0, 24.0), (5e6, 24.0), (9000.0, 0.0)])
def test_cells_and_fractions_make_up_the_distribution_of_pairs(mean, gain_db):
    cdf = detector.grey_distribution(CLEAN, gain_db, mean)
    cells = detector.cells(cdf)
    probability = np.diff(cdf, prepend=0.0)
    is_marker = cells.table == cells.marker
    made = np.bincount(cells.table[~is_marker], minlength=65536) / 65536
    share = np.diff(cells.fractions, prepend=0.0) / max(cells.fractions[-1], 1e-300)
    np.add.at(made, cells.outcomes.astype(int), is_marker.mean() * share)
    np.testing.assert_allclose(made, np.outer(probability, probability).ravel(), atol=1e-15, rtol=1e-9)


def test_background_pixels_are_independent():
    """Correlation between neighbours along and across the rows, and between frames: 4.5 sigma."""
    rng = np.random.default_rng(3)
    cdf = detector.grey_distribution(CLEAN, 24.0, 20.0)
    images = np.array(
        [detector.background(N_PIXELS, detector.cells(cdf), rng) for _ in range(20)], dtype=float
    )
    images = (images - images.mean()) / images.std()
    for lag in (1, 2, 3, 4, 8, 659):
        correlation = (images[:, lag:] * images[:, :-lag]).mean()
        assert abs(correlation) < 4.5 / np.sqrt(images.size), lag
    assert abs((images[1:] * images[:-1]).mean()) < 4.5 / np.sqrt(images.size)


def test_single_pixels_follow_the_same_distribution():
    """The few pixels with starlight are drawn another way: same law."""
    rng = np.random.default_rng(4)
    for mean in (0.0, 20.0, 400.0, 1750.0):
        grey = detector.digitise(CLEAN, 24.0, np.full(400_000, mean), rng)
        probabilities = np.diff(detector.grey_distribution(CLEAN, 24.0, mean), prepend=0.0)
        assert chi_square(np.bincount(grey, minlength=256), probabilities) > 1e-3


def test_saturation():
    rng = np.random.default_rng(5)
    grey = detector.digitise(CLEAN, 24.0, np.array([5e3, 1e5, 1e12]), rng)
    assert list(grey) == [255, 255, 255]
    # at 0 dB the full well ends at 30000/118 + 16 = 270 > 255; a small well shows as a plateau below
    small = CLEAN._replace(full_well_electrons=1000.0)
    grey = detector.digitise(small, 24.0, np.full(10_000, 1e6), rng)
    assert grey.mean() == pytest.approx(1000.0 / 7.446 + 16.0, abs=0.1)
    cdf = detector.grey_distribution(CLEAN, 24.0, 5e6)
    assert np.all(detector.background(1001, detector.cells(cdf), rng) == 255)


def test_same_seed_same_noise():
    cdf = detector.grey_distribution(CLEAN, 24.0, 20.0)
    first = detector.background(N_PIXELS, detector.cells(cdf), np.random.default_rng(7))
    again = detector.background(N_PIXELS, detector.cells(cdf), np.random.default_rng(7))
    other = detector.background(N_PIXELS, detector.cells(cdf), np.random.default_rng(8))
    np.testing.assert_array_equal(first, again)
    assert first.shape == (N_PIXELS,)
    assert np.mean(first == other) < 0.2
