"""The route: scenario -> world -> on-board computer -> records.

Here world and flight software take their turns; elsewhere they meet only where both are set up (`prepare`),
where a model stands for pictures (`statistical`), and in experiments. `run` is an iterator of the records of
`records`, in the order in which things happen; whoever calls it writes them, keeps them or counts them.
"""

import copy
import pickle
import time
from array import array
from bisect import bisect_right
from itertools import zip_longest

import numpy as np

from shefex_nav import prepare, statistical
from shefex_nav.clock import IMU_HZ, SAME_S, SAMPLES_PER_TICK, TICK_HZ
from shefex_nav.environment import ephemeris
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.log.steady import ARRIVED, EVENTS, MEASURED, Reached, Steady
from shefex_nav.onboard import computer as onboard
from shefex_nav.onboard import driving, navigator
from shefex_nav.onboard.navigator import RECORDS, Columns
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.records import (
    CameraCommand,
    ComputeTime,
    ControlSample,
    Frame,
    ImuBlock,
    rows,
)
from shefex_nav.scenario import software
from shefex_nav.software import flown
from shefex_nav.world import camera, faults, imu, noise
from shefex_nav.world.camera.shutter import Shutter
from shefex_nav.world.flight.record import control_samples, truth_of


def run(scenario, seed):
    """Fly a scenario once.

    Parameters
    ----------
    scenario : Scenario
    seed : int

    Yields
    ------
    records in order of time; all but the measured durations (ComputeTime) depends on scenario and seed alone
    """
    yield from route(prepare.build_world(scenario, seed), scenario, seed)


def route(world, scenario, seed, *, until_s=np.inf, step=star_tracker.step, columns=None, pace=None):
    """Tick by tick through a world that has been built; as `run`, until the mission time until_s at most.

    step : `star_tracker.step`, or something that wraps it to see what it is given
    columns : navigator.Columns, which takes all solutions and covariances; truth, control and IMU are not
        yielded either (`truth_columns` has the first two). Nothing else changes with it. None: all is
        yielded. `steady_columns` of the world takes all five, and Reached comes with the records
    pace : pacing.Pace, the clock that says when a tick begins; None: as fast as it goes
    """
    yield world.alignment
    flown = Route(world, scenario, seed, until_s=until_s, step=step, columns=columns, pace=pace)
    yield from flown.on(flown.schedule.ticks)


class Route:
    """A mission on its way; arguments as of `route`.

    done : int, ticks that have been made
    columns : navigator.Columns, those that were given
    """

    def __init__(
        self, world, scenario, seed, *, until_s=np.inf, step=star_tracker.step, columns=None, pace=None
    ):
        self._steady = columns if isinstance(columns, Steady) else None
        columns = columns if self._steady is None else self._steady.told
        self.world, self.columns, self.done, self._until_s = world, columns, 0, until_s
        self.read = imu.stacked(world.imu)
        stops = () if self._steady is None else stops_of(self.read.t_valid_s, world.flight.events)
        self.schedule = Schedule(world, self.read.t_valid_s, until_s, columns is None, stops)
        telemetry = RECORDS if columns is None else columns
        self._at_ticks = ()
        if columns is None:
            self._at_ticks = Rows(truth_of(world.flight.trajectory, 1, self.schedule.ticks)), Rows(self.read)
        self._link, computer = _on_board(world, scenario, seed, step, self.schedule, telemetry)
        self._aboard = computer if pace is None else pace.around(computer)

    def on(self, ticks, stops=True):
        """Records on to the end of a tick.

        ticks : its number, from 1;  stops : False if there is more to come
        """
        link, schedule = self._link, self.schedule
        at = _nowhere if self._steady is None else self._steady.at
        for k, arrived, outputs in driving.drive(self._aboard, self.read, link, ticks, self.done, stops):
            n, now_s = k + 1, schedule.ends_s[k]
            at(n, EVENTS)
            yield from due(schedule.events, now_s)
            if self._at_ticks:
                truth, blocks = self._at_ticks
                yield truth[k]
                yield from due(schedule.steered, now_s)
                yield blocks[k]
            at(n, ARRIVED)
            yield from link.records_of(arrived)
            yield from outputs
            at(n, MEASURED)
            yield from link.durations(now_s)
            link.commands += [one for one in outputs if isinstance(one, CameraCommand)]
            at(n + 1, EVENTS)
            if self._steady is not None:
                yield Reached(now_s, int(self.world.flight.trajectory.phase[n * SAMPLES_PER_TICK]))
        self.done = ticks
        if ticks == len(self.read.t_valid_s):
            yield from reversed(schedule.events)  # the impact, after the last tick

    def fork(self, world, stands_for):
        """A copy, which goes on in another world: as if it had flown there from the beginning.

        Parameters
        ----------
        world : prepare.World that has been the same so far, `ticks_alike`, and has the same computer
        stands_for : {id of an object that the route holds: what its copy holds in its place}
        """
        own, line = self.world, self._link.line
        schedule = Schedule(world, self.read.t_valid_s, self._until_s, self.columns is None)
        schedule.skip(self.done)
        computer, constant = own.computer, (own.camera, own.earth, own.flight.trajectory)
        constant = (*constant, computer, computer.nav, computer.tracker, self._aboard.tracker)
        instead = {
            id(own): world,
            id(self.read): imu.stacked(world.imu),
            id(self.schedule): schedule,
            id(line): faults.StarLine(world.faults.star_tracker, copy.deepcopy(line.rng)),
        }
        return copy.deepcopy(self, {id(one): one for one in constant} | instead | stands_for)


class Rows:
    """Records of a record of arrays by number; many are made at once, in a fifth of the time of `row`."""

    AT_ONCE = 128

    def __init__(self, arrays):
        self._arrays, self._first, self._made = arrays, 0, []

    def __getitem__(self, k):
        """Record k, from 0 on, as of `row`."""
        if not 0 <= k - self._first < len(self._made):
            self._first, parts = k, (column[k : k + self.AT_ONCE] for column in self._arrays)
            self._made = rows(type(self._arrays)(*parts))
        return self._made[k - self._first]


def ticks_alike(world, other):
    """Number of ticks at which all that comes to the computer is the same in two worlds of one flight.

    They differ by faults alone, one seed has drawn them.
    """
    reads = imu.stacked(world.imu), imu.stacked(other.imu)
    ends_s, n = reads[0].t_valid_s, len(reads[0].t_valid_s)
    same = np.ones(n, dtype=bool)
    for a, b in zip(*reads, strict=True):
        equal = a == b
        if not equal.all():
            equal |= np.isnan(a) & np.isnan(b)
            same &= equal.reshape(n, -1).all(axis=1)
    parts_s = [fault.start for one in (world, other) for fault in one.faults.star_tracker]
    for a, b in zip_longest(*(sorted(one.received, key=happens_s) for one in (world, other))):
        if a is b:
            continue
        if a is None or b is None or pickle.dumps(a) != pickle.dumps(b):
            parts_s += [happens_s(one) for one in (a, b) if one is not None]
            break
    first = n if same.all() else int(np.argmin(same))
    return min(first, *np.searchsorted(ends_s + SAME_S, parts_s).tolist(), n)


def _on_board(world, scenario, seed, step, schedule, telemetry):
    """What comes to the computer in a run, and the computer. -> Link, Computer

    step : of pictures, if there are any
    """
    params, tracker = world.computer, tracker_on_board(scenario, world)
    line, take = faults.StarLine(world.faults.star_tracker, noise.generator(seed, "faults")), camera.expose
    if is_statistical := statistical.is_wanted(scenario):
        sight = statistical.Statistical(scenario, world, tracker, seed, line)
        step, take = sight.step, sight.expose
    shutter = Shutter(
        world.camera,
        world.flight.trajectory,
        every=round(TICK_HZ / scenario.star_tracker.rate),
        last_s=onboard.last_on_s(params, np.array(schedule.ends_s)),
        rng=noise.generator(seed, "camera_noise"),
        take=take,
    )
    if computer := flown.computer(scenario, params, world.alignment, world.earth):
        return Link(schedule, shutter, line, step, True, looks_ahead=False), computer
    if searching := flown.tracker(scenario, params, world.earth):
        step = searching.step
    link = Link(schedule, shutter, line, step, not is_statistical)
    navigation = flown.navigation(scenario, params, world.alignment, world.earth) or navigator.start(
        params.nav, world.alignment, world.earth, telemetry
    )
    # statistics find single stars by the prediction, and nothing else
    predicts = not is_statistical or params.tracker.vectors
    end = searching.close if searching else lambda: None
    return link, onboard.Computer(params, navigation, tracker, link.search, predicts, end)


class Link:
    """What comes to the computer in a mission, a `driving.Arrivals`: its schedule, and pictures.

    schedule : Schedule
    shutter, line : Shutter of the star camera, and StarLine from there to the computer
    step : of the star tracker's chain, which searches the pictures
    has_pictures : False if their content is made by statistics
    looks_ahead : False if the camera may be commanded at any tick, not only with a picture or while it is off
    commands : list of CameraCommand that the camera is yet to be given
    """

    def __init__(self, schedule, shutter, line, step, has_pictures, looks_ahead=True):
        self.schedule, self.shutter, self.line, self.commands = schedule, shutter, line, []
        self._step, self._has_pictures, self._looks_ahead = step, has_pictures, looks_ahead
        # (Frame as it came, FrameTruth) of the last tick that was asked for, and how long their steps took
        self._pictures, self._durations_s = [], []

    def next_tick(self, n):
        """As of Arrivals; the camera is given the commands of tick n, and takes a picture if one is due."""
        if n:
            commands, self.commands = self.commands, []
            self.shutter.tick(n, self.schedule.ends_s[n - 1], commands)
        if not self._looks_ahead:
            return n + 1
        return self.shutter.ahead(n, self.schedule.next_tick(n), self.schedule.ends_s)

    def at(self, n):
        """As of Arrivals."""
        now_s = self.schedule.ends_s[n - 1]
        self._pictures = self.shutter.arrived(now_s)
        if self.line.faults:
            self._pictures = [(self.line.picture(frame), truth) for frame, truth in self._pictures]
        return [*due(self.schedule.received, now_s), *(frame for frame, _ in self._pictures)]

    def search(self, *given):
        """A timed step of the chain. -> state, StarFix as it reaches the navigation, CameraCommand"""
        begin = time.perf_counter()
        state, fix, command = self._step(*given)
        self._durations_s.append(time.perf_counter() - begin)
        return state, self.line.fix(fix) if self.line.faults else fix, command

    def records_of(self, arrived):
        """Records of what has arrived at the last tick, truth of the pictures first."""
        if arrived:
            yield from (truth for _, truth in self._pictures)
            yield from (one for one in arrived if self._has_pictures or not isinstance(one, Frame))

    def durations(self, now_s):
        """ComputeTime of each picture that has been searched."""
        durations_s, self._durations_s = self._durations_s, []
        for (frame, _), duration_s in zip(self._pictures, durations_s, strict=False):
            if self._has_pictures:
                yield ComputeTime(now_s, frame.number, duration_s)


class Schedule:
    """What is still to come in a run, and at which tick.

    events, steered, received : lists in reverse order of time of Event, ControlSample, and of GpsFix,
        GpsRanges and readings of instruments
    ends_s : array of mission times at which the ticks end, from the first one on; its items are floats
    busy : ticks at which one of `received` has its turn
    ticks : int, how many are flown
    with_control : whether anybody wants the ControlSample
    stops : ticks that have a turn of their own in any case
    """

    def __init__(self, world, ends_s, until_s, with_control, stops=()):
        flight = world.flight
        self.events = list(flight.events)[::-1]
        steered = control_samples(flight.control, flight.trajectory) if with_control else None
        self.steered = [] if steered is None else rows(steered)[::-1]
        self.received = sorted(world.received, key=happens_s, reverse=True)
        self.ends_s = array("d", ends_s.tobytes())
        received_s = [happens_s(record) for record in self.received]
        self.busy = np.unique([*(np.searchsorted(ends_s + SAME_S, received_s) + 1), *stops]).tolist()
        self.ticks = int(np.searchsorted(ends_s, until_s + SAME_S, side="right"))

    def skip(self, n):
        """What has come until tick n is not to come any more."""
        for waiting in (self.events, self.steered, self.received) if n else ():
            due(waiting, self.ends_s[n - 1])

    def next_tick(self, n):
        """The first tick after n at which anything but a picture comes to the computer; or the last."""
        k = bisect_right(self.busy, n)
        return min(self.busy[k], self.ticks) if k < len(self.busy) else self.ticks


def tracker_on_board(scenario, world):
    """star_tracker.Tracker of a mission; CatalogueError where the stars that it wants are not there.

    Its stars are those of the day, within which none moves by more than 0.02 arcsec: a launch that is held
    for minutes flies the same catalogue.
    """
    year = round(ephemeris.julian_year(scenario.mission.epoch) * 365.25) / 365.25
    return star_tracker.init(world.computer.tracker, world.catalogue, year)


def warm_up(scenario, world=None):
    """Compile or load every kernel of the route, so that a run is not measured with its compiler.

    world : the one that is going to be flown, which stays as it is; None: a brief one is built
    """
    if world is None:
        world = prepare.build_world(scenario, seed=0, brief=True)
    # software of a user's own flies once, not here
    for _ in route(world, software.with_built_in(scenario), 0, until_s=scenario.mission.start + 1.5):
        pass
    tracker = tracker_on_board(scenario, world)
    state, command = star_tracker.start(tracker, scenario.mission.start)
    trajectory = looking_up(world.flight.trajectory, world.camera)
    rng = noise.generator(0, "camera_noise")
    picture, truth = camera.expose(world.camera, command, trajectory, 0, command.t_s, rng)
    at_rest = star_tracker.NO_CONTEXT._replace(omega_c=np.zeros(3), P_omega_c=1e-12 * np.eye(3))
    predicted = at_rest._replace(q_ic=truth.q_ic, P_c=1e-8 * np.eye(3))
    for context in (star_tracker.NO_CONTEXT, at_rest, predicted):  # every way to search a frame
        state, _, _ = star_tracker.step(tracker, state, picture, context)
        picture = picture._replace(t_valid_s=picture.t_valid_s + picture.exposure_s)


def looking_up(trajectory, camera):
    """The first second of a trajectory with the star camera held away from Earth and Sun. -> Trajectory"""
    brief = trajectory._make(np.ascontiguousarray(column[:IMU_HZ]) for column in trajectory)
    up_i, sun_i = brief.r_i[0] / np.linalg.norm(brief.r_i[0]), camera.bodies.sun_u_i
    z_i = up_i - max(0.0, up_i @ sun_i) * sun_i
    z_i = z_i / np.linalg.norm(z_i)
    x_i = wgs84.perpendicular(z_i)
    C_ic = np.column_stack([x_i, np.cross(z_i, x_i), z_i])
    q_ib = rotation.quat_from_dcm(C_ic @ camera.settings.mounting.C_bc.T)
    return brief._replace(q_ib=np.tile(q_ib, (len(brief.t_s), 1)), omega_ib_b=np.zeros_like(brief.v_i))


def happens_s(record):
    """When a record is there: what is measured, when it arrives."""
    return record.t_available_s if hasattr(record, "t_available_s") else record.t_s


def _nowhere(tick, order):
    """The place of a record is nobody's business."""


def due(waiting, now_s):
    """Take what is there by now from a list in reverse order of time."""
    arrived = []
    while waiting and happens_s(waiting[-1]) <= now_s + SAME_S:
        arrived.append(waiting.pop())
    return arrived


def truth_columns(world, every):
    """TruthSample and ControlSample of arrays, as a whole `route` would yield them.

    World; ticks from one TruthSample to the next -> list, without control where there is none
    """
    trajectory = world.flight.trajectory
    truth = truth_of(trajectory, every)
    control = control_samples(world.flight.control, trajectory)
    if control is None:
        return [truth]
    until_s = trajectory.t_s[(len(trajectory.t_s) - 1) // SAMPLES_PER_TICK * SAMPLES_PER_TICK] + SAME_S
    return [truth, ControlSample(*(column[control.t_s <= until_s] for column in control))]


def steady_columns(world, every):
    """Steady of a flight through a World that is logged; every : ticks from one sample to the next."""
    trajectory, blocks = world.flight.trajectory, imu.stacked(world.imu)
    ends_s, truth = blocks.t_valid_s, truth_of(trajectory, every)
    ticks = every * np.arange(1, len(ends_s) // every + 1)
    known = [(truth, ticks), (ImuBlock(*(column[ticks - 1] for column in blocks)), ticks)]
    control = control_samples(world.flight.control, trajectory)
    if control is not None:
        known.append((control, np.searchsorted(ends_s + SAME_S, control.t_s) + 1))
    return Steady(known, Columns(every, len(ends_s)))


def stops_of(ends_s, events):
    """Ticks at which the log is written, or an event belongs: after a tenth of a second, and every second.

    (N,) s, ends of the ticks; list of Event -> (M,)
    """
    seconds = np.arange(np.ceil(ends_s[0]), ends_s[-1])
    times_s = [ends_s[0] + 0.1, *seconds, *(one.t_s for one in events)]
    ticks = np.searchsorted(ends_s + SAME_S, times_s) + 1
    return ticks[ticks <= len(ends_s)]
