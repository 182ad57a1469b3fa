"""A frame that the gyros call too fast is given where the stars themselves have turned far less."""

import numpy as np
import pytest
from star_fields import TRACKER, all_stars, tracker_with

from shefex_nav.geometry.rotation import quat_from_rotvec, quat_multiply
from shefex_nav.onboard.startracker import best_attitude, objects, tracker
from shefex_nav.onboard.startracker.background import FrameStatistics
from shefex_nav.onboard.startracker.identify.verify import Identification
from shefex_nav.records import NO_STARS, Detections, Frame, Reason

HIGHEST = np.radians(2.5)
START = np.array([0.8, 0.0, 0.6, 0.0])
NOTHING = Detections(
    np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2, 2))
)


def turned(deg, axis=(0.0, 0.6, 0.8)):
    return quat_multiply(START, quat_from_rotvec(np.radians(deg) * np.array(axis)))


def is_fast(rate_deg_s, turned_deg, since_s=0.1, q_ic=None, before_deg_s=None):
    before_deg_s = rate_deg_s if before_deg_s is None else before_deg_s
    before = best_attitude.Seen(7.0, np.radians(before_deg_s), START)
    q_ic = turned(turned_deg) if q_ic is None else q_ic
    return best_attitude.is_fast(
        HIGHEST, before, best_attitude.Seen(7.0 + since_s, np.radians(rate_deg_s), q_ic)
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])  # q and -q are one attitude
def test_stars_that_turn_far_less_than_the_gyros_say_are_believed(sign):
    assert not is_fast(15.0, 0.0, q_ic=sign * START)
    assert not is_fast(15.0, 0.0, q_ic=sign * turned(0.24))  # 2.4 deg/s
    assert is_fast(15.0, 0.0, q_ic=sign * turned(0.26))  # faster than the tracker is made for
    assert is_fast(15.0, 0.0, q_ic=sign * turned(1.5))  # as the gyros say
    assert is_fast(15.0, 0.0, q_ic=sign * turned(-1.5))
    assert not is_fast(15.0, 2.4, since_s=1.0)  # a frame a second


def test_stars_that_turn_nearly_as_the_gyros_say_are_not():
    """Just above the highest rate the gyros are believed, unless the stars say less than half of it."""
    assert not is_fast(2.6, 0.12)
    assert is_fast(2.6, 0.14)
    assert is_fast(9.0, 0.14, before_deg_s=2.6)


def test_a_camera_that_has_just_begun_to_turn_has_not_turned_much():
    """100 deg/s^2 from rest for 70 ms: 7 deg/s, and 0.245 deg on the way."""
    for before in (0.0, 2.4, np.nan):
        assert is_fast(7.0, 0.245, before_deg_s=before)


def test_up_to_the_highest_rate_and_where_it_is_not_known_no_frame_is_too_fast():
    assert not is_fast(2.4, 90.0)
    assert not is_fast(np.nan, 90.0)


def test_one_attitude_alone_says_nothing_of_a_rate():
    assert is_fast(15.0, 0.0, since_s=1.6)  # too long ago
    assert is_fast(15.0, 0.0, since_s=0.0)
    assert is_fast(15.0, 0.0, q_ic=np.full(4, np.nan))
    assert best_attitude.is_fast(HIGHEST, best_attitude.NOT_SEEN, best_attitude.Seen(7.0, 0.3, START))


def test_the_chain_goes_on_where_a_gyro_jumps_and_the_camera_rests():
    """Still camera, 15 deg/s from the third frame on, which is lost; from the fifth on it turns as well."""
    ready = tracker.init(tracker_with(TRACKER), all_stars(), 2012.47)
    rates = [0.0, 0.0, 15.0, 15.0, 15.0, 15.0]
    attitudes = [turned(deg) for deg in (0.0, 0.0, 0.0, 0.01, 1.5, 3.0)]
    state, reasons = tracker.TrackerState(0.04), []
    for number, (rate, q_ic) in enumerate(zip(rates, attitudes, strict=True)):
        t_s = 0.1 * number
        frame = Frame(number, t_s, t_s + 0.02, t_s + 0.05, 0.04, 0.0, np.zeros((4, 4), np.uint8), 0.0)
        found = Identification(np.zeros(0, np.int64), int(Reason.NONE), 30.0)
        result = found, Reason.NONE, (q_ic, 1e-10 * np.eye(3), 0.1), NO_STARS
        seen = objects.Found(NOTHING, FrameStatistics(20.0, 2.0, 20.0), 0, True)
        context = tracker.NO_CONTEXT._replace(rate=np.radians(rate))
        state, fix, _ = tracker.concluded(ready, state, frame, context, seen, result)
        reasons.append(fix.reason)
    given, fast = Reason.NONE, Reason.SMEARED
    assert reasons == [given, given, fast, given, fast, fast]


def test_rows_that_the_gyros_bring_too_far_are_looked_at_as_they_are_as_well():
    omega_c, P_omega_c = np.array([0.0, 0.3, 0.0]), 1e-8 * np.eye(3)
    context = tracker.NO_CONTEXT._replace(rate=0.3, omega_c=omega_c, P_omega_c=P_omega_c)
    frame = Frame(1, 0.0, 0.02, 0.05, 0.04, 0.0, np.zeros((4, 4), np.uint8), 0.0)
    rolling = frame._replace(line_s=2e-5)
    assert objects.turning(HIGHEST, frame, context) == [context]
    assert objects.turning(HIGHEST, rolling, context._replace(rate=0.01)) == [context._replace(rate=0.01)]
    first, second = objects.turning(HIGHEST, rolling, context)
    assert first is context and not second.omega_c.any()
    np.testing.assert_allclose(second.P_omega_c, (0.5 * HIGHEST) ** 2 * np.eye(3))


@pytest.mark.parametrize("solved, kept", [((), 1), ((2,), 2), ((1, 2), 1)])
def test_a_guess_counts_only_if_it_shows_an_attitude(monkeypatch, solved, kept):
    """Of two searches, the second a guess: what is said of the frame is the solved one, or the first."""
    ready = tracker.init(tracker_with(TRACKER), all_stars(), 2012.47)
    found = [
        objects.Found(NOTHING, FrameStatistics(10.0 * k, 2.0, 20.0), 0, True, guess=k == 2) for k in (1, 2)
    ]
    monkeypatch.setattr(objects, "as_spots", lambda *given: found)

    def result_of(_, detections, context, rate):
        looked.append(len(looked) + 1)
        reason = Reason.NONE if looked[-1] in solved else Reason.NO_MATCH
        solution = (START, 1e-10 * np.eye(3), 0.1) if reason == Reason.NONE else tracker.NO_SOLUTION
        return Identification(np.zeros(0, np.int64), int(reason), 30.0), reason, solution, NO_STARS

    looked = []
    monkeypatch.setattr(tracker, "attitude_with_stars", result_of)
    frame = Frame(1, 0.0, 0.02, 0.05, 0.04, 0.0, np.zeros((4, 4), np.uint8), 0.0)
    _, fix, _ = tracker.step(ready, tracker.TrackerState(0.04), frame, tracker.NO_CONTEXT)
    assert fix.background_dn == 10.0 * kept
    assert len(looked) == (1 if solved == (1, 2) else 2)
    assert (fix.reason == Reason.NONE) == bool(solved)
