"""Differences of two samples of the same seeds: values, intervals, verdicts that chance seldom gives."""

import numpy as np
import pytest
from scipy import stats

from shefex_nav.campaign.compare import paired
from shefex_nav.campaign.compare.quantities import QUANTITIES
from shefex_nav.report.requirements import figures_of

RUNS = 8


def test_mean_and_student_s_interval_of_the_pairs():
    a, b = np.array([1.0, 2.0, 5.0, 4.0]), np.array([2.0, 2.5, 7.0, 4.5])
    found = paired.difference(a, b)
    low, high = stats.ttest_rel(b, a).confidence_interval(0.95)
    assert (found.mean, found.low, found.high) == pytest.approx((1.0, low, high))
    assert (found.n, found.better, found.worse) == (4, 0, 4)
    assert (found.verdict, found.why) == (paired.OPEN, "only 4 pairs")


def test_what_is_better():
    a = np.arange(10.0)
    b = a + 1.0 + 0.01 * np.cos(a)
    assert paired.difference(a, b).verdict == paired.A_BETTER
    assert paired.difference(b, a).verdict == paired.B_BETTER
    assert paired.difference(a, b, larger_is_better=True).verdict == paired.B_BETTER
    assert paired.difference(a, b, larger_is_better=True).better == 10


@pytest.mark.parametrize(("n", "verdicts"), [(5, {paired.OPEN}), (6, {paired.A_BETTER, paired.B_BETTER})])
def test_fewer_than_six_pairs_prove_nothing(n, verdicts):
    """Differences of one size and either sign: Student's interval of two pairs is without 0 half the time."""
    rng = np.random.default_rng(4)
    signs, size = np.sign(rng.normal(size=(200, 2))), 1.0 + 0.01 * rng.normal(size=(200, 2))
    without = [stats.ttest_1samp(row, 0.0).pvalue < 0.05 for row in signs * size]
    assert 0.4 < np.mean(without) < 0.6
    a = np.arange(float(n))
    b = a + 1.0 + 0.01 * np.cos(a)
    found = {paired.difference(a, b).verdict, paired.difference(b, a).verdict}
    found |= {paired.share_difference([True] * n, [False] * n, good=good).verdict for good in (True, False)}
    assert found == verdicts


def test_certain_but_of_no_size_is_equal():
    """1.2e-7 m/s in each pair, of 0.02 m/s; a hundredth of the figures is better, as ever."""
    rng = np.random.default_rng(8)
    a = rng.uniform(0.015, 0.025, RUNS)
    tiny = a - 1.2e-7 * rng.uniform(0.9, 1.1, RUNS)
    assert paired.difference(a, tiny).verdict == paired.EQUAL and paired.difference(a, tiny).high < 0.0
    assert paired.difference(a, a - 2e-4 * rng.uniform(0.9, 1.1, RUNS)).verdict == paired.B_BETTER


def test_pairs_see_what_runs_alone_do_not():
    """One noise in both of a seed goes out of the difference."""
    rng = np.random.default_rng(5)
    a = rng.normal(100.0, 30.0, RUNS)
    b = a + 1.0 + 0.3 * rng.normal(size=RUNS)
    assert stats.ttest_ind(a, b).pvalue > 0.5
    assert paired.difference(a, b).verdict == paired.A_BETTER


def test_the_same_is_zero_and_no_difference():
    a = np.random.default_rng(2).normal(size=RUNS)
    found = paired.difference(a, a)
    assert (found.mean, found.low, found.better, found.worse) == (0.0, None, 0, 0)
    assert found.verdict == paired.NOT_SEEN and not found.why


@pytest.mark.parametrize(
    ("b", "why"),
    [([2.0], "one pair"), ([2.0, 3.0, 4.0], "all differences are equal"), ([2.0, np.inf, 1.0], "not finite")],
)
def test_no_interval_no_verdict(b, why):
    found = paired.difference(np.arange(1.0, 1.0 + len(b)), np.array(b))
    assert found.verdict is None and found.low is None and why in found.why


def test_one_pair_without_a_difference_is_the_same_as_well():
    """One with a difference has no interval."""
    found = paired.difference([1.0], [1.0]), paired.share_difference([True], [True], good=True)
    assert [(one.verdict, one.low, one.why) for one in found] == [(paired.NOT_SEEN, None, "")] * 2
    assert paired.share_difference([True], [False], good=True).why == "one pair"


@pytest.mark.parametrize("law", ["normal", "lognormal", "student"])
def test_chance_alone_is_seldom_called_a_difference(law):
    """Two equal filters with a common and an own noise: 5 % of verdicts at most, about."""
    rng, trials, told = np.random.default_rng(31), 3000, 0
    draw = {
        "normal": lambda: rng.normal(size=RUNS),
        "lognormal": lambda: np.exp(rng.normal(size=RUNS)),
        "student": lambda: rng.standard_t(3, RUNS),
    }[law]
    for _ in range(trials):
        common = draw()
        told += paired.difference(common + draw(), common + draw()).verdict != paired.NOT_SEEN
    assert told / trials < 0.065


def test_how_often_something_happened():
    a = [True] * 10
    b = [False] * 6 + [True] * 4
    met = paired.share_difference(a, b, good=True)
    assert met.mean == pytest.approx(-0.6) and met.high < 0.0 and met.verdict == paired.A_BETTER
    failed = paired.share_difference(a, b, good=False)
    assert failed.verdict == paired.B_BETTER
    assert stats.binomtest(0, 6).pvalue < 0.05 < stats.binomtest(0, 5).pvalue  # McNemar's exact test
    five = paired.share_difference(a, [False] * 5 + [True] * 5, good=True)
    assert five.verdict == paired.NOT_SEEN  # the exact test, which is stricter than the interval
    half = 1.959964 * np.sqrt((7.0 / 12.0 - (5.0 / 12.0) ** 2) / 12.0)  # Bonett and Price
    assert (five.low, five.high) == pytest.approx((-5.0 / 12.0 - half, -5.0 / 12.0 + half))
    same = paired.share_difference(a, a, good=True)
    assert (same.mean, same.low, same.verdict) == (0.0, None, paired.NOT_SEEN)


@pytest.mark.parametrize("n", [20, 100])
@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_the_interval_of_a_difference_of_shares_covers_it(n, rho):
    """Exactly: the law of the pairs that differ, over all that can happen; 95 % is claimed."""
    only_a, only_b = (k.ravel() for k in np.indices((n + 1, n + 1)))
    only_a, only_b = (k[only_a + only_b <= n] for k in (only_a, only_b))
    bounds = np.array([_shares(*one, n) for one in zip(only_a.tolist(), only_b.tolist(), strict=True)])
    for p_a in (0.02, 0.07, 0.2, 0.5):
        for p_b in (0.02, 0.07, 0.2, 0.5):
            both = p_a * p_b + rho * np.sqrt(p_a * (1.0 - p_a) * p_b * (1.0 - p_b))
            if both > min(p_a, p_b):
                continue  # no two shares are so correlated
            law = [p_a - both, p_b - both, 1.0 - p_a - p_b + 2.0 * both]
            chance = stats.multinomial.pmf(np.stack([only_a, only_b, n - only_a - only_b], axis=1), n, law)
            covered = (bounds[:, 0] <= p_b - p_a + 1e-12) & (p_b - p_a - 1e-12 <= bounds[:, 1])
            assert chance @ covered > 0.93, (p_a, p_b)


def _shares(only_a, only_b, n):
    """Interval that is told; without one, of pairs that are all equal, what says least."""
    a = [True] * only_a + [False] * (n - only_a)
    b = [False] * only_a + [True] * only_b + [False] * (n - only_a - only_b)
    found = paired.share_difference(a, b, good=True)
    return (-1.0, 1.0) if found.low is None else (found.low, found.high)


def test_a_share_has_the_interval_of_clopper_and_pearson():
    interval = stats.binomtest(7, 10).proportion_ci(0.95, "exact")
    found = paired.share([True] * 7 + [False] * 3)
    assert (found.k, found.n) == (7, 10)
    assert (found.low, found.high) == pytest.approx((interval.low, interval.high))


def test_samples():
    found = paired.sample([3.0, 4.0, 5.0])
    assert (found.n, found.median, found.mean) == (3, 4.0, 4.0)
    assert found.rms == pytest.approx(np.sqrt(50.0 / 3.0))


def test_nees_is_compared_by_its_distance_from_what_it_should_be():
    nees = next(one for one in QUANTITIES if one.name.startswith("NEES"))
    assert nees.compared(9.0) == 0.0
    assert nees.compared(18.0) == pytest.approx(nees.compared(4.5)) == pytest.approx(np.log(2.0))


def test_figures_come_out_of_a_summary():
    summary = {
        "navigation": {
            "at_entry": {"position_error_m": 3.0, "attitude_error_deg": [0.3, -0.4, 0.0]},
            "star_phase": {"attitude_rms_deg": 0.01},
            "integrity": {"misleading_share": 0.02, "usable_share": 0.5},
        },
        "star_tracker": {"solved": 9, "in_window": 10},
        "wall_s": 20.0,
        "simulated_s": 100.0,
    }
    found = {one.name: one.figure(figures_of(summary)) for one in QUANTITIES}
    assert found["position at entry"] == 3.0 and found["attitude at entry, size"] == pytest.approx(0.5)
    assert found["attitude, rms of the star phase"] == 0.01
    assert found["misleading, of the time"] == pytest.approx(2.0)
    assert found["star fixes of the window"] == pytest.approx(90.0)
    assert found["time per tick, with the simulator"] == pytest.approx(2.0)
    assert found["velocity at entry"] is None
