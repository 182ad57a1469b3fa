"""The attitude programme: each task arrives where it should, with a rate that is continuous."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from shefex2 import C_BC, DEG, EARTH, dwell, task

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.world.flight import attitude_program as attitude
from shefex_nav.world.flight import tasks


def end_attitude(law, q_0):
    """Attitude at the end of a piece, integrated by scipy."""

    def rate(t_s, q):
        omega = np.array(attitude.body_rate(law, t_s)[:3])
        return rotation.quat_multiply(q, np.concatenate([[0.0], omega])) / 2.0

    solution = solve_ivp(rate, (law.t_0, law.t_1), q_0, rtol=1e-10, atol=1e-12, method="DOP853")
    return rotation.quat_normalise(solution.y[:, -1])


def random_attitude(rng):
    return rotation.quat_normalise(rng.normal(size=4))


def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def test_rate_and_its_derivative_agree():
    rng = np.random.default_rng(1)
    law = attitude.RateLaw(
        10.0, 30.0, 9.0, 2.0, unit(rng), 1.2, np.array([0.0, 0.1, -0.2]), -8.0,
        rng.normal(size=3) * 0.01, rng.normal(size=(2, 3)) * 0.01, 0.7, 0.3, 4.0,
    )  # fmt: skip
    for t_s in np.linspace(10.01, 29.99, 23):
        after, before = (np.array(attitude.body_rate(law, t_s + d)[:3]) for d in (1e-4, -1e-4))
        assert np.allclose(attitude.body_rate(law, t_s)[3:], (after - before) / 2e-4, atol=1e-5)


def test_smooth_step():
    u = np.linspace(0.0, 1.0, 2001)
    s, ds, dds, integral = np.array([attitude.smooth_step(x) for x in u]).T
    assert (s[0], s[-1], ds[0], ds[-1], dds[0], dds[-1]) == (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    for function, derivative in ((s, ds), (ds, dds), (integral, s)):
        assert np.allclose(np.gradient(function, u)[1:-1], derivative[1:-1], atol=2e-5)


@pytest.mark.parametrize("seed", range(4))
def test_roll_axis_turns_along_a_great_circle_to_its_target(seed):
    rng = np.random.default_rng(seed)
    q_0, target = random_attitude(rng), unit(rng)
    law = attitude.turn_roll_axis(70.0, 80.0, 9.4, q_0, target)
    x_0, x_1 = (rotation.dcm_from_quat(q)[:, 0] for q in (q_0, end_attitude(law, q_0)))
    assert np.allclose(x_1, target, atol=1e-8)
    assert law.angle == pytest.approx(np.arccos(x_0 @ target), abs=1e-7)
    for t_s in (70.0, 80.0):  # from rest to rest but for the spin
        assert np.allclose(attitude.body_rate(law, t_s)[:3], [9.4, 0.0, 0.0], atol=1e-12)


def test_roll_axis_turns_to_the_opposite_direction_too():
    q_0 = np.array([1.0, 0.0, 0.0, 0.0])
    law = attitude.turn_roll_axis(0.0, 10.0, 0.0, q_0, np.array([-1.0, 0.0, 0.0]))
    assert np.allclose(rotation.dcm_from_quat(end_attitude(law, q_0))[:, 0], [-1.0, 0.0, 0.0], atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_slew_arrives_at_rest(seed):
    rng = np.random.default_rng(seed)
    q_0, q_1 = random_attitude(rng), random_attitude(rng)
    law = attitude.turn_to(235.0, 250.0, q_0, q_1)
    assert np.linalg.norm(rotation.rotvec_between(end_attitude(law, q_0), q_1)) < 1e-8
    for t_s in (235.0, 250.0):
        assert np.allclose(attitude.body_rate(law, t_s), 0.0, atol=1e-12)


def test_damping_starts_with_the_rate_of_the_free_flight():
    omega = np.array([9.4, 0.3, -0.2])
    law = attitude.damp(65.0, 70.0, omega, -8.0)
    assert np.allclose(attitude.body_rate(law, 65.0)[:3], omega, atol=1e-15)
    assert np.allclose(attitude.body_rate(law, 70.0)[:3], [9.4, 0.0, 0.0], atol=1e-15)
    # for the first instant the transverse rate just nutates
    assert np.allclose(attitude.body_rate(law, 65.0)[3:], [0.0, -8.0 * 0.2, -8.0 * 0.3], atol=1e-12)


def test_spin_ramp():
    law = attitude.ramp_spin(220.0, 235.0, 9.4, 0.0)
    assert attitude.body_rate(law, 220.0)[0] == 9.4
    assert attitude.body_rate(law, 235.0)[0] == pytest.approx(0.0, abs=1e-14)
    rolled = Rotation.from_quat(rotation.xyzw(end_attitude(law, np.array([1.0, 0.0, 0.0, 0.0]))))
    assert (rolled * Rotation.from_rotvec([-9.4 * 7.5, 0.0, 0.0])).magnitude() < 1e-7


def test_rates_of_a_dwell_have_the_size_that_was_asked_for():
    rates = {"boresight_rate": 1.2 * DEG, "cross_rate": 1.6 * DEG, "cross_period": 20.0, "cross_phase": 0.3}
    moving = dwell(250.0, 372.0, ramp=3.0, **rates)
    law = attitude.dwell(moving, C_BC)
    middle = np.array([attitude.body_rate(law, t)[:3] for t in np.arange(260.0, 360.0, 0.5)])
    assert np.allclose(np.linalg.norm(middle, axis=1), 2.0 * DEG, rtol=1e-9)
    assert np.allclose(middle @ C_BC[:, 2], 1.2 * DEG, rtol=1e-9)
    turning = np.unwrap(np.arctan2(middle @ C_BC[:, 1], middle @ C_BC[:, 0]))
    assert np.allclose(np.diff(turning) / 0.5, 2.0 * np.pi / 20.0, rtol=1e-6)
    for t_s in (moving.start, moving.end):
        assert np.allclose(attitude.body_rate(law, t_s), 0.0, atol=1e-15)
    still = attitude.dwell(replace(moving, boresight_rate=0.0, cross_rate=0.0), C_BC)
    assert not any(attitude.body_rate(still, 300.0))


def test_tasks_become_the_laws_that_reach_their_targets():
    rng = np.random.default_rng(6)
    q_0, r_i = random_attitude(rng), np.array([2.0e6, 1.0e6, 6.1e6])
    v_i = np.array([500.0, 1500.0, -2000.0])

    def ahead(t_s):
        assert t_s == 149.2  # the time that the task names
        return r_i, v_i

    def reached(flown, spin):
        law = attitude.rate_law(flown, q_0, spin, ahead, EARTH, C_BC)
        assert (law.t_0, law.t_1) == (100.0, 130.0)
        assert attitude.body_rate(law, 100.0)[:3] == pytest.approx([spin, 0.0, 0.0], abs=1e-12)
        return rotation.dcm_from_quat(end_attitude(law, q_0)), attitude.body_rate(law, 130.0)[0]

    span = (100.0, 130.0)
    C_ib, spin = reached(task(tasks.Turn, *span, azimuth=5.0, elevation=0.2, at=149.2), 9.0)
    assert np.allclose(C_ib[:, 0], attitude.direction_i(EARTH, 149.2, r_i, 5.0, 0.2), atol=1e-7)
    assert spin == 9.0
    C_ib, _ = reached(task(tasks.AlignVelocity, *span, at=149.2), 0.0)
    v_air = v_i - np.cross(frames.omega_ie_i(EARTH), r_i)
    assert np.allclose(C_ib[:, 0], v_air / np.linalg.norm(v_air), atol=1e-7)
    assert reached(task(tasks.SpinTo, *span, rate=2.5), 9.0)[1] == pytest.approx(2.5, abs=1e-12)
    C_ib, spin = reached(task(tasks.Hold, *span), 9.0)
    assert np.allclose(C_ib[:, 0], rotation.dcm_from_quat(q_0)[:, 0], atol=1e-7) and spin == 9.0
    with pytest.raises(TypeError, match="no law"):
        attitude.rate_law(task(tasks.Damp, *span), q_0, 0.0, ahead, EARTH, C_BC)


def test_point_lays_the_boresight_where_it_is_told_at_its_end():
    q_0, r_i = random_attitude(np.random.default_rng(4)), np.array([2.0e6, 1.0e6, 6.1e6])
    slew = task(tasks.Point, 235.0, 250.0, azimuth=115.0 * DEG, elevation=52.0 * DEG, roll=0.4)
    law = attitude.rate_law(slew, q_0, 0.0, lambda t_s: (r_i + (t_s - 250.0), None), EARTH, C_BC)
    C_ic = rotation.dcm_from_quat(end_attitude(law, q_0)) @ C_BC
    assert np.allclose(
        C_ic[:, 2], attitude.direction_i(EARTH, 250.0, r_i, 115.0 * DEG, 52.0 * DEG), atol=1e-7
    )


def test_point_inertial_lays_the_boresight_among_the_stars():
    q_0 = random_attitude(np.random.default_rng(5))
    slew = task(tasks.PointInertial, 0.0, 60.0, right_ascension=136.0 * DEG, declination=51.0 * DEG, roll=0.4)
    law = attitude.rate_law(slew, q_0, 0.0, None, EARTH, C_BC)
    C_ic = rotation.dcm_from_quat(end_attitude(law, q_0)) @ C_BC
    boresight_i, roll_axis_i = C_ic[:, 2], rotation.dcm_from_quat(q_0)[:, 0]
    assert np.arctan2(boresight_i[1], boresight_i[0]) == pytest.approx(136.0 * DEG, abs=1e-7)
    assert np.arcsin(boresight_i[2]) == pytest.approx(51.0 * DEG, abs=1e-7)
    across = roll_axis_i - (roll_axis_i @ boresight_i) * boresight_i
    turned = np.arctan2(C_ic[:, 0] @ np.cross(boresight_i, across), C_ic[:, 0] @ across)
    assert turned == pytest.approx(0.4, abs=1e-6)


def test_point_nadir_lays_z_to_the_centre_and_x_forward_across_it():
    q_0 = random_attitude(np.random.default_rng(7))
    r_i, v_i = np.array([2.0e6, 1.0e6, 6.1e6]), np.array([5200.0, -4900.0, 1700.0])  # climbs: 0.14 rad
    ahead = {130.0: (r_i, v_i)}  # of its end and no other time
    law = attitude.rate_law(task(tasks.PointNadir, 100.0, 130.0), q_0, 0.0, ahead.__getitem__, EARTH, C_BC)
    for t_s in (100.0, 130.0):
        assert attitude.body_rate(law, t_s)[:3] == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    C_ib = rotation.dcm_from_quat(end_attitude(law, q_0))
    assert C_ib.T @ r_i == pytest.approx([0.0, 0.0, -np.linalg.norm(r_i)], abs=1.0)
    forward, right, down = C_ib.T @ v_i
    assert forward == pytest.approx(np.linalg.norm(np.cross(r_i, v_i)) / np.linalg.norm(r_i), abs=1e-3)
    assert right == pytest.approx(0.0, abs=1e-3)
    assert down == pytest.approx(-r_i @ v_i / np.linalg.norm(r_i), abs=1e-3) and down < -1000.0


@pytest.mark.parametrize("roll", [0.0, 0.7, np.pi])
def test_camera_attitude(roll):
    rng = np.random.default_rng(3)
    boresight, x_b = unit(rng), unit(rng)
    C_ic = rotation.dcm_from_quat(attitude.camera_attitude(boresight, x_b, roll, C_BC)) @ C_BC
    assert np.allclose(C_ic[:, 2], boresight, atol=1e-12)
    nearest = x_b - (x_b @ boresight) * boresight
    cosine = C_ic[:, 0] @ nearest / np.linalg.norm(nearest)
    assert np.arccos(np.clip(cosine, -1.0, 1.0)) == pytest.approx(roll, abs=1e-7)
    if 0.0 < roll < np.pi:  # positive about the boresight
        assert np.cross(nearest, C_ic[:, 0]) @ boresight > 0.0


def test_direction_in_the_local_frame():
    r_i, _ = frames.inertial_from_ecef(EARTH, 250.0, wgs84.ecef_from_geodetic(1.2, 0.3, 1e5), np.zeros(3))
    C_ei = frames.dcm_ie(EARTH, 250.0).T
    C_el = wgs84.dcm_el(1.2, 0.3)
    up_i = attitude.direction_i(EARTH, 250.0, r_i, 1.0, np.pi / 2.0)
    east_i = attitude.direction_i(EARTH, 250.0, r_i, np.pi / 2.0, 0.0)
    assert np.allclose(C_el.T @ C_ei @ up_i, [0.0, 0.0, 1.0], atol=1e-9)
    assert np.allclose(C_el.T @ C_ei @ east_i, [1.0, 0.0, 0.0], atol=1e-9)
