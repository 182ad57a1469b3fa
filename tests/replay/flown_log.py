"""The log of a short flight: real on-board computer over noisy fixes, truth beside it."""

from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from navigation_flight import C_BC, EARTH, alignment, fly, gps_fix, star_fix, state_at
from unpacked import tick

from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import cross_axes, pinhole
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.thinning import thinned
from shefex_nav.log.topics import Mission, RunSummary
from shefex_nav.log.writer import LogWriter
from shefex_nav.onboard import computer
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigator import Navigator
from shefex_nav.records import Detections, Event, GpsRanges, Phase, StarVectors, TruthSample
from shefex_nav.scenario import load, params_onboard

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"
END_S = 30.0
# the errors of this flight are those that the filter estimates, and white noise
SIMPLE = (
    "imu.vibration.boost=[0 gee, 0 gee]",
    "imu.gyro.g_sensitivity=0 deg/h/gee",
    "imu.gyro.scale_factor=0 ppm",
    "imu.accelerometer.scale_factor=0 ppm",
    "imu.accelerometer.misalignment=0 mrad",
    "navigation.gravity_error=2 ugee",  # what smoothing assumes, so that both are the same filter
    "earth.gravity=j2",
)
NOTHING = Detections(np.empty((0, 2)), np.empty(0), np.empty(0, int), np.empty(0, int), np.empty((0, 2, 2)))


class Options(NamedTuple):
    """What is special about a flight."""

    seed: int = 1
    overrides: tuple = ()  # of the scenario
    rate_hz: float = 100.0  # of truth, IMU and solution in the log
    stars_s: tuple = (22.0, 28.0)  # from, until
    stars_turned: float = 0.0  # rad, of all star fixes about the body's y axis: the camera has been bent
    vectors: bool = True  # the fixes hold their stars by themselves, frames without attitude one star


def mission(scenario, options):
    """Mission of the log; the Earth is that of the flight."""
    return Mission(
        scenario="short_flight",
        scenario_text=scenario.source,
        seed=options.seed,
        version="0.1.0",
        epoch_utc="2012-06-22T19:18:00Z",
        start_s=0.0,
        earth=EARTH,
        launch_latitude=1.2,
        launch_longitude=0.3,
        launch_height=0.0,
        camera=pinhole(659, 493, 2500.0),
        C_bc=C_BC,
    )


def measured(blocks, params, rng):
    """ImuBlocks with errors drawn as the filter expects them: biases, roll column, white noise."""
    gyro_bias = params.sigma_gyro_bias * rng.standard_normal(3)
    accel_bias = params.sigma_accel_bias * rng.standard_normal(3)
    roll_column = params.sigma_blocks["gyro_roll_column"] * rng.standard_normal(3)
    for block in blocks:
        dt, root = block.dt_s, np.sqrt(block.dt_s)
        noise = rng.standard_normal((2, 4, 3))
        yield block._replace(
            dtheta_b=block.dtheta_b
            + block.dtheta_b[:, :1] * roll_column
            + gyro_bias * dt
            + params.imu.gyro_random_walk * root * noise[0],
            dv_b=block.dv_b + accel_bias * dt + params.imu.accel_random_walk * root * noise[1],
        )


def ranges(fix, rng):
    """GpsRanges that belong to a noiseless GpsFix: eight satellites above it, a clock of 100 m and 1 m/s."""
    up = fix.r_ea_e / np.linalg.norm(fix.r_ea_e)
    spread = np.random.default_rng(0).standard_normal((8, 3))
    r_es_e = 26.56e6 * (up + 0.6 * spread) / np.linalg.norm(up + 0.6 * spread, axis=1)[:, None]
    d = r_es_e - fix.r_ea_e
    distance = np.linalg.norm(d, axis=1)
    u, turn = d / distance[:, None], np.array([0.0, 0.0, EARTH.rate])
    v_s = np.cross(turn, r_es_e)  # the satellites stand still over the Earth
    v = v_s - fix.v_ea_e - np.cross(turn, fix.r_ea_e)
    rate = np.sum(u * v, axis=1) / (1.0 + np.sum(u * v_s, axis=1) / 299792458.0)
    return GpsRanges(
        t_valid_s=fix.t_valid_s,
        t_available_s=fix.t_available_s,
        prn=np.arange(1, 9),
        pseudorange=distance + 100.0 + fix.t_valid_s + 1.5 * rng.standard_normal(8),
        range_rate=rate + 1.0 + 0.05 * rng.standard_normal(8),
        r_es_e=r_es_e,
        v_es_e=np.zeros((8, 3)),
        sigma_range=np.full(8, 1.5),
        sigma_range_rate=np.full(8, 0.05),
    )


def fixes(flight, params, options, rng):
    """GPS every second, 0.2 s late; stars at 10 Hz, 0.09 s late, every seventh frame in vain."""
    gps = [gps_fix(*flight, float(t), 0.2, rng) for t in range(1, round(END_S))]
    mounting = params.sigma_blocks["mounting"] * rng.standard_normal(3)
    mounting = mounting + np.array([0.0, options.stars_turned, 0.0])
    stars = []
    for number, t_s in enumerate(np.arange(options.stars_s[0] + 0.013, options.stars_s[1], 0.1)):
        fix = star_fix(*flight, float(t_s), 0.09, rng, wrong_by=mounting)
        fix = fix._replace(number=number, detections=NOTHING, hip=np.empty(0, int))
        unsolved = number % 7 == 3
        if options.vectors:
            sky = np.random.default_rng([options.seed, number])
            fix = fix._replace(stars=stars_seen(flight, fix.t_valid_s, mounting, 1 if unsolved else 8, sky))
        if unsolved:
            fix = fix._replace(reason=2, q_ic=np.full(4, np.nan), P_c=np.full((3, 3), np.nan))
        stars.append(fix)
    return gps, stars


def stars_seen(flight, t_s, mounting, m, rng):
    """StarVectors of m stars anywhere in the field of a camera that is mounted wrong; 20 arcsec of noise."""
    u_c = np.column_stack([rng.uniform(-0.13, 0.13, m), rng.uniform(-0.1, 0.1, m), np.ones(m)])
    u_c /= np.linalg.norm(u_c, axis=1, keepdims=True)
    state, _ = state_at(*flight, t_s)
    C_ic = rotation.dcm_from_quat(state.q_ib) @ rotation.dcm_from_rotvec(mounting) @ C_BC
    sigma = np.radians(20.0 / 3600.0)
    seen_c = u_c + sigma * np.einsum("ki,kij->kj", rng.standard_normal((m, 2)), cross_axes(u_c))
    seen_c /= np.linalg.norm(seen_c, axis=1, keepdims=True)
    P_u = np.tile(sigma**2 * np.eye(2), (m, 1, 1))
    return StarVectors(rng.integers(1, 10**5, m), seen_c, P_u, u_c @ C_ic.T, np.zeros(m), np.zeros((3, 3)))


def records(options):
    """Mission, then an iterator of the records, as a run gives them."""
    scenario = load.load(SCENARIO, (*SIMPLE, *options.overrides))
    return mission(scenario, options), _fly(params_onboard.nav_params(scenario), fly(END_S), options)


def _fly(params, flight, options):
    rng = np.random.default_rng(options.seed)
    start = alignment(flight[1][0], rng)
    gps, stars = fixes(flight, params, options, rng)
    nav = fusion.start(params, start, EARTH)
    settings = SimpleNamespace(enabled=False, on=0.0, off=0.0)
    off = SimpleNamespace(settings=settings, earth_velocity_i=np.zeros(3))
    switched_off = computer.ComputerParams(params, off, np.zeros(3))
    onboard = computer.Computer(switched_off, Navigator(nav), None)
    onboard.waiting = tuple(stars)
    noise = np.random.default_rng(options.seed + 100)
    yield start
    for block, state in zip(measured(flight[0], params, rng), flight[1][1:], strict=True):
        now_s = block.t_valid_s
        if now_s in (20.0, END_S):
            yield Event(now_s, "burn_out_1" if now_s == 20.0 else "impact", 1e5, "")
        phase = Phase.BOOST if now_s < 20.0 else Phase.POINTING
        yield TruthSample(now_s, int(phase), state.r_i, state.v_i, state.q_ib, np.zeros(3), np.zeros(3), 0.0)
        yield block
        due = [fix for fix in gps if now_s - 0.01 + 1e-6 < fix.t_available_s <= now_s + 1e-6]
        due += [
            ranges(gps_fix(*flight, fix.t_valid_s, fix.t_available_s - fix.t_valid_s), noise) for fix in due
        ]
        yield from due
        yield from (fix for fix in stars if now_s - 0.01 < fix.t_available_s - 0.05 <= now_s)
        yield from tick(onboard, block, due)


def write(path, options=None):
    """Write the log of a flight. -> path"""
    options = options or Options()
    head, stream = records(options)
    with LogWriter(path, head, FramePolicy(0, "none", 4.0)) as log:
        for record in thinned(stream, options.rate_hz, head.start_s):
            log.write(record)
        log.write(RunSummary(END_S, 1.0, 0.0))
    return path
