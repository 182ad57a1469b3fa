"""From when on a fault can be noticed, and what is made of flights and twins: against worked examples."""

from typing import NamedTuple

import numpy as np
import pytest

from shefex_nav import prepare
from shefex_nav.geometry import frames
from shefex_nav.records import Doubt, GateResult, GpsFix, NavHealth
from shefex_nav.scenario import load
from shefex_nav.verify.robustness import assess, detect, fixes, happenings
from shefex_nav.verify.robustness.detect import Innovation
from shefex_nav.verify.robustness.happenings import HAPPENS, Window


def flown(changes, noise, *, accepted=lambda k: True, health=(), begin=0):
    """detect.Flown of innovations of noise and, from `begin` on, of what is added; S is 4 on each axis."""
    seen, gates = {}, []
    for k, white in enumerate(noise):
        z = white + (changes[k - begin] if 0 <= k - begin < len(changes) else 0.0)
        seen["gps_position", float(k)] = Innovation(z, 4.0 * np.eye(3))
        note = "" if accepted(k) else "rejected"
        gates.append(
            GateResult(k + 0.2, float(k), "gps_position", 3, z @ z / 4.0, 21.0, accepted(k), note, z)
        )
    return detect.Flown(seen, gates, list(health))


def test_noise_cancels_and_the_sum_of_what_is_left_counts():
    """A change of 4 on one axis is D^T S^-1 D = 4 each second: the 25th makes 100."""
    noise = np.random.default_rng(3).standard_normal((60, 3)) * 50.0
    change = np.tile([4.0, 0.0, 0.0], (40, 1))
    found = detect.instant(flown(change, noise, begin=10), flown([], noise), start_s=10.0)
    assert found.t_s == pytest.approx(10.0 + 24.0 + 0.2)
    assert found.total == pytest.approx(100.0)
    assert detect.instant(flown([], noise), flown([], noise), 10.0).t_s is None
    short = detect.instant(flown(change[:20], noise, begin=10), flown([], noise), 10.0)
    assert short.t_s is None and short.total == pytest.approx(80.0)


def test_after_the_filter_has_reacted_noise_alone_is_nothing():
    """The innovation on which it reacts counts in full, later ones only beyond what chance explains."""
    rng = np.random.default_rng(4)
    noise, other = rng.standard_normal((2, 200, 3)) * 2.0
    change = np.full((1, 3), 6.0)
    clean = flown([], noise)
    faulty = flown(change, np.vstack([noise[:11], other[11:]]), accepted=lambda k: k != 10, begin=10)
    found = detect.instant(faulty, clean, 10.0)
    assert found.t_s is None
    assert 27.0 <= found.total < 60.0
    large = flown(np.full((30, 3), 12.0), noise, accepted=lambda k: k < 10, begin=10)
    assert detect.instant(large, clean, 10.0).t_s == pytest.approx(10.2)


def test_a_statement_is_a_reaction_too():
    noise = np.zeros((30, 3))
    change = np.tile([4.0, 0.0, 0.0], (20, 1))
    said = NavHealth(12.0, "gyro x", False, "turns otherwise than the stars: by 1 deg/s")
    found = detect.instant(flown(change, noise, health=[said], begin=5), flown([], noise), 5.0)
    assert found.t_s is None
    assert found.total == pytest.approx(7 * 4.0)  # at 5 to 11 s; 4 of each later one is chance
    assert detect.first_statement([said], [said], 0.0) == np.inf


def test_readings_that_tell_themselves():
    true = load.load("shefex2_andoya")
    window = Window(100.0, 110.0)
    at_once = detect.of_readings(HAPPENS["imu_gap"], window, true, [])
    assert (at_once.t_s, at_once.by) == (100.0, happenings.AT_ONCE)
    stuck = detect.of_readings(HAPPENS["gyro_stuck"], window, true, [])
    assert 100.0 < stuck.t_s < 100.2  # what the scenario imu_faults promises of stuck axes
    spread = detect.of_readings(HAPPENS["vibration_5x"], window, true, [])
    assert 100.0 < spread.t_s < 100.2
    assert detect.of_readings(HAPPENS["gps_drift"], window, true, []).t_s is None
    moved = [fix(float(k), np.full(3, min(k, 101.0))) for k in range(99, 110)]
    frozen = detect.of_readings(HAPPENS["gps_frozen"], window, true, moved)
    assert frozen.t_s == pytest.approx(102.2)


def fix(t_s, r_e):
    return GpsFix(t_s, t_s + 0.2, True, r_e, np.zeros(3), np.eye(3), np.eye(3), 8, 2.0, "")


def test_earliest_of_what_can_be_noticed():
    never, late, soon = (detect.Detectable(t_s, "", 0.0) for t_s in (None, 5.0, 2.0))
    assert detect.earliest(never, late, soon) is soon
    assert detect.earliest(never, never._replace(total=7.0)).total == 7.0


class Doubted(NamedTuple):
    """A flight of one quantity."""

    t_s: np.ndarray
    quantities: dict


def track(beyond, usable, doubt=Doubt.LEVEL):
    """levels.Flown-like of ten samples a second; (n,) bool each."""
    beyond, usable = np.asarray(beyond), np.asarray(usable)
    error = np.where(beyond, 2.0, 0.5)[:, None] * np.ones(3)
    doubts = np.where(usable, int(Doubt.NONE), int(doubt))
    one = assess.Quantity(error, np.ones_like(error), usable, doubts)
    return Doubted(0.1 * np.arange(len(beyond)), {"attitude": one})


def alarm(beyond, usable, detectable_s, named=(), doubt=Doubt.LEVEL, healthy=None):
    healthy = healthy or track(np.zeros(100, dtype=bool), np.ones(100, dtype=bool))
    window = Window(2.0, 8.0)
    noticed = [(2.0, detectable_s)]
    return assess._alarm(
        track(beyond, usable, doubt), healthy, "attitude", noticed, window, list(named), {int(Doubt.IMU)}
    )


def test_an_alarm_is_due_a_second_after_detectability_and_error():
    t_s = 0.1 * np.arange(100)
    beyond = (t_s >= 3.95) & (t_s < 8.0)
    always = np.ones(100, dtype=bool)
    late = alarm(beyond, always, 3.0)
    assert late["late_s"] == pytest.approx(3.0) and late["undetected_s"] == 0.0
    in_time = alarm(beyond, t_s < 4.85, 3.0, doubt=Doubt.IMU)
    assert (in_time["late_s"], in_time["wrong_words"]) == (0.0, 0)
    assert in_time["after_s"] == pytest.approx(0.9)
    silent = alarm(beyond, t_s < 4.85, 3.0)  # withdrawn, but nothing says that it is the sensor
    assert (silent["late_s"], silent["wrong_words"]) == (0.0, 1)
    named = alarm(beyond, t_s < 4.85, 3.0, named=[(4.0, np.inf)])
    assert named["wrong_words"] == 0
    for reason, wrong in ((Doubt.LEVEL, 0), (Doubt.CONTRADICTED, 1)):  # that of the twin, withdrawn as well
        twin = track(np.zeros(100, dtype=bool), t_s < 4.85, reason)
        assert alarm(beyond, t_s < 4.85, 3.0, healthy=twin)["wrong_words"] == wrong
    later = alarm(beyond, t_s < 6.95, 6.0, doubt=Doubt.IMU)  # it cannot be noticed before 6 s
    assert later["late_s"] == 0.0 and later["undetected_s"] == pytest.approx(3.0)
    never = alarm(beyond, always, None)
    assert never["late_s"] == 0.0 and never["undetected_s"] == pytest.approx(4.0)


@pytest.mark.parametrize("error, usable, wrong", [
    ((2.0, 0.5, 0.5), False, 0), ((2.0, 0.5, 0.5), True, 1), ((0.9, 2.0, 2.0), False, 1),
    ((0.5, 0.5, 0.5), False, 1),
])  # fmt: skip
def test_words_are_not_wrong_where_the_twin_errs_as_much_and_is_withdrawn_too(error, usable, wrong):
    """The flight is off about x by twice its level; the level of the twin is wider, so it is not beyond."""
    t_s, axes = 0.1 * np.arange(100), np.ones(3)
    beyond, always = (t_s >= 3.95) & (t_s < 8.0), np.ones(100, dtype=bool)
    flown = track(beyond, ~always, Doubt.CONTRADICTED)
    about_x = np.where(beyond[:, None], [2.0, 0.5, 0.5], 0.5)
    flown = Doubted(t_s, {"attitude": flown.quantities["attitude"]._replace(error=about_x)})
    twin = track(~always, always & usable, Doubt.CONTRADICTED).quantities["attitude"]
    twin = twin._replace(error=np.tile(error, (100, 1)), level=3.0 * np.tile(axes, (100, 1)))
    healthy = Doubted(t_s, {"attitude": twin})
    found = assess._alarm(flown, healthy, "attitude", [(2.0, 3.0)], Window(2.0, 8.0), [], {int(Doubt.IMU)})
    assert (found["late_s"], found["wrong_words"]) == (0.0, wrong)


@pytest.mark.parametrize("lasts_s, wrong", [(0.9, 0), (1.3, 1)])
def test_an_error_that_is_over_before_an_alarm_is_due_needs_no_reason(lasts_s, wrong):
    t_s = 0.1 * np.arange(100)
    beyond = (t_s > 3.95) & (t_s < 3.95 + lasts_s)
    found = alarm(beyond, t_s < 3.95, 3.0)
    assert found["beyond_s"] == pytest.approx(lasts_s)
    assert (found["late_s"], found["wrong_words"]) == (0.0, wrong)


def test_misleading_is_longer_than_a_second():
    t_s = 0.1 * np.arange(100)
    one = track((t_s > 1.0) & (t_s < 1.75), np.ones(100, dtype=bool)).quantities["attitude"]
    assert assess._quantity(one, t_s)["misleading_s"] == 0.0
    one = track((t_s > 1.0) & (t_s < 3.05), np.ones(100, dtype=bool)).quantities["attitude"]
    found = assess._quantity(one, t_s)
    assert found["misleading_s"] == pytest.approx(2.0) and found["misleading_times"] == 1
    assert found["largest_ratio"] == 2.0
    one = track((t_s > 1.0) & (t_s < 3.05), t_s < 0.5).quantities["attitude"]
    assert assess._quantity(one, t_s)["misleading_s"] == 0.0


def test_a_level_that_is_no_number_is_no_level():
    error = np.zeros((3, 3))
    level = np.array([[1.0, 1.0, 1.0], [1.0, np.nan, 1.0], [0.0, 0.0, 0.0]])
    one = assess.Quantity(error, level, np.ones(3, dtype=bool), np.zeros(3))
    assert one.beyond.tolist() == [False, True, False]


def test_nees_in_whatever_units():
    rng = np.random.default_rng(5)
    A = rng.standard_normal((9, 9)) * np.array([10.0] * 3 + [0.1] * 3 + [1e-5] * 3)[:, None]
    P, error = A @ A.T, A @ rng.standard_normal(9)
    white = np.linalg.solve(A, error)
    assert assess.nees(error[None], P[None])[0] == pytest.approx(white @ white, rel=1e-6)


def test_alarms_are_statements_against_healthy_sensors():
    said = [
        NavHealth(1.0, "gps", False, "no fix: pdop 12"),
        NavHealth(2.0, "gyro x", False, "at the end of its range"),
        NavHealth(3.0, "gps_position", False, "drifts: its innovations keep their sign"),
        NavHealth(4.0, "gps_position", True, ""),
    ]
    assert [one.t_s for one in assess.alarms(said, ())] == [3.0]
    assert assess.alarms(said, ("gps",)) == []


@pytest.fixture(scope="module")
def world():
    scenario = load.load(
        "night_sky", ["mission.time_limit=20 s", "star_tracker.off=20 s", "star_tracker.enabled=false"]
    )
    return scenario, prepare.build_world(scenario, 1)


def test_old_fixes_are_those_of_the_antenna_of_then(world):
    """On the ground in the axes of the Earth nothing moves; with an inertial speed the antenna does."""
    scenario, built = world
    arm = scenario.gps.antenna.lever_arm
    assert fixes.changed(built, arm) is built
    late = fixes.changed(built, arm, late_s=0.2)
    for one, other in zip(built.gps_fixes, late.gps_fixes, strict=True):
        assert np.allclose(one.r_ea_e, other.r_ea_e, atol=1e-3)
        assert one.t_valid_s == other.t_valid_s
    noisy = fixes.changed(built, arm, reported=3.0)
    assert np.allclose(noisy.gps_fixes[5].R_r_e, 9.0 * built.gps_fixes[5].R_r_e)


def test_the_antenna_between_samples_moves_with_its_velocity(world):
    """A vehicle that flies: position over 0.2 s is the integral of the velocity."""
    _, built = world
    truth = built.flight.trajectory
    flying = truth._replace(
        r_i=truth.r_i + (truth.t_s - truth.t_s[0])[:, None] * [1000.0, 0.0, 0.0],
        v_i=truth.v_i + np.array([1000.0, 0.0, 0.0]),
    )
    moving = built._replace(flight=built.flight._replace(trajectory=flying))
    for t_s in (3.0, 3.001):
        (r_1, v_1), (r_0, v_0) = (fixes.antenna(moving, (0.5, 0.0, 0.0), t_s - dt_s) for dt_s in (0.0, 0.2))
        assert np.allclose(r_1 - r_0, 0.1 * (v_1 + v_0), atol=2e-3)
    k = int(np.searchsorted(flying.t_s, 3.0 - 1e-9))
    expected, _ = frames.ecef_from_inertial(moving.earth, 3.0, flying.r_i[k], flying.v_i[k])
    assert np.allclose(fixes.antenna(moving, np.zeros(3), 3.0)[0], expected, atol=1e-6)
