"""Confidence intervals: published values, and whether they cover the truth as often as they say."""

import numpy as np
import pytest
from scipy import stats

from shefex_nav.report import intervals


def test_clopper_pearson_has_the_published_ends():
    # Closed forms: 0 of n ends at 1 - (alpha/2)^(1/n), n of n begins at (alpha/2)^(1/n); in between,
    # P(X >= k | low) = P(X <= k | high) = alpha/2 defines the ends.
    assert intervals.proportion(0, 10) == pytest.approx((0.0, 0.3085), abs=5e-5)
    assert intervals.proportion(10, 10) == pytest.approx((0.6915, 1.0), abs=5e-5)
    low, high = intervals.proportion(97, 100)
    assert stats.binom.sf(96, 100, low) == pytest.approx(0.025, rel=1e-6)
    assert stats.binom.cdf(97, 100, high) == pytest.approx(0.025, rel=1e-6)


@pytest.mark.parametrize("p", [0.001, 0.03, 0.5, 0.97])
def test_proportion_covers_for_every_outcome(p):
    n = 200
    k = np.arange(n + 1)
    inside = [low <= p <= high for low, high in (intervals.proportion(int(i), n) for i in k)]
    coverage = stats.binom.pmf(k, n, p)[inside].sum()  # exact, no sampling
    assert 0.95 <= coverage < 1.0


@pytest.mark.parametrize("bad", [1, 3, 10])
def test_a_share_of_frames_that_few_runs_lack_is_covered(bad):
    """Of 300 runs some lose 10 of 1000 frames each: Student's interval of the ratio held 85 % with three."""
    rng, n, tries, covered = np.random.default_rng(3), 300, 2000, 0
    wholes, truth = np.full(n, 1000.0), 1.0 - 0.01 * bad / n
    for _ in range(tries):
        low, high = intervals.clustered(wholes - 10.0 * (rng.random(n) < bad / n), wholes)
        covered += low <= truth <= high
    # of none that loses any, what a run would lose is not known: 5 % of the campaigns of three, 37 % of one
    without = (1.0 - bad / n) ** n
    assert covered / tries > (0.95 - 3.0 * np.sqrt(0.95 * 0.05 / tries)) * (1.0 - without)


def test_clusters_that_have_nothing_in_common_are_single_trials():
    assert intervals.clustered([4.0] * 6, [50.0] * 6) == pytest.approx(intervals.proportion(24, 300))
    assert intervals.clustered([0.0] * 6, [50.0] * 6) == pytest.approx(intervals.proportion(0, 300))
    # all of one cluster of ten: as one of ten, less what ten do not know of their variance
    low, high = intervals.clustered([0.0] * 9 + [100.0], [100.0] * 10)
    trials = 9.0 * (stats.t.ppf(0.025, 999) / stats.t.ppf(0.025, 9)) ** 2
    assert (low, high) == pytest.approx(
        (
            stats.beta.ppf(0.025, 0.1 * trials, 0.9 * trials + 1.0),
            stats.beta.ppf(0.975, 0.1 * trials + 1.0, 0.9 * trials),
        )
    )
    with pytest.raises(ValueError, match="among wholes"):
        intervals.clustered([5.0, 1.0], [4.0, 4.0])


@pytest.mark.parametrize("q", [50.0, 97.5])
def test_percentile_covers_whatever_the_distribution(q):
    rng = np.random.default_rng(11)
    n, tries = 400, 2000
    truth = stats.expon.ppf(q / 100.0)
    covered = 0
    for _ in range(tries):
        low, high = intervals.percentile(rng.exponential(size=n), q)
        covered += low <= truth <= high
    # 95 % is promised, steps between order statistics give a little more; 3 sigma of the binomial below
    assert 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / tries) < covered / tries < 0.99


def test_percentile_of_a_small_sample_says_how_many_it_needs():
    n = intervals.values_needed(97.5)
    assert 0.975**n <= 0.025 < 0.975 ** (n - 1)
    assert intervals.percentile([3.0, 1.0, 2.0], 97.5) == (2.0, 3.0)


@pytest.mark.parametrize("draw", [lambda r, n: r.normal(size=n), lambda r, n: r.laplace(size=n) / np.sqrt(2)])
def test_rms_covers_normal_and_heavy_tailed_errors(draw):
    rng = np.random.default_rng(12)
    tries = 2000
    covered = 0
    for _ in range(tries):
        low, high = intervals.rms(draw(rng, 300))
        covered += low <= 1.0 <= high  # both have unit variance
    assert 0.92 < covered / tries < 0.97


@pytest.mark.parametrize("n", [3, 8, 20, 200])
@pytest.mark.parametrize("dof", [3, 30])
def test_the_mean_of_squares_is_covered_at_both_ends(n, dof):
    """Of chi-square over its degrees of freedom; Student's ends lie below 1 in 3.4 % in place of 0.5 %."""
    tries = 4000
    ends = [
        intervals.mean_square(one, 0.99) for one in np.random.default_rng(14).chisquare(dof, (tries, n)) / dof
    ]
    low, high = np.transpose(ends)
    assert stats.binomtest(int((low > 1.0).sum()), tries, 0.006, alternative="greater").pvalue > 1e-3
    assert stats.binomtest(int((high < 1.0).sum()), tries, 0.006, alternative="greater").pvalue > 1e-3
    if n > 3:  # of three the ends are so far away that none is missed
        assert ((low > 1.0) | (high < 1.0)).mean() > 0.005


def test_the_mean_of_many_squares_has_student_s_interval():
    squares = np.random.default_rng(15).chisquare(9.0, 20_000) / 9.0
    assert intervals.mean_square(squares) == pytest.approx(intervals.mean(squares), abs=1e-4)
    assert intervals.mean_square([1.5]) == (0.0, np.inf) and intervals.mean_square([1.5, 1.5]) == (1.5, 1.5)


@pytest.mark.parametrize("n", [3, 5, 10, 20])
def test_rms_of_few_normal_errors_is_covered(n):
    """With Student's interval of the squares it was in 81 % of five errors, in 90 % of twenty."""
    rng, tries = np.random.default_rng(16), 2000
    ends = [intervals.rms(rng.normal(size=n)) for _ in range(tries)]
    covered = sum(low <= 1.0 <= high for low, high in ends)
    assert stats.binomtest(covered, tries, 0.92, alternative="less").pvalue > 1e-3


def test_mean_and_bootstrap_agree_where_both_apply():
    rng = np.random.default_rng(13)
    values = rng.gamma(3.0, size=500)
    low, high = intervals.mean(values)
    width = high - low
    b_low, b_high = intervals.bootstrap(np.mean, [values], np.random.default_rng(1), resamples=2000)
    assert b_low == pytest.approx(low, abs=0.1 * width)
    assert b_high == pytest.approx(high, abs=0.1 * width)


def test_one_value_says_nothing_of_its_scatter():
    assert intervals.mean([3.0]) == (-np.inf, np.inf)
    assert intervals.rms([3.0]) == (0.0, np.inf)


def test_bootstrap_keeps_rows_together():
    x = np.arange(100.0)
    interval = intervals.bootstrap(
        lambda a, b: float(np.max(np.abs(a - b))), [x, x], np.random.default_rng(2), resamples=20
    )
    assert interval == (0.0, 0.0)


@pytest.mark.parametrize(
    "call",
    [
        lambda: intervals.proportion(3, 2),
        lambda: intervals.proportion(0, 0),
        lambda: intervals.percentile([], 50.0),
        lambda: intervals.mean([np.nan, 1.0]),
    ],
)
def test_nonsense_is_refused(call):
    with pytest.raises(ValueError):
        call()


def test_mean_square_of_clusters_covers():
    """30 frames of 10 errors that share half of their variance: 95 % hold where those of 300 hold fewer."""
    rng, tries, n, m = np.random.default_rng(21), 400, 30, 10
    own, shared = rng.standard_normal((tries, n, m)), rng.standard_normal((tries, n, 1))
    squares = 0.5 * (own + shared) ** 2
    counts = np.full(n, float(m))
    held = [low <= 1.0 <= high for low, high in
            (intervals.mean_square_clustered(one.sum(axis=1), counts) for one in squares)]  # fmt: skip
    naive = [low <= 1.0 <= high for low, high in (intervals.mean_square(one.ravel()) for one in squares)]
    assert np.mean(held) > 0.92 and np.mean(naive) < 0.8
    one = squares[0].ravel()
    alike = intervals.mean_square_clustered(one, np.ones(len(one)))
    assert alike == pytest.approx(intervals.mean_square(one), rel=1e-12)
    assert intervals.mean_square_clustered([3.0], [2.0]) == (0.0, np.inf)
    assert intervals.mean_square_clustered([3.0, 1.5], [2.0, 1.0]) == (1.5, 1.5)
