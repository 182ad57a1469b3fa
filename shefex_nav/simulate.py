"""The route: scenario -> world -> on-board computer -> records.

This is the only place where the world and the flight software meet. `run` is an iterator of the records of
`records`, in the order in which things happen; whoever calls it writes them, keeps them or counts them.
"""

import time

import numpy as np

from shefex_nav import prepare, statistical
from shefex_nav.environment import ephemeris
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.onboard import computer as onboard
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.records import CameraCommand, ComputeTime, ControlSample, TruthSample
from shefex_nav.world import camera, faults, imu, noise
from shefex_nav.world.camera.shutter import Shutter

TICKS_PER_S = 100  # of the on-board clock
SAMPLES_PER_TICK = 4  # of the IMU
CONTROL_TICKS = 10  # between two records of the attitude control
EARLY_S = 1e-6  # rounding of the times of ticks


def run(scenario, seed):
    """Fly a scenario once.

    Parameters
    ----------
    scenario : Scenario
    seed : int

    Yields
    ------
    records in order of time; all but the measured durations (ComputeTime) depends on scenario and seed alone
    """
    yield from route(prepare.build_world(scenario, seed), scenario, seed)


def route(world, scenario, seed, *, until_s=np.inf, step=star_tracker.step, every=1):
    """Tick by tick through a world that has been built; as `run`, until the mission time until_s at most.

    step : `star_tracker.step`, or something that wraps it to see what it is given
    every : ticks from one record of truth, IMU and solution to the next; nothing else changes with it
    """
    yield world.alignment
    trajectory, events = world.flight.trajectory, list(world.flight.events)[::-1]
    epoch_year = ephemeris.julian_year(scenario.mission.epoch)
    computer = onboard.start(world.computer, world.alignment, world.earth, world.catalogue, epoch_year)
    line = faults.StarLine(world.faults.stars, noise.generator(seed, "faults"))
    sight, shutter, context = _star_camera(world, scenario, seed, computer, line)
    received = sorted(world.gps_fixes + world.gps_ranges, key=lambda m: m.t_available_s, reverse=True)
    steered = control_samples(world.flight.control, trajectory)[::-1]
    for n, block in enumerate(imu.blocks(world.imu), 1):
        now_s = block.t_valid_s
        if now_s > until_s + EARLY_S:
            return
        while events and events[-1].t_s <= now_s + EARLY_S:
            yield events.pop()
        told = n % every == 0
        if told:
            yield truth_sample(trajectory, n * SAMPLES_PER_TICK)
        while steered and steered[-1].t_s <= now_s + EARLY_S:
            yield steered.pop()
        if told:
            yield block
        arrived = due(received, now_s)
        pictures = shutter.arrived(now_s)
        for _, truth in pictures:
            yield truth
        yield from arrived
        frames = [line.picture(frame) for frame, _ in pictures]
        if not sight:
            yield from frames
        clock = Stopwatch(sight.step if sight else step)
        chain = line.chain(clock.step)
        computer, outputs = onboard.tick(
            computer, block, arrived, frames, chain=chain, context=context, told=told
        )
        yield from outputs
        for frame, duration_s in zip(frames if not sight else (), clock.durations_s, strict=not sight):
            yield ComputeTime(now_s, frame.number, duration_s)
        shutter.tick(n, now_s, [record for record in outputs if isinstance(record, CameraCommand)])
    yield from reversed(events)  # the impact, between the last tick and the one that did not come


def _star_camera(world, scenario, seed, computer, line):
    """What stands for pictures if there are none, or None; the Shutter; what tells the chain of a frame."""
    sight = None
    if statistical.is_wanted(scenario):
        sight = statistical.Statistical(scenario, world, computer.tracker, seed, line)
    shutter = Shutter(
        world.camera,
        world.flight.trajectory,
        every=round(TICKS_PER_S / scenario.star_tracker.rate),
        off_s=scenario.star_tracker.off,
        rng=noise.generator(seed, "camera_noise"),
        take=sight.expose if sight else camera.expose,
    )
    brief = sight and not world.computer.tracker.vectors  # single stars are found by the prediction
    return sight, shutter, onboard.brief_context if brief else onboard.star_context


def warm_up(scenario):
    """Compile or load every kernel of the route, so that a run is not measured with its compiler."""
    world = prepare.build_world(scenario, seed=0, brief=True)
    for _ in route(world, scenario, 0, until_s=scenario.mission.start + 1.5):
        pass
    epoch_year = ephemeris.julian_year(scenario.mission.epoch)
    tracker = star_tracker.init(world.computer.tracker, world.catalogue, epoch_year)
    state, command = star_tracker.start(tracker, scenario.mission.start)
    trajectory = looking_up(world.flight.trajectory, world.camera)
    rng = noise.generator(0, "camera_noise")
    picture, truth = camera.expose(world.camera, command, trajectory, 0, command.t_s, rng)
    at_rest = star_tracker.NO_CONTEXT._replace(omega_c=np.zeros(3), P_omega_c=1e-12 * np.eye(3))
    predicted = at_rest._replace(q_ic=truth.q_ic, P_c=1e-8 * np.eye(3))
    for context in (star_tracker.NO_CONTEXT, at_rest, predicted):  # every way to search a frame
        state, _, _ = star_tracker.step(tracker, state, picture, context)
        picture = picture._replace(t_valid_s=picture.t_valid_s + picture.exposure_s)


def looking_up(trajectory, camera):
    """The first second of a trajectory with the star camera held away from Earth and Sun. -> Trajectory"""
    brief = trajectory._make(np.ascontiguousarray(column[:400]) for column in trajectory)
    up_i, sun_i = brief.r_i[0] / np.linalg.norm(brief.r_i[0]), camera.bodies.sun_u_i
    z_i = up_i - max(0.0, up_i @ sun_i) * sun_i
    z_i = z_i / np.linalg.norm(z_i)
    x_i = wgs84.perpendicular(z_i)
    C_ic = np.column_stack([x_i, np.cross(z_i, x_i), z_i])
    q_ib = rotation.quat_from_dcm(C_ic @ camera.params.C_bc.T)
    n = len(brief.t_s)
    return brief._replace(q_ib=np.tile(q_ib, (n, 1)), omega_ib_b=np.zeros((n, 3)))


def due(waiting, now_s):
    """Take what is available by now from a list in reverse order of time."""
    arrived = []
    while waiting and waiting[-1].t_available_s <= now_s + EARLY_S:
        arrived.append(waiting.pop())
    return arrived


def truth_sample(trajectory, k):
    """TruthSample of the trajectory's sample k."""
    return TruthSample(
        float(trajectory.t_s[k]),
        int(trajectory.phase[k]),
        trajectory.r_i[k],
        trajectory.v_i[k],
        trajectory.q_ib[k],
        trajectory.omega_ib_b[k],
        trajectory.f_b[k],
        float(trajectory.angle_of_attack[k]),
    )


def control_samples(control, trajectory):
    """A ControlSample for every tenth tick that has a new one: the last. ControlHistory or None -> list."""
    if control is None or not len(control.t_s):
        return []
    period_s = CONTROL_TICKS / TICKS_PER_S
    slot = np.ceil((control.t_s - trajectory.t_s[0]) / period_s - EARLY_S)
    last = np.flatnonzero(np.diff(slot, append=np.inf))  # of each interval
    return [
        ControlSample(
            float(control.t_s[k]),
            control.pointing_error[k],
            control.torque_b[k],
            float(control.propellant_kg[k]),
        )
        for k in last
    ]


class Stopwatch:
    """Runs a function and keeps how long each call took."""

    def __init__(self, function):
        self.function = function
        self.durations_s = []

    def step(self, *arguments):
        """Call the function and time it."""
        begin = time.perf_counter()
        result = self.function(*arguments)
        self.durations_s.append(time.perf_counter() - begin)
        return result
