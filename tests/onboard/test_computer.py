"""The executive: what runs when, and what comes out; its star tracker is a stand-in with known fixes."""

import numpy as np
import pytest
from navigation_flight import (
    C_BC,
    EARTH,
    PARAMS,
    alignment,
    fly,
    gps_fix,
    motion,
    star_fix,
    state_at,
)
from star_fields import TRACKER as STAR_TRACKER
from star_fields import tracker_with
from unpacked import tick

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard import computer, navigator
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.records import CameraCommand, Frame, GateResult, NavCovariance, NavSolution, Reason, StarFix

BLOCKS, STATES = fly(3.0)
SUN_I = np.array([0.0, 0.6, 0.8])
EARTH_VELOCITY_I = np.array([-2.9e4, 3e3, 1e3])
TRACKER = star_tracker.TrackerParams(STAR_TRACKER.settings, STAR_TRACKER.camera, EARTH_VELOCITY_I)


class Chain:
    """Solves every frame but number 1, and remembers what it was told."""

    def __init__(self):
        self.contexts = []

    def __call__(self, tracker, state, frame, context):
        self.contexts.append(context)
        latency_s = frame.t_available_s + 0.05 - frame.t_valid_s
        fix = star_fix(BLOCKS, STATES, frame.t_valid_s, latency_s)._replace(number=frame.number)
        if frame.number == 1:
            fix = fix._replace(reason=int(Reason.NO_MATCH), q_ic=np.full(4, np.nan))
        return state, fix, CameraCommand(frame.t_available_s, 0.1, 0.0)


def frame(number, t_s):
    return Frame(number, t_s, t_s + 0.025, t_s + 0.08, 0.05, 0.0, np.zeros((2, 2), np.uint8))


def fly_computer(gps=(), frames_taken=(), on_s=0.5, off_s=2.0, chain=None):
    """[(time of the tick, records)] of a flight of 3 s."""
    chain = chain or Chain()
    params = computer.ComputerParams(PARAMS, tracker_with(TRACKER, on=on_s, off=off_s), SUN_I)
    navigation = navigator.start(PARAMS, alignment(STATES[0]), EARTH)
    software = computer.Computer(params, navigation, star_tracker.Tracker(TRACKER, None), chain)
    ticks = []
    for block in BLOCKS:
        now = block.t_valid_s

        def due(things, now=now):
            return [x for x in things if now - 0.01 + 1e-9 < x.t_available_s <= now + 1e-9]

        ticks.append((now, tick(software, block, [*due(gps), *due(frames_taken)])))
    return ticks


def times(ticks, kind):
    return [round(now, 6) for now, records in ticks for record in records if isinstance(record, kind)]


def test_solutions_at_100_hz_and_covariances_at_10_hz():
    ticks = fly_computer(on_s=99.0, off_s=100.0)
    assert np.allclose(times(ticks, NavSolution), np.arange(1, 301) / 100.0)
    assert np.allclose(times(ticks, NavCovariance), np.arange(1, 31) / 10.0)
    assert not times(ticks, CameraCommand)


def test_the_tracker_runs_between_on_and_off_only():
    frames_taken = [frame(n, t) for n, t in enumerate((0.3, 0.6, 0.7, 1.9, 2.1))]
    ticks = fly_computer(frames_taken=frames_taken)
    assert times(ticks, CameraCommand) == [0.5, 0.68, 0.78, 1.98]
    assert times(ticks, StarFix) == [0.68, 0.78, 1.98]


def test_a_star_fix_enters_the_filter_at_the_first_tick_when_it_is_available():
    """Read out 0.08 s after the shutter opens, 0.05 s of chain; the frame without a match never enters.

    The first fix is only held, until the second one agrees with it.
    """
    ticks = fly_computer(frames_taken=[frame(1, 0.6), frame(2, 0.7), frame(3, 0.804)])
    used = [(now, r) for now, records in ticks for r in records if isinstance(r, GateResult)]
    assert [round(now, 6) for now, _ in used] == [0.83, 0.94]
    assert [round(r.t_valid_s, 6) for _, r in used] == [0.725, 0.829]
    assert [r.accepted for _, r in used] == [False, True]
    assert all(r.t_s == pytest.approx(now) for now, r in used)
    aided = [now for now, records in ticks for r in records if isinstance(r, NavSolution) and r.star_aided]
    assert round(aided[0], 6) == 0.94


def test_gps_passes_through_to_the_filter():
    ticks = fly_computer(gps=[gps_fix(BLOCKS, STATES, 1.0, 0.2), gps_fix(BLOCKS, STATES, 2.0, 0.2)], on_s=9.0)
    assert times(ticks, GateResult) == [1.2, 1.2, 2.2, 2.2]
    last = ticks[-1][1][0]
    assert np.linalg.norm(last.r_i - STATES[-1].r_i) < 0.01


def test_what_the_tracker_is_told_is_the_geometry_of_the_frame():
    chain = Chain()
    fly_computer(frames_taken=[frame(2, 0.7)], chain=chain)
    (context,) = chain.contexts
    truth = STATES[72]  # tick nearest to 0.725 s; the vehicle turns by 0.02 rad in half a tick
    assert np.allclose(context.velocity_i, truth.v_i + EARTH_VELOCITY_I, atol=2.0)
    assert context.rate == pytest.approx(3.0, rel=0.01)
    boresight_i = rotation.dcm_from_quat(truth.q_ib) @ C_BC[:, 2]
    assert context.sun_angle == pytest.approx(np.arccos(boresight_i @ SUN_I), abs=0.02)
    C_ei = frames.dcm_ie(EARTH, 0.72).T
    limb = wgs84.limb_angle(C_ei @ truth.r_i, C_ei @ boresight_i)
    assert context.limb_angle == pytest.approx(limb, abs=0.02)


def test_two_runs_are_the_same():
    def run():
        fixes = [gps_fix(BLOCKS, STATES, 1.0, 0.2)]
        return fly_computer(gps=fixes, frames_taken=[frame(2, 0.7), frame(3, 0.8)])

    for (_, one), (_, two) in zip(run(), run(), strict=True):
        assert [type(record) for record in one] == [type(record) for record in two]
        for a, b in zip(one, two, strict=True):
            if isinstance(a, NavSolution):
                assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))


def test_the_tracker_is_told_the_mean_rate_of_the_exposure():
    """3 rad/s of spin, in camera axes; rows of a rolling shutter are open from t_start_s on."""
    chain = Chain()
    rolling = frame(2, 0.7)._replace(line_s=0.02, t_valid_s=0.735)  # two rows
    fly_computer(frames_taken=[rolling], chain=chain)
    (context,) = chain.contexts
    expected = np.mean([motion(t)[0] for t in np.linspace(0.7, 0.77, 1001)], axis=0)
    assert np.allclose(context.omega_c, C_BC.T @ expected, atol=1e-5)
    truth, _ = state_at(BLOCKS, STATES, 0.735)
    error = rotation.rotvec_between(
        context.q_ic, rotation.quat_multiply(truth.q_ib, rotation.quat_from_dcm(C_BC))
    )
    assert np.abs(error).max() < 1e-4  # half a tick of spin would be 0.015
    assert np.sqrt(np.diag(context.P_c)).max() < np.radians(0.2)
