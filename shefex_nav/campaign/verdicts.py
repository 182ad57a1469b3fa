"""Whether a campaign shows that each requirement is met in `requirements.probability` of the flights.

What counts as a flight: every run that is done. One that failed, never had the figure or gave no protection
level does not meet the requirement: it gave no answer. A run that was not flown, or was lost with its worker,
is no sample.

A campaign of a settled number of runs is judged once, of all its runs (`tolerance`); one that flies on until
it is verified at its looks (`looks`), of the first so many runs by their number: what is decided follows from
the runs that are kept, in whatever order and in however many sessions they were flown.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import looks, tolerance

PASS, FAIL, MORE, UNJUDGED = "pass", "fail", "more runs needed", "not judged"


class Verdict(NamedTuple):
    """What a campaign shows of one requirement."""

    name: str
    verdict: str  # pass, fail, more runs needed, not judged
    probability: float  # required
    confidence: float  # of the verdict
    runs: int  # that it is made of
    missed: int  # of these, runs that did not meet the requirement
    least: float | None  # one-sided bounds of the probability that it is met, of these runs alone
    most: float | None
    more: int | None = None  # further runs, all meeting it, until it passes; None: decided, or not judged
    more_at_rate: int | None = None  # until it passes or fails if missed as often as so far; None: also far
    looks: int | None = None  # at which the campaign was looked at; None: its number of runs was settled


def of_campaign(campaign):
    """Verdict of each requirement: list, in their order. results.Campaign"""
    wanted, met = stated(campaign.requirements), _met(campaign)
    judge = at_looks if campaign.head.get("until_verified") else settled
    return [
        Verdict(name, UNJUDGED, *wanted, len(campaign), 0, None, None)
        if column is None
        else judge(name, wanted, campaign.runs, column)
        for name, column in zip(campaign.judgements.names, met, strict=True)
    ]


def stated(requirements):
    """(probability, confidence) of a scenario's requirements, without the last digits of a conversion."""
    return tuple(float(f"{share:.12g}") for share in (requirements.probability, requirements.confidence))


def _met(campaign):
    """Whether each run met each requirement: list of (N,) bool, or None of one that cannot be judged."""
    found, good, result = campaign.judgements, campaign.succeeded, []
    for k in range(len(found.names)):
        column = np.zeros(len(campaign), bool)
        column[good] = found.passed[:, k]
        judged = not good.any() or found.judgeable[:, k].any()
        result.append(column if judged else None)
    return result


def settled(name, wanted, runs, met):
    """Verdict of all runs, whose number was settled before. Arguments as of `at_looks`."""
    n, missed = len(met), int((~met).sum())
    one = Verdict(name, MORE, *wanted, n, missed, *tolerance.bounds(missed, n, wanted[1]))
    if tolerance.passes(missed, n, *wanted):
        return one._replace(verdict=PASS)
    if tolerance.fails(missed, n, *wanted):
        return one._replace(verdict=FAIL)
    total = tolerance.at_rate(missed, n, *wanted)
    return one._replace(
        more=tolerance.needed(missed, *wanted) - n, more_at_rate=None if total is None else total - n
    )


def at_looks(name, wanted, runs, met):
    """Verdict of the first look that decides, else of all that is there.

    Parameters
    ----------
    name : of the requirement
    wanted : (probability, confidence) as of `stated`
    runs : (N,) numbers of the runs that are done, sorted
    met : (N,) bool, whether each met the requirement
    """
    n = complete(runs)
    missed = np.concatenate([[0], np.cumsum(~met[:n])])
    taken = looks.until(*wanted, n)
    for k, look in enumerate(taken):
        f = int(missed[look.runs])
        verdict = decided(look, f)
        if verdict is not None:
            bounds = tolerance.bounds(f, look.runs, wanted[1])
            return Verdict(name, verdict, *wanted, look.runs, f, *bounds, looks=k + 1)
    f = int(missed[n])
    bounds = tolerance.bounds(f, n, wanted[1]) if n else (None, None)
    more = _until(wanted, n, lambda look: decided(look, f) == PASS, math.inf)
    rate = f / n if n else 0.0
    at_rate = _until(wanted, n, lambda look: decided(look, round(rate * look.runs)) is not None)
    return Verdict(name, MORE, *wanted, n, f, *bounds, more, at_rate, len(taken))


def complete(runs):
    """How many of the first runs are there without a gap. runs : (N,) numbers of runs, sorted"""
    return int((runs == np.arange(len(runs))).sum())


def decided(look, missed):
    """pass, fail or None of a requirement that so many runs of a look missed."""
    if look.passes is not None and missed <= look.passes:
        return PASS
    if look.fails is not None and missed >= look.fails:
        return FAIL
    return None


def _until(wanted, n, ends, most=tolerance.FAR):
    """Further runs after n until the first look of which `ends` holds; None beyond `most` runs."""
    for look in looks.each(*wanted):
        if look.runs > max(n, most):
            return None
        if look.runs > n and ends(look):
            return look.runs - n


def summary(campaign):
    """The same for `--json`: {name: dict}."""
    return {one.name: {key: value for key, value in one._asdict().items() if key != "name"}
            for one in of_campaign(campaign)}  # fmt: skip


def looked_at_before(campaign, found):
    """Settled numbers of runs at which a campaign that was flown on could have ended with the same verdict.

    Whoever flies on until a requirement passes has more than one chance to see it pass by luck. -> list
    """
    before, kinds = campaign.head.get("asked_before", []), {one.verdict for one in found}
    if FAIL in kinds:  # a single run that misses it can do so
        return before
    if PASS in kinds:
        one = found[0]
        return [runs for runs in before if tolerance.passes(0, runs, one.probability, one.confidence)]
    return []
