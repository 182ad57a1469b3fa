"""A campaign that flies on from look to look until each of its requirements is verified, or refuted.

Looks and what they decide are settled beforehand (`looks`), and a verdict is made of the runs that are kept:
a session that is killed changes neither. From one look to the next it is a campaign like any other.
"""

from itertools import pairwise
from typing import NamedTuple

from shefex_nav.campaign import looks, results, running, verdicts
from shefex_nav.campaign.running import BadCampaign
from shefex_nav.report import requirements
from shefex_nav.scenario.laws import TableLaw


class Flown(NamedTuple):
    """A campaign that was flown until its requirements were decided, or stopped before."""

    ended: running.Ended
    verdicts: tuple  # of verdicts.Verdict; () without any run
    asked: int  # runs of the last look that was flown to
    next_look: int | None  # runs of the one after it; None: there is nothing left to decide

    @property
    def all_pass(self):
        """Whether every requirement passes."""
        return bool(self.verdicts) and all(one.verdict == verdicts.PASS for one in self.verdicts)


def checked(request):
    """The request with the most runs that there may be, None for any number; BadCampaign.

    request : Request, its `runs` None where no maximum is wanted
    """
    given = 1 if request.runs is None else request.runs
    wanted = running.checked(request._replace(runs=given, until_verified=True))
    scenario = request.scenario
    if not requirements.limits(scenario.requirements):
        raise BadCampaign("the scenario requires nothing that could be verified; see `requirements`")
    if scenario.campaign.sampling != "random":
        raise BadCampaign(
            f"campaign.sampling: {scenario.campaign.sampling} settles the number of runs beforehand; to fly "
            "until verified, expected random"
        )
    _, sampler = running.prepared(scenario, 1, wanted.seed)
    tables = [len(one.law.values) for one in sampler.dispersed if isinstance(one.law, TableLaw)]
    most = min([*([] if request.runs is None else [wanted.runs]), *tables], default=None)
    stated = verdicts.stated(scenario.requirements)
    first = looks.first_pass(*stated)
    if most is not None and most < first:
        probability, confidence = (f"{100.0 * share:.6g} %" for share in stated)
        raise BadCampaign(
            f"at most {most} runs: the first look that can show {probability} at {confidence} confidence is "
            f"after {first}; expected {first} or more, or less in requirements.probability or .confidence"
        )
    return wanted._replace(runs=most)


def fly(request, store, show, stopped=lambda: False, crew=None):
    """Fly what is missing until each requirement passes or fails, or no look is left within the maximum.

    Arguments as of `running.fly`, but the request as of `checked`. -> Flown
    """
    for runs, following in _legs(request, store):
        ended = running.fly(request._replace(runs=runs, keep=()), store, show, stopped, crew)
        found = _verdicts(store) if ended.done else ()
        if ended.interrupted or ended.lost:
            return Flown(ended, found, runs, runs)
        if not any(one.verdict == verdicts.MORE for one in found):
            following = None
        further = "" if following is None else f"; the next look is after {following:,}"
        show.say(f"{runs:,} runs: {_words(found)}{further}")
        if following is None:
            break
    if request.keep:
        ended = running.fly(request._replace(runs=runs), store, show, stopped, crew)
    return Flown(ended, found, runs, following)


def _legs(request, store):
    """(runs to fly to, runs of the look after these) from where the campaign is: iterator."""
    head, most = store.head(), request.runs
    asked = 0 if head is None else head["runs"]
    if most is not None and most < asked:
        yield most, None  # the store refuses fewer runs than it was asked for before
    for look, following in pairwise(looks.each(*verdicts.stated(request.scenario.requirements))):
        if following.runs <= asked:
            continue
        yield max(look.runs, asked), following.runs
        if most is not None and following.runs > most:
            return


def _verdicts(store):
    """Verdicts of the runs in a store."""
    return tuple(verdicts.of_campaign(results.open_campaign(store.folder)))


def _words(found):
    """How many of the verdicts are what, for people."""
    kinds = (verdicts.PASS, verdicts.FAIL, verdicts.MORE, verdicts.UNJUDGED)
    counts = {kind: sum(one.verdict == kind for one in found) for kind in kinds}
    names = "pass", "fail", "undecided", "not judged"
    return ", ".join(f"{n} {name}" for name, n in zip(names, counts.values(), strict=True) if n)
