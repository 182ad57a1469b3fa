"""A made-up mission with the shape of the real one, for the tests of log and report.

A ballistic arc on a uniformly turning Earth, a spinning then pointing body, estimates that are the truth plus
errors drawn from the covariance that is logged with them: whoever reads it knows what must come out.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav import records as rec
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.geometry.frames import EarthRotation, ecef_from_inertial, inertial_from_ecef
from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.instruments.barometer import BarometerReading
from shefex_nav.instruments.magnetometer import MagnetometerReading
from shefex_nav.instruments.sun_sensor import SunReading
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.topics import Mission, RunSummary

SIGMA_R, SIGMA_V, SIGMA_THETA = 4.0, 0.05, 4e-4  # m, m/s, rad: of every axis of the made-up navigation
STAR_SIGMA_C = np.array([5e-5, 5e-5, 5e-4])  # rad
C_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
PHASES = (  # start s, phase
    (-10.0, rec.Phase.PAD),
    (0.0, rec.Phase.BOOST),
    (56.0, rec.Phase.COAST),
    (65.0, rec.Phase.MANOEUVRE),
    (149.2, rec.Phase.BOOST),
    (217.2, rec.Phase.MANOEUVRE),
    (250.0, rec.Phase.POINTING),
    (372.0, rec.Phase.MANOEUVRE),
    (394.0, rec.Phase.DESCENT),
)
SLOW_S = 235.0, 384.0  # between them the body turns at 1 deg/s, before and after at 1.5 Hz
CONTROLLED_S = 65.0, 394.0  # the attitude is controlled
POINTING_ERROR = np.radians([0.3, -0.4, 1.2])  # about x, y, z while pointing; twice that before and after
GAS_RATE = 0.01  # kg/s


class Options(NamedTuple):
    """What of the mission is made up; the default is all of it."""

    start_s: float = -10.0
    end_s: float = 495.0
    tracker_on_s: float = 222.0
    tracker_off_s: float = 394.0
    frame_pixels: bool = True
    seed: int = 1


DEFAULT = Options()
NO_PIXELS = FramePolicy(full_every=0, otherwise="none", threshold_sigma=4.0)
THRESHOLDED = FramePolicy(full_every=0, otherwise="thresholded", threshold_sigma=4.0)


def mission(seed=1, start_s=-10.0):
    """The constants of the made-up mission."""
    return Mission(
        scenario="made_up",
        scenario_text="name: made_up  # ✓ not only ASCII\n",
        seed=seed,
        version="0.1.0",
        epoch_utc="2012-06-22T19:18:00Z",
        start_s=start_s,
        earth=EarthRotation(np.eye(3), np.eye(3), 1.2, 7.292115e-5),
        launch_latitude=math.radians(69.2942),
        launch_longitude=math.radians(16.0190),
        launch_height=10.0,
        camera=pinhole(659, 493, 2500.0),
        C_bc=C_BC,
    )


def phase_at(t_s):
    return [int(phase) for start, phase in PHASES if start <= t_s][-1]


def _position_l(t_s):
    """East, north, up position and velocity: 800 km north-west, 177 km high, 495 s after lift-off."""
    if t_s <= 0.0:
        return np.zeros(3), np.zeros(3)
    end, height = 495.0, 177e3
    s = t_s / end
    drop = 790e3**2 / 2 / wgs84.A  # the Earth falls away under the launch site's horizon
    r = np.array([-110e3 * s, 790e3 * s, 4 * height * s * (1 - s) - drop * s * s])
    v = np.array([-110e3, 790e3, 4 * height * (1 - 2 * s) - 2 * drop * s]) / end
    return r, v


def truth_at(mission, t_s):
    C_el = wgs84.dcm_el(mission.launch_latitude, mission.launch_longitude)
    r_l, v_l = _position_l(t_s)
    base_e = wgs84.ecef_from_geodetic(
        mission.launch_latitude, mission.launch_longitude, mission.launch_height
    )
    r_i, v_i = inertial_from_ecef(mission.earth, t_s, base_e + C_el @ r_l, C_el @ v_l)
    phase = phase_at(t_s)
    is_slow = SLOW_S[0] <= t_s < SLOW_S[1]
    roll_rate = 0.0 if phase == rec.Phase.PAD else np.radians(1.0) if is_slow else 2 * np.pi * 1.5
    q_ib = rotation.quat_multiply(
        rotation.quat_from_rotvec(np.array([0.1, 0.7, -0.4])),
        rotation.quat_from_rotvec(np.array([roll_rate * t_s, 0.0, 0.0])),
    )
    omega = np.array([roll_rate, 0.0, 0.0])
    return rec.TruthSample(t_s, phase, r_i, v_i, q_ib, omega, np.array([0.0, 0.0, -9.8]), 0.02)


def _height(mission, truth):
    r_e, _ = ecef_from_inertial(mission.earth, truth.t_s, truth.r_i, truth.v_i)
    return wgs84.geodetic_from_ecef(r_e)[2]


def control(t_s):
    """What the cold-gas system does; it leaves the spin alone until the body turns slowly."""
    error = POINTING_ERROR * (1.0 if phase_at(t_s) == rec.Phase.POINTING else 2.0)
    if t_s < SLOW_S[0]:
        error[0] = np.nan
    return rec.ControlSample(t_s, error, np.array([0.0, 15.0, -15.0]), GAS_RATE * (t_s - CONTROLLED_S[0]))


def _navigation(mission, truth, rng):
    dtheta_b = rng.normal(0.0, SIGMA_THETA, 3)
    r_i = truth.r_i + rng.normal(0.0, SIGMA_R, 3)
    v_i = truth.v_i + rng.normal(0.0, SIGMA_V, 3)
    r_e, v_e = ecef_from_inertial(mission.earth, truth.t_s, r_i, v_i)
    q_ib = rotation.quat_multiply(truth.q_ib, rotation.quat_from_rotvec(-dtheta_b))
    return rec.NavSolution(
        truth.t_s, r_i, v_i, q_ib, truth.omega_ib_b, r_e, v_e, 0.1, 5.9, 0.01, -0.01,
        np.full(3, SIGMA_R), np.full(3, SIGMA_V), np.full(3, SIGMA_THETA), np.full(3, 1e-4),
        1e-4, 2e-4, 3e-4, truth.t_s > 236.0,
    )  # fmt: skip


def _covariance(t_s):
    diagonal = np.repeat([SIGMA_R**2, SIGMA_V**2, SIGMA_THETA**2], 3)
    zero = np.zeros(3)
    blocks = "gyro_roll_column mounting", np.zeros(6), np.arange(6.0)
    return rec.NavCovariance(t_s, np.diag(diagonal), zero, zero, zero, zero, np.arange(12.0), *blocks)


def _sky(rng):
    """A noisy sky, 659 x 493, and 30 stars in it."""
    image = rng.normal(12.0, 2.0, (493, 659)).clip(0, 255).astype(np.uint8)
    xy_px = rng.uniform(8.0, 480.0, (30, 2))
    for x, y in xy_px.astype(int):
        image[y - 1 : y + 2, x - 1 : x + 2] = 60
        image[y, x] = 200
    return image, xy_px


def star_camera(mission, truth, number, sky, rng):
    """Frame, its truth, the fix and the command of one tick; every 25th frame has no fix."""
    image, xy_px = sky
    t_valid = truth.t_s + 0.025
    later = truth_at(mission, t_valid)
    q_ic = rotation.quat_multiply(later.q_ib, rotation.quat_from_dcm(C_BC))
    rate = float(np.linalg.norm(truth.omega_ib_b))
    hip = np.arange(1000, 1030)
    yield rec.Frame(number, truth.t_s, t_valid, t_valid + 0.03, 0.05, 20.0, image)
    yield rec.FrameTruth(number, t_valid, q_ic, rate, 1.9, 0.9, True, hip, xy_px)
    reason = rec.Reason.TOO_FEW_STARS if number % 25 == 3 else rec.Reason.NONE
    q_fix, P_c = np.full(4, np.nan), np.full((3, 3), np.nan)
    if reason == rec.Reason.NONE:
        error_c = rng.normal(0.0, STAR_SIGMA_C)
        q_fix = rotation.quat_multiply(q_ic, rotation.quat_from_rotvec(-error_c))
        P_c = np.diag(STAR_SIGMA_C**2)
    P_px = np.tile(0.01 * np.eye(2), (30, 1, 1))
    found = rec.Detections(xy_px, np.full(30, 700.0), np.full(30, 9), np.zeros(30, int), P_px)
    known = np.where(np.arange(30) < 22, hip, 0)
    m = 2 if reason else 21
    u_c = np.column_stack([(xy_px[:m] - [329.0, 246.0]) / 2520.0, np.ones(m)])
    u_c /= np.linalg.norm(u_c, axis=1, keepdims=True)
    stars = rec.StarVectors(
        known[:m], u_c, P_px[:m] / 2520.0**2, u_c @ rotation.dcm_from_quat(q_ic).T, 1e-4 * np.arange(m),
        1e-8 * np.eye(3),
    )  # fmt: skip
    yield rec.StarFix(
        number, t_valid, t_valid + 0.06, int(reason), q_fix, P_c, found, known, 0.21, 12.0, 0.05, False,
        False, stars=stars,
    )  # fmt: skip
    yield rec.CameraCommand(truth.t_s + 0.09, 0.05, 20.0)
    yield rec.ComputeTime(truth.t_s, number, 0.002 + 0.001 * (number % 5))


def _ranges(t_s, r_e, rng, n):
    """Ranges of n satellites around; none for n = 0."""
    u_e = rng.normal(size=(n, 3))
    r_es_e = 26.6e6 * u_e / np.linalg.norm(u_e, axis=1, keepdims=True)
    pseudorange = np.linalg.norm(r_es_e - r_e, axis=1) + 1e4
    sigma, reason = np.full(n, 1.5), "" if n else "signals lost at ignition"
    return rec.GpsRanges(
        t_s, t_s + 0.2, np.arange(n) + 3, pseudorange, rng.normal(0.0, 500.0, n), r_es_e,
        rng.normal(0.0, 2e3, (n, 3)), sigma, sigma / 30.0, reason,
    )  # fmt: skip


def _events(mission):
    for t_s, name in ((0.0, "lift_off"), (56.0, "burn_out_1"), (149.2, "ignition_2"), (235.0, "despun")):
        yield rec.Event(t_s, name, _height(mission, truth_at(mission, t_s)), "")
    yield rec.Event(495.0, "impact", 0.0, "end of the made-up mission")


def simulate(options=DEFAULT):
    """All records in the order in which a simulation would give them."""
    run = mission(options.seed, options.start_s)
    rng = np.random.default_rng(options.seed)
    sky = _sky(rng) if options.frame_pixels else (np.zeros((1, 1), np.uint8), _sky(rng)[1])
    events = list(_events(run))
    cov3 = np.eye(3) * 9.0
    yield rec.Alignment(options.start_s, *truth_at(run, options.start_s)[2:5], 1.0, 0.01, np.eye(3) * 1e-6)
    n_ticks = round((options.end_s - options.start_s) * 100)
    for n in range(n_ticks + 1):
        t_s = options.start_s + n / 100
        truth = truth_at(run, t_s)
        yield truth
        if n % 10 == 0 and CONTROLLED_S[0] <= t_s < CONTROLLED_S[1]:
            yield control(t_s)
        yield rec.ImuBlock(t_s, t_s, 0.0025, rng.normal(0, 1e-3, (4, 3)), rng.normal(0, 0.1, (4, 3)), False)
        while events and events[0].t_s <= t_s:
            yield events.pop(0)
        if n % 100 == 0:
            r_e, v_e = ecef_from_inertial(run.earth, t_s, truth.r_i, truth.v_i)
            valid = n % 1000 != 300
            reason = "" if valid else "lost at ignition"
            yield rec.GpsFix(t_s, t_s + 0.2, valid, r_e, v_e, cov3, cov3 * 1e-4, 9, 1.8, reason)
            yield BarometerReading(t_s, t_s + 0.02, 101325.0 - 10.0 * n, not valid)
            yield MagnetometerReading(t_s, t_s + 0.02, 1e-6 * np.array([10.0, -20.0, 0.1 * n]), not valid)
            yield SunReading(t_s, t_s + 0.02, np.array([0.6, 0.0, 0.8]), valid)
            yield _ranges(t_s, r_e, np.random.default_rng(n), 0 if not valid else 4 + n // 100 % 3)
            yield rec.GateResult(t_s + 0.2, t_s, "gps_position", 3, 2.5, 16.3, True, "", np.ones(3))
            if n % 1000 in (0, 300):
                yield rec.NavHealth(t_s, "gps", valid, reason)
        if n % 10 == 0 and options.tracker_on_s <= t_s < options.tracker_off_s:
            number = round((t_s - options.tracker_on_s) * 10)
            yield from star_camera(run, truth, number, sky, rng)
            if number % 25 != 3:
                yield rec.GateResult(
                    t_s + 0.1, t_s + 0.025, "star_tracker", 3, 3.1, 16.3, t_s >= 236.0, "", np.zeros(3)
                )
        yield _navigation(run, truth, rng)
        if n % 10 == 0:
            yield _covariance(t_s)


def summary(options=DEFAULT):
    """The closing record of a run that took four seconds."""
    return RunSummary(options.end_s, 4.0, 1.5)
