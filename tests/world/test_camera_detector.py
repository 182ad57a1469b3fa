"""The noise of the detector against its exact distribution."""

from dataclasses import replace

import camera_bench
import numpy as np
import pytest
from scipy import stats

from shefex_nav.world.camera import detector

N_PIXELS = 659 * 493


CLEAN = camera_bench.CLEAN.detector
AT_24, AT_0 = detector.electronics(CLEAN, 24.0), detector.electronics(CLEAN, 0.0)


def reference_distribution(electronics, mean):
    """P(grey <= k) as the plain double sum over electron counts and read noise."""
    well = int(electronics.full_well)
    n = np.arange(0, min(well, int(mean + 12 * np.sqrt(mean) + 60)) + 1)
    probability = stats.poisson.pmf(n, mean)
    probability[-1] += stats.poisson.sf(n[-1], mean)
    edges = (np.arange(255) + 0.5 - electronics.black_level) * electronics.electrons_per_dn
    cdf = (probability[:, None] * stats.norm.cdf(edges[None] - n[:, None], scale=electronics.read_noise)).sum(
        0
    )
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
        (300.0, 24.0, {"full_well": 310.0}),
        (1e6, 24.0, {}),
        (20.0, 24.0, {"black_level": 0.0}),  # clipped below
        (20.0, 24.0, {"read_noise": 1.0}),
    ],
)
def test_distribution_against_the_double_sum(mean, gain_db, changes):
    electronics = detector.electronics(replace(CLEAN, **changes), gain_db)
    cdf = detector.grey_distribution(electronics, mean)
    np.testing.assert_allclose(cdf, reference_distribution(electronics, mean), atol=1e-12)


def test_gain_in_decibels():
    assert AT_0.electrons_per_dn == 118.0
    assert AT_24.electrons_per_dn == pytest.approx(7.4, abs=0.05)


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
    cdf = detector.grey_distribution(detector.electronics(CLEAN, gain_db), mean)
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
    cdf = detector.grey_distribution(detector.electronics(CLEAN, gain_db), mean)
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
    cdf = detector.grey_distribution(AT_24, 20.0)
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
        grey = detector.digitise(AT_24, np.full(400_000, mean), rng)
        probabilities = np.diff(detector.grey_distribution(AT_24, mean), prepend=0.0)
        assert chi_square(np.bincount(grey, minlength=256), probabilities) > 1e-3


def test_saturation():
    rng = np.random.default_rng(5)
    grey = detector.digitise(AT_24, np.array([5e3, 1e5, 1e12]), rng)
    assert list(grey) == [255, 255, 255]
    # at 0 dB the full well ends at 30000/118 + 16 = 270 > 255; a small well shows as a plateau below
    small = AT_24._replace(full_well=1000.0)
    grey = detector.digitise(small, np.full(10_000, 1e6), rng)
    assert grey.mean() == pytest.approx(1000.0 / 7.446 + 16.0, abs=0.1)
    cdf = detector.grey_distribution(AT_24, 5e6)
    assert np.all(detector.background(1001, detector.cells(cdf), rng) == 255)


def test_same_seed_same_noise():
    cdf = detector.grey_distribution(AT_24, 20.0)
    first = detector.background(N_PIXELS, detector.cells(cdf), np.random.default_rng(7))
    again = detector.background(N_PIXELS, detector.cells(cdf), np.random.default_rng(7))
    other = detector.background(N_PIXELS, detector.cells(cdf), np.random.default_rng(8))
    np.testing.assert_array_equal(first, again)
    assert first.shape == (N_PIXELS,)
    assert np.mean(first == other) < 0.2


# --- more than 8 bits ---

TWELVE = detector.Electronics(50.0, 65e3, 16.0, 32.0, 12)
SIXTEEN = TWELVE._replace(bits=16, electrons_per_dn=1.0)


def exact(electronics, mean):
    """P(grey = k) by the double sum, for the few grey values that occur."""
    n = np.arange(max(0, int(mean - 9 * np.sqrt(mean) - 30)), int(mean + 9 * np.sqrt(mean) + 30))
    probability = stats.poisson.pmf(n, mean)
    probability /= probability.sum()  # scipy's are 4e-12 off
    edges = (
        np.arange(2**electronics.bits - 1) + 0.5 - electronics.black_level
    ) * electronics.electrons_per_dn
    used = np.flatnonzero(np.abs(edges - mean) < 12 * np.sqrt(mean + electronics.read_noise**2))
    cdf = np.where(edges < mean, 0.0, 1.0)
    deviation = (edges[used] - n[:, None]) / electronics.read_noise
    cdf[used] = probability @ stats.norm.cdf(deviation)
    return np.diff(np.append(cdf, 1.0), prepend=0.0)


@pytest.mark.parametrize(("electronics", "mean"), [(TWELVE, 6100.0), (TWELVE, 40.0), (SIXTEEN, 6100.0)])
def test_distribution_of_more_grey_values(electronics, mean):
    found = np.diff(detector.grey_distribution(electronics, mean), prepend=0.0)
    np.testing.assert_allclose(found, exact(electronics, mean), atol=1e-12)


@pytest.mark.parametrize(("electronics", "together"), [(TWELVE, 2), (SIXTEEN, 1)])
def test_background_of_more_grey_values_is_exact_into_the_tails(electronics, together):
    """84 million pixels of IMPA's background, in pairs or one by one, and both tails beyond 5 sigma."""
    rng, levels = np.random.default_rng(21), 2**electronics.bits
    cdf = detector.grey_distribution(electronics, 6100.0)
    cells = detector.cells(cdf)
    assert cells.together == together
    counts = np.zeros(levels, dtype=np.int64)
    for _ in range(80):
        grey = detector.background(2**20, cells, rng)
        assert grey.dtype == np.uint16
        counts += np.bincount(grey, minlength=levels)
    assert chi_square(counts, np.diff(cdf, prepend=0.0)) > 1e-3
    for tail in (1.3e-5, 2.9e-7):
        high = np.flatnonzero(1.0 - cdf < tail)[0]
        low = np.flatnonzero(cdf < tail)[-1]
        for observed, probability in (
            (counts[high + 1 :].sum(), 1.0 - cdf[high]),
            (counts[: low + 1].sum(), cdf[low]),
        ):
            few, many = stats.poisson.interval(0.9999, counts.sum() * probability)
            assert few <= observed <= many


def test_cells_of_single_grey_values_make_up_the_distribution():
    cdf = detector.grey_distribution(SIXTEEN, 6100.0)
    cells = detector.cells(cdf)
    is_marker = cells.table == cells.marker
    made = np.bincount(cells.table[~is_marker], minlength=65536) / 65536
    share = np.diff(cells.fractions, prepend=0.0) / cells.fractions[-1]
    np.add.at(made, cells.outcomes.astype(int), is_marker.mean() * share)
    np.testing.assert_allclose(made, np.diff(cdf, prepend=0.0), atol=1e-15, rtol=1e-9)


def test_many_electrons_are_drawn_with_the_moments_and_the_tail_of_poisson():
    """Just above the limit, next to no read noise: 20 million draws against Poisson(1000)."""
    electronics = SIXTEEN._replace(read_noise=1e-3, black_level=0.0)
    mean, n, rng = detector.MANY_ELECTRONS, 20_000_000, np.random.default_rng(5)
    grey = np.concatenate(
        [detector.digitise(electronics, np.full(n // 10, mean), rng).astype(float) for _ in range(10)]
    )
    assert grey.mean() == pytest.approx(mean, abs=4.0 * np.sqrt(mean / n))
    assert grey.var() == pytest.approx(mean, rel=4.0 * np.sqrt(2.0 / n) + 1.5e-3)  # rounding: 1/12; skewness
    skewness = ((grey - mean) ** 3).mean() / mean**1.5
    assert skewness == pytest.approx(1.0 / np.sqrt(mean), abs=4.0 * np.sqrt(6.0 / n) + 1e-3)
    for tail in (1e-3, 1e-5):  # a normal number would miss the upper one at 1e-5 by 45 %
        high, low = stats.poisson.isf(tail, mean), stats.poisson.ppf(tail, mean) - 1.0
        tolerance = 0.01 + 4.0 / np.sqrt(n * tail)  # of the expansion, of the draws
        above, below = stats.poisson.sf(high, mean), stats.poisson.cdf(low, mean)
        assert (grey > high).mean() == pytest.approx(above, rel=tolerance)
        assert (grey <= low).mean() == pytest.approx(below, rel=tolerance)


def test_many_and_few_electrons_follow_the_exact_distribution():
    rng = np.random.default_rng(6)
    for mean in (200.0, 1500.0, 6100.0, 20e3):
        grey = detector.digitise(TWELVE, np.full(2_000_000, mean), rng)
        assert grey.dtype == np.uint16
        cdf = detector.grey_distribution(TWELVE, mean)
        assert chi_square(np.bincount(grey, minlength=4096), np.diff(cdf, prepend=0.0)) > 1e-3


def test_each_pixel_has_normals_of_its_own():
    """Few and many electrons by turns, pixel after pixel from one row of normals."""
    n = 4000
    mean = np.where(np.arange(n) % 3 == 0, 20.0, detector.MANY_ELECTRONS * np.linspace(1.0, 5.0, n))
    grey = detector.digitise(TWELVE, mean, np.random.default_rng(12))
    rng, many = np.random.default_rng(12), mean >= detector.MANY_ELECTRONS
    electrons = np.empty(n)
    electrons[~many] = rng.poisson(mean[~many])
    normals = iter(rng.standard_normal(n + many.sum()))
    for k in range(n):
        if many[k]:
            z = next(normals)
            electrons[k] = np.round(mean[k] + np.sqrt(mean[k]) * z + (z * z - 1.0) / 6.0)
        electrons[k] = min(electrons[k], TWELVE.full_well) + TWELVE.read_noise * next(normals)
    np.testing.assert_array_equal(grey, np.round(electrons / TWELVE.electrons_per_dn + TWELVE.black_level))
