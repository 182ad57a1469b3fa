"""What a campaign says to people of each requirement: met often enough, or how many runs more it takes."""

from typing import NamedTuple

from shefex_nav.campaign import looks, tolerance, verdicts
from shefex_nav.campaign.summary import name_of

LOUD = (verdicts.FAIL,)  # cells that want attention


class Table(NamedTuple):
    """Title, heads (one that begins with '>' is of numbers), rows and lines below."""

    title: str
    heads: tuple
    rows: tuple
    lines: tuple


def table(campaign):
    """Table of the verdicts of a results.Campaign; None if nothing is required."""
    found = verdicts.of_campaign(campaign)
    if not found:
        return None
    probability, confidence = (percent(share) for share in (found[0].probability, found[0].confidence))
    heads = ("requirement", "verdict", ">runs", ">missed by", f">at least ({confidence})",
             f">at most ({confidence})", ">more at this rate")  # fmt: skip
    return Table(
        f"Is each requirement met in {probability} of the flights, at {confidence} confidence?",
        heads,
        tuple(_row(one) for one in found),
        tuple(_lines(campaign, found)),
    )


def percent(share):
    """A probability as it is stated: 99.865 %."""
    return f"{100.0 * share:.6g} %"


def _row(one):
    name = name_of(one.name)
    if one.verdict == verdicts.UNJUDGED:
        return name, one.verdict, *"-----"
    bounds = ("-" if share is None else f"{100.0 * share:.3f} %" for share in (one.least, one.most))
    words, at_rate = one.verdict, "-"
    if one.verdict == verdicts.MORE:
        words = "fails at the next look" if one.more is None else f"{one.more:,} more runs needed"
        at_rate = f"> {tolerance.FAR:,}" if one.more_at_rate is None else f"{one.more_at_rate:,}"
    return name, words, f"{one.runs:,}", str(one.missed), *bounds, at_rate


def _lines(campaign, found):
    """What one has to know to read the table."""
    if any(one.verdict == verdicts.MORE for one in found):
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
    if earlier := verdicts.looked_at_before(campaign, found):
        yield (
            f"The campaign was flown on from {', '.join(f'{runs:,}' for runs in earlier)} runs, after which "
            "the same verdict was possible: its confidence is less than stated. Only the looks of "
            "`--until-verified` are counted."
        )


def _of_looks(campaign, found):
    """When it was looked at the campaign, and what the verdict is of."""
    stated, n = (found[0].probability, found[0].confidence), verdicts.complete(campaign.runs)
    taken = looks.until(*stated, n)
    after = "Looks were after " + ", ".join(f"{look.runs:,}" for look in taken) if taken else "No look yet"
    if any(one.verdict == verdicts.MORE for one in found):
        following = next(look for look in looks.each(*stated) if look.runs > n)
        after += f", the next is after {following.runs:,}"
    return (
        f"{after} runs; the first that decides gives the verdict. Its confidence is that of all looks "
        "together; the bounds are those of so many runs that were settled beforehand."
    )
