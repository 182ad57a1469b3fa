"""Attitudes between frames that are refused for their residuals: not given out while those are the most."""

import numpy as np
import pytest
from star_fields import TRACKER, all_stars, tracker_with

from shefex_nav.onboard.startracker import best_attitude, objects, tracker
from shefex_nav.onboard.startracker.background import FrameStatistics
from shefex_nav.onboard.startracker.identify.verify import Identification
from shefex_nav.records import NO_STARS, Detections, Frame, Reason

NONE, RESIDUALS = Reason.NONE, Reason.RESIDUALS
NOTHING = Detections(
    np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2, 2))
)
SOLVED = np.array([1.0, 0.0, 0.0, 0.0]), 1e-10 * np.eye(3), 0.1


@pytest.fixture(scope="module")
def ready():
    return tracker.init(tracker_with(TRACKER), all_stars(), 2012.47)


def answers(ready, reasons):
    """Reasons that are given out for frames with these of their own."""
    state, given = tracker.TrackerState(0.04), []
    for number, reason in enumerate(reasons):
        frame = Frame(
            number, number, number + 0.02, number + 0.05, 0.04, 0.0, np.zeros((4, 4), np.uint8), 0.0
        )
        named = Identification(np.zeros(0, np.int64), int(reason), 30.0)
        solution = SOLVED if reason == NONE else tracker.NO_SOLUTION
        seen = objects.Found(NOTHING, FrameStatistics(20.0, 2.0, 20.0), 0, True)
        context = tracker.NO_CONTEXT._replace(rate=0.0)
        result = named, reason, solution, NO_STARS
        state, fix, _ = tracker.concluded(ready, state, frame, context, seen, result)
        assert np.isfinite(fix.q_ic).all() == (fix.reason == NONE)
        given.append(fix.reason)
    return given


def test_the_share_is_the_mean_with_a_memory_of_twenty_frames():
    """(1 - 1/20)^14 is the first power below one half."""
    share = 0.0
    for n in range(1, 40):
        is_denied, share = best_attitude.denied(share, RESIDUALS)
        assert share == pytest.approx(1.0 - 0.95**n)
        assert is_denied == (n > 14)  # by the frames before it
    for other in (Reason.NO_MATCH, Reason.SMEARED, Reason.SUN_EXCLUSION, Reason.TOO_FEW_STARS, None):
        assert best_attitude.denied(share, other) == (True, share)


def test_rare_attitudes_among_refused_frames_are_refused_too(ready):
    reasons = ([RESIDUALS] * 15 + [NONE]) * 4
    given = answers(ready, reasons)
    assert all(reason == RESIDUALS for reason in given[14:])


def test_a_right_camera_loses_nothing(ready):
    """Frames with a residual now and then, and a second of bad ones: as they are by themselves."""
    rng = np.random.default_rng(1)
    reasons = [RESIDUALS if rng.random() < 0.05 else NONE for _ in range(400)]
    reasons[100:110] = [RESIDUALS] * 10
    assert answers(ready, reasons) == reasons


def test_after_a_disturbance_attitudes_come_again(ready):
    """However long it was, within 1.4 s at 10 Hz."""
    given = answers(ready, [RESIDUALS] * 300 + [NONE] * 30)
    assert given[300:314] == [RESIDUALS] * 14 and given[314:] == [NONE] * 16
