"""What runs draw: from the number of the run alone, and with the distributions that were asked for.

Every statistical check is at a probability of one in a million or less of failing by chance, for a seed that
is fixed; N = 4000 draws unless something else is said.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from shefex_nav.campaign import draws, running
from shefex_nav.campaign.plan import Plan
from shefex_nav.scenario import laws, load
from shefex_nav.scenario.disperse import Dispersed

SCENARIOS = Path(__file__).parents[2] / "scenarios"
N = 4000
LEAST_P = 1e-6


def dispersed(name, law, group=(), factors=()):
    return Dispersed((name,), name, None, None, law, "", "add", group, factors)


def sampler(*fields, seed=1, runs=N, sampling="random"):
    plan = Plan("test", "", seed, runs, sampling, 1.0, False, {})
    return draws.Sampler(plan, list(fields))


def column(one, name, runs=N):
    return np.array([one.draws(run)[name] for run in range(runs)])


A = dispersed("a", laws.NormalLaw(1.0, 2.0))
B = dispersed("b", laws.UniformLaw(-3.0, 5.0))


def test_a_draw_does_not_depend_on_the_order_of_runs_or_on_other_dispersions():
    alone, both, reversed_ = sampler(A), sampler(A, B), sampler(B, A)
    backwards = [both.draws(run)["a"] for run in (7, 3, 0)]
    assert backwards == [alone.draws(run)["a"] for run in (7, 3, 0)]
    assert [reversed_.draws(run)["b"] for run in range(5)] == [both.draws(run)["b"] for run in range(5)]
    assert sampler(A, runs=10).draws(3) == sampler(A, runs=10**6).draws(3)
    assert sampler(A, seed=2).draws(3) != alone.draws(3)


def test_runs_paths_and_sensors_have_streams_of_their_own():
    u = dispersed("u", laws.UniformLaw(0.0, 1.0))
    v = dispersed("v", laws.UniformLaw(0.0, 1.0))
    one = sampler(u, v)
    x, y = column(one, "u"), column(one, "v")
    limit = stats.norm.isf(LEAST_P / 2) / np.sqrt(N)
    assert abs(np.corrcoef(x, y)[0, 1]) < limit
    assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < limit
    seeds = [draws.sensor_seed(1, run) for run in range(N)]
    assert len(set(seeds)) == N and max(seeds) < 2**53 and max(seeds) > 2**52
    assert draws.flight_seed(1) not in seeds


LAWS = {
    "normal": (laws.NormalLaw(1.0, 2.0), stats.norm(1.0, 2.0)),
    "uniform": (laws.UniformLaw(-3.0, 5.0), stats.uniform(-3.0, 8.0)),
    "truncated": (laws.TruncatedLaw(0.5, 2.0, -1.0, 4.0), stats.truncnorm(-0.75, 1.75, 0.5, 2.0)),
    "truncated far out": (laws.TruncatedLaw(0.0, 1.0, 9.0, 12.0), stats.truncnorm(9.0, 12.0)),
    "half": (laws.TruncatedLaw(0.0, 2.0, 0.0, np.inf), stats.halfnorm(0.0, 2.0)),
    "log-normal": (laws.LogNormalLaw(0.3), stats.lognorm(0.3)),
}


@pytest.mark.parametrize("name", LAWS)
def test_distributions(name):
    """Kolmogorov and Smirnov's test against scipy's distribution; mean and variance within their scatter."""
    law, expected = LAWS[name]
    x = column(sampler(dispersed("x", law)), "x")
    assert stats.kstest(x, expected.cdf).pvalue > LEAST_P
    far = stats.norm.isf(LEAST_P / 2)
    assert abs(x.mean() - expected.mean()) < far * expected.std() / np.sqrt(N)
    scatter = np.sqrt((expected.stats("k") + 2.0) / N) * expected.var()
    assert abs(x.var() - expected.var()) < far * scatter


@pytest.mark.parametrize("name", [name for name in LAWS if name != "truncated far out"])
def test_quantiles_are_those_of_scipy(name):
    law, expected = LAWS[name]
    u = np.array([1e-9, 0.01, 0.3, 0.5, 0.9, 1.0 - 1e-9])
    assert [law.draw(one, 0) for one in u] == pytest.approx(expected.ppf(u), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("a", [9.0, 40.0, 300.0, 9000.0])
def test_a_normal_distribution_cut_far_out_in_a_tail_is_an_exponential_one(a):
    """Mills' ratio is 1/a but for 1/a^2: between a and a + 1/a lies z = a - ln(1 - u (1 - e^-1)) / a."""
    for u in (1e-6, 0.1, 0.5, 0.9, 1.0 - 1e-6):
        high = laws.TruncatedLaw(5.0, 2.0, 5.0 + 2.0 * a, 5.0 + 2.0 * (a + 1.0 / a)).draw(u, 0)
        low = laws.TruncatedLaw(5.0, 2.0, 5.0 - 2.0 * (a + 1.0 / a), 5.0 - 2.0 * a).draw(1.0 - u, 0)
        beyond = (high - 5.0) / 2.0 - a
        assert beyond * a == pytest.approx(
            -np.log1p(-u * (1.0 - np.exp(-1.0))), abs=2.0 / a**2 + 1e-7 * a**0.5
        )
        assert 5.0 - low == pytest.approx(high - 5.0, rel=1e-12)
    half_open = laws.TruncatedLaw(0.0, 1.0, a, np.inf)
    assert half_open.draw(0.5, 0) == pytest.approx(stats.truncnorm(a, np.inf).ppf(0.5), rel=1e-9)


def test_choices_come_as_often_as_their_weights():
    law = laws.ChoiceLaw((100, 250, 500), (0.25, 0.75, 1.0))
    x = column(sampler(dispersed("x", law)), "x")
    counts = [np.sum(x == value) for value in (100, 250, 500)]
    assert stats.chisquare(counts, [0.25 * N, 0.5 * N, 0.25 * N]).pvalue > LEAST_P


def test_a_choice_without_weight_is_never_drawn():
    law = laws.ChoiceLaw(("a", "b", "c"), (0.5, 1.0, 1.0))
    assert {law.draw(u, 0) for u in (1e-16, 0.49, 0.5, 1.0 - 1e-16)} == {"a", "b"}
    assert law.reach() == ("a", "b")


def test_a_table_is_read_by_the_number_of_the_run():
    one = sampler(dispersed("x", laws.TableLaw((5.0, 7.0, 6.0))))
    assert [one.draws(run)["x"] for run in (2, 0, 1)] == [6.0, 5.0, 7.0]


def test_correlated_group():
    """Sigmas and correlation come out; the first path draws what it would draw alone."""
    names, sigma = ("p", "q"), (2.0, 0.5)
    group = [
        dispersed("p", laws.NormalLaw(0.0, 2.0), names, (1.0, 0.0)),
        dispersed("q", laws.NormalLaw(0.0, 0.5), names, (0.7, np.sqrt(1.0 - 0.49))),
    ]
    one = sampler(*group)
    x = np.array([list(one.draws(run).values()) for run in range(N)])
    far = stats.norm.isf(LEAST_P / 2)
    assert abs(np.arctanh(np.corrcoef(x.T)[0, 1]) - np.arctanh(0.7)) < far / np.sqrt(N - 3)  # Fisher
    for k in (0, 1):
        assert stats.kstest(x[:, k], stats.norm(0.0, sigma[k]).cdf).pvalue > LEAST_P
    alone = sampler(dispersed("p", laws.NormalLaw(0.0, 2.0)))
    assert x[:20, 0] == pytest.approx([alone.draws(run)["p"] for run in range(20)], rel=1e-12)


def test_a_latin_hypercube_hits_every_part_of_each_distribution_once():
    u, v = dispersed("u", laws.UniformLaw(0.0, 1.0)), dispersed("v", laws.NormalLaw(0.0, 1.0))
    one = sampler(u, v, runs=200, sampling="latin_hypercube")
    x, y = column(one, "u", 200), column(one, "v", 200)
    assert sorted(np.floor(200 * x)) == list(range(200))
    assert sorted(np.floor(200 * stats.norm.cdf(y))) == list(range(200))
    assert abs(stats.spearmanr(x, y).statistic) < 0.35  # 5 sigma; the parts are put together at random
    alone = sampler(u, runs=200, sampling="latin_hypercube")
    assert column(alone, "u", 200).tolist() == x.tolist()
    assert column(sampler(u, runs=100, sampling="latin_hypercube"), "u", 100).tolist() != x[:100].tolist()


def test_a_latin_hypercube_knows_a_mean_better():
    """Variance of the mean of a smooth function: less than a hundredth of that of random draws."""
    u = dispersed("u", laws.NormalLaw(0.0, 1.0))

    def means(sampling):
        return [np.mean(column(sampler(u, seed=s, runs=50, sampling=sampling), "u", 50)) for s in range(40)]

    assert np.var(means("latin_hypercube")) < 0.01 * np.var(means("random"))


def test_instruments_are_drawn_alike_with_one_flight_and_with_many():
    """Run k of the one with one flight has the instruments of run k of the one that extends it."""
    (plan, alone), (of_all, every) = (
        running.prepared(load.load(SCENARIOS / f"{name}.yaml"), 3, 1)
        for name in ("shefex2_dispersed_sensors", "shefex2_dispersed")
    )
    assert plan.shared and not of_all.shared
    for run in range(3):
        one, other = alone.job(run), every.job(run)
        assert one.seed == other.seed and len(one.draws) < len(other.draws)
        assert one.draws.items() <= other.draws.items()
        assert {path.split(".")[0] for path in one.draws} == {"imu", "gps", "star_camera"}
