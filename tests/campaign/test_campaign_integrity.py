"""Events beyond protection levels, counted per hour of use against the stated risk."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm, poisson

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
