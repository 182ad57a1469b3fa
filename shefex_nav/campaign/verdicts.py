"""Whether a campaign shows that each requirement is met in `requirements.probability` of the flights.

What counts as a flight: every run that is done. One that failed, never had the figure or gave no protection
level does not meet the requirement: it gave no answer. A run that was not flown, or was lost with its worker,
is no sample.

A campaign of a settled number of runs is judged once, of all its runs (`tolerance`); one that flies on until
it is verified at its looks (`looks`), of the first so many runs by their number: what is decided follows from
the runs that are kept, in whatever order and in however many sessions they were flown.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import looks, tolerance
from shefex_nav.campaign.tables import Bold, Part
from shefex_nav.report.requirements import name_of

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
    if n == 0:
        return Verdict(name, MORE, *wanted, 0, 0, None, None, tolerance.needed(0, *wanted))
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
    ahead = next(look for look in looks.each(*wanted) if look.runs > n and decided(look, f))
    more = ahead.runs - n if decided(ahead, f) == PASS else None
    rate = f / n if n else 0.0
    at_rate = _until(wanted, n, lambda look: decided(look, max(f, round(rate * look.runs))) is not None)
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


def _until(wanted, n, ends):
    """Further runs after n until the first look of which `ends` holds; None beyond FAR runs."""
    for look in looks.each(*wanted):
        if look.runs > max(n, tolerance.FAR):
            return None
        if look.runs > n and ends(look):
            return look.runs - n


def summary(campaign):
    """The same for `--json`: {name: dict}, with what takes from the confidence that is told.

    finished : whether all runs are there whose number was settled, or it was judged at looks
    flown_on_from : of `looked_at_before`
    """
    found = of_campaign(campaign)
    whole = {
        "finished": bool(campaign.head.get("until_verified")) or len(campaign) >= campaign.head["runs"],
        "flown_on_from": looked_at_before(campaign, found) if found else [],
    }
    return {
        one.name: {key: value for key, value in one._asdict().items() if key != "name"} | whole
        for one in found
    }


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


def part(campaign):
    """tables.Part for people: whether each requirement is met as often as is stated; None without any."""
    found = of_campaign(campaign)
    if not found:
        return None
    probability, confidence = (
        f"{100.0 * share:.6g} %" for share in (found[0].probability, found[0].confidence)
    )
    heads = ("requirement", "verdict", ">runs", ">missed by", f">at least ({confidence})",
             f">at most ({confidence})", ">more at this rate")  # fmt: skip
    return Part(
        f"Is each requirement met in {probability} of the flights, at {confidence} confidence?",
        heads,
        tuple(_row(one) for one in found),
        tuple(_lines(campaign, found)),
    )


def _row(one):
    name, words, at_rate = name_of(one.name), one.verdict, "-"
    if one.verdict == UNJUDGED:
        return name, words, *"-----"
    bounds = ("-" if share is None else f"{100.0 * share:.3f} %" for share in (one.least, one.most))
    if one.verdict == MORE:
        words = "fails at the next look" if one.more is None else f"{one.more:,} more runs needed"
        at_rate = f"> {tolerance.FAR:,}" if one.more_at_rate is None else f"{one.more_at_rate:,}"
    words = Bold(words) if one.verdict == FAIL else words
    return name, words, f"{one.runs:,}", str(one.missed), *bounds, at_rate


def _lines(campaign, found):
    """What one has to know to read the table."""
    if any(one.verdict == MORE for one in found):
        yield (
            "More runs needed: until it passes, if all of them meet the requirement. At this rate: until it "
            "passes or fails, if it is missed as often as so far."
        )
    failed = len(campaign) - int(campaign.succeeded.sum())
    if failed:
        yield f"Runs that failed: {failed}. They gave no answer and meet no requirement."
    if campaign.lost:
        yield f"Runs that were lost with their workers: {len(campaign.lost)}. They are no samples."
    if campaign.head.get("flight") == "shared":
        yield "All runs have one and the same flight: what is shown is shown of this flight alone."
    if campaign.head.get("sampling") == "latin_hypercube":
        yield "The draws are a Latin hypercube, not independent: bounds and verdicts are approximate."
    n, asked = len(campaign), campaign.head["runs"]
    if campaign.head.get("until_verified"):
        yield _of_looks(campaign, found)
    elif n < asked:
        yield f"The campaign is not finished: a verdict counts when all of its {asked:,} runs are there."
    if earlier := looked_at_before(campaign, found):
        yield (
            f"The campaign was flown on from {', '.join(f'{runs:,}' for runs in earlier)} runs, after which "
            "the same verdict was possible: its confidence is less than stated. Only the looks of "
            "`--until-verified` are counted."
        )


def _of_looks(campaign, found):
    """When it was looked at the campaign, and what the verdict is of."""
    wanted, n = (found[0].probability, found[0].confidence), complete(campaign.runs)
    taken = looks.until(*wanted, n)
    after = "Looks were after " + ", ".join(f"{look.runs:,}" for look in taken) if taken else "No look yet"
    if any(one.verdict == MORE for one in found):
        following = next(look for look in looks.each(*wanted) if look.runs > n)
        after += f", the next is after {following.runs:,}"
    return (
        f"{after} runs; the first that decides gives the verdict. Its confidence is that of all looks "
        "together; the bounds are those of so many runs that were settled beforehand."
    )
