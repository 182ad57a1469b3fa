"""The Sun sensor: where the Sun is seen, how wrong the direction is, what the filter learns of it."""

from dataclasses import replace
from functools import cache

import numpy as np
import synthetic_trajectory

from shefex_nav.geometry import frames, rotation
from shefex_nav.instruments import sun_sensor
from shefex_nav.instruments.instrument import Known, Truth, Use
from shefex_nav.instruments.sun_sensor import SunSensor
from shefex_nav.world import noise

SENSOR = SunSensor(
    rate=20.0,
    latency=0.0,
    boresight=(0.0, 1.0, 0.0),
    field_of_view=np.radians(60.0),
    alignment=0.0,
    noise=1e-3,
)


@cache
def flown():
    return synthetic_trajectory.fly(end_s=20.0)


def measured(sensor, sun_i, seed=1):
    flight = flown()
    truth = Truth(flight, synthetic_trajectory.EARTH, 2012.5, sun_i, np.zeros((0, 4)))
    found = sun_sensor.measure(sensor, truth, noise.generator(seed, 1234))
    k = np.searchsorted(flight.t_s, [one.t_valid_s - 1e-9 for one in found.readings])
    true_b = np.array([rotation.dcm_from_quat(flight.q_ib[n]).T @ sun_i for n in k])
    return found, true_b


def overhead():
    """A Sun that stands 30 deg from the vertical, on the side that the spin turns the sensor to."""
    C_ib = rotation.dcm_from_quat(synthetic_trajectory.fly(end_s=1.0).q_ib[0])
    return C_ib @ np.array([0.64, 0.0, -np.sqrt(1.0 - 0.64**2)])


def test_the_sun_is_seen_in_the_field_of_view_alone():
    found, true_b = measured(SENSOR, overhead())
    inside = true_b[:, 1] >= np.cos(np.radians(60.0))
    assert 0 < inside.sum() < len(inside)
    np.testing.assert_array_equal([one.seen for one in found.readings], inside)
    assert all(np.isnan(one.s_b).all() != one.seen for one in found.readings)


def test_behind_the_earth_it_is_not_seen():
    found, _ = measured(replace(SENSOR, field_of_view=np.pi), -overhead())
    assert not any(one.seen for one in found.readings)


def test_noise_is_as_large_as_said_about_each_axis_across():
    found, true_b = measured(replace(SENSOR, field_of_view=np.pi), overhead())
    off = np.array([one.s_b for one in found.readings]) - true_b
    n = 2 * len(off)
    assert abs(np.sum(off**2) / 1e-6 / n - 1.0) < 4.0 * np.sqrt(2.0 / n)
    along = np.abs(np.sum(off * true_b, axis=1))
    assert along.max() < 2e-5  # of second order


def test_the_alignment_error_is_one_rotation_of_all_readings():
    sensor = replace(SENSOR, field_of_view=np.pi, noise=1e-9, alignment=2e-3)
    found, true_b = measured(sensor, overhead())
    turned = true_b @ rotation.dcm_from_rotvec(found.errors).T
    np.testing.assert_allclose([one.s_b for one in found.readings], turned, atol=1e-8)
    drawn = [measured(sensor, overhead(), seed)[0].errors for seed in range(20)]
    assert 1.4e-3 < np.std(drawn) < 2.7e-3  # 99.9 % of 60 draws


def test_it_says_nothing_about_the_direction_of_the_sun():
    """A turn about the Sun leaves the reading as it was."""
    from shefex_nav.onboard.navigation.aiding import Here
    from shefex_nav.onboard.navigation.state import ATT, NavState, layout, pack

    sun_i, q_ib = overhead(), rotation.quat_normalise(np.array([0.3, -0.5, 0.7, 0.2]))
    earth = frames.EarthRotation(np.eye(3), np.eye(3), 0.3, 7.292115e-5)
    zero = np.zeros(3)
    state = NavState(5.0, np.array([6.4e6, 0, 0]), zero, q_ib, zero, zero, others=zero)
    aid = sun_sensor.aid(replace(SENSOR, alignment=2e-3), Use(used=True), Known(2012.5, sun_i))
    order, s_b = layout(("sun_alignment",), aid.blocks), rotation.dcm_from_quat(q_ib).T @ sun_i
    here = Here(order, earth, 5.0, pack(state))
    seen = aid.expect(here, sun_sensor.SunReading(5.0, 5.0, s_b, True))
    np.testing.assert_allclose(seen.R, 1e-6 * np.eye(2))
    np.testing.assert_allclose(aid.blocks[0].P, 4e-6 * np.eye(3))
    np.testing.assert_allclose(seen.z, 0.0, atol=1e-15)
    np.testing.assert_allclose(seen.H[:, ATT] @ s_b, 0.0, atol=1e-15)
    assert np.linalg.matrix_rank(seen.H) == 2
