"""k-vector search against searchsorted on the same data."""

import numpy as np
import pytest

from shefex_nav.onboard.startracker import tables


def search(index, values, low, high):
    """(first, last) of each range, as the identification looks them up."""
    found = [tables.span(*index, values, *limits) for limits in zip(low, high, strict=True)]
    return tuple(np.array(found).T)


def brute_force(values, low, high):
    first = np.searchsorted(values, low, side="left")
    return first, np.maximum(first, np.searchsorted(values, high, side="right"))


@pytest.mark.parametrize("seed", range(6))
def test_same_ranges_as_a_search(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 3000))
    values = np.sort(rng.choice([rng.uniform(0.9, 1.0, n), rng.uniform(-5, 5, n) ** 3], axis=0))
    if seed == 3:  # many equal values
        values = np.sort(np.round(values, 2))
    index = tables.k_vector(values)
    picks = rng.choice(values, 300)
    low = np.concatenate([picks, rng.uniform(values[0] - 1, values[-1] + 1, 300), [values[0], -1e30]])
    width = np.concatenate([np.zeros(150), rng.uniform(0, 0.02, 150), rng.uniform(0, 2, 300), [0, 2e30]])
    np.testing.assert_array_equal(
        search(index, values, low, low + width), brute_force(values, low, low + width)
    )


def test_every_value_and_the_gaps_beside_it():
    """Ends and off-by-one: each value found alone, just below and just above it nothing or its neighbour."""
    values = np.sort(np.random.default_rng(9).uniform(0.94, 1.0, 500))
    index = tables.k_vector(values)
    first, last = search(index, values, values, values)
    np.testing.assert_array_equal(first, np.arange(500))
    np.testing.assert_array_equal(last, np.arange(500) + 1)
    above = np.nextafter(values, np.inf)
    first, last = search(index, values, above, above)
    np.testing.assert_array_equal(first, last)


def test_first_and_last_entry_of_the_index():
    values = np.linspace(0.95, 1.0, 1000) ** 2
    index = tables.k_vector(values)
    assert index.count[0] == 0
    assert index.count[-1] == 1000
    line = index.slope * np.arange(1, 1001) + index.intercept
    np.testing.assert_array_equal(index.count[1:-1], [(values <= z).sum() for z in line[1:-1]])


def test_outside_the_table():
    values = np.linspace(0.95, 1.0, 100)
    index = tables.k_vector(values)
    low, high = np.array([0.0, 1.1, -np.inf, 0.0]), np.array([0.9, 1.2, np.inf, 2.0])
    first, last = search(index, values, low, high)
    np.testing.assert_array_equal(last - first, [0, 0, 100, 100])
