"""Whether a filter's errors are what its covariance says, over runs with different seeds.

Per block of errors and phase of the mission the time-averaged NEES against histories that obey the filter's
own matrices, per sensor the NIS against chi-square, per axis the share of runs inside 3 sigma. `nees` has
the statistics, `flown` the runs, `linear` the histories.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from shefex_nav import prepare
from shefex_nav.onboard.navigation import momentary, state
from shefex_nav.onboard.navigation.laws import FIELD_TIME_S
from shefex_nav.onboard.navigation.state import ATT, BA, VEL
from shefex_nav.report.navigation_errors import nees as normalised
from shefex_nav.verify import flown, linear, nees
from shefex_nav.verify.flown import BLOCKS, N_CORE, PHASES

HISTORIES = 1000
# of each; of containment there are 15 a phase, of which a right filter must not leave any by chance
NEES_PROBABILITY, NIS_PROBABILITY, CONTAINED_PROBABILITY = 0.999, 0.999, 0.999


class Extra(NamedTuple):
    """What is reported beyond the covariance that the filter carries, at each epoch."""

    velocity: np.ndarray  # (m,) m/s, errors of the moment
    attitude: np.ndarray  # (m,) rad
    gravity: float  # m/s^2, part of the bias estimate


class Histories(NamedTuple):
    """Time-averaged NEES of simulated errors."""

    averages: dict  # (block, phase) -> (number,)
    P: np.ndarray  # (m, 15, 15) as reported, at the epochs
    one_field: dict  # of `in_one_field`; empty where gravity is no state, or where nobody asked


def of_run(scenario, seed, fixes, *, number=HISTORIES, rng, one_field=False):
    """A run and histories from the matrices that its filter used.

    scenario, seed, fixes as `flown.filter_run` takes them; one_field: as well those of runs that have the
    field in common -> Run, Histories
    """
    world = prepare.build_world(scenario, seed)
    nav_params = world.computer.nav
    recorder = flown.Recorder(float(world.alignment.t_valid_s))
    run = flown.filter_run(scenario, seed, fixes, recorder=recorder, world=world)
    order = state.layout(nav_params.states)
    _, P = state.initial(nav_params, order, world.alignment)
    extra = reported_besides(nav_params, recorder.vibration(run.t_s))
    histories = simulate(P, recorder.steps, run.t_s, run.phase, extra, number=number, rng=rng)
    if one_field and order.places["gravity"] is not None:
        what = P, recorder.steps, run.t_s, run.phase, extra, order.places["gravity"]
        histories = histories._replace(one_field=in_one_field(*what, number=number, rng=rng))
    return run, histories


def reported_besides(params, levels):
    """Extra under some levels of the vibration. NavParams, (m,)"""
    of = momentary.of(params)
    velocity, attitude = np.sqrt([momentary.variances(of, level) for level in levels.tolist()]).T
    return Extra(velocity, attitude, params.imu.gravity)


def simulate(P, steps, t_s, phase, extra, *, number=HISTORIES, rng):
    """Histories of the errors of a filter, from its own matrices.

    Parameters
    ----------
    P : (n, n) at the start
    steps : of `linear`, in order
    t_s, phase : (m,) epochs of a Run
    extra : Extra
    number : of histories
    rng : Generator

    Returns
    -------
    Histories
    """
    sums = {(block, p): np.zeros(number) for block in BLOCKS for p in range(len(PHASES))}
    counts = np.zeros(len(PHASES), dtype=int)
    field, covariances = rng.standard_normal((3, number)), []
    for k, output in enumerate(linear.outputs(P, steps, t_s, rng=rng, number=number)):
        if k:
            keeps = np.exp(-(t_s[k] - t_s[k - 1]) / FIELD_TIME_S)
            field = keeps * field + np.sqrt(1.0 - keeps**2) * rng.standard_normal((3, number))
        P_k, errors = output.P[:N_CORE, :N_CORE].copy(), output.errors[:N_CORE].copy()
        for block, sigma in ((VEL, extra.velocity[k]), (ATT, extra.attitude[k])):
            if sigma > 0.0:
                P_k[block, block] += sigma**2 * np.eye(3)
                errors[block] += sigma * rng.standard_normal((3, number))
        P_k[BA, BA] += extra.gravity**2 * np.eye(3)
        errors[BA] += extra.gravity * field
        covariances.append(P_k)
        if phase[k] < 0:
            continue
        counts[phase[k]] += 1
        for name, block in BLOCKS.items():
            sums[name, int(phase[k])] += normalised(errors[block].T, P_k[block, block][None])
    averaged = {key: total / counts[key[1]] for key, total in sums.items() if counts[key[1]] > 0}
    return Histories(averaged, np.array(covariances), {})


def in_one_field(P, steps, t_s, phase, extra, field, *, number=HISTORIES, rng):
    """Histories of runs that all fly through the same field: that of the block `gravity` is drawn once.

    Parameters
    ----------
    P, steps, t_s, phase, extra, number, rng : as of `simulate`
    field : slice of the errors of gravity

    Returns
    -------
    (block, phase) -> nees.Common: of `number` runs, and as many fields
    """
    states = np.zeros(len(P))
    states[field] = 1.0
    parts = linear.Share(1.0 - states, True), linear.Share(states, False)
    ways = [linear.outputs(P, steps, t_s, rng=rng, number=number, share=share) for share in parts]
    sums, counts = {}, np.bincount(phase[phase >= 0], minlength=len(PHASES))
    for k, (own, common) in enumerate(zip(*ways, strict=True)):
        p = int(phase[k])
        for name, block in BLOCKS.items() if p >= 0 else ():
            swing = {"velocity": extra.velocity[k], "attitude": extra.attitude[k]}.get(name, 0.0)
            o = own.errors[block] + swing * rng.standard_normal((3, number))
            c = common.errors[block]
            weight = np.linalg.inv(own.P[block, block] + swing**2 * np.eye(3)) / counts[p]
            if (name, p) not in sums:
                shapes = number, (number, number), number
                sums[name, p] = nees.Common(*(np.zeros(shape) for shape in shapes))
            sums[name, p].own[:] += np.einsum("im,ij,jm->m", o, weight, o)
            sums[name, p].cross[:] += o.T @ (weight @ c)
            sums[name, p].same[:] += np.einsum("im,ij,jm->m", c, weight, c)
    return sums


def averages(run):
    """Time-averaged NEES of one Run: (block, phase) -> float."""
    result = {}
    for name, block in BLOCKS.items():
        values = normalised(run.errors[:, block], run.P[:, block, block])
        for p in range(len(PHASES)):
            if np.any(run.phase == p):
                result[name, p] = float(values[run.phase == p].mean())
    return result


def judge_nees(runs, histories):
    """Verdict of each block and phase: mean over runs of the time-averaged NEES, per degree of freedom."""
    expected = {key: averaged / 3.0 for key, averaged in histories.averages.items()}
    return _judge_averages(runs, expected, 1.0, nees.mean_interval, "")


def judge_in_one_field(runs, common, rng):
    """`judge_nees` by runs that have the field of gravity in common, of `in_one_field`."""
    interval = partial(nees.one_draw_interval, rng=rng)
    return _judge_averages(runs, common, 3.0, interval, ", one field")


def _judge_averages(runs, expected, dof, interval, words):
    """Verdicts by what is expected of each block and phase, as `interval` takes it, over its dof."""
    each, verdicts = [averages(run) for run in runs], []
    for (block, phase), histories in expected.items():
        values = [one[block, phase] for one in each if (block, phase) in one]
        ends = (end / dof for end in interval(histories, len(values), NEES_PROBABILITY))
        what = f"NEES {block}, {PHASES[phase]}{words}"
        verdicts.append(nees.Verdict(what, float(np.mean(values)) / 3.0, *ends, len(values)))
    return verdicts


def judge_nis(runs):
    """Verdict of each sensor: mean NIS per degree of freedom, of every measurement that met the gate."""
    verdicts = []
    for sensor in sorted({name for run in runs for name in run.nis}):
        total = sum(float(run.nis[sensor].sum()) for run in runs if sensor in run.nis)
        dof = sum(int(run.dof[sensor].sum()) for run in runs if sensor in run.nis)
        low, high = nees.nis_interval(dof, NIS_PROBABILITY)
        count = sum(len(run.nis[sensor]) for run in runs if sensor in run.nis)
        verdicts.append(nees.Verdict(f"NIS {sensor}", total / dof, low, high, count))
    return verdicts


def judge_containment(runs):
    """Verdict of each error at the end of each phase: share of the runs inside 3 sigma."""
    verdicts = []
    for p, phase in enumerate(PHASES):
        chosen = [(run, np.flatnonzero(run.phase == p)[-1]) for run in runs if np.any(run.phase == p)]
        if not chosen:
            continue
        sigma = np.array([np.sqrt(np.diag(run.P[k])) for run, k in chosen])
        inside = np.abs(np.array([run.errors[k] for run, k in chosen])) <= 3.0 * sigma
        low, high = nees.containment_interval(len(chosen), CONTAINED_PROBABILITY)
        for name, block in BLOCKS.items():
            for axis, share in zip("xyz", inside[:, block].mean(axis=0), strict=True):
                what = f"3 sigma {name} {axis}, end of {phase}"
                verdicts.append(nees.Verdict(what, float(share), low, high, len(chosen)))
    return verdicts


def judge(runs, histories, rng):
    """All Verdicts of some runs; of the NEES by histories with the field in common where there are any."""
    common = histories.one_field
    by_nees = judge_in_one_field(runs, common, rng) if common else judge_nees(runs, histories)
    return by_nees + judge_nis(runs) + judge_containment(runs)
