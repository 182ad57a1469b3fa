"""The route: scenario -> world -> on-board computer -> records.

This is the only place where the world and the flight software meet. `run` is an iterator of the records of
`records`, in the order in which things happen; whoever calls it writes them, keeps them or counts them.
"""

import time
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__
from shefex_nav.environment import ephemeris, gnss, stars
from shefex_nav.log.topics import Mission
from shefex_nav.onboard import computer as onboard
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.records import Alignment, CameraCommand, ComputeTime, TruthSample
from shefex_nav.scenario import params, params_onboard
from shefex_nav.world import camera, gps, imu, noise, pad
from shefex_nav.world.camera.shutter import Shutter
from shefex_nav.world.flight import fly

TICKS_PER_S = 100  # of the on-board clock
SAMPLES_PER_TICK = 4  # of the IMU
EARLY_S = 1e-6  # rounding of the times of ticks


class World(NamedTuple):
    """Everything that is settled before the first tick: the flight, and what the sensors will say of it."""

    earth: object  # EarthRotation
    catalogue: object  # StarCatalogue at the epoch of its data
    trajectory: object  # Trajectory
    events: tuple
    alignment: Alignment
    imu: object  # ImuData
    gps_fixes: list
    camera: camera.Camera
    computer: onboard.ComputerParams


def mission(scenario, seed):
    """Who, when and where, for the head of a log. Scenario, int -> Mission."""
    return Mission(
        scenario=scenario.mission.name,
        scenario_text=scenario.source,
        seed=seed,
        version=__version__,
        epoch_utc=scenario.mission.epoch,
        start_s=scenario.mission.start,
        earth=earth_rotation(scenario),
        launch_latitude=scenario.launch.latitude,
        launch_longitude=scenario.launch.longitude,
        launch_height=scenario.launch.height,
        camera=params_onboard.nominal_camera(scenario),
        C_bc=params.mounting(scenario),
    )


def earth_rotation(scenario):
    """EarthRotation of the scenario's epoch and pinned Earth orientation."""
    earth = scenario.earth
    return ephemeris.earth_rotation(scenario.mission.epoch, earth.ut1_minus_utc, earth.pole_x, earth.pole_y)


def build_world(scenario, seed):
    """Fly the vehicle and let the sensors measure it. Scenario, int -> World."""

    def rng(stream):
        return noise.generator(seed, stream)

    epoch = scenario.mission.epoch
    earth, bodies = earth_rotation(scenario), ephemeris.sky_bodies(epoch)
    catalogue = stars.load_catalogue(8.0)
    at_epoch = stars.at_epoch(catalogue, ephemeris.julian_year(epoch))
    trajectory, events = fly.fly(params.flight_params(scenario), earth)
    true_camera = camera.init(params.camera_params(scenario), at_epoch, bodies, earth, rng("camera_errors"))
    return World(
        earth=earth,
        catalogue=catalogue,
        trajectory=trajectory,
        events=events,
        alignment=pad.align(params.pad_params(scenario), trajectory, earth, rng("pad")),
        imu=imu.measure(params.imu_params(scenario), trajectory, rng("imu")),
        gps_fixes=gps.measure(
            params.gps_params(scenario), trajectory, events, earth, gnss.nominal_24(epoch), rng("gps")
        ),
        camera=true_camera,
        computer=params_onboard.computer_params(scenario, bodies, true_camera.bad_pixel_map),
    )


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
    yield from route(build_world(scenario, seed), scenario, seed)


def route(world, scenario, seed, *, until_s=np.inf):
    """Tick by tick through a world that has been built; as `run`, until the mission time until_s at most."""
    yield world.alignment
    epoch_year = ephemeris.julian_year(scenario.mission.epoch)
    computer = onboard.start(world.computer, world.alignment, world.earth, world.catalogue, epoch_year)
    shutter = Shutter(
        world.camera,
        world.trajectory,
        every=round(TICKS_PER_S / scenario.star_tracker.rate),
        off_s=scenario.star_tracker.off,
        rng=noise.generator(seed, "camera_noise"),
    )
    fixes, events = list(world.gps_fixes)[::-1], list(world.events)[::-1]
    for n, block in enumerate(imu.blocks(world.imu), 1):
        now_s = block.t_valid_s
        if now_s > until_s + EARLY_S:
            return
        while events and events[-1].t_s <= now_s + EARLY_S:
            yield events.pop()
        yield truth_sample(world.trajectory, n * SAMPLES_PER_TICK)
        yield block
        arrived = due(fixes, now_s)
        pictures = shutter.arrived(now_s)
        for _, truth in pictures:
            yield truth
        yield from arrived
        frames = [frame for frame, _ in pictures]
        yield from frames
        clock = Stopwatch(star_tracker.step)
        computer, outputs = onboard.tick(computer, block, arrived, frames, chain=clock.step)
        yield from outputs
        for frame, duration_s in zip(frames, clock.durations_s, strict=True):
            yield ComputeTime(now_s, frame.number, duration_s)
        shutter.tick(n, now_s, [record for record in outputs if isinstance(record, CameraCommand)])
    yield from reversed(events)  # the impact, between the last tick and the one that did not come


def warm_up(scenario):
    """Compile or load every kernel of the route, so that a run is not measured with its compiler."""
    world = build_world(scenario, seed=0)
    for _ in route(world, scenario, 0, until_s=scenario.mission.start + 1.5):
        pass
    epoch_year = ephemeris.julian_year(scenario.mission.epoch)
    tracker = star_tracker.init(world.computer.tracker, world.catalogue, epoch_year)
    state, command = star_tracker.start(tracker, scenario.programme.pointing_start)
    picture, _ = camera.expose(
        world.camera, command, world.trajectory, 0, command.t_s, noise.generator(0, "camera_noise")
    )
    star_tracker.step(tracker, state, picture, star_tracker.NO_CONTEXT)


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
    )


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
