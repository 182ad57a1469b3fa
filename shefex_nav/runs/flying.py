"""Fly a scenario from Python: simulate, navigate, log, keep."""

import math
import shutil
import tempfile
import time
import weakref
from contextlib import chdir, contextmanager, nullcontext
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.log import thinning
from shefex_nav.log.checked import MOST_DIGITS
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.steady import Reached
from shefex_nav.log.topics import LogError, RunSummary, check_folder
from shefex_nav.pacing import SLOWEST, Pace
from shefex_nav.records import TruthSample
from shefex_nav.runs.room import Room
from shefex_nav.runs.run import Run
from shefex_nav.workers import collected_afterwards

FOLDER_PREFIX = "shefex_nav-"  # of temporary logs
LOG_NAME = "run.mcap"


class LogGoneError(LogError):
    """A flight came to its end, but its log is not there any more."""

    exit_code = 1


def _check(scenario, seed, until_s, pace):
    """TypeError or ValueError, in words, of what cannot be flown."""
    if pace is not None and not SLOWEST <= pace < math.inf:
        words = f"expected mission time over real time, from {SLOWEST:g} on, such as 1.0"
        raise ValueError(f"pace {pace!r}: {words}")
    if not hasattr(scenario, "mission"):
        raise TypeError(f"{scenario!r}: expected a Scenario, the path of one or the name of a shipped one")
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise ValueError(f"seed {seed!r}: expected a whole number from 0 on")
    if seed >= 10**MOST_DIGITS:
        raise ValueError(f"seed: expected {MOST_DIGITS} digits at most, which a log can say")
    earliest_s = thinning.earliest_end(scenario.mission.start)
    if until_s is not None and not (isinstance(until_s, Real) and until_s >= earliest_s):
        raise ValueError(f"until_s {until_s!r}: expected a time after the start, from {earliest_s:g} s on")


def _loaded(scenario):
    """The Scenario of a path or a name; whatever else it is, the same."""
    if not isinstance(scenario, str | PathLike):
        return scenario
    from shefex_nav.scenario.load import Scenario

    return Scenario.load(scenario)


def get_ready(scenario):
    """Compile what flying a Scenario needs and is not compiled yet."""
    from shefex_nav import warmup
    from shefex_nav.scenario.block import choices

    warmup.get_ready({"command=run", *choices(scenario)})


def _unwatched(records, _start_s, _end_s):
    return records


def _untold(_warnings):
    return None


def fly(
    scenario,
    seed: int = 1,
    *,
    until_s: float | None = None,
    log: str | Path | None = None,
    overwrite: bool = False,
    pace: float | None = None,
    watch=_unwatched,
    told=_untold,
) -> Run:
    """Fly a scenario once: simulate, navigate, log.

    Parameters
    ----------
    scenario : Scenario, path of its YAML file, or name of a shipped one (as of `Scenario.load`)
    seed : int
    until_s : mission time [s] at which to stop looking, which the log says. None: look to the end
    log : path of the log; without it a temporary one, which lives as long as the Run
    overwrite : whether an existing log may be replaced
    pace : mission time over real time, 1.0 in real time, 0.001 at least; None: as fast as it goes
    watch : function (records, start_s, end_s) -> the same records, called once; for progress bars. Of truth,
        control, IMU and built-in solution there are no records, but once a second at least log.steady.Reached
    told : function of a tuple of report.programme.Warned, wrong in the scenario; called before anything flies

    Returns
    -------
    Run; LogError if the log cannot be written, FlightError if the vehicle cannot be flown
    """
    scenario = _loaded(scenario)
    _check(scenario, seed, until_s, pace)
    from shefex_nav import prepare, simulate, warmup

    folder, path = _place(log)
    began, room = time.perf_counter(), Room(path.parent)
    get_ready(scenario)
    scenario = prepare.settled(scenario, room=room)
    world = prepare.build_world(scenario, seed, room=room)
    told(_warned(scenario, world.flight))
    room.release()
    simulate.tracker_on_board(scenario, world)  # one without a catalogue is refused before a log is replaced
    mission = prepare.mission(scenario, seed, world.flight.trajectory)
    if pace is not None or warmup.uses_are_noted():
        simulate.warm_up(scenario, world)  # in real time what takes longer the first time would be late
    clock = None if pace is None else Pace(pace)
    flight = _seen(world, scenario, seed, math.inf if until_s is None else until_s, watch, clock, room)
    with _beside_own_code(scenario, path):
        setup_s = time.perf_counter() - began
        data = _record(flight, mission, scenario.log, path.absolute(), overwrite, setup_s, pace)
    return Run(data, path, folder, clock and clock.real_time(), scenario=scenario)


def _warned(scenario, flight):
    """Tuple of report.programme.Warned, wrong in a Scenario or in it against its flight."""
    from shefex_nav.report import programme

    return (*programme.of_files(scenario), *programme.warnings(scenario, programme.of_flight(flight)))


def _place(log):
    """Folder of a log that nobody has named, or None, and the path of the log; LogError without a folder."""
    if not log:
        folder = Folder()
        return folder, folder.path / LOG_NAME
    check_folder(path := Path(log))  # here, for the truth of a long flight lies in it, too
    return None, path


@contextmanager
def _beside_own_code(scenario, path):
    """Context in which code of a user's own flies, which may go to another folder, or take the log away."""
    with _cycles(scenario), chdir(Path.cwd()):
        yield
    if not path.exists():
        raise LogGoneError(f"{path}: was flown to the end, but somebody has deleted the log meanwhile")


def _cycles(scenario):
    """Context in which cycles are searched afterwards; code of a user's own may make them without end."""
    from shefex_nav.scenario import software

    return nullcontext() if software.flown(scenario) or scenario.plugins else collected_afterwards()


class _Flight(NamedTuple):
    """A flight that is looked at."""

    records: object  # iterator, as `watch` passes them on
    steady: object  # log.steady.Steady, what does not come as records
    cut_s: float  # mission time at which it is not looked at any more, NaN if it is to the end
    room: Room  # in which its truth lies


def _seen(world, scenario, seed, until_s, watch, pace, room):
    """_Flight of a World in its Room; the other arguments are those of `fly`. pace : Pace"""
    from shefex_nav import simulate

    t_s = world.flight.trajectory.t_s
    steady = simulate.steady_columns(world, thinning.ticks(scenario.log.rate))
    records = simulate.route(world, scenario, seed, until_s=until_s, columns=steady, pace=pace)
    cut_s = float(until_s) if until_s < t_s[-1] else math.nan
    return _Flight(watch(records, float(t_s[0]), min(float(t_s[-1]), until_s)), steady, cut_s, room)


def _record(flight, mission, wanted, path, overwrite, setup_s, pace):
    """RunData of a _Flight, which is written to its log as well, thinned.

    wanted : what a scenario says of its log;  setup_s : how long everything before took
    pace : of a flight in real time, else None
    """
    from shefex_nav.log.drawings import FramePolicy
    from shefex_nav.log.writer import AT_A_PACE_S, EVERY_S, LogWriter

    began, kept = time.perf_counter(), RunDataBuilder(mission)
    frames = wanted.frames
    policy = FramePolicy(frames.full_every, frames.otherwise, frames.threshold_sigma)
    every_s = EVERY_S if pace is None else AT_A_PACE_S
    how = {"overwrite": overwrite, "flush_every_s": every_s, "steady": flight.steady}
    with LogWriter(path, mission, policy, **how) as writer:
        for record in thinning.thinned(flight.records, wanted.rate, mission.start_s):
            writer.write(record)
            if type(record) is Reached:
                flight.room.release()
            else:
                kept.add(record)
        columns = flight.steady.read()
        last_s = next(float(one.t_s[-1]) for one in columns if type(one) is TruthSample)
        done = RunSummary(last_s, time.perf_counter() - began, setup_s, flight.cut_s)
        writer.write(done)
        kept.add(done)
    return kept.build(columns)


class Folder:
    """A temporary folder that goes with whoever holds this."""

    def __init__(self):
        self.path = Path(tempfile.mkdtemp(prefix=FOLDER_PREFIX))
        weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)
