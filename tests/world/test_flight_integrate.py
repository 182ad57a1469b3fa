"""The integrator: its order, its error control, its samples, and the instants at which it stops."""

import numpy as np
import pytest
from cold_gas_bench import COLD_GAS
from flight_bench import (
    AT_CG,
    BODY,
    FAR,
    IDLE,
    POINT,
    STANDARD,
    STILL,
    TURNING,
    body,
    propagate,
    section,
    state,
    world,
)
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from shefex2 import EARTH, PRESCRIBED

from shefex_nav.environment import gravity
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.world.flight import (
    attitude_program,
    control,
    dynamics,
    fly,
    integrate,
    runge_kutta,
    surroundings,
)

TUMBLING = state(FAR, [3.0, -2.0, 1.0], [5.0, 1.5, -0.8])
COASTING = body(imu=AT_CG)


def order(steps, errors):
    """Slope of the errors over the steps, both in logarithms."""
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def distance(a, b):
    """Largest difference of two states or rows in velocity, attitude and rate; positions are too rounded."""
    return np.abs(a[..., 3:13] - b[..., 3:13]).max()


@pytest.mark.parametrize("what", ["tumbling", "falling"])
def test_order_of_the_solution(what):
    if what == "tumbling":  # attitude, rate and the swing of the IMU
        x0, around, steps = TUMBLING, world(), np.array([0.04, 0.025, 0.02, 0.0125, 0.01])
    else:  # gravitation of an oblate Earth
        x0 = state([6.6e6, 1e5, 3e5], [200.0, 5300.0, 5500.0])
        around, steps = world(gravity.load("j2"), TURNING), np.array([50.0, 40.0, 25.0, 20.0])
    t_end = 400.0 if what == "falling" else 4.0
    exact, _ = propagate(x0, t_end, body(), around, tolerance=-steps[-1] / 8.0)
    errors = [distance(propagate(x0, t_end, body(), around, tolerance=-h)[0], exact) for h in steps]
    assert 4.85 < order(steps, errors) < 5.5


def test_order_of_the_samples_within_a_step():
    steps = np.array([0.1, 0.08, 0.05, 0.04])
    _, exact = propagate(TUMBLING, 4.0, body(), tolerance=-1e-3, dt=2.5e-3)
    errors = []
    for h in steps:
        _, rows = propagate(TUMBLING, 4.0, body(), tolerance=-h, dt=2.5e-3)
        errors.append(distance(rows, exact))
    assert order(steps, errors) > 4.0
    # they are no worse than the solution by more than the order that is missing
    assert errors[-1] < 1e-5


def test_samples_do_not_disturb_the_solution():
    fine, _ = propagate(TUMBLING, 10.0, body(), dt=2.5e-3)
    coarse, _ = propagate(TUMBLING, 10.0, body(), dt=10.0)
    assert np.array_equal(fine[:13], coarse[:13])


def test_a_smaller_tolerance_gives_a_smaller_error():
    exact, _ = propagate(TUMBLING, 60.0, body(), tolerance=1e-14)
    tolerances = 1e-7 * 0.5 ** np.arange(12)
    errors = [distance(propagate(TUMBLING, 60.0, body(), tolerance=t)[0], exact) for t in tolerances]
    assert np.all(np.diff(errors) < 0.0)
    assert order(tolerances, errors) == pytest.approx(1.0, abs=0.2)
    assert errors[0] < 1e4 * tolerances[0]


def test_default_tolerance_is_good_to_a_millimetre(monkeypatch):
    # with a prescribed attitude: valves that open or stay shut let any difference grow
    loose = fly.fly(PRESCRIBED, EARTH).trajectory
    monkeypatch.setattr(fly, "TOLERANCE", integrate.TOLERANCE / 100.0)
    tight = fly.fly(PRESCRIBED, EARTH).trajectory
    n = min(len(loose.t_s), len(tight.t_s))
    assert abs(len(loose.t_s) - len(tight.t_s)) <= 1  # the impact
    assert np.abs(loose.r_i[:n] - tight.r_i[:n]).max() < 1e-3
    assert np.abs(loose.v_i[:n] - tight.v_i[:n]).max() < 1e-4
    assert np.abs(loose.q_ib[:n] - tight.q_ib[:n]).max() < 1e-6
    assert not np.array_equal(loose.r_i[:n], tight.r_i[:n])


def test_increments_are_the_integrals():
    # of the rate: p t, and of the transverse one its sine; of f: by Simpson's rule from the analytic rate
    p, w, dt = 9.0, 0.5, 2.5e-3
    nu = (BODY.inertia_roll / BODY.inertia_pitch - 1.0) * p
    x, rows = propagate(state(FAR, omega_b=(p, w, 0.0)), 2.0, body(), dt=dt)
    t = np.arange(len(rows)) * dt
    expected = w / nu * np.diff(np.stack([np.sin(nu * t), -np.cos(nu * t)]), axis=1).T
    assert np.allclose(rows[1:, 13], p * dt, rtol=1e-12)
    assert np.allclose(rows[1:, 14:16], expected, rtol=0.0, atol=1e-11)
    lever = AT_CG - np.array([-2.0, 0.1, -0.05])

    def force(s):
        omega = np.stack([0.0 * s + p, w * np.cos(nu * s), w * np.sin(nu * s)], axis=-1)
        alpha = np.stack([0.0 * s, -w * nu * np.sin(nu * s), w * nu * np.cos(nu * s)], axis=-1)
        return -np.cross(alpha, lever) - np.cross(omega, np.cross(omega, lever))

    simpson = dt / 6.0 * (force(t[:-1]) + 4.0 * force(t[:-1] + 0.5 * dt) + force(t[1:]))
    assert np.allclose(rows[1:, 16:19], simpson, rtol=0.0, atol=1e-10)
    assert np.allclose(rows[:, 19:22], force(t), rtol=0.0, atol=1e-7)
    assert np.array_equal(rows[0, 13:19], np.zeros(6))
    # all rows and what is left at the end: the whole integral
    assert rows[:, 13].sum() + x[13] == pytest.approx(p * 2.0, rel=1e-13)
    assert rows[:, 14].sum() + x[14] == pytest.approx(w / nu * np.sin(2.0 * nu), abs=1e-9)


def test_increments_go_on_over_the_end_of_a_section():
    c, dt = body(), 0.01
    rows, x = np.zeros((400, dynamics.ROW)), TUMBLING.copy()
    samples = integrate.Samples(0.0, dt, rows)
    flown = integrate.Vehicle(c, dynamics.FREE, IDLE, control.none())
    t, k = 0.0, 0
    for end in (0.5137, 0.514, 1.9, 3.3):
        t, k, how = integrate.integrate(x, t, end, k, samples, flown, world(), 1e-10)
        assert (t, how) == (end, integrate.T_END)
        assert k == np.ceil(end / dt - 1e-6)  # the sample at the very end is left to the next section
    whole, at_once = propagate(TUMBLING, 3.3, c, dt=dt)
    assert np.allclose(rows[:k, 13:19], at_once[:, 13:19], rtol=0.0, atol=1e-10)
    assert np.allclose(rows[:k], at_once, rtol=0.0, atol=1e-7)
    assert np.allclose(x, whole, rtol=0.0, atol=1e-7)


def test_rows_are_not_written_beyond_their_end():
    rows, x = np.full((6, dynamics.ROW), np.nan), TUMBLING.copy()
    guard = rows[3:].copy()
    samples = integrate.Samples(0.0, 0.1, rows[:3])
    flown = integrate.Vehicle(body(), dynamics.FREE, IDLE, control.none())
    _, k, _ = integrate.integrate(x, 0.0, 1.0, 0, samples, flown, world(), 1e-10)
    assert k == 3
    assert np.array_equal(rows[3:], guard, equal_nan=True)


def test_samples_that_are_taken_in_pieces_are_those_of_the_whole_bit_for_bit():
    steering, law = control.none(), IDLE
    whole, taken = np.full((4000, dynamics.ROW), np.nan), np.full((4000, dynamics.ROW), np.nan)

    def take(first, rows):
        assert np.isnan(taken[first : first + len(rows)]).all()  # each comes once
        taken[first : first + len(rows)] = rows
        rows[:] = np.nan  # they are written again

    ends = []
    for samples in (
        integrate.Samples(0.0, 0.0025, whole),
        integrate.Samples(0.0, 0.0025, np.zeros((30, dynamics.ROW)), take, 4000),
    ):
        x, t, k = TUMBLING.copy(), 0.0, 0
        for end in (0.51, 3.3, 10.1):  # there are samples until 9.9975 s alone
            flown = integrate.Vehicle(body(), dynamics.FREE, law, steering)
            t, k, how = integrate.integrate(x, t, end, k, samples, flown, world(), 1e-10)
            assert (t, how) == (end, integrate.T_END)
        ends.append((k, x.tobytes()))
    assert ends[0] == ends[1] and ends[0][0] == 4000
    assert taken.tobytes() == whole.tobytes()


def test_a_piece_holds_the_samples_of_a_step():
    samples = integrate.Samples(0.0, 0.0025, np.zeros((20, dynamics.ROW)), lambda first, rows: None, 4000)
    flown = integrate.Vehicle(body(), dynamics.FREE, IDLE, control.none())
    with pytest.raises(ValueError, match="20 rows are not enough"):
        integrate.integrate(TUMBLING.copy(), 0.0, 1.0, 0, samples, flown, world(), 1e-10)


def fall_time(r_0, r, gm):
    """Time of the fall along a line from rest at r_0 to r in the field of a point mass."""
    x = r / r_0
    return np.sqrt(r_0**3 / (2.0 * gm)) * (np.arccos(np.sqrt(x)) + np.sqrt(x * (1.0 - x)))


def test_instant_of_the_impact():
    r_0 = wgs84.A + 5e3
    x, t, how, rows = section(state([r_0, 0.0, 0.0]), 10.0, 500.0, COASTING, world(POINT), dt=0.01)
    assert how == integrate.EVENT
    assert t - 10.0 == pytest.approx(fall_time(r_0, wgs84.A, POINT.gm), abs=1e-9)
    assert x[0] == pytest.approx(wgs84.A, abs=1e-7)
    assert len(rows) == np.ceil((t - 10.0) / 0.01)


def test_instant_at_which_a_height_is_passed_on_the_way_down():
    steering = control.none()._replace(stop_height=3e3)
    up = 150.0  # m/s: passes the height on the way up first, which does not count
    x0 = state([wgs84.A + 2.5e3, 0.0, 0.0], [up, 0.0, 0.0])
    x, t, how, _ = section(x0, 0.0, 500.0, COASTING, world(POINT), steering=steering)
    top = 1.0 / (1.0 / (wgs84.A + 2.5e3) - up**2 / (2.0 * POINT.gm))
    expected = sum(fall_time(top, wgs84.A + h, POINT.gm) for h in (2.5e3, 3e3))
    assert how == integrate.STOP
    assert t == pytest.approx(expected, abs=1e-9)
    # from there on it is over: the ground comes next
    x, later, how, _ = section(x, t, 500.0, COASTING, world(POINT), steering=steering)
    assert how == integrate.EVENT
    assert later == pytest.approx(sum(fall_time(top, wgs84.A + h, POINT.gm) for h in (2.5e3, 0.0)), abs=2e-9)


def test_what_starts_below_the_ellipsoid_may_rise():
    x0 = state([wgs84.A - 25.0, 0.0, 0.0], [100.0, 0.0, 0.0])
    _, t, how, _ = section(x0, 0.0, 100.0, COASTING, world(POINT))
    assert how == integrate.EVENT
    assert t > 19.0  # up and down again
    _, t, how, _ = section(state([wgs84.A - 25.0, 0.0, 0.0]), 0.0, 100.0, COASTING, world(POINT))
    assert how == integrate.EVENT
    assert t < 1e-3  # but what falls from there has hit the ground


def test_instant_at_which_the_rail_ends():
    # constant thrust in empty space: s = c (t - (m/mu - t) ln(m / (m - mu t)))
    force, speed, full, dry = 9e4, 2500.0, 900.0, 500.0
    flow, start, length = force / speed, 0.6789, 10.0
    c = body(
        imu=AT_CG, exhaust_speed=speed,
        mass=np.array([[0.0, dry, 3.0, 60.0, 900.0, 900.0], [full, dry + full, 3.0, 60.0, 900.0, 900.0]]),
        thrust=np.array([[start, force, full], [start + full / flow, force, 0.0]]),
    )  # fmt: skip
    rail = surroundings.Rail(FAR, np.array([1.0, 0.0, 0.0]), length)

    def travel(t):
        whole = (dry + full) / flow
        return speed * (t - (whole - t) * np.log(whole / (whole - t)))

    expected = start + brentq(lambda t: travel(t) - length, 0.01, 5.0, xtol=1e-14)
    x, t, how, rows = section(state(), 0.0, 9.0, c, world(rail=rail), mode=dynamics.ON_RAIL, dt=2.5e-3)
    assert how == integrate.EVENT
    assert t == pytest.approx(expected, abs=1e-9)
    assert x[0] - FAR[0] == pytest.approx(length, abs=2e-8)
    assert x[0] - FAR[0] >= length - 1e-8
    assert np.array_equal(rows[:, 3] > 0.0, np.arange(len(rows)) * 2.5e-3 > start)


def test_a_rail_holds_what_cannot_lift_itself():
    c = body(imu=AT_CG)
    q = rotation.quat_from_dcm(np.eye(3))
    up = state([wgs84.A + 10.0, 0.0, 0.0], q_ib=q)
    rail = surroundings.Rail(up[0:3], np.array([1.0, 0.0, 0.0]), 5.0)
    x, t, how, rows = section(
        up, 0.0, 3.0, c, world(POINT, STILL, STANDARD, rail=rail), mode=dynamics.ON_RAIL
    )
    assert (t, how) == (3.0, integrate.T_END)
    assert np.allclose(x[0:6], up[0:6], rtol=0.0, atol=1e-9)
    assert np.allclose(rows[:, 19], POINT.gm / up[0] ** 2, rtol=1e-12)  # what carries it


def test_a_prescribed_attitude_is_followed():
    law = attitude_program.ramp_spin(1.0, 9.0, 7.0, -2.0)
    x, t, _, rows = section(
        state(FAR, omega_b=(7.0, 0.0, 0.0)),
        1.0,
        9.0,
        body(),
        world(),
        mode=dynamics.PROGRAMMED,
        law=law,
        dt=0.05,
    )
    times = 1.0 + 0.05 * np.arange(len(rows))
    wanted = np.array([attitude_program.body_rate(law, s)[:3] for s in times])
    assert np.array_equal(rows[:, 10:13], wanted)
    angle = 0.5 * (7.0 - 2.0) * 8.0  # of a smooth step half of the time counts
    assert np.allclose(
        x[6:10], [np.cos(angle / 2.0), np.sin(angle / 2.0), 0.0, 0.0], atol=1e-9
    ) or np.allclose(-x[6:10], [np.cos(angle / 2.0), np.sin(angle / 2.0), 0.0, 0.0], atol=1e-9)
    assert np.allclose(x[10:13], [-2.0, 0.0, 0.0], atol=1e-12)
    assert t == 9.0


def test_control_is_asked_at_its_ticks_and_holds_its_torque():
    steering = control.start(COLD_GAS, None, 400)._replace(
        follow=control.ATTITUDE, law=attitude_program.hold(0.5, 8.5, 0.0)
    )
    steering.next_s[0] = steering.clock[0] = 0.5
    steering.q_wanted[:] = [np.cos(0.1), np.sin(0.1), 0.0, 0.0]
    x, _, _, rows = section(
        state(FAR), 0.5, 8.5, COASTING, world(), mode=dynamics.CONTROLLED, steering=steering, dt=2.5e-3
    )
    ticks = steering.history[: steering.count[0]]
    assert np.allclose(ticks[:, 0], 0.5 + 0.02 * np.arange(400), rtol=0.0, atol=1e-9)
    given = ticks[:, 4].sum() * 0.02  # N m s about the roll axis, the only one asked for
    assert np.abs(ticks[:, 4]).max() > 0.0
    assert x[10] * BODY.inertia_roll == pytest.approx(given, abs=1e-9)
    # each sample shows the torque of its own period, from its first instant on
    slope = np.diff(rows[:, 10]) / 2.5e-3 * BODY.inertia_roll
    assert np.allclose(slope, np.repeat(ticks[:, 4], 8)[: len(slope)], rtol=0.0, atol=1e-7)


def test_ticks_that_were_missed_stay_missed():
    steering = control.start(COLD_GAS, None, 400)._replace(law=attitude_program.hold(0.0, 9.0, 0.0))
    steering.next_s[0] = 0.1
    _, t, _, _ = section(state(FAR), 5.0, 6.0, COASTING, world(), mode=dynamics.CONTROLLED, steering=steering)
    assert t == 6.0
    assert steering.count[0] == pytest.approx(50, abs=1)


def test_what_has_no_solution_is_an_error():
    x = state(FAR, [np.nan, 0.0, 0.0])
    with pytest.raises(ArithmeticError, match="grows without bound"):
        section(x, 0.0, 1.0, body(), world())


def test_a_motion_that_is_too_fast_to_follow_is_an_error():
    """A spin of 6000 rad/s with a wobble needs steps of some 10 us; 40 rev/s are followed."""
    slow, fast = (state(FAR, omega_b=[rate, 0.01 * rate, 0.0]) for rate in (250.0, 6000.0))
    x, t, how, _ = section(slow, 0.0, 40.0, body(), world())  # 228 000 steps, more than are free
    assert (t, how) == (40.0, integrate.T_END) and abs(np.linalg.norm(x[6:10]) - 1.0) < 1e-9
    with pytest.raises(integrate.MotionError, match="too fast"):
        section(fast, 0.0, 600.0, body(), world())


def test_the_smallest_step_is_made_where_rounding_makes_it_longer():
    """A step of 1 us ends 1e-16 s late at T+5 s: longer than the smallest, and not to be made shorter."""
    fast = state(FAR, omega_b=[1e8, 1e7, 0.0])
    begin_s = next(t for t in 5.0 + 1e-3 * np.arange(99) if (t + integrate.SMALLEST_STEP) - t > 1e-6)
    with pytest.raises(integrate.MotionError):
        section(fast, begin_s, begin_s + 1.0, body(), world())


def test_sections_without_length_change_nothing():
    x, t, how, rows = section(TUMBLING, 3.0, 3.0, body(), world())
    assert np.array_equal(x, TUMBLING)
    assert (t, how, len(rows)) == (3.0, integrate.T_END, 0)


@pytest.mark.parametrize("angle", [0.0, 0.1, 0.3, 0.33, 1.0, 2.5])
def test_rotation_vector_of_a_turning_body(angle):
    # t(s) with exp(t(0) + t' s) = exp(t(0)) exp(omega s), to the second order in s
    start, omega = angle * np.array([0.6, -0.64, 0.48]), np.array([0.5, 2.0, -1.0])
    slope = np.zeros(19)
    runge_kutta.turning(*start, *omega, slope)
    s = 1e-4
    ends = [
        (Rotation.from_rotvec(start) * Rotation.from_rotvec(sign * s * omega)).as_rotvec()
        for sign in (1.0, -1.0)
    ]
    assert np.allclose(slope[6:9], (ends[0] - ends[1]) / (2.0 * s), rtol=0.0, atol=3e-7)
    x, y = state(FAR, q_ib=rotation.xyzw([0.0, 0.6, 0.0, 0.8])), np.zeros(19)
    y[6:9] = start
    runge_kutta.turn(x, y)
    expected = Rotation.from_quat(rotation.xyzw(x[6:10])) * Rotation.from_rotvec(start)
    got = Rotation.from_quat(rotation.xyzw(y[6:10]))
    assert (expected.inv() * got).magnitude() < 1e-15
