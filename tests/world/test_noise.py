"""Streams are independent and reproducible; coloured noise has the variance and correlation asked for."""

import numpy as np
import pytest
from scipy import signal, stats
from scipy_bits import assert_as_scipy

from shefex_nav.world import noise


def test_a_stream_repeats_and_differs_from_every_other():
    first = {name: noise.generator(7, name).standard_normal(4) for name in noise.STREAMS}
    again = {name: noise.generator(7, name).standard_normal(4) for name in noise.STREAMS}
    assert all(np.array_equal(first[name], again[name]) for name in noise.STREAMS)
    assert len({tuple(numbers) for numbers in first.values()}) == len(noise.STREAMS)
    assert not np.array_equal(first["imu"], noise.generator(8, "imu").standard_normal(4))


def test_keys_of_streams_are_frozen():
    """A changed key would change the numbers of every run ever made."""
    assert noise.STREAMS == {
        "imu": 1,
        "gps": 2,
        "pad": 3,
        "camera_errors": 4,
        "camera_noise": 5,
        "attitude_control": 6,
        "gps_errors": 7,
        "faults": 8,
        "sightings": 9,
    }


def test_unknown_stream_is_an_error():
    with pytest.raises(KeyError):
        noise.generator(1, "altimeter")


def test_gauss_markov_against_the_recursion():
    white = np.random.default_rng(1).standard_normal((50, 2))
    x = noise.gauss_markov(0.9, white)
    expected = white[0]
    for k in range(50):
        if k > 0:
            expected = 0.9 * expected + np.sqrt(1.0 - 0.81) * white[k]
        np.testing.assert_allclose(x[k], expected, atol=1e-13)


def test_gauss_markov_in_pieces_is_the_filter_of_scipy():
    white, c = np.random.default_rng(3).standard_normal((500, 3)), np.exp(-0.01)
    drive = np.sqrt(1.0 - c**2) * white
    drive[0] = white[0]
    expected = signal.lfilter([1.0], [1.0, -c], drive, axis=0)
    assert_as_scipy(noise.gauss_markov(c, white.copy()), expected)
    first = noise.gauss_markov(c, white[:123].copy())
    rest = noise.gauss_markov(c, white[123:].copy(), first[-1])
    assert_as_scipy(np.concatenate([first, rest]), expected)


def test_gauss_markov_is_stationary_with_exponential_correlation():
    """4000 processes; variance by chi-square, correlation by Fisher's z, each at 99.9 % confidence."""
    n = 4000
    x = noise.gauss_markov(np.exp(-1.0 / 20.0), np.random.default_rng(2).standard_normal((101, n)))
    for k in (0, 20, 100):
        low, high = stats.chi2.interval(0.999, n)
        assert low < np.sum(x[k] ** 2) < high
    for lag in (5, 20, 40):
        sample = np.arctanh(np.corrcoef(x[50], x[50 + lag])[0, 1])
        expected = np.arctanh(np.exp(-lag / 20.0))
        assert abs(sample - expected) < stats.norm.ppf(0.9995) / np.sqrt(n - 3)
