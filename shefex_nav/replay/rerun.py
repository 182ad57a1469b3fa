"""The on-board navigation again, over the measurements that a log has.

The log holds everything that the filter got: alignment, IMU blocks, GPS fixes, star fixes, each with the
instant at which it was available. With the configuration of the flight the same solution comes out, to the
last bit on a machine of the same type; with another one, the solution which that would have given. Star
fixes are those of the log: which frames were solved, and how, is not decided again.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from shefex_nav import prepare
from shefex_nav.clock import SAME_S
from shefex_nav.environment import ephemeris
from shefex_nav.log import reader
from shefex_nav.log.run_data import RunData
from shefex_nav.log.topics import ATTACHMENT, FAILED, LogError
from shefex_nav.onboard.driving import Recorded, drive
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.hypotheses import is_wide
from shefex_nav.onboard.navigation.state import NavParams
from shefex_nav.onboard.navigator import Navigator
from shefex_nav.records import QUANTITIES, ControlSample, Event, FrameTruth, Reason, TruthSample, row
from shefex_nav.replay import load as external_load
from shefex_nav.replay import own as external_own
from shefex_nav.replay import params as external_params
from shefex_nav.replay import runnable
from shefex_nav.report import local_level
from shefex_nav.scenario import load, params_onboard, software, surroundings
from shefex_nav.software import flown

CHANGEABLE = (  # what of a scenario may be changed after the flight
    "computer.software",
    "navigation.",
    *(f"requirements.{quantity}." for quantity in QUANTITIES),
    "requirements.integrity_risk",
)
TICKS = "navigation.samples_per_tick"  # but for this


class Recording(NamedTuple):
    """A log that can be run again."""

    path: str
    data: RunData
    params: NavParams  # of the filter that is run
    scenario_text: str  # with the overrides in it
    arrivals: Recorded  # GpsFix, GpsRanges, readings of instruments, StarFix, without an attitude too
    gravity: Any  # GravityModel of the field that the scenario names; None: external data name none
    software: tuple = ()  # as Mission.software, of what is run
    own: Callable | None = None  # starts the OwnNavigation that is run in the place of the filter
    field: Any = None  # GravityModel that is felt instead of the on-board one; None: that of the filter


def run(log_path, overrides=()):
    """Run the filter again over a log.

    Parameters
    ----------
    log_path : MCAP file
    overrides : texts 'navigation.key=value', or of requirements.attitude, of a filter that is configured
        otherwise than in flight

    Yields
    ------
    records in order of time: Alignment, then in each tick Event, TruthSample, FrameTruth, ImuBlock, what the
    sensors said, GateResult, NavSolution, at 10 Hz NavCovariance

    Raises
    ------
    LogError, ScenarioError with a message for people, before the first record
    """
    return records(open_log(log_path, overrides))


def open_log(log_path, overrides=()):
    """Recording of a log; LogError or ScenarioError where it cannot be run again."""
    for text in overrides:
        if not text.strip().startswith(CHANGEABLE):
            raise load.ScenarioError(
                [
                    f"--set {text.partition('=')[0].strip()}: the flight of a log is over; only what starts "
                    f"with {' or '.join(map(repr, CHANGEABLE))} can be changed"
                ]
            )
        if text.partition("=")[0].strip() == TICKS:
            raise load.ScenarioError(
                [f"--set {TICKS}: the samples of a log are in ticks already; replay its data"]
            )
    return of_data(reader.read(log_path), log_path, overrides)


def of_data(data, log_path, overrides=()):
    """Recording of a RunData, read from `log_path` or kept in memory under this name."""
    runnable.check(log_path, data)
    if data.alignment is not None and is_wide(data.alignment):
        raise LogError(
            f"{log_path}: begins with an angle of the attitude that was not known; its flight can be flown "
            "again (run), its filter cannot be run again over this log"
        )
    nav_params, source, known, own, running = _configuration(data, f"{log_path}: {ATTACHMENT}", overrides)
    if nav_params.stars == "vectors" and any(
        fix.reason == Reason.NONE and not len(fix.stars.hip) for fix in data.star_fixes
    ):
        raise LogError(
            f"{log_path}: cannot be run again with navigation.stars=vectors: its star fixes do not hold the "
            "stars by themselves; it was written by an older version"
        )
    stars = sorted(data.star_fixes, key=lambda fix: fix.t_available_s)
    return Recording(
        path=str(log_path),
        data=data,
        params=nav_params,
        scenario_text=source,
        gravity=known,
        own=own,
        software=running,
        arrivals=Recorded(data.imu.t_valid_s, *_received(data), stars),
    )


def _configuration(data, name, overrides):
    """NavParams, scenario text, gravity, OwnNavigation that flies instead of the filter or None, its name.

    Of the log of a mission, or of a replay of external data.
    """
    text = data.mission.scenario_text
    if local_level.is_replay(data):
        scenario = external_load.load_text(text, name, overrides)
        nav_params = external_params.nav_params(scenario, float(data.imu.dt_s[0]))
        own = None
        if software.flying(scenario) is not None:
            own = partial(external_own.navigation, scenario, data.alignment, data.mission.earth)
        return nav_params, scenario.source, None, own, software.flown(scenario)
    scenario = load.load_text(text, name, overrides)
    known = surroundings.gravity(scenario)
    scenario = prepare.settled(scenario)
    bodies = ephemeris.sky_bodies(scenario.mission.epoch)
    params = params_onboard.computer_params(scenario, bodies, np.empty((0, 2)))
    own, flies = None, software.flying(scenario)
    if flies == software.COMPUTER:
        raise LogError(
            f"{name}: computer.software: was flown by a computer of your own, which cannot be run again, for "
            "logs do not hold its pictures; --set computer.software=built_in runs the built-in filter"
        )
    if flies is not None:
        own = partial(flown.navigation, scenario, params, data.alignment, data.mission.earth)
    return params.nav, scenario.source, known, own, software.flown(scenario)


def until(recording, end_s, imu):
    """The same Recording as if its log ended at a mission time.

    imu : ImuBlock of arrays until then
    """
    data = recording.data
    arrays = {}
    for name in ("truth", "control"):
        whole = getattr(data, name)
        n = int(np.searchsorted(whole.t_s, end_s + SAME_S))
        arrays[name] = type(whole)(*(column[:n] for column in whole))
    events = [one for one in data.events if one.t_s <= end_s + SAME_S]
    frames = [one for one in data.frame_truths if one.t_valid_s <= end_s + SAME_S]
    return recording._replace(data=data._replace(imu=imu, events=events, frame_truths=frames, **arrays))


def _received(data):
    """Lists of what the sensors of a RunData said that have no pictures."""
    yield from (data.gps, data.gps_ranges)
    for arrays in data.readings.values():
        yield [row(arrays, k) for k in range(len(arrays.t_valid_s))]


def start(recording):
    """fusion.Filter at the alignment."""
    return fusion.start(recording.params, recording.data.alignment, recording.data.mission.earth)


def records(recording):
    """The records of `run`."""
    data = recording.data
    flies = Navigator(start(recording)) if recording.own is None else recording.own()
    yield data.alignment
    aside = not_seen_on_board(data)[::-1]
    for k, arrived, outputs in drive(flies, data.imu, recording.arrivals):
        block = row(data.imu, k)
        while aside and aside[-1][0] <= block.t_valid_s + SAME_S:
            yield aside.pop()[1]
        yield block
        yield from arrived
        yield from outputs
    for _, record in aside[::-1]:  # the impact, after the last tick
        yield record


def not_seen_on_board(data):
    """(t_s, record) of truth and events of a RunData, in order of time."""
    rank = {Event: 0, TruthSample: 1, ControlSample: 2, FrameTruth: 3}
    # that the software of the flight failed is no event of what is run instead
    pairs = [(event.t_s, event) for event in data.events if event.name != FAILED]
    pairs += [(frame.t_valid_s, frame) for frame in data.frame_truths]
    for arrays in (data.truth, data.control):
        pairs += [(t_s, row(arrays, k)) for k, t_s in enumerate(arrays.t_s.tolist())]
    return sorted(pairs, key=lambda pair: (pair[0], rank[type(pair[1])]))
