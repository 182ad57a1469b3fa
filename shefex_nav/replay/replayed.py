"""A replay from beginning to end: what was recorded in, a log and a summary out."""

import math
import time
from contextlib import contextmanager

import numpy as np

from shefex_nav import __version__, warmup
from shefex_nav.clock import SAME_S
from shefex_nav.environment import atmosphere
from shefex_nav.errors import UserError
from shefex_nav.geometry import frames, wgs84
from shefex_nav.instruments import state_sizes
from shefex_nav.log import thinning
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.topics import RunSummary
from shefex_nav.onboard.driving import drive
from shefex_nav.onboard.navigation import measure_barometer
from shefex_nav.onboard.navigation.blocks import OPTIONAL
from shefex_nav.onboard.navigation.state import POS
from shefex_nav.onboard.navigator import Navigator
from shefex_nav.records import ImuBlock
from shefex_nav.replay import external, rerun, said
from shefex_nav.report import metrics
from shefex_nav.scenario.block import choices

BRIEF_TICKS = 300  # of a log, by which everything is compiled: the first fixes are among them


class NothingLeft(UserError):
    """Statistics are to begin where the data are over, or the data are to end before they begin."""

    option = "--from"


class NothingBefore(NothingLeft):
    """The data are to end before they begin."""

    option = "--until"


def _unwatched(records, _start_s, _end_s):
    return records


def of_data(scenario, files, from_s, log, watch=_unwatched, *, until_s=math.inf):
    """Replay external data.

    Parameters
    ----------
    scenario, files : ReplayScenario, and the paths of its data by their names: what `load.load` returns
    from_s : mission time [s] from which on there are statistics
    log : Path of a log that is written, or None
    watch : function (records, start_s, end_s) -> the same records, called once; for progress bars
    until_s : mission time [s] until which the data are looked at

    Returns
    -------
    dict of numbers, texts and None: what `shefex-nav replay --json` prints

    Raises NothingLeft, DataError, LogError.
    """
    began = time.perf_counter()
    warmup.get_ready({"command=replay", *choices(scenario)})
    ready = external.prepare(scenario, files)
    imu, cut_s = _looked_at(ready.blocks, ready.alignment.t_valid_s, from_s, until_s)
    ready, end_s = ready._replace(blocks=imu), float(imu.t_valid_s[-1])
    external.warm_up(ready)
    setup_s, clock = time.perf_counter() - began, external.Clock()
    mission = external.mission(ready)
    records = watch(external.run(ready, clock), mission.start_s, end_s)
    data = _collect(records, mission, end_s, setup_s, log, until_s=cut_s)
    summary = _summary(data, log, from_s, clock.filter_s, end_s - mission.start_s)
    odd = (*ready.oddities, *said.contradiction(data))
    summary["warnings"] = [{"field": field, "text": text} for field, text in odd]
    summary["alignment"], summary["clocks"] = ready.start, said.clocks(ready.common, data)
    readings = [one for one in ready.data.readings.get("barometer", ()) if one.t_valid_s <= end_s + SAME_S]
    summary["barometer"] = highest(readings, ready.alignment, data)
    return summary


def of_log(recording, from_s, log, watch=_unwatched, *, until_s=math.inf):
    """Run the filter again over the log of a rerun.Recording. The rest is as of `of_data`."""
    imu, cut_s = _looked_at(recording.data.imu, recording.data.mission.start_s, from_s, until_s)
    if math.isfinite(cut_s):
        recording = rerun.until(recording, cut_s, imu)
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
    replayed = _collect(records, mission, end_s, setup_s, log, until_s=float(np.fmin(cut_s, data.cut_s)))
    return _summary(replayed, log, from_s, None, end_s - mission.start_s)


def _looked_at(imu, start_s, from_s, until_s):
    """ImuBlock of arrays as far as it is looked at, and the time at which it is cut, NaN where it is not.

    NothingLeft, NothingBefore where nothing is left.
    """
    n = int(np.searchsorted(imu.t_valid_s, until_s + SAME_S))
    earliest_s = max(thinning.earliest_end(start_s), float(imu.t_valid_s[0]))
    if until_s < earliest_s - SAME_S:
        raise NothingBefore(
            f"{until_s:g} s is not after the start of the data, T{start_s:+g} s: from {earliest_s:g} s on "
            "there is something to see"
        )
    end_s, is_cut = float(imu.t_valid_s[n - 1]), n < len(imu.t_valid_s)
    if from_s >= end_s:
        what = "what is looked at" if is_cut else "the data"
        raise NothingLeft(f"{from_s:g} s is not before the end of {what}, T{end_s:+.1f} s")
    return ImuBlock(*(column[:n] for column in imu)), until_s if is_cut else math.nan


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


# ----------------------------------------------------------------------------------------------------------
# What a replay with a barometer says of heights: by the pressure alone, and by the filter.


TABLE_M = np.arange(-1000.0, 80001.0, 20.0)  # geometric heights
BEFORE_S = 0.5  # [E] of readings that are of the start, where the data begin with it


def pressure_altitude(pressure):
    """Geopotential altitude in the US Standard Atmosphere of static pressures. (N,) Pa -> (N,) m"""
    logs = np.log([atmosphere.us76(height)[1] for height in TABLE_M])
    geometric = np.interp(-np.log(pressure), -logs, TABLE_M)
    return atmosphere.EARTH_RADIUS * geometric / (atmosphere.EARTH_RADIUS + geometric)


def highest(readings, alignment, data):
    """JSON object about the greatest pressure altitude above the start; None without readings.

    readings : of the barometer in the data set;  alignment : Alignment;  data : RunData of the replay
    """
    if not readings or data.covariance is None or not len(data.covariance.t_s):
        return None
    t_s, pressure = (np.array([getattr(one, name) for one in readings]) for name in ("t_valid_s", "pressure"))
    still = t_s <= max(alignment.t_valid_s, t_s[0] + BEFORE_S)
    altitude = pressure_altitude(pressure)
    above = altitude - altitude[still].mean()
    later = t_s >= data.nav.t_s[0]
    top = int(np.argmax(np.where(later, above, -np.inf)))
    earth = data.mission.earth
    k = int(np.argmin(np.abs(data.nav.t_s - t_s[top])))
    start_e, _ = frames.ecef_from_inertial(earth, alignment.t_valid_s, alignment.r_i, alignment.v_i)
    heights = [wgs84.geodetic_from_ecef(r_e)[2] for r_e in (start_e, data.nav.r_e[k])]
    j = int(np.argmin(np.abs(data.covariance.t_s - data.nav.t_s[k])))
    warmth, sigma_warmth = _warmth(data.covariance, j, heights[1])
    return {
        "t_s": float(t_s[top]),
        "pressure_altitude_m": float(above[top]),
        "height_m": heights[1] - heights[0],
        "sigma_height_m": _sigma_height(earth, data, k, j, alignment),
        "warmer_by": warmth,
        "sigma_warmer_by": sigma_warmth,
    }


def _sigma_height(earth, data, k, j, alignment):
    """1 sigma of the height above the start [m] at sample k of the solution, j of the covariances.

    Fixes with a height tell it anew: what the start is off by is another error. Without them it is in all
    heights, and the sigma of one is too large for the difference, if anything.
    """
    r_e, t_s = data.nav.r_e[k], data.nav.t_s[k]
    up_e = -wgs84.level_axes(r_e)[:, 2]
    up_i = frames.dcm_ie(earth, t_s) @ up_e
    start = 0.0 if all(fix.horizontal for fix in data.gps if fix.valid) else alignment.sigma_r
    return float(np.hypot(start, np.sqrt(up_i @ data.covariance.P[j][POS, POS] @ up_i)))


def _warmth(covariance, j, height):
    """Mean share by which the air below a height [m] is warmer than the Standard, and its 1 sigma; None, None
    where it is not estimated. The layers' errors are counted as one."""
    states = covariance.states[j].split()
    if "baro_scale" not in states:
        return None, None
    sizes = OPTIONAL | state_sizes()
    first = sum(sizes[name] for name in states[: states.index("baro_scale")])
    block = slice(first, first + sizes["baro_scale"])
    parts = measure_barometer.thicknesses(height)
    weights = parts / parts.sum()
    return float(weights @ covariance.estimates[j][block]), float(weights @ covariance.sigmas[j][block])
