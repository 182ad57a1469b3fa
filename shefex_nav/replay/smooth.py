"""Best estimate of a flight from its log: the filter forward, the smoother backward, and both once more.

The forward run is the one on board, with its delays and its decisions which measurement to believe, but for
what can be done better after the flight (`after_the_flight`): the field of the Earth is known, and errors of
the sensors that last have states. What is smoothed is its final pass, in which every measurement stands at
its instant. That pass is kept piece by piece only: on the way forward a copy of the filter is put aside every
SEGMENT_TICKS, and on the way back each segment is run once more from its copy. What comes out is a better
trajectory than the filter's, and the same measurements are smoothed again, linear about it (`relinear`).

Memory is that of one segment, 10 s, some 150 MB with 51 states, and of copies, steps and result, some 1 MB
per second of flight; time is some ten times the filter's.
"""

import copy
from functools import partial
from itertools import accumulate
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.environment import gravity
from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.log.run_data import RunData, RunDataBuilder, join, stack
from shefex_nav.onboard.navigation.blocks import CONTAINED
from shefex_nav.onboard.navigation.fusion import Interval, finish
from shefex_nav.onboard.navigation.history import History, Tick
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.state import ATT, corrected, pack
from shefex_nav.onboard.telemetry import RECORDS
from shefex_nav.records import GateResult, NavCovariance, NavHealth, NavSolution
from shefex_nav.replay import relinear, rerun, smoother
from shefex_nav.scenario import load, params_onboard

SEGMENT_TICKS = 1000
SAID = {NavSolution: "nav", NavCovariance: "covariance", GateResult: "gates", NavHealth: "health"}
FIELD_ERROR = 2e-6 * STANDARD_GRAVITY  # [E] m/s^2, of the field that is known after the flight
LASTING = (  # blocks of errors that last for the whole flight
    "gyro_scale",
    "gyro_misalignment",
    "gyro_g_sensitivity",
    "accel_scale",
    "accel_misalignment",
    "accel_rectification",
)


class Smoothed(NamedTuple):
    """What comes out."""

    filtered: RunData  # of the filter as it was run, on board or configured otherwise
    # the same with NavSolution and NavCovariance of the smoother; how far the solution can be trusted, which
    # is judged on board, is what the filter said of its own
    smoothed: RunData


class Copy(NamedTuple):
    """The filter at some moment of the way forward."""

    tick: int  # that comes next
    nav: object  # fusion.Filter
    final_s: float  # up to here nothing changes any more


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
    n = len(recording.data.imu.t_valid_s)

    def share(begin, end):
        return lambda k: progress(begin + (end - begin) * k / n)

    _, filtered = forward(recording, share(0.0, 0.1))
    recording = after_the_flight(recording)
    copies, final = forward(recording, share(0.1, 0.25))
    steps, e = backward(recording, copies, share(0.5, 0.25))
    star_aided = any(gate.accepted and gate.sensor.startswith("star") for gate in final.gates)
    nav, covariance = again(copies[0].nav, steps, e, star_aided, share(0.5, 1.0))
    judged = NavSolution._fields[NavSolution._fields.index("star_aided") + 1 :]
    nav = nav._replace(**{name: getattr(filtered.nav, name) for name in judged})
    return Smoothed(filtered, final._replace(nav=nav, covariance=covariance))


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
    known = _with_states(recording, LASTING).params.sigma_blocks
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
        params = params._replace(sigma_blocks=known, gravity_sigma=FIELD_ERROR)
    else:
        params = params._replace(imu=params.imu._replace(gravity=FIELD_ERROR))
    return recording._replace(field=gravity.load(*recording.gravity), params=params)


def forward(recording, progress=lambda k: None):
    """The filter over a whole log. -> list of Copy, RunData with what it said"""
    nav, copies, said = rerun.start(recording), [], RunDataBuilder(recording.data.mission)
    for k in range(len(recording.data.imu.t_valid_s)):
        if k % SEGMENT_TICKS == 0:
            copies.append(Copy(k, copy.deepcopy(nav), nav.history[0].t_s))
            progress(k)
        for record in rerun.tick(recording, nav, k):
            if type(record) in SAID:
                said.add(record)
    said = said.build()
    return copies, recording.data._replace(**{name: getattr(said, name) for name in SAID.values()})


def backward(recording, copies, progress=lambda k: None):
    """The smoother from the end of a log to its beginning.

    Parameters
    ----------
    recording : rerun.Recording
    copies : list of Copy
    progress : function of the tick reached

    Returns
    -------
    list of relinear.Way and relinear.Seen : the steps of the final pass with what is smoothed
    (n,) error of the filter's state at the start
    """
    layout, found = copies[0].nav.layout, []
    adjoint, until_s = smoother.at_the_end(layout.n), np.inf
    for start in copies[::-1]:
        for step in _steps(recording, start, until_s)[::-1]:
            e = -step.P_after @ adjoint.vector
            found.append(relinear.step_of(step, corrected(pack(step.state_after), e, layout.nominal)))
            adjoint = _before(step, adjoint, layout)
        until_s = start.final_s
        progress(start.tick)
    return found[::-1], -copies[0].nav.history[0].P @ adjoint.vector


def again(nav, steps, e, star_aided, progress=lambda k: None):
    """Filter and smoother once more, linear about what is smoothed.

    Parameters
    ----------
    nav : fusion.Filter at the start
    steps, e : of `backward`
    star_aided : whether the filter used a star fix
    progress : function of the ticks done, half of them on the way forward

    Returns
    -------
    NavSolution, NavCovariance of arrays
    """
    x, filtered = relinear.origin(nav, nav.history[0], e)
    begins, ticks = [], 0
    for k, step in enumerate(steps):
        if k % SEGMENT_TICKS == 0:
            begins.append((k, ticks, x, filtered))
            progress(0.5 * ticks)
        filtered, x = relinear.follow(nav, filtered, x, step), step.x
        ticks += _at_a_tick(step)
    adjoint, pieces = smoother.at_the_end(nav.layout.n), {NavSolution: [], NavCovariance: []}
    for first, before, x, filtered in begins[::-1]:
        rows = {NavSolution: [], NavCovariance: []}
        part = steps[first : first + SEGMENT_TICKS]
        found = list(accumulate(part, partial(_next, nav), initial=(x, filtered)))[1:]
        at = before + sum(map(_at_a_tick, part))
        progress(ticks - 0.5 * at)
        for step, (_, after) in zip(part[::-1], found[::-1], strict=True):
            if _at_a_tick(step):
                for record in _said(nav, at, step, after, adjoint, star_aided):
                    rows[type(record)].append(record)
                at -= 1
            adjoint = relinear.back(adjoint, after)
        for record, said in rows.items():
            if said:
                pieces[record].append(stack(record, said[::-1]))
    return tuple(join(said[::-1]) for said in pieces.values())


def _at_a_tick(step):
    """Whether a step leads to the end of a tick."""
    return type(step) is relinear.Way and step.t_end_s == step.imu.t_end_s


def _next(nav, reached, step):
    """(packed nominal values, Filtered) after a step, from those before it."""
    x, filtered = reached
    return step.x, relinear.follow(nav, filtered, x, step)


def _said(nav, ticks, step, after, adjoint, star_aided):
    """NavSolution of the smoother at the end of a tick, and NavCovariance where the filter had one.

    nav : fusion.Filter of the same parameters; ticks : how many there are up to here; after : Filtered
    """
    e, P = smoother.smoothed(adjoint, after.P, after.mean)
    x = corrected(step.x, e, nav.layout.nominal)
    stars = nav.health["star_tracker"]._replace(used=int(star_aided))
    nav = nav._replace(
        history=History(Tick(step.t_end_s, x, P, step.imu)),
        health={**nav.health, "star_tracker": stars},
    )
    yield from RECORDS.now(nav, ticks)


def _steps(recording, start, until_s):
    """Interval and Correction of the final pass from a Copy to an instant, in order of time."""
    steps = []
    nav = copy.deepcopy(start.nav)._replace(recorder=steps.append)
    for k in range(start.tick, len(recording.data.imu.t_valid_s)):
        rerun.tick(recording, nav, k)
        if nav.history[0].t_s >= until_s - SAME_S:
            return steps
    finish(nav)
    return steps


def _before(step, adjoint, layout):
    """Adjoint before a step, from that after it."""
    if type(step) is Interval:
        return smoother.before_interval(adjoint, step.Phi)
    if step.fate == Fate.DOUBTED:  # noise that was added, which needs nothing here
        return adjoint
    G = np.eye(layout.n)
    G[ATT, ATT] = step.G
    adjoint = smoother.before_update(adjoint, step.P_forgotten, step.z, step.H, step.R, G)
    for block in step.cut:  # drawn anew before it; an error that a reset only admits is noise again
        adjoint = smoother.before_forgetting(adjoint, block)
    return adjoint
