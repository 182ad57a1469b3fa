"""Subset simulation against closed forms: its mean, its coefficient of variation, its chains."""

import math

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import binom, chi2, kstest

from shefex_nav.campaign import subset


def linear(state):
    """Standard normal, of any number of normals."""
    return float(state.normal.sum()) / math.sqrt(len(state.normal))


def sphere(state):
    """Square of a radius."""
    return float(state.normal @ state.normal)


def by_seed(state):
    """Standard normal that the seed decides."""
    return float(np.random.default_rng(state.seeds[0]).standard_normal())


def both(state):
    """Standard normal that both decide."""
    return (linear(state) + by_seed(state)) / math.sqrt(2.0)


def first(size, n, seed, seeds=0):
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(7,)))
    return [
        subset.State(rng.standard_normal(n), tuple(rng.integers(2**53, size=seeds).tolist()))
        for _ in range(size)
    ]


def estimate(function, limit, n, seed, size=500, seeds=0, smallest=1e-7):
    def work(what, calls):
        return [what(function, call) for call in calls]

    return subset.estimate(first(size, n, seed, seeds), limit, smallest, seed, work)


CLOSED = {  # function, limit, normals, seeds, probability
    "linear 3": (linear, 3.0, 10, 0, ndtr(-3.0)),
    "linear 4": (linear, 4.0, 10, 0, ndtr(-4.0)),
    "sphere": (sphere, 25.0, 5, 0, chi2.sf(25.0, 5)),
    "seed alone": (by_seed, 2.5, 0, 1, ndtr(-2.5)),
    "normals and a seed": (both, 2.5, 5, 1, ndtr(-2.5)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CLOSED)
def test_mean_and_coefficient_of_variation(name):
    """Au and Beck: the bias is of the order of the squared coefficient of variation."""
    function, limit, n, seeds, probability = CLOSED[name]
    found = [estimate(function, limit, n, seed, seeds=seeds) for seed in range(100)]
    ratios = np.array([one.probability for one in found]) / probability
    stated = math.sqrt(np.mean([one.variation**2 for one in found]))
    assert all(one.reached for one in found)
    assert abs(ratios.mean() - 1.0) < 3.0 * ratios.std() / 10.0 + 0.5 * stated**2
    assert 0.7 < ratios.std() / ratios.mean() / stated < 1.3
    inside = np.mean([one.interval[0] <= probability <= one.interval[1] for one in found])
    assert inside >= 0.87  # of 95 %, 100 of them: 3 standard errors


@pytest.mark.parametrize("name", ["linear 3", "seed alone", "normals and a seed"])
def test_a_few_replications(name):
    function, limit, n, seeds, probability = CLOSED[name]
    found = [estimate(function, limit, n, seed, 200, seeds) for seed in range(6)]
    logs = np.log([one.probability / probability for one in found])
    assert abs(logs.mean()) < 4.0 * found[0].variation / math.sqrt(6.0)


def walked(value, threshold, seeds=0, steps=15, spread=0.7, n=3):
    """Last samples of 1000 chains that begin with independent draws beyond the threshold."""
    begin = [one for one in first(10_000, n, 3, seeds) if value(one) >= threshold][:1000]
    chains = [
        subset.Chain((5, 1, k), subset.Sample(one, value(one)), threshold, np.full(n, spread), steps)
        for k, one in enumerate(begin)
    ]
    return [subset.walk(value, one).samples[-1] for one in chains]


def test_chains_leave_the_conditional_distribution_as_it_is():
    """Of a standard normal beyond 1: the last samples are again of that law. A step too wide or too narrow
    for its factor, or a rule that accepts what is below, fails it.
    """
    last = walked(linear, 1.0)
    beyond = np.array([one.value for one in last])
    assert beyond.min() >= 1.0
    assert kstest(beyond, lambda x: 1.0 - ndtr(-x) / ndtr(-1.0)).pvalue > 1e-3
    across = np.array([(one.state.normal[0] - one.state.normal[1]) / math.sqrt(2.0) for one in last])
    assert kstest(across, ndtr).pvalue > 1e-3


def wrong_step(state, spread, rng):
    """A random walk, which is not reversible with respect to the normal distribution."""
    return subset.State(state.normal + spread * rng.standard_normal(len(spread)), state.seeds)


def test_a_wrong_step_would_be_seen(monkeypatch):
    monkeypatch.setattr(subset, "proposed", wrong_step)
    last = walked(linear, 1.0)
    beyond = np.array([one.value for one in last])
    assert kstest(beyond, lambda x: 1.0 - ndtr(-x) / ndtr(-1.0)).pvalue < 1e-6


def test_chains_of_seeds_leave_their_distribution_as_it_is():
    last = walked(by_seed, 1.0, seeds=1, n=0)
    beyond = np.array([one.value for one in last])
    assert kstest(beyond, lambda x: 1.0 - ndtr(-x) / ndtr(-1.0)).pvalue > 1e-3


def test_a_seed_alone_is_accepted_no_more_often_than_plain_monte_carlo():
    found = estimate(by_seed, 2.5, 0, 1, seeds=1)
    for before, level in zip(found.levels, found.levels[1:], strict=False):
        assert level.accepted is None
        assert level.redrawn_accepted == pytest.approx(before.probability, abs=0.05)


def test_correlation_of_chains():
    """Samples of a chain that are all the same count as one; independent ones as what they are."""
    rng = np.random.default_rng(2)
    independent = rng.random((400, 10)) < 0.1
    share = independent.mean()
    plain = math.sqrt((1.0 - share) / share / 4000)
    assert subset.correlated(independent.ravel(), [10] * 400) == pytest.approx(plain, rel=0.15)
    same = np.repeat(rng.random(400) < 0.1, 10)
    share = same.mean()
    wanted = math.sqrt((1.0 - share) / share / 400)
    assert subset.correlated(same, [10] * 400) == pytest.approx(wanted, rel=0.02)


def test_steps_are_accepted_as_often_as_wanted():
    found = estimate(linear, 4.0, 20, 1, size=1000)
    for level in found.levels[2:]:
        assert level.accepted == pytest.approx(subset.WANTED, abs=0.12)


def test_plain_monte_carlo_of_what_is_not_rare():
    found = estimate(linear, 1.0, 4, 1)
    inside = np.mean([linear(one) > 1.0 for one in first(500, 4, 1)])
    assert len(found.levels) == 1 and found.reached
    assert found.probability == inside and found.evaluated == 500
    low, high = found.interval
    assert binom.sf(500 * inside - 1, 500, low) == pytest.approx(0.025)
    assert binom.cdf(500 * inside, 500, high) == pytest.approx(0.025)
    assert found.variation == pytest.approx(math.sqrt((1.0 - inside) / inside / 500))
    assert found.plain == pytest.approx(500)


def test_what_all_samples_are_is_not_certain():
    """100 of 100: 2.5 % of the time with a probability of 0.025^(1/100) (Clopper and Pearson)."""
    found = estimate(linear, -20.0, 4, 1, 100)
    assert found.probability == 1.0
    assert found.interval == pytest.approx((0.025**0.01, 1.0))


def test_what_is_too_rare_is_given_up_at_the_smallest():
    found = estimate(linear, 40.0, 4, 1, smallest=1e-3)
    assert not found.reached and found.probability == pytest.approx(1e-3, rel=0.1)
    assert found.evaluated == pytest.approx(subset.most(500, 1e-3), rel=0.01)
    assert subset.most(500, 1e-3) == 500 + 2 * 450
    assert found.levels[-1].threshold == pytest.approx(3.09, abs=0.5)


def test_what_does_not_differ_has_no_threshold():
    with pytest.raises(subset.SubsetError, match="500 of 500 samples have one and the same value"):
        estimate(lambda state: 1.0, 2.0, 3, 1)


def test_an_infinite_value_is_in_the_event():
    """Of a tail of 1e-2 beyond which the value is infinite."""
    found = estimate(lambda state: math.inf if linear(state) > 2.326 else linear(state), 9.0, 4, 3)
    assert found.probability == pytest.approx(0.01, rel=0.6)
    assert all(math.isfinite(level.threshold) for level in found.levels)


def test_a_threshold_that_equals_the_limit_is_not_beyond_it():
    """Values in steps of 0.25, of which those at the limit are not greater than it."""
    found = estimate(lambda state: math.floor(4.0 * linear(state)) / 4.0, 1.25, 4, 1)
    assert found.reached and len(found.levels) == 2  # greater than 1.25 is 1.5 and more: 6.7 %
    assert found.probability == pytest.approx(ndtr(-1.5), rel=0.3)


def test_chains_that_begin_with_one_sample_move():
    same = [subset.Sample(subset.State(np.array([2.0, 0.0])), 2.0)] * 5

    def work(what, calls):
        return [what(lambda state: state.normal[0], call) for call in calls]

    chains, _ = subset._walked((1, 1), same, 1.0, 50, 0.6, work)
    assert sum(chain.accepted for chain in chains) > 10
