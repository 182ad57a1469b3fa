"""The simulated magnetometer: field of the model in body axes, irons, limits, a stream of its own."""

from dataclasses import replace

import numpy as np
import pytest
import synthetic_trajectory
from magnetic_elements import elements, field_n

from shefex_nav.environment import magnetic_field
from shefex_nav.geometry import frames, rotation
from shefex_nav.instruments import magnetometer
from shefex_nav.instruments.instrument import Truth
from shefex_nav.world import noise

GOOD = magnetometer.Magnetometer(
    rate=10.0, latency=0.02, hard_iron=0.0, soft_iron=0.0, noise=0.0, quantum=0.0, range=2e-4
)


@pytest.fixture(scope="module")
def flight():
    return synthetic_trajectory.fly(end_s=20.0)


def fields(flight, seed=1, **changes):
    truth = Truth(flight, synthetic_trajectory.EARTH, 2012.5, np.zeros(3), np.zeros((0, 4)))
    said = magnetometer.measure(replace(GOOD, **changes), truth, noise.generator(seed, 11))
    return np.array([one.field_b for one in said.readings]), said


def test_the_field_is_that_of_the_model_but_for_what_no_model_has(flight):
    """At 69.3 N 16.0 E in 2012: 53 000 nT, 77 deg below the horizon; crust and currents of 200 nT on it."""
    read, said = fields(flight)
    site = synthetic_trajectory.SITE
    told = elements(field_n(magnetic_field.load(2012.5), *site, 10.0))
    assert np.linalg.norm(read[0]) == pytest.approx(told.total, abs=6e-7)
    assert told.total == pytest.approx(52.9e-6, rel=0.01)
    off = []
    for one in said.readings[::10]:
        k = np.argmin(np.abs(flight.t_s - one.t_valid_s))
        C_ie = frames.dcm_ie(synthetic_trajectory.EARTH, one.t_valid_s)
        b_e = magnetic_field.field_e(magnetic_field.load(2012.5), C_ie.T @ flight.r_i[k])
        off.append(one.field_b - rotation.dcm_from_quat(flight.q_ib[k]).T @ C_ie @ b_e)
    sigma = np.linalg.norm(magnetic_field.sigma_n(2012.5))
    assert 0.05 * sigma < np.linalg.norm(off, axis=1).mean() < 3.0 * sigma


def test_a_flight_that_ends_before_the_first_reading_has_none(flight):
    _, said = fields(flight, rate=0.01)
    assert said.readings == []


def test_irons_and_noise_are_as_large_as_said(flight):
    clean, _ = fields(flight)
    read, said = fields(flight, hard_iron=5e-7, soft_iron=3e-3)
    wanted = clean @ (np.eye(3) + said.errors.soft_iron).T + said.errors.hard_iron
    np.testing.assert_allclose(read, wanted, atol=1e-15)
    drawn = [fields(flight, seed=k, hard_iron=5e-7)[1].errors.hard_iron for k in range(40)]
    assert 4e-7 < np.std(drawn) < 6.2e-7  # 99.9 % of 120 draws
    assert (fields(flight, noise=5e-8)[0] - clean).std() == pytest.approx(5e-8, rel=0.1)


def test_readings_stay_in_the_range_and_say_so(flight):
    read, said = fields(flight, range=3e-5, quantum=1.5e-8)
    assert np.abs(read).max() == 3e-5
    at_end = [one.at_limit for one in said.readings]
    assert any(at_end)
    assert at_end == (np.abs(read) >= 3e-5).any(axis=1).tolist()
