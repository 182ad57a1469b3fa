"""The filter in time: prediction tick by tick, measurements put where they belong.

Every tick of the last half second is kept with its state, covariance, IMU samples and measurements. A
measurement valid in the past goes back to its instant, also between ticks and between samples, corrects the
state of then, and the stored increments are integrated again up to now, with the later measurements of the
interval applied again in their order. The result is that of a filter which had every measurement in time
(Larsen et al., CDC 1998, recompute instead of extrapolate). Whether a measurement is believed is decided
once, when it arrives, and repeated in later recomputations.
"""

from collections import deque
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.onboard.navigation import error_model, eskf, integrity, measurements, strapdown
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.state import ATT, BG, MOUNT, POS, ROLL, VEL, NavState, initial
from shefex_nav.records import GateResult

SNAP_S = 1e-6  # instants closer together than this are one
FORGOTTEN = {POS.start: 1e5, VEL.start: 1e4, ATT.start: np.pi}  # m, m/s, rad: sigma that says nothing


class Measurement(NamedTuple):
    """A measurement in the history of the filter."""

    sensor: str  # 'gps_position', 'gps_velocity', 'star_tracker'
    fix: Any  # GpsFix or StarFix
    fate: Fate


class Tick(NamedTuple):
    """The filter at the end of a tick."""

    state: NavState
    P: np.ndarray  # (21, 21)
    imu: Any  # strapdown.ImuWindow that led here; None at the start
    measurements: tuple[Measurement, ...]  # valid within the tick, in the order of their instants


class Filter(NamedTuple):
    """The running filter. `history` and `health` change in place: they are the memory of the computer."""

    params: Any  # NavParams
    earth: Any  # EarthRotation
    imu_model: np.ndarray  # params.imu for the kernels, `error_model.record`
    kalman: Any  # covariance engine
    limit: float  # of the gate, three degrees of freedom
    history: deque  # of Tick, oldest first
    health: dict  # sensor -> integrity.Health


def start(params, alignment, earth):
    """Filter at the instant of the alignment. NavParams, Alignment, EarthRotation -> Filter."""
    state, P = initial(params, alignment)
    return Filter(
        params=params,
        earth=earth,
        imu_model=error_model.record(params.imu),
        kalman=eskf.engine(),
        limit=integrity.chi_square_limit(params.gate_probability, 3),
        history=deque([Tick(state, P, None, ())], maxlen=int(np.ceil(params.history_s * 100.0)) + 1),
        health={name: integrity.HEALTHY for name in ("gps_position", "gps_velocity", "star_tracker")},
    )


def advance(nav, block):
    """One tick on: strapdown and prediction with an ImuBlock, which must follow on the last one."""
    last = nav.history[-1]
    length_s = strapdown.SAMPLES * block.dt_s
    if abs(block.t_valid_s - last.state.t_s - length_s) > SNAP_S:
        raise ValueError(
            f"IMU block ending at {block.t_valid_s:.6f} s does not follow on the state at "
            f"{last.state.t_s:.6f} s"
        )
    level = error_model.vibration_level(nav.params, block)
    imu = strapdown.window(block, last.imu, level)
    state, P = _predict(nav, last.state, last.P, imu, 0.0, length_s)
    nav.history.append(Tick(state, P, imu, ()))


def fuse(nav, arrivals):
    """Take measurements into the filter.

    Parameters
    ----------
    nav : Filter, advanced to the present tick
    arrivals : list of (sensor, fix): 'gps' with a GpsFix, 'star_tracker' with a StarFix that has an attitude

    Returns
    -------
    list of GateResult, one for each measurement
    """
    now_s = nav.history[-1].state.t_s
    results = []
    earliest = len(nav.history)
    for sensor, fix in arrivals:
        if sensor == "gps" and not fix.valid:
            results.append(_unused(now_s, fix, sensor + "_position", f"no fix: {fix.reason}"))
            continue
        names = ("gps_position", "gps_velocity") if sensor == "gps" else (sensor,)
        index = _place(nav.history, fix.t_valid_s)
        if index is None:
            results.extend(_unused(now_s, fix, name, _out_of_reach(nav.history, fix)) for name in names)
            continue
        tick = nav.history[index]
        queue = tick.measurements + tuple(Measurement(name, fix, Fate.PENDING) for name in names)
        queue = tuple(sorted(queue, key=lambda m: m.fix.t_valid_s))
        nav.history[index] = tick._replace(measurements=queue)
        earliest = min(earliest, index)
    for index in range(earliest, len(nav.history)):
        before = nav.history[index - 1]
        nav.history[index] = _repeat(nav, before.state, before.P, nav.history[index], results)
    return results


def _unused(now_s, fix, sensor, note):
    """GateResult of a measurement that never reached the gate: no degrees of freedom."""
    return GateResult(now_s, fix.t_valid_s, sensor, 0, np.nan, np.nan, False, note, np.empty(0))


def _out_of_reach(history, fix):
    """Why there is no tick for a fix."""
    if fix.t_valid_s > history[-1].state.t_s:
        return "from the future"
    return "not after the start of the filter" if history[0].imu is None else "older than the history"


def _place(history, t_s):
    """Index of the tick in which t_s lies, after the tick before and not after its own end; or None."""
    if not history[0].state.t_s + SNAP_S < t_s <= history[-1].state.t_s + SNAP_S:
        return None
    index = len(history) - 1
    while history[index - 1].state.t_s + SNAP_S >= t_s:
        index -= 1
    return index


def nearest(nav, t_s):
    """The Tick whose end is nearest to t_s, of those that have IMU samples; ticks are equally spaced."""
    history = nav.history
    last = history[-1]
    oldest = len(history) - (2 if history[0].imu is None else 1)
    back = int(max(last.state.t_s - t_s, 0.0) / (strapdown.SAMPLES * last.imu.dt_s))
    around = [history[-1 - min(steps, oldest)] for steps in (back + 1, back)]
    return min(around, key=lambda tick: abs(tick.state.t_s - t_s))


def _repeat(nav, state, P, tick, results):
    """The tick again, from another state at its beginning, with its measurements. -> Tick"""
    length_s = strapdown.SAMPLES * tick.imu.dt_s
    begin_s, decided = 0.0, []
    for measurement in tick.measurements:
        at_s = measurement.fix.t_valid_s - (tick.imu.t_end_s - length_s)
        if at_s > length_s - SNAP_S:
            at_s = length_s
        if at_s - begin_s > SNAP_S:
            state, P = _predict(nav, state, P, tick.imu, begin_s, at_s)
            begin_s = at_s
        state, P, fate, result = _apply(nav, state, P, tick.imu, at_s, measurement)
        decided.append(measurement._replace(fate=fate))
        if result is not None:
            results.append(result)
    if length_s - begin_s > SNAP_S:
        state, P = _predict(nav, state, P, tick.imu, begin_s, length_s)
    return Tick(state, P, tick.imu, tuple(decided))


def _predict(nav, state, P, imu, begin_s, end_s):
    """State and covariance after the part begin_s ... end_s of a tick."""
    r_i, v_i, q_ib, Phi, Q = error_model.step(nav.imu_model, state, imu, begin_s, end_s, nav.earth)
    t_s = imu.t_end_s - (strapdown.SAMPLES * imu.dt_s - end_s)  # exact at the end of the tick
    state = NavState(t_s, r_i, v_i, q_ib, *state[4:])
    return state, eskf.predict(nav.kalman, P, Phi, Q)


def _apply(nav, state, P, imu, at_s, measurement):
    """Correct with one measurement. -> NavState, P, Fate, GateResult or None if its fate was known."""
    sensor, fix, fate = measurement
    if fate == Fate.REJECTED:
        return state, P, fate, None
    z, H, R, block = _linearise(nav, state, imu, at_s, sensor, fix)
    result = None
    if fate == Fate.PENDING:
        nis = eskf.innovation_statistics(P, z, H, R)
        fate = _decide(nav, state, P, z, R, imu, at_s, measurement, nis)
        note = {Fate.USED: "", Fate.REJECTED: "rejected", Fate.RESET: "reset after timeout"}[fate]
        if fate == Fate.RESET and sensor == "star_tracker":
            note = "attitude reset"
        now_s = nav.history[-1].imu.t_end_s
        accepted = fate != Fate.REJECTED
        result = GateResult(now_s, fix.t_valid_s, sensor, 3, nis, nav.limit, accepted, note, z)
    if fate == Fate.REJECTED:
        return state, P, fate, result
    if fate == Fate.RESET:
        P = eskf.forget(P, block, FORGOTTEN[block.start])
        if block == ATT:  # whatever misled the attitude has misled the mounting too
            P = eskf.forget(P, MOUNT, nav.params.sigma_mounting)
    state, P = eskf.update(nav.kalman, state, P, z, H, R)
    return state, P, fate, result


def _linearise(nav, state, imu, at_s, sensor, fix):
    """z, H, R of a measurement and the block of errors that it measures."""
    params = nav.params
    if sensor == "gps_position":
        return *measurements.gps_position(state, fix, nav.earth, params.l_ba_b), POS
    if sensor == "gps_velocity":
        omega = strapdown.rate(state, imu, at_s)
        z, H, R = measurements.gps_velocity(state, fix, nav.earth, params.l_ba_b, omega)
        return z, H, R + vibration_covariance(params, imu), VEL
    return *measurements.star_attitude(state, fix, params.C_bc, params.star_sigma_floor), ATT


def vibration_covariance(params, imu):
    """What vibration puts between the strapdown's antenna velocity and the vehicle's: (3, 3) m^2/s^2.

    The velocity of the sensors, and the rate of one sample (change of a swinging angle in dt) times the
    lever arm.
    """
    model = params.imu
    rate2 = 2.0 * (model.gyro_vibration / imu.dt_s) ** 2
    variance = model.accel_vibration**2 + rate2 * (params.l_ba_b @ params.l_ba_b)
    return imu.vibration**2 * variance * np.eye(3)


def _decide(nav, state, P, z, R, imu, at_s, measurement, nis):
    """Fate of a new measurement; the health of its sensor is brought up to date."""
    params, sensor = nav.params, measurement.sensor
    health = nav.health[sensor]
    if sensor == "star_tracker":
        rule = params.release_star if health.used else params.release_star_first
        evidence = integrity.star_evidence(state, z, R)
        P_rate = rate_covariance(P, strapdown.rate(state, imu, at_s)[0])

        def agree(earlier, later):
            return integrity.star_fixes_agree(earlier, later, P_rate, nav.limit)
    else:
        rule, evidence = params.release_gps, measurement.fix

        def agree(earlier, later):
            return integrity.gps_fixes_agree(earlier, later, params.gps_agreement)

    fate, nav.health[sensor] = integrity.judge(
        health, rule, nis, nav.limit, measurement.fix.t_valid_s, evidence, agree
    )
    return fate


def rate_covariance(P, roll_rate):
    """Covariance of the corrected rate, from bias and roll column: (21, 21), rad/s -> (3, 3) rad^2/s^2."""
    cross = P[BG, ROLL] * roll_rate
    return P[BG, BG] + cross + cross.T + roll_rate**2 * P[ROLL, ROLL]
