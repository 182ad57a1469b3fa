"""The stopping rule of campaigns that fly until verified: how often it is wrong, and when it stops."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from shefex_nav.campaign import looks, tolerance, verdicts

STATED = [(0.99865, 0.9), (0.95, 0.95), (0.9, 0.9), (0.5, 0.6)]
BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
PROCEDURES = 20_000
SURE = 1.0 - 1e-6  # of an interval of a simulated share


@pytest.fixture
def simulated(monkeypatch):
    """Verdicts of many procedures with looks up to so many runs: (pass, fail) numbers, and mean runs."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    from stopping_rule import procedures

    def flown(stated, share, runs, seed):
        return procedures(looks.until(*stated, runs), share, PROCEDURES, np.random.default_rng(seed))

    return flown


def interval(k):
    """Interval of a share of the procedures."""
    low = stats.beta.ppf(0.5 * (1 - SURE), k, PROCEDURES - k + 1)
    return low, stats.beta.ppf(0.5 * (1 + SURE), k + 1, PROCEDURES - k)


@pytest.mark.parametrize("stated", STATED)
def test_a_false_pass_is_as_rare_as_stated_and_hardly_rarer(stated, simulated):
    """True probability just below what is stated. The risk is meant to be used, else it costs runs."""
    p, c = stated
    runs = next(look.runs for look in looks.each(*stated) if (look.passes or 0) >= 16)
    passed, failed, _ = simulated(stated, (1.0 - p) * 1.0005, runs, 1)
    low, high = interval(passed)
    assert low <= 1.0 - c
    assert high >= 0.9 * (1.0 - c)
    low, _ = interval(failed)
    assert failed > 0 and low <= 1.0 - c  # the same probability is just about that of a false fail


def test_each_look_spends_what_it_is_meant_to():
    """Without failing, the share that has passed by look k is 1 - 1/2^k of the risk: by simulation."""
    p, c = stated = 0.95, 0.95
    rng, missed, open_ones = np.random.default_rng(3), np.zeros(PROCEDURES, int), np.ones(PROCEDURES, bool)
    before, k = 0, 0
    for look in looks.until(*stated, 700):
        missed += rng.binomial(look.runs - before, 1.0 - p, PROCEDURES)
        before = look.runs
        if look.passes is None:
            continue
        k += 1
        open_ones &= missed > look.passes
        low, high = interval(PROCEDURES - int(open_ones.sum()))
        spent = (1.0 - c) * (1.0 - 0.5**k)
        assert low <= spent and high >= 0.9 * spent
    assert k == 6


def test_naive_looks_are_wrong_more_often():
    """Whoever flies on to the next number that would pass: a simulation like the others sees that."""
    p, c = stated = 0.95, 0.95
    rng, missed, before = np.random.default_rng(4), np.zeros(PROCEDURES, int), 0
    passed = np.zeros(PROCEDURES, bool)
    for failures in range(30):
        n = tolerance.needed(failures, *stated)
        missed += rng.binomial(n - before, 1.0 - p, PROCEDURES)
        before = n
        passed |= missed <= failures
    low, _ = interval(int(passed.sum()))
    assert low > 2.0 * (1.0 - c)


@pytest.mark.parametrize("stated", STATED)
def test_looks_grow_and_leave_room_between_pass_and_fail(stated):
    plan = looks.until(*stated, 20_000)
    first = looks.first_pass(*stated)
    assert tolerance.at_most(0, first, 1.0 - stated[0]) <= 0.5 * (1.0 - stated[1])
    assert tolerance.at_most(0, first - 1, 1.0 - stated[0]) > 0.5 * (1.0 - stated[1])
    for before, after in pairwise(plan):
        assert before.runs < after.runs <= 2.5 * before.runs
    for look in plan:
        if look.passes is not None and look.fails is not None:
            assert look.passes < (1.0 - stated[0]) * look.runs < look.fails


def test_more_often_met_than_stated_passes_and_less_often_fails(simulated):
    stated = 0.99865, 0.9
    passed, failed, runs = simulated(stated, 0.1 * 0.00135, 30_000, 5)
    assert passed > 0.99 * PROCEDURES and 2218 < runs < 3000
    passed, failed, runs = simulated(stated, 10.0 * 0.00135, 30_000, 6)
    assert failed > 0.99 * PROCEDURES and runs < 500


def test_the_verdict_of_a_campaign_is_this_rule():
    """Bernoulli runs, one by one, through the function that judges a campaign: as looks say of their sums."""
    stated, most, rng = (0.9, 0.9), 200, np.random.default_rng(7)
    seen = set()
    for _ in range(300):
        met = rng.random(most) < rng.choice([0.7, 0.9, 0.97])
        found = verdicts.at_looks("one", stated, np.arange(most), met)
        expected = verdicts.MORE, most
        for look in looks.until(*stated, most):
            missed = int((~met[: look.runs]).sum())
            if look.passes is not None and missed <= look.passes:
                expected = verdicts.PASS, look.runs
                break
            if look.fails is not None and missed >= look.fails:
                expected = verdicts.FAIL, look.runs
                break
        assert (found.verdict, found.runs) == expected
        assert found.missed == int((~met[: found.runs]).sum())
        seen.add(found.verdict)
    assert seen == {verdicts.PASS, verdicts.FAIL, verdicts.MORE}
