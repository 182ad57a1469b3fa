"""One run of a campaign: its scenario, the mission, what is kept of it."""

import io
import os
import re
import sys
import time
import traceback
from importlib import import_module
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import ONE_THREAD

PACKAGE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
LONGEST_REASON = 500


class WorkerError(Exception):
    """A worker that cannot fly this campaign; the message says why."""


class Flown(NamedTuple):
    """A run that is over."""

    record: dict  # what runs/000123.json holds
    series: bytes | None  # what runs/000123.npz holds; None of a run that failed


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

    def fly(self, job, log=None):
        """Fly one run, with a log at the path `log` if one is given. -> Flown

        An exception is the end of the run, not of the campaign: it becomes the run's reason and traceback.
        """
        from shefex_nav.campaign.plan import digest

        began, cpu_s, record = time.perf_counter(), time.process_time(), _record(job)
        try:
            summary, kept = self._mission(job, log)
        except Exception as error:
            record |= {"status": "failed", "reason": _reason(error), "traceback": _traceback(error)}
            series = None
        else:
            series = _npz(kept)
            record |= {"summary": summary, "series_sha256": digest(series)}
        record["timing"] = {
            "wall_s": time.perf_counter() - began,
            "cpu_s": time.process_time() - cpu_s,
            "start_s": self.start_s,
            "peak_memory_mb": _peak_memory_mb(),
        }
        return Flown(record, series)

    def _mission(self, job, log):
        """(summary, series) of a run."""
        from shefex_nav import prepare
        from shefex_nav.campaign.series import series
        from shefex_nav.report import metrics

        scenario = self.scenario(job)
        if log is None:
            scenario.keep_text("", {})  # its text goes into logs alone, and takes as long to make as all else
        world = prepare.build_world(scenario, job.seed, flight=self.flight)
        trajectory = world.flight.trajectory
        data = _records(scenario, job.seed, world, log)
        summary = metrics.summarise(data)
        return summary, series(data, scenario, job.seed, trajectory, self.plan.series_rate)


def _peak_memory_mb():
    """The most memory that this process has had, MB; None where that is not told."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def _record(job):
    """Record of a run that has not been flown yet."""
    return {
        "run": job.run,
        "status": "succeeded",
        "reason": "",
        "traceback": "",
        "seed": job.seed,
        "draws": job.draws,
        "summary": {},
        "series_sha256": "",
        "timing": {},
    }


def lost(job, reason):
    """Flown of a run that never came back."""
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
    from shefex_nav.records import ImuBlock

    mission, began = prepare.mission(scenario, seed, world.flight.trajectory), time.perf_counter()
    kept = RunDataBuilder(mission)
    every = thinning.ticks(thinning.LOWEST_HZ)
    if log is None:
        for record in simulate.route(world, scenario, seed, every=every):
            if type(record) is not ImuBlock:
                kept.add(record)
        return kept.build()
    frames = scenario.log.frames
    policy = FramePolicy(frames.full_every, frames.otherwise, frames.threshold_sigma)
    with LogWriter(log, mission, policy, overwrite=True) as writer:
        for record in thinning.thinned(
            simulate.route(world, scenario, seed), scenario.log.rate, mission.start_s
        ):
            writer.write(record)
            if type(record) is not ImuBlock and thinning.stays(record, every, mission.start_s):
                kept.add(record)
        writer.write(RunSummary(kept.last_t_s, time.perf_counter() - began, 0.0))
    return kept.build()


def _npz(arrays):
    """Arrays as the bytes of an .npz file; the same arrays give the same bytes."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


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

_pilot = None  # Pilot of this process, or why there is none


def prepare_worker(plan, runs_at_a_time=1):
    """Make this process ready to fly the runs of a plan; a fault is raised by the first run."""
    global _pilot
    try:
        if runs_at_a_time != 1:
            raise WorkerError(f"a worker flies {runs_at_a_time} runs at a time; start each with --nthreads 1")
        _check_threads()
        _check_versions(plan.versions)
        _pilot = Pilot(plan)
    except Exception as error:
        _pilot = error


def fly(job):
    """Fly one run in a worker that has been prepared."""
    if isinstance(_pilot, Exception):
        raise _pilot
    if _pilot is None:
        raise WorkerError("a worker was not told what to fly")
    return _pilot.fly(job)


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
            raise WorkerError(f"start the worker with {name}=1, it is {os.environ.get(name, 'not set')}")
