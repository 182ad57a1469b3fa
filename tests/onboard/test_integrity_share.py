"""The share of process noise in innovations, and the size of that noise: a walk whose noise is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.onboard.navigation import adaptation, sensor
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.noise_evidence import Share


def shared(q, told_q, r, n, seed):
    """Share of a filter of a random walk in three axes, whose process noise is told wrong."""
    rng, P, H = np.random.default_rng(seed), 10.0 * np.eye(3), np.eye(3)
    share = Share(SimpleNamespace(P=P, newest=0))
    x, estimate = np.zeros(3), np.zeros(3)
    for _ in range(n):
        x = x + np.sqrt(q) * rng.standard_normal(3)
        P, share.P = P + told_q * np.eye(3), share.P + told_q * np.eye(3)
        z, S = x + np.sqrt(r) * rng.standard_normal(3) - estimate, P + r * np.eye(3)
        share.innovation(z, H, S)
        share.corrected(P, H, S)
        estimate, P = estimate + P @ np.linalg.solve(S, z), P - P @ np.linalg.solve(S, P)
    return share.estimate()


@pytest.mark.parametrize("true", [0.25, 1.0, 9.0, 100.0])
def test_the_growth_is_that_of_the_true_noise(true):
    """Whatever the gain, which belongs to the noise that was told: the formula is no approximation."""
    found = [shared(q=0.25 * true, told_q=0.25, r=1.0, n=600, seed=seed).growth for seed in range(10)]
    assert np.mean(found) == pytest.approx(true, rel=0.1, abs=0.05)


def test_a_hundred_innovations_tell_the_factor_within_two_where_the_share_is_a_third():
    """Factor of the standard deviation, told 3.3 times too small; noise of half the sensor's."""
    found = [shared(q=6.0, told_q=0.55, r=1.0, n=100, seed=seed) for seed in range(50)]
    factors, true = np.sqrt([one.growth for one in found]), np.sqrt(6.0 / 0.55)
    assert min(one.share for one in found) > 0.3
    assert np.all((factors > true / 2.0) & (factors < 2.0 * true))


def test_a_small_share_has_a_large_sigma():
    one = shared(q=1e-4, told_q=1e-4, r=1.0, n=100, seed=1)
    assert one.share < 0.05
    assert one.sigma > 1.0


def test_what_process_noise_has_brought_in_stays_a_covariance():
    """`prediction` takes the rows of a symmetric matrix; a difference by rounding would grow at each fix."""
    rng, n = np.random.default_rng(2), 30
    scale = 10.0 ** rng.uniform(-7.0, 1.0, n)
    P = np.diag(scale) @ (np.eye(n) + 0.1 * np.ones((n, n))) @ np.diag(scale)
    share = Share(SimpleNamespace(P=P, newest=0))
    share.P, H = 0.5 * P, rng.standard_normal((3, n)) / scale
    for _ in range(50):
        share.corrected(P, H, H @ P @ H.T + 1e-4 * np.eye(3))
        assert np.array_equal(share.P, share.P.T)
        assert np.linalg.eigvalsh(share.P / np.outer(scale, scale)).min() > -1e-9


def test_a_part_that_is_more_than_the_whole_begins_anew():
    """A reset took another gain than the one followed; carried on, it grew past all numbers in flight."""
    P, H = 10.0 * np.eye(3), np.eye(3)
    share = Share(SimpleNamespace(P=P, newest=0))
    share.P[:] = np.diag([1.0, 20.0, 1.0])
    share.innovation(np.ones(3), H, P + H)
    share.corrected(P, H, P + H)
    assert not share.P.any() and share.count == 0
    share.P[:] = P
    share.corrected(P, H, P + H)
    assert np.diag(share.P) == pytest.approx(10.0 / 11.0**2)


def test_positions_whose_errors_last_take_less_of_the_noise_away():
    """What is left of it follows the gain, so the noise that such a fix counts with, not that of its gate."""
    seen, R, H = [], np.eye(3), np.eye(3, 6)
    share = SimpleNamespace(
        number=3, carry=lambda *_: None, innovation=lambda *_: None, estimate=lambda: None,
        corrected=lambda P, H, S: seen.append(S),
    )  # fmt: skip
    for counted, expected in ((None, 3.0), (lambda nav, fix, R, gap_s: gap_s * R, 9.0)):
        nav = SimpleNamespace(
            noise=SimpleNamespace(share=share), sensors={"altimeter": SimpleNamespace(counted=counted)},
            history=SimpleNamespace(number=lambda k: k, used_s={"altimeter": 1.0}),
        )  # fmt: skip
        innovation = sensor.Innovation(np.zeros(3), H, R, 3.0 * np.eye(3), 0.0, 16.0)
        measurement = SimpleNamespace(sensor="altimeter", fix=SimpleNamespace(t_valid_s=8.0))
        now = SimpleNamespace(k=3, P=2.0 * np.eye(6))
        adaptation._learn(nav, now, innovation, measurement, Fate.USED)
        np.testing.assert_allclose(seen.pop(), expected * np.eye(3))
