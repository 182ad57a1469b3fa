"""What the watch says and doubts, case by case; what star camera and star tracker are told of the filter."""

from types import SimpleNamespace

import numpy as np
import pytest
from navigation_flight import C_BC, EARTH, MODEL, PARAMS, alignment, fly
from plain import plain

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.onboard import navigator
from shefex_nav.onboard.navigation import fusion, integrity_gyro, integrity_watch
from shefex_nav.onboard.navigation.integrity import HEALTHY, Steps
from shefex_nav.onboard.navigation.state import ATT, X_R, layout
from shefex_nav.records import Doubt

BAD, MOVES = HEALTHY._replace(rejected=3, in_a_row=3, used=9), HEALTHY._replace(used=9)
SENSORS = ("gps_position", "gps_velocity", "star_tracker", "star_vectors", "barometer")


def steps(*given):
    one = Steps()
    for z in given:
        one.add(np.array(z))
    return one


def watch():
    return integrity_watch.start(PARAMS)


def doubts(one=None, blind=False, **health):
    """Doubt about position, velocity, attitude."""
    records = {**dict.fromkeys(SENSORS, MOVES), **health}
    one = one or watch()
    return "".join(
        "C" if k == Doubt.CONTRADICTED else "I" if k == Doubt.IMU else "-"
        for k in one.graver_doubts(records, blind)
    )


def test_which_sensor_makes_what_doubtful():
    assert doubts() == "---"
    assert doubts(blind=True, gps_velocity=BAD) == "III"
    assert doubts(star_tracker=BAD) == doubts(star_vectors=BAD) == "--C"
    assert doubts(gps_position=BAD) == "C--"  # its velocity goes on: it has jumped
    assert doubts(gps_position=BAD, star_tracker=BAD) == "C-C"
    assert doubts(gps_velocity=BAD) == doubts(barometer=BAD) == "CCC"
    assert doubts(gps_position=BAD, gps_velocity=BAD) == "CCC"
    assert doubts(gps_position=BAD, gps_velocity=HEALTHY) == "CCC"  # no velocity says that it goes on
    assert doubts(gps_position=BAD._replace(used=0)) == "CCC"
    assert doubts(gps_position=BAD, barometer=BAD) == "CCC"


def test_ranges_that_contradict_while_their_rates_do_not_have_jumped():
    """The position alone; once they are believed the velocity too, which rates say along lines of sight."""
    rates = {"gps_position": HEALTHY, "gps_velocity": HEALTHY, "gps_range_rate": MOVES}
    assert doubts(gps_range=BAD, **rates) == "C--"
    assert doubts(gps_range=BAD, star_tracker=BAD, **rates) == "C-C"
    assert doubts(gps_range=BAD, **{**rates, "gps_range_rate": BAD}) == "CCC"
    assert doubts(gps_range=BAD, **{**rates, "gps_range_rate": HEALTHY}) == "CCC"
    assert doubts(gps_range=BAD._replace(used=0), **rates) == "CCC"
    words = integrity_watch.reason("gps_range", {"gps_range": BAD, **rates})
    assert words == "moves without its velocity"
    one = watch()
    one.moved = steps([3.0, 4.0, 0.0])
    assert doubts(one, gps_range=MOVES, **rates) == "CC-" and doubts(one, gps_range=HEALTHY) == "C--"
    one.accept(1.0, "gps_range")
    assert one.pending[-1].reason == "disputed: it or the filter was wrong by 5 m"


def test_without_specific_force_the_attitude_is_what_gyros_and_stars_say():
    """Position and velocity run away; whether the attitude may be used says its level, or a sensor."""
    rate, force = integrity_watch.Blind.TO_RATE, integrity_watch.Blind.TO_FORCE
    blind = [integrity_watch.blind(np.eye(7, 6, dtype=int)[k]) for k in range(7)]
    assert blind == 3 * [rate] + 3 * [force] + [integrity_watch.Blind.NOT]
    assert integrity_watch.blind(np.ones(6, dtype=int)) == rate | force
    assert doubts(blind=force) == "II-"
    assert doubts(blind=force, star_tracker=BAD) == "IIC"
    assert doubts(blind=force, gps_velocity=BAD) == "IIC"
    assert doubts(blind=rate, star_tracker=BAD) == doubts(blind=rate | force, star_tracker=BAD) == "III"
    one = watch()
    one.unread = force
    assert doubts(one, blind=None) == "II-"
    one.distrusted = True
    assert one.imu_blind == rate | force and doubts(one, blind=None) == "III"


def test_what_gyros_turn_by_under_force_is_known_either_way():
    """As noise of the model, or estimated as a block of states."""
    known = np.radians(36.0 / 3600.0) / 9.80665
    model = PARAMS.imu._replace(gyro_g_sensitivity=known)
    assert integrity_watch.start(PARAMS._replace(imu=model)).gyros.sensed == known
    model = PARAMS.imu._replace(gyro_g_sensitivity=0.0)
    blocks = PARAMS.sigma_blocks | {"gyro_g_sensitivity": np.full(9, known)}
    assert integrity_watch.start(PARAMS._replace(imu=model, sigma_blocks=blocks)).gyros.sensed == known


@pytest.mark.parametrize(
    "values, expected",
    [
        ({"step": steps(np.ones(3))}, "CCC"),
        ({"moved": steps(np.ones(3))}, "C--"),
        ({"alarms": {"gps": 0.0}}, "CCC"),
        ({"alarms": {"star_tracker": 0.0}}, "--C"),
        ({"alarms": {"star_tracker": 0.0}, "moved": steps(np.ones(3))}, "C-C"),
        ({"alarms": {"star_tracker": 0.0}, "reasons": {"gps": "frozen"}}, "CCC"),
        ({"reasons": {"gps": "frozen"}}, "---"),
    ],
)
def test_what_is_remembered_makes_doubtful_too(values, expected):
    one = watch()
    for name, value in values.items():
        setattr(one, name, value)
    assert doubts(one) == expected
    one.constants.found = "lever arm"
    assert doubts(one) == "CCC"


def test_two_that_agree_against_a_receiver_without_use():
    one = watch()
    one.reasons["gps"] = "frozen"
    assert doubts(one, star_tracker=BAD) == "CCC" and doubts(one) == "---"


@pytest.mark.parametrize("name, record, contradicts", [
    ("gps_position", {"rejected": 3}, True), ("gps_position", {"rejected": 2}, False),
    ("gps_position", {"in_a_row": 9}, False), ("gps_position", {"far": True}, True),
    ("gps_velocity", {"far": True}, True), ("star_tracker", {"far": True}, False),
    ("barometer", {"far": True}, False), ("gps_range", {"far": True}, True),
    ("gps_range", {"in_a_row": 3, "rejected": 1}, True), ("gps_range_rate", {"in_a_row": 2}, False),
    ("star_tracker", {"in_a_row": 3}, True), ("star_tracker", {"in_a_row": 2, "rejected": 9}, False),
])  # fmt: skip
def test_when_a_sensor_contradicts_the_solution(name, record, contradicts):
    record = HEALTHY._replace(**record)
    assert integrity_watch.contradicts(name, record) == contradicts
    assert list(integrity_watch.contradicting({name: record})) == (
        [name] if contradicts and not (record.far and not record.rejected) else []
    )


def test_reasons_name_what_is_contradicted():
    health = {"gps_velocity": MOVES, "gps_position": BAD}
    assert integrity_watch.reason("gps_position", health) == "moves without its velocity"
    assert integrity_watch.reason("gps_position", {**health, "gps_velocity": BAD}) == "contradicts the filter"
    assert integrity_watch.reason("star_tracker", health) == "contradicts the gyros"
    assert integrity_watch.reason("gps_velocity", health) == "contradicts the accelerometers"


def test_a_step_that_is_taken_back_leaves_the_others_open():
    """A receiver that is off by A, and for a while by B as well, is off by A in the end."""
    A, B = np.array([300.0, 0.0, 0.0]), np.array([0.0, 400.0, 0.0])
    for first, left in ((B, A), (A, B)):
        one = steps(A, B)
        assert one.largest == pytest.approx(500.0)
        assert one.take_back(-first) and one.largest == pytest.approx(np.linalg.norm(left))
        assert not one.take_back(-first) and one
        assert one.take_back(-left) and not one and one.largest == 0.0
    one = steps(A, B)
    assert not one.take_back(A) and one.take_back(-(A + B)) and not one  # all of them together
    one = steps(A, -A)
    assert not one.is_back(np.zeros(3)) and one.largest == pytest.approx(300.0)


def test_a_step_back_is_one_of_the_same_size():
    step = np.array([3.0, -4.0, 0.0])
    for back, is_back in ((-step, True), (-1.29 * step, True), (-1.31 * step, False), (-0.71 * step, True),
                          (-0.69 * step, False), (step, False)):  # fmt: skip
        assert steps(step).is_back(back) == is_back
    assert not steps().is_back(step) and not steps(step).is_back(-step[:2])


def test_a_velocity_that_is_believed_is_a_step_until_one_back():
    one, z = watch(), np.array([3.0, 0.0, 0.0])
    one.accept_velocity("gps_velocity", z, 5.0)
    assert not one.step  # not far off
    one.far = True
    one.accept_velocity("gps_range_rate", z, 5.0)
    assert not one.step
    one.accept_velocity("gps_velocity", z, 5.0)
    assert np.array_equal(one.step.kept, [z]) and one.pushed == 5.0
    one.accept_velocity("gps_velocity", -z, 6.0)
    assert not one.step and one.pushed == 6.0
    one.unread = True
    one.accept_velocity("gps_velocity", z, 5.0)
    assert not one.step


def test_a_position_that_is_believed_is_remembered_until_it_is_back():
    one, z = watch(), np.array([30.0, 0.0, 0.0])
    one.accept_position(z)
    assert not one.moved
    one.far = True
    one.accept_position(z)
    assert np.array_equal(one.moved.kept, [z])
    one.accept_position(-z)
    assert not one.moved
    one.unread = True
    one.accept_position(z)
    assert not one.moved


@pytest.mark.parametrize("angle, over", [(0.091, True), (0.089, False)])
def test_an_attitude_that_was_wrong_explains_a_step_of_the_velocity(angle, over):
    """By 0.3 of it at least: the angle times what specific force has added, 10 m/s; the step is 3 m/s."""
    one = watch()
    one.attitude_was_wrong(1.0)
    one.step, one.moved, one.pushed = steps([3.0, 0.0, 0.0]), steps(np.ones(3)), 10.0
    one.attitude_was_wrong(angle)
    assert (not one.step) == (not one.moved) == over
    one.step, one.pushed = steps(np.ones(3)), np.inf
    one.attitude_was_wrong(1.0)
    assert one.step


def test_what_is_left_to_say_of_a_sensor_that_is_used():
    one = watch()
    one.moved, one.step, one.disputed = steps([3.0, 4.0, 0.0]), steps([0.0, 1.2, 0.5]), np.radians(2.0)
    for name, words in (("gps_position", "5 m"), ("gps_velocity", "1.3 m/s"), ("star_tracker", "2 deg")):
        one.accept(1.0, name)
        assert one.pending[-1].source == name and one.pending[-1].reason.endswith(f"wrong by {words}")
    one.accept(1.0, "barometer")
    assert len(one.pending) == 3
    one.moved, one.step, one.disputed = steps(), steps(), 0.0
    one.accept(2.0, "gps_position")
    assert one.pending[-1].healthy


def test_the_same_kind_of_reason_is_told_once():
    one = watch()
    for words in ("frozen: of T+1 s", "frozen: of T+2 s", "stale: of T+2 s", "", ""):
        one.report(1.0, "gps", words)
    assert [said.reason for said in one.changes()] == ["frozen: of T+1 s", "stale: of T+2 s", ""]
    assert one.changes() == [] and one.reasons["gps"] == ""


def test_axes_of_the_level_are_kept_for_a_second():
    one, x = watch().protection, fusion.start(PARAMS, alignment(fly(0.1)[1][0]), EARTH).history.x
    first = one.axes(EARTH, 10.0, x)
    moved = x.copy()
    moved[X_R] *= -1.0
    assert one.axes(EARTH, 10.9, moved) is first and one.axes(EARTH, 9.1, moved) is first
    assert one.axes(EARTH, 11.1, moved) is not first


def test_gyros_that_were_wrong_are_trusted_for_a_second_after_stars():
    one = watch()
    found = integrity_gyro.Finding(("gyro y",), np.array([0.0, 0.01, 0.0]), np.full(3, 1e-4))
    one.gyros.failed, one.gyros.wrong = ("gyro y",), ("gyro y",)
    one.gyros_wrong(5.0, found)
    assert (
        one.distrusted
        and one.pending[-1].reason.endswith("by 0.573 deg/s")
        and one.pending[-1].source == "gyro y"
    )
    one.gyros.wrong, one.gyros.checked_s = (), 6.0
    for t_s, trusted in ((6.5, True), (7.0, True), (7.01, False)):
        one.screened(t_s, 0)
        assert one.distrusted != trusted and one.imu_blind != trusted
        assert one.pending[-1].healthy == trusted
    ends_s = 6.5 + 0.1 * np.arange(10)
    one.screened(6.4, 0)
    assert one.steady(ends_s) == 1 + 6  # the first at which the check is too old, 7.1 s
    assert one.steady(ends_s[:3]) == 3
    one.screened(7.5, 0)
    assert one.steady(ends_s + 1.1) == 10 and one.steady(ends_s) == 1
    assert watch().steady(ends_s) == 10


@pytest.mark.parametrize("name", ["gyro_roll_column", "gyro_scale", "gyro_misalignment", "mounting"])
def test_angles_are_wrong_by_all_that_is_relative_to_them(name):
    """Root of the sum of squares of what is known of each, of its worst axis."""
    params = PARAMS._replace(
        imu=MODEL._replace(gyro_cross=3e-4), sigma_blocks={name: np.array([1e-4, -4e-4, 2e-4])}
    )
    assert integrity_gyro.relative_error(params) == pytest.approx(5e-4)


def test_rates_are_wrong_under_force_by_the_worst_g_sensitivity():
    for block, of_noise, sigma in ((2e-6, 1e-6, 2e-6), (2e-6, 3e-6, 3e-6)):
        params = PARAMS._replace(
            imu=MODEL._replace(gyro_g_sensitivity=of_noise),
            sigma_blocks={"gyro_g_sensitivity": np.array([1e-6, -block])},
        )
        assert integrity_gyro.sensed_error(params) == sigma
    assert integrity_gyro.sensed_error(params._replace(sigma_blocks={})) == 3e-6


def test_the_floor_of_a_prediction_is_what_aberration_can_be():
    """Places are predicted without it: Earth round the Sun at 30.3 km/s and a vehicle below 11 km/s.

    At least that, so that a prediction is never too sure; not twice that, or it would be no prediction.
    """
    most = (30.3e3 + 11e3) / SPEED_OF_LIGHT
    assert most < navigator.PREDICTION_FLOOR < 2.0 * most


@pytest.mark.parametrize("blocks", [("mounting",), ()])
def test_the_camera_is_as_uncertain_as_attitude_and_mounting_together(blocks):
    order, rng = layout(blocks), np.random.default_rng(1)
    A = rng.standard_normal((order.n, order.n))
    P, H = A @ A.T, np.zeros((3, order.n))
    H[:, ATT] = np.eye(3)
    if blocks:
        H[:, order.places["mounting"]] = np.eye(3)
    got = plain(navigator.camera_covariance)(order.at, P, C_BC)
    np.testing.assert_allclose(got, C_BC.T @ H @ P @ H.T @ C_BC, rtol=1e-10)


@pytest.fixture(scope="module")
def context():
    """Filter after a second, a frame of its memory, and what the star tracker is told of it."""
    blocks, states = fly(1.0)
    nav = fusion.start(PARAMS, alignment(states[0]), EARTH)
    for block in blocks:
        fusion.advance(nav, block)
    frame = SimpleNamespace(
        t_valid_s=0.8034, t_start_s=0.77, exposure_s=0.05, line_s=1e-4, image_dn=np.zeros((100, 9))
    )
    sun = np.array([0.6, -0.64, 0.48])
    sky = navigator.Sky(sun, np.array([-1e4, 2e4, 1.8e4]))
    return nav, frame, sky, navigator.full_context(nav, frame, sky)


def test_the_star_tracker_is_told_attitude_and_velocity_of_the_instant(context):
    """Attitude of the nearest tick, carried on by the rate to the instant; velocity round the Sun."""
    nav, frame, sky, told = context
    tick = min(nav.history, key=lambda tick: abs(tick.t_s - frame.t_valid_s))
    before = max((t for t in nav.history if t.t_s < tick.t_s), key=lambda t: t.t_s)
    turn = rotation.rotvec_between(before.state.q_ib, tick.state.q_ib) / (tick.t_s - before.t_s)
    q_ib = rotation.quat_multiply(
        tick.state.q_ib, rotation.quat_from_rotvec(turn * (frame.t_valid_s - tick.t_s))
    )
    C_ic = rotation.dcm_from_quat(q_ib) @ rotation.dcm_from_rotvec(tick.state.mounting) @ C_BC
    predicted = rotation.dcm_from_quat(told.q_ic)
    np.testing.assert_allclose(predicted, C_ic, atol=2e-6)
    np.testing.assert_allclose(told[0], tick.state.v_i + sky.earth_velocity_i, rtol=1e-9)
    assert told[1] == pytest.approx(np.linalg.norm(turn), rel=1e-3)
    assert np.cos(told[2]) == pytest.approx(C_ic[:, 2] @ sky.sun_i, abs=1e-5)
    P_c = plain(navigator.camera_covariance)(nav.layout.at, tick.P, C_BC)
    np.testing.assert_allclose(told.P_c, P_c + navigator.PREDICTION_FLOOR**2 * np.eye(3), rtol=1e-9)
    down = -tick.state.r_i / np.linalg.norm(tick.state.r_i)
    off_down = np.arccos(C_ic[:, 2] @ down)
    radius = np.arcsin(min(1.0, wgs84.A / np.linalg.norm(tick.state.r_i)))
    assert told[3] == pytest.approx(off_down - radius, abs=0.1)  # of a sphere


def test_a_chain_without_prediction_is_told_the_angles_alone(context):
    nav, frame, sky, told = context
    brief = navigator.brief_context(nav, frame, sky)
    np.testing.assert_allclose(brief[0], told[0], rtol=1e-12)
    np.testing.assert_allclose(brief[1:4], told[1:4], rtol=1e-12)
    assert told.omega_c is not None
    late = SimpleNamespace(**{**vars(frame), "t_start_s": 5.0, "t_valid_s": 5.0})
    unknown = navigator.full_context(nav, late, sky)
    assert unknown.omega_c is None and unknown.P_omega_c is None
