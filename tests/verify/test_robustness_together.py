"""A flight and its twin fly together until something differs: bit by bit as if each had flown alone."""

import numpy as np
import pytest

from shefex_nav import simulate
from shefex_nav.clock import SAME_S
from shefex_nav.verify.robustness import flight, running
from shefex_nav.world import imu

CUT_S = 262.0  # of flights here: 18 s of stars


@pytest.fixture
def brief(monkeypatch):
    monkeypatch.setattr(flight, "last_s", lambda vehicle: CUT_S)


def job_and_vehicle(seed=4):
    (job, *_) = running.jobs(running.request(["shefex2_andoya"], (), 1, None, seed, 0))
    job = job._replace(cell=job.cell._replace(grade="own", told="right"))
    return job, flight._vehicle(job.scenario, flight.of_rocket(job))


def situation(job, *settings, **changed):
    true = flight.scenario_of(job.scenario, flight.overrides(job))
    told = flight.factors.TOLD["right"]
    return flight.Situation((), None, told, true, settings, **changed)


STARS = "faults.star_tracker=[{fault: wrong_fixes, from: 255 s, until: 258 s, every: 3, smallest: 1 deg, "
STARS += "largest: 5 deg}]"
GPS = "faults.gps=[{fault: jump, from: 252.5 s, until: 255 s, position: [0 m, 30 m, 0 m]}]"
IMU = "faults.imu=[{fault: gyro_bias, axis: x, rate: 0.02 rad/s, from: 251 s, until: 256 s}]"


def assert_same(one, two):
    for name in ("solution", "covariance", "truth"):
        for a, b in zip(getattr(one, name), getattr(two, name), strict=True):
            np.testing.assert_array_equal(a, b)
    assert [repr(gate) for gate in one.gates] == [repr(gate) for gate in two.gates]
    assert one.health == two.health
    assert list(one.seen) == list(two.seen)
    for key, seen in one.seen.items():
        np.testing.assert_array_equal(seen.z, two.seen[key].z)
        np.testing.assert_array_equal(seen.S, two.seen[key].S)


@pytest.mark.slow
def test_flights_that_part_are_what_each_is_alone(brief):
    job, vehicle = job_and_vehicle()
    situations = [situation(job, STARS, IMU), situation(job), situation(job, IMU), situation(job, GPS)]
    together = flight._fly(job, situations, vehicle)
    for one, flown in zip(situations, together, strict=True):
        (alone,) = flight._fly(job, [one], vehicle)
        assert_same(flown, alone)
    ends = [repr(one.solution.r_i[-1]) for one in together]
    assert len(set(ends)) == len(ends)  # each fault did something
    assert len(together[0].gates) > 300


def worlds(job, vehicle, *settings):
    situations = [situation(job), situation(job, *settings)]
    return [world for _, world in flight._scenarios_and_worlds(job, situations, vehicle)]


def tick_of(world, t_s):
    """Number of ticks that end before an instant."""
    return int(np.searchsorted(imu.stacked(world.imu).t_valid_s + SAME_S, t_s))


def test_worlds_are_alike_until_the_first_thing_that_differs():
    job, vehicle = job_and_vehicle()
    healthy, jumps = worlds(job, vehicle, GPS)
    pairs = zip(healthy.gps_fixes, jumps.gps_fixes, strict=True)
    differ = [a for a, b in pairs if a.valid and not np.array_equal(a.r_ea_e, b.r_ea_e)]
    changed = min(fix.t_available_s for fix in differ)
    assert simulate.ticks_alike(healthy, jumps) == tick_of(healthy, changed)
    healthy, biased = worlds(job, vehicle, IMU)
    first = int(np.argmax((healthy.imu.dtheta_b != biased.imu.dtheta_b).any(axis=1)))
    assert simulate.ticks_alike(healthy, biased) == (first - 1) // 4
    healthy, wrong = worlds(job, vehicle, STARS)
    assert simulate.ticks_alike(healthy, wrong) == tick_of(healthy, 255.0)
    assert simulate.ticks_alike(healthy, healthy) == len(imu.stacked(healthy.imu).t_valid_s)


def test_a_world_with_other_settings_than_faults_is_flown_from_the_start(brief, monkeypatch):
    job, vehicle = job_and_vehicle()
    monkeypatch.setattr(simulate, "ticks_alike", lambda *_: pytest.fail("is not to be asked"))
    shaken = situation(job, *flight.factors.shaken(flight.scenario_of(job.scenario, ()), 5.0))
    flown = flight._fly(job, [shaken, situation(job)], vehicle)
    assert not np.array_equal(flown[0].solution.r_i, flown[1].solution.r_i)
