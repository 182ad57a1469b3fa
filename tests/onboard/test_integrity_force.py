"""Gyros that answer to a specific force that is not read: how the angle grows, what fixes say of it."""

import numpy as np
import pytest
from navigation_flight import DT, EARTH, PARAMS, Q_0, R_0, V_0, alignment, gps_fix
from plain import plain
from scipy import integrate, stats
from unpacked import propagate, window

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import fusion, integrity_imu, integrity_unread, integrity_watch
from shefex_nav.onboard.navigation.state import ATT, NavState
from shefex_nav.records import ImuBlock

N, BLOCK_S = 4, 0.01
SENSED = np.radians(100.0 / 3600.0) / 9.80665  # rad/s per m/s^2: 100 deg/h/gee
SPREAD, CHANGE, RANGE = 60.0, 30.0, 300.0  # m/s^2, m/s^3, m/s^2
RULES = integrity_imu.ImuRules(
    repeats=np.array([np.inf, 20.0]),
    range=np.array([np.inf, RANGE]),
    wrong=np.array([1.0, SPREAD]),
    change=np.array([0.5, CHANGE / integrity_unread.LIT]),
    missed=np.array([1.0, 50.0]),
)


@pytest.mark.parametrize("lasting_s, known_s, before", [(0.4, 0.4, 0.0), (0.2, 1.0, 3.0), (2.0, 2.0, 12.0)])
def test_the_force_runs_away_from_when_it_was_known(lasting_s, known_s, before):
    """Integral of m_0 + c (0.1 s + time) over the last of the time."""
    u, _ = integrate.quad(lambda t: before + 5.0 * (0.1 + t), known_s - lasting_s, known_s)
    squared, change = plain(integrity_unread.squared), 5.0 / integrity_unread.LIT
    assert squared(lasting_s, known_s, before, 1e3, change) == pytest.approx(u**2)
    assert squared(lasting_s, known_s, before, 0.5, change) == pytest.approx((0.5 * lasting_s) ** 2)
    assert squared(lasting_s, known_s, np.inf, 7.0, change) == pytest.approx((7.0 * lasting_s) ** 2)


def test_what_a_force_can_be():
    largest, rules = plain(integrity_unread.largest), np.array(RULES)
    assert largest(rules, False) == RANGE / 3.0 and largest(rules, True) == RANGE
    rules[1, 1] = np.inf
    assert largest(rules, False) == SPREAD


class Unit:
    """Blocks of a unit at rest but for an axis that is stuck from the first block after `settle` on."""

    def __init__(self, axis=3):
        self.watch, self.t_s, self.axis = integrity_imu.start(RULES, N, SENSED), 0.0, axis
        self.rng = np.random.default_rng(1)

    def pass_by(self, duration_s, stuck=True, saturated=False):
        """Densities on the attitude times the time of a block, (n,) rad^2, the same on each axis."""
        added = []
        for _ in range(round(duration_s / BLOCK_S)):
            self.t_s += BLOCK_S
            values = 1e-4 * self.rng.standard_normal((N, 6))
            if stuck:
                values[:, self.axis] = 0.0
            if saturated:
                values[:, self.axis] = RANGE * DT
            block = ImuBlock(self.t_s, self.t_s, DT, values[:, :3].copy(), values[:, 3:].copy(), False, True)
            readings, densities = np.empty((N, 6)), np.empty((3, 3))
            integrity_imu.screen(self.watch, block, readings, densities)
            assert np.ptp(densities[2]) == 0.0
            added.append(densities[2, 0] * BLOCK_S)
        return np.array(added)


def test_an_axis_that_is_stuck_after_the_end_of_its_range_goes_on_with_what_a_force_can_be():
    """A second by the range, then one by a third of it: the angle goes on from the first."""
    unit = Unit()
    unit.pass_by(1.0, stuck=False)
    at_end = unit.pass_by(1.0, saturated=True).sum()
    assert at_end == pytest.approx((SENSED * RANGE) ** 2, rel=1e-9)
    third = SENSED * RANGE / 3.0
    assert unit.pass_by(1.0).sum() == pytest.approx((2.0 * third) ** 2 - third**2, rel=1e-9)


def test_an_axis_that_is_not_read_turns_the_gyros_by_an_angle_that_lasts():
    """Held: c t^2/2 at first; then s t, in proportion to the time. Read again: nothing."""
    unit = Unit()
    assert not unit.pass_by(1.0, stuck=False).any()
    angle = np.sqrt(np.cumsum(unit.pass_by(30.0))) / SENSED
    assert angle[99] == pytest.approx(CHANGE * (0.1 + 0.5) * 1.0, rel=0.02)
    assert angle[[1499, 2999]] == pytest.approx([RANGE / 3.0 * 15.0, RANGE / 3.0 * 30.0], rel=1e-3)
    assert not unit.pass_by(1.0, stuck=False)[1:].any()


def test_at_the_end_of_the_range_all_of_it_may_be_false():
    unit = Unit()
    unit.pass_by(1.0, stuck=False)
    angle = np.sqrt(unit.pass_by(2.0, stuck=False, saturated=True).sum()) / SENSED
    assert angle == pytest.approx(RANGE * 2.0, rel=1e-3)


def test_velocities_show_the_force_along_the_roll_axis_and_their_sum_lasts():
    """Corrected by 10 m/s each second: after 5 s the shown share is of 50 m/s, not of sqrt(5) times 10."""
    unit, total = Unit(), 0.0
    unit.pass_by(1.0, stuck=False)
    for _ in range(5):
        total += unit.pass_by(1.0).sum()
        integrity_imu.pushed(unit.watch, -10.0, unit.t_s, unit.t_s)
    total += unit.pass_by(0.01)[0]
    unknown = (CHANGE * 0.6) ** 2 + 4.0 * (10.0 + CHANGE * 0.6) ** 2  # between two fixes
    assert total / SENSED**2 == pytest.approx(50.0**2 + unknown, rel=0.05)
    across = Unit(axis=4)
    across.pass_by(1.0, stuck=False)
    first = across.pass_by(1.0).sum()
    integrity_imu.pushed(across.watch, 10.0, across.t_s, across.t_s)
    assert across.pass_by(1.0).sum() > 5.0 * first  # it runs away still


def test_what_gps_has_shown_is_paid_when_the_axis_is_read_again():
    unit = Unit()
    unit.pass_by(1.0, stuck=False)
    unit.pass_by(1.0)
    integrity_imu.pushed(unit.watch, 7.0, unit.t_s, unit.t_s)
    again = unit.pass_by(0.05, stuck=False)
    assert again.sum() == pytest.approx((7.0 * SENSED) ** 2) and np.count_nonzero(again) == 1


def test_a_force_that_was_not_known_is_what_the_first_velocity_shows():
    """At the end of the range nothing is known at first: 0.8 s ago 40 m/s had been gained in 1.2 s."""
    unit = Unit()
    unit.pass_by(1.0, stuck=False)
    unit.pass_by(2.0, saturated=True)
    assert unit.watch.forces[0]["before"] == np.inf
    integrity_imu.pushed(unit.watch, 40.0, unit.t_s - 0.8, unit.t_s)
    assert unit.watch.forces[0]["before"] == pytest.approx(40.0 / 1.2)
    integrity_imu.pushed(unit.watch, 3.0, unit.t_s - 0.75, unit.t_s)  # a mean over a tenth of a second
    assert unit.watch.forces[0]["before"] == pytest.approx(40.0 / 1.2 * 0.5 + 3.0 / 0.1)


def test_after_a_star_fix_the_angle_counts_as_if_a_second_old():
    unit = Unit(axis=5)
    unit.pass_by(1.0, stuck=False)
    unit.pass_by(20.0)
    integrity_imu.turned(unit.watch, unit.t_s - 0.1, unit.t_s)
    angle2 = np.cumsum(unit.pass_by(2.0)) / (SENSED * RANGE / 3.0) ** 2
    assert angle2[[99, 199]] == pytest.approx([2.1**2 - 1.1**2, 3.1**2 - 1.1**2], rel=1e-3)


def charged_under(force, gps_hz, duration_s=3.0):
    """Charge per second, m^2/s^2, with ten star fixes a second and GPS; m/s^2, Hz. After 1 s of both."""
    unit, charged = Unit(), np.zeros(2)
    unit.pass_by(1.0, stuck=False)
    for k in range(round((1.0 + duration_s) / BLOCK_S)):
        charged[int(k * BLOCK_S >= 1.0)] += unit.pass_by(BLOCK_S)[0]
        if k % 10 == 0:
            integrity_imu.turned(unit.watch, unit.t_s - 0.05, unit.t_s)
        if k % round(100 / gps_hz) == 0:
            integrity_imu.pushed(unit.watch, force / gps_hz, unit.t_s - 0.1, unit.t_s)
    return charged[1] / SENSED**2 / duration_s, unit.watch.forces[0]["before"]


@pytest.mark.parametrize("gps_hz", [1, 2, 5, 10, 20, 50])
def test_velocities_between_star_fixes_leave_the_second_that_an_angle_counts(gps_hz):
    """An angle m t that is a second old grows by 2 m^2 per second in its square, however often GPS is."""
    force = RANGE / 3.0
    charged, known = charged_under(force, gps_hz)
    assert known == pytest.approx(force, rel=1e-2)  # m_0, of velocities that are 20 ms apart, too
    assert 2.0 < charged / force**2 < 3.3
    at_rest, _ = charged_under(0.0, gps_hz)
    assert at_rest <= 1.01 * (CHANGE * 0.65 * 1.1) ** 2  # it runs away from nothing between two velocities


def test_a_star_fix_soon_after_the_beginning_leaves_no_more_than_has_been_shown():
    unit = Unit()
    unit.pass_by(1.0, stuck=False)
    unit.pass_by(0.2)
    integrity_imu.pushed(unit.watch, 5.0, unit.t_s, unit.t_s)
    integrity_imu.turned(unit.watch, unit.t_s, unit.t_s)
    assert unit.watch.forces[0]["shown"] == 5.0
    unit.pass_by(0.4)
    integrity_imu.turned(unit.watch, unit.t_s, unit.t_s)
    assert unit.watch.forces[0]["shown"] == 5.0
    integrity_imu.pushed(unit.watch, 0.0, unit.t_s, unit.t_s)
    integrity_imu.turned(unit.watch, unit.t_s, unit.t_s)
    assert unit.watch.forces[0]["shown"] == 0.0  # the force has gone


ROLL_RATE, BURN_S, END_S = 1.0, (1.0, 5.0), 6.0


def truth(rng):
    """Blocks ideal and as read by gyros of a drawn g-sensitivity, and states, of a burn along the nose."""
    G = SENSED * rng.standard_normal((3, 3))
    force = 100.0 * (0.6 + 0.4 * rng.random())
    states, ideal, read, imu = [NavState(0.0, R_0, V_0, Q_0, *[np.zeros(3)] * 4)], [], [], None
    for k in range(round(END_S / BLOCK_S)):
        t_s = (k + 1) * BLOCK_S
        f_b = np.array([force if BURN_S[0] < t_s <= BURN_S[1] else 0.0, 0.0, 0.0])
        omega_b = np.array([ROLL_RATE, 0.01, -0.02])
        block = ImuBlock(t_s, t_s, DT, np.tile(omega_b * DT, (N, 1)), np.tile(f_b * DT, (N, 1)), False)
        imu = window(block, imu)
        r_i, v_i, q_ib = propagate(states[-1], imu, 0.0, BLOCK_S, EARTH)
        ideal.append(block)
        states.append(NavState(t_s, r_i, v_i, q_ib, *states[0][4:]))
        dtheta_b = (
            block.dtheta_b
            + G @ f_b * DT
            + PARAMS.imu.gyro_random_walk * np.sqrt(DT) * (rng.standard_normal((N, 3)))
        )
        dv_b = block.dv_b + 1e-5 * rng.standard_normal((N, 3))
        dv_b[:, 0] = 0.0  # it has been dead since before the burn
        read.append(block._replace(dtheta_b=dtheta_b, dv_b=dv_b))
    return ideal, read, states


def attitude_nees(rng, gps_from_s):
    """Of a filter whose axial accelerometer is dead through a burn. -> at its end, and 1 s later"""
    ideal, read, states = truth(rng)
    model = PARAMS.imu._replace(gyro_g_sensitivity=SENSED)
    watched = integrity_watch.DEFAULT._replace(imu=RULES)
    nav = fusion.start(PARAMS._replace(imu=model, integrity=watched), alignment(states[0], rng), EARTH)
    found = []
    for block, state in zip(read, states[1:], strict=True):
        fusion.advance(nav, block)
        t_s = block.t_valid_s
        if t_s >= gps_from_s and round(100 * t_s) % 100 == 0:
            fusion.fuse(nav, [("gps", gps_fix(ideal, states, t_s - 1e-4, 0.0, rng))])
        if round(100 * t_s) in (round(100 * BURN_S[1]), round(100 * END_S)):
            theta = rotation.rotvec_between(nav.history[-1].state.q_ib, state.q_ib)
            found.append(theta @ np.linalg.solve(nav.history.P[ATT, ATT], theta))
    return found


@pytest.mark.parametrize("gps_from_s", [0.0, 3.0])
def test_the_attitude_is_honest_through_a_burn_that_is_not_read(gps_from_s):
    """100 deg/h/gee: 1 deg in 4 s. Without the charge the NEES is some hundreds."""
    rng, runs = np.random.default_rng(5), 8
    found = np.array([attitude_nees(rng, gps_from_s) for _ in range(runs)])
    assert (found.mean(axis=0) < stats.chi2.ppf(1.0 - 1e-3, 3 * runs) / runs).all(), found.mean(axis=0)
    assert found.mean() > 0.2  # nor is it covered by an angle of which nothing is known
