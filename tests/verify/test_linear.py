"""Error histories of linear problems whose answers are known.

Steps that leave out what is zero, against the equations written down with whole matrices.
"""

import numpy as np
import pytest

from shefex_nav.verify import linear
from shefex_nav.verify.linear import Interval, Update


def one(value):
    return np.array([[float(value)]])


def walk(times_s, q, r, late_s=0.0):
    """A scalar random walk, measured at every second time."""
    steps = []
    for k, t_s in enumerate(times_s):
        steps.append(Interval(t_s, one(1.0), one(q)))
        if k % 2:
            steps.append(Update(t_s, t_s + late_s, "position", one(1.0), one(r)))
    return steps


def oscillator(n, dt_s=0.1):
    """A spring with a constant force, driven by noise: position, velocity, force; measured at times."""
    A = np.array([[0.0, 1.0, 0.0], [-4.0, -0.3, 1.0], [0.0, 0.0, 0.0]])
    Phi = np.eye(3) + dt_s * A + 0.5 * (dt_s * A) @ (dt_s * A)
    Q = np.diag([1e-4, 0.02, 0.0])
    steps = []
    for k in range(1, n + 1):
        steps.append(Interval(k * dt_s, Phi, Q))
        if k % 5 == 0:
            steps.append(
                Update(k * dt_s, k * dt_s + 0.25, "position", np.array([[1.0, 0.0, 0.0]]), one(0.01))
            )
    return steps


def test_a_random_walk_settles_at_the_root_of_its_riccati_equation():
    q, r = 0.5, 2.0
    times_s = np.arange(1.0, 101.0)
    last = list(linear.outputs(one(10.0), walk(times_s, q, r), times_s))[-1]
    # after an update: 1/P = 1/(P + 2q) + 1/r, so P^2 + 2qP - 2qr = 0
    assert last.P[0, 0] == pytest.approx(-q + np.sqrt(q * q + 2.0 * q * r), rel=1e-12)


def test_what_is_late_counts_when_it_is_there():
    times_s = np.arange(1.0, 11.0)
    in_time = [one.P[0, 0] for one in linear.outputs(one(10.0), walk(times_s, 0.5, 2.0), times_s)]
    late = [one.P[0, 0] for one in linear.outputs(one(10.0), walk(times_s, 0.5, 2.0, late_s=1.0), times_s)]
    # updates are at 2, 4, ... and arrive at 3, 5, ...: then all is as if they had never been late
    assert late[2::2] == pytest.approx(in_time[2::2], rel=1e-12)
    before = in_time[6] + 0.5  # at 8 s the update of 8 s is on its way: the knowledge of 7 s, a step older
    assert late[7] == pytest.approx(before, rel=1e-12)


def test_late_ones_in_another_order_than_their_instants():
    """A fix that overtakes an older one: what is known is what has arrived."""
    early, slow = one(1.0), one(4.0)
    steps = [
        Interval(1.0, one(1.0), one(0.0)),
        Update(1.0, 3.5, "slow", one(1.0), slow),
        Interval(2.0, one(1.0), one(0.0)),
        Update(2.0, 2.5, "fast", one(1.0), early),
        Interval(3.0, one(1.0), one(0.0)),
        Interval(4.0, one(1.0), one(0.0)),
    ]
    P = [output.P[0, 0] for output in linear.outputs(one(2.0), steps, [1.0, 2.0, 3.0, 4.0])]
    assert P == pytest.approx([2.0, 2.0, 1.0 / (1 / 2 + 1 / 1), 1.0 / (1 / 2 + 1 / 1 + 1 / 4)], rel=1e-12)


def test_histories_have_the_covariance_that_is_said():
    """Also while measurements are on their way; 20000 histories, seed 3, five standard deviations."""
    steps = oscillator(60)
    times_s = np.arange(1, 61) * 0.1
    n = 20000
    P = np.diag([1.0, 0.5, 0.2])
    for output in linear.outputs(P, steps, times_s, rng=np.random.default_rng(3), number=n):
        sampled = output.errors @ output.errors.T / n
        spread = np.sqrt((np.outer(np.diag(output.P), np.diag(output.P)) + output.P**2) / n)
        assert np.all(np.abs(sampled - output.P) < 5.0 * spread), output.t_s


def test_a_history_is_one_history():
    """Noise drawn on the way to an output is the same on the way to the next."""
    steps = [Interval(0.1 * k, one(1.0), one(1.0)) for k in range(1, 21)]
    steps.insert(5, Update(0.5, 1.95, "late", one(1.0), one(1e12)))  # holds all the rest back, says nothing
    errors = [
        output.errors
        for output in linear.outputs(
            one(1.0), steps, 0.1 * np.arange(1, 21), rng=np.random.default_rng(0), number=4000
        )
    ]
    changes = np.diff(np.array(errors)[:, 0], axis=0)
    assert np.var(changes, axis=1) == pytest.approx(np.ones(19), rel=0.15)  # 6 sigma of 4000


def test_root_of_a_covariance_with_nothing_in_some_directions():
    A = np.array([[1e6, 0.0, 0.0], [2e6, 1e-6, 0.0], [0.0, 0.0, 0.0]])
    P = A @ A.T
    root = linear.square_root(P)
    assert root @ root.T == pytest.approx(P, rel=1e-9)
    with pytest.raises(ValueError, match="not a covariance"):
        linear.square_root(np.array([[1.0, 2.0], [2.0, 1.0]]))


def test_what_does_not_vary_gets_no_noise():
    """A scale factor without process noise beside a position with it, the rounding of whose root is 1e-9."""
    P = np.zeros((4, 4))
    P[:3, :3] = np.outer([1.0, 0.3, 1e-4], [1.0, 0.3, 1e-4])  # of rank one
    assert np.all(linear.square_root(P)[3] == 0.0)


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
