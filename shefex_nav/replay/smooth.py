"""Best estimate of a flight from its log: the filter forward, then a smoother over all that it believed.

The forward run is the one on board, with its delays and its decisions which measurement to believe. What
stands at its end (`final_pass`) is smoothed, with what can be done better after the flight
(`after_the_flight`): the field of the Earth is known, and errors of the sensors that last have states. A
Kalman filter linear about the filter's own trajectory goes forward (`relinear`) and the adjoint backward
(`smoother`); what comes out is a better trajectory, about which both go once more, and again where it still
moves (`MOVES`).

Memory is some 1.3 MB per second of flight with 48 states; time is some three times that of the filter.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gravity
from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.geometry import frames
from shefex_nav.log.run_data import RunData, RunDataBuilder
from shefex_nav.onboard.driving import drive
from shefex_nav.onboard.navigation import adaptation, covariance, integrity_readings, solution
from shefex_nav.onboard.navigation.blocks import CONTAINED, STATES
from shefex_nav.onboard.navigation.prediction import Memory
from shefex_nav.onboard.navigation.quantity import ATTITUDE, about
from shefex_nav.onboard.navigation.state import ATT, X_R, used_at_start
from shefex_nav.onboard.navigation.strapdown import BEFORE
from shefex_nav.onboard.navigator import COVARIANCE_TICKS, Columns, Navigator
from shefex_nav.records import NavSolution
from shefex_nav.replay import final_pass, relinear, rerun, smoother
from shefex_nav.replay.series import between
from shefex_nav.scenario import load, params_onboard

CHUNK_TICKS = 100  # of which the solution is written down at once: what the processor's cache holds
FIELD_TICKS = 100  # between two places at which the field is worked out
MOVES = np.radians(2.0)  # [E] a pass is off by some half of the square of what the trajectory moves in it
MOST_PASSES = 6
FILTER_SHARE = 0.3  # of the time, roughly
FIELD_ERROR = 2e-6 * STANDARD_GRAVITY  # [E] m/s^2, of the field that is known after the flight
LASTING = tuple(state.name for state in STATES if state.lasts)


class Smoothed(NamedTuple):
    """What comes out."""

    filtered: RunData  # of the filter as it was run, on board or configured otherwise
    # the same with NavSolution and NavCovariance of the smoother; how far the solution can be trusted, which
    # is judged on board, is what the filter said of its own
    smoothed: RunData


class Chunk(NamedTuple):
    """Ticks 0 ... m - 1 of a solution, as `solution.fill` and `covariance.fill` read a History."""

    arrays: Memory


def run(recording, progress=lambda share: None):
    """Smooth a log.

    Parameters
    ----------
    recording : rerun.Recording
    progress : function of the share done, 0 ... 1

    Returns
    -------
    Smoothed
    """
    filtered, nav, final = forward(recording, lambda share: progress(FILTER_SHARE * share))
    recording = after_the_flight(recording)
    used = any(gate.accepted and about(gate.sensor) is ATTITUDE for gate in filtered.gates)

    def later(share):
        progress(FILTER_SHARE + (1.0 - FILTER_SHARE) * share)

    nav, covariance_ = backward(recording, nav, final, used, later)
    judged = NavSolution._fields[NavSolution._fields.index("star_aided") + 1 :]
    nav = nav._replace(**{name: getattr(filtered.nav, name) for name in judged})
    return Smoothed(filtered, filtered._replace(nav=nav, covariance=covariance_))


def after_the_flight(recording):
    """The Recording with the filter that is smoothed: it need not keep up with the vehicle.

    External data, of which neither field nor data sheet of the sensors are known, keep the filter they had.
    """
    if recording.gravity is None:
        return recording
    return knowing_the_field(with_lasting_errors(recording))


def with_lasting_errors(recording):
    """The Recording with states for errors of the sensors that last: `LASTING`, those that there are.

    On board they are noise with the memory of a burn or of a turn. That is good enough to filter by; a
    smoother takes the same error in boost and at entry for two that are independent, and averages over them.
    """
    given = recording.params.states
    others = [
        block for block in given if block not in CONTAINED and block not in LASTING
    ]  # what sensors need
    known = _with_states(recording, [*LASTING, *others]).params.sigma_blocks
    states = dict.fromkeys([*given, *(block for block in LASTING if np.any(known[block]))])
    for part, wholes in CONTAINED.items():
        if any(whole in states for whole in wholes):
            states.pop(part, None)
    return _with_states(recording, states)


def _with_states(recording, states):
    """The Recording of a mission with other states of the filter."""
    overrides = [f"navigation.states=[{', '.join(states)}]"]
    scenario = load.load_text(recording.scenario_text, recording.path, overrides)
    return recording._replace(params=params_onboard.nav_params(scenario))


def knowing_the_field(recording):
    """The Recording with the field of the Earth that its scenario names instead of the on-board model.

    On board, what J2 leaves out is a process of thousands of seconds, or, where that is no state, bias that
    walks and noise: good enough to filter by and too optimistic to smooth by. External data name no field and
    are left with that of the filter.
    """
    if recording.gravity is None:
        return recording
    params = recording.params
    if "gravity" in params.states:
        known = params.sigma_blocks | {"gravity": np.full(3, FIELD_ERROR)}
        params = params._replace(sigma_blocks=known, gravity_error=FIELD_ERROR)
    else:
        params = params._replace(imu=params.imu._replace(gravity=FIELD_ERROR))
    return recording._replace(field=recording.gravity, params=params)


def forward(recording, progress=lambda share: None):
    """The filter over a whole log.

    -> RunData with what it said, fusion.Filter at the end, final_pass.Final
    """
    if recording.field is not None:
        raise ValueError("the filter runs in the on-board field; a better one is for `backward`")
    blocks, said = recording.data.imu, RunDataBuilder(recording.data.mission)
    nav, columns = rerun.start(recording), Columns(1)
    used_s = used_at_start(nav.params, nav.history.ends_s[0])
    nav = nav._replace(history=final_pass.Keeping(nav.history[0], nav.history.drives.shape[2], used_s))
    done, end, before = 0, len(blocks.t_valid_s), _axes(nav)
    states = np.zeros((end + 1, 6), dtype=int)
    for k, _, outputs in drive(Navigator(nav, columns), blocks, recording.arrivals):
        states[done + 1 : k + 1] = before  # a change ends the ticks that are made at once
        done, before = k + 1, _axes(nav)
        states[done] = before
        for record in outputs:
            said.add(record)
        progress(done / end)
    said = said.build()
    told = dict(zip(("nav", "covariance"), columns.read(), strict=False))
    told |= {"gates": said.gates, "health": said.health}
    final = without_hedging(nav.history.final(), states, blocks.saturated, nav.watch.imu.rules)
    return recording.data._replace(**told), nav, final


def _axes(nav):
    """State of each axis of the IMU, as `ImuWatch.state`: (6,) int, a copy."""
    return np.zeros(6, dtype=int) if nav.watch.imu is None else nav.watch.imu.state.copy()


def without_hedging(final, states, saturated, rules):
    """The Final with the noise that readings at the end of their range deserve as one sees it afterwards.

    On board such readings count as wrong in the same sense until a fix, also where good ones lie in between,
    so the noise grows with the square of their number. Here only those that follow on each other do.

    states : (N + 1, 6) int, of the axes at each tick, as `ImuWatch.state`
    saturated : (N,) bool, what the unit says;  rules : `ImuWatch.rules`
    """
    numbers, extra = final.numbers, final.extra.copy()
    lengths_s = numbers[:, 1] * numbers[:, 2]
    readings = np.abs(final.increments[:, BEFORE:]).max(axis=1)
    limits = 0.999 * numbers[:, 1, None] * np.repeat(rules[1], 3)
    at_range = readings >= limits
    unnamed = np.append(False, saturated) & ~at_range.any(axis=1)
    at_range |= unnamed[:, None]
    for axis in range(6):
        run_s = 0.0
        for k in np.flatnonzero(states[:, axis] == integrity_readings.SATURATED):
            if not at_range[k, axis]:
                extra[k, axis // 3, axis % 3] = 0.0
                continue
            run_s = run_s if k > 1 and at_range[k - 1, axis] else 0.0
            missed, T = rules[4, axis // 3], lengths_s[k]
            extra[k, axis // 3, axis % 3] = missed**2 * ((run_s + T) ** 2 - run_s**2) / T
            run_s += T
    return final._replace(extra=extra)


def backward(recording, flown, final, star_aided, progress=lambda share: None):
    """The smoother over what a filter believed.

    Parameters
    ----------
    recording : rerun.Recording with the filter that is smoothed
    flown, final : of `forward`
    star_aided : whether the filter used a star fix

    Returns
    -------
    NavSolution, NavCovariance of arrays
    """
    nav = adaptation.replayed(rerun.start(recording), flown.noise.schedule)
    start, whole = nav.history[0], final_pass.Whole(final, nav.history.P)
    nodes = final_pass.nodes(flown, final, nav.layout)
    intervals = relinear.room(len(nodes.ticks), nav.layout.n)
    one_pass = partial(smoothed_about, nav, whole, nodes, start, intervals)
    xs = nodes.xs
    for k in range(MOST_PASSES):
        e, _ = one_pass(relinear.Trajectory(xs, known_field(recording, nodes, final, xs)))
        xs = smoother.moved(xs, e, nav.layout.nominal)
        progress((k + 1.0) / (k + 3.0))
        if np.sqrt((e[nodes.ends, ATT] ** 2).sum(axis=1).max()) < MOVES or k == MOST_PASSES - 1:
            break
    e, wanted = one_pass(relinear.Trajectory(xs, known_field(recording, nodes, final, xs)), second=True)
    xs = smoother.moved(xs, e, nav.layout.nominal)
    progress(0.9)
    stars = nav.health["star_tracker"]._replace(used=int(star_aided))
    nav = nav._replace(health={**nav.health, "star_tracker": stars})
    return solutions(nav, final, nodes, xs, wanted)


def smoothed_about(nav, whole, nodes, start, intervals, trajectory, second=False):
    """Forward and backward once, linear about a trajectory.

    nav : fusion.Filter;  whole : final_pass.Whole;  nodes : final_pass.Nodes;  start : history.Tick
    intervals : relinear.Intervals, overwritten
    second : whether covariances are wanted

    Returns
    -------
    e : (m + 1, n) errors of the trajectory
    wanted : smoother.Wanted, covariances of the nine at the ends of ticks, of all at every tenth; or None
    """
    passed = relinear.forward(nav, whole, nodes, trajectory, start, intervals, second)
    wanted = None
    if second:
        n, count, tenth = nav.layout.n, len(nodes.xs), nodes.ends[COVARIANCE_TICKS::COVARIANCE_TICKS]
        ends, rows = np.zeros(count, dtype=bool), np.full(count, -1)
        ends[nodes.ends], rows[tenth] = True, np.arange(len(tenth))
        nine = np.empty((count, relinear.TOP, relinear.TOP))
        wanted = smoother.Wanted(ends, nine, rows, np.empty((len(tenth), n, n)))
    return smoother.back(nav, nodes, passed, wanted), wanted


def known_field(recording, nodes, final, xs):
    """Gravity that the on-board field leaves out and the recording's does not: (m + 1, 3) m/s^2, inertial.

    Worked out once a second of ticks and taken as linear between: over a few kilometres it is.
    """
    if recording.field is None:
        return np.zeros((len(xs), 3))
    earth, last = recording.data.mission.earth, len(nodes.ends) - 1
    at = np.unique(np.append(np.arange(0, last, FIELD_TICKS), last))
    t_s, found = final.numbers[:, 0], np.empty((len(at), 3))
    for row, k in enumerate(at):
        C_ie = frames.dcm_ie(earth, t_s[k])
        r_e = C_ie.T @ xs[nodes.ends[k], X_R]
        found[row] = C_ie @ (gravity.gravity_e(recording.field, r_e) - gravity.gravity_j2_e(r_e))
    begin = nodes.parts_s[:, 0] - final.numbers[nodes.ticks, 1] * final.numbers[nodes.ticks, 2]
    begin_s = np.append(t_s[nodes.ticks] + begin, t_s[last])
    half_s = 0.5 * np.append(nodes.parts_s[:, 1] - nodes.parts_s[:, 0], 0.0)
    return between(begin_s + half_s, t_s[at], found)


def solutions(nav, final, nodes, xs, wanted):
    """NavSolution of the smoother at every tick, and NavCovariance at every tenth.

    nav : fusion.Filter of the same parameters;  xs, wanted : of the last pass
    What is left of the errors behind the attitude changes slowly; that of the tenth tick stands for the nine
    before it.
    """
    last, n = len(nodes.ends) - 1, nav.layout.n
    rows = np.empty((last, solution.WIDTH))
    spread = np.empty((last // COVARIANCE_TICKS, covariance.width(nav.layout)))
    room = np.zeros((min(CHUNK_TICKS, last), n, n))
    for first in range(1, last + 1, CHUNK_TICKS):
        ticks = np.arange(first, min(first + CHUNK_TICKS, last + 1))
        Ps = room[: len(ticks)]
        if len(wanted.whole):
            nearest = np.minimum((ticks - 1) // COVARIANCE_TICKS, len(wanted.whole) - 1)
            np.take(wanted.whole, nearest, axis=0, out=Ps, mode="clip")
        Ps[:, :9, :9] = wanted.nine[nodes.ends[ticks]]
        of_ticks = (array[ticks] for array in (final.numbers, final.increments, final.extra))
        at_ticks, drives = xs[nodes.ends[ticks]], final.drives[ticks]
        memory = Memory(*of_ticks, at_ticks, Ps, at_ticks[-1], Ps[-1], drives)
        here = nav._replace(history=Chunk(memory))
        solution.fill(here, range(len(ticks)), rows[first - 1 : first - 1 + len(ticks)], False)
        tenth = ticks[ticks % COVARIANCE_TICKS == 0]
        if len(tenth):
            own = spread[tenth[0] // COVARIANCE_TICKS - 1 : tenth[-1] // COVARIANCE_TICKS]
            covariance.fill(here, range(tenth[0] - first, tenth[-1] - first + 1, COVARIANCE_TICKS), own)
    return solution.columns(rows), covariance.columns(nav.layout, spread)
