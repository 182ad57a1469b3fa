"""Covariance steps that leave out what is zero, against the equations written down with whole matrices."""

import numpy as np
import pytest

from shefex_nav.verify import linear

N, A = 17, 5


def made(seed):
    """P, DrivenInterval, H, R at random, and scales of the states, as far apart as m and rad."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-6.0, 2.0, N)
    root = scale[:, None] * rng.standard_normal((N, N))
    X = np.hstack([np.eye(A) + 0.1 * rng.standard_normal((A, A)), rng.standard_normal((A, N - A))])
    X = scale[:A, None] * X / scale
    noise = scale[:A, None] * rng.standard_normal((A, A))
    step = linear.DrivenInterval(1.0, X, noise @ noise.T, rng.random(N - A), rng.random(N - A))
    H = rng.standard_normal((3, N)) * (rng.random(N) < 0.5) / scale
    said = rng.standard_normal((3, 3))
    return root @ root.T, step, H, said @ said.T, scale


@pytest.mark.parametrize("seed", range(5))
def test_steps_are_those_of_whole_matrices(seed):
    P, step, H, R, scale = made(seed)
    size = np.outer(scale, scale)
    assert step.Phi[A + 1, A + 1] == step.keeps[1] and not np.any(step.Phi[A:, :A])
    grown = step.Phi @ P @ step.Phi.T + step.Q
    np.testing.assert_allclose(linear.grown(P, *step[1:]) / size, grown / size, rtol=1e-11, atol=1e-10)
    after, K = linear.corrected(P, H, R)
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    left = np.eye(N) - gain @ H
    np.testing.assert_allclose(K / scale[:, None], gain / scale[:, None], rtol=1e-8, atol=1e-9)
    wanted = left @ P @ left.T + gain @ R @ gain.T
    np.testing.assert_allclose(after / size, wanted / size, rtol=1e-7, atol=1e-8)
    assert np.array_equal(after, after.T)


def test_a_gain_that_is_wrong_at_rounding_level_keeps_a_covariance():
    """Measurements 1e4 times better than what was known: still no negative variance in any direction."""
    rng = np.random.default_rng(3)
    root = rng.standard_normal((N, N))
    P = root @ root.T
    for _ in range(20):
        P, _ = linear.corrected(P, rng.standard_normal((3, N)), 1e-8 * np.eye(3))
    values = np.linalg.eigvalsh(P)
    assert 0.0 < values[0] and values[-1] < 1e-5


def test_a_measurement_without_a_covariance_is_refused():
    P, _, H, R, _ = made(1)
    with pytest.raises(ValueError, match="not positive definite"):
        linear.corrected(P, H, R - 1e12 * np.eye(3))


def test_histories_of_driven_errors_have_their_covariance():
    """Drawn by the blocks of an interval, against the covariance of the same steps."""
    P, step, H, R, scale = made(2)
    step = step._replace(added=step.added * scale[A:] ** 2 * (np.arange(N - A) % 2))
    steps = [step, linear.Update(1.0, 1.0, "one", H, R), step._replace(t_s=2.0)]
    number = 40_000
    rng = np.random.default_rng(5)
    *_, last = linear.outputs(P, steps, [1.0, 2.0], rng=rng, number=number)
    sigma = np.sqrt(last.P.diagonal())
    drawn = last.errors / sigma[:, None]
    wanted = last.P / np.outer(sigma, sigma)
    assert np.abs(drawn @ drawn.T / number - wanted).max() < 6.0 / np.sqrt(number)


def test_histories_that_begin_later_have_the_covariance_of_then():
    P, step, H, R, scale = made(4)
    step = step._replace(added=step.added * scale[A:] ** 2)
    steps = []
    for k in range(1, 6):
        steps += [step._replace(t_s=float(k)), linear.Update(float(k), k + 0.5, "late", H, R)]
    number = 40_000
    found = list(
        linear.outputs(
            P, steps, np.arange(1.0, 6.0), rng=np.random.default_rng(6), number=number, between=(3.0, 4.0)
        )
    )
    assert [one.errors.shape[1] for one in found] == [0, 0, number, number, 0]
    for one, plain in zip(found, linear.outputs(P, steps, np.arange(1.0, 6.0)), strict=True):
        assert np.array_equal(one.P, plain.P)
        if one.errors.shape[1]:
            sigma = np.sqrt(one.P.diagonal())
            drawn, wanted = one.errors / sigma[:, None], one.P / np.outer(sigma, sigma)
            assert np.abs(drawn @ drawn.T / number - wanted).max() < 6.0 / np.sqrt(number)
