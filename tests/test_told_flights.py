"""A computer that is told other figures of its sensors than are true, and clocks that do not agree."""

import numpy as np
import pytest
from faulty_flight import fly

NAME, UNTIL_S = "shefex2_andoya", 150.0
LATE = "gps.clock_offset=20 ms"


def worst(flown, begin_s=60.0):
    """Largest errors of position, m, and by their sigmas."""
    k = flown.t_s >= begin_s
    return np.linalg.norm(flown.error[k, :3], axis=1).max(), (np.abs(flown.error[k]) / flown.sigma[k]).max()


def speed(flown):
    """Of the vehicle over the ground, m/s, largest."""
    return np.linalg.norm(flown.world.flight.trajectory.v_i, axis=1).max()


@pytest.mark.slow
def test_a_clock_offset_that_nobody_knows_moves_the_vehicle_along_its_way():
    """20 ms too late at 2 km/s are 40 m; the filter does not know, and is off by many sigmas."""
    flown = fly(NAME, LATE, until_s=UNTIL_S)
    error_m, ratio = worst(flown)
    assert 0.5 < error_m / (0.02 * speed(flown)) < 5.0 and ratio > 3.0 * worst(fly(NAME, until_s=UNTIL_S))[1]


@pytest.mark.parametrize("known", ["clock_offset=20 ms", "latency=0.2 s"])
def test_one_that_is_told_does_nothing(known):
    """By the offset, or by counting back from the arrival."""
    told = fly(NAME, LATE, f"navigation.told.gps.{known}", until_s=UNTIL_S)
    healthy = fly(NAME, until_s=UNTIL_S)
    np.testing.assert_allclose(told.error, healthy.error, atol=1e-6)
    assert worst(told)[1] < 5.0


def test_stamps_alone_differ():
    late, healthy = fly(NAME, LATE, until_s=UNTIL_S).world, fly(NAME, until_s=UNTIL_S).world
    for fix, good in zip(late.gps_fixes, healthy.gps_fixes, strict=True):
        assert fix.t_valid_s == good.t_valid_s + 0.02 and fix.t_available_s == good.t_available_s
        assert np.array_equal(fix.r_ea_e, good.r_ea_e, equal_nan=True)
    assert all(one.t_valid_s == two.t_valid_s + 0.02
               for one, two in zip(late.gps_ranges, healthy.gps_ranges, strict=True))  # fmt: skip
    assert np.array_equal(late.imu.dv_b, healthy.imu.dv_b)


def test_stamps_from_the_future_are_refused():
    flown = fly(NAME, "gps.clock_offset=300 ms", until_s=20.0)
    notes = {gate.note for gate in flown.gates if not gate.note.startswith("no fix")}
    assert notes == {"from the future"}
    assert not flown.used("gps_position")


@pytest.mark.slow
def test_a_computer_that_is_told_too_little_noise_is_too_sure():
    """And one that is told ten times as much is not."""
    little = fly(NAME, "navigation.told.gps.range_noise=0.3 m", until_s=UNTIL_S)
    much = fly(NAME, "navigation.told.gps.range_noise=15 m", until_s=UNTIL_S)
    assert worst(little)[1] > 6.0 and len(little.used("gps_position")) < 0.7 * len(much.used("gps_position"))
    assert worst(much)[1] < 4.0


def test_vibration_five_times_what_the_computer_is_told():
    """The world shakes so; the filter, made for the level that it was told, finds out and admits more."""
    boost = "navigation.told.imu.vibration.boost=[7 gee, 3.5 gee]"
    shaken = fly(NAME, "imu.vibration.boost=[35 gee, 17.5 gee]", boost, until_s=UNTIL_S)
    calm = fly(NAME, until_s=UNTIL_S)
    burning = slice(20 * 400, 50 * 400)  # 10 s to 40 s
    swing = [np.diff(flown.world.imu.dv_b[burning, 1]).std() for flown in (shaken, calm)]
    assert 4.5 < swing[0] / swing[1] < 5.5
    assert shaken.world.computer.nav.imu == calm.world.computer.nav.imu
    boosted = (shaken.t_s > 20.0) & (shaken.t_s < 40.0)
    velocity = slice(3, 6)
    assert shaken.sigma[boosted, velocity].mean() > 3.0 * calm.sigma[boosted, velocity].mean()
    assert worst(shaken, 20.0)[1] < 5.0


def test_delayed_fixes_are_used_at_their_instant_while_the_memory_reaches():
    delayed = fly(NAME, "faults.gps=[{fault: delay, by: 0.3 s, from: 100 s, until: 120 s}]", until_s=UNTIL_S)
    healthy = fly(NAME, until_s=UNTIL_S)
    assert delayed.used("gps_position") == healthy.used("gps_position")
    assert worst(delayed)[1] < 5.0
    later = fly(NAME, "faults.gps=[{fault: delay, by: 3 s, from: 100 s, until: 120 s}]", until_s=UNTIL_S)
    notes = {gate.note for gate in later.gates if 100.0 <= gate.t_valid_s < 120.0}
    assert notes == {"older than the history"} and worst(later)[1] < 5.0


@pytest.mark.parametrize("fault", ["dropout", "repeat"])
@pytest.mark.parametrize("duration_s", [0.01, 0.2, 2.0])
def test_a_gap_in_the_samples_is_admitted(fault, duration_s):
    """Under thrust, in the spin: what is held instead is wrong, and the filter says by how much."""
    gap = f"faults.imu=[{{fault: {fault}, from: 30 s, until: {30.0 + duration_s} s}}]"
    flown = fly(NAME, gap, until_s=40.0)
    assert worst(flown, 29.9)[1] < 5.0
    assert [healthy for _, healthy in flown.noticed("imu")][-1] == ""
    assert len(flown.noticed("imu")) == 2
