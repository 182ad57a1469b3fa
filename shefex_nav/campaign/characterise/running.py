"""Rendered runs, fit, and judgement on runs that were not fitted, in worker processes.

The runs are those of a campaign of the scenario with the same root seed: same draws, same sensors. In the
first of them, the corner runs, each dispersed setting of star camera and star tracker is at one end of what a
campaign may draw, at random, and in the next run at the other; these are always fitted. So the range in which
the statistics are said to hold is the one that was flown.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from shefex_nav import simulate
from shefex_nav.campaign.characterise import fit, flying
from shefex_nav.campaign.characterise.fit import FitError
from shefex_nav.campaign.characterise.records import Records
from shefex_nav.scenario.laws import ChoiceLaw, TableLaw
from shefex_nav.workers import cores

CORNERS = 6  # at least every sixth run is a corner run, and they are an even number
HELD_OUT = 2  # every second of the others is not fitted, but judges
RARE = 1e-7  # probability of a draw beyond either end of what the corner runs fly: 5.2 sigma
DISPERSED = ("star_camera", "star_tracker")  # sections of the settings that the statistics depend on
CORNER_STREAM = 1  # of the seeds of a characterisation; of a run's draws there are others


class Result(NamedTuple):
    """What `characterise` found."""

    content: dict  # of the file
    tests: list  # of judge.Test
    failed: list  # of flying.Failed, rendered runs that are not in it
    lost: list  # of engine.Lost, runs of either kind that no worker brought to an end


def characterise(scenario, runs, seed, *, workers=None, folder=None, done=lambda text: None):
    """Fly rendered runs of a scenario and fit the statistics of its star tracker.

    Parameters
    ----------
    scenario : Scenario with frames: rendered, with its dispersions
    runs : int, at least 6: two corner runs, and of the others a half judges
    seed : int, root of all randomness
    workers : int, processes; None: one a core
    folder : Path where rendered runs are kept, and those that it has are not flown again; None: nowhere
    done : called with words when something has been done

    Returns
    -------
    Result

    Raises
    ------
    fit.FitError, records.RecordsError, campaign.running.BadCampaign, campaign.engine.EngineError
    """
    from shefex_nav.campaign import running
    from shefex_nav.campaign.characterise import judge, model

    plan, sampler = running.prepared(scenario, runs, seed)
    jobs = corner_jobs(plan, sampler) + [sampler.job(run) for run in range(corners(runs), runs)]
    records = Records(folder, plan) if folder else None
    workers = min(workers or cores(), runs)
    flown, failed, lost = _rendered(scenario, plan, jobs, workers, records, done)
    fitted, held = split(flown, corners(runs))
    content, sightings = _fitted(scenario, fitted, held, (failed, lost), seed)
    function = partial(flying.statistical, content)
    over = flying.fly(plan, workers, function, [jobs[one.run] for one in held], done, "statistical")
    tests = [judge.flown_all(len(held), over.failed)]
    judges = [one for one in held if one.run in over.results]
    if over.lost and not judges:
        raise FitError(f"no run that was not fitted could be judged; the first: {over.lost[0].reason}")
    if judges:
        tests += _judged(scenario, sightings, judges, [over.results[one.run] for one in judges])
    return Result(model.with_tests(content, tests), tests, failed, lost + over.lost)


def _rendered(scenario, plan, jobs, workers, records, done):
    """([Flown] by run, [Failed], [Lost]); what is kept is not flown."""
    from shefex_nav import runs

    kept = {} if records is None else {run: records.read(run) for run in range(len(jobs))}
    kept = {run: one for run, one in kept.items() if one is not None}
    missing = [job for job in jobs if job.run not in kept]
    if kept:
        done(f"{len(kept)} of {len(jobs)} rendered runs are kept in {records.folder}")
    if missing:
        runs.get_ready(scenario)
        simulate.warm_up(scenario)  # compiles; workers that compiled together would get into each other's way
    keep = (lambda one: None) if records is None else records.keep
    results, failed, lost = flying.fly(plan, workers, flying.rendered, missing, done, "rendered", keep)
    if not kept and not results:
        raise FitError(
            f"no rendered run of {len(jobs)} came to its end; the first: {(failed + lost)[0].reason}"
        )
    return [one for _, one in sorted((kept | results).items())], failed, lost


def corners(runs):
    """Number of corner runs: even, at least two."""
    return 2 * -(-runs // (2 * CORNERS))


def corner_jobs(plan, sampler):
    """Jobs of the corner runs: two by two, what is at its upper end in one is at its lower in the next."""
    jobs = []
    for run in range(corners(plan.runs)):
        rng = np.random.default_rng(np.random.SeedSequence(plan.seed, spawn_key=(CORNER_STREAM, run // 2)))
        job, ends = sampler.job(run), {}
        for one in sampler.dispersed:
            high = bool(rng.integers(2)) != bool(run % 2)
            if one.path[0] in DISPERSED:
                ends[one.name] = _end(one, 1.0 - RARE if high else RARE, run)
        jobs.append(job._replace(draws=job.draws | ends))
    return jobs


def _end(one, u, run):
    """The draw of a Dispersed for a probability u; of a group each for itself, of listed values the last."""
    if one.group:
        return float(one.law.sigma * ndtri(u))
    if not isinstance(one.law, ChoiceLaw | TableLaw):
        return one.law.draw(u, run)
    values = one.law.reach()
    if any(isinstance(value, bool | str) for value in values):
        words = ", ".join(map(str, values))
        raise FitError(
            f"{one.name} is dispersed over {words}; statistics hold for one of them: characterise each"
        )
    return max(values) if u > 0.5 else min(values)


def split(flown, first):
    """([Flown] that are fitted, [Flown] that judge): runs from number `first` on may judge."""
    held = [one for one in flown if one.run >= first and (one.run - first) % HELD_OUT == HELD_OUT - 1]
    judges = {one.run for one in held}
    fitted = [one for one in flown if one.run not in judges]
    if not fitted or not held:
        raise FitError(f"{len(fitted)} runs to fit and {len(held)} to judge succeeded; neither may be 0")
    return fitted, held


def to_judge(held):
    """The number of runs to ask for, so that so many judge if none fails."""
    runs = HELD_OUT * held
    while (runs - corners(runs)) // HELD_OUT < held:
        runs += 1
    return runs


def _fitted(scenario, fitted, held, without, seed):
    """(content of the file without tests, SightingModel); without : the runs that failed, those lost."""
    from shefex_nav.campaign.characterise import model
    from shefex_nav.report.star_metrics import WRONG_ANGLE

    tracker, runs = scenario.star_tracker, [one.collected for one in fitted]
    sightings = fit.sightings(runs, tracker.highest_rate, tracker.detection.saturation)
    search = fit.identification(runs, tracker.highest_rate, WRONG_ANGLE)
    failed, lost = map(len, without)
    made = {"runs": len(fitted), "held_out": len(held), "failed": failed, "lost": lost, "seed": seed}
    made["frames"] = sum(len(one.frames.t_s) for one in runs)
    made["code"] = sorted({one.code for one in (*fitted, *held)})
    ranges = spans([one.settings for one in (*fitted, *held)])
    return model.section(scenario, sightings, search, made, ranges), sightings


def _judged(scenario, sightings, held, statistical):
    from shefex_nav.campaign.characterise import judge
    from shefex_nav.report.star_metrics import WRONG_ANGLE

    rendered = [one.collected for one in held]
    fixes = [judge.of_frames(one.frames) for one in rendered]
    return [
        *judge.centroids(rendered, sightings, scenario.star_tracker.highest_rate),
        *judge.fixes(fixes, statistical, WRONG_ANGLE),
    ]


def spans(settings):
    """{path: (low, high)} of numbers that are not the same in all of a list of settings."""
    found = {}
    for path, first in settings[0].items():
        values = [one[path] for one in settings if path in one]
        if not isinstance(first, bool | str) and any(value != first for value in values):
            found[path] = (min(values), max(values))
    return found
