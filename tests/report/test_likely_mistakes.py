"""What errors of a user's own software fit: mistakes put into a good flight are named, none of a good one."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav import runs
from shefex_nav.geometry import frames, rotation
from shefex_nav.report import likely_mistakes
from shefex_nav.report.lever_arm import of_gps
from shefex_nav.report.navigation_errors import navigation_errors
from shefex_nav.scenario.load import load

OWN = (("navigation", "own.py:Mine", ""),)


@pytest.fixture(scope="module")
def good():
    """RunData of a flight as if software of a user's own had flown it, which gives no gate results."""
    data = runs.fly(load("shefex2_andoya", ["star_tracker.frames=statistical"]), until_s=60.0).data
    return data._replace(mission=data.mission._replace(software=OWN), gates=[])


def fits(data):
    return likely_mistakes.found(data, navigation_errors(data))


def with_nav(data, **changes):
    return data._replace(nav=data.nav._replace(**changes))


def older(data, ticks):
    """The solution of some ticks ago as that of now."""
    old = {name: np.roll(getattr(data.nav, name), ticks, axis=0) for name in ("r_i", "v_i", "q_ib")}
    for name, value in old.items():
        value[:ticks] = getattr(data.nav, name)[:ticks]
    return with_nav(data, **old)


def without_covariance(data):
    return data._replace(covariance=data.covariance._replace(P=np.full_like(data.covariance.P, np.nan)))


def test_of_a_good_flight_nothing_is_said(good):
    assert fits(good) == [] and fits(without_covariance(good)) == []


def test_errors_of_a_good_filter_that_takes_them_for_too_small_fit_nothing(good):
    sure = good._replace(covariance=good.covariance._replace(P=1e-6 * good.covariance.P))
    assert fits(sure) == []


@pytest.mark.parametrize("ticks", [2, 10, 40])
def test_an_old_solution(good, ticks):
    (found,) = fits(older(good, ticks))
    shift_s = float(found.what.split(" s old")[0].split()[-1])
    assert shift_s == pytest.approx(0.01 * ticks, rel=0.15) and "of the position error" in found.what
    assert found.explained > 0.95 and found.until_s > 59.0
    if ticks < 40:  # which at 540 deg/s are more than half a turn
        assert "of the attitude error" in found.what


def test_position_off_by_the_same_all_the_time_is_no_shift(good):
    off = np.cross(good.truth.v_i[0], [0.3, -0.5, 0.8])
    assert fits(with_nav(good, r_i=good.nav.r_i + 50.0 * off / np.linalg.norm(off))) == []


def test_roll_off_by_the_same_all_the_time_is_no_shift(good):
    """At a constant rate it would be one."""
    off = rotation.quat_from_rotvec(np.array([0.15, 0.0, 0.0]))
    q_ib = np.array([rotation.quat_multiply(q, off) for q in good.nav.q_ib])
    assert fits(with_nav(good, q_ib=q_ib)) == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda q: q * [1.0, -1.0, -1.0, -1.0], "the other way round"),
        (lambda q: np.roll(q, -1, axis=-1), "scalar last"),
    ],
)
def test_an_attitude_in_another_convention_from_a_later_instant_on(good, change, words):
    late = good.nav.t_s > 31.0
    (found,) = fits(with_nav(good, q_ib=np.where(late[:, None], change(good.nav.q_ib), good.nav.q_ib)))
    assert words in found.what and found.from_s == pytest.approx(31.0, abs=0.2) and found.until_s > 59.0


def test_positions_and_velocities_in_other_axes_and_units(good):
    nav, earth = good.nav, good.mission.earth
    C_ei = np.swapaxes(frames.dcms_ie(earth, nav.t_s), 1, 2)
    (found,) = fits(with_nav(good, r_i=np.einsum("kij,kj->ki", C_ei, nav.r_i)))
    assert "r_i in Earth-fixed axes" in found.what
    (found,) = fits(with_nav(good, r_i=1e-3 * nav.r_i))
    assert "kilometres" in found.what
    against = nav.v_i - np.cross(frames.omega_ie_i(earth), nav.r_i)
    (found,) = fits(with_nav(good, v_i=against))
    assert "v_i relative to the Earth (" in found.what


@pytest.mark.parametrize(
    ("factor", "words"), [(180.0 / np.pi, "180/pi"), (0.25, "one of the four"), (1.1, "1.1 times")]
)
def test_turns_that_are_not_those_of_the_imu(good, factor, words):
    rows = np.searchsorted(good.imu.t_valid_s, good.nav.t_s - 1e-6)
    q, out = good.nav.q_ib[0], []
    for dtheta_b in good.imu.dtheta_b[rows].sum(axis=1):
        q = rotation.quat_normalise(rotation.quat_multiply(q, rotation.quat_from_rotvec(factor * dtheta_b)))
        out.append(q)
    found = fits(with_nav(good, q_ib=np.array(out)))
    assert [words in one.what for one in found] == [True], found


# ----------------------------------------------------------------------------------------------------------
# The lever arm.

ARM = np.array([0.6, 0.1, -0.05])


def followed(share, seed=1, bias_m=5.0):
    """RunData of a vehicle that turns, and a solution that has followed fixes with a share of the arm."""
    rng, earth = np.random.default_rng(seed), frames.EarthRotation(np.eye(3), np.eye(3), 0.3, 7.29e-5)
    t_s = np.arange(0.0, 400.0, 0.01)
    turn = np.column_stack([0.3 * t_s, 0.4 * np.sin(0.02 * t_s), 0.5 * np.cos(0.03 * t_s)])
    q_ib = np.array([rotation.quat_from_rotvec(one) for one in turn])
    r_i = np.array([7e6, 0.0, 0.0]) + np.outer(t_s, [0.0, 7e3, 500.0])
    v_i = np.tile([0.0, 7e3, 500.0], (len(t_s), 1))
    truth = SimpleNamespace(t_s=t_s, r_i=r_i, q_ib=q_ib, omega_ib_b=np.zeros((len(t_s), 3)))
    slow_i = (
        bias_m * np.sin(t_s / 60.0)[:, None] * np.ones(3)
    )  # error of the fixes, which the solution has too
    fixes, nav_r_i = [], r_i.copy()
    for k in range(0, len(t_s), 100):
        arm_i = rotation.quat_rotate(q_ib[k], ARM)
        nav_r_i[k] += slow_i[k] + (1.0 - share) * arm_i
        antenna_i = r_i[k] + arm_i + slow_i[k] + rng.normal(0.0, 1.0, 3)
        r_e, _ = frames.ecef_from_inertial(earth, t_s[k], antenna_i, v_i[k])
        fixes.append(
            SimpleNamespace(t_valid_s=t_s[k], valid=True, horizontal=False, r_ea_e=r_e, R_r_e=9.0 * np.eye(3))
        )
    nav = SimpleNamespace(t_s=t_s, r_i=nav_r_i, v_i=v_i)
    return SimpleNamespace(truth=truth, nav=nav, gps=fixes, mission=SimpleNamespace(earth=earth))


def with_arm(arm=ARM):
    return SimpleNamespace(gps=SimpleNamespace(antenna=SimpleNamespace(lever_arm=arm)))


@pytest.mark.parametrize(("share", "words"), [(0.0, "left out"), (2.0, "other way round"), (-1.0, "twice")])
def test_a_lever_arm_that_is_not_as_it_should_be(share, words):
    ((what, *_),) = of_gps(followed(share), with_arm())
    assert words in what and "gps.antenna.lever_arm" in what


@pytest.mark.parametrize("seed", range(5))
def test_of_a_lever_arm_that_is_right_nothing_is_said(seed):
    assert of_gps(followed(1.0, seed), with_arm()) == []


def test_nothing_without_arm_fixes_or_scenario():
    data = followed(0.0)
    assert of_gps(data, None) == [] and of_gps(data, with_arm(np.zeros(3))) == []
    data.gps.clear()
    assert of_gps(data, with_arm()) == []
