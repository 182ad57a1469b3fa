"""Best estimate of a flight from its log: the filter forward, the smoother backward.

The forward run is the one on board, with its delays and its decisions which measurement to believe, but for
the field of the Earth, which is known better after the flight (`knowing_the_field`). What is smoothed is its
final pass, in which every measurement stands at its instant. That pass is kept piece by piece only: on the
way forward a copy of the filter is put aside every SEGMENT_TICKS, and on the way back each segment is run
once more from its copy. So memory is that of one segment, 10 s, some 50 MB with 21 states, and of the copies
and the result, some 0.1 MB and 0.6 MB per second of flight; time is some four times the filter's.
"""

import copy
from typing import NamedTuple

import numpy as np

from shefex_nav.environment import gravity
from shefex_nav.log.run_data import RunData, RunDataBuilder, join, stack
from shefex_nav.onboard import computer
from shefex_nav.onboard.navigation import solution
from shefex_nav.onboard.navigation.fusion import Interval, finish
from shefex_nav.onboard.navigation.history import History, Tick
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.state import ATT, correct, pack
from shefex_nav.records import GateResult, NavCovariance, NavHealth, NavSolution
from shefex_nav.replay import rerun, smoother

SEGMENT_TICKS = 1000
SAID = {NavSolution: "nav", NavCovariance: "covariance", GateResult: "gates", NavHealth: "health"}
FIELD_ERROR = 2e-6 * 9.80665  # [E] m/s^2, of the field that is known after the flight
SAME_S = 1e-6  # instants closer together than this are one


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
    _, filtered = forward(recording, lambda k: progress(k / (4.0 * n)))
    recording = knowing_the_field(recording)
    copies, final = forward(recording, lambda k: progress((n + k) / (4.0 * n)))
    star_aided = any(gate.accepted and gate.sensor.startswith("star") for gate in final.gates)
    nav, covariance = backward(recording, copies, star_aided, lambda k: progress((2 * n - k) / (2.0 * n)))
    judged = NavSolution._fields[NavSolution._fields.index("star_aided") + 1 :]
    nav = nav._replace(**{name: getattr(filtered.nav, name) for name in judged})
    return Smoothed(filtered, final._replace(nav=nav, covariance=covariance))


def knowing_the_field(recording):
    """The Recording with the field of the Earth that its scenario names instead of the on-board model.

    On board, what J2 leaves out is a process of a few hundred seconds, or, where that is no state, bias that
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


def backward(recording, copies, star_aided, progress=lambda k: None):
    """The smoother from the end of a log to its beginning.

    Parameters
    ----------
    recording : rerun.Recording
    copies : list of Copy
    star_aided : whether the filter used a star fix
    progress : function of the tick reached

    Returns
    -------
    NavSolution, NavCovariance of arrays
    """
    k = len(recording.data.imu.t_valid_s)  # ticks that are still to come, on the way back
    adjoint, until_s = smoother.at_the_end(copies[0].nav.layout.n), np.inf
    pieces = {NavSolution: [], NavCovariance: []}
    for start in copies[::-1]:
        rows = {NavSolution: [], NavCovariance: []}
        for step in _steps(recording, start, until_s)[::-1]:
            if type(step) is Interval and step.t_end_s == step.imu.t_end_s:
                for record in _said(start.nav, k, step, adjoint, star_aided):
                    rows[type(record)].append(record)
                k -= 1
            adjoint = _before(step, adjoint, start.nav.layout)
        for record, found in rows.items():
            pieces[record].append(stack(record, found[::-1]))
        until_s = start.final_s
        progress(start.tick)
    return tuple(join(found[::-1]) for found in pieces.values())


def _said(nav, ticks, step, adjoint, star_aided):
    """NavSolution of the smoother at the end of an Interval, and NavCovariance where the filter had one.

    nav : fusion.Filter of the same parameters; ticks : how many there are up to here
    """
    e, P = smoother.smoothed(adjoint, step.P_after)
    state = correct(nav.layout, step.state_after, e)
    stars = nav.health["star_tracker"]._replace(used=int(star_aided))
    nav = nav._replace(
        history=History(Tick(state.t_s, pack(state), P, step.imu)),
        health={**nav.health, "star_tracker": stars},
    )
    yield solution.solution(nav)
    if ticks % computer.COVARIANCE_TICKS == 0:
        yield solution.covariance(nav)


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
