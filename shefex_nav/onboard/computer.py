"""The executive of the on-board computer: `predict` from tick to tick, `update` with what has arrived at one.

Order within a tick: strapdown and prediction with the IMU block, star tracker chain on the frames that have
arrived, fusion of the GPS fixes and star fixes that are due, solution. A StarFix enters the filter at the
first tick not earlier than its `t_available_s`.

The computer's state is a tuple; the memory of the filter inside it (`fusion.Filter`: history of the last
`history_s`, health of the sensors) is changed in place, because copying it at every tick would cost more
than the tick. So a state that has been advanced must not be advanced again.
"""

from math import acos, sqrt
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import kernel
from shefex_nav.geometry import frames, rotation, shutter, wgs84
from shefex_nav.onboard.navigation import fusion, mean_rate, search, strapdown
from shefex_nav.onboard.navigation import ticks as filter_ticks
from shefex_nav.onboard.navigation.state import ATT, X_MOUNTING, X_Q, X_R, X_V, NavParams
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.onboard.telemetry import RECORDS
from shefex_nav.records import Reason

PREDICTION_FLOOR = np.radians(40.0 / 3600.0)  # rad; aberration, which the predicted places do not have


class ComputerParams(NamedTuple):
    """Parameters of the on-board computer."""

    nav: NavParams
    tracker: star_tracker.TrackerParams
    sun_i: np.ndarray  # (3,) unit vector to the Sun, constant within the mission


class Computer(NamedTuple):
    """State of the computer after a tick."""

    params: ComputerParams
    earth: Any  # EarthRotation
    nav: fusion.Filter
    tracker: star_tracker.Tracker
    tracker_state: Any  # star_tracker.TrackerState while switched on, else None
    waiting: tuple  # StarFix that are not available yet
    ticks: int
    bank: Any = None  # hypotheses.Bank while an angle of the attitude is not known; nav is the best of it


def start(params, alignment, earth, catalogue, julian_year):
    """Computer at the instant of the alignment.

    Parameters
    ----------
    params : ComputerParams
    alignment : Alignment
    earth : EarthRotation
    catalogue, julian_year : as `star_tracker.init` wants them

    Returns
    -------
    Computer
    """
    tracker = star_tracker.init(params.tracker, catalogue, julian_year)
    nav, bank = search.start(params.nav, alignment, earth)
    return Computer(params, earth, nav, tracker, None, (), 0, bank)


def predict(computer, blocks, first, last, telemetry=RECORDS):
    """On with ImuBlocks, up to the first tick at which the computer itself has something to do.

    Parameters
    ----------
    computer : Computer, all ticks before updated
    blocks : ImuBlock of arrays, of which rows first ... last - 1 are meant
    telemetry : who is told of the ticks, `telemetry.Records` or `telemetry.Columns`

    Returns
    -------
    computer : Computer at a tick that has not been updated
    done : int, ticks that were made, at least one
    outputs : list of (tick, records), what there is to tell of the ticks before the last
    """
    if computer.bank is not None:
        search.advance(computer.bank, blocks, first)
        return computer._replace(ticks=computer.ticks + 1), 1, []
    ticks, is_now = computer.ticks, computer.tracker_state is not None
    switches = np.flatnonzero(is_on(computer.params, blocks.t_valid_s[first:last]) != is_now)
    if len(switches):
        last = first + int(switches[0]) + 1
    due_s = min((fix.t_available_s for fix in computer.waiting), default=np.inf)
    if due_s < blocks.t_valid_s[last - 1]:
        last = first + int(np.searchsorted(blocks.t_valid_s[first:last], due_s - SAME_S)) + 1
    done, outputs = predict_filter(computer.nav, ticks, blocks, first, last, telemetry)
    return computer._replace(ticks=ticks + done), done, outputs


def predict_filter(nav, ticks, blocks, first, last, telemetry=RECORDS):
    """`ticks.advance`, and what is told of the ticks on the way.

    Parameters
    ----------
    nav : fusion.Filter
    ticks : of this run, made before
    blocks, first, last : as there
    telemetry : as in `predict`

    Returns
    -------
    done : int, ticks that were made
    outputs : list of (tick, list of records), without the last tick, of which there may be more to tell
    """
    blind = nav.watch.imu_blind  # until the last tick: it ends there if that changes
    done = filter_ticks.advance(nav, blocks, first, last)
    return done, telemetry.passed(nav, ticks, ticks + done, blind)


def update(computer, gps_fixes, frames_arrived, *, chain=star_tracker.step, context=None, telemetry=RECORDS):
    """What is done at the tick that the filter has reached, with what has arrived since the one before.

    Parameters
    ----------
    computer : Computer
    gps_fixes : sequence of GpsFix and GpsRanges with t_available_s not later than this tick, each handed
        over once
    frames_arrived : sequence of Frame, likewise
    chain : `star_tracker.step`, or something that wraps it to see how long it takes
    context : as `star_context`, which it is by default: what the chain wants to know of a frame
    telemetry : as in `predict`

    Returns
    -------
    computer : Computer
    outputs : list of records in the order in which they came about: CameraCommand (the first when the tracker
        is switched on, then one with each frame), StarFix, GateResult, what the telemetry hands over
    """
    now_s, outputs, due = computer.nav.history.ends_s[-1], [], ()
    if computer.waiting or frames_arrived or _switches(computer, now_s):
        computer, outputs, due = _track_stars(computer, now_s, frames_arrived, chain, context or star_context)
    if computer.bank is not None:
        computer, more = _search(computer, gps_fixes, due, telemetry)
        return computer, outputs + more
    return computer, outputs + update_filter(computer.nav, computer.ticks, gps_fixes, due, telemetry)


def _search(computer, gps_fixes, star_fixes, telemetry):
    """`update_filter` while an angle of the attitude is not known. -> Computer, records"""
    params, bank = computer.params, computer.bank
    outputs = search.fuse(bank, gps_fixes, star_fixes) if len(gps_fixes) or len(star_fixes) else []
    found = search.settled(bank, params.nav, computer.earth) if outputs else None
    if found is None:
        outputs = outputs + telemetry.now(search.teller(bank), computer.ticks)
        return computer._replace(nav=bank.best), outputs
    outputs = outputs + telemetry.now(found, computer.ticks)
    return computer._replace(nav=found, bank=None), outputs


def update_filter(nav, ticks, gps_fixes, star_fixes, telemetry=RECORDS):
    """What a tick does once the filter has been advanced and the star tracker has had its turn.

    Parameters
    ----------
    nav : fusion.Filter
    ticks : of this run, this one included
    gps_fixes : GpsFix and GpsRanges that have become available
    star_fixes : StarFix likewise, also those that hold nothing for the filter
    telemetry : as in `predict`

    Returns
    -------
    list of GateResult and NavHealth, then what the telemetry hands over
    """
    outputs = fusion.take(nav, gps_fixes, star_fixes) if len(gps_fixes) or len(star_fixes) else []
    outputs += nav.watch.changes()
    outputs += telemetry.now(nav, ticks)
    return outputs


def is_on(params, now_s):
    """Whether camera and star tracker are on at the ticks that end at now_s: this alone decides it.

    ComputerParams; s, scalar or (n,) -> bool, likewise
    """
    settings, late_s = params.tracker.settings, now_s + SAME_S
    return settings.enabled & (settings.on <= late_s) & (late_s < settings.off)


def last_on_s(params, ends_s):
    """End of the last tick at which a picture can be taken in. ComputerParams; (n,) s -> s, -inf without"""
    ends_on_s = ends_s[is_on(params, ends_s)]
    return float(ends_on_s[-1]) if len(ends_on_s) else -np.inf


def _switches(computer, now_s):
    """Whether the tracker has to be switched on or off at this tick."""
    return is_on(computer.params, now_s) != (computer.tracker_state is not None)


def _track_stars(computer, now_s, frames_arrived, chain, context_of):
    """Switch the tracker, run its chain on frames. -> Computer, records, StarFix that are due now."""
    outputs, due = [], []
    if _switches(computer, now_s):
        if computer.tracker_state is None:
            tracker_state, command = star_tracker.start(computer.tracker, now_s)
            outputs.append(command)
        else:
            tracker_state = None
        computer = computer._replace(tracker_state=tracker_state)
    if computer.tracker_state is not None:
        for frame in frames_arrived:
            context = context_of(computer, frame)
            tracker_state, fix, command = chain(computer.tracker, computer.tracker_state, frame, context)
            outputs += [fix, command]
            usable = fix.reason == Reason.NONE or len(fix.stars.hip)
            waiting = computer.waiting + ((fix,) if usable else ())
            computer = computer._replace(tracker_state=tracker_state, waiting=waiting)
    if computer.waiting:
        due = [fix for fix in computer.waiting if fix.t_available_s <= now_s + SAME_S]
        later = tuple(fix for fix in computer.waiting if fix.t_available_s > now_s + SAME_S)
        computer = computer._replace(waiting=later)
    return computer, outputs, due


def star_context(computer, frame):
    """What the navigation knows about a frame: `tracker.Context`.

    Place and geometry are those of the tick nearest to its instant: within 5 ms they do not change. The
    attitude is carried on to the instant itself, and the rate is the mean from the opening of the first row
    to the closing of the last.
    """
    params, history = computer.params, computer.nav.history
    index = history.nearest(frame.t_valid_s)
    C_bc, C_ic, surroundings = _surroundings(computer, index, frame.t_valid_s)
    near = history[index]
    times = shutter.row_times(frame.exposure_s, frame.line_s, frame.image_dn.shape[0])
    end_s = frame.t_start_s + shutter.duration_s(times)
    omega_c, P_omega_c = mean_rate.camera_rate(computer.nav, near, C_bc, frame.t_start_s, end_s)
    return surroundings._replace(
        q_ic=rotation.quat_from_dcm(C_ic),
        P_c=camera_covariance(computer.nav.layout, near.P, params.nav.C_bc) + PREDICTION_FLOOR**2 * np.eye(3),
        omega_c=omega_c,
        P_omega_c=P_omega_c,
    )


def brief_context(computer, frame):
    """`star_context` without the prediction, for a chain that does not search by it."""
    return _surroundings(computer, computer.nav.history.nearest(frame.t_valid_s), frame.t_valid_s)[2]


def _surroundings(computer, index, t_valid_s):
    """Mounting and attitude of the camera at an instant, and the Context without the prediction.

    Computer, index of the tick nearest to it, time -> C_bc, C_ic, Context
    """
    params, history = computer.params, computer.nav.history
    v_i, C_bc, C_ic, *angles = _sight(
        history.arrays, history.place(index), params.nav.C_bc, t_valid_s, computer.earth, params.sun_i
    )
    return C_bc, C_ic, star_tracker.Context(v_i + params.tracker.earth_velocity_i, *angles)


@kernel
def _sight(memory, place, C_bc_nominal, t_valid_s, earth, sun_i):
    """Velocity, mounting, attitude at t_valid_s; rate, angles of the boresight to Sun and limb.

    memory : prediction.Memory;  place : in it, of the tick that ends nearest to t_valid_s
    """
    x, t_s, dt_s = memory.xs[place], memory.numbers[place, 0], memory.numbers[place, 1]
    n, vibration = int(memory.numbers[place, 2]), memory.numbers[place, 3]
    drive = memory.drives[place]
    omega_b = strapdown.felt_packed(x, memory.increments[place], n, dt_s, vibration, drive, n * dt_s)[:3]
    C_bc = rotation.dcm_from_rotvec(x[X_MOUNTING]) @ C_bc_nominal
    turned = rotation.dcm_from_rotvec(omega_b * (t_valid_s - t_s))
    C_ic = rotation.dcm_from_quat(x[X_Q]) @ turned @ C_bc
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, t_s).T)
    boresight_i = np.ascontiguousarray(C_ic[:, 2])
    sun_angle = acos(min(1.0, max(-1.0, boresight_i @ sun_i)))
    limb_angle = wgs84.limb_angle(C_ei @ x[X_R], C_ei @ boresight_i)
    return x[X_V].copy(), C_bc, C_ic, sqrt(omega_b @ omega_b), sun_angle, limb_angle


def camera_covariance(layout, P, C_bc):
    """Covariance of the camera's attitude error in camera axes: attitude and mounting add up.

    Layout; P : (n, n) of the filter; C_bc : (3, 3) nominal mounting -> (3, 3) rad^2
    """
    P_b = P[ATT, ATT]
    if mounting := layout.places["mounting"]:
        P_b = P_b + P[ATT, mounting] + P[mounting, ATT] + P[mounting, mounting]
    return C_bc.T @ P_b @ C_bc
