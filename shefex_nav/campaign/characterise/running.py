"""Rendered runs, fit, and judgement on runs that were not fitted, in worker processes.

The runs are those of a campaign of the scenario with the same root seed: same draws, same sensors.
"""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import NamedTuple

from shefex_nav.compiled import ONE_THREAD
from shefex_nav.workers import bind_to_parent, cores

LEAST_RUNS = 3
HELD_OUT = 3  # every third run is not fitted, but judges
RARE = 1e-6  # probability of a draw beyond either end of the range that a dispersed setting may have


class Flown(NamedTuple):
    """A rendered run as a worker sends it back."""

    run: int
    collected: object  # collect.Collected
    settings: dict  # of camera and star tracker


class Result(NamedTuple):
    """What `characterise` found."""

    content: dict  # of the file
    tests: list  # of judge.Test


def characterise(scenario, runs, seed, *, workers=None, done=lambda text: None):
    """Fly rendered runs of a scenario and fit the statistics of its star tracker.

    Parameters
    ----------
    scenario : Scenario with frames: rendered, with its dispersions
    runs : int, at least LEAST_RUNS
    seed : int, root of all randomness
    workers : int, processes; None: one a core
    done : called with words when something has been done

    Returns
    -------
    Result
    """
    from shefex_nav import simulate
    from shefex_nav.campaign import running
    from shefex_nav.campaign.characterise import model

    plan, sampler = running.prepared(scenario, runs, seed)
    simulate.warm_up(scenario)  # compiles; workers that compiled together would get into each other's way
    jobs = [sampler.job(run) for run in range(runs)]
    with _pool(plan, min(workers or cores(), runs)) as pool:
        flown = _all(pool, fly_rendered, [(job,) for job in jobs], done, "rendered")
        others = [one for k, one in enumerate(flown) if not _held(k)]
        sightings, search = _fitted(scenario, [one.collected for one in others])
        made = {"runs": len(others), "held_out": runs - len(others), "seed": seed}
        made["frames"] = sum(len(one.collected.frames.t_s) for one in others)
        ranges = spans([one.settings for one in flown] + extremes(plan, sampler))
        content = model.section(scenario, sightings, search, made, [], ranges)
        held = [(job, content) for k, job in enumerate(jobs) if _held(k)]
        statistical = _all(pool, fly_statistical, held, done, "statistical")
    tests = _judged(scenario, sightings, [flown[k].collected for k in range(runs) if _held(k)], statistical)
    return Result(
        model.section(scenario, sightings, search, made, [one.as_dict() for one in tests], ranges), tests
    )


def _held(k):
    """Whether run k judges."""
    return k % HELD_OUT == HELD_OUT - 1


def _fitted(scenario, runs):
    from shefex_nav.campaign.characterise import fit
    from shefex_nav.report.metrics import WRONG_ANGLE

    tracker = scenario.star_tracker
    return (
        fit.sightings(runs, tracker.highest_rate, tracker.detection.saturation),
        fit.identification(runs, tracker.highest_rate, WRONG_ANGLE),
    )


def _judged(scenario, sightings, rendered, statistical):
    from shefex_nav.campaign.characterise import judge
    from shefex_nav.report.metrics import WRONG_ANGLE

    fixes = [judge.of_frames(one.frames) for one in rendered]
    return [
        *judge.centroids(rendered, sightings, scenario.star_tracker.highest_rate),
        *judge.fixes(fixes, statistical, WRONG_ANGLE),
    ]


def extremes(plan, sampler):
    """Settings of the star camera and the star tracker at both ends of each dispersion of theirs: list."""
    from shefex_nav.scenario import load, star_statistics

    pattern, drawn, found = load.Pattern(plan.source, plan.name), sampler.draws(0), []
    for one in sampler.dispersed:
        if one.path[0] not in ("star_camera", "star_tracker") or one.group:
            continue
        for u in (RARE, 1.0 - RARE):
            try:
                scenario = pattern.with_draws(drawn | {one.name: one.law.draw(u, 0)})
            except load.ScenarioError:  # a draw that cannot be flown needs no place in the range
                continue
            found.append(star_statistics.settings(scenario))
    return found


def spans(settings):
    """{path: (low, high)} of numbers that are not the same in all of a list of settings."""
    found = {}
    for path, first in settings[0].items():
        values = [one[path] for one in settings if path in one]
        if not isinstance(first, bool | str) and any(value != first for value in values):
            found[path] = (min(values), max(values))
    return found


# ---- in a worker -----------------------------------------------------------------------------------------

_pattern = None  # load.Pattern of this process


def _begin(plan):
    global _pattern
    bind_to_parent()
    from shefex_nav.scenario import load

    _pattern = load.Pattern(plan.source, plan.name)


def fly_rendered(job):
    """Flown of a Job."""
    from shefex_nav.campaign.characterise import collect
    from shefex_nav.scenario import star_statistics

    scenario = _pattern.with_draws(job.draws)
    return Flown(job.run, collect.collect(scenario, job.seed), star_statistics.settings(scenario))


def fly_statistical(job, content):
    """judge.Fixes of a Job, flown with the statistics `content`."""
    import numpy as np

    from shefex_nav.campaign.characterise import collect, judge
    from shefex_nav.scenario import star_statistics

    scenario = star_statistics.with_model(_pattern.with_draws(job.draws), content)
    rows = collect.fixes(scenario, job.seed)
    return judge.Fixes(*(np.array(column) for column in zip(*rows, strict=True)))


# ---- in the parent ---------------------------------------------------------------------------------------


def _pool(plan, workers):
    """Pool of new processes, each with one thread for linear algebra, as the workers of a campaign."""
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, context, _begin, (plan,))


def _all(pool, function, arguments, done, words):
    """Results in the order of the arguments; the first exception ends the work."""
    futures = {pool.submit(function, *one): k for k, one in enumerate(arguments)}
    results = [None] * len(arguments)
    try:
        for n, future in enumerate(as_completed(futures), 1):
            results[futures[future]] = future.result()
            done(f"{words} run {n} of {len(arguments)}")
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    return results
