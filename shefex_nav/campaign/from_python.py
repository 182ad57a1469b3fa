"""Campaigns from Python, as `shefex-nav campaign` flies them.

    if __name__ == "__main__":
        campaign = sn.fly_campaign(sn.Scenario.load("shefex2_dispersed"), 300, folder="my_campaign")
        campaign.table()  # rich; a notebook shows it
        campaign.plot.errors()

The condition is for scripts: the workers are new processes, which read the script too.
"""

import multiprocessing
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path


def fly_campaign(
    scenario, runs: int | None = None, *, folder: str | Path, seed: int = 1, workers: int | None = None,
    engine: str | None = None, keep: Sequence[str] = (), say: Callable[[str], object] = print,
    until_verified: bool = False,
):  # fmt: skip
    """Fly a scenario many times; what the folder has of the same campaign already is not flown again.

    Parameters
    ----------
    scenario : Scenario, with `dispersions`
    runs : int, how many; None: any number, if `until_verified`
    folder : path of the results, made if it is not there
    seed : int, root of all randomness
    workers : processes; None: one a core
    engine : 'dask://HOST:PORT' of the scheduler of a cluster, which then flies them; None: this machine
    keep : of 'worst:K' and 'failed', runs that are flown again at the end with a log each
    say : function that is told how far it is, a line at a time
    until_verified : whether to fly on, to `runs` at most, until each requirement passes or fails

    Returns
    -------
    results.Campaign

    Raises StoreError if the folder holds another campaign, BadCampaign and EngineError if it cannot be flown
    (nothing is written if that is by the arguments),
    KeyboardInterrupt if it was interrupted: what is done is kept, the same call goes on. Warns of runs that
    were lost with their workers, which the Campaign is without; EngineError if all of them were.
    """
    from shefex_nav.campaign import progress, results, running, until
    from shefex_nav.campaign.store import Store
    from shefex_nav.stopping import stopping

    if multiprocessing.parent_process() is not None:
        raise running.BadCampaign(
            "fly_campaign was called in a worker process; in a script, the call stands below "
            "`if __name__ == '__main__':`, because the workers read the script too"
        )
    asked = running.Request(scenario, runs, seed, workers, running.address(engine), running.kept(keep))
    request = until.checked(asked) if until_verified else running.checked(asked)
    with Store(folder) as store, stopping() as stop:
        fly = until.fly if until_verified else running.fly
        flown = fly(request, store, progress.Show(say), stop)
    ended, runs = (flown.ended, flown.asked) if until_verified else (flown, runs)
    _report_missing(ended, runs, say)
    return results.open_campaign(folder)


def _report_missing(ended, runs, say):
    """Say, warn of or raise what a campaign of so many runs is without. running.Ended"""
    from shefex_nav.campaign.engine import EngineError

    for one in ended.lost:
        say(f"run {one.run} was lost and is flown by the same call the next time: {one.reason}")
    for one in ended.unlogged:
        say(f"run {one.run} has no log: {one.reason}")
    if ended.interrupted:
        raise KeyboardInterrupt(f"{ended.done} of {runs} runs are kept; the same call goes on from there")
    if ended.lost:
        words = f"{len(ended.lost)} of {runs} runs were lost with their workers, the same call flies them"
        if not ended.done:
            raise EngineError(f"{words}; run {ended.lost[0].run}: {ended.lost[0].reason}")
        warnings.warn(f"{words}; every figure is of the {ended.done} others", stacklevel=3)
