"""Fly a scenario from Python and look at what came out; a log read back gives the same object.

    scenario = Scenario.load("shefex2_andoya")
    run = fly(scenario, seed=1)
    run.solution.q_ib            # (N, 4), 100 times a second
    run.errors().attitude_b      # (N, 3) rad, truth minus estimate
    run.frames[300.0].image_dn   # the picture of the star camera at T+300 s
    run.frames[300.0].plot()     # ... with what was found in it: a matplotlib Figure, as all pictures
    run.plot.attitude()
    run.errors().at(run.event("entry").t_s).position_i

Arrays are in SI units and radians; the frames of their components are the last letter of their names.
"""

import math
import shutil
import tempfile
import time
import weakref
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.log import pixels, reader, thinning
from shefex_nav.log.run_data import RunDataBuilder, stack
from shefex_nav.log.topics import LogError, RunSummary, epoch_ns, log_time_ns
from shefex_nav.pacing import Pace
from shefex_nav.records import FrameTruth, GpsFix, StarFix

FOLDER_PREFIX = "shefex_nav-"  # of temporary logs
LOG_NAME = "run.mcap"
MOST_AWAY_S = 1.0  # between the time asked for and the one that there is


def _check(scenario, seed, until_s, pace):
    """TypeError or ValueError, in words, of what cannot be flown."""
    if pace is not None and not 0.0 < pace < math.inf:
        raise ValueError(f"pace {pace!r}: expected mission time over real time, above 0, such as 1.0")
    if not hasattr(scenario, "mission"):
        raise TypeError(f"a Scenario is flown, not {scenario!r}: load it with Scenario.load(path)")
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed {seed!r}: expected a whole number from 0 on")
    if not until_s >= earliest_end(scenario):
        raise ValueError(
            f"until_s {until_s!r}: expected a time after the start, from {earliest_end(scenario):g} s on"
        )


def earliest_end(scenario):
    """Mission time [s] by which every log has a record of each kind that comes at a steady rate."""
    return scenario.mission.start + 1.0 / thinning.LOWEST_HZ


def get_ready(scenario):
    """Compile what flying a Scenario needs and is not compiled yet."""
    from shefex_nav import warmup
    from shefex_nav.scenario.choices import choices

    warmup.get_ready({"command=run", *choices(scenario)})


def fly(
    scenario,
    seed=1,
    *,
    until_s=math.inf,
    log=None,
    overwrite=False,
    pace=None,
    watch=lambda records, *_: records,
    told=lambda warnings: None,
):
    """Fly a scenario once: simulate, navigate, log.

    Parameters
    ----------
    scenario : Scenario
    seed : int
    until_s : mission time [s] at which to stop looking; the vehicle flies to its end all the same, and the
        log says that it was not seen
    log : path of the log; without it a temporary one, which lives as long as the Run
    overwrite : whether an existing log may be replaced
    pace : mission time over real time, 1.0 for a flight in real time, above 0; None: as fast as it goes
    watch : function (records, start_s, end_s) -> the same records, called once; for progress bars
    told : function of what the scenario gets wrong of the flight, a tuple of report.programme.Warned, called
        before the sensors see it

    Returns
    -------
    Run

    Raises LogError if the log cannot be written, FlightError if the vehicle cannot be flown, TypeError or
    ValueError for what is no scenario, seed or time.
    """
    _check(scenario, seed, until_s, pace)
    from shefex_nav import prepare, simulate
    from shefex_nav.report import programme

    folder = None if log else Folder()
    path = Path(log) if log else folder.path / LOG_NAME
    began = time.perf_counter()
    get_ready(scenario)
    scenario = prepare.settled(scenario)
    world = prepare.build_world(scenario, seed)
    flown = programme.of_flight(world.flight)
    told((*programme.of_trajectory(scenario), *programme.warnings(scenario, flown)))
    mission = prepare.mission(scenario, seed, world.flight.trajectory)
    simulate.warm_up(scenario, world)
    setup_s = time.perf_counter() - began
    clock = None if pace is None else Pace(pace)
    records, cut_s = _seen(world, scenario, seed, until_s, watch, clock)
    data = _record(records, mission, scenario.log, path, overwrite, setup_s, cut_s)
    return Run(data, path, folder, clock and clock.real_time())


def _seen(world, scenario, seed, until_s, watch, pace):
    """Records of a flight as `watch` passes them on, and when it is looked at no more, as of `_record`."""
    from shefex_nav import simulate

    t_s = world.flight.trajectory.t_s
    records = simulate.route(world, scenario, seed, until_s=until_s, pace=pace)
    cut_s = float(until_s) if until_s < t_s[-1] else math.nan
    return watch(records, float(t_s[0]), min(float(t_s[-1]), until_s)), cut_s


def _record(records, mission, wanted, path, overwrite, setup_s, cut_s):
    """RunData of the records of a flight, which are written to its log as well, thinned.

    wanted : what a scenario says of its log;  setup_s : how long everything before took
    cut_s : mission time at which it was not looked at any more, NaN if it was to the end
    """
    from shefex_nav.log.drawings import FramePolicy
    from shefex_nav.log.writer import LogWriter

    began, kept = time.perf_counter(), RunDataBuilder(mission)
    frames = wanted.frames
    policy = FramePolicy(frames.full_every, frames.otherwise, frames.threshold_sigma)
    with LogWriter(path, mission, policy, overwrite=overwrite) as writer:
        for record in thinning.thinned(records, wanted.rate, mission.start_s):
            writer.write(record)
            kept.add(record)
        done = RunSummary(kept.last_t_s, time.perf_counter() - began, setup_s, cut_s)
        writer.write(done)
        kept.add(done)
    return kept.build()


def open_run(log):
    """The Run of a log, of a killed run too; LogError if it is none."""
    return Run(reader.read(log), Path(log))


class Folder:
    """A temporary folder that goes with whoever holds this."""

    def __init__(self):
        self.path = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)


class Errors(NamedTuple):
    """Truth minus estimate, and what the filter believes of it."""

    t_s: np.ndarray  # (N,) of the errors
    position_i: np.ndarray  # (N, 3) m
    velocity_i: np.ndarray  # (N, 3) m/s
    attitude_b: np.ndarray  # (N, 3) rad, rotation vector
    sigma_t_s: np.ndarray  # (K,) of the logged covariances
    sigma_position_i: np.ndarray  # (K, 3) m
    sigma_velocity_i: np.ndarray  # (K, 3) m/s
    sigma_attitude_b: np.ndarray  # (K, 3) rad

    def at(self, t_s):
        """Errors at the instants nearest to a mission time [s]: numbers and (3,) in place of the arrays.

        LookupError where the run has none within a second.
        """
        k, j = _nearest(self.t_s, t_s, "errors"), _nearest(self.sigma_t_s, t_s, "standard deviations")
        return Errors(*(column[k] for column in self[:4]), *(column[j] for column in self[4:]))


class Run:
    """One flight: its records as arrays, its pictures, its figures.

    Attributes
    ----------
    data : RunData, every record of the log
    log : Path of the log
    real_time : pacing.RealTime, how well it has kept its pace; None of one that had none
    """

    def __init__(self, data, log, folder=None, real_time=None):
        self.data = data
        self.log = log
        self.real_time = real_time
        self._folder = folder  # a temporary log is deleted with it

    def __repr__(self):
        mission = self.data.mission
        ends = (
            (self.data.failure, "failed at"),
            (self.data.ended_early, "ended early at"),
            (self.data.until_s is not None, "looked at until"),
        )
        end = next((words for holds, words in ends if holds), "ended at")
        end += f" T{self.data.last_t_s:+.1f} s"
        kept = "log not saved" if self._folder else self.log
        own = "".join(f", {name}" for _, name, _ in mission.software)
        return f"<Run {mission.scenario}, seed {mission.seed}{own}, {end}, {kept}>"

    @property
    def truth(self):
        """TruthSample of arrays over the ticks of the on-board clock."""
        return self.data.truth

    @property
    def solution(self):
        """NavSolution of arrays over the ticks of the on-board clock."""
        return self.data.nav

    @property
    def events(self):
        """list of Event in order of time."""
        return self.data.events

    @property
    def imu(self):
        """ImuBlock of arrays over the ticks, as the on-board computer got them."""
        return self.data.imu

    @property
    def gps(self):
        """GpsFix of arrays over the fixes."""
        return stack(GpsFix, self.data.gps)

    @cached_property
    def tables(self):
        """The tables that `shefex-nav export` writes, by name: `run.tables["nav"].to_pandas()`."""
        from shefex_nav.report.tables import Tables

        return Tables(self.data)

    @property
    def others(self):
        """{name: Run} of what other filters say of this flight in its log (`write_solution`)."""
        return {
            name: Run(self.data.with_other(name, one), self.log) for name, one in self.data.others.items()
        }

    def with_solution(self, t_s, r, v, q, P=None, *, frame="i", name="other"):
        """What another filter says of this flight, as a Run: with errors, NEES and figures of its own.

        Raises ValueError where an array is no such thing.

        Parameters
        ----------
        t_s : (N,) s, mission times, increasing; those that are times of `truth` have errors
        r, v : (N, 3) m, m/s, of the IMU; v relative to the axes of r
        q : (N, 4) attitude, body axes to those of r, Hamilton, scalar first
        P : (N, 9, 9) covariance of the errors, truth minus estimate: position and velocity in the axes of r,
            attitude as a rotation vector in body axes [rad]; None without one
        frame : axes of r: 'i' inertial, 'e' Earth-fixed
        name : of the filter, lower case
        """
        from shefex_nav.report import other_solution

        given = other_solution.Given(t_s, r, v, q, P)
        return Run(self.data.with_other(name, other_solution.other(self.data, given, frame, name)), self.log)

    def write_solution(self, other, log):
        """Write a copy of this run's log with what another filter says in it. -> the Run of the copy

        other : Run of `with_solution`, under its name;  log : path of the copy, which must not exist
        Raises LogError.
        """
        from shefex_nav.log import other_solutions

        if self.data.ended_early and not self.data.failure:
            raise LogError(f"{self.log}: was not closed, its run was killed; it cannot be copied whole")
        name = other.data.mission.software[0][1]
        found = {name: other_solutions.Other(other.data.nav, other.data.covariance)}
        other_solutions.write(self.log, log, self.data.mission, found)
        return open_run(log)

    def event(self, name):
        """The first Event of a name, such as 'apogee' or 'entry'; LookupError if there was none."""
        for event in self.events:
            if event.name == name:
                return event
        names = ", ".join(dict.fromkeys(event.name for event in self.events)) or "none"
        raise LookupError(f"there was no event {name!r}; the run has: {names}")

    def errors(self):
        """Errors of position, velocity and attitude with their standard deviations."""
        from shefex_nav.report import metrics

        errors, covariance = metrics.navigation_errors(self.data), self.data.covariance
        sigma = np.sqrt(np.einsum("kii->ki", covariance.P))
        return Errors(*errors, covariance.t_s, sigma[:, :3], sigma[:, 3:6], sigma[:, 6:])

    def summary(self):
        """The object that `shefex-nav run --json` prints: dict of numbers, texts and None."""
        from shefex_nav.report import metrics

        summary = metrics.summarise(self.data, log=self.log)
        return summary if self.real_time is None else summary | {"real_time": self.real_time._asdict()}

    def table(self):
        """The closing table of `shefex-nav run`, a rich Table."""
        from shefex_nav.report import configured, table

        summary = self.summary()
        if self._folder:  # a temporary log is nobody's business
            summary["log"] = None
        return table.summary_table(summary, configured.judged(self.data, summary))

    @cached_property
    def frames(self):
        """Frames of the star camera by mission time: `run.frames[300.0]`, `len(run.frames)`, iteration."""
        return Frames(self.data, self.log)

    @property
    def plot(self):
        """Figures of the run, each of matplotlib: `run.plot.attitude()`; `dir(run.plot)` names them."""
        from shefex_nav.report import figures

        names = [entry.name for entry in figures.catalogue()]
        return figures.Plots(names, lambda name: figures.draw(name, self.data))

    def view(self, save=None):
        """Open the run in the rerun viewer and wait until it is closed, or save its recording (.rrd)."""
        from shefex_nav.report import viewer

        viewer.view(self.log, save=save)

    def save(self, path):
        """Copy the log to a path that does not exist yet; returns it."""
        path = Path(path)
        if path.exists():
            raise FileExistsError(f"{path}: exists already; choose another name")
        shutil.copyfile(self.log, path)
        return path


class SeenFrame(NamedTuple):
    """One frame of the star camera, what came out of it and what it really looked at."""

    number: int
    t_s: float  # middle of the exposure
    exposure_s: float
    gain_db: float
    image_dn: np.ndarray | None  # (rows, columns) grey values; None where the log keeps none
    is_full: bool  # as read out; otherwise the background of the sky is zero
    fix: StarFix | None  # of the star tracker; None if the run ended before
    truth: FrameTruth | None

    def plot(self):
        """Figure of the frame with what was found in it and what it really looked at."""
        from shefex_nav.report.figures import frame

        if self.image_dn is None:
            raise LookupError(f"the log keeps no pixels of frame {self.number} (log.frames in the scenario)")
        return frame.frame(self)


class Frames:
    """The frames of a run; their pixels are read from its log when they are asked for."""

    def __init__(self, data, log):
        self._data, self._log = data, log
        self._fixes = {fix.number: fix for fix in data.star_fixes}
        self._truths = {truth.number: truth for truth in data.frame_truths}
        self.t_s = data.frames.t_valid_s  # (N,) middles of the exposures

    def __len__(self):
        return len(self.t_s)

    def __getitem__(self, t_s):
        """SeenFrame nearest to a mission time [s]; LookupError before the first and after the last frame."""
        return self._frame(_nearest(self.t_s, t_s, "frame of the star camera"))

    def __iter__(self):
        return (self._frame(k) for k in range(len(self)))

    def _frame(self, k):
        frames = self._data.frames
        number, ns = int(frames.number[k]), log_time_ns(epoch_ns(self._data.mission.epoch_utc), self.t_s[k])
        found = pixels.at(self._log, int(ns))
        return SeenFrame(
            number,
            float(self.t_s[k]),
            float(frames.exposure_s[k]),
            float(frames.gain_db[k]),
            found.image_dn if found else None,
            bool(found and found.is_full),
            self._fixes.get(number),
            self._truths.get(number),
        )


def _nearest(times_s, t_s, what):
    """Index of the time nearest to t_s, at most a second off; LookupError."""
    k = int(np.argmin(np.abs(times_s - t_s))) if len(times_s) else -1
    if k < 0 or not abs(times_s[k] - t_s) <= MOST_AWAY_S:
        covered = f"T{times_s[0]:+.1f} to {times_s[-1]:+.1f} s" if k >= 0 else "no time"
        raise LookupError(f"no {what} at T{t_s:+.1f} s; the run has them for {covered}")
    return k
