"""A replay from beginning to end: what was recorded in, a log and a summary out."""

import math
import time
from contextlib import contextmanager

from shefex_nav import __version__, warmup
from shefex_nav.errors import UserError
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.topics import RunSummary
from shefex_nav.onboard.driving import drive
from shefex_nav.onboard.navigator import Navigator
from shefex_nav.records import ImuBlock
from shefex_nav.replay import air, external, rerun, said
from shefex_nav.report import metrics
from shefex_nav.scenario.choices import choices

BRIEF_TICKS = 300  # of a log, by which everything is compiled: the first fixes are among them


class NothingLeft(UserError):
    """Statistics are to begin where the data are over."""


def _unwatched(records, _start_s, _end_s):
    return records


def of_data(scenario, files, from_s, log, watch=_unwatched):
    """Replay external data.

    Parameters
    ----------
    scenario, files : ReplayScenario, and the paths of its data by their names: what `load.load` returns
    from_s : mission time [s] from which on there are statistics
    log : Path of a log that is written, or None
    watch : function (records, start_s, end_s) -> the same records, called once; for progress bars

    Returns
    -------
    dict of numbers, texts and None: what `shefex-nav replay --json` prints

    Raises NothingLeft, DataError, LogError.
    """
    began = time.perf_counter()
    warmup.get_ready({"command=replay", *choices(scenario)})
    ready = external.prepare(scenario, files)
    end_s = float(ready.blocks.t_valid_s[-1])
    _check_within(from_s, end_s)
    external.warm_up(ready)
    setup_s, clock = time.perf_counter() - began, external.Clock()
    mission = external.mission(ready)
    records = watch(external.run(ready, clock), mission.start_s, end_s)
    data = _collect(records, mission, end_s, setup_s, log)
    summary = _summary(data, log, from_s, clock.filter_s, end_s - mission.start_s)
    summary["warnings"] = [one._asdict() for one in ready.oddities]
    summary["alignment"], summary["clocks"] = ready.start, said.clocks(ready.common, data)
    summary["barometer"] = air.highest(ready.data.readings.get("barometer", ()), ready.alignment, data)
    return summary


def of_log(recording, from_s, log, watch=_unwatched):
    """Run the filter again over the log of a rerun.Recording. The rest is as of `of_data`."""
    _check_within(from_s, float(recording.data.imu.t_valid_s[-1]))
    began = time.perf_counter()
    warmup.get_ready({"command=replay of a log"})
    data = recording.data
    brief = ImuBlock(*(column[:BRIEF_TICKS] for column in data.imu))
    for _ in drive(Navigator(rerun.start(recording)), brief, recording.arrivals):
        pass
    setup_s = time.perf_counter() - began
    name = f"{data.mission.scenario} (replayed)"
    mission = data.mission._replace(scenario=name, scenario_text=recording.scenario_text, version=__version__)
    mission = mission._replace(software=recording.software)
    end_s = float(data.imu.t_valid_s[-1])
    records = watch(rerun.records(recording), mission.start_s, end_s)
    replayed = _collect(records, mission, end_s, setup_s, log, until_s=data.cut_s)
    return _summary(replayed, log, from_s, None, end_s - mission.start_s)


def _check_within(from_s, end_s):
    """Refuse statistics that begin where there is nothing left."""
    if from_s >= end_s:
        raise NothingLeft(f"{from_s:g} s is not before the end of the data, T{end_s:+.1f} s")


def _collect(records, mission, end_s, setup_s, log, *, until_s=math.nan):
    """RunData of records, which are written to the log as well, if there is one."""
    began = time.perf_counter()
    kept = RunDataBuilder(mission)
    with _writer(log, mission) as write:
        for record in records:
            write(record)
            kept.add(record)
        done = RunSummary(end_s, time.perf_counter() - began, setup_s, until_s)
        write(done)
        kept.add(done)
    return kept.build()


@contextmanager
def _writer(path, mission):
    """Gives a function which writes a record, to the log or, without a path, nowhere."""
    if path is None:
        yield lambda record: None
        return
    from shefex_nav.log.drawings import FramePolicy
    from shefex_nav.log.writer import LogWriter

    with LogWriter(path, mission, FramePolicy(0, "none", 4.0)) as log:
        yield log.write


def _summary(data, log, from_s, filter_s, length_s):
    """What `run` gives, and how long the filter itself took."""
    summary = metrics.summarise(data, log=log, from_s=from_s)
    summary["filter_s"] = filter_s
    summary["filter_real_time_factor"] = length_s / filter_s if filter_s else None
    return summary
