"""Windows over innovations: what white ones of the right size never raise, and who is named by which."""

import numpy as np
import pytest

from shefex_nav.onboard.navigation.integrity import chi_square_limit
from shefex_nav.onboard.navigation.noise_evidence import CHANCE, LENGTHS, Window, neighbours


def findings(innovations):
    window = Window()
    return [window.take(w) for w in innovations]


def scalar_filter(q, told_q, r, told_r, n, seed):
    """Whitened innovations of a random walk in three axes, filtered with the noise that was told."""
    rng, P = np.random.default_rng(seed), 10.0
    x = estimate = np.zeros(3)
    out = []
    for _ in range(n):
        x = x + np.sqrt(q) * rng.standard_normal(3)
        P += told_q
        z = x + np.sqrt(r) * rng.standard_normal(3) - estimate
        S = P + told_r
        out.append(z / np.sqrt(S))
        estimate, P = estimate + P / S * z, P * told_r / S
    return out


def test_white_innovations_raise_no_alarm():
    """Sixty flights of a thousand innovations; at 1e-5 a flight, one alarm has a chance of 6e-4."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        assert not any(one.process or one.sensor for one in findings(rng.standard_normal((1000, 3))))


def test_the_limit_is_that_of_the_chance():
    """Chi-square of the Gauss approximation by Wilson and Hilferty, z(1e-9) = 5.998."""
    dof = 3 * LENGTHS[-1]
    wilson = dof * (1.0 - 2.0 / (9.0 * dof) + 5.998 * np.sqrt(2.0 / (9.0 * dof))) ** 3
    assert CHANCE == 1e-9
    assert chi_square_limit(CHANCE, dof) == pytest.approx(wilson, rel=2e-3)


@pytest.mark.parametrize("seed", range(5))
def test_process_noise_told_too_small_is_named(seed):
    found = findings(scalar_filter(q=1.0, told_q=0.04, r=1.0, told_r=1.0, n=200, seed=seed))
    assert any(one.process for one in found)
    assert not any(one.sensor for one in found)


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_the_sensor_told_too_small_is_named(seed):
    """The gain is too high then: neighbours have opposite signs."""
    innovations = scalar_filter(q=0.01, told_q=0.01, r=9.0, told_r=1.0, n=200, seed=seed)
    found = findings(innovations)
    assert any(one.sensor for one in found)
    assert not any(one.process for one in found)
    assert neighbours(np.array(innovations)) < 0.0


def test_noise_told_too_large_is_not_named():
    for told_q, told_r in ((25.0, 1.0), (1.0, 25.0)):
        found = findings(scalar_filter(q=1.0, told_q=told_q, r=1.0, told_r=told_r, n=500, seed=1))
        assert not any(one.process or one.sensor for one in found)


def test_a_run_of_one_sign_counts_where_each_is_small():
    """An error that lasts has made S ten times as large in variance: not one innovation is out of it."""
    rng = np.random.default_rng(3)
    w = np.array([0.9, 0.9, 0.0]) + np.sqrt(0.1) * rng.standard_normal((100, 3))
    found = findings(w)
    assert (w * w).sum(axis=1).max() < 16.3  # that of chance once in a thousand
    assert any(one.process for one in found)
    signs = rng.choice([-1.0, 1.0], (100, 1))
    assert not any(one.process for one in findings(w * signs))  # as large, but of either sign
