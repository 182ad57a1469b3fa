"""Runs of a characterisation in worker processes of this machine, by the engine that flies campaigns.

So its rules are theirs: a killed worker costs the run that it had, which is flown again; trouble of the
machine (no memory, no disk) is no result of the run; a run that no worker brings to an end is lost and told;
if nothing is flown any more, it ends. What breaks the run itself is a value, `Failed`.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import engine, plan
from shefex_nav.campaign.characterise import collect
from shefex_nav.campaign.characterise.records import Flown
from shefex_nav.campaign.flight import OF_THE_MACHINE, MachineError
from shefex_nav.scenario import load, star_statistics


class Failed(NamedTuple):
    """A run that came to no end."""

    run: int
    reason: str


class Outcome(NamedTuple):
    """What became of some runs; each is in one of the three."""

    results: dict  # run -> what the function returned
    failed: list  # of Failed
    lost: list  # of engine.Lost


def fly(plan, workers, function, jobs, done, words, keep=lambda one: None):
    """A function of each job in worker processes.

    Parameters
    ----------
    plan : plan.Plan that the jobs belong to
    workers : int, processes at most
    function : of a Job, which can be pickled and is called in a worker
    jobs : list of Job
    done : called with words when a run is over
    words : str, what these runs are called
    keep : called with each result as soon as it is there

    Returns
    -------
    Outcome

    Raises
    ------
    engine.EngineError if workers die or are in trouble one after the other; whatever `keep` raises
    """
    results, failed = {}, []

    def take(over):
        run, one = over
        if isinstance(one, Failed):
            failed.append(one)
            done(f"{words} run {run} failed: {one.reason}")
            return
        keep(one)
        results[run] = one
        done(f"{words} run {len(results) + len(failed)} of {len(jobs)}")

    lanes = [_lane(plan, function) for _ in range(min(workers, len(jobs)))]
    lost = engine.fly(jobs, lanes, take)
    for one in lost:
        done(f"{words} run {one.run} is lost: {one.reason}")
    return Outcome(results, sorted(failed), lost)


def _lane(plan, function):
    """One worker process."""
    return engine.ProcessLane(plan, partial(attempt, function), prepare)


# ---- in a worker -----------------------------------------------------------------------------------------

_plan = None  # of this process
_pattern = None  # its load.Pattern, from the first run on


def prepare(plan):
    """Tell this process what it is to fly; what goes wrong in reading it is for the first run to say."""
    global _plan, _pattern
    _plan, _pattern = plan, None


def attempt(function, job):
    """(run, what the function returns of a Job, or Failed); MachineError where the fault is not the run's."""
    try:
        return job.run, function(job)
    except OF_THE_MACHINE as error:
        raise MachineError(f"{type(error).__name__}: {error}") from error
    except Exception as error:
        return job.run, Failed(job.run, f"{type(error).__name__}: {error}")


def _scenario(job):
    """Scenario of a run."""
    global _pattern
    if _pattern is None:
        _pattern = load.Pattern(_plan.source, _plan.name)
    return _pattern.with_draws(job.draws)


def rendered(job):
    """records.Flown of a Job."""
    scenario = _scenario(job)
    collected, settings = collect.collect(scenario, job.seed), star_statistics.settings(scenario)
    return Flown(job.run, collected, settings, plan.versions()["code"])


def statistical(content, job):
    """judge.Fixes of a Job, flown with the statistics `content`."""
    from shefex_nav.campaign.characterise import judge

    scenario = star_statistics.with_model(_scenario(job), content)
    rows = collect.fixes(scenario, job.seed)
    return judge.Fixes(*(np.array(column) for column in zip(*rows, strict=True)))
