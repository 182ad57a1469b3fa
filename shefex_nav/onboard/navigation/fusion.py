"""The filter in time: prediction tick by tick, measurements put where they belong.

Every tick of the last half second is kept with its state, covariance, IMU samples and measurements. A
measurement valid in the past goes back to its instant, also between ticks and between samples, corrects the
state of then, and the stored increments are integrated again up to now, with the later measurements of the
interval applied again in their order. The result is that of a filter which had every measurement in time
(Larsen et al., CDC 1998, recompute instead of extrapolate). Whether a measurement is believed is decided
once, when it arrives, and repeated in later recomputations.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.geometry import frames
from shefex_nav.onboard.navigation import (
    error_model,
    eskf,
    gate,
    integrity,
    integrity_gps,
    integrity_protection,
    integrity_watch,
    measurements,
    prediction,
    strapdown,
)
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.sensors import SENSORS, contents, without_solution
from shefex_nav.onboard.navigation.state import (
    Layout,
    NavState,
    initial,
    initial_covariance,
    layout,
    pack,
    unpack,
)
from shefex_nav.records import GateResult, Reason

SNAP_S = 1e-6  # instants closer together than this are one
UNUSED = (Fate.REJECTED, Fate.HELD)
RANK = {name: k for k, name in enumerate(SENSORS)}


class Measurement(NamedTuple):
    """A measurement in the history of the filter."""

    sensor: str  # of sensors.SENSORS
    fix: Any
    fate: Fate
    rows: Any = None  # (m,) bool, rows that are used; None: all
    # sigma that is added to what it measures, or to the blocks of a dict; None: a reset forgets it all
    admitted: Any = None
    noise: float = 1.0  # factor on its covariance where it is used, `measurements.lasting_factor`


class Tick(NamedTuple):
    """The filter at the end of a tick."""

    t_s: float
    x: np.ndarray  # (93,) packed nominal state
    P: np.ndarray  # (n, n)
    imu: Any  # strapdown.ImuWindow that led here; None at the start
    measurements: tuple[Measurement, ...]  # valid within the tick, in the order of their instants

    @property
    def state(self):
        """NavState."""
        return unpack(self.t_s, self.x)


class Interval(NamedTuple):
    """For a recorder: prediction over a tick, or over a part of it between measurements."""

    t_begin_s: float
    t_end_s: float
    state: NavState  # at the beginning, and its covariance
    P: np.ndarray  # (n, n)
    Phi: np.ndarray  # (n, n)
    Q: np.ndarray  # (n, n)
    state_after: NavState
    P_after: np.ndarray  # (n, n)
    imu: Any  # ImuWindow of the tick


class Correction(NamedTuple):
    """For a recorder: one update. What is not used is not recorded."""

    t_s: float  # of the state; the fix's, but for rounding
    sensor: str
    fix: Any
    fate: Fate  # USED or RESET
    state: NavState  # before
    P: np.ndarray  # (n, n) before
    P_forgotten: np.ndarray  # (n, n) the same after a reset forgot; P where there was none
    z: np.ndarray  # (m,) rows used
    H: np.ndarray  # (m, n)
    R: np.ndarray  # (m, m)
    dx: np.ndarray  # (n,) taken into the state
    G: np.ndarray  # (3, 3) attitude error -> attitude error in the new body axes
    state_after: NavState
    P_after: np.ndarray  # (n, n)


class Filter(NamedTuple):
    """The running filter. `history` and `health` change in place: they are the memory of the computer."""

    params: Any  # NavParams
    layout: Layout
    earth: Any  # EarthRotation
    imu_model: np.ndarray  # noise for the kernels, `error_model.record`
    kalman: Any  # covariance engine
    limits: dict  # degrees of freedom -> limit of the gate, as far as needed yet
    history: deque  # of Tick, oldest first
    health: dict  # sensor -> integrity.Health
    recorder: Callable | None
    watch: integrity_watch.Watch  # over the sensors, changes in place, too

    def limit(self, dof):
        """What a normalised innovation squared may be, chi-square with so many degrees of freedom."""
        if dof not in self.limits:
            self.limits[dof] = integrity.chi_square_limit(self.params.gate_probability, dof)
        return self.limits[dof]


def start(params, alignment, earth, recorder=None):
    """Filter at the instant of the alignment.

    Parameters
    ----------
    params : NavParams
    alignment : Alignment
    earth : EarthRotation
    recorder : function of an Interval or a Correction, called with each in the order of their instants once
        no later measurement can change it any more, `params.history_s` after it, or at `finish`

    Returns
    -------
    Filter
    """
    order = layout(params.states)
    state, P = initial(params, order, alignment)
    return Filter(
        params=params,
        layout=order,
        earth=earth,
        imu_model=error_model.record(params),
        kalman=eskf.engine(order),
        limits={},
        history=deque([Tick(state.t_s, pack(state), P, None, ())]),
        health={name: integrity.HEALTHY for name in SENSORS},
        recorder=recorder,
        watch=integrity_watch.start(params),
    )


def advance(nav, block):
    """One tick on: strapdown and prediction with an ImuBlock, which must follow on the last one."""
    last = nav.history[-1]
    length_s = len(block.dtheta_b) * block.dt_s
    if abs(block.t_valid_s - last.t_s - length_s) > SNAP_S:
        raise ValueError(
            f"IMU block ending at {block.t_valid_s:.6f} s does not follow on the state at {last.t_s:.6f} s"
        )
    block, extra = nav.watch.screen(block)
    thrust, shake = block.dv_b[:, 0].sum() / length_s, error_model.shake(block.dv_b)
    limits = nav.params.imu.thrust_threshold, nav.params.imu.shake_threshold
    level = error_model.vibration_level(nav.params.motors, *limits, block.t_valid_s, thrust, shake)
    imu = strapdown.window(block, last.imu, level, extra)
    x, P = prediction.advance(
        nav.layout, nav.imu_model, last.x, last.t_s, last.P, imu, 0.0, length_s, nav.earth
    )
    nav.history.append(Tick(imu.t_end_s, x, P, imu, ()))
    while nav.history[1].t_s <= imu.t_end_s - nav.params.history_s + SNAP_S:
        _forget_oldest(nav)


def finish(nav):
    """Hand all that is still open to the recorder; no measurement can be taken in afterwards."""
    while len(nav.history) > 1:
        _forget_oldest(nav)


def _forget_oldest(nav):
    """Let the oldest tick go; what led from it to the next is final."""
    gone = nav.history.popleft()
    if nav.recorder is not None:
        _repeat(nav, gone, nav.history[0], [], nav.recorder)


def fuse(nav, arrivals):
    """Take measurements into the filter.

    Parameters
    ----------
    nav : Filter, advanced to the present tick
    arrivals : list of (arrival, fix), the first of `sensors.ARRIVALS`: 'gps' with a GpsFix, 'star_tracker'
        with a StarFix that has an attitude, 'star_vectors' with one that has stars

    Returns
    -------
    list of GateResult, one for each measurement
    """
    now_s = nav.history[-1].t_s
    results = []
    earliest = len(nav.history)
    for arrival, fix in arrivals:
        names = contents(arrival, fix)
        reason = without_solution(arrival, fix)
        if reason:
            results.append(_unused(now_s, fix, names[0], reason))
            nav.watch.tell(now_s, "gps" if arrival.startswith("gps") else arrival, reason)
            continue
        index = _place(nav.history, fix.t_valid_s)
        if index is None:
            results.extend(_unused(now_s, fix, name, _out_of_reach(nav.history, fix)) for name in names)
            continue
        if arrival.startswith("gps"):
            repeats, fix = integrity_gps.repeated(nav.watch.gps, fix, *_whereabouts(nav, index))
            results.extend(_unused(now_s, fix, name, words) for name, words in repeats.items())
            nav.watch.tell(now_s, "gps", next(iter(repeats.values()), ""))
            names = tuple(name for name in names if name not in repeats)
        tick = nav.history[index]
        new = [Measurement(name, fix, Fate.PENDING, noise=_lasting(nav, name, fix)) for name in names]
        queue = tick.measurements + tuple(new)
        queue = tuple(sorted(queue, key=_turn))
        nav.history[index] = tick._replace(measurements=queue)
        earliest = min(earliest, index)
    _integrate_again(nav, earliest, results)
    nav.watch.protect(nav.history[-1].P)
    return results


def _lasting(nav, name, fix):
    """Factor on the covariance of a measurement that errs as the one before it did."""
    if name != "gps_position":
        return 1.0
    gap_s = abs(fix.t_valid_s - nav.watch.position_s)
    nav.watch.position_s = max(fix.t_valid_s, nav.watch.position_s)
    return measurements.lasting_factor(nav.params.lasting_share, nav.params.range_bias_time_s, gap_s)


def _whereabouts(nav, index):
    """Position and velocity of a tick, axes of the Earth: (3,) m, (3,) m/s."""
    state = nav.history[index].state
    return frames.ecef_from_inertial(nav.earth, state.t_s, state.r_i, state.v_i)


def _turn(measurement):
    """When a measurement has its turn: at its instant; of one instant in the order of the table of sensors.

    So the order of arrival does not matter.
    """
    return measurement.fix.t_valid_s, RANK[measurement.sensor]


def _integrate_again(nav, index, results):
    """The ticks from an index on once more; what the gate says of new measurements goes to the results."""
    history = nav.history
    while index < len(history):
        before, run = history[index - 1], []
        for k in range(index, len(history)):
            if any(measurement.fate not in UNUSED for measurement in history[k].measurements):
                break
            run.append(history[k])
        if run:
            xs, Ps = prediction.advance_ticks(
                nav.layout, nav.imu_model, before.x, before.t_s, before.P, [t.imu for t in run], nav.earth
            )
            for k, tick in enumerate(run):
                history[index + k] = Tick(tick.t_s, xs[k], Ps[k], tick.imu, tick.measurements)
            index += len(run)
        else:
            history[index] = _repeat(nav, before, history[index], results)
            index += 1


def _unused(now_s, fix, sensor, note):
    """GateResult of a measurement that never reached the gate: no degrees of freedom."""
    return GateResult(now_s, fix.t_valid_s, sensor, 0, np.nan, np.nan, False, note, np.empty(0))


def _out_of_reach(history, fix):
    """Why there is no tick for a fix."""
    if fix.t_valid_s > history[-1].t_s:
        return "from the future"
    return "not after the start of the filter" if history[0].imu is None else "older than the history"


def _place(history, t_s):
    """Index of the tick in which t_s lies, after the tick before and not after its own end; or None."""
    if not history[0].t_s + SNAP_S < t_s <= history[-1].t_s + SNAP_S:
        return None
    index = len(history) - 1
    while history[index - 1].t_s + SNAP_S >= t_s:
        index -= 1
    return index


def nearest(nav, t_s):
    """The Tick whose end is nearest to t_s, of those that have IMU samples."""
    history = nav.history
    first = 1 if history[0].imu is None else 0
    later = min(max(bisect_left(history, t_s, key=lambda tick: tick.t_s), first), len(history) - 1)
    around = [history[max(later - 1, first)], history[later]]
    return min(around, key=lambda tick: abs(tick.t_s - t_s))


def _repeat(nav, before, tick, results, recorder=None):
    """The tick again, from the state of the one before it, with its measurements. -> Tick"""
    imu = tick.imu
    length_s = imu.length_s
    begin_s, decided = 0.0, []
    t_s, x, P = before.t_s, before.x, before.P
    for measurement in tick.measurements:
        at_s = measurement.fix.t_valid_s - (imu.t_end_s - length_s)
        if at_s > length_s - SNAP_S:
            at_s = length_s
        if at_s - begin_s > SNAP_S:
            t_s, x, P = _predict(nav, t_s, x, P, imu, begin_s, at_s, recorder)
            begin_s = at_s
        x, P, measurement, result = _apply(nav, t_s, x, P, imu, at_s, measurement, recorder)
        decided.append(measurement)
        if result is not None:
            results.append(result)
    if length_s - begin_s > SNAP_S:
        t_s, x, P = _predict(nav, t_s, x, P, imu, begin_s, length_s, recorder)
    return Tick(imu.t_end_s, x, P, imu, tuple(decided))


def _predict(nav, t_s, x, P, imu, begin_s, end_s, recorder):
    """Mission time, state and covariance after the part begin_s ... end_s of a tick."""
    after, P_after = prediction.advance(nav.layout, nav.imu_model, x, t_s, P, imu, begin_s, end_s, nav.earth)
    after_s = imu.t_end_s - (imu.length_s - end_s)  # exact at the end of the tick
    if recorder is not None:
        state = unpack(t_s, x)
        Phi, Q = prediction.growth(nav.layout, nav.imu_model, state, imu, begin_s, end_s, nav.earth)
        recorder(Interval(t_s, after_s, state, P, Phi, Q, unpack(after_s, after), P_after, imu))
    return after_s, after, P_after


def _apply(nav, t_s, x, P, imu, at_s, measurement, recorder):
    """Correct with one measurement. -> x, P, Measurement, GateResult or None if its fate was known."""
    if measurement.fate in UNUSED:
        return x, P, measurement, None
    sensor, state = SENSORS[measurement.sensor], unpack(t_s, x)
    z, H, R = sensor.linearise(nav, state, imu, at_s, measurement.fix)
    result, confirmed = None, False
    if measurement.fate == Fate.PENDING:
        measurement, result, confirmed = gate.decide(nav, state, P, z, H, R, imu, at_s, measurement)
        if measurement.fate in UNUSED:
            return x, P, measurement, result
    prior, R = P, measurement.noise * R
    if measurement.fate in (Fate.RESET, Fate.DOUBTED):
        prior = _forgotten(nav, P, sensor, measurement.admitted)
    if measurement.fate == Fate.DOUBTED:
        return x, prior, measurement, result
    used = measurement.rows
    if used is not None:
        z, H, R = z[used], H[used], R[np.ix_(used, used)]
    after, P_after, dx, G = eskf.update_packed(nav.kalman, nav.layout, x, prior, z, H, R)
    if measurement.fate == Fate.RESET and sensor.block == "attitude":
        P_after, G = eskf.turned_back(P_after, G), np.eye(3)
    if recorder is not None:
        name, fix, fate = measurement[:3]
        ends = unpack(t_s, after), P_after
        recorder(Correction(t_s, name, fix, fate, state, P, prior, z, H, R, dx, G, *ends))
    if result is not None:
        _protect(nav, measurement, prior, P_after, H, R, confirmed)
        if confirmed:
            state = unpack(t_s, after)
            nav.health[measurement.sensor] = sensor.confirmed(nav, state, imu, at_s, measurement.fix)
    return after, P_after, measurement, result


def _protect(nav, measurement, P_before, P_after, H, R, confirmed):
    """Tell the watch of a measurement that has just been used for the first time."""
    watch, limit, name = nav.watch, nav.limit(len(R)), measurement.sensor
    whole = name == "star_vectors" and measurement.fix.reason == Reason.NONE  # as good as the attitude
    watch.used("star_tracker" if whole else name, measurement.fix.t_valid_s, nav.history[-1].t_s)
    if name == "star_vectors":
        found = integrity_protection.slope_of_vectors(nav.layout, P_before, P_after, nav.limit(2), H, R)
    elif name == "star_tracker":
        found = integrity_protection.slope_of_stars(P_before, P_after, limit, H, R, confirmed)
    else:
        found = integrity_protection.slope(P_before, P_after, limit)
    watch.used_now.append(found)


def _forgotten(nav, P, sensor, admitted):
    """Covariance in which nothing is known of what a sensor measures, or less by a sigma that is admitted."""
    places = nav.layout.places
    if isinstance(admitted, dict):  # block -> (3,)
        P = P.copy()
        for name, sigma in admitted.items():
            P[places[name], places[name]] += np.diag(sigma**2)
        return P
    if admitted is not None:
        P = P.copy()
        for name in (sensor.block, *sensor.with_it):
            if places[name] is not None:
                P[places[name], places[name]] += admitted**2 * np.eye(3)
        return P
    P = eskf.forget(P, places[sensor.block], sensor.forgotten**2)
    for name in sensor.with_it:
        if places[name] is not None:
            P = eskf.forget(P, places[name], initial_covariance(nav.params, name))
    return P
