"""A jump or a drift of the GPS position is in the ranges too: their own solution is displaced by it."""

import numpy as np
import pytest
import synthetic_trajectory as synthetic
from fault_kinds import gps_fault
from range_solution import solved_position, solved_velocity
from test_gps_ranges import PARAMS, measure

from shefex_nav.geometry import wgs84
from shefex_nav.settings import changed
from shefex_nav.world import faults

START_S, END_S = 35.0, 45.0  # of the fault; at least five satellites throughout
MOVED_N = np.array([300.0, -200.0, 80.0])
RATE_N = np.array([2.0, -1.0, 0.5])


@pytest.fixture(scope="module")
def data():
    return measure(changed(PARAMS, {"spin.loss": 0.0, "outages": ()}), synthetic.fly())


def north_east_down(moved_e, r_e):
    return wgs84.dcm_en(*wgs84.geodetic_from_ecef(r_e)[:2]).T @ moved_e


def displacements(data, ranges):
    """Time, by how much position and velocity that are solved from the ranges differ: north, east, down."""
    for before, now, r_e in zip(data.ranges, ranges, data.antenna.r_ea_e, strict=True):
        good, bad = (solved_position(one, r_e) for one in (before, now))
        # velocities are seen from where their positions are
        v_good, v_bad = solved_velocity(before, r_e), solved_velocity(now, r_e + bad - good)
        yield now.t_valid_s, north_east_down(bad - good, r_e), north_east_down(v_bad - v_good, r_e)


@pytest.mark.parametrize(
    ("fault", "position", "velocity"),
    [
        (gps_fault("jump", START_S, END_S, position=tuple(MOVED_N)), lambda _: MOVED_N, 0.0 * RATE_N),
        (
            gps_fault("jump", START_S, END_S, position=tuple(100.0 * MOVED_N)),
            lambda _: 100.0 * MOVED_N,
            0.0 * RATE_N,
        ),
        (gps_fault("drift", START_S, END_S, rate=tuple(RATE_N)), lambda s: s * RATE_N, 0.0 * RATE_N),
        (
            gps_fault("drift", START_S, END_S, rate=tuple(RATE_N), velocity_too=True),
            lambda s: s * RATE_N,
            RATE_N,
        ),
    ],
)
def test_the_solution_of_the_ranges_is_displaced(data, fault, position, velocity):
    """To 10 mm of 37 km: what the noise of the ranges makes of other lines of sight."""
    ranges = faults.gps_ranges((fault,), data.ranges, data.antenna)
    acted = 0
    for t_s, moved_n, faster_n in displacements(data, ranges):
        acts = START_S <= t_s < END_S
        wanted = position(t_s - START_S) if acts else np.zeros(3)
        np.testing.assert_allclose(moved_n, wanted, atol=1e-3 + 1e-6 * np.abs(wanted).max())
        np.testing.assert_allclose(faster_n, velocity * acts, atol=2e-3 if acts else 1e-9)
        acted += acts
    assert acted == END_S - START_S


def test_ranges_and_fixes_are_displaced_alike(data):
    fault = gps_fault("drift", START_S, END_S, rate=tuple(10.0 * RATE_N), velocity_too=True)
    ranges = faults.gps_ranges((fault,), data.ranges, data.antenna)
    fixes = faults.gps((fault,), data.fixes)
    for fix, before, now, good in zip(fixes, data.ranges, ranges, data.fixes, strict=True):
        moved_e = solved_position(now, good.r_ea_e) - solved_position(before, good.r_ea_e)
        np.testing.assert_allclose(moved_e, fix.r_ea_e - good.r_ea_e, atol=2e-3)


def test_faults_add_up_and_a_frozen_set_is_displaced_from_where_it_was_measured(data):
    freeze = gps_fault("freeze", START_S, END_S)
    jump = gps_fault("jump", START_S, END_S, position=tuple(100.0 * MOVED_N))
    frozen = faults.gps_ranges((freeze,), data.ranges, data.antenna)
    both = faults.gps_ranges((freeze, jump, jump), data.ranges, data.antenna)
    k = next(k for k, one in enumerate(data.ranges) if one.t_valid_s == START_S - 1.0)
    r_e = data.antenna.r_ea_e[k]
    once_e = wgs84.dcm_en(*wgs84.geodetic_from_ecef(r_e)[:2]) @ (100.0 * MOVED_N)
    twice_e = once_e + wgs84.dcm_en(*wgs84.geodetic_from_ecef(r_e + once_e)[:2]) @ (100.0 * MOVED_N)
    for one, other in zip(frozen[k + 1 : k + 11], both[k + 1 : k + 11], strict=True):
        moved_e = solved_position(other, r_e) - solved_position(one, r_e)
        np.testing.assert_allclose(moved_e, twice_e, atol=0.1)


def test_to_first_order_it_is_minus_the_line_of_sight_times_the_displacement(data):
    fault = gps_fault("jump", START_S, END_S, position=tuple(MOVED_N))
    ranges = faults.gps_ranges((fault,), data.ranges, data.antenna)
    for before, now, r_e in zip(data.ranges, ranges, data.antenna.r_ea_e, strict=True):
        if not START_S <= now.t_valid_s < END_S:
            assert now is before
            continue
        u = before.r_es_e - r_e
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        moved_e = wgs84.dcm_en(*wgs84.geodetic_from_ecef(r_e)[:2]) @ MOVED_N
        np.testing.assert_allclose(now.pseudorange - before.pseudorange, -u @ moved_e, atol=0.01)
        np.testing.assert_array_equal(now.r_es_e, before.r_es_e)


def test_without_faults_nothing_is_touched(data):
    assert faults.gps_ranges((), data.ranges, data.antenna) is data.ranges
