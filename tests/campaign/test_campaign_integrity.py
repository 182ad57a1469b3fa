"""Events beyond protection levels, counted per hour of use against the stated risk."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binomtest, norm, poisson

from shefex_nav.campaign import integrity
from shefex_nav.campaign.parts import trusted


def campaign(events, *, hours=1.0, risk=0.1, over=0.5, succeeded=True):
    """Runs with so many events of the position each; of velocity and attitude there is none."""
    n = len(events)
    columns = {"misleading_events": np.asarray(events, float), "usable_h": hours, "over_level": over}

    def numbers(name):
        quantity, figure = name.split(".")[-2:]
        value = 0.0 if figure == "misleading_events" and quantity != "position" else columns[figure]
        return np.broadcast_to(np.asarray(value, float), n).copy()

    return SimpleNamespace(
        numbers=numbers,
        runs=np.arange(n),
        succeeded=np.broadcast_to(succeeded, n),
        requirements=SimpleNamespace(integrity_risk=risk),
    )


@pytest.mark.parametrize("k", [0, 1, 3, 20])
def test_the_bounds_are_those_of_a_poisson_variable(k):
    """At the upper bound k or fewer come with 1 %, at the lower one k or more."""
    least, most = integrity.poisson(k, 0.99)
    assert poisson.cdf(k, most) == pytest.approx(0.01)
    assert (least == 0.0) if k == 0 else poisson.sf(k - 1, least) == pytest.approx(0.01)


def test_a_verdict_says_no_more_than_the_hours_do():
    def verdict(*args, **kwargs):
        return integrity.count(campaign(*args, **kwargs))[0].verdict

    assert verdict([0] * 46) == "not refuted"  # 46 hours: 4.605 / 46 > 0.1
    assert verdict([0] * 47) == "shown"
    assert verdict([1, *[0] * 9]) == "not refuted"
    assert verdict([2, *[0] * 9]) == "neither shown nor refuted"
    assert verdict([1] * 10) == "not kept"
    assert verdict([0] * 3, hours=0.0) == "never usable"


def test_runs_that_failed_count_neither_events_nor_hours():
    found = integrity.count(campaign([0, 5, 1], succeeded=np.array([True, False, True])))
    assert [(one.quantity, one.events, one.hours) for one in found] == [
        ("position", 1, 2.0), ("velocity", 0, 2.0), ("attitude", 0, 2.0),
    ]  # fmt: skip
    title, rows = trusted(campaign([1] * 10)).title, trusted(campaign([1] * 10)).rows
    assert title == "Integrity risk" and rows[0][5] == "not kept" and rows[1][5] == "not refuted"


def test_the_extrapolated_tail_of_normal_errors():
    """Levels that normal errors exceed with a known, small rate: the tail comes within a factor of ten."""
    rng, k, samples = np.random.default_rng(11), 5.5, 100
    over = np.abs(rng.standard_normal((3000, samples))).max(axis=1) / k
    rate, most = integrity.extrapolated(over, np.ones(3000))
    true = samples * 2.0 * norm.sf(k)
    assert over.max() < 1.0 and 0.1 * true < rate < 10.0 * true and most > rate


@pytest.mark.parametrize("at_once", [1, 3, 10])
def test_events_of_a_run_that_come_together_are_not_counted_as_if_alone(at_once):
    """As Poisson's the bounds of three runs in a thousand with ten events each held 80 % in place of 99 %."""
    rng, held, tries = np.random.default_rng(5), np.zeros(2, int), 1000
    for _ in range(tries):
        one = integrity.count(campaign(at_once * (rng.random(1000) < 3e-3)))[0]
        held += (one.least <= 3e-3 * at_once, not one.events or one.most >= 3e-3 * at_once)
    assert all(binomtest(int(k), tries, 0.99, alternative="less").pvalue > 1e-3 for k in held)


@pytest.mark.parametrize("runs", [20, 200, 1000])
def test_the_bound_of_the_extrapolated_tail_holds(runs):
    """Of squares that are Gumbel's; a bootstrap of 20 runs held 81 % in place of 99 %."""
    rng, tries = np.random.default_rng(6), 1000
    true = np.exp((0.3 - 1.0) / 0.06)
    tails = (np.sqrt(np.maximum(rng.gumbel(0.3, 0.06, runs), 0.0)) for _ in range(tries))
    held = sum(integrity.extrapolated(over, np.ones(runs))[1] >= true for over in tails)
    assert binomtest(held, tries, 0.99, alternative="less").pvalue > 1e-3
    assert integrity.extrapolated(np.full(runs, 0.5), np.ones(runs)) == (None, None)
