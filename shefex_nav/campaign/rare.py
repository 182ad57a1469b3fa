"""How probable a rare flight is: the flights that `subset` asks for, without sensors and filter.

In: a scenario with dispersions, and an event such as `apogee < 150 km`. A State of `subset` has a standard
normal number for each dispersed path, which by its distribution function is the probability that the law of
the path is drawn at, and the seed of the run, from which the attitude control draws its errors. Sample k of
level 0 is run k of the campaign of the same seed.

A flight that fails has no figure. It counts as the event, as a run that fails meets no requirement, unless it
is left out: then it is on the other side, a flight without the event, and its share of level 0 is told.
"""

from concurrent.futures import BrokenExecutor, as_completed
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri

from shefex_nav import prepare
from shefex_nav.campaign import draws, running, subset
from shefex_nav.campaign.impact import aim, landing
from shefex_nav.campaign.rare_events import QUANTITIES, Event, RareError
from shefex_nav.scenario import dispersions, load
from shefex_nav.scenario.laws import TableLaw
from shefex_nav.workers import Pool, cores, undisturbed
from shefex_nav.world.flight.timeline import FlightError

FAILED, LEFT_OUT = float("inf"), float("-inf")  # value of a flight that fails
RUN = 0  # number of a flight that is none of a campaign; no law but a table's, which is refused, asks for it


class Problem(NamedTuple):
    """What flights have in common."""

    plan: object  # plan.Plan
    event: Event
    body: str | None  # whose landing counts; None: what flies last
    ground: float  # m above the ellipsoid
    place: tuple | None  # rad, that `off` counts from
    of_failed: float  # value of a flight that fails: FAILED, LEFT_OUT


class Found(NamedTuple):
    """All of it."""

    problem: Problem
    dispersed: tuple  # of disperse.Dispersed
    nominal: float | None  # of the flight without draws, SI
    estimate: subset.Estimate
    failed: int  # flights of level 0 that failed
    worst: tuple  # of Case, the worst first


class Case(NamedTuple):
    """A flight that can be flown again."""

    value: float | None  # SI; None: it failed
    reason: str  # why it failed, or ''
    seed: int
    draws: dict  # path as written: value in the unit of its dispersion
    deviations: dict  # path as written: standard normal number of the same probability
    source: str  # YAML text of its scenario, with everything in it


class Flights:
    """Flies states of a Problem."""

    def __init__(self, problem):
        self.problem = problem
        self._pattern = load.Pattern(problem.plan.source, problem.plan.name)
        self.dispersed = tuple(self._pattern.dispersed)
        self._sampler = draws.Sampler(problem.plan, self.dispersed)

    def first(self, run):
        """State of run number `run` of the campaign."""
        names = [one.name for one in self.dispersed]
        normal = ndtri([self._sampler.probability(run, name) for name in names])
        return subset.State(normal, (draws.sensor_seed(self.problem.plan.seed, run),))

    def value(self, state):
        """How far a flight is on the side of the event, in SI."""
        try:
            found = self.figure(self.scenario(state), state.seeds[0])
        except (FlightError, landing.ImpactError, load.ScenarioError):
            return self.problem.of_failed
        return self.problem.of_failed if found is None else self.problem.event.sign * found

    def scenario(self, state):
        """Scenario of a state; ScenarioError."""
        return self._pattern.with_draws(self.draws(state))

    def draws(self, state):
        """{path as written: value in the unit of its dispersion} of a state."""
        probabilities = {
            one.name: draws.inside(float(ndtr(z)))
            for one, z in zip(self.dispersed, state.normal, strict=True)
        }
        return draws.drawn(self.dispersed, probabilities.get, RUN)

    def figure(self, scenario, seed):
        """The quantity of a flight, SI; None if the flight has none. FlightError, ImpactError"""
        asked = QUANTITIES[self.problem.event.name]
        if asked.lands:
            flown = landing.land(scenario, seed, self.problem.ground, paths=False)
        else:
            flown = prepare.fly_vehicle(scenario, seed)
        return asked.figure(self.problem, scenario, flown)

    def case(self, sample):
        """Case of a Sample."""
        state, reason, value, source = sample.state, "", None, ""
        try:
            scenario = self.scenario(state)
            source = scenario.source
            value = self.figure(scenario, state.seeds[0])
            reason = "" if value is not None else f"it has no {self.problem.event.name}"
        except (FlightError, landing.ImpactError, load.ScenarioError) as error:
            reason = str(error).splitlines()[0]
        deviations = deviating(self.dispersed, state.normal)
        return Case(value, reason, state.seeds[0], self.draws(state), deviations, source)


class Crew:
    """Does what `subset` asks for, in this process or in workers."""

    def __init__(self, flights, most, count):
        """most : of the workers;  count : called after each flight"""
        self._flights, self._count = flights, count
        self._pool = Pool(most, _prepare, flights.problem) if most > 1 else None

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if self._pool is not None:
            with undisturbed():
                self._pool.stop(at_once=kind is not None)

    def work(self, function, calls):
        """As of `subset.estimate`."""
        if self._pool is None:
            return [self._counted(function(self._value, call)) for call in calls]
        try:
            futures = [self._pool.submit(_call, function, call) for call in calls]
            for future in as_completed(futures):
                self._counted(future.result())
        except BrokenExecutor:
            raise RareError("a worker was killed; try fewer with --workers") from None
        return [future.result() for future in futures]

    def _value(self, state):
        return self._flights.value(state)

    def _counted(self, done):
        flights = done.steps + done.redrawn if isinstance(done, subset.Walked) else len(done)
        for _ in range(flights):
            self._count()
        return done


_flights_of_worker = []  # the Flights of a worker


def _prepare(problem):
    _flights_of_worker[:] = [Flights(problem)]


def _call(function, call):
    return function(_flights_of_worker[0].value, call)


# ---- from what is asked to what came out -----------------------------------------------------------------


class Asked(NamedTuple):
    """How it is to be found out."""

    runs: int  # of each level
    seed: int
    smallest: float  # probability
    workers: int | None  # None: one a core
    worst: int = 3  # flights that are told
    of_failed: float = FAILED  # or LEFT_OUT


def problem_of(scenario, event, asked, body=None, ground=None, place=None):
    """(Problem, value of the nominal flight). RareError, ImpactError, FlightError"""
    landing.check(scenario, 0.0 if ground is None else ground)
    ground = scenario.launch.height if ground is None else ground
    aim.check(scenario, body)
    if not QUANTITIES[event.name].lands and (body, place) != (None, None):
        raise RareError(f"{event.name} is of the whole rocket: neither a body nor a place goes with it")
    if place is not None and event.name != "off":
        raise RareError(f"a place goes with 'off', not with {event.name}")
    if scenario.campaign.flight == "shared" or not scenario.dispersions:
        words = "campaign.flight: shared" if scenario.dispersions else "there is no section dispersions"
        raise RareError(f"{scenario.mission.name}: every run would have the same flight ({words})")
    plan, sampler = running.prepared(scenario, asked.runs, asked.seed)
    tables = [one.name for one in sampler.dispersed if isinstance(one.law, TableLaw)]
    if tables:
        raise RareError(f"{scenario.mission.name}: dispersions.{tables[0]} is a table, not a distribution")
    problem = Problem(plan._replace(sampling="random"), event, body, ground, place, asked.of_failed)
    if event.name == "off" and place is None:
        landed = landing.land(scenario, asked.seed, ground, paths=False)
        one = landing.of_body(landed.landings, problem.body)
        if one is None:
            raise RareError(f"{body} does not come off in the nominal flight")
        problem = problem._replace(place=(one.latitude, one.longitude))
    return problem, Flights(problem).figure(scenario, asked.seed)


def study(problem, nominal, asked, count=lambda: None, tell=lambda level: None):
    """Found of a Problem. count : called after each flight;  tell : with each subset.Level"""
    flown, event, failed = Flights(problem), problem.event, []

    def noted(function, calls):
        done = crew.work(function, calls)
        if function is subset.draw:
            failed.append(sum(abs(one.value) == FAILED for part in done for one in part))
        return done

    with Crew(flown, asked.workers or cores(), count) as crew:
        first = [flown.first(run) for run in range(asked.runs)]
        found = subset.estimate(first, event.sign * event.limit, asked.smallest, asked.seed, noted, tell)
    different = {(one.state.normal.tobytes(), one.state.seeds): one for one in found.samples}
    worst = sorted(different.values(), key=lambda one: -one.value)[: asked.worst]
    return Found(problem, flown.dispersed, nominal, found, sum(failed), tuple(map(flown.case, worst)))


def in_common(found):
    """[(path, mean, standard deviation)] of what the flights beyond the last threshold have drawn.

    In standard deviations of the laws, the farthest from 0 first; what changes no flight is left out.
    """
    rows = [deviating(found.dispersed, one.state.normal) for one in found.estimate.samples]
    names = [one.name for one in found.dispersed if is_of_flight(one)]
    columns = ((name, np.array([row[name] for row in rows])) for name in names)
    means = [(name, float(column.mean()), float(column.std())) for name, column in columns]
    return sorted(means, key=lambda one: -abs(one[1]))


def is_of_flight(dispersed):
    """Whether a Dispersed decides where the vehicle flies."""
    return any(dispersed.path[: len(part)] == part for part in dispersions.OF_FLIGHT)


def deviating(dispersed, normal):
    """{path as written: standard normal number of the probability at which its law was drawn}.

    dispersed : of disperse.Dispersed;  normal : (n,) of a State, which a correlated group mixes
    """
    own = {one.name: float(z) for one, z in zip(dispersed, normal, strict=True)}
    return {
        one.name: sum(f * own[name] for f, name in zip(one.factors, one.group, strict=True))
        if one.group
        else own[one.name]
        for one in dispersed
    }
