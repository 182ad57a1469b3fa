"""Flights to workers and back, in the order of the design: after any number of them all levels have met."""

from concurrent.futures import BrokenExecutor
from contextlib import closing
from typing import NamedTuple

from shefex_nav.compiled.target import ONE_THREAD
from shefex_nav.errors import UserError
from shefex_nav.verify.robustness import design, flight, random_faults
from shefex_nav.workers import cores, each, environment


class Request(NamedTuple):
    """What is asked for."""

    scenarios: tuple  # (name as given, name of the mission, has a star tracker), ...
    overrides: tuple
    flights: int  # of each cell
    cells: tuple | None  # numbers; None: all
    seed: int
    random: int  # missions with random faults; 0: the design is flown


MOST_FLIGHTS = 1_000_000  # that are known before the first one flies


class RobustnessError(UserError):
    """A study that cannot be flown; the message says why."""


def request(scenarios, overrides, flights, cells, seed, random_faults):
    """Request of scenarios as given; RobustnessError or ScenarioError of one that cannot be flown."""
    from shefex_nav.scenario import load, software

    given = []
    for name in dict.fromkeys(scenarios):
        loaded = load.load(name, overrides)
        software.refuse_own(loaded, "verify robustness")
        if loaded.navigation.gps != "loose":
            raise RobustnessError(
                f"{name}: navigation.gps has to be 'loose', not '{loaded.navigation.gps}': the matrix "
                "changes fixes, not ranges"
            )
        _refuse_without_statistics(name, loaded.mission.name, tuple(overrides))
        given.append((name, loaded.mission.name, bool(loaded.star_tracker.enabled)))
    names = [mission for _, mission, _ in given]
    if len(set(names)) < len(names):
        raise RobustnessError(f"two scenarios have the same mission.name: {', '.join(names)}")
    return Request(tuple(given), tuple(overrides), flights, cells, seed, random_faults)


def _refuse_without_statistics(name, mission, overrides):
    """Refuse a scenario whose star tracker has no statistics: no cell could be flown."""
    from shefex_nav.scenario.layers import ScenarioError

    try:
        flight.scenario_of(name, (*design.ROCKETS.get(mission, ()), *overrides))
    except ScenarioError as error:
        raise RobustnessError(
            f"{name}: the matrix flies star trackers by their statistics (star_tracker.frames: statistical), "
            "and those here are not of this scenario; `shefex-nav characterise` makes them, "
            f"--set star_tracker.enabled=false flies without stars\n{error}"
        ) from None


def _check_count(flights, of):
    if flights > MOST_FLIGHTS:
        raise RobustnessError(f"{of}: {flights} flights; expected {MOST_FLIGHTS} at most")


def jobs(request):
    """list of flight.Job: first one flight of every cell, then the second ..."""
    _check_count(request.random, "--random-faults")
    if request.random:
        return [_random(request, k) for k in range(request.random)]
    chosen = []
    for given, mission, has_stars in request.scenarios:
        found = design.of_scenario(mission, has_stars)
        chosen += [(given, cell) for cell in found if request.cells is None or cell.number in request.cells]
    if not chosen:
        raise RobustnessError("none of the cells that were asked for belongs to these scenarios")
    _check_count(request.flights * len(chosen), f"--flights {request.flights} of {len(chosen)} cells")
    chosen.sort(key=lambda one: one[1].number)
    return [
        flight.Job(given, request.overrides, cell, k, flight.seed_of(request.seed, cell.number, k))
        for k in range(request.flights)
        for given, cell in chosen
    ]


def _random(request, k):
    """Mission k with random faults, in one scenario after the other."""
    given, mission, _ = request.scenarios[k % len(request.scenarios)]
    cell = design.Cell(k, mission, design.OWN, "right", random_faults.NAME, design.ANY)
    return flight.Job(given, request.overrides, cell, 0, flight.seed_of(request.seed, k, 0))


def warm_up(waiting):
    """Compile what is not compiled yet: workers would do so all at once."""
    from shefex_nav import runs
    from shefex_nav.scenario import load

    for name in dict.fromkeys(job.scenario for job in waiting):
        runs.get_ready(load.load(name))


def fly(waiting, workers, take):
    """Fly jobs in worker processes; each result is handed to `take` as it comes.

    waiting : list of flight.Job;  workers : int or None, one a core
    """
    calls = {number: (job,) for number, job in enumerate(waiting)}
    done = each(flight.fly, calls, min(workers or cores(), max(1, len(waiting))))
    try:
        with environment(dict.fromkeys(ONE_THREAD, "1")), closing(done):
            for _, record in done:
                take(record)
    except BrokenExecutor:
        raise RobustnessError(
            "a worker process was killed, perhaps for want of memory; what is done is kept in --out FOLDER, "
            "--resume goes on"
        ) from None
