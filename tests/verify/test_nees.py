"""Bounds of statistics: they hold for a consistent filter and break for one that is not."""

import numpy as np
import pytest
from scipy.stats import chi2

from shefex_nav.report.navigation_errors import nees as normalised
from shefex_nav.verify import nees


def test_nees_is_the_squared_error_in_units_of_its_covariance():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((3, 3)) * np.array([[1e3], [1.0], [1e-6]])  # units far apart
    errors = rng.standard_normal((5, 3)) @ A.T
    expected = [e @ np.linalg.inv(A).T @ np.linalg.inv(A) @ e for e in errors]
    assert normalised(errors, (A @ A.T)[None]) == pytest.approx(expected, rel=1e-6)


def test_interval_of_a_mean_of_independent_epochs_is_that_of_chi_square():
    """With histories of one independent epoch the interval is known."""
    rng = np.random.default_rng(2)
    histories = rng.chisquare(3, size=200000)
    low, high = nees.mean_interval(histories / 3.0, 20, 0.99)
    assert (low, high) == pytest.approx(tuple(chi2.ppf([0.005, 0.995], 60) / 60), rel=0.02)


def correlated(rng, runs, epochs, correlation, sigma=1.0):
    """Errors of Gauss-Markov runs, three axes. -> (runs,) time-averaged NEES for sigma 1"""
    e = rng.standard_normal((runs, 3))
    total = np.zeros(runs)
    for _ in range(epochs):
        e = correlation * e + np.sqrt(1 - correlation**2) * rng.standard_normal((runs, 3))
        total += (sigma**2) * (e**2).sum(axis=1)
    return total / epochs


def test_time_correlation_widens_the_interval_and_mistuning_falls_outside():
    """Consistent runs stay inside, runs with half the noise assumed (sigma twice what is said) do not."""
    rng = np.random.default_rng(4)
    histories = correlated(rng, 1000, 200, 0.98)
    low, high = (3.0 * end for end in nees.mean_interval(histories / 3.0, 100, 0.999))
    per_epoch = chi2.ppf([0.0005, 0.9995], 3 * 100 * 200) / (100 * 200)
    assert high - low > 4.0 * (per_epoch[1] - per_epoch[0])
    inside = [low <= correlated(rng, 100, 200, 0.98).mean() <= high for _ in range(40)]
    assert np.mean(inside) > 0.9
    assert correlated(rng, 100, 200, 0.98, sigma=1.2).mean() > high
    assert correlated(rng, 100, 200, 0.98, sigma=0.8).mean() < low


@pytest.mark.parametrize("n", [1, 10, 100])
@pytest.mark.parametrize("correlation", [0.0, 0.9, 1.0])
def test_means_are_outside_as_seldom_as_the_interval_says(n, correlation):
    """Brute force, 0.1 %: from 1000 histories, whatever their own mean, and for as many runs as these are."""
    rng = np.random.default_rng(9)
    C = correlation ** np.abs(np.subtract.outer(np.arange(30), np.arange(30)))
    weights = np.linalg.eigvalsh(C).clip(0.0) / 30.0  # of independent squares in the mean over 30 epochs

    def drawn(size):
        return (rng.chisquare(3, (size, 30)) @ weights) / 3.0

    whole = drawn(200000)
    means = whole if n == 1 else whole[rng.integers(len(whole), size=(40000, n))].mean(axis=1)
    ends = [nees.mean_interval(drawn(1000), n, 0.999) for _ in range(40)]
    outside = np.mean([np.mean((means < low) | (means > high)) for low, high in ends])
    assert outside < 1.7e-3


def test_bounds_of_nis_and_of_containment():
    low, high = nees.nis_interval(3000, 0.999)
    assert low < 1.0 < high
    assert high - low == pytest.approx(2 * 3.29 * np.sqrt(2.0 / 3000), rel=0.01)
    low, high = nees.containment_interval(100, 0.99)
    assert (low, high) == (0.98, 1.0)  # 0.27 expected outside: P(3 or more) is 0.26 %, P(2 or more) 3 %
