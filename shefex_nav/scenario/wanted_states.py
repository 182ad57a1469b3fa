"""Which errors of the IMU the filter has to estimate: a rule from the data sheets and the planned flight.

The filter takes an error that goes with rate or specific force for noise unless a block of its states carries
it. Where the flight turns or pushes long enough, such an error is no noise: it moves attitude or velocity by
many times what noise does, always the same way. So for each block: by how much does its error, one standard
deviation on each element, move attitude or velocity within `WINDOW_S` of the planned flight, at the worst?

    moved(t) = int_t^{t + WINDOW_S} C_ib E(omega, f) dt,        E linear in the elements of the block

and rms over the elements and the inertial axes. Against it stands what noise makes of the same time: of the
gyros the angular random walk, sigma sqrt(WINDOW_S); of the change of velocity what a line through the N
velocities of that time leaves open, sigma sqrt(12/N), or a parabola through the positions, sigma
sqrt(720/N)/WINDOW_S. A block whose error is `SWAMPS` times that is estimated; so is one whose error weight
makes a bias, for minutes. Beside `gyro_scale` the misalignment of the gyros is estimated where its
error exceeds the noise at all: spin makes it an error that is fixed to the body, as large as the misalignment
itself, and no noise of the filter stands for that.

Errors in proportion to specific force are noise to the filter unless their block is on, noise that keeps its
sign for `navigation.thrust_memory`: thrust ends soon. Weight does not. On the ground, on the launch pad and
under a parachute these errors are biases.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import sample_s
from shefex_nav.onboard.navigation.blocks import ANGLE, DURATION, SPEED, STATES
from shefex_nav.scenario import aboard, params_onboard

# Memories that weight may last. After a time t an error s that stays has grown to s^2 t^2, noise with the
# memory tau to 2 s^2 tau t: as much at 2 tau, the burn for which tau is chosen, two thirds of it at 3 tau.
MEMORIES = 3.0
WINDOW_S = 60.0  # [E] three times the filter's memory of thrust: an error that lasts longer is no noise
SWAMPS = 3.0  # [E] times the noise
STEP_HZ = 100.0  # of the samples that are summed up, if they are not too many
MOST = 200_000  # samples
DILUTION = 2.0  # [E] of a fix, each axis, by satellites all around

GYROS = ("gyro_roll_column", "gyro_scale", "gyro_misalignment")  # the first is a part of the others


@dataclass(frozen=True)
class Motion:
    """A flight as the IMU senses it: K samples, dt_s apart."""

    dt_s: float
    C_ib: np.ndarray  # (K, 3, 3)
    omega_b: np.ndarray  # (K, 3) rad/s
    f_b: np.ndarray  # (K, 3) m/s^2
    burning: np.ndarray  # (K,) int, stage whose motor burns, from 1; 0: none

    @cached_property
    def rate_windows(self):
        """`_windows` of errors that go with rates: large, and the same for every IMU that flies it."""
        return windows_of(self.C_ib, self.omega_b, self.dt_s)

    @cached_property
    def force_windows(self):
        """The same of errors that go with specific force."""
        return windows_of(self.C_ib, self.f_b, self.dt_s)


class Effect(NamedTuple):
    """What the errors of one block do to the planned flight."""

    block: str  # of onboard.navigation.blocks.OPTIONAL
    on: bool
    effect: float  # rad, m/s or m, rms of an axis, in the worst WINDOW_S; NaN: not looked at
    noise: float  # of the sensor that sees it, in the same unit
    unit: str  # deg, m/s or m
    why: str  # for people


def motion(trajectory):
    """Motion of a Trajectory."""
    from scipy.spatial.transform import Rotation

    rows, dt_s = thinned(trajectory.t_s, STEP_HZ)
    C_ib = Rotation.from_quat(trajectory.q_ib[rows][:, [1, 2, 3, 0]]).as_matrix()
    return Motion(dt_s, C_ib, trajectory.omega_ib_b[rows], trajectory.f_b[rows], trajectory.burning[rows])


def thinned(t_s, step_hz):
    """Samples of t_s (N,) at about step_hz, `MOST` at most: slice, s from one to the next."""
    dt_s = sample_s(t_s)
    every = max(1, round(1.0 / (step_hz * dt_s)), math.ceil(len(t_s) / MOST))
    return slice(0, None, every), every * dt_s


def windows_of(C_ib, felt_b, dt_s):
    """`_windows` of errors that multiply felt_b. (K, 3, 3), (K, 3), s -> (n, 3, 3)"""
    return _windows(_responses(C_ib, felt_b, dt_s), dt_s)


def effects(scenario, moved, events, end_s):
    """What the errors of each block do, and whether it is estimated.

    Parameters
    ----------
    scenario : Scenario as the computer is told
    moved : Motion of the planned flight
    events : sequence of its Event
    end_s : of the flight

    Returns
    -------
    list of Effect
    """
    sigmas = _sigmas(params_onboard.beforehand(scenario))
    sizes = {
        name: _worst(moved.rate_windows if by_rate else moved.force_windows, sigma)
        for name, (by_rate, sigma) in sigmas.items()
    }
    (_, roll), *both = (sigmas[name] for name in GYROS)
    across = [_worst(moved.rate_windows, np.where(roll, 0.0, sigma)) for _, sigma in both]
    sizes["accel_rectification"] = _rectified(scenario, moved)
    sizes["gravity"] = scenario.navigation.gravity_error * WINDOW_S
    noises = {name: noise(scenario, name) for name in sizes}
    on = {name for name in sizes if sizes[name] > SWAMPS * noises[name]}
    if max(across) > SWAMPS * noises["gyro_scale"]:  # turns about the other axes count, too
        on.discard("gyro_roll_column")
        if sizes["gyro_misalignment"] > noises["gyro_misalignment"]:
            on.add("gyro_misalignment")  # no noise stands for what it makes of the roll rate
    else:
        on -= {"gyro_scale", "gyro_misalignment"}
    why = {name: _words(name, sizes[name], noises[name], on) for name in sizes}
    lasts_s, where = longest_weight(scenario, events, end_s)
    for name, sigma in weight_errors(scenario.imu).items():
        if sigma and name not in on and is_bias(scenario, lasts_s):
            on.add(name)
            why[name] = f"{where} for {lasts_s:.0f} s: a bias"
    found = [Effect(name, name in on, sizes[name], noises[name], _unit(name), why[name]) for name in sizes]
    return found + _of_others(scenario)


def _sigmas(told):
    """{block: (whether it goes with rates, (3, 3) sigma of what axis i sees per unit along j)} of the IMU.

    told : Beforehand
    """
    out = {}
    for state in STATES:
        if state.drives and state.drives[0].weight != DURATION:
            by_rate = state.drives[0].weight < SPEED
            sigma, first = np.zeros((3, 3)), ANGLE if by_rate else SPEED
            for drive, value in zip(state.drives, state.known(told), strict=True):
                sigma[drive.axis, drive.weight - first] = value
            out[state.name] = by_rate, sigma
    return out


def _responses(C_ib, felt_b, dt_s):
    """What an element ij of a matrix that multiplies `felt_b` has moved by each sample: (K + 1, 3, 3, 3).

    Element [k, i, j] is the integral of C_ib[:, i] felt_b[j] over the first k samples, inertial axes.
    """
    each = np.einsum("kai,kj->kija", C_ib, felt_b) * dt_s
    return np.concatenate([np.zeros((1, 3, 3, 3)), np.cumsum(each, axis=0)])


def _windows(responses, dt_s):
    """Squares of what the elements have moved within each window: (K + 1, i, j, axis), s -> (n, i, j)."""
    steps = min(round(WINDOW_S / dt_s), len(responses) - 1)
    return ((responses[steps:] - responses[: len(responses) - steps]) ** 2).sum(axis=-1)


def _worst(windows, sigma):
    """Largest rms of an inertial axis within any of `_windows`, of elements (i, j) with these sigmas."""
    square = np.einsum("kij,ij->k", windows, sigma**2)
    return float(np.sqrt(square.max() / 3.0))


def _rectified(scenario, moved):
    """Velocity that the bias under vibration makes, m/s, rms of an axis in the worst window."""
    vibration = scenario.imu.vibration
    level = np.array([vibration.coast, *vibration.boost])[moved.burning] ** 2
    each = np.einsum("kai,k->kia", moved.C_ib, level) * moved.dt_s
    grown = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(each, axis=0)])
    sigma = scenario.imu.accelerometer.vibration_rectification
    return _worst(_windows(grown[:, :, None, :], moved.dt_s), np.full((3, 1), sigma))


def noise(scenario, block):
    """What noise makes in a window: rad of gyros, m/s of accelerometers. block : its name"""
    if block.startswith("gyro"):
        walk = scenario.navigation.sensors.gyro_random_walk or scenario.imu.gyro.random_walk
        return walk * np.sqrt(WINDOW_S)
    gps, fixes = scenario.gps, WINDOW_S * scenario.gps.rate
    by_positions = DILUTION * gps.range_noise * np.sqrt(720.0 / fixes) / WINDOW_S
    if gps.fix != "full":
        return by_positions
    return min(by_positions, DILUTION * gps.range_rate_noise * np.sqrt(12.0 / fixes))


def _words(block, size, noise, on):
    """Why a block is estimated or not; `on` : all that are."""
    if size > SWAMPS * noise and block not in on:
        names = [name for name in GYROS if name in on]
        return f"{' and '.join(names)} {'stands' if len(names) == 1 else 'stand'} for it"
    return f"{size / noise:.3g} times the noise" if noise else "there is no noise"


def _unit(block):
    return "deg" if block.startswith("gyro") else "m/s"


def _of_others(scenario):
    """Effect of blocks that are not the IMU's."""
    tracker, camera = scenario.star_tracker, scenario.star_camera
    one_star = tracker.identification.centroid_error * camera.detector.pixel_size / camera.optics.focal_length
    turn = params_onboard.camera_turn(scenario)
    words = "constant, no number of fixes averages it out" if tracker.enabled else "no star tracker"
    found = [Effect("mounting", tracker.enabled and turn > 0.0, turn, one_star, "deg", words)]
    if scenario.navigation.gps == "tight":
        found.append(Effect("clock", True, np.nan, np.nan, "m", "ranges need it"))
        if scenario.gps.errors.model_dump(exclude_none=True):
            found.append(
                Effect("range_bias", True, np.nan, np.nan, "m", "the errors of ranges last (gps.errors)")
            )
    for instrument, _, _ in aboard.used(scenario):
        for block in instrument.states:
            found.append(Effect(block.name, True, np.nan, np.nan, block.unit, block.why))
    for state, known in aboard.own_states(scenario):
        words = f"navigation.{state.name} is given" if known else f"there is no navigation.{state.name}"
        found.append(Effect(state.name, known is not None, np.nan, np.nan, state.unit, words))
    return found


def weight_errors(imu):
    """Blocks of the errors that go with specific force, and how large these are in the IMU of a scenario."""
    return {
        "gyro_g_sensitivity": imu.gyro.g_sensitivity,
        "accel_scale": imu.accelerometer.scale_factor,
        "accel_misalignment": imu.accelerometer.misalignment,
    }


def longest_weight(scenario, events, end_s):
    """For how long weight lasts, as far as the flight was seen, and where: (s, text)."""
    return max(_times(scenario, {event.name: event.t_s for event in events}, end_s), default=(0.0, ""))


def is_bias(scenario, lasts_s):
    """Whether weight that lasts so long makes biases of the errors."""
    return lasts_s > MEMORIES * scenario.navigation.thrust_memory


def _times(scenario, at, end_s):
    """Each time that weight acts: (s, where). at : {event: s}"""
    start_s = scenario.mission.start
    if scenario.ground is not None:
        yield end_s - start_s, "the vehicle stands on the ground"
    if scenario.launch is not None or (scenario.trajectory is not None and "lift_off" in at):
        yield at.get("lift_off", min(end_s, 0.0)) - start_s, "the vehicle stands on the pad"
    if "parachute" in at:
        yield at.get("impact", end_s) - at["parachute"], "the vehicle hangs on its parachute"
