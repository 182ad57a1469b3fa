"""Gyros that are wrong but alive: what the comparison with star fixes finds, and what it leaves alone."""

from types import SimpleNamespace

import numpy as np
import pytest
from unpacked import FALLING

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import integrity_gyro
from shefex_nav.onboard.navigation.history import Corrections
from shefex_nav.onboard.navigation.state import X_MOUNTING, X_Q

ARCSEC = np.pi / 648000.0
WALK = 9e-6  # rad/sqrt(s)
G_SENSE = 0.5 * np.pi / 180.0 / 3600.0 / 9.8  # rad/s per m/s^2: 0.5 deg/h/gee
SIGMA = np.array([1.2, 12.0, 1.1]) * ARCSEC  # of star fixes about the body axes
R = np.diag(SIGMA**2)
BIAS = 0.5 * ARCSEC  # rad/s, known to
P = BIAS**2 * np.eye(15)
DT = 0.1
GAIN = 1.0 - 1.0 / 1.3**2  # of a filter that uses the fixes


def watch(relative=2e-4):
    model = SimpleNamespace(gyro_random_walk=WALK)
    return integrity_gyro.GyroWatch(model, relative, G_SENSE)


def turned(q, phi):
    return rotation.quat_normalise(rotation.quat_multiply(q, rotation.quat_from_rotvec(phi)))


def packed(q_ib, mounting=(0.0, 0.0, 0.0)):
    x = np.zeros_like(FALLING)
    x[X_Q], x[X_MOUNTING] = q_ib, mounting
    return x


def fly(
    one, seconds, rng, *, rate=(0.0, 0.0, 0.0), wrong=None, spoil=None, uses=False, pushed=None, force=0.0
):
    """Findings [(t_s, Finding)] of a flight with ten star fixes a second.

    rate : (3,) rad/s, of the vehicle
    wrong : t_s -> (3,) rad/s, what the gyros read too much
    spoil : number of the fix -> (3,) rad, by which it is wrong
    uses : whether the filter takes the fixes in, which moves its attitude
    pushed : (3,) rad, by which another sensor corrects the attitude every second
    force : m/s^2, specific force along x
    """
    true = estimated = rotation.quat_normalise(rng.standard_normal(4))
    found, corrections = [], Corrections()
    for k in range(round(seconds / DT)):
        t_s = k * DT
        measured = turned(true, SIGMA * rng.standard_normal(3) + (spoil(k) if spoil else 0.0))
        z = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(estimated), measured))
        good = uses and np.linalg.norm(z) < 200.0 * ARCSEC
        seen = integrity_gyro.StarSight(t_s, packed(estimated), P, z, R, np.array([force, 0.0, 0.0]))
        finding = one.compare(seen, corrections.kept[-1].A)
        if finding:
            found.append((t_s, finding))
        if good:
            before, estimated = estimated, turned(estimated, GAIN * z)
            corrections.add(k + 1, k - 1, t_s, packed(before), packed(estimated))
        if pushed is not None and k % 10 == 3:  # another sensor, once a second
            before, estimated = estimated, turned(estimated, pushed)
            corrections.add(k + 1, k - 1, t_s, packed(before), packed(estimated))
        true = turned(true, np.array(rate) * DT)
        error = WALK * np.sqrt(DT) * rng.standard_normal(3) + (wrong(t_s) * DT if wrong else 0.0)
        estimated = turned(estimated, np.array(rate) * DT + error)
    return found


@pytest.mark.parametrize("uses", [False, True])
def test_healthy_gyros_are_left_alone(uses):
    """Half an hour of star fixes, 18 000 comparisons three times over, while the vehicle turns."""
    one = watch()
    assert not fly(one, 1800.0, np.random.default_rng(1), rate=(0.0, 0.004, -0.002), uses=uses)
    assert one.trust(1800.0) and not one.failed
    assert one.checked_s > 1795.0  # and they are known to be right


@pytest.mark.parametrize("uses", [False, True])
@pytest.mark.parametrize(("axis", "deg_s", "within_s"), [(1, 1.0, 0.7), (2, 0.05, 0.7), (0, 0.003, 8.5)])
def test_a_bias_that_jumps_is_found(axis, deg_s, within_s, uses):
    """The axis is named, the rate is right within its sigma, and sooner the larger it is."""
    error = np.radians(deg_s) * np.eye(3)[axis]
    one = watch()
    rng = np.random.default_rng(2)
    found = fly(one, 30.0, rng, wrong=lambda t: error * (t >= 20.0), uses=uses)
    t_s, finding = found[0]
    assert 20.0 < t_s <= 20.0 + within_s
    assert finding.axes == (integrity_gyro.AXES[axis],)
    if deg_s > 0.01:  # the short comparison begins within the fault, or shortly before
        assert -finding.rate_b[axis] == pytest.approx(error[axis], rel=0.35)
    assert np.count_nonzero(finding.admitted) == 1 and finding.admitted[axis] >= abs(finding.rate_b[axis])
    assert one.failed == finding.axes and not one.trust(t_s)


def test_g_sensitivity_that_is_known_is_no_fault():
    """Braking in the air with 10 gee moves each gyro by its g-sensitivity: 5 deg/h, ten times its bias."""
    error = G_SENSE * 100.0 * np.array([1.0, -0.8, 0.6])
    braking = {"wrong": lambda t: error * (t >= 10.0), "force": 100.0}
    assert not fly(watch(), 60.0, np.random.default_rng(7), **braking)
    assert fly(
        watch(), 60.0, np.random.default_rng(7), wrong=lambda t: 20.0 * error * (t >= 10.0), force=100.0
    )
    assert fly(watch(), 60.0, np.random.default_rng(7), wrong=lambda t: error * (t >= 10.0))  # in free fall


def test_a_scale_factor_is_found_when_the_vehicle_turns():
    rate, one = np.array([0.0, 0.02, 0.0]), watch()
    found = fly(one, 20.0, np.random.default_rng(3), rate=rate, wrong=lambda t: 0.05 * rate * (t > 10.0))
    assert found and found[0][1].axes == ("gyro y",) and found[0][0] < 12.0
    at_rest = fly(watch(), 20.0, np.random.default_rng(3), wrong=lambda t: 0.0 * rate)
    assert not at_rest


@pytest.mark.parametrize("uses", [False, True])
def test_wrong_star_fixes_are_not_blamed_on_the_gyros(uses):
    """Every tenth by 0.5 to 180 deg, and one in a hundred twice in a row; 6000 fixes."""
    rng = np.random.default_rng(4)

    def spoil(k):
        angle = np.radians(0.5 * 360.0 ** rng.random())
        direction = rng.standard_normal(3)
        wrong = k % 10 == 0 or k % 100 == 1
        return angle * direction / np.linalg.norm(direction) if wrong else np.zeros(3)

    assert not fly(watch(), 600.0, rng, spoil=spoil, uses=uses)


def test_corrections_by_other_sensors_are_not_blamed_on_the_gyros():
    """GPS after a burn: 30 arcsec a second in one direction; 0.003 deg/s of a gyro are found all the same."""
    push = np.array([0.0, 0.0, 30.0]) * ARCSEC
    one = watch()
    assert not fly(one, 300.0, np.random.default_rng(7), uses=True, pushed=push)
    assert one.checked_s > 295.0
    error = np.radians([0.003, 0.0, 0.0])
    found = fly(watch(), 30.0, np.random.default_rng(8), wrong=lambda t: error * (t >= 20.0), pushed=push)
    assert found and found[0][1].axes == ("gyro x",) and found[0][0] < 28.5


def test_what_goes_from_the_attitude_to_the_mounting_is_no_rotation():
    """An update that turns the body and the camera's mounting against each other leaves E as it is."""
    one, rng = Corrections(), np.random.default_rng(10)
    q, phi = turned(np.array([1.0, 0.0, 0.0, 0.0]), rng.standard_normal(3)), 1e-3 * rng.standard_normal(3)
    one.add(1, 0, 0.0, packed(q, phi), packed(turned(q, phi)))
    np.testing.assert_allclose(one.kept[-1].A, [1.0, 0.0, 0.0, 0.0], atol=1e-15)


def test_going_back_takes_corrections_back():
    """A late measurement: what was corrected after it is corrected again, otherwise, and E stays the same."""
    one, rng = Corrections(), np.random.default_rng(9)
    q = [turned(np.array([1.0, 0.0, 0.0, 0.0]), 1e-3 * rng.standard_normal(3)) for _ in range(6)]
    for number in range(1, 6):
        one.add(number, 0, 0.0, packed(q[number - 1]), packed(q[number]))
    wanted = one.kept[2].A
    one.back_to(2)
    assert np.array_equal(one.kept[-1].A, wanted) and one.kept[-1].number == 2
    one.add(4, 2, 0.0, packed(q[2]), packed(q[4]))
    assert [kept.number for kept in one.kept] == [2, 4]  # and nothing before the oldest tick is kept
    expected = rotation.quat_multiply(q[4], rotation.quat_conjugate(q[0]))
    np.testing.assert_allclose(one.kept[-1].A, expected, atol=1e-15)


def test_a_camera_that_is_knocked_is_not_blamed_on_the_gyros():
    """Steps of 0.01 to 1 deg, one in half a minute."""
    rng, steps = np.random.default_rng(5), {}

    def spoil(k):
        number = k // 300
        if number not in steps:
            last = steps.get(number - 1, np.zeros(3))
            angle = np.radians(10.0 ** rng.uniform(-2.0, 0.0))
            steps[number] = last + angle * rng.standard_normal(3) / np.sqrt(3.0)
        return steps[number]

    assert not fly(watch(), 900.0, rng, spoil=spoil)


def test_gyros_that_were_wrong_need_stars():
    """Right again once they conform; not to be trusted from one second after the last star on."""
    one = watch()
    fault = np.radians([0.0, 0.0, 0.5])
    fly(one, 12.0, np.random.default_rng(6), wrong=lambda t: fault * (1.0 <= t < 1.8))
    assert one.failed == ("gyro z",) and one.wrong == ()
    assert one.checked_s > 11.0
    assert one.trust(one.checked_s + 0.9) and not one.is_unchecked(one.checked_s + 0.9)
    assert not one.trust(one.checked_s + 1.1) and one.is_unchecked(one.checked_s + 1.1)
