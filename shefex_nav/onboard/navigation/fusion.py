"""The filter in time: prediction tick by tick, measurements put where they belong.

Every tick of the last `history_s` is kept with its state, covariance, IMU samples and measurements. A
measurement valid in the past goes back to its instant, also between ticks and between samples, corrects the
state of then, and the stored increments are integrated again up to now, with the later measurements of the
interval applied again in their order. The result is that of a filter which had every measurement in time
(Larsen et al., CDC 1998, recompute instead of extrapolate). Whether a measurement is believed is decided
once, when it arrives, and repeated in later recomputations.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import entry
from shefex_nav.geometry import frames
from shefex_nav.onboard.navigation import (
    adaptation,
    blocks,
    error_model,
    eskf,
    gate,
    integrity,
    integrity_bank,
    integrity_gps,
    integrity_learnt,
    integrity_watch,
    measurements,
    momentary,
    prediction,
    unknown_attitude,
)
from shefex_nav.onboard.navigation.history import History, Tick
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.quantity import ATTITUDE, POSITION, VECTORS, VELOCITY, about, fix_of
from shefex_nav.onboard.navigation.sensor import Correction, Interval, Measurement
from shefex_nav.onboard.navigation.sensors import arrivals, attitudes_instead, contents, straightened, table
from shefex_nav.onboard.navigation.state import (
    ATT,
    NOTHING_TOLD,
    VEL,
    X_Q,
    Layout,
    NavParams,
    initial,
    layout,
    pack,
    unpack,
    used_at_start,
)
from shefex_nav.onboard.navigation.strapdown import BEFORE
from shefex_nav.records import GateResult, Reason

UNUSED = (Fate.REJECTED, Fate.HELD)


class Filter(NamedTuple):
    """The running filter. `history` and `health` change in place: they are the memory of the computer."""

    params: NavParams
    layout: Layout
    earth: frames.EarthRotation
    sensors: dict  # name -> sensor.Sensor, in the order in which measurements of one instant have their turn
    constants: prediction.Constants
    kalman: Any  # of `eskf.engine`, whose type takes seconds to import
    limits: integrity.Limits  # of the gate
    history: History
    health: dict  # sensor -> integrity.Health
    recorder: Callable | None
    watch: integrity_watch.Watch  # over the sensors, changes in place, too
    noise: adaptation.Noise  # that is larger than told, likewise
    bank: integrity_bank.Bank  # of windows over innovations, likewise
    propagate: Callable  # `prediction.propagate` for the types of its arrays
    judged: Callable | None = None  # of the sensor, S (m, m) and the NIS of every measurement at the gate


def start(params, alignment, earth, recorder=None, judged=None):
    """Filter at the instant of the alignment.

    Parameters
    ----------
    params : NavParams
    alignment : Alignment
    earth : EarthRotation
    recorder : function of an Interval or a Correction, called with each in the order of their instants once
        no later measurement can change it any more, `params.history_s` after it, or at `finish`
    judged : function, as in Filter

    Returns
    -------
    Filter
    """
    order, known = layout(params.states, params.blocks), table(params)
    state, P = initial(params, order, alignment)
    model, errors = error_model.record(params), momentary.of(params)
    constants = prediction.constants(order, model, earth, params.blocks, errors)
    first = Tick(state.t_s, pack(state), P, None)
    history = History(first, constants.driving, used_at_start(params, state.t_s))
    return Filter(
        params=params,
        layout=order,
        earth=earth,
        sensors=known,
        constants=constants,
        kalman=eskf.engine(order),
        limits=integrity.Limits(params.gate_probability),
        history=history,
        health={name: integrity.HEALTHY for name in known},
        recorder=recorder,
        watch=integrity_watch.start(params),
        noise=adaptation.Noise(),
        bank=integrity_bank.Bank(),
        propagate=entry(prediction.propagate, constants, history.arrays, 0, 0.0, 0, 0.0),
        judged=judged,
    )


def advance(nav, block):
    """One tick on: strapdown and prediction with an ImuBlock, which must follow on the last one."""
    history, n, now_s = nav.history, len(block.dtheta_b), block.t_valid_s
    if abs(now_s - history.ends_s[-1] - n * block.dt_s) > SAME_S:
        raise ValueError(
            f"IMU block ending at {now_s:.6f} s does not follow on the state at {history.ends_s[-1]:.6f} s"
        )
    place = history.make_room(n)
    readings = history.increments[place, BEFORE : BEFORE + n]
    nav.watch.screen(block, readings, history.extra[place])
    if nav.constants.driving:
        history.drives[place] = blocks.drive_of_tick(nav, readings, now_s, block.dt_s)
    new = history.newest + 1
    prediction.enter(nav.constants, history.arrays, new, nav.params.motors, now_s, block.dt_s, n)
    history.extend([now_s])
    forget_old(nav)


def forget_old(nav):
    """Let the ticks go that are older than the history is to reach."""
    if nav.noise.share is not None:
        adaptation.carry(nav)
    _forget(nav, nav.history.ends_s[-1] - nav.params.history_s + SAME_S)


def finish(nav):
    """Hand all that is still open to the recorder; no measurement can be taken in afterwards."""
    _forget(nav, np.inf)


def _forget(nav, t_s):
    """Let the ticks go before the last that ends at t_s or earlier: what leads on from them is final."""
    history = nav.history
    while nav.recorder is not None and len(history) > 1 and history.ends_s[1] <= t_s:
        present = history.x.copy(), history.P.copy()
        _reprocess(nav, 1, 1, [], nav.recorder)
        history.x[:], history.P[:] = present
        history.forget_until(history.ends_s[1])
    history.forget_until(t_s)


def take(nav, arrived):
    """Take in what has arrived: `fuse`, and of stars that were not used one by one the attitude.

    Parameters
    ----------
    nav : Filter, advanced to the present tick
    arrived : sequence of GpsFix, GpsRanges, readings of instruments and StarFix, also of those that hold
        nothing for the filter

    Returns
    -------
    list of GateResult, one for each measurement
    """
    taken = arrivals(nav, arrived)
    results = fuse(nav, taken) if taken else []
    if nav.params.stars != "attitude" and (instead := attitudes_instead(nav, taken, results)):
        results += fuse(nav, instead)
    return results


def fuse(nav, arrived):
    """Take measurements into the filter.

    Parameters
    ----------
    nav : Filter, advanced to the present tick
    arrived : list of (arrival, fix), the first of `sensors.ARRIVALS`: 'gps' with a GpsFix, 'gps_ranges' with
        GpsRanges, 'star_tracker' with a StarFix that has an attitude, 'star_vectors' with one that has stars

    Returns
    -------
    list of GateResult, one for each measurement
    """
    history, results = nav.history, []
    last, turn = history.newest - history.oldest, partial(_order, list(nav.sensors))
    earliest = last + 1
    for arrival, fix in arrived:
        if nav.params.gps_told is not NOTHING_TOLD:
            fix = measurements.understood(nav.params.gps_told, fix)
        index = history.within(fix.t_valid_s)
        names, fix = _worth_trying(nav, arrival, fix, index, results)
        if names:
            grown = nav.noise.sensors.get
            new = (Measurement(name, fix, Fate.PENDING, grown=grown(name, 1.0)) for name in names)
            queue = [*history.measurements[index], *new]
            history.measurements[index] = tuple(sorted(queue, key=turn))
            earliest = min(earliest, index)
    if earliest <= last:
        _reprocess(nav, earliest, last, results)
    nav.watch.protection.update(nav.earth, history, nav.watch.drifts.values())
    return results


def _worth_trying(nav, arrival, fix, index, results):
    """Names of the measurements of a fix that are to meet the gate, and the fix as it may be used.

    Results of those that are not are added.
    """
    now_s = nav.history.ends_s[-1]
    names, reason = contents(nav, arrival, index, fix)
    if reason:
        results.append(_unused(now_s, fix, names[0], reason))
        nav.watch.report(now_s, "gps" if about(names[0]) in (POSITION, VELOCITY) else arrival, reason)
        return (), fix
    if index is None:
        results.extend(_unused(now_s, fix, name, _out_of_reach(nav.history, fix)) for name in names)
        return (), fix
    if about(names[0]) not in (POSITION, VELOCITY) and _is_again(nav.history.measurements[index], names, fix):
        results.append(_unused(now_s, fix, names[0], f"stale: of T{fix.t_valid_s:+.1f} s, as one before"))
        return (), fix
    if about(names[0]) is ATTITUDE:
        return names, fix if fix.straight else straightened(nav, arrival, index, fix)
    if about(names[0]):
        repeats, fix = integrity_gps.repeated(nav.watch.gps, fix, _inertial_state(nav, index))
        results.extend(_unused(now_s, fix, name, words) for name, words in repeats.items())
        nav.watch.report(now_s, "gps", next(iter(repeats.values()), ""))
        names = tuple(name for name in names if name not in repeats)
    return names, fix


def _is_again(measurements, names, fix):
    """Whether a sensor has said something of the instant of a fix already; of GPS `repeated` knows that."""
    same = (one for one in measurements if one.sensor in names)
    return any(abs(one.fix.t_valid_s - fix.t_valid_s) < SAME_S for one in same)


def _inertial_state(nav, index):
    """integrity_gps.InertialState of a tick."""
    history, t_s = nav.history, nav.history.ends_s[index]
    sums = history.corrections.until(history.oldest + index)
    return integrity_gps.inertial_state(t_s, history.arrays, history.place(index), sums, nav.earth)


def _order(sensors, measurement):
    """When a measurement has its turn: at its instant; of one instant in the order of the list of sensors.

    So the order of arrival does not matter.
    """
    return measurement.fix.t_valid_s, sensors.index(measurement.sensor)


def _unused(now_s, fix, sensor, note):
    """GateResult of a measurement that never reached the gate: no degrees of freedom."""
    return GateResult(now_s, fix.t_valid_s, sensor, 0, np.nan, np.nan, False, note, np.empty(0))


def _out_of_reach(history, fix):
    """Why there is no tick for a fix."""
    if fix.t_valid_s > history.ends_s[-1]:
        return "from the future"
    return "not after the start of the filter" if history.imu(0) is None else "older than the history"


def _reprocess(nav, first, last, results, recorder=None):
    """The ticks `first` to `last` again, with their measurements, whose results are added if they are new."""
    history = nav.history
    if recorder is None:
        history.back_to(first - 1)
    else:
        history.go_to(first - 1)
    if nav.params.lasting_share or nav.params.range_bias_sigma or nav.params.aids:
        history.used_s = history.used_before(first)
    k, begin_s = first, 0.0  # the instant that has been reached: tick, s from its start
    for index in range(first, last + 1):
        decided = []
        for measurement in history.measurements[index]:
            if measurement.fate not in UNUSED:
                now = history.moment(index, begin_s if k == index else 0.0, measurement.fix.t_valid_s)
                if k < index or now.at_s > begin_s:
                    _propagate(nav, k, begin_s, index, now.at_s, recorder)
                k, begin_s = index, now.at_s
                measurement = _apply(nav, now, measurement, results, recorder)
            decided.append(measurement)
        if decided:
            history.measurements[index] = tuple(decided)
    _propagate(nav, k, begin_s, last, np.inf, recorder)


def _propagate(nav, first, begin_s, last, end_s, recorder):
    """From an instant of the tick `first` to one of the tick `last`; s from the start of each."""
    history = nav.history
    way = history.oldest + first, begin_s, history.oldest + last, end_s
    if recorder is None:
        nav.propagate(nav.constants, history.arrays, *way)
        return
    imu = history.imu(last)
    end_s = min(end_s, imu.length_s)
    t_s, after_s = (imu.t_end_s - (imu.length_s - at_s) for at_s in (begin_s, end_s))  # exact at the end
    state, P = unpack(t_s, history.x.copy()), history.P.copy()
    prediction.propagate(nav.constants, history.arrays, *way)
    if end_s - begin_s > SAME_S:
        Phi, Q = prediction.growth(nav.constants, nav.layout, state, imu, begin_s, end_s)
        after = unpack(after_s, history.x.copy())
        recorder(Interval(t_s, after_s, state, P, Phi, Q, after, history.P.copy(), imu))


def _apply(nav, now, measurement, results, recorder):
    """Correct the Moment that has been reached with a measurement. -> Measurement"""
    history, sensor, fix = nav.history, nav.sensors[measurement.sensor], measurement.fix
    z, H, R = linearised(nav, now, measurement)
    of_gps = measurement.sensor in VECTORS
    beyond = unknown_attitude.second_order(now.P, z, H, R, now.x[X_Q]) if of_gps else None
    if beyond is not None:
        z = z - H @ beyond
    pending, confirmed = measurement.fate == Fate.PENDING, False
    if pending:
        measurement, result, confirmed = gate.decide(nav, now, z, H, R, measurement)
        results.append(result)
        if measurement.fate in UNUSED:
            return measurement
    fate, x = measurement.fate, history.x.copy()
    if beyond is not None and fate != Fate.USED:  # a sensor that is believed otherwise says it in its own way
        z, beyond = z + H @ beyond, None
    before, P = None if recorder is None else now.state, history.P.copy()
    prior, cut = gate.forgotten(nav, P, measurement, H)
    z, H, R = rows_used(nav, measurement, z, H, R)
    if fate == Fate.DOUBTED:
        history.P[:], dx, G = prior, np.zeros(nav.layout.n), np.eye(3)
    else:
        if beyond is not None:
            history.x[: ATT.start] += beyond[: ATT.start]
        whole = beyond is not None or about(measurement.sensor) is ATTITUDE
        share = eskf.take_all if whole else unknown_attitude.take_share
        given = prior, (z, H, R), history.x, history.P, share, fix_of(measurement.sensor) is not ATTITUDE
        if measurement.teaches:
            dx, G = eskf.update_packed(nav.kalman, nav.layout, *given)
        else:
            dx, G = integrity_learnt.update_without(nav.layout, *given)
    if recorder is not None:
        after = now.state, history.P.copy(), cut
        recorder(Correction(now.t_s, measurement.sensor, fix, fate, before, P, prior, z, H, R, dx, G, *after))
    elif fate != Fate.DOUBTED:
        history.corrections.add(history.oldest + now.k, history.oldest, now.t_s, x, history.x)
        if about(measurement.sensor) is VELOCITY:
            nav.watch.learnt.moving(now.t_s, history.x)
    if pending and fate != Fate.DOUBTED:
        _used(nav, now, measurement, dx, (P, prior, H, R), confirmed)
        if confirmed:
            nav.health[measurement.sensor] = sensor.confirmed(nav, now, fix)
    return measurement


def linearised(nav, now, measurement):
    """z (m,), H (m, n), R (m, m) of a measurement, with the noise that its sensor was found to have."""
    z, H, R = nav.sensors[measurement.sensor].linearise(nav, now, measurement.fix)
    return z, H, (R if measurement.grown == 1.0 else measurement.grown**2 * R)


def rows_used(nav, measurement, z, H, R):
    """The rows of a measurement that correct the state, with the noise that they count with.

    The gate has judged them by the noise of one fix alone, which is what an innovation has. Errors that last
    do not make it larger; they make the fixes one after the other say less together than each says alone.
    """
    if measurement.fate == Fate.DOUBTED:
        return z[:0], H[:0], R[:0, :0]
    name, fix, used = measurement.sensor, measurement.fix, measurement.rows
    R = measurements.counted_noise(nav, name, fix, R)
    if nav.sensors[name].counted is not None:
        nav.history.used_s[name] = fix.t_valid_s
    return (z, H, R) if used is None else (z[used], H[used], R[np.ix_(used, used)])


def _used(nav, now, measurement, dx, update, confirmed):
    """Tell the watch of a measurement that has just been used for the first time.

    dx : (n,) its correction;  update : P before it, the one it was used with, H, R
    """
    (P, prior, H, R), fix, name = update, measurement.fix, measurement.sensor
    whole = about(name) is ATTITUDE and fix.reason == Reason.NONE  # as good as the attitude
    as_sensor = "star_tracker" if whole else name
    nav.watch.used(as_sensor, fix.t_valid_s, nav.history.ends_s[-1], dx[VEL], now.x)
    for instrument, drift in nav.watch.drifts.items():
        own = instrument == name
        drift.learn(now.t_s, prior, (H, R), own, drift.bend_of(fix) if own else 0.0)
    nav.watch.protection.used(nav, now, measurement, P, prior, H, R, confirmed)
