"""Faults at the edges: before anything good was heard, at the ends of a flight, several at a time."""

import numpy as np
import pytest
from fault_kinds import gps_fault, imu_fault, star_fault
from scipy import stats
from test_faults import EARTH, gps_fix, star_fix

from shefex_nav.geometry import rotation, wgs84
from shefex_nav.records import Frame, GpsRanges, Reason, Trajectory
from shefex_nav.world import faults, gps
from shefex_nav.world.fault_settings import Faults

RATE_HZ = 400.0
CHANNELS = (
    "prn", "pseudorange", "range_rate", "r_es_e", "v_es_e", "sigma_range", "sigma_range_rate",
    "sigma_lasting", "sigma_shared",
)  # fmt: skip


def readings(count=41):
    """Ends of samples (N,) s, and increments of two triads (N, 3) which all differ."""
    values = np.arange(1.0, 6.0 * count + 1.0).reshape(2, count, 3)
    return np.arange(count) / RATE_HZ, values[0], values[1]


def sent(*wrong, count=41):
    t_s, dtheta_b, dv_b = readings(count)
    flags = np.ones((2, count, 3), dtype=bool)
    missing = faults.imu_sent(wrong, t_s, dtheta_b, dv_b, flags)
    return dtheta_b, dv_b, flags, missing


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer"])
def test_an_axis_that_is_stuck_from_before_the_flight_repeats_its_first_reading(sensor):
    """One axis of one triad, with the flag that goes with it; the other triad goes on."""
    dtheta_b, dv_b, flags, missing = sent(imu_fault("stuck", -5.0, 0.05, sensor=sensor, axis="y"))
    _, *good = readings()
    bad, other = (dtheta_b, dv_b) if sensor == "gyro" else (dv_b, dtheta_b)
    before, whole = good if sensor == "gyro" else good[::-1]
    assert np.all(bad[:21, 1] == before[0, 1]) and np.array_equal(bad[21:], before[21:])
    assert np.array_equal(bad[:, [0, 2]], before[:, [0, 2]]) and np.array_equal(other, whole)
    assert flags.all() and not missing.any()


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer"])
def test_an_axis_that_is_stuck_keeps_the_flag_of_its_last_good_reading(sensor):
    """At the end of its range before the fault, and within it while it is stuck; and the other way round."""
    triad = ("gyro", "accelerometer").index(sensor)
    for was_at_end in (True, False):
        t_s, dtheta_b, dv_b = readings()
        flags = np.full((2, 41, 3), not was_at_end)
        flags[triad, 4, 1] = was_at_end  # of the sample before the first that is stuck
        faults.imu_sent(
            (imu_fault("stuck", 0.01, 0.02, sensor=sensor, axis="y"),), t_s, dtheta_b, dv_b, flags
        )
        assert np.flatnonzero(flags[triad, :, 1] == was_at_end).tolist() == [4, 5, 6, 7, 8]


def test_a_fault_from_the_first_sample_on_acts_on_the_second():
    """Nothing was sent before the first: it is left as it is."""
    dtheta_b, _, flags, missing = sent(imu_fault("dead", -1.0, 1.5 / RATE_HZ, sensor="gyro", axis="x"))
    assert np.flatnonzero(dtheta_b[:, 0] == 0.0).tolist() == [1, 2] and not missing.any()
    assert np.flatnonzero(~flags[0, :, 0]).tolist() == [1, 2]


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer"])
def test_a_dead_axis_reads_zero_and_is_at_no_range(sensor):
    dtheta_b, dv_b, flags, _ = sent(imu_fault("dead", 0.01, 0.02, sensor=sensor, axis="z"))
    triad = ("gyro", "accelerometer").index(sensor)
    bad, rows = (dtheta_b, dv_b)[triad], np.arange(5, 9)  # samples that end within (10, 20] ms
    assert np.flatnonzero(bad[:, 2] == 0.0).tolist() == rows.tolist()
    cleared = np.argwhere(~flags)
    assert cleared.tolist() == [[triad, row, 2] for row in rows]


def test_samples_that_are_not_sent_are_those_that_begin_within_the_dropout():
    *_, missing = sent(imu_fault("dropout", 0.01, 0.02))
    assert np.flatnonzero(missing).tolist() == [5, 6, 7, 8]
    *_, missing = sent(imu_fault("dropout", 1.0, 2.0))  # after the last sample
    assert missing.dtype == bool and not missing.any()


def test_blocks_repeat_from_the_block_in_which_the_fault_begins():
    """Blocks are rows 1 to 4, 5 to 8, ...; a fault from the middle of the third repeats the second.

    Of the first block there is nothing to repeat.
    """
    dtheta_b, dv_b, *_ = sent(imu_fault("repeat", 10 / RATE_HZ, 16 / RATE_HZ))
    _, good, other = readings()
    for bad, before in ((dtheta_b, good), (dv_b, other)):
        expected = before.copy()
        expected[9:13], expected[13:17] = before[5:9], before[5:9]
        np.testing.assert_array_equal(bad, expected)
    middle, *_ = sent(imu_fault("repeat", 10 / RATE_HZ, 13.5 / RATE_HZ))  # ends in the middle of a block
    np.testing.assert_array_equal(middle, dtheta_b)
    last, *_ = sent(imu_fault("repeat", 10 / RATE_HZ, 13.5 / RATE_HZ), count=15)  # the flight ends there
    np.testing.assert_array_equal(last, dtheta_b[:15])
    dtheta_b, dv_b, *_ = sent(imu_fault("repeat", 2 / RATE_HZ, 16 / RATE_HZ))
    assert np.array_equal(dtheta_b, good) and np.array_equal(dv_b, other)


@pytest.mark.parametrize("sensor", ["gyro", "accelerometer"])
def test_scale_multiplies_and_bias_adds_whatever_the_sign(sensor):
    """A scale of +10 % makes a rate of -1 rad/s read -1.1; a bias of 0.2 /s adds 0.2 dt to every sample."""
    t_s, key = np.arange(41) / RATE_HZ, "rate" if sensor == "gyro" else "acceleration"
    for kind, error in (("scale", {"factor": 0.1}), ("bias", {key: 0.2})):
        increments = np.full((2, 41, 3), -1.0)
        wrong = (imu_fault(f"{sensor}_{kind}", 0.025, 0.05, axis="x", **error),)
        faults.imu_sensed(wrong, t_s, *increments)
        expected = np.full((2, 41, 3), -1.0)
        expected[int(sensor != "gyro"), 11:21, 0] = -1.1 if kind == "scale" else -1.0 + 0.2 / RATE_HZ
        np.testing.assert_allclose(increments, expected, rtol=1e-12)


@pytest.mark.parametrize("turned", [False, True])
def test_what_repeats_has_what_was_sent_when_it_began_whatever_the_order_of_the_list(turned):
    """An axis that is dead when it gets stuck stays at zero; a receiver that freezes stays displaced."""

    def listed(*wrong):
        return wrong[::-1] if turned else wrong

    dead = imu_fault("dead", 0.03, 0.07, sensor="gyro", axis="x")
    stuck = imu_fault("stuck", 0.05, 0.09, sensor="gyro", axis="x")
    dtheta_b, *_ = sent(*listed(dead, stuck))
    good = readings()[1][:, 0]
    expected = np.where((np.arange(41) > 12) & (np.arange(41) <= 36), 0.0, good)
    np.testing.assert_array_equal(dtheta_b[:, 0], expected)
    jump = gps_fault("jump", 2.0, 7.0, position=(300.0, 0.0, 0.0))
    got = faults.gps(listed(jump, gps_fault("freeze", 5.0, 10.0)), [gps_fix(float(t)) for t in range(12)])
    before = gps_fix(4.0).r_ea_e
    off = np.array([np.linalg.norm(fix.r_ea_e - before) for fix in got[4:10]])
    np.testing.assert_allclose(off, [300.0, 300.0, 300.0, 300.0, 300.0, 300.0], atol=0.5)
    told, antenna = messages()
    got = faults.gps_ranges(
        listed(gps_fault("freeze", 3.0, 6.0), gps_fault("outage", 2.0, 4.0)), told, antenna
    )
    assert [one.reason for one in got] == ["lost", "", "outage", "", "", ""]
    for one in got[3:]:
        np.testing.assert_array_equal(one.pseudorange, told[1].pseudorange)


def test_an_outage_leaves_no_number_of_the_fix():
    (fix,) = faults.gps((gps_fault("outage", 0.0, 2.0),), [gps_fix(1.0)])
    for name, shape in (("r_ea_e", (3,)), ("v_ea_e", (3,)), ("R_r_e", (3, 3)), ("R_v_e", (3, 3))):
        value = getattr(fix, name)
        assert value.shape == shape and np.isnan(value).all()
    assert np.isnan(fix.pdop) and (fix.t_valid_s, fix.t_available_s) == (1.0, 1.2)


def test_a_receiver_that_has_no_fix_cannot_freeze_nor_be_displaced():
    fixes = [gps_fix(0.0, valid=False), gps_fix(1.0, valid=False), gps_fix(2.0)]
    wrong = gps_fault("freeze", 0.0, 2.0), gps_fault("jump", 0.0, 2.0, position=(1.0, 2.0, 3.0))
    assert all(one is other for one, other in zip(faults.gps(wrong, fixes), fixes, strict=True))


def test_a_drift_that_leaves_the_velocity_alone_grows_from_its_start():
    (fix,) = faults.gps((gps_fault("drift", 4.0, 9.0, rate=(0.0, 0.0, -2.0)),), [gps_fix(7.0)])
    up_e = gps_fix(7.0).r_ea_e / np.linalg.norm(gps_fix(7.0).r_ea_e)
    assert up_e @ (fix.r_ea_e - gps_fix(7.0).r_ea_e) == pytest.approx(6.0, rel=1e-4)  # up by 2 m/s for 3 s
    np.testing.assert_array_equal(fix.v_ea_e, gps_fix(7.0).v_ea_e)


def messages(lost=(0,)):
    """Ranges of two satellites at 1 Hz, some without any; and the antenna."""
    told, t_s = [], np.arange(6.0)
    r_e = wgs84.ecef_from_geodetic(1.2, 0.3, 1e5) + np.outer(t_s, [1000.0, 500.0, 200.0])
    for t in t_s:
        k = 0 if t in lost else 2
        numbers = {name: np.arange(1.0, k + 1.0) + 10.0 * t for name in CHANNELS}
        places = {"r_es_e": 2e7 * np.eye(3)[:k], "v_es_e": 4e3 * np.eye(3)[:k]}
        fields = {**dict.fromkeys(GpsRanges._fields), **numbers, **places}
        told.append(
            GpsRanges(**{**fields, "t_valid_s": t, "t_available_s": t + 0.2, "reason": "" if k else "lost"})
        )
    v_e, unused = np.tile([1000.0, 500.0, 200.0], (6, 1)), np.zeros((6, 3))
    return told, gps.Antenna(t_s, r_e, v_e, unused, unused[:, 0])


def test_frozen_ranges_are_the_last_that_were_heard():
    """Those of 0 s and 3 s have no satellite; nothing was heard before 1 s."""
    told, antenna = messages(lost=(0, 3))
    for time, stamps in (("runs", [4.0, 5.0]), ("stands", [2.0, 2.0])):
        got = faults.gps_ranges((gps_fault("freeze", 4.0, 9.0, time=time),), told, antenna)
        assert all(one is other for one, other in zip(got[:4], told[:4], strict=True))
        for one, arrived, stamp in zip(got[4:], told[4:], stamps, strict=True):
            assert (one.t_valid_s, one.t_available_s) == (stamp, arrived.t_available_s)
            np.testing.assert_array_equal(one.pseudorange, told[2].pseudorange)
    first = faults.gps_ranges((gps_fault("freeze", -1.0, 1.0),), told, antenna)
    assert first[0] is told[0]


def test_ranges_of_an_outage_have_no_satellite_and_those_of_a_delay_come_later():
    told, antenna = messages()
    got = faults.gps_ranges((gps_fault("outage", 2.0, 3.0),), told, antenna)
    assert got[2].reason == "outage" and got[2].t_valid_s == 2.0
    assert all(len(getattr(got[2], name)) == 0 for name in CHANNELS)
    assert [one.reason for one in got] == ["lost", "", "outage", "", "", ""]
    for time, late_s in (("right", 0.0), ("late", 0.5)):
        got = faults.gps_ranges((gps_fault("delay", 2.0, 3.0, by=0.5, time=time),), told, antenna)
        assert (got[2].t_valid_s, got[2].t_available_s) == (2.0 + late_s, 2.7)
        assert got[2].pseudorange is told[2].pseudorange


def test_wrong_fixes_are_drawn_evenly_by_the_logarithm_of_their_angle_about_any_axis():
    """Kolmogorov and Smirnov: the logarithm of the angle, and the height of the axis on its sphere."""
    fault = star_fault("wrong_fixes", 0.0, 1e6, every=1, smallest=0.01, largest=2.0)
    line, fix = faults.StarLine((fault,), np.random.default_rng(4)), star_fix(1)
    turned = np.array([rotation.rotvec_between(fix.q_ic, line.fix(fix).q_ic) for _ in range(400)])
    angle = np.linalg.norm(turned, axis=1)
    evenly = np.log(angle / 0.01) / np.log(2.0 / 0.01)
    assert stats.kstest(evenly, "uniform").pvalue > 1e-3
    for k in range(3):  # Archimedes: evenly between -1 and 1
        assert stats.kstest((turned[:, k] / angle + 1.0) / 2.0, "uniform").pvalue > 1e-3


def test_faults_of_star_fixes_turn_one_after_the_other():
    """Two biases at a time: exp(a) exp(b); every third fix is counted for each fault from its own begin."""
    a, b = (0.1, 0.0, 0.0), (0.0, 0.2, 0.0)
    line = faults.StarLine(
        (star_fault("bias", 0.0, 1e3, angles=a), star_fault("bias", 0.0, 1e3, angles=b)), None
    )
    q, expected = line.fix(star_fix(1)).q_ic, star_fix(1).q_ic
    for one in (a, b):
        expected = rotation.quat_multiply(expected, rotation.quat_from_rotvec(np.array(one)))
    assert np.linalg.norm(rotation.rotvec_between(expected, q)) < 1e-12
    wrong = [
        star_fault("wrong_fixes", 100.0 + 0.1 * first - 0.05, 200.0, every=3, smallest=0.3, largest=0.4)
        for first in (1, 2)
    ]
    line = faults.StarLine(tuple(wrong), np.random.default_rng(1))
    bad = [k for k in range(9) if np.any(line.fix(star_fix(k)).q_ic != star_fix(k).q_ic)]
    assert bad == [1, 2, 4, 5, 7, 8]


def test_only_light_blinds_and_only_while_it_falls_in():
    picture = Frame(0, 1.5, 1.52, 1.6, 0.05, 0.0, np.full((3, 4), 7, np.uint16), bits=10)
    blinded, biased = star_fault("blinded", 1.0, 2.0), star_fault("bias", 1.0, 2.0, angles=(0.1, 0.0, 0.0))
    assert faults.StarLine((biased,), None).picture(picture) is picture
    both = faults.StarLine((biased, blinded), None)
    assert np.all(both.picture(picture).image_dn == 1023)
    assert both.blinds(1.0) and not both.blinds(2.0) and not both.blinds(0.99)


def test_events_tell_the_height_at_their_time():
    """A climb at 1 km/s along the pole: 3 km higher at the end. Faults outside the flight leave no event."""
    t_s = 2.0 + np.arange(1001) / 100.0  # until 12 s
    r_i = np.outer(wgs84.B + 1000.0 * t_s, [0.0, 0.0, 1.0])
    trajectory = Trajectory(*[np.zeros(1001)] * len(Trajectory._fields))._replace(
        t_s=t_s, r_i=r_i, v_i=np.zeros((1001, 3))
    )
    some = Faults(
        imu=(imu_fault("dropout", 2.0, 12.0),),
        gps=(gps_fault("delay", 4.0, 7.0, by=0.5), gps_fault("outage", 12.5, 14.0)),
        star_tracker=(star_fault("blinded", -1.0, 1.5), star_fault("blinded", 1.0, 5.555)),
    )
    instruments = {"barometer": [imu_fault("dropout", 3.0, 30.0)]}
    found = faults.events(some, trajectory, EARTH, instruments)
    assert [(one.t_s, one.name) for one in found] == [
        (2.0, "fault_imu_dropout"),
        (3.0, "fault_barometer_dropout"),
        (4.0, "fault_gps_delay"),
        (5.555, "fault_star_tracker_blinded_end"),
        (7.0, "fault_gps_delay_end"),
        (12.0, "fault_imu_dropout_end"),
    ]
    for one in found:
        assert one.altitude_m == pytest.approx(1000.0 * one.t_s, abs=10.001)  # to a row of the trajectory
        if one.t_s != 5.555:
            assert one.altitude_m == pytest.approx(1000.0 * one.t_s, abs=0.01)
    assert [one.detail for one in found if one.name == "fault_gps_delay"] == ["0.5 s"]
    assert {one.detail for one in found if one.name.endswith("_end")} == {""}


def test_an_unsolved_frame_without_stars_is_left_alone():
    line = faults.StarLine((star_fault("bias", 0.0, 1e3, angles=(0.1, 0.0, 0.0)),), None)
    empty = star_fix(1, Reason.TOO_FEW_STARS)
    assert empty.stars is not None and line.fix(empty) is empty
