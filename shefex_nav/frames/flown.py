"""The frames of a flight: flown for them, or flown again from its log.

A log keeps some of its pictures as they were read out and the rest without the background of the sky. Its
scenario and its seed give them all again. Each frame is compared with what the log says of it, so that a
picture of another flight cannot pass for one of this.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__, prepare, runs, simulate
from shefex_nav.errors import UserError
from shefex_nav.geometry.rotation import quat_from_dcm, quat_from_rotvec, quat_multiply, rotvec_between
from shefex_nav.geometry.shutter import row_times
from shefex_nav.log import reader
from shefex_nav.log.topics import ATTACHMENT, LogError
from shefex_nav.onboard.navigator import Columns
from shefex_nav.records import Frame, FrameTruth, StarFix
from shefex_nav.scenario import load, software
from shefex_nav.statistical import is_wanted
from shefex_nav.world.camera import motion

AFTER_S = 0.5  # after the last frame that is wanted its answer is there
SPARSE = 100  # ticks between two solutions, which nobody wants here
SAME_RAD = 1e-9  # attitudes of one flight differ by less, on whatever machine


class FramesError(UserError):
    """A flight that has no frames to give; the message says why."""


class Shot(NamedTuple):
    """One frame with its truth and what the star tracker said of it."""

    frame: Frame
    truth: FrameTruth
    fix: StarFix
    q_mean: np.ndarray  # (4,) q_ic, mean over the exposure: what the places of the stars show
    omega_c: np.ndarray  # (3,) rad/s, rate of the camera in its axes, mean over the exposure
    v_i: np.ndarray  # (3,) m/s, of the camera relative to the centre of the Earth


class Flight(NamedTuple):
    """What is flown for its frames."""

    scenario: object  # Scenario, settled
    seed: int
    world: object  # prepare.World
    until_s: float  # of the flight
    known: object = None  # RunData of the log that it must be like; None: there is none


def of_scenario(scenario, seed):
    """Flight of a Scenario and a seed."""
    if not scenario.star_tracker.enabled:
        raise FramesError("star_tracker.enabled is false: no frame is taken; set it to true")
    if is_wanted(scenario):
        raise FramesError(
            "star_tracker.frames is statistical: nothing is drawn; add --set star_tracker.frames=rendered"
        )
    runs.get_ready(scenario)
    scenario = prepare.settled(scenario)
    world = prepare.build_world(scenario, seed)
    simulate.warm_up(scenario, world)
    return Flight(scenario, seed, world, float(world.flight.trajectory.t_s[-1]))


def of_log(path):
    """Flight of a log; LogError if it cannot be flown again."""
    data = reader.read(path)
    if not len(data.frames.number):
        raise LogError(f"{path}: holds no frames of a star camera")
    mission = data.mission
    scenario = load.load_text(mission.scenario_text, f"{path}: {ATTACHMENT}")
    if is_wanted(scenario):
        raise LogError(
            f"{path}: was flown with star_tracker.frames: statistical, without pictures; fly its scenario "
            "with --set star_tracker.frames=rendered"
        )
    flight = of_scenario(scenario, mission.seed)
    return flight._replace(until_s=float(data.frames.t_valid_s[-1]), known=data)


def shots(flight, path=None, from_s=-math.inf, until_s=math.inf, every=1):
    """Shots of a Flight in order of time.

    path : of its log, for complaints
    from_s, until_s : mission times [s] between which the instants of the frames are
    every : every so many-th of these, from the first on
    """
    world, last_s = flight.world, min(until_s, flight.until_s)
    frames, truths, n = {}, {}, 0
    known = None if flight.known is None else {fix.number: fix for fix in flight.known.star_fixes}
    route = simulate.route(
        world, flight.scenario, flight.seed, until_s=last_s + AFTER_S, columns=Columns(SPARSE)
    )
    for record in route:
        if isinstance(record, Frame):
            frames[record.number] = record
        elif isinstance(record, FrameTruth):
            truths[record.number] = record
        elif isinstance(record, StarFix):
            frame, truth = frames.pop(record.number), truths.pop(record.number)
            if not from_s <= frame.t_valid_s <= last_s:
                continue
            if known is not None and record.number in known:
                _compare(path, flight, record, known[record.number])
            if n % every == 0:
                yield _shot(world, frame, truth, record)
            n += 1
    if software.own(flight.scenario.computer) is not None:
        _all_answered(one for one in frames.values() if from_s <= one.t_valid_s <= last_s)


def _all_answered(frames):
    """FramesError if there are Frames of which a computer of somebody's own has given no Solved."""
    if numbers := [one.number for one in frames]:
        words = f"frame {numbers[0]}" if len(numbers) == 1 else f"{len(numbers)} frames from {numbers[0]} on"
        raise FramesError(
            f"computer.software gave no Solved of {words}, not written; let it give one for each"
        )


def _shot(world, frame, truth, fix):
    """Shot of what came of one frame."""
    camera = world.camera
    times = row_times(frame.exposure_s, frame.line_s, frame.image_dn.shape[0])
    step_px = camera.psf.step_px
    move = motion.during(
        camera.pinhole, world.flight.trajectory, camera.q_bc, frame.t_valid_s, times, step_px
    )
    C_ic = np.ascontiguousarray(move.C_ci.T)
    turns = [rotvec_between(truth.q_ic, quat_from_dcm(np.ascontiguousarray(C.T))) for C in move.path.C_ci]
    weight = np.ones(len(turns))
    if len(turns) > 1:  # the trapezoidal rule, for which `motion.during` has made the steps
        weight[[0, -1]] = 0.5
    q_mean = quat_multiply(truth.q_ic, quat_from_rotvec(np.average(turns, axis=0, weights=weight)))
    return Shot(frame, truth, fix, q_mean, C_ic.T @ move.omega_ib_i, move.v_i)


def _compare(path, flight, fix, known):
    """LogError unless a StarFix is the one that the log has."""
    same = (fix.t_valid_s, fix.exposure_s, fix.reason) == (known.t_valid_s, known.exposure_s, known.reason)
    same = same and fix.background_dn == known.background_dn
    if same and np.isfinite(known.q_ic).all():
        same = np.linalg.norm(rotvec_between(fix.q_ic, known.q_ic)) < SAME_RAD
    if not same:
        version = flight.known.mission.version
        why = "the log has been changed, or was flown on another machine or with other libraries"
        if version != __version__:
            why = f"the log is of version {version}, this is {__version__}"
        raise LogError(
            f"{path}: frame {fix.number} at T{fix.t_valid_s:+.2f} s comes out otherwise than it was flown: "
            f"{why}; fly its scenario anew, or give the scenario itself"
        )
