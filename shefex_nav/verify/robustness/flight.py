"""One flight of a cell and its twin: the same world, computer and seed, but nothing happens."""

import time
from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from shefex_nav.records import GateResult, NavHealth
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.verify.robustness import design, detect, factors, fixes, happenings, random_faults
from shefex_nav.verify.robustness.happenings import HAPPENS
from shefex_nav.workers import collected_afterwards

EVERY = 10  # ticks from one solution that is kept to the next
OF_CELLS, OF_HAPPENINGS = 77, 9  # keys of random numbers of their own, beside those of the sensors
LAST = "altitude_20km"  # on the way down: what comes later is no matter of navigation
VEHICLE_SEED = 0  # all flights of a rocket fly the same way; what differs is what sensors say of it


class Job(NamedTuple):
    """One flight."""

    scenario: str  # file or name of a shipped one
    overrides: tuple  # KEY=VALUE of the user
    cell: design.Cell
    flight: int  # number of it in its cell
    seed: int


class Situation(NamedTuple):
    """What is flown and what goes wrong with it."""

    sources: tuple  # devices, keys of happenings.SOURCES
    window: happenings.Window | None  # when; None: nothing happens
    told: factors.Told
    scenario: object  # Scenario of the healthy world
    settings: tuple  # KEY=VALUE of the faults
    late_s: float = 0.0  # of fixes within the window
    spans: tuple = ()  # (happenings.Happening, happenings.Window) of which it is made
    alone: tuple = ()  # settings of each of several faults by itself


class Kept(NamedTuple):
    """What is kept of a flight."""

    solution: object  # NavSolution of arrays
    covariance: object  # NavCovariance of arrays
    truth: object  # TruthSample of arrays
    gates: list  # GateResult
    health: list  # NavHealth
    seen: dict  # of innovations.watched
    fixes: list  # GpsFix
    earth: object  # EarthRotation


def seed_of(root, cell, flight):
    """Seed of a flight: int."""
    return int(np.random.SeedSequence(root, spawn_key=(OF_CELLS, cell, flight)).generate_state(1)[0])


def fly(job):
    """One flight and its twin, judged. Job -> dict, plain, for JSON"""
    from shefex_nav.verify.robustness import assess

    began = time.process_time()
    head = {"cell": job.cell.number, "flight": job.flight, "seed": job.seed}
    head |= {name: getattr(job.cell, name) for name in design.FACTORS}
    try:
        with collected_afterwards():
            record = assess.compared(*pair(job))
    except Exception as error:  # the end of this flight, not of the others
        record = {"failed": f"{type(error).__name__}: {error}"[:500]}
    return head | record | {"cpu_s": round(time.process_time() - began, 3)}


def pair(job):
    """Situation, the flight, its twin or None if nothing happens; of several faults each alone: list."""
    true = scenario_of(job.scenario, overrides(job))
    vehicle = _vehicle(job.scenario, of_rocket(job))
    situation = situation_of(job, true, vehicle)
    if situation.window is None:
        return situation, *_fly(job, [situation], vehicle), None, []
    twin = situation._replace(settings=(), late_s=0.0)
    alone = situation.alone if len(situation.alone) > 1 else ()
    situations = [situation, twin, *(situation._replace(settings=one) for one in alone)]
    flown, clean, *others = _fly(job, situations, vehicle)
    return situation, flown, clean, others


def situation_of(job, true, vehicle):
    """Situation of a cell: the time of what happens is drawn by the seed of the flight."""
    if job.cell.happens == random_faults.NAME:
        return _random_situation(job, true, vehicle)
    cell, happening = job.cell, HAPPENS[job.cell.happens]
    told = factors.TOLD[cell.told]
    if not happening.device:
        return Situation((), None, told, true, ())
    rng = np.random.default_rng([job.seed, OF_HAPPENINGS])
    start_s, end_s = true.mission.start, last_s(vehicle)
    tracker = true.star_tracker
    stars = (tracker.on + 16.0, tracker.off - 13.0) if tracker.enabled else None
    phase = happenings.phases(vehicle.events, start_s, end_s, stars)[cell.phase]
    window = happenings.drawn(happening, phase, rng)
    settings = tuple(happenings.settings(happening, true, window, rng))
    if happening.shakes != 1.0:
        window = happenings.Window(start_s, end_s)
    spans = ((happening, window),)
    return Situation((happening.device,), window, told, true, settings, happening.late_s, spans)


def _random_situation(job, true, vehicle):
    """Situation of one or two faults at random; it begins with the first and ends with the last."""
    found = random_faults.drawn(true, true.mission.start, last_s(vehicle), job.seed)
    window = happenings.Window(
        min(one.start_s for one in found.windows), max(one.end_s for one in found.windows)
    )
    devices = tuple(dict.fromkeys(one.device for one in found.happenings))
    told = factors.TOLD[job.cell.told]
    spans = tuple(zip(found.happenings, found.windows, strict=True))
    return Situation(devices, window, told, true, found.settings, spans=spans, alone=found.alone)


def overrides(job):
    """KEY=VALUE of the healthy world of a job: tuple; later ones win."""
    grade = () if job.cell.grade == design.OWN else factors.imu_settings(job.cell.grade)
    return (*design.ROCKETS.get(job.cell.rocket, ()), *grade, *job.overrides)


def of_rocket(job):
    """Those of them that the flight depends on, which knows no inertial sensors: tuple."""
    return (*design.ROCKETS.get(job.cell.rocket, ()), *job.overrides)


def last_s(vehicle):
    """Until when a vehicle is flown, s."""
    at = {event.name: event.t_s for event in vehicle.events}
    return float(at.get(LAST, vehicle.trajectory.t_s[-1]))


@lru_cache(maxsize=256)  # all that is told of all grades of the rockets
def scenario_of(name, settings):
    """Scenario with settings; pictures are never drawn."""
    return _loaded(name, settings)


def _loaded(name, settings):
    """`scenario_of` of settings that no other flight has: not kept, as they would drive out the others."""
    from shefex_nav.scenario import load

    loaded = load.load(name, settings)
    if loaded.star_tracker.enabled and loaded.star_tracker.frames != "statistical":
        loaded = load.load(name, (*settings, "star_tracker.frames=statistical"))
    return loaded


@lru_cache(maxsize=8)
def _vehicle(name, settings):
    """Flight of a rocket, without sensors."""
    from shefex_nav import prepare

    return prepare.fly_vehicle(scenario_of(name, settings), VEHICLE_SEED)


@lru_cache(maxsize=8)
def _sky(name, settings):
    """Where antenna and satellites are in the flight of a rocket. Nobody looks at ranges here."""
    from shefex_nav import prepare

    return prepare.gps_sky(scenario_of(name, settings), _vehicle(name, settings), with_ranges=False)


@cache
def _states(name, settings, vehicle_settings):
    """Names of the blocks that the filter of a scenario estimates, where it leaves them to the program."""
    from shefex_nav import prepare

    return prepare.settled(scenario_of(name, settings), _vehicle(name, vehicle_settings)).navigation.states


class _Flight:
    """A flight on its way.

    route : simulate.Route
    kept : {type of a record: list}
    seen : of `innovations.watched`
    """

    def __init__(self, route, kept, seen):
        self.route, self._kept, self._seen = route, kept, seen

    def on(self, ticks):
        """On to the end of a tick."""
        with detect.watched(self._seen):
            for record in self.route.on(ticks, stops=ticks == self.route.schedule.ticks):
                self._kept.setdefault(type(record), []).append(record)

    def fork(self, world):
        """This flight so far, which goes on in another world."""
        seen = self._seen.copy()
        route = self.route.fork(world, {id(self._seen): seen})
        return _Flight(route, {kind: records.copy() for kind, records in self._kept.items()}, seen)

    def end(self):
        """Fly to the end. -> Kept"""
        from shefex_nav import simulate

        self.on(self.route.schedule.ticks)
        world = self.route.world
        solution, covariance = self.route.columns.read()
        truth = simulate.truth_columns(world, EVERY)[0]
        gates, health = (self._kept.get(kind, []) for kind in (GateResult, NavHealth))
        return Kept(solution, covariance, truth, gates, health, self._seen, world.gps_fixes, world.earth)


def _fly(job, situations, vehicle):
    """One flight of each Situation of a job: list of Kept. As long as nothing differs, one flies for all."""
    from shefex_nav import simulate

    built, flights = _scenarios_and_worlds(job, situations, vehicle), {}
    first, world = _begun(job, *built[0], vehicle), built[0][1]
    alike = [0] * len(situations)
    for k, one in enumerate(situations):
        if k and _only_faults(one) and _only_faults(situations[0]):
            alike[k] = min(simulate.ticks_alike(world, built[k][1]), first.route.schedule.ticks - 1)
    for k in sorted(range(1, len(situations)), key=lambda k: alike[k]):
        if alike[k] > 0:
            first.on(alike[k])
            flights[k] = first.fork(built[k][1])
        else:
            flights[k] = _begun(job, *built[k], vehicle)
    flights[0] = first
    return [flights[k].end() for k in range(len(situations))]


def _only_faults(situation):
    """Whether a Situation has the healthy world but for faults that begin some time."""
    return all(setting.startswith("faults.") for setting in situation.settings)


def _begun(job, scenario, world, vehicle):
    """_Flight that has not begun yet."""
    from shefex_nav import simulate
    from shefex_nav.onboard.navigator import Columns

    seen = {}
    with detect.watched(seen):
        route = simulate.Route(world, scenario, job.seed, until_s=last_s(vehicle), columns=Columns(EVERY))
    return _Flight(route, {}, seen)


def _scenarios_and_worlds(job, situations, vehicle):
    """Scenario, prepare.World of each Situation: list. What faults do not change is measured once."""
    from shefex_nav import prepare

    built, healthy = [], None
    for situation in situations:
        scenario, faulty = _scenario(job, situation), _only_faults(situation)
        if not faulty or healthy is None:
            found = prepare.measure(scenario, job.seed, vehicle, sky=_sky(job.scenario, of_rocket(job)))
            healthy = found if faulty else healthy
        world = prepare.with_faults(scenario, healthy if faulty else found, keeps=faulty)
        built.append((scenario, _received(world, situation)))
    return built


def _scenario(job, situation):
    """Scenario of a Situation, with the blocks of states that its filter estimates."""
    from shefex_nav.scenario import load

    told = situation.told.settings(situation.scenario) if situation.told.settings else ()
    healthy = (*overrides(job), *told)
    of = _loaded if situation.settings else scenario_of
    scenario = of(job.scenario, (*healthy, *situation.settings))
    if scenario.navigation.states == AUTOMATIC:
        scenario = load.with_states(scenario, _states(job.scenario, healthy, of_rocket(job)))
    return scenario


def _received(world, situation):
    """World with fixes that are not what they say."""
    told, arm = situation.told, situation.scenario.gps.antenna.lever_arm
    world = fixes.changed(world, arm, late_s=told.late_s, reported=told.reported)
    return fixes.changed(world, arm, late_s=situation.late_s, window=situation.window)
