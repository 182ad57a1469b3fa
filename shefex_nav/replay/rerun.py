"""The on-board navigation again, over the measurements that a log has.

The log holds everything that the filter got: alignment, IMU blocks, GPS fixes, star fixes, each with the
instant at which it was available. With the configuration of the flight the same solution comes out, to the
last bit on a machine of the same type; with another one, the solution which that would have given. Star
fixes are those of the log: which frames were solved, and how, is not decided again.

It needs an alignment, and every IMU block from there to the end: each begins where the one before it ends. A
log that somebody has changed may hold blocks that do not, readings of no sensor and an alignment elsewhere
than the vehicle was; what the filter would say of them looks like a result (`check_runnable`).
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
from shefex_nav.log.topics import ATTACHMENT, FAILED, LogError, of_record
from shefex_nav.onboard.driving import Recorded, drive
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.hypotheses import is_wide
from shefex_nav.onboard.navigation.state import NavParams
from shefex_nav.onboard.navigator import Navigator
from shefex_nav.records import (
    QUANTITIES,
    Alignment,
    ControlSample,
    Event,
    FrameTruth,
    GpsFix,
    ImuBlock,
    Reason,
    TruthSample,
    row,
)
from shefex_nav.replay import load as external_load
from shefex_nav.replay import params as external_params
from shefex_nav.replay.dataset import PULLS, TURNS
from shefex_nav.report import local_level
from shefex_nav.scenario import load, params_onboard, software, surroundings
from shefex_nav.software import flown

SIGMAS = 10.0  # [E] by which the alignment may be off
SLACK_R, SLACK_V = 1e5, 1e3  # [E] m, m/s, beyond them: where sigmas are told too small
SAME = 1e-6  # rounding of covariances
NEAR_S = 1.0  # of the truth that an alignment is compared with
LARGEST = {  # [E] of an alignment; beyond them nothing is known of a flight, and covariances overflow
    "r_i": (1e9, "m"),
    "v_i": (1e6, "m/s"),
    "sigma_r": (1e9, "m"),
    "sigma_v": (1e6, "m/s"),
    "omega_i": (TURNS, "rad/s"),
    "gyro_bias": (TURNS, "rad/s"),
    "sigma_gyro_bias": (TURNS, "rad/s"),
}
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
    check_runnable(log_path, data)
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
            own = partial(external_params.navigation, scenario, data.alignment, data.mission.earth)
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
    pairs += [*timed(data.truth), *timed(data.control)]
    return sorted(pairs, key=lambda pair: (pair[0], rank[type(pair[1])]))


def timed(arrays, time="t_s"):
    """(t_s, record) of each row of a record of arrays. time : the field that is their time"""
    return [(t_s, row(arrays, k)) for k, t_s in enumerate(getattr(arrays, time).tolist())]


def check_runnable(path, data):
    """LogError unless the filter can be run again over a RunData. path : of its log, for messages"""
    if data.alignment is None:
        raise _cannot(path, "it has no alignment to start from")
    if not len(data.imu.t_valid_s):
        raise _cannot(path, "it has no IMU samples; give the log of the flight itself")
    begin_s = np.concatenate([[data.alignment.t_valid_s], data.imu.t_valid_s[:-1]])
    _whole(path, data.imu, begin_s)
    _follow(path, data.imu, begin_s)
    _sensed(path, data.imu)
    _known(path, data.alignment)
    _placed(path, data)
    _alike(path, data.gps)


def _cannot(path, words):
    return LogError(f"{path}: cannot be run again: {words}")


def _whole(path, imu, begin_s):
    """LogError of IMU blocks that are missing. begin_s : (N,) ends of the blocks before, or the alignment"""
    length_s = imu.dt_s[0] * imu.dtheta_b.shape[1]
    step_s = imu.t_valid_s - begin_s
    gaps = np.flatnonzero(step_s > 1.5 * length_s)
    if not len(gaps):
        return
    if (usual_s := np.median(step_s)) > 1.5 * length_s:
        words = f"{1.0 / usual_s:.0f} IMU blocks a second of the {1.0 / length_s:.0f} that were measured"
        raise _cannot(path, f"it has {words}; fly with --set log.rate='100 Hz'")
    missed = f"T{begin_s[gaps[0]]:+.2f} s to T{imu.t_valid_s[gaps[0]]:+.2f} s"
    raise _cannot(path, f"IMU samples are missing from {missed}")


def _follow(path, imu, begin_s):
    """LogError of a block that does not begin where the one before it, or the alignment, is."""
    n = imu.dtheta_b.shape[1]
    apart = np.abs(imu.t_valid_s - begin_s - n * imu.dt_s) > SAME_S
    if not apart.any():
        return
    k = int(apart.argmax())
    end_s, length_s, imu_topic = imu.t_valid_s[k], n * imu.dt_s[k], of_record(ImuBlock).topic
    samples = f"{n} samples of {imu.dt_s[k]:.10g} s"
    if k == 0:
        place = f"{of_record(Alignment).topic}: t_valid_s: got {begin_s[0]:.10g}"
        words = f"where the {samples} of {imu_topic}, message 1, begin, which end at {end_s:.10g}"
        raise LogError(f"{path}: {place}, expected {end_s - length_s:.10g}, {words}")
    words = f"got {end_s:.10g}, expected {begin_s[k] + length_s:.10g}"
    follow = f"its {samples} (dt_s) follow on {begin_s[k]:.10g}"
    raise LogError(f"{path}: {imu_topic}: message {k + 1}: t_valid_s: {words}: {follow}")


def _sensed(path, imu):
    """LogError of increments that no sensor measures."""
    for name, most, unit in (("dtheta_b", TURNS, "rad/s"), ("dv_b", PULLS, "m/s^2")):
        size = np.abs(getattr(imu, name)).max(axis=(1, 2)) / imu.dt_s
        bad = (size > most) & imu.valid
        if bad.any():
            k = int(bad.argmax())
            words = f"got {size[k]:.4g} {unit} over {imu.dt_s[k]:.4g} s, expected {most:g} {unit} at most"
            raise LogError(f"{path}: {of_record(ImuBlock).topic}: message {k + 1}: {name}: {words}")


def _known(path, told):
    """LogError of an alignment whose numbers are too large to begin with, or none."""
    for name, (most, unit) in LARGEST.items():
        size = float(np.linalg.norm(getattr(told, name)))
        if not size <= most:
            words = f"got {size:.4g} {unit}, expected {most:g} {unit} at most"
            raise LogError(f"{path}: {of_record(Alignment).topic}: {name}: {words}")
    if len(P := told.P_with_biases) and not _goes_with(P, told.P_theta_b):
        words = "expected a covariance, 9 x 9, that begins with that of the attitude"
        raise LogError(f"{path}: {of_record(Alignment).topic}: P_with_biases: {words}")


def _goes_with(P, P_theta_b):
    """Whether a matrix of an alignment is a covariance, of the same attitude. (n, 9), (3, 3)"""
    if P.shape != (9, 9) or not np.allclose(P[:3, :3], P_theta_b, rtol=SAME, atol=0.0):
        return False
    sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
    sigma[sigma == 0.0] = 1.0  # then the row is zero
    correlations = P / np.outer(sigma, sigma)
    return bool(np.allclose(P, P.T) and np.linalg.eigvalsh(correlations)[0] > -SAME)


def _placed(path, data):
    """LogError of an alignment that is far from the truth, where the log has it."""
    told, truth = data.alignment, data.truth
    apart_s = np.abs(truth.t_s - told.t_valid_s)
    if apart_s.min(initial=np.inf) > NEAR_S:
        return
    k = int(apart_s.argmin())
    sigma_v = told.sigma_v + float(np.linalg.norm(told.omega_i)) * told.sigma_r
    for name, most, unit in (
        ("r_i", SIGMAS * told.sigma_r + SLACK_R, "m"),
        ("v_i", SIGMAS * sigma_v + SLACK_V, "m/s"),
    ):
        off = float(np.linalg.norm(getattr(told, name) - getattr(truth, name)[k]))
        if off > most:
            words = f"is {off:.4g} {unit} from the truth at T{truth.t_s[k]:+.2f} s"
            place = f"{path}: {of_record(Alignment).topic}: {name}"
            raise LogError(f"{place}: {words}, expected {most:.4g} {unit} at most")


def _alike(path, fixes):
    """LogError of fixes of which some have a height and some have none: one receiver gives one kind."""
    kinds = [fix.horizontal for fix in fixes if fix.valid]
    if len(set(kinds)) > 1:
        k = [fix.valid and fix.horizontal != kinds[0] for fix in fixes].index(True)
        words = f"got {bool(fixes[k].horizontal)}, expected {bool(kinds[0])} as of the fixes before"
        raise LogError(f"{path}: {of_record(GpsFix).topic}: message {k + 1}: horizontal: {words}")
