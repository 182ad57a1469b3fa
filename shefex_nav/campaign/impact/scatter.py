"""Many flights to the ground: run k draws what run k of a campaign draws, and flies what it flies.

In several winds the runs take them in turn.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import running
from shefex_nav.campaign.draws import Sampler
from shefex_nav.campaign.impact.landing import ImpactError, land
from shefex_nav.scenario import load
from shefex_nav.workers import each
from shefex_nav.world.flight.timeline import FlightError

CHUNKS = 4  # of each worker, so that none waits long for another


class Case(NamedTuple):
    """A scenario in one wind."""

    wind: str  # where the wind is from
    scenario: object


class Scattered(NamedTuple):
    """Landings of many flights."""

    landings: dict  # {body: (n, 2) rad, geodetic latitude and longitude} of the runs that flew
    flown: tuple  # (n,) numbers of these runs
    failed: tuple  # of (run, reason)


def case_of(cases, run):
    """The Case that a run flies."""
    return cases[run % len(cases)]


def check(scenario):
    """Refuse a scenario whose runs would all be the same."""
    if not scenario.dispersions:
        raise ImpactError(
            f"{scenario.mission.name} has no section dispersions: every run would land in one place"
        )


def scatter(cases, runs, seed, ground, workers, tell=lambda words: None):
    """Landings of runs 0 to runs - 1 : Scattered, the same for any number of workers.

    cases : of Case;  ground : m above the ellipsoid;  tell : function of words, called after each chunk
    """
    check(cases[0].scenario)
    plans = [running.prepared(case.scenario, runs, seed)[0] for case in cases]
    parts = [list(range(k, runs, CHUNKS * workers)) for k in range(min(runs, CHUNKS * workers))]
    calls = {k: (plans, part, ground) for k, part in enumerate(parts)}
    if workers == 1:
        done = ((k, fly_some(*call)) for k, call in calls.items())
    else:
        done = each(fly_some, calls, workers)
    rows = []
    for _, found in done:
        rows += found
        tell(f"{len(rows)} of {runs} flown")
    rows.sort()
    failed = tuple((run, reason) for run, reason, _ in rows if reason)
    flown = [landings for _, reason, landings in rows if not reason]
    numbers = tuple(run for run, reason, _ in rows if not reason)
    bodies = [name for name, _, _ in flown[0]] if flown else []
    places = {body: np.array([landings[k][1:] for landings in flown]) for k, body in enumerate(bodies)}
    return Scattered(places, numbers, failed)


def fly_some(plans, runs, ground):
    """Fly some runs: list of (run, reason why it did not land or '', [(body, latitude, longitude)])."""
    patterns = [load.Pattern(plan.source, plan.name) for plan in plans]
    samplers = [Sampler(plan, one.dispersed) for plan, one in zip(plans, patterns, strict=True)]
    found = []
    for run in runs:
        k = case_of(range(len(plans)), run)
        job = samplers[k].job(run)
        try:
            landed = land(patterns[k].with_draws(job.draws), job.seed, ground, paths=False)
        except (FlightError, ImpactError, load.ScenarioError) as error:
            found.append((run, str(error).splitlines()[0], []))
            continue
        found.append((run, "", [(one.body, one.latitude, one.longitude) for one in landed.landings]))
    return found
