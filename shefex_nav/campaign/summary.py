"""What a campaign says to programs, and which of its runs to look at."""

from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import integrity, statistics, verdicts
from shefex_nav.report.requirements import in_words, name_of, severity, words

MOST_WORST = 3  # runs to look at


class Worst(NamedTuple):
    """A run to look at."""

    run: int
    severity: float
    words: str  # what it did not meet, or came nearest to missing


def summary_object(campaign):
    """The object that `campaign --json` and `report DIR --json` print: plain dict, ready for JSON."""
    succeeded, verified = int(campaign.succeeded.sum()), verdicts.summary(campaign)
    return of_nothing(campaign.head, len(campaign.lost), campaign.digest) | {
        "runs": len(campaign),
        "succeeded": succeeded,
        "failed": len(campaign) - succeeded,
        "requirements": [
            _requirement(one) | {"verification": verified[one.name]} for one in statistics.successes(campaign)
        ],
        "integrity": integrity.summary(campaign),
        "wall_s": campaign.wall_s,
    }


def _requirement(success):
    """A statistics.Success, without what is not measured."""
    found = success._asdict() | {"ci95": None if success.ci95 is None else list(success.ci95)}
    del found["without"]
    return found


def of_nothing(head, lost, digest):
    """The same of a campaign that has no run. head : of campaign.json, lost : how many runs were lost"""
    return {
        "scenario": head["scenario"],
        "seed": head["seed"],
        "runs": 0,
        "asked": head["runs"],
        "lost": lost,
        "succeeded": 0,
        "failed": 0,
        "requirements": [],
        "integrity": [],
        "wall_s": head["wall_s"] or None,
        "results_digest": digest,
    }


def worst_runs(campaign, k=MOST_WORST):
    """The k succeeded runs that met the fewest requirements, or came nearest to the limits: list of Worst.

    Among equals, and without any requirements, those with the largest rms attitude error.
    """
    runs, severity = campaign.runs[campaign.succeeded], campaign.judgements.severity
    rms_deg = campaign.numbers("summary.navigation.attitude_error_deg.rms")[campaign.succeeded]
    first = np.lexsort((runs, -np.nan_to_num(rms_deg), -severity))[:k].tolist()
    judged = campaign.judged(runs[first].tolist())
    return [Worst(int(runs[j]), float(severity[j]), _why(judged[int(runs[j])], rms_deg[j])) for j in first]


def _why(judged, rms_deg):
    """What a run missed, or what it came nearest to missing; without requirements its attitude error."""
    if not any(one.judgeable for one in judged):
        what = "nothing that is required can be judged" if judged else "the scenario requires nothing"
        return f"attitude error {rms_deg:.3g} deg rms; {what}"
    judged = [one for one in judged if one.judgeable]
    missed = [one for one in judged if not one.passed]
    nearest = sorted(judged, key=lambda one: -severity([one]))[:1]
    found = "; ".join(
        f"{name_of(one.name)} {in_words(one)}, wanted {words(one.name, one.required, one.unit)}"
        for one in missed or nearest
    )
    return f"misses {found}" if missed else f"meets all requirements; nearest to its limit: {found}"


def repeat(campaign, run):
    """The command that flies a run again."""
    return f"shefex-nav repeat {campaign.folder} {run} --log run{run}.mcap"
