"""Faults change what they are said to change, while they act, and nothing else."""

import numpy as np
import pytest
from fault_kinds import gps_fault, imu_fault, star_fault

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.records import NO_STARS, Frame, GpsFix, Reason, StarFix, Trajectory, rows
from shefex_nav.world import faults, imu
from shefex_nav.world.fault_settings import Faults

N = 4001  # samples: 10 s at 400 Hz
EARTH = frames.EarthRotation(np.eye(3), np.eye(3), 0.4, 7.292115e-5)


@pytest.fixture
def data():
    rng = np.random.default_rng(1)
    t_s = np.arange(N) / 400.0
    dtheta_b, dv_b = 1e-3 * rng.standard_normal((2, N, 3))
    return imu.ImuData(t_s, dtheta_b, dv_b, np.zeros(N, dtype=bool), None)


def changed(one, two):
    """Ends of the samples in which two arrays differ, s, first and last."""
    rows = np.flatnonzero((one != two).reshape(N, -1).any(axis=1))
    return rows[0] / 400.0, rows[-1] / 400.0


def sent(data, *wrong):
    """The data of a unit that sends them with faults."""
    dtheta_b, dv_b = data.dtheta_b.copy(), data.dv_b.copy()
    at_range = np.zeros((2, N, 3), dtype=bool)
    missing = faults.imu_sent(wrong, data.t_s, dtheta_b, dv_b, at_range)
    return data._replace(dtheta_b=dtheta_b, dv_b=dv_b, missing=missing)


def test_without_faults_nothing_is_touched(data):
    assert np.array_equal(sent(data).dtheta_b, data.dtheta_b) and sent(data).missing is None
    fixes = [gps_fix(1.0)]
    assert faults.gps((), fixes) is fixes


def test_a_stuck_axis_repeats_the_last_good_reading(data):
    bad = sent(data, imu_fault("stuck", 2.0, 3.0, sensor="gyro", axis="y"))
    assert changed(bad.dtheta_b, data.dtheta_b) == (2.0025, 3.0)  # samples of (2 s, 3 s]
    assert np.all(bad.dtheta_b[801:1201, 1] == data.dtheta_b[800, 1])
    assert np.array_equal(bad.dtheta_b[:, [0, 2]], data.dtheta_b[:, [0, 2]])
    assert np.array_equal(bad.dv_b, data.dv_b)


def test_a_dead_axis_reads_zero(data):
    bad = sent(data, imu_fault("dead", 2.0, 3.0, sensor="accelerometer", axis="z"))
    assert not bad.dv_b[801:1201, 2].any() and bad.dv_b[1201, 2] == data.dv_b[1201, 2]
    assert np.array_equal(bad.dtheta_b, data.dtheta_b)


def test_a_dropout_makes_blocks_that_say_they_are_not_valid(data):
    blocks = rows(imu.stacked(sent(data, imu_fault("dropout", 2.0, 2.05))))
    lost = [block.t_valid_s for block in blocks if not block.valid]
    assert lost == pytest.approx([2.01, 2.02, 2.03, 2.04, 2.05])
    assert all(np.isnan(block.dtheta_b).all() for block in blocks if not block.valid)
    assert len(blocks) == 1000 and all(np.isfinite(b.dv_b).all() for b in blocks if b.valid)


def test_repeated_blocks_are_the_last_good_one(data):
    good = rows(imu.stacked(data))
    bad = rows(imu.stacked(sent(data, imu_fault("repeat", 2.0, 2.05))))
    for k in range(1000):
        source = 199 if 200 <= k < 205 else k  # block k begins at k/100 s
        assert np.array_equal(bad[k].dtheta_b, good[source].dtheta_b)
        assert np.array_equal(bad[k].dv_b, good[source].dv_b)


def gps_fix(t_s, valid=True):
    r_e = wgs84.ecef_from_geodetic(1.2, 0.3, 1e5) + np.array([1000.0, 500.0, 200.0]) * t_s
    return GpsFix(
        t_s, t_s + 0.2, valid, r_e, np.array([1000.0, 500.0, 200.0]), np.eye(3), np.eye(3), 8, 2.0, ""
    )


def test_a_frozen_receiver_repeats_its_last_valid_fix():
    fixes = [gps_fix(float(t), valid=t not in (2, 5)) for t in range(8)]
    bad = faults.gps((gps_fault("freeze", 3.0, 6.0),), fixes)
    assert [fix.valid for fix in bad] == [True, True, False, True, True, True, True, True]
    for t in (3, 4, 5):  # 2 s has no solution, so that of 1 s is repeated
        assert np.array_equal(bad[t].r_ea_e, fixes[1].r_ea_e)
        assert bad[t].t_valid_s == t and bad[t].t_available_s == t + 0.2
    assert bad[6] is fixes[6]
    stands = faults.gps((gps_fault("freeze", 3.0, 6.0, time="stands"),), fixes)
    assert stands[4].t_valid_s == 1.0 and stands[4].t_available_s == 4.2


def test_a_delayed_receiver_says_the_same_later():
    fixes = [gps_fix(float(t), valid=t != 4) for t in range(8)]
    right = faults.gps((gps_fault("delay", 3.0, 6.0, by=0.5),), fixes)
    late = faults.gps((gps_fault("delay", 3.0, 6.0, by=0.5, time="late"),), fixes)
    for t, fix in enumerate(fixes):
        later_s = 0.5 if t in (3, 4, 5) else 0.0
        assert right[t].t_available_s == late[t].t_available_s == fix.t_available_s + later_s
        assert (right[t].t_valid_s, late[t].t_valid_s) == (t, t + later_s)
        assert right[t].r_ea_e is late[t].r_ea_e is fix.r_ea_e and right[t].valid == fix.valid


def test_jump_and_drift_are_along_north_east_down():
    fixes = [gps_fix(float(t)) for t in range(8)]
    moved = np.array([30.0, -40.0, 5.0])
    jump = faults.gps((gps_fault("jump", 2.0, 4.0, position=tuple(moved)),), fixes)
    drift = faults.gps((gps_fault("drift", 2.0, 6.0, rate=tuple(moved), velocity_too=True),), fixes)
    for t, fix in enumerate(fixes):
        C_ne = wgs84.dcm_en(*wgs84.geodetic_from_ecef(fix.r_ea_e)[:2]).T
        expected = moved if t in (2, 3) else np.zeros(3)
        assert np.allclose(C_ne @ (jump[t].r_ea_e - fix.r_ea_e), expected, atol=1e-8)
        expected = moved * (t - 2) if 2 <= t < 6 else np.zeros(3)
        assert np.allclose(C_ne @ (drift[t].r_ea_e - fix.r_ea_e), expected, atol=1e-8)
        inside = 2 <= t < 6
        assert np.allclose(C_ne @ (drift[t].v_ea_e - fix.v_ea_e), moved * inside, atol=1e-10)


def test_an_outage_has_no_solution_and_says_why():
    (fix,) = faults.gps((gps_fault("outage", 1.0, 2.0),), [gps_fix(1.0)])
    assert not fix.valid and fix.reason == "outage" and np.isnan(fix.r_ea_e).all() and fix.n_satellites == 0


def star_fix(number, reason=Reason.NONE):
    q_ic = rotation.quat_normalise(np.array([0.5, 0.1 * number, -0.3, 0.7]))
    t_s = 100.0 + 0.1 * number
    return StarFix(number, t_s, t_s, int(reason), q_ic, np.eye(3), None, None, 0.1, 9.0, 0.05, False, False)


def test_every_tenth_solved_frame_is_wrong_and_the_first_of_them():
    fault = star_fault("wrong_fixes", 100.0, 200.0, every=10, smallest=0.01, largest=np.pi)
    line = faults.StarLine((fault,), np.random.default_rng(2))
    angles = []
    for number in range(402):
        fix = line.fix(star_fix(number, Reason(number in (0, 5))))
        if fix.reason == Reason.NONE:
            angles.append(np.linalg.norm(rotation.rotvec_between(star_fix(number).q_ic, fix.q_ic)))
    wrong = np.flatnonzero(np.array(angles) > 1e-9)
    assert wrong.tolist() == list(range(0, 400, 10))
    sizes = np.array(angles)[wrong]
    assert sizes.min() >= 0.01 - 1e-9 and sizes.max() <= np.pi + 1e-9
    # evenly by the logarithm: half of 40 below the geometric mean, five sigma of the binomial
    assert abs((sizes < np.sqrt(0.01 * np.pi)).sum() - 20) < 16


def test_a_bias_turns_every_fix_alike():
    bias_c = np.array([1e-3, -2e-3, 3e-3])
    line = faults.StarLine((star_fault("bias", 100.15, 100.35, angles=tuple(bias_c)),), None)
    for number in range(6):
        turned = rotation.rotvec_between(star_fix(number).q_ic, line.fix(star_fix(number)).q_ic)
        assert np.allclose(turned, bias_c if number in (2, 3) else 0.0, atol=1e-12)


def test_single_stars_show_the_turned_camera_too():
    """u_i = C_ic u_c holds for the turned attitude; so do stars of a frame without one."""
    bias_c = np.array([0.1, -0.2, 0.3])
    line = faults.StarLine((star_fault("bias", 100.0, 200.0, angles=tuple(bias_c)),), None)
    rng = np.random.default_rng(3)
    u_c = rng.standard_normal((4, 3))
    u_c /= np.linalg.norm(u_c, axis=1, keepdims=True)
    fix = star_fix(1)
    u_i = u_c @ rotation.dcm_from_quat(fix.q_ic).T
    stars = NO_STARS._replace(hip=np.arange(1, 5), u_c=u_c, u_i=u_i)
    turned = line.fix(fix._replace(stars=stars))
    np.testing.assert_allclose(turned.stars.u_c @ rotation.dcm_from_quat(turned.q_ic).T, u_i, atol=1e-14)
    unsolved = line.fix(star_fix(1, Reason.TOO_FEW_STARS)._replace(stars=stars))
    np.testing.assert_array_equal(unsolved.stars.u_c, turned.stars.u_c)
    wrong = faults.StarLine(
        (star_fault("wrong_fixes", 100.0, 200.0, every=1, smallest=0.1, largest=1.0),), rng
    )
    untouched = wrong.fix(star_fix(1, Reason.TOO_FEW_STARS)._replace(stars=stars))
    np.testing.assert_array_equal(untouched.stars.u_c, u_c)


def test_a_blinded_camera_is_white_and_its_fixes_are_not_touched():
    line = faults.StarLine((star_fault("blinded", 1.0, 2.0),), None)
    picture = Frame(0, 1.2, 1.22, 1.3, 0.05, 0.0, np.zeros((4, 5), np.uint16), bits=12)
    assert np.all(line.picture(picture).image_dn == 4095)
    assert line.picture(picture._replace(t_valid_s=2.5)).image_dn.max() == 0
    assert line.fix(star_fix(1)) is not None and np.array_equal(line.fix(star_fix(1)).q_ic, star_fix(1).q_ic)


def test_every_fault_has_a_begin_and_an_end_in_the_events():
    column = np.zeros(N)
    r_i = np.tile([0.0, 0.0, wgs84.B + 5e4], (N, 1))
    trajectory = Trajectory(*[column] * len(Trajectory._fields))._replace(
        t_s=np.arange(N) / 400.0, r_i=r_i, v_i=np.zeros((N, 3))
    )
    all_of_them = Faults(
        imu=(imu_fault("stuck", 2.0, 3.0, sensor="gyro", axis="y"), imu_fault("dropout", 5.0, 5.1)),
        gps=(gps_fault("freeze", 4.0, 20.0),),
        star_tracker=(star_fault("bias", 1.0, 9.0, angles=(0.01, 0.0, 0.0)),),
    )
    events = faults.events(all_of_them, trajectory, EARTH)
    assert [(event.t_s, event.name) for event in events] == [
        (1.0, "fault_star_tracker_bias"),
        (2.0, "fault_gyro_y_stuck"),
        (3.0, "fault_gyro_y_stuck_end"),
        (4.0, "fault_gps_freeze"),  # its end is after the flight
        (5.0, "fault_imu_dropout"),
        (5.1, "fault_imu_dropout_end"),
        (9.0, "fault_star_tracker_bias_end"),
    ]
    assert all(event.altitude_m == pytest.approx(5e4, abs=1e-3) for event in events)
