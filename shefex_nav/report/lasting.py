"""Blocks of `navigation.states` that are missing: of errors that last in a flight, noise to the filter.

Where weight lasts (`scenario.weight`) these errors are biases, and the filter's covariance does not hold
(docs/theory/filter.md, docs/verification/navigation.md). Not looked at: what falls through the air without a
parachute, and that one which opens at a great height hangs in free fall first.

Thrust and drag end soon, but an error of an accelerometer that moves the velocity by many times what GPS
leaves open is no noise either: the biases take it up, and then GPS seems to be wrong.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.instruments import state_sizes
from shefex_nav.onboard.navigation.blocks import OPTIONAL
from shefex_nav.records import Phase
from shefex_nav.scenario import wanted_states, weight
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.wanted_states import WINDOW_S

WARNED = 15.0  # [E] times the noise (docs/verification/navigation.md)
STEP_HZ = 25.0  # of the samples that are summed up
LEAST = 60.0  # m/s in a window, below which there is hardly any force


class Pushed(NamedTuple):
    """Velocity that an error of the accelerometers makes by thrust and drag in the worst `WINDOW_S`."""

    scale: float  # m/s per unit of the scale factors
    misalignment: float  # m/s per rad


def pushed(flown):
    """Pushed of a flight, rms of an inertial axis; None: there is hardly any force but weight at rest.

    flown : Trajectory, or TruthSample of arrays
    """
    if len(flown.t_s) < 2:
        return None
    rows, dt_s = wanted_states.thinned(flown.t_s, STEP_HZ)
    rests = np.isin(flown.phase[rows], (Phase.PAD, Phase.GROUND))
    pushed_b = np.where(rests[:, None], 0.0, flown.f_b[rows])
    seconds = max(1, round(1.0 / dt_s))
    pushes = np.add.reduceat(np.abs(pushed_b).sum(axis=1), np.arange(0, len(pushed_b), seconds)) * dt_s
    if np.convolve(pushes, np.ones(round(WINDOW_S))).max() < LEAST:
        return None
    C_ib = np.stack([_axis(flown.q_ib[rows], i) for i in range(3)], axis=-1)
    squares = wanted_states.windows_of(C_ib, pushed_b, dt_s)
    along = np.einsum("kii->k", squares)
    across = squares.sum(axis=(1, 2)) - along
    return Pushed(*(float(np.sqrt(one.max() / 3.0)) for one in (along, across)))


def _axis(q_ib, i):
    """Body axis i in inertial axes, (N, 3), without a kernel that every run would have to load."""
    w, u, e = q_ib[:, :1], q_ib[:, 1:], np.eye(3)[i]
    across = np.cross(u, e)
    return e + 2.0 * (w * across + np.cross(u, across))


def words(scenario, flown):
    """What `navigation.states` lacks for the flight of a programme.Flown, in one line; "" if nothing.

    scenario : with the states by name, `prepare.settled`
    """
    navigation = scenario.navigation
    if navigation.states == AUTOMATIC:
        raise ValueError("navigation.states: automatic is not settled yet: prepare.settled")
    for missing, why in (_of_weight(scenario, flown), _of_push(scenario, flown)):
        if missing:
            named = {*missing, *navigation.states}
            whole = [name for name in OPTIONAL | state_sizes() if name in named]
            are = "are" if missing[1:] else "is"
            return f"{_listed(missing)} {are} missing: {why}; write states: [{', '.join(whole)}]"
    return ""


def _of_weight(scenario, flown):
    """Blocks of errors that weight makes biases, and why: list of names, text."""
    navigation = scenario.navigation
    lasts_s, where = weight.longest(scenario, flown.events, flown.end_s)
    missing = [
        name for name, sigma in weight.errors(scenario.imu).items() if sigma and name not in navigation.states
    ]
    if not weight.is_bias(scenario, lasts_s):
        return [], ""
    errors_are, them = ("these errors are biases", "them") if missing[1:] else ("this error is a bias", "it")
    return missing, (
        f"{where} for {lasts_s:.0f} s, in which {errors_are} of the IMU; the filter takes {them} for noise "
        f"with a memory of {navigation.thrust_memory:g} s, so that its sigmas are wrong"
    )


def _of_push(scenario, flown):
    """Likewise of errors that are no noise while thrust or drag acts."""
    if flown.pushed is None:
        return [], ""
    accelerometer, noise = scenario.imu.accelerometer, wanted_states.noise(scenario, "accel_scale")
    sizes = {
        "accel_scale": accelerometer.scale_factor * flown.pushed.scale,
        "accel_misalignment": accelerometer.misalignment * flown.pushed.misalignment,
    }
    missing = [
        name
        for name, size in sizes.items()
        if size > WARNED * noise and name not in scenario.navigation.states
    ]
    if not missing:
        return [], ""
    most, moves = max(sizes[name] for name in missing), "errors move" if missing[1:] else "error moves"
    return missing, (
        f"{'their' if missing[1:] else 'its'} {moves} the velocity by {most:.2g} m/s within "
        f"{WINDOW_S:g} s of thrust or drag, {most / noise:.2g} times what GPS leaves open; the biases take "
        "it up, and then a right GPS seems to be wrong"
    )


def _listed(names):
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if names[1:] else names)
