"""Blocks of `navigation.states` that are missing: of errors that last in a flight, noise to the filter.

Where weight lasts (`wanted_states`) these errors are biases, and the filter's covariance does not hold
(docs/theory/filter.md, docs/verification/navigation.md). Not looked at: what falls through the air without a
parachute, and that one which opens at a great height hangs in free fall first.

Thrust and drag end soon, but an error of an accelerometer that moves the velocity by many times what GPS
leaves open is no noise either: the biases take it up, and then GPS seems to be wrong. Likewise an error of a
gyro in a spin: the noise that stands for it grows with the root of the angle, the error with the angle. And
what turns the star camera for good is in every fix; no number of fixes averages it out.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.instruments import state_sizes
from shefex_nav.onboard.navigation.blocks import OPTIONAL
from shefex_nav.records import Phase
from shefex_nav.report import columns
from shefex_nav.scenario import params_onboard, wanted_states
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.software import BUILT_IN
from shefex_nav.scenario.wanted_states import SWAMPS, WINDOW_S
from shefex_nav.world import absent

WARNED = 15.0  # [E] times the noise (docs/verification/navigation.md)
STEP_HZ = 25.0  # of the samples that are summed up
LEAST = 60.0  # m/s in a window, below which there is hardly any force
LEAST_TURN = 3.0  # rad in a window, below which there is hardly any turn
TURNS = 9.0  # times manoeuvre_angle: from there on a third of the error is what noise stands for, or less
WHOLE = "gyro_scale", "gyro_misalignment"  # of which gyro_roll_column is a part
OF_FLOOR = 0.1  # [E] of star_fix_floor: what a hundred fixes leave of it
HEADS = ("block of states", "its error moves", "noise makes", "estimated", "because")


class Pushed(NamedTuple):
    """Velocity that an error of the accelerometers makes by thrust and drag in the worst `WINDOW_S`."""

    scale: float  # m/s per unit of the scale factors
    misalignment: float  # m/s per rad


def turned(flown):
    """Squares of the angles [rad] that errors of the gyros make within `WINDOW_S`, about each second.

    flown : as of `pushed`
    -> (n, 3, 3), ij: per unit of what gyro i sees of the rate along j; None: there is hardly any turn
    """
    if len(flown.t_s) < 2:
        return None
    rows, dt_s = wanted_states.thinned(flown.t_s, STEP_HZ)
    omega_b, seconds = flown.omega_ib_b[rows], max(1, round(1.0 / dt_s))
    turns = np.add.reduceat(np.linalg.norm(omega_b, axis=1), np.arange(0, len(omega_b), seconds)) * dt_s
    if np.convolve(turns, np.ones(round(WINDOW_S))).max() < LEAST_TURN:
        return None
    return wanted_states.windows_of(_C_ib(flown.q_ib[rows]), omega_b, dt_s)[::seconds]


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
    squares = wanted_states.windows_of(_C_ib(flown.q_ib[rows]), pushed_b, dt_s)
    along = np.einsum("kii->k", squares)
    across = squares.sum(axis=(1, 2)) - along
    return Pushed(*(float(np.sqrt(one.max() / 3.0)) for one in (along, across)))


def _C_ib(q_ib):
    """(N, 3, 3) of (N, 4), without a kernel that every run would have to load."""
    return np.stack([_axis(q_ib, i) for i in range(3)], axis=-1)


def _axis(q_ib, i):
    """Body axis i in inertial axes, (N, 3)."""
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
    if navigation.software != BUILT_IN:
        return ""  # which takes no notice of them
    by_force = _of_weight(scenario, flown)
    by_force = by_force if by_force[0] else _of_push(scenario, flown)
    found = [one for one in (by_force, _of_turn(scenario, flown), _of_camera(scenario)) if one[0]]
    if not found:
        return ""
    named = {*navigation.states, *(name for missing, _ in found for name in missing)}
    named -= {"gyro_roll_column"} if named & set(WHOLE) else set()
    whole = [name for name in OPTIONAL | state_sizes() if name in named]
    said = [f"{_listed(missing)} {'are' if missing[1:] else 'is'} missing: {why}" for missing, why in found]
    return f"{'; '.join(said)}; write states: [{', '.join(whole)}]"


def _of_weight(scenario, flown):
    """Blocks of errors that weight makes biases, and why: list of names, text."""
    navigation = scenario.navigation
    lasts_s, where = wanted_states.longest_weight(scenario, flown.events, flown.end_s)
    missing = [
        name
        for name, sigma in wanted_states.weight_errors(scenario.imu).items()
        if sigma and name not in navigation.states
    ]
    if not wanted_states.is_bias(scenario, lasts_s):
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


def _of_turn(scenario, flown):
    """Likewise of errors of the gyros, which a spin makes larger than the noise that stands for them."""
    named, gyro = scenario.navigation.states, scenario.imu.gyro
    if flown.turned is None:
        return [], ""
    sigma = np.full((3, 3), gyro.misalignment)
    np.fill_diagonal(sigma, [gyro.scale_factor_roll, gyro.scale_factor, gyro.scale_factor])
    diagonal = np.eye(3, dtype=bool)
    for name, covered in (*zip(WHOLE, (diagonal, ~diagonal), strict=True), ("gyro_roll_column", [[1, 0, 0]])):
        sigma = np.where(np.logical_and(covered, name in named), 0.0, sigma)
    angle = _spun(scenario, flown.turned, sigma)
    if angle == 0.0:
        return [], ""
    across = np.where([[True, False, False]], 0.0, sigma)
    if set(WHOLE) & set(named) or _spun(scenario, flown.turned, across):
        missing = [name for name in WHOLE if name not in named]
    else:
        missing = ["gyro_roll_column"]
    noise = wanted_states.noise(scenario, "gyro_scale")
    times = f", {angle / noise:.3g} times the noise of the gyros" if noise else ""
    return missing, (
        f"{'their errors turn' if missing[1:] else 'its error turns'} the attitude by "
        f"{np.degrees(angle):.2g} deg within {WINDOW_S:g} s of spin{times}; the filter takes it for noise "
        "that grows more slowly, so that its sigmas are wrong"
    )


def _spun(scenario, squares, sigma):
    """Angle, rad, by which errors (3, 3) turn the attitude in the worst window; 0: noise stands for it."""
    of_all = np.einsum("kij,ij->k", squares, sigma**2)
    k, least = int(of_all.argmax()), TURNS * scenario.navigation.manoeuvre_angle
    angle = float(np.sqrt(of_all[k] / 3.0))
    counts = np.sqrt(np.max(squares[k], where=sigma > 0.0, initial=0.0)) > least
    return angle if counts and angle > WARNED * wanted_states.noise(scenario, "gyro_scale") else 0.0


def _of_camera(scenario):
    """Likewise of what turns the star camera."""
    tracker, named = scenario.star_tracker, scenario.navigation.states
    if not tracker.enabled or "mounting" in named:
        return [], ""
    camera = absent.of_camera(settings(scenario.star_camera), scenario.without)
    turn = params_onboard.turn_of(camera)
    one_star = tracker.identification.centroid_error * camera.detector.pixel_size / camera.optics.focal_length
    if turn <= max(one_star, OF_FLOOR * scenario.navigation.star_fix_floor):
        return [], ""
    return ["mounting"], (
        f"the star camera is off by {np.degrees(turn):.3g} deg (1 sigma, of mounting.error and "
        "principal_point_error), and so is every fix; the filter takes fixes for independent, so that its "
        "sigmas are wrong"
    )


def _listed(names):
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if names[1:] else names)


def states_table(effects):
    """rich Table of a list of wanted_states.Effect."""
    title = (
        f"navigation.states: automatic. 1 sigma, in the worst {WINDOW_S:g} s of the planned flight; "
        f"estimated from {SWAMPS:g} times the noise on"
    )
    rows = (
        (one.block, *(_in_unit(size, one.unit) for size in (one.effect, one.noise)), _yes(one.on), one.why)
        for one in effects
    )
    return columns.table(title, HEADS, rows, no_wrap=True)


def _yes(on):
    return "yes" if on else "no"


def _in_unit(value, unit):
    """A figure in its unit, angles in degrees."""
    if math.isnan(value):
        return ""
    return f"{math.degrees(value) if unit == 'deg' else value:.3g} {unit}"
