"""One flight, flown or read from its log: records as arrays, errors, pictures, figures."""

import shutil
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav.log import mcap_file, other_solutions, reader
from shefex_nav.log.run_data import stack
from shefex_nav.log.topics import LogError
from shefex_nav.records import Event, GpsFix, ImuBlock, NavSolution, Reason, StarFix, TruthSample
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.runs.frames import Frames, nearest

KEEP = "log.frames of the scenario says which are kept: full_every, otherwise"


def open_run(log: str | Path) -> "Run":
    """The Run of a log, of a killed run too; LogError if it is none."""
    return Run(reader.read(log), Path(log))


class Errors(NamedTuple):
    """Truth minus estimate, and the standard deviations that the filter reports.

    Attributes
    ----------
    t_s : (N,) s, mission time of the errors
    position_i, velocity_i : (N, 3) m, m/s, inertial axes; the true one is the estimate plus this
    attitude_b : (N, 3) rad, rotation vector in body axes, q_ib(true) = q_ib(estimate) * exp(attitude_b)
    sigma_t_s : (K,) s, of the logged covariances, ten times fewer than the errors at 100 Hz
    sigma_position_i, sigma_velocity_i : (K, 3) m, m/s, standard deviations along the inertial axes
    sigma_attitude_b : (K, 3) rad, standard deviations about the body axes

    The errors at the times of the sigmas are `errors.attitude_b[np.searchsorted(errors.t_s, errors.sigma_t_s
    - 1e-6)]`; `errors.at(t_s)` has both at one instant.
    """

    t_s: np.ndarray
    position_i: np.ndarray
    velocity_i: np.ndarray
    attitude_b: np.ndarray
    sigma_t_s: np.ndarray
    sigma_position_i: np.ndarray
    sigma_velocity_i: np.ndarray
    sigma_attitude_b: np.ndarray

    def at(self, t_s):
        """Errors at the instants nearest to a mission time [s]: numbers and (3,) in place of the arrays.

        LookupError where the run has none within a second.
        """
        k, j = nearest(self.t_s, t_s, "errors"), nearest(self.sigma_t_s, t_s, "standard deviations")
        return Errors(*(column[k] for column in self[:4]), *(column[j] for column in self[4:]))


class Run:
    """One flight: its records as arrays, its pictures, its figures.

    Attributes
    ----------
    data : RunData, every record of the log
    log : Path of the log
    real_time : pacing.RealTime, how well it has kept its pace; None of one that had none
    filter : name of another filter whose solution it has (`with_solution`, `others`); '' of what flew
    """

    def __init__(self, data, log, folder=None, real_time=None, filter="", scenario=None):
        self.data = data
        self.log = log
        self.real_time = real_time
        self.filter = filter
        self._scenario = scenario
        self._folder = folder  # a temporary log is deleted with it

    def __repr__(self):
        mission = self.data.mission
        ends = (
            (self.data.failure, "failed at"),
            (self.data.ended_early, "ended early at"),
            (self.data.until_s is not None, "looked at until"),
        )
        end = next((words for holds, words in ends if holds), "ended at")
        end += f" T{self.data.reached_s:+.1f} s"
        kept = "log not saved" if self._folder else self.log
        own = "".join(f", {name}" for _, name, _ in mission.software)
        return f"<Run {mission.scenario}, seed {mission.seed}{own}, {end}, {kept}>"

    def _repr_mimebundle_(self, include=None, exclude=None, **_):
        """The closing table, where a notebook shows what the last line of a cell is."""
        return self.table()._repr_mimebundle_(include or (), exclude or ()) | {"text/plain": repr(self)}

    @cached_property
    def scenario(self):
        """The Scenario that was flown; None of external data, or where this version cannot read that text."""
        from shefex_nav.report import configured

        return self._scenario or configured.configured(self.data).scenario

    @property
    def truth(self) -> TruthSample:
        """TruthSample of arrays over the ticks of the on-board clock."""
        return self.data.truth

    @property
    def solution(self) -> NavSolution:
        """NavSolution of arrays over the ticks of the on-board clock."""
        return self.data.nav

    @property
    def events(self) -> list[Event]:
        """list of Event in order of time."""
        return self.data.events

    @property
    def imu(self) -> ImuBlock:
        """ImuBlock of arrays over the ticks, as the on-board computer got them."""
        return self.data.imu

    @property
    def gps(self) -> GpsFix:
        """GpsFix of arrays over the fixes."""
        return stack(GpsFix, self.data.gps)

    @property
    def star_fixes(self) -> list[StarFix]:
        """list of StarFix, one a frame; those without an attitude say why by their `reason`."""
        return self.data.star_fixes

    @cached_property
    def tables(self):
        """The tables that `shefex-nav export` writes, by name: `run.tables["nav"].to_pandas()`."""
        from shefex_nav.report.tables import Tables

        return Tables(self.data)

    @property
    def others(self):
        """{name: Run} of what other filters say of this flight in its log (`write_solution`)."""
        return {name: self._with_other(name, one) for name, one in self.data.others.items()}

    def with_solution(self, t_s, r, v, q, P=None, *, frame="i", name="other"):
        """What another filter says of this flight, as a Run: with errors, NEES and figures of its own.

        Raises ValueError where an array is no such thing.

        Parameters
        ----------
        t_s : (N,) s, mission times, increasing; those that are times of `truth` have errors, half at least
        r, v : (N, 3) m, m/s, of the IMU; v relative to the axes of r
        q : (N, 4) attitude, body axes to those of r, Hamilton, scalar first
        P : (N, 9, 9) covariance of the errors, truth minus estimate: position and velocity in the axes of r,
            attitude as a rotation vector in body axes [rad]; None without one
        frame : axes of r: 'i' inertial, 'e' Earth-fixed
        name : of the filter, lower case
        """
        from shefex_nav.report import other_solution

        given = other_solution.Given(t_s, r, v, q, P)
        return self._with_other(name, other_solution.other(self.data, given, frame, name))

    def _with_other(self, name, other):
        """Run of this flight with log.other_solutions.Other of a filter."""
        return Run(self.data.with_other(name, other), self.log, filter=name)

    def write_solution(self, other, log):
        """Write a copy of this run's log with what another filter says in it. -> the Run of the copy

        other : Run of `with_solution` or of `others` of this flight, under its name
        log : path of the copy, which must not exist
        Raises LogError.
        """
        if not other.filter:
            raise LogError(f"{other!r} has no other filter's solution; expected a Run of with_solution")
        if not _is_one_flight(self.data, other.data):
            raise LogError(f"{self.log}: is not the flight that {other.filter!r} is about, {other!r}")
        if not mcap_file.is_closed(self.log):
            raise LogError(f"{self.log}: was not closed, its run was killed; it cannot be copied whole")
        found = {other.filter: other_solutions.Other(other.data.nav, other.data.covariance)}
        other_solutions.write(self.log, log, self.data.mission, found)
        return open_run(log)

    def event(self, name):
        """The first Event of a name, such as 'apogee' or 'entry'; LookupError if there was none."""
        for event in self.events:
            if event.name == name:
                return event
        names = ", ".join(dict.fromkeys(event.name for event in self.events)) or "none"
        raise LookupError(f"there was no event {name!r}; the run has: {names}")

    def errors(self) -> Errors:
        """Errors of position, velocity and attitude with their standard deviations."""

        errors, covariance = navigation_errors(self.data), self.data.covariance
        sigma = np.sqrt(np.einsum("kii->ki", covariance.P))
        return Errors(*errors, covariance.t_s, sigma[:, :3], sigma[:, 3:6], sigma[:, 6:])

    def summary(self) -> dict:
        """The object that `shefex-nav run --json` prints: dict of numbers, texts and None."""
        from shefex_nav.report import metrics

        summary = metrics.summarise(self.data, log=self.log, scenario=self.scenario)
        return summary if self.real_time is None else summary | {"real_time": self.real_time._asdict()}

    def table(self, name=None):
        """The closing table of `shefex-nav run`, a rich Table; with a name, that of `tables`."""
        if name is not None:
            return self.tables[name]
        from shefex_nav.report import configured, table

        summary = self.summary()
        if self._folder:  # a temporary log is nobody's business
            summary["log"] = None
        return table.summary_table(summary, configured.judged(self.data, summary, self.scenario))

    @cached_property
    def frames(self) -> Frames:
        """Frames of the star camera by mission time: `run.frames[300.0]`, `len(run.frames)`, iteration."""
        return Frames(self.data, self.log)

    @property
    def plot(self):
        """Figures of the run, each of matplotlib: `run.plot.attitude()`; `dir(run.plot)` names them."""
        from shefex_nav.report import figures

        names = [entry.name for entry in figures.catalogue()]
        return figures.Plots(names, lambda name: figures.draw(name, self.data))

    def glance(self, t_s=None):
        """The run in one Figure: a frame with its stars named, the flight, attitude errors inside 3 sigma.

        t_s : mission time of the frame; None: the middle of those that gave an attitude
        Raises LookupError where the log has no truth or keeps no pixels.
        """
        from shefex_nav.report.figures import glance

        if not len(self.data.truth.t_s):
            raise LookupError(f"{self.log}: has no truth, which the errors are drawn against")
        seen = self.frames.middle() if t_s is None else self.frames[t_s]
        if seen is None and not any(fix.reason == Reason.NONE for fix in self.data.star_fixes):
            raise LookupError(f"{self.log}: no frame gave an attitude; name the time of one")
        if seen is None or seen.image_dn is None:
            which = "the frames" if seen is None else f"the frame of T{seen.t_s:+.1f} s"
            raise LookupError(f"{self.log}: keeps no pixels of {which}; {KEEP}")
        return glance.glance(self.data, seen)

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


def _is_one_flight(data, other):
    """Whether two RunData have one scenario, seed and truth."""
    told = [(one.mission.scenario_text, one.mission.seed, one.mission.epoch_utc) for one in (data, other)]
    truths = ((one.truth.t_s, one.truth.r_i, one.truth.v_i, one.truth.q_ib) for one in (data, other))
    return told[0] == told[1] and all(
        np.array_equal(*pair, equal_nan=True) for pair in zip(*truths, strict=True)
    )
