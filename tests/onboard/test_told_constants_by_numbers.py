"""Wrong constants of a receiver: what a unit of each shows, how the response travels, when one is named."""

from types import SimpleNamespace

import numpy as np
import pytest
from plain import plain
from scipy import stats

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import integrity_constants as told
from shefex_nav.onboard.navigation import prediction, sensor
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.measurements import lasting_factor
from shefex_nav.onboard.navigation.state import ATT, POS, VEL, X_Q, X_R, X_V
from shefex_nav.onboard.navigation.strapdown import BEFORE

N = 15
TILTED = rotation.dcm_from_rotvec(np.array([1e-3, -2e-3, 0.0]))  # by the precession
EARTH = frames.EarthRotation(TILTED, np.eye(3), 0.4, wgs84.OMEGA)
ARM_B = np.array([0.6, 0.05, -0.3])
OMEGA_IE_I = TILTED @ np.array([0.0, 0.0, wgs84.OMEGA])
Q = rotation.quat_from_rotvec(np.array([0.4, -0.7, 1.1]))
C = rotation.dcm_from_quat(Q)
R_I, V_I = np.array([6.5e6, 1e6, -2e6]), np.array([300.0, 1500.0, 900.0])


def packed(r=R_I, v=V_I, q=Q):
    x = np.zeros(30)
    x[X_R], x[X_V], x[X_Q] = r, v, q
    return x


def rows(block):
    H = np.zeros((3, N))
    H[:, block] = rotation.dcm_from_rotvec(np.array([0.1, 0.9, 0.2]))
    return H


def test_a_position_of_another_instant_is_off_by_the_velocity_over_ground():
    """A fix measured c seconds before its time, where the Earth has turned since; an arm as it stands."""
    c, H = 1e-3, rows(POS)
    turned = rotation.dcm_from_rotvec(OMEGA_IE_I * c) @ (R_I - V_I * c)
    got = plain(told._of_position)(H, packed(), V_I - np.cross(OMEGA_IE_I, R_I))
    np.testing.assert_allclose(got[:, 0] * c, H[:, POS] @ (turned - R_I), rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(got[:, 1:], H[:, POS] @ C, rtol=1e-12)


@pytest.mark.parametrize("f_i", [np.array([3.0, -50.0, 7.0]), np.zeros(3)], ids=["thrust", "orbit"])
def test_a_velocity_of_another_instant_is_off_by_the_acceleration_over_ground(f_i):
    """The antenna of a body that turns steadily a moment before, against the axes of the Earth then."""
    omega_b, H, c = np.array([6.0, -0.2, 0.4]), rows(VEL), 1e-4
    a_i = f_i - wgs84.GM / np.linalg.norm(R_I) ** 3 * R_I
    seen = read(np.eye(N), np.ones(3), H, np.eye(3), x=packed(v=5.0 * V_I), f_i=f_i, omega_b=omega_b)

    def over_ground(t_s):
        """Velocity at t_s, in the axes that the Earth has at 0."""
        C_ib, back = C @ rotation.dcm_from_rotvec(omega_b * t_s), rotation.dcm_from_rotvec(-OMEGA_IE_I * t_s)
        r = R_I + 5.0 * V_I * t_s + 0.5 * a_i * t_s**2
        return back @ (5.0 * V_I + a_i * t_s - np.cross(OMEGA_IE_I, r) + C_ib @ np.cross(omega_b, ARM_B))

    changes = (over_ground(-c) - over_ground(c)) / (2.0 * c)
    got = plain(told._shown)(seen, told.VELOCITY)
    np.testing.assert_allclose(got[:, 0], H[:, VEL] @ changes, atol=2e-3)  # m/s^2; the arm on the Earth
    for k in range(3):
        arm = np.eye(3)[k]
        np.testing.assert_allclose(got[:, 1 + k], H[:, VEL] @ C @ np.cross(omega_b, arm), atol=1e-12)


def test_a_response_travels_as_an_error_of_the_state():
    """Position by velocity, velocity by the attitude's error times specific force, which is not gravity."""
    B, dt = np.random.default_rng(1).standard_normal((N, 4)), 0.8
    C_0, f_i = rotation.dcm_from_rotvec(np.array([0.3, 0.2, -0.5])), np.array([20.0, -5.0, 8.0])
    gravity = -wgs84.GM / np.linalg.norm(R_I) ** 3 * R_I
    v_after, before = V_I + dt * (f_i + gravity), B.copy()
    plain(told._carry)(B, V_I, C_0, R_I, v_after, C, dt)
    turn_i = C_0 @ before[ATT]
    for k in range(4):
        a = np.cross(turn_i[:, k], f_i)
        np.testing.assert_allclose(B[VEL, k], before[VEL, k] + a * dt, rtol=1e-6)
        np.testing.assert_allclose(
            B[POS, k], before[POS, k] + before[VEL, k] * dt + 0.5 * a * dt**2, rtol=1e-6
        )
    np.testing.assert_allclose(B[ATT], C.T @ turn_i, rtol=1e-12)  # the same turn, in the axes of now


def test_a_response_of_the_clock_runs_on_by_its_drift():
    B = np.random.default_rng(8).standard_normal((N + 2, 4))
    sums, before, H = told.Constants().sums, B.copy(), np.zeros((3, N + 2))
    seen = read(np.eye(N + 2), np.ones(3), H, np.eye(3), dt_s=0.5)._replace(clock=N)
    plain(told._take)(B, sums, seen, told.NOTHING, False, False)
    np.testing.assert_allclose(B[N], before[N] + 0.5 * before[N + 1])
    np.testing.assert_array_equal(B[N + 1], before[N + 1])


def test_the_value_that_explains_most():
    rng = np.random.default_rng(2)
    A = rng.standard_normal((6, 3))
    J, y = A.T @ A, rng.standard_normal(3)
    value, explained = plain(told._best)(J, y)
    np.testing.assert_allclose(value, np.linalg.solve(J, y), rtol=1e-9)
    assert explained == pytest.approx(y @ np.linalg.inv(J) @ y)
    for bad in (np.diag([1.0, 1.0, 1e-9]), np.diag([1.0, 1.0, 0.0]), np.full((3, 3), np.nan)):
        value, explained = plain(told._best)(bad, y)
        assert not value.any() and explained == 0.0
    assert plain(told._best)(np.diag([1.0, 1.0, 1e-7]), y)[1] > 1e5
    assert plain(told._best)(np.zeros((1, 1)), np.ones(1))[1] == 0.0
    assert plain(told._best)(np.full((1, 1), 1e-12), np.ones(1))[1] == pytest.approx(1e12)


OMEGA_B, F_I = np.array([6.0, -0.2, 0.4]), np.array([3.0, -50.0, 7.0])


def read(P, z, H, S, x=None, f_i=F_I, dt_s=np.nan, omega_b=OMEGA_B):
    return told.Shown(packed() if x is None else x, P, z, H, S, omega_b, f_i, OMEGA_IE_I, ARM_B, -1, dt_s)


def measured(what, judges, learns, B, sums, dt_s=np.nan, seed=3):
    """A measurement taken in. -> what `_take` says, and its s, z, S, P, H"""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((N, N))
    P, z = A @ A.T, rng.standard_normal(3)
    H = rows(POS if what == told.POSITION else VEL)
    S = H @ P @ H.T + np.diag([1.0, 2.0, 3.0])
    got = plain(told._take)(B, sums, read(P, z, H, S, dt_s=dt_s), what, judges, learns)
    s = np.zeros((3, 4))
    if what == told.POSITION:
        s = plain(told._of_position)(H, packed(), V_I - np.cross(OMEGA_IE_I, R_I))
    elif what == told.VELOCITY:
        s = plain(told._shown)(read(P, z, H, S), what)
    return got, s, z, S, P, H


@pytest.mark.parametrize("what", [told.POSITION, told.VELOCITY, told.NOTHING])
@pytest.mark.parametrize("judges, learns", [(True, True), (True, False), (False, True)])
def test_the_information_on_constants_adds_up_over_innovations(what, judges, learns):
    """h = s - H B, J = sum h^T S^-1 h, y = sum h^T S^-1 z; a fix that is used moves B by K h."""
    B, sums = np.random.default_rng(5).standard_normal((N, 4)), told.Constants().sums
    before = B.copy()
    (beyond, time, by_time, arm, by_arm), shown, z, S, P, H = measured(what, judges, learns, B, sums)
    h, inverse = shown - H @ before, np.linalg.inv(S)
    np.testing.assert_allclose(sums.J, judges * h.T @ inverse @ h, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(sums.y, judges * h.T @ inverse @ z, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(B - before, learns * P @ H.T @ inverse @ h, rtol=1e-6, atol=1e-8)
    assert beyond == pytest.approx(judges * (z @ inverse @ z - 3.0))
    if judges:
        J, y = sums.J, sums.y
        assert time[0] == pytest.approx(y[0] / J[0, 0]) and by_time == pytest.approx(y[0] ** 2 / J[0, 0])
        value, explained = plain(told._best)(J[1:, 1:].copy(), y[1:].copy())
        np.testing.assert_allclose(arm, value, rtol=1e-7)
        assert by_arm == pytest.approx(explained)
    else:
        assert by_time == by_arm == 0.0
    np.testing.assert_array_equal(sums.v_i, V_I)
    np.testing.assert_allclose(sums.C_ib, C)


def test_between_measurements_the_response_is_carried_on():
    B, sums = np.ones((N, 4)), told.Constants().sums
    measured(told.NOTHING, False, False, B, sums)
    assert np.array_equal(B, np.ones((N, 4)))  # the first
    sums.v_i[:] = V_I - 5.0
    wanted = B.copy()
    plain(told._carry)(wanted, V_I - 5.0, C, R_I, V_I, C, 0.5)
    measured(told.NOTHING, False, False, B, sums, dt_s=0.5)
    np.testing.assert_allclose(B, wanted, rtol=1e-9)


def test_a_late_measurement_does_not_let_the_response_go_back():
    """A position of 0.2 s before the last star fix: else those 0.2 s would be carried twice."""
    B, sums = np.random.default_rng(6).standard_normal((N, 4)), told.Constants().sums
    measured(told.NOTHING, False, False, B, sums)
    sums.v_i[:], sums.C_ib[:], before = V_I - 5.0, TILTED, B.copy()
    measured(told.POSITION, True, False, B, sums, dt_s=-0.2)
    np.testing.assert_array_equal(B, before)
    np.testing.assert_array_equal(sums.v_i, V_I - 5.0)
    np.testing.assert_array_equal(sums.C_ib, TILTED)
    one = told.Constants()
    for t_s, latest_s in ((1.0, 1.0), (2.0, 2.0), (1.8, 2.0), (2.1, 2.1)):
        take(one, t_s=t_s)
        assert one.seen_s == latest_s


def remembered(ticks=40, n=4, dt_s=0.0025, pushed=lambda number: 1.0):
    """Memory of a body that turns and is pushed, in ticks of 10 ms that end at 0.01, 0.02 ... s.

    pushed : number of a tick -> factor of F_I in it
    """
    size = 64
    numbers, increments = np.zeros((size, 4)), np.full((size, BEFORE + n, 6), np.nan)
    xs = np.full((size, 30), np.nan)
    for number in range(1, ticks + 1):
        numbers[number] = n * dt_s * number, dt_s, n, 0.0
        C_ib = C @ rotation.dcm_from_rotvec(OMEGA_B * n * dt_s * number)
        xs[number, X_Q] = rotation.quat_from_dcm(C_ib)
        increments[number, BEFORE:, :3] = OMEGA_B * dt_s
        increments[number, BEFORE:, 3:] = pushed(number) * C_ib.T @ F_I * dt_s
    return prediction.Memory(
        numbers, increments, np.zeros((size, 3, 3)), xs, np.zeros((size, N, N)), packed(), np.eye(N),
        np.zeros((size, 6, 0)),
    )  # fmt: skip


def test_the_motion_is_what_the_sensors_have_read_until_shortly_before():
    """Mean of the ten ticks that end at the instant or in `SPAN_S` before it, as far as there are any."""
    omega_b, f_i = plain(told._read)(remembered(), 0, 40, 0.3)
    np.testing.assert_allclose(omega_b, OMEGA_B, rtol=1e-9)
    np.testing.assert_allclose(f_i, F_I, rtol=1e-9)
    for number, counts in ((20, False), (21, True), (30, True), (31, False)):
        memory = remembered()
        memory.increments[number] = np.nan
        assert np.isnan(plain(told._read)(memory, 0, 40, 0.3)[1]).all() == counts
    np.testing.assert_allclose(plain(told._read)(remembered(), 28, 40, 0.3)[1], F_I, rtol=1e-9)
    assert np.isnan(plain(told._read)(remembered(), 31, 40, 0.3)[1]).all()
    assert np.isnan(plain(told._read)(remembered(), 0, 40, 0.0)[0]).all()


def test_of_ticks_that_are_longer_than_the_span_it_is_the_last_before():
    """An IMU of 5 Hz, say: ticks that end at 0.2, 0.4 ... s."""
    memory = remembered(n=1, dt_s=0.2, pushed=lambda number: number)
    np.testing.assert_allclose(plain(told._read)(memory, 0, 40, 7.95)[1], 39.0 * F_I, rtol=1e-9)
    np.testing.assert_allclose(plain(told._read)(memory, 0, 40, 8.0)[1], 40.0 * F_I, rtol=1e-9)


def test_where_no_motion_is_known_a_velocity_teaches_nothing():
    """Neither the sums nor the response, which would need what it shows."""
    unknown, P = np.full(3, np.nan), np.eye(N)
    for what, H, shows in ((told.VELOCITY, rows(VEL), False), (told.POSITION, rows(POS), True)):
        B, sums = np.random.default_rng(5).standard_normal((N, 4)), told.Constants().sums
        before = B.copy()
        plain(told._take)(B, sums, read(P, np.ones(3), H, np.eye(3), f_i=unknown), what, True, True)
        assert sums.J.any() == sums.y.any() == (B != before).any() == shows


@pytest.mark.parametrize("what", [told.POSITION, told.VELOCITY])
@pytest.mark.parametrize("sigmas, moves", [(9.9, False), (10.1, True)])
def test_the_time_shows_only_in_a_vehicle_that_moves(what, sigmas, moves):
    """At rest the velocity is its error, which is in the innovation too; an arm shows as before."""
    P, v_r = np.diag(np.full(N, 0.03**2)), np.array([0.0, sigmas * 0.03 * np.sqrt(3.0), 0.0])
    H = rows(POS if what == told.POSITION else VEL)
    x = packed(v=np.cross(OMEGA_IE_I, R_I) + v_r)
    s = plain(told._shown)(read(P, np.ones(3), H, P[:3, :3], x=x), what)
    assert np.any(s[:, 0]) == moves
    assert np.abs(s[:, told.ARM]).max() > 0.1


LIMITS = {1: stats.chi2.isf(1e-10, 1), 3: stats.chi2.isf(1e-10, 3)}


def judged(time=(0.01, 0.0), arm=(1.0, 0.0), beyond=0.0, count=9, before=None):
    """Words of a memory that has seen `count` innovations of GPS. time, arm : value, squares explained"""
    one = told.Constants()
    one.count, one.beyond, one.wrong = count, beyond, before
    one._judge((np.array([time[0]]), time[1], np.array([0.6 * arm[0], 0.0, -0.8 * arm[0]]), arm[1]))
    return one.found, one.wrong


def test_a_constant_is_named_if_it_explains_far_more_than_chance():
    """Beyond the quantile of 1e-10, and most of what is more than chance in all innovations."""
    words = "time of its fixes wrong: measured about 10 ms before it"
    assert judged(time=(0.01, 1.01 * LIMITS[1])) == (words, told.TIME)
    assert judged(time=(-0.01, 1.01 * LIMITS[1]))[0].endswith("about 10 ms after it")
    assert judged(time=(0.01, 0.99 * LIMITS[1])) == ("", None)
    assert judged(arm=(2.5, 1.01 * LIMITS[3])) == ("lever arm wrong: by about 2.5 m", told.ARM)
    far = "its fixes are off by about 620 m in the axes of the body: no lever arm is so long"
    assert judged(arm=(618.0, 1.01 * LIMITS[3])) == (far, told.ARM)
    assert judged(arm=(2.5, 0.99 * LIMITS[3])) == ("", None)
    for share, found in ((0.71, True), (0.69, False)):
        assert bool(judged(time=(0.01, 100.0), beyond=100.0 / share)[0]) == found


def test_small_errors_and_few_innovations_are_no_matter():
    for value, found in ((2.1e-3, True), (1.9e-3, False), (-2.1e-3, True)):
        assert bool(judged(time=(value, 99.0))[0]) == found
    for value, found in ((0.21, True), (0.19, False)):
        assert bool(judged(arm=(value, 99.0))[0]) == found
    assert judged(time=(0.01, 99.0), count=5)[0] and judged(time=(0.01, 99.0), count=4) == ("", None)


def test_the_one_that_explains_more_is_named_and_stays_while_anything_speaks_for_it():
    time, arm = (0.01, LIMITS[1] + 20.0), (2.0, LIMITS[3] + 21.0)
    assert judged(time, arm)[1] == told.ARM
    assert judged(time, (2.0, LIMITS[3] + 19.0))[1] == told.TIME
    assert judged(time, arm, before=told.TIME)[1] == told.TIME
    assert judged((0.01, 0.26 * LIMITS[1]), (0.0, 0.0), before=told.TIME)[1] == told.TIME
    assert judged((0.01, 0.24 * LIMITS[1]), (0.0, 0.0), before=told.TIME) == ("", None)
    assert judged((0.0, 0.0), (1.0, 0.26 * LIMITS[3]), before=told.ARM)[1] == told.ARM


LASTS_S = 300.0


def take(one, name="gps_position", fate=Fate.USED, t_s=1.0, blind=False, z=0.0, **memory):
    """lasts : share of the variance that lasts, of a filter that knows its place to 3 % of a fix"""
    lasts, period_s, used = memory.pop("lasts", None), memory.pop("period_s", 0.05), memory.pop("used", None)
    reported, memory = [], remembered(**memory)
    memory.numbers[:, 0] += t_s - 0.4
    nav = SimpleNamespace(
        layout=SimpleNamespace(places={"clock": None}),
        watch=SimpleNamespace(imu_blind=blind, report=lambda *given: reported.append(given)),
        earth=EARTH,
        params=SimpleNamespace(l_ba_b=ARM_B, vibration_period_s=period_s),
        history=SimpleNamespace(ends_s=[t_s], oldest=0, number=lambda k: k, arrays=memory),
    )  # fmt: skip
    known, R = 1.0 if lasts is None else 1e-3, np.eye(3)
    gap_s = np.inf if np.isnan(one.seen_s) else t_s - one.seen_s
    now = SimpleNamespace(x=packed(), P=known * np.eye(N), k=40, t_s=t_s)
    H = rows(VEL if "velocity" in name else POS)
    innovation = sensor.Innovation(z + np.zeros(3), H, R, (1.0 + known) * np.eye(3), np.nan, np.nan)
    S = innovation.S if lasts is None else innovation.S - R + lasting_factor(lasts, LASTS_S, gap_s) * R
    one.take(nav, now, name, innovation, S, SimpleNamespace(fate=fate, rows=used))
    assert reported in ([], [(t_s, "gps_constants", one.found)])
    return reported


def test_what_is_taken_in_and_what_ends_it():
    """GPS fixes judge, used or not, unless they wait or the IMU is blind; after a reset all begins anew."""
    one = told.Constants()
    assert take(one, z=2.0)
    assert (one.count, one.seen_s) == (1, 1.0) and one.beyond == pytest.approx(6.0 - 3.0)
    take(one, fate=Fate.REJECTED, t_s=2.0)
    take(one, "gps_velocity", t_s=3.0)
    assert one.count == 3 and one.seen_s == 3.0 and one.beyond == pytest.approx(3.0 - 3.0 - 3.0)
    for given in ({"fate": Fate.HELD}, {"blind": True}, {"name": "star_tracker"}, {"name": "star_vectors"}):
        assert not take(one, t_s=4.0, **given)
    assert one.count == 3 and one.seen_s == 4.0
    before = one.B.copy()
    take(one, fate=Fate.RESET, t_s=5.0)
    assert one.count == one.beyond == 0 and not one.sums.J.any() and not one.sums.y.any()
    assert not take(one, t_s=5.0 + told.QUIET_S - 0.1) and one.count == 0 and not one.sums.J.any()
    assert one.seen_s == 5.0 + told.QUIET_S - 0.1  # the response goes on meanwhile
    assert take(one, t_s=5.0 + told.QUIET_S) and one.count == 1 and one.sums.J.any()
    one.found = "lever arm wrong: by about 2 m"
    take(one, "star_tracker", fate=Fate.RESET, t_s=50.0)
    assert not take(one, t_s=500.0) and one.found  # what was found by then stays
    learns = told.Constants()
    take(learns, fate=Fate.REJECTED)
    assert not learns.B.any()
    take(learns)
    assert learns.B.any() and before.shape == (N, 4)


def test_rows_that_the_gate_has_refused_say_nothing():
    """Of a satellite that contradicts the others: as if it had not been measured."""
    one, other = told.Constants(), told.Constants()
    take(one, z=np.array([2.0, 99.0, -1.0]), used=np.array([True, False, True]))
    take(other, z=np.array([2.0, -7.0, -1.0]), used=np.array([True, False, True]))
    assert one.beyond == pytest.approx(2.5 - 2.0) and one.beyond == other.beyond
    np.testing.assert_array_equal(one.sums.y, other.sums.y)
    shown = rows(POS)[[0, 2]][:, POS] @ C
    np.testing.assert_allclose(one.sums.J[1:, 1:], shown.T @ shown / 2.0, atol=1e-9)


def test_a_velocity_sees_the_turn_of_the_body():
    one = told.Constants()
    take(one, "gps_velocity")
    omega = rotation.skew(OMEGA_B)
    np.testing.assert_allclose(one.sums.J[1:, 1:], omega.T @ omega / 2.0, atol=1e-9)


@pytest.mark.parametrize("period_s, known", [(0.05, True), (0.2, True), (0.41, False), (1.01, False)])
def test_the_motion_is_that_of_a_period_of_the_vibration_before(period_s, known):
    """Pushed until a period and `SPAN_S` before, and since then in the period alone: as if never."""
    first = 40 - round(100.0 * (period_s + told.SPAN_S))
    swings = {"pushed": lambda number: 1.0 + (number > 40 - round(100.0 * period_s)) - (number <= first)}
    wanted, one, other = told.Constants(), told.Constants(), told.Constants()
    take(wanted, "gps_velocity", period_s=period_s)
    take(one, "gps_velocity", period_s=period_s, **swings)
    np.testing.assert_allclose(one.sums.J, wanted.sums.J, rtol=1e-12)
    assert one.sums.J.any() == known
    take(other, "gps_velocity", period_s=0.5 * period_s, **swings)
    assert np.abs(other.sums.J - wanted.sums.J).max() > 1.0 or period_s > 1.0


def test_a_time_shows_in_the_turn_of_the_antenna_too():
    """Of a body that spins, by the centripetal acceleration at the end of the arm that was told."""
    one, seen = told.Constants(), read(np.eye(N), np.ones(3), rows(VEL), np.eye(3))
    moves = plain(told._shown)(seen, told.VELOCITY)
    take(one, "gps_velocity")
    assert one.sums.J[0, 0] == pytest.approx(moves[:, 0] @ moves[:, 0] / 2.0, rel=1e-9)
    assert np.linalg.norm(np.cross(OMEGA_B, np.cross(OMEGA_B, ARM_B))) > 5.0


def lasting_positions(rng, n):
    """Innovations (n, 3) of positions with R = I, 0.9 of which lasts for `LASTS_S`."""
    r = np.exp(-1.0 / LASTS_S)
    last, all_of_it = rng.standard_normal(3), []
    for _ in range(n):
        all_of_it.append(np.sqrt(0.9) * last + np.sqrt(0.1) * rng.standard_normal(3))
        last = r * last + np.sqrt(1.0 - r**2) * rng.standard_normal(3)
    return np.array(all_of_it)


def test_errors_that_last_are_not_taken_for_a_constant():
    """Ten receivers for 200 s: taken for white, most of them have an arm that is wrong."""
    rng, found = np.random.default_rng(4), {0.0: 0, 0.9: 0}
    for _ in range(10):
        z = lasting_positions(rng, 200)
        for share in found:
            one = told.Constants()
            for k in range(len(z)):
                take(one, z=z[k], t_s=1.0 + k, lasts=share)
            found[share] += bool(one.found)
    assert found[0.9] == 0 and found[0.0] >= 5, found
