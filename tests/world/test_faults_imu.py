"""Where faults of the IMU act: wrong bias and scale before range and quanta, the others on what is sent."""

import numpy as np
import pytest
import synthetic_trajectory as synthetic
from fault_kinds import imu_fault, wrong_reading
from imu_settings import PERFECT, imu_with
from test_imu import REAL

from shefex_nav.world import imu, noise

DT_S = 1.0 / synthetic.RATE_HZ
NAMES = {"gyro": ("dtheta_b", "gyro"), "accelerometer": ("dv_b", "accel")}  # increments, of `imu_with`
BOOST = 5.0, 15.0  # s: rate 2.4 to 7.1 rad/s about x, specific force 60 m/s^2
ROWS = slice(6001, 10001)  # samples of (5 s, 15 s]; the flight begins at -10 s


@pytest.fixture(scope="module")
def flight():
    return synthetic.fly()


def measure(params, flight, *wrong):
    return imu.measure(params, flight, noise.generator(1, "imu"), wrong=wrong)


def readings(data, sensor):
    return getattr(data, NAMES[sensor][0])


@pytest.mark.parametrize("sensor", NAMES)
@pytest.mark.parametrize("error", [0.02, -0.03])
@pytest.mark.parametrize("axis", [0, 2])
def test_a_wrong_bias_is_added(flight, sensor, error, axis):
    good = measure(REAL, flight)
    bad = measure(REAL, flight, wrong_reading("bias", sensor, axis, *BOOST, error))
    expected = np.zeros((len(flight.t_s), 3))
    expected[ROWS, axis] = error * DT_S
    quantum = getattr(REAL, sensor).quantum
    more = readings(bad, sensor) - readings(good, sensor)
    np.testing.assert_allclose(more, expected, atol=2.01 * quantum)
    np.testing.assert_allclose(more.sum(axis=0), expected.sum(axis=0), atol=1.01 * quantum)
    other = "gyro" if sensor == "accelerometer" else "accelerometer"
    assert np.array_equal(readings(bad, other), readings(good, other))


@pytest.mark.parametrize("sensor", NAMES)
@pytest.mark.parametrize("error", [0.1, -0.05])
def test_a_wrong_scale_reads_more_by_its_factor(flight, sensor, error):
    good, bad = (
        measure(PERFECT, flight, *wrong)
        for wrong in ((), (wrong_reading("scale", sensor, 0, *BOOST, error),))
    )
    expected = readings(good, sensor).copy()
    assert expected[ROWS, 0].min() > 0.0
    expected[ROWS, 0] *= 1.0 + error
    np.testing.assert_allclose(readings(bad, sensor), expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("kind", ["bias", "scale"])
@pytest.mark.parametrize("sensor", NAMES)
def test_what_exceeds_the_range_is_held_counted_and_flagged(flight, kind, sensor):
    """Twice as much, or 0.6 of the range more: full scale at most, in whole counts, and flagged."""
    name, unit = NAMES[sensor]
    values = getattr(flight, name)[ROWS, 0]
    full = 1.25 * np.abs(getattr(flight, name)).max()
    params = imu_with(PERFECT, **{f"{unit}_range": full / DT_S, f"{unit}_quantum": full / 1000.5})
    good = measure(params, flight)
    assert not good.saturated.any()
    error = 1.0 if kind == "scale" else 0.6 * full / DT_S
    bad = measure(params, flight, wrong_reading(kind, sensor, 0, *BOOST, error))
    counts = readings(bad, sensor) / (full / 1000.5)
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)
    assert np.abs(counts).max() <= 1001
    beyond = 2.0 * values >= full if kind == "scale" else values + 0.6 * full >= full
    assert beyond.any()
    expected = np.zeros(len(flight.t_s), dtype=bool)
    expected[ROWS] = beyond
    assert np.array_equal(bad.saturated, expected)


@pytest.mark.parametrize("kind", ["stuck", "dead", "repeat"])
def test_flags_go_with_the_readings_that_are_sent(flight, kind):
    """An accelerometer at the end of its range from ignition on; the fault ends with the burn still on."""
    params = imu_with(PERFECT, accel_range=40.0)
    what = {} if kind == "repeat" else {"sensor": "accelerometer", "axis": "x"}
    fault = imu_fault(kind, *BOOST, **what)
    good, bad = measure(params, flight), measure(params, flight, fault)
    assert good.saturated[ROWS].all()
    assert np.all(bad.saturated[ROWS] == (kind != "dead"))
    before = imu_fault(kind, -5.0, 5.0, **what)  # repeats readings of the pad
    bad = measure(params, flight, before)
    assert not bad.saturated[2001:6001].any() and bad.saturated[ROWS].all()


def test_a_stuck_axis_repeats_what_a_faulty_sensor_sent(flight):
    """Wrong scale, then stuck: a whole number of counts within the range, whichever stands first."""
    wrong = (
        wrong_reading("scale", "accelerometer", 0, 0.0, 15.0, 0.5),
        imu_fault("stuck", *BOOST, sensor="accelerometer", axis="x"),
    )
    params = imu_with(PERFECT, accel_range=80.0, accel_quantum=0.003)
    one, other = measure(params, flight, *wrong), measure(params, flight, *wrong[::-1])
    assert np.array_equal(one.dv_b, other.dv_b)
    scaled = measure(params, flight, wrong[0])
    assert np.all(one.dv_b[ROWS, 0] == scaled.dv_b[6000, 0]) and one.saturated[ROWS].all()
    assert abs(one.dv_b[6000, 0] - 80.0 * DT_S) <= 0.003


def test_a_fault_moves_nothing_else(flight):
    """Not a bit before it, none of the draws, and no other axis."""
    good = measure(REAL, flight)
    bad = measure(REAL, flight, wrong_reading("scale", "gyro", 1, *BOOST, 0.5))
    assert np.array_equal(good.dv_b, bad.dv_b)
    assert np.array_equal(good.dtheta_b[:, [0, 2]], bad.dtheta_b[:, [0, 2]])
    assert np.array_equal(good.dtheta_b[: ROWS.start], bad.dtheta_b[: ROWS.start])
    assert np.allclose(good.dtheta_b[ROWS.stop :], bad.dtheta_b[ROWS.stop :], atol=2.01 * REAL.gyro.quantum)


def test_events_name_unit_and_size():
    some = (
        wrong_reading("bias", "accelerometer", 2, 1.0, 2.0, -0.05),
        wrong_reading("scale", "accelerometer", 0, 1.0, 2.0, 0.01),
        wrong_reading("bias", "gyro", 1, 1.0, 2.0, np.radians(0.1)),
    )
    assert [(fault.name, fault.words) for fault in some] == [
        ("accelerometer_z_bias", "-0.05 m/s^2"),
        ("accelerometer_x_scale", "10000 ppm"),
        ("gyro_y_bias", "0.1 deg/s"),
    ]
