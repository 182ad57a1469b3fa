"""Curves through rows: they go through them, and position, velocity and acceleration are one motion."""

import numpy as np
import pytest
from given_flight import EXAMPLE, at, reckoned
from made import EARTH, J2, ROLL, rocket, thrust
from scipy.integrate import cumulative_trapezoid

from shefex_nav import prepare
from shefex_nav.environment import gravity
from shefex_nav.geometry import frames, rotation
from shefex_nav.scenario import load
from shefex_nav.trajectory import rows
from shefex_nav.world.flight import track

RNG = np.random.default_rng(26)


@pytest.fixture(scope="module")
def example():
    return load.load(EXAMPLE)


def uneven(n):
    return np.cumsum(RNG.uniform(0.05, 0.3, n))


@pytest.mark.parametrize("with_accelerations", [False, True])
def test_it_goes_through_rows_that_do_not_agree(with_accelerations):
    t_s = uneven(60)
    r, v, a = RNG.normal(size=(60, 3)) * 5.0, RNG.normal(size=(60, 3)), RNG.normal(size=(60, 3))
    curve = track.Track(t_s, r, v, a if with_accelerations else None, 0.0, 0.0)
    r_at, v_at, _ = curve.at(t_s)
    assert np.allclose(r_at, r, atol=1e-9) and np.allclose(v_at, v, atol=1e-9)


def test_velocity_and_acceleration_are_derivatives():
    t_s = uneven(60)
    curve = track.Track(t_s, RNG.normal(size=(60, 3)), RNG.normal(size=(60, 3)), None, 0.0, 0.0)
    when, h = np.linspace(t_s[0] + 0.01, t_s[-1] - 0.01, 997), 1e-5
    before, now, after = (curve.at(when + step) for step in (-h, 0.0, h))
    for k in (0, 1):
        slope = (after[k] - before[k]) / (2.0 * h)
        assert np.allclose(slope, now[k + 1], atol=1e-4 * np.abs(now[k + 1]).max())
    jumps = np.abs(curve.at(t_s[1:-1] + 1e-9)[2] - curve.at(t_s[1:-1] - 1e-9)[2])
    assert jumps.max() < 1e-4 * np.abs(now[2]).max()


def test_a_smooth_motion_comes_back():
    """Error of the order of the sixth power of the distance of rows in position."""
    t_s, off = np.linspace(0.0, 20.0, 101), []
    for every in (1, 2):
        known = t_s[::every]
        curve = track.Track(known, *(np.column_stack(one) for one in _wave(known)[:2]), None, 0.0, 0.0)
        when = np.linspace(2.0, 18.0, 4001)
        off.append(np.abs(curve.at(when)[2] - np.column_stack(_wave(when)[2])).max())
    assert off[0] < 1e-3 and off[1] / off[0] > 6.0


def _wave(t_s):
    """Three circular motions, their velocities and accelerations."""
    rates = (0.7, 1.1, 1.9)
    return tuple([w**order * np.sin(w * t_s + 0.5 * np.pi * order + w) for w in rates] for order in range(3))


def test_an_attitude_has_the_rate_of_its_rows():
    """A body that turns with (3, 0.4, 0.2) rad/s about its own axes."""
    rate, t_s = np.array([3.0, 0.4, 0.2]), np.linspace(0.0, 10.0, 201)
    q = np.array([rotation.quat_from_rotvec(rate * t) for t in t_s])
    turning = track.Turning(t_s, q, 0.0)
    _, omega = turning.at(np.linspace(0.5, 9.5, 777))
    assert np.allclose(omega, rate, atol=1e-6)


def test_rounded_rows_are_passed_by():
    """Rows 1 ms apart with micrometres of rounding would be metres per second squared."""
    t_s = np.arange(0.0, 4.0, 0.001)
    fall = np.column_stack([-0.5 * 9.81 * t_s**2, 20.0 * t_s, 0.0 * t_s])
    speed = np.column_stack([-9.81 * t_s, 20.0 + 0.0 * t_s, 0.0 * t_s])
    told = np.round(fall, 4), np.round(speed, 4)
    digits = [rows.rounding(one) for one in told]
    assert digits == [pytest.approx(5e-5), pytest.approx(5e-5)]
    when = np.linspace(0.1, 3.9, 1001)
    careless, careful = (track.Track(t_s, *told, None, *one).at(when)[2] for one in ((0.0, 0.0), digits))
    assert np.abs(careless[:, 0] + 9.81).max() > 1.0
    assert np.abs(careful[:, 0] + 9.81).max() < 0.02


def boost(t_s):
    """Heights, speeds and accelerations (N,) of a burn from 5 s to 15 s that sets in and ends in 0.5 s."""
    a = 50.0 * np.clip(np.minimum(t_s - 5.0, 15.0 - t_s) / 0.5, 0.0, 1.0)
    v = cumulative_trapezoid(a, t_s, initial=0.0)
    return cumulative_trapezoid(v, t_s, initial=0.0), v, a


@pytest.mark.parametrize("digits", [2, 1, 0])
@pytest.mark.parametrize("alone", [False, True])
def test_a_curve_comes_near_the_rows_that_it_passes_by(digits, alone):
    """Rows every 10 ms, rounded so much that seconds lie between those that are used where it is calm."""
    t_s = np.arange(0.0, 30.0, 0.01)
    h, v, a = boost(t_s)
    r_told, v_told = (np.round(np.column_stack([one, 0.1 * one, 0.0 * one]), digits) for one in (h, v))
    step = 0.5 * 10.0**-digits
    if alone:
        v_told = track.velocity(t_s, r_told, step)
    curve = track.Track(t_s, r_told, v_told, None, step, 0.0 if alone else step)
    r_at, v_at, a_at = curve.at(t_s)
    assert np.abs(r_at[:, 0] - h).max() < 6.0 * step
    calm = np.abs(t_s - 5.0) > 2.0
    calm &= (np.abs(t_s - 15.0) > 2.0) & (t_s > 1.0) & (t_s < 29.0)
    assert np.abs(v_at[calm, 0] - v[calm]).max() < 6.0 * max(step, 0.02)
    assert np.abs(a_at[calm, 0] - a[calm]).max() < 6.0


def test_an_attitude_comes_near_the_rows_that_it_passes_by():
    """A body that begins to cone, told to four digits: 0.01 deg, by which no row may be far off."""
    t_s = np.arange(0.0, 60.0, 0.01)
    lean = 0.05 * np.clip((t_s - 20.0) / 2.0, 0.0, 1.0)
    phi = np.column_stack([0.0 * t_s, lean * np.cos(t_s), lean * np.sin(t_s)])
    true = np.array([rotation.quat_from_rotvec(one) for one in phi])
    told = np.round(true, 4)
    digit = 2.0 * rows.rounding(told)
    turning = track.Turning(t_s, told / np.linalg.norm(told, axis=1)[:, None], digit)
    attitude, _ = turning.at(t_s)
    off = [
        np.linalg.norm(rotation.rotvec_between(q, one))
        for q, one in zip(true[::10], np.roll(attitude.as_quat()[::10], 1, axis=1), strict=True)
    ]
    assert max(off) < 6.0 * digit


def test_the_digits_of_columns():
    assert rows.rounding(np.array([[0.5], [1.25]])) == pytest.approx(0.005)
    assert rows.rounding(np.array([[100.0, 0.0], [20.0, 0.0]])) == pytest.approx(0.5)
    assert rows.rounding(np.array([[np.pi], [np.e]])) == 0.0
    assert rows.rounding(np.zeros((5, 1))) == 0.0
    assert rows.rounding(np.full((5, 1), 69.0)) == 0.0, "what never changes says nothing"


@pytest.mark.parametrize("form", ["{:.6e}", "{:.7g}", "{:.4e}"])
def test_significant_digits_are_those_of_the_largest_number(form):
    """From millimetres on the pad to tens of kilometres, in three columns of another size each."""
    t_s = np.arange(0.0, 100.0, 0.01)
    exact = np.outer(0.5 * 7.123457 * t_s**2, [1.0, 0.0517, 0.0123])
    told = np.array([[float(form.format(one)) for one in row] for row in exact])
    digit = rows.rounding(told)
    assert np.abs(told - exact).max() == pytest.approx(digit, rel=0.1)
    decimals = np.round(exact, 3)
    assert rows.rounding(decimals) == pytest.approx(5e-4)
    assert rows.rounding(exact) < 1e-11


def test_what_significant_digits_leave_open_is_not_flown():
    """In free fall, told to 1 cm at 30 km by rows every 10 ms: no rest of the positions pushes it about."""
    t_s = np.arange(0.0, 60.0, 0.01)
    r = np.column_stack([800.0 * t_s - 4.905 * t_s**2, 40.01 * t_s, 0.0 * t_s])
    v = np.column_stack([800.0 - 9.81 * t_s, 40.01 + 0.0 * t_s, 0.0 * t_s])
    told = [np.array([[float(f"{one:.6e}") for one in row] for row in values]) for values in (r, v)]
    curve = track.Track(t_s, *told, None, *map(rows.rounding, told))
    _, _, a = curve.at(np.arange(1.0, 59.0, 0.0025))
    assert np.abs(a - [-9.81, 0.0, 0.0]).max() < 0.1


def test_the_digits_are_those_of_the_flight_and_not_of_the_pad():
    """A vehicle that waits at zero for longer than the numbers that are looked at."""
    waits = np.zeros((2 * rows.CHECKED, 3))
    moves = np.round(np.outer(np.linspace(0.0, 900.0, rows.CHECKED), [1.0, 0.3, 0.1]), 3)
    assert rows.rounding(np.concatenate([waits, moves])) == pytest.approx(5e-4)
    clock = np.concatenate([np.arange(1.0 - 2.0 * rows.CHECKED, 1.0), np.arange(1, rows.CHECKED) / 100.0])
    assert rows.clock_rounding(clock) == pytest.approx(5e-3)


@pytest.mark.slow
def test_an_imu_without_errors_integrates_back_to_the_example(example):
    away_m, tilt = reckoned(example)
    assert away_m < 0.02 and tilt < 2e-5


def test_forces_and_rates_are_those_of_the_motion(example):
    """Thrust less drag along the nose, as it was made; the roll rate; on the pad its weight."""
    path = rocket()
    t = prepare.fly_vehicle(example, 1).trajectory
    steady = (path.t_s > 1.5) & (path.t_s < 8.0)
    k = at(t, path.t_s[steady])
    speed = np.linalg.norm(path.v_l[steady], axis=1)
    drag = 0.5 * 1.2 * np.exp(-path.r_l[steady, 2] / 7500.0) * speed**2 * 0.05 / 300.0
    felt = [thrust(one) for one in path.t_s[steady]] - drag
    assert np.allclose(t.f_b[k, 0], felt, atol=0.01)
    assert np.abs(t.f_b[k, 1:]).max() < 0.02
    late = path.t_s > 15.0
    assert np.allclose(t.omega_ib_b[at(t, path.t_s[late]), 0], ROLL, atol=2e-3)
    stands = t.t_s < -0.01
    r_e, _ = frames.ecef_from_inertial(EARTH, t.t_s[0], t.r_i[0], t.v_i[0])
    omega_e = EARTH.C_re.T @ [0.0, 0.0, EARTH.rate]
    egm = gravity.load("egm96", 12)
    weight = np.linalg.norm(gravity.gravity_e(egm, r_e) - np.cross(omega_e, np.cross(omega_e, r_e)))
    assert np.allclose(np.linalg.norm(t.f_b[stands], axis=1), weight, atol=1e-6)
    assert np.allclose(np.linalg.norm(t.omega_ib_b[stands], axis=1), EARTH.rate, rtol=1e-9)
    assert J2.degree == 2
