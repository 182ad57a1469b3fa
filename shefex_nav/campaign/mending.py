"""A run that a disk has spoilt, or that failed, flown again and kept in its place; nothing good is lost."""

from shefex_nav.campaign import engine, repeating, running
from shefex_nav.campaign.flight import Flown
from shefex_nav.campaign.results import SUCCEEDED
from shefex_nav.campaign.store import Store
from shefex_nav.scenario import load


def keep(folder, run, log=None, *, lane=engine.ProcessLane):
    """Repeat a run of the campaign in `folder` and keep it. Arguments and errors as of `repeating.repeat`.

    A run of the same results keeps its record, with the times of its first flight. One that flew to its end
    and now comes out otherwise is left as it is. StoreError also if a campaign is at work in the folder, or
    if the program is not the one that flew its runs.

    -> (Repeated, whether it was kept)
    """
    head = repeating.read_head(folder, run)
    scenario = load.Pattern(head["source"], head["scenario"]).scenario
    with Store(folder) as store:
        store.begin(repeating.plan_of(head, folder), running.described(scenario))
        repeated = repeating.repeat(folder, run, log, lane=lane)
        if not repeated.same and repeated.kept is not None and repeated.kept["status"] == SUCCEEDED:
            return repeated, False
        record = repeated.kept if repeated.same else repeated.record
        store.keep(Flown(record, repeated.series), running.badness(scenario)(record))
    return repeated, True
