"""Time to render a frame of the star camera, by camera, shutter and rate.

Two cameras: that of SHEFEX-2 (659 x 493, 8 bits, exposures of 50 ms, stars to V 7, with all else that the
default mission puts into a frame; `camera.expose`) and that of the paper of the Improved Multi-Poles
(1024 x 1024, exposures of 0.2 s, stars to V 6.5; 12 bits of 16 electrons; `stills.still`), each with a global
and with a rolling shutter, turning across and a little about the boresight. Several attitudes, many frames
each. Medians over all frames by the clock and of the time on the processor, which differ where other work
runs beside it; and the fastest.

    uv run python benchmarks/rendering.py [--frames 200] [--seed 1]
"""

import argparse
import sys
import time

import numpy as np

from shefex_nav.environment import ephemeris, stars
from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.geometry.shutter import row_times
from shefex_nav.papers.stills import StillCamera, electrons, still
from shefex_nav.records import CameraCommand, Trajectory
from shefex_nav.scenario import load
from shefex_nav.scenario.of_settings import settings
from shefex_nav.settings import changed
from shefex_nav.world import camera
from shefex_nav.world.camera.detector import Electronics

RATES = 0.0, 2.0, 5.0  # deg/s
ATTITUDES = 5
AXIS = np.array([0.6, 0.78, 0.17])  # of the rotation, in camera axes
DEG = np.pi / 180.0
CENTRE_M = 6.56e6  # from the centre of the Earth


def mission_camera(line_s):
    """Camera of the default mission."""
    scenario = load.load("scenarios/shefex2_andoya.yaml")
    epoch = scenario.mission.epoch
    catalogue = stars.at_epoch(stars.load_catalogue(8.0), ephemeris.julian_year(epoch))
    earth = ephemeris.earth_rotation(epoch, scenario.earth.ut1_minus_utc, 0.0, 0.0)
    chosen = changed(
        settings(scenario.star_camera),
        {"detector.shutter": "rolling" if line_s else "global", "detector.line_time": line_s},
    )
    return camera.init(chosen, catalogue, ephemeris.sky_bodies(epoch), earth, np.random.default_rng(1))


def turning(device, omega_c, rng):
    """Half a second 180 km above the Earth with the boresight up and away from the Sun."""
    sun_i = device.bodies.sun_u_i
    z_i = -sun_i + 0.5 * rng.standard_normal(3)
    z_i /= np.linalg.norm(z_i)
    x_i = np.cross(z_i, rng.standard_normal(3))
    x_i /= np.linalg.norm(x_i)
    C_ic = np.column_stack([x_i, np.cross(z_i, x_i), z_i])
    omega_b = device.settings.mounting.C_bc @ omega_c
    n = 201
    t_s = np.arange(n) / 400.0
    q_ib = rotation.quat_from_dcm(C_ic @ device.settings.mounting.C_bc.T)
    q = [rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(omega_b * t)) for t in t_s]
    zero, none = np.zeros((n, 3)), np.zeros(n)
    return Trajectory(
        t_s,
        np.zeros(n, np.int8),
        np.tile(CENTRE_M * z_i, (n, 1)),
        zero,
        np.array(q),
        np.tile(omega_b, (n, 1)),
        *(zero,) * 3,
        *(none,) * 4,
        np.zeros(n, np.int8),
        none,
    )


def mission_frames(line_s, rate, frames, rng):
    """Seconds of each frame, by the clock and on the processor: (frames, 2)."""
    device, command = mission_camera(line_s), CameraCommand(0.0, 0.05, 24.0)
    seconds = []
    for _ in range(ATTITUDES):
        trajectory = turning(device, rate * DEG * AXIS, rng)
        seconds += timed(lambda: camera.expose(device, command, trajectory, 0, 0.1, rng), frames // ATTITUDES)  # noqa: B023
    return np.array(seconds)


def impa_camera(line_s):
    """Camera of the paper, tables 1 and 2: 18 um, 52 mm, 0.2 s, 7.3e6 electrons/s from magnitude 0."""
    return StillCamera(
        pinhole(1024, 1024, 52e-3 / 18e-6),
        1.1,
        Electronics(50.0, 65e3, 16.0, 32.0, 12),
        6100.0,  # electrons: 100 of dark current, 6000 of stray light
        7.3e6 * 0.2,
        row_times(0.2, line_s, 1024),
    )


def impa_frames(line_s, rate, frames, rng):
    """Seconds of each frame, by the clock and on the processor: (frames, 2)."""
    device, catalogue = impa_camera(line_s), stars.load_catalogue(6.5)
    light, seconds = electrons(device, catalogue.vmag), []
    for _ in range(ATTITUDES):
        q_ic = rotation.quat_normalise(rng.standard_normal(4))
        omega_c = rate * DEG * AXIS if rate else None
        seconds += timed(
            lambda: still(device, catalogue.u_i, light, q_ic, rng, omega_c=omega_c),  # noqa: B023
            frames // ATTITUDES,
        )
    return np.array(seconds)


def timed(work, n):
    """Seconds of n runs by the clock and on the processor, after two that compile and warm up: [(s, s)]."""
    seconds = []
    for _ in range(n + 2):
        begin, begin_cpu = time.perf_counter(), time.process_time()
        work()
        seconds.append((time.perf_counter() - begin, time.process_time() - begin_cpu))
    return seconds[2:]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if arguments.frames < ATTITUDES:
        parser.error(f"--frames is {arguments.frames}; {ATTITUDES} are the fewest, one of each attitude")
    rng = np.random.default_rng(arguments.seed)
    cases = (
        ("SHEFEX-2, 659 x 493, 8 bits", mission_frames, 0.05 / 493),
        ("IMPA, 1024 x 1024, 12 bits", impa_frames, 0.2 / 1024),
    )
    print("| camera | shutter | rate [deg/s] | median [ms] | on the processor [ms] | fastest [ms] |")
    print("|---|---|---|---|---|---|")
    for name, frames_of, line_s in cases:
        for shutter, line in (("global", 0.0), ("rolling", line_s)):
            for rate in RATES:
                ms = 1e3 * frames_of(line, rate, arguments.frames, rng)
                (clock, processor), fastest = np.median(ms, axis=0), ms[:, 0].min()
                print(f"| {name} | {shutter} | {rate:g} | {clock:.2f} | {processor:.2f} | {fastest:.2f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
