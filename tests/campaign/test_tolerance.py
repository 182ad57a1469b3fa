"""How many runs show a requirement: published numbers, and the bounds of Clopper and Pearson."""

import math

import pytest
from scipy import stats

from shefex_nav.campaign import tolerance


@pytest.mark.parametrize(
    ("stated", "runs"),
    [
        # one-sided tolerance limits by order statistics, 95 % of the population at 95 % confidence:
        # Wilks (1941) and the tables made from it for reactor safety
        ((0.95, 0.95), (59, 93, 124, 153, 181, 208)),
        # 99.865 % at 90 %, no failure: ln 0.1 / ln 0.99865 = 1704.5
        ((0.99865, 0.9), (1705,)),
        ((0.99, 0.95), (299,)),  # ln 0.05 / ln 0.99 = 298.07
        ((0.9, 0.9), (22, 38, 52)),  # of tables of single sampling plans: LTPD 10 %, consumer's risk 10 %
    ],
)
def test_runs_that_pass_with_so_many_failures(stated, runs):
    for failures, expected in enumerate(runs):
        assert tolerance.needed(failures, *stated) == expected
        assert tolerance.passes(failures, expected, *stated)
        assert not tolerance.passes(failures, expected - 1, *stated)
        assert not tolerance.passes(failures + 1, expected, *stated)


@pytest.mark.parametrize("failures", [1, 2, 40])
def test_more_failures_by_the_sum_of_the_binomial(failures):
    """The number is the first for which the sum of the terms, made here, is not above 10 %."""
    n = tolerance.needed(failures, 0.99865, 0.9)

    def total(n):
        q = 1.0 - 0.99865
        logs = [
            math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
            + k * math.log(q) + (n - k) * math.log1p(-q) for k in range(failures + 1)
        ]  # fmt: skip
        return math.fsum(math.exp(one) for one in logs)

    assert total(n) <= 0.1 < total(n - 1)


def test_no_failure_by_the_logarithm():
    for p, c in ((0.5, 0.5), (0.9973, 0.9), (0.999999, 0.99)):
        assert tolerance.needed(0, p, c) == math.ceil(math.log1p(-c) / math.log(p) - 1e-9)


def test_rounding_decides_nothing():
    """0.7 ** 2 is 1 - 0.51, whatever the last digit says."""
    assert tolerance.needed(0, 0.7, 0.51) == 2 and tolerance.needed(0, 0.5, 0.5) == 1
    assert not tolerance.fails(2, 2, 0.3, 0.51) and tolerance.fails(2, 2, 0.3, 0.5)


def test_verdicts_are_those_of_the_bounds():
    """pass: lower bound not below what is stated; fail: upper bound below it."""
    for p, c in ((0.95, 0.9), (0.8, 0.6), (0.5, 0.95)):
        for n in (1, 5, 40, 200):
            for f in range(n + 1):
                least, most = tolerance.bounds(f, n, c)
                assert tolerance.passes(f, n, p, c) == (least >= p)
                assert tolerance.fails(f, n, p, c) == (most < p)
                assert least == pytest.approx(stats.beta.ppf(1.0 - c, n - f, f + 1) if f < n else 0.0)
                assert most == pytest.approx(stats.beta.ppf(c, n - f + 1, f) if f else 1.0)


def test_a_verdict_of_a_settled_number_is_wrong_as_seldom_as_it_says():
    """Summed over every outcome, with the probability that is just allowed."""
    for p, c, n in ((0.99865, 0.9, 1705), (0.95, 0.95, 100), (0.9, 0.5, 30)):
        weights = stats.binom.pmf(range(n + 1), n, 1.0 - p)
        for verdict in (tolerance.passes, tolerance.fails):
            chance = sum(w for f, w in enumerate(weights) if verdict(f, n, p, c))
            assert chance <= 1.0 - c + 1e-12


def test_at_the_rate_so_far():
    stated = 0.99865, 0.9
    assert tolerance.at_rate(0, 400, *stated) == 1705
    total = tolerance.at_rate(1, 2000, *stated)  # 0.05 %: passes
    found = round(total / 2000)
    assert total == tolerance.needed(found, *stated) and total / 2000 <= found
    assert not tolerance.passes(math.ceil(found - 1), round((found - 1) * 2000), *stated)
    total = tolerance.at_rate(4, 2000, *stated)  # 0.2 %: fails
    assert tolerance.fails(round(total / 500), total, *stated)
    assert not tolerance.fails(round(total / 500) - 1, total - 500, *stated)
    assert tolerance.at_rate(27, 20000, *stated) is None  # 0.135 %: what is stated
