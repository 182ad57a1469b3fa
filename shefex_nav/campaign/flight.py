"""One run of a campaign: its scenario, the mission, what is kept of it."""

import errno
import hashlib
import io
import json
import os
import re
import sys
import time
import traceback
from contextlib import ExitStack
from importlib import import_module
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled.target import ONE_THREAD
from shefex_nav.errors import UserError
from shefex_nav.workers import collected_afterwards

PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
LONGEST_REASON = 500
LACKING = errno.ENOMEM, errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE  # of OSErrors
OF_THE_MACHINE = (MemoryError, OSError, ImportError)  # exceptions that say nothing of the run


class WorkerError(UserError):
    """A worker that cannot fly this campaign; the message says why."""


class MachineError(Exception):
    """Trouble of a machine, of which a run is not to be judged: no memory, no disk, a package missing."""


class Flown(NamedTuple):
    """A run that is over."""

    record: dict  # draws, status, reason, summary ...: `_record`
    series: bytes | None  # an .npz file; None of a run that failed


class Pilot:
    """Flies the runs of one plan; what they have in common is made once."""

    def __init__(self, plan):
        began = time.perf_counter()
        from shefex_nav.campaign import flight_file
        from shefex_nav.scenario import load

        for name in ("simulate", "report.metrics"):  # what a run needs, so that none is measured with it
            import_module(f"shefex_nav.{name}")
        self.plan = plan
        self.pattern = load.Pattern(plan.source, plan.name)
        self.flight = flight_file.from_bytes(plan.flight) if plan.shared else None
        self.start_s = time.perf_counter() - began  # from the first import on

    def scenario(self, job):
        """Scenario of a run."""
        return self.pattern.with_draws(job.draws)

    def fly(self, job):
        """Fly one run, with a log if the job asks for one. -> Flown

        An exception is the end of the run, not of the campaign: it becomes the run's reason and traceback.
        Raises MachineError where the fault is not the run's, LogError if its log cannot be written.
        """
        from shefex_nav.log.topics import LogError

        began, cpu_s, record, series = time.perf_counter(), time.process_time(), _record(job), None
        try:
            with collected_afterwards():
                summary, kept = self._mission(job)
            json.dumps(summary, allow_nan=False)  # what cannot be kept is a fault of the run
            series = _npz(kept)
            record |= {"summary": summary, "series_sha256": _arrays_digest(kept)}
        except OF_THE_MACHINE as error:
            raise MachineError(_reason(error)) from error
        except LogError:
            raise
        except (Exception, SystemExit) as error:
            if _is_of_machine(error.__cause__):  # of a user's own code, which has its words around it
                raise MachineError(_reason(error)) from error
            record |= {"status": "failed", "reason": _reason(error), "traceback": _traceback(error)}
        record["timing"] = {
            "wall_s": time.perf_counter() - began,
            "cpu_s": time.process_time() - cpu_s,
            "start_s": self.start_s,
            "peak_memory_mb": _peak_memory_mb(),
        }
        return Flown(record, series)

    def _mission(self, job):
        """(summary, series) of a run."""
        from shefex_nav import prepare
        from shefex_nav.campaign.series import series
        from shefex_nav.report import metrics
        from shefex_nav.scenario import software

        scenario = self.scenario(job)
        if job.log is None and not software.flown(scenario):
            scenario.keep_text("", {})  # its text goes into logs alone, and takes as long to make as all else
        world = prepare.build_world(scenario, job.seed, flight=self.flight, biases=True)
        data = _records(scenario, job.seed, world, job.log)
        summary = metrics.summarise(data, scenario=scenario)
        return summary, series(data, world.flight.trajectory, world.imu_biases, self.plan.series_rate)


def _is_of_machine(cause):
    """Whether code of a user's own had no memory or disk left. cause : its exception, or None"""
    return isinstance(cause, MemoryError) or getattr(cause, "errno", None) in LACKING


def _peak_memory_mb():
    """The most memory that this process has had, MB; None where that is not told.

    On Linux not by `getrusage`: a new process takes over the peak of the one that started it.
    """
    try:
        with open("/proc/self/status", encoding="ascii") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) * 1024 / 1e6
    except (OSError, StopIteration):
        pass
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def _record(job):
    """Record of a run that has not been flown yet."""
    from shefex_nav.campaign.plan import writable

    return {
        "run": job.run,
        "status": "succeeded",
        "reason": "",
        "traceback": "",
        "seed": job.seed,
        "draws": writable(job.draws),
        "summary": {},
        "series_sha256": "",  # of the arrays
        "timing": {},
    }


def given_up(job, reason):
    """Flown of a run that no worker outlives: failed, without a traceback."""
    return Flown(_record(job) | {"status": "failed", "reason": reason}, None)


def _records(scenario, seed, world, log):
    """RunData of a mission, truth and solution at 10 Hz, as figures need them; all there is is in the log.

    Without the IMU's samples, which no figure needs.
    """
    from shefex_nav import prepare, simulate
    from shefex_nav.log import thinning
    from shefex_nav.log.drawings import FramePolicy
    from shefex_nav.log.run_data import RunDataBuilder
    from shefex_nav.log.topics import RunSummary
    from shefex_nav.log.writer import LogWriter
    from shefex_nav.onboard.navigator import Columns
    from shefex_nav.records import ImuBlock
    from shefex_nav.scenario import software

    mission, began = prepare.mission(scenario, seed, world.flight.trajectory), time.perf_counter()
    kept = RunDataBuilder(mission)
    every = thinning.ticks(thinning.LOWEST_HZ)
    if log is None and software.flying(scenario) is None:
        columns = Columns(every)
        for record in simulate.route(world, scenario, seed, columns=columns):
            kept.add(record)
        return kept.build(simulate.truth_columns(world, every) + columns.read())
    frames = scenario.log.frames
    policy = FramePolicy(frames.full_every, frames.otherwise, frames.threshold_sigma)
    with ExitStack() as open_ones:
        write = _unwritten
        if log is not None:
            write = open_ones.enter_context(LogWriter(log, mission, policy, overwrite=True)).write
        for record in thinning.thinned(
            simulate.route(world, scenario, seed), scenario.log.rate, mission.start_s
        ):
            write(record)
            if type(record) is not ImuBlock and thinning.stays(record, every, mission.start_s):
                kept.add(record)
        write(RunSummary(kept.last_t_s, time.perf_counter() - began, 0.0))
    return kept.build()


def _unwritten(record):
    """Of a record that goes to no log."""


def _npz(arrays):
    """Arrays as the bytes of an .npz file."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def _arrays_digest(arrays):
    """sha256 of arrays by name: of their values, not of what a version of zlib makes of them."""
    total = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        values = np.ascontiguousarray(values)
        values = values.astype(values.dtype.newbyteorder("<"))
        total.update(f"{name} {values.dtype.str} {values.shape}\n".encode() + values.tobytes())
    return total.hexdigest()


def _reason(error):
    """The first line of what an exception says."""
    words = str(error).strip().splitlines()
    return f"{type(error).__name__}: {words[0] if words else ''}"[:LONGEST_REASON].rstrip(": ")


def _traceback(error):
    """The traceback as text that is the same on every machine: no addresses, no places of files."""
    text = "".join(traceback.format_exception(error))
    text = text.replace(PACKAGE, os.path.basename(PACKAGE))
    text = re.sub(r'File "[^"]*[/\\](?:site-packages|python3\.\d+)[/\\]', 'File "', text)
    return re.sub(r"0x[0-9a-fA-F]{6,}", "0x...", text)


# ---- in a worker -----------------------------------------------------------------------------------------

_pilots = {}  # digest of a plan -> Pilot of this process, or why there is none


def prepare_worker(plan, runs_at_a_time=1):
    """Make this process ready to fly the runs of a plan, too; a fault is raised by the first run."""
    if isinstance(_pilots.get(plan.digest), Pilot):
        return
    try:
        if runs_at_a_time != 1:
            raise WorkerError(f"a worker flies {runs_at_a_time} runs at a time; start each with --nthreads 1")
        _check_threads()
        _check_versions(plan.versions)
        _pilots[plan.digest] = Pilot(plan)
    except Exception as error:
        _pilots[plan.digest] = error


def dismiss(plan):
    """Forget a plan."""
    _pilots.pop(plan.digest, None)


def fly(job):
    """Fly one run in a worker that has been prepared for its plan."""
    pilot = _pilots.get(job.plan)
    if isinstance(pilot, Exception):
        raise pilot
    if pilot is None:
        raise WorkerError("a worker was not told what to fly")
    return pilot.fly(job)


def _check_versions(wanted):
    """The same program as the one that asks; another NumPy or code may end in other last digits."""
    from shefex_nav.campaign.plan import versions

    own = versions()
    differ = [
        f"{name} {own.get(name)}, not {value}" for name, value in wanted.items() if own.get(name) != value
    ]
    if differ:
        raise WorkerError(
            f"a worker has {'; '.join(differ)}: all need the same, from the first run to the last"
        )


def _check_threads():
    """One thread for linear algebra: sums in another order would end in other last digits."""
    for name in ONE_THREAD:
        if os.environ.get(name) != "1":
            given = os.environ.get(name, "not set") or "empty"
            raise WorkerError(f"start the worker with {name}=1, it is {given}")
