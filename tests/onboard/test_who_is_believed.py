"""The rules of belief, case by case: what agrees, what insists, and when a sensor is believed in the end."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import integrity
from shefex_nav.onboard.navigation.integrity import HEALTHY, Fate, GpsEvidence, Health, StarEvidence
from shefex_nav.records import GpsFix

ZERO, ONE = np.zeros(3), np.eye(3)
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize("dof", [1, 2, 3, 6, 30])
@pytest.mark.parametrize("probability", [1e-2, 1e-5, 1e-9])
def test_limits_are_quantiles_of_chi_square(dof, probability):
    expected = stats.chi2.isf(probability, dof)
    assert integrity.chi_square_limit(probability, dof) == pytest.approx(expected, rel=1e-9)
    limits = integrity.Limits(probability)
    assert limits[dof] == pytest.approx(expected, rel=1e-9)
    assert limits[dof, 0.5] == pytest.approx(stats.chi2.median(dof), rel=1e-9)
    assert set(limits) == {dof, (dof, 0.5)}  # each is computed once


def trial(evidence, agree=True, still=None, steady=None, rejections=3, duration=2.0):
    """sensors.Trial of answers that are given."""
    return SimpleNamespace(
        evidence=evidence,
        agree=lambda first, later: agree,
        still=None if still is None else (lambda first, later: still),
        steady=None if steady is None else (lambda first, later: steady),
        rule=SimpleNamespace(rejections=rejections, duration=duration),
    )


def judged(sequence, **alone):
    """Fates of (t, nis, agree) in turn, limit 10; and the record at the end."""
    health, fates = HEALTHY, []
    for t_s, nis, agree in sequence:
        fate, health = integrity.judge(health, trial(t_s, agree), nis, 10.0, t_s, **alone)
        fates.append(fate.name)
    return fates, health


def test_inside_the_gate_and_on_its_rim_a_fix_is_used():
    fates, health = judged([(0.0, 9.0, True), (1.0, 10.0, True), (2.0, 10.1, True)])
    assert fates == ["USED", "USED", "REJECTED"]
    assert (health.used, health.rejected, health.t_first_s, health.in_a_row) == (2, 1, 2.0, 1)
    assert health.evidence == health.first == 2.0


def test_a_sensor_is_believed_when_it_has_insisted_often_and_long_enough():
    """Three agreeing fixes within two seconds at least: a quick sensor waits, a slow one counts."""
    assert judged([(t, 99.0, True) for t in (0.0, 0.5, 1.0, 1.5, 2.0)])[0] == ["REJECTED"] * 4 + ["RESET"]
    assert judged([(t, 99.0, True) for t in (0.0, 5.0, 10.0)])[0] == ["REJECTED", "REJECTED", "RESET"]
    fates, health = judged([(t, 99.0, True) for t in (0.0, 1.0, 2.0)])
    assert fates[-1] == "RESET"
    assert health == Health(1, 0, health.t_first_s, None) and np.isnan(health.t_first_s)


def test_fixes_that_disagree_begin_to_count_anew():
    fates, health = judged([(0.0, 99.0, True), (1.0, 99.0, True), (2.0, 99.0, False), (3.0, 99.0, True)])
    assert fates == ["REJECTED"] * 4
    assert (health.rejected, health.t_first_s, health.first, health.evidence) == (2, 2.0, 2.0, 3.0)
    assert health.in_a_row == 4  # whether they agree or not
    fates, health = judged([(0.0, 99.0, True), (1.0, 9.0, False), (2.0, 99.0, True)])
    assert fates == ["REJECTED", "USED", "REJECTED"] and health.in_a_row == health.rejected == 1


def test_where_one_is_not_enough_it_is_held_until_a_second_agrees():
    fates, health = judged([(0.0, 1.0, True), (1.0, 1.0, False), (2.0, 1.0, True)], alone=False)
    assert fates == ["HELD", "HELD", "USED"] and health.held is None and health.used == 1
    fates, health = judged([(0.0, 1.0, True), (1.0, 99.0, True)], alone=False)
    assert fates == ["HELD", "REJECTED"] and health.held == 0.0 and health.used == 0


@pytest.mark.parametrize("agree, still, fate", [(True, True, "REJECTED"), (True, False, "USED"),
                                               (False, True, "USED"), (True, None, "USED")])  # fmt: skip
def test_a_gate_that_has_widened_does_not_let_the_same_offset_pass(agree, still, fate):
    before = Health(5, 1, 0.0, "rejected", first="rejected", in_a_row=1)
    got, health = integrity.judge(before, trial("now", agree, still), 1.0, 10.0, 1.0)
    assert got.name == fate and health.used == (6 if fate == "USED" else 5)
    assert integrity.judge(HEALTHY, trial("now", True, True), 1.0, 10.0, 1.0)[0] == Fate.USED
    assert integrity.judge(HEALTHY, None, 1.0, 10.0, 1.0)[0] == Fate.USED


@pytest.mark.parametrize("steady, insists", [(None, True), (True, True), (False, False)])
def test_what_grows_does_not_insist(steady, insists):
    before = Health(5, 1, 0.0, "rejected", first="rejected")
    assert integrity.insists(before, trial("now", True, steady=steady)) == insists
    assert not integrity.insists(before, trial("now", False, steady=steady))
    assert not integrity.insists(HEALTHY, trial("now", True, steady=steady))


def gps(t_s=0.0, r=ZERO, v=ZERO, sigma=1.0):
    return GpsFix(t_s, t_s, True, np.array(r), np.array(v), sigma**2 * ONE, 0.01 * ONE, 8, 2.0, "")


def evidence(z, sigma_P=1.0, **fix):
    return GpsEvidence(gps(**fix), np.array(z), sigma_P**2 * ONE)


def test_offsets_agree_within_the_noise_of_both_fixes_and_of_the_filter():
    """d^T (R1 + R2 + P)^-1 d: variances 1 + 4 + 4 of what differs by 9 are nine sigmas squared."""
    first, later = evidence(ZERO, 7.0, sigma=1.0), evidence(9.0 * X, 2.0, sigma=2.0)
    assert integrity.offsets_agree(first, later, 9.001) and not integrity.offsets_agree(first, later, 8.999)


def test_an_offset_remains_if_it_is_nearer_to_the_one_before_than_to_none():
    first = evidence(10.0 * X)
    for z, remains in ((10.0 * X, True), (5.1 * X, True), (4.9 * X, False), (-10.0 * X, False), (Y, False)):
        assert integrity.offset_remains(first, evidence(z)) == remains


def test_a_gate_is_wider_if_its_variance_is_four_times_as_large():
    narrow = evidence(X, 1.0)  # trace of P + R: 6
    for sigma_P, wider in ((np.sqrt(6.99), False), (np.sqrt(7.01), True)):
        assert integrity.has_widened(narrow, evidence(X, sigma_P)) == wider


def test_velocities_are_off_alike_if_they_differ_by_less_than_half():
    first = evidence(2.0 * X)
    for z, same in ((2.9 * X, True), (3.1 * X, False), (1.1 * X, True), (0.9 * X, False), (2.0 * Y, False)):
        assert integrity.same_velocity_offset(first, evidence(z)) == same
    assert not integrity.same_velocity_offset(None, evidence(X))
    assert not integrity.same_velocity_offset(evidence(X, v=(np.nan, 0.0, 0.0)), evidence(X))


@pytest.mark.parametrize("deg, same", [(0.0, True), (59.0, True), (61.0, False), (180.0, False)])
def test_velocities_are_off_to_the_same_side_within_sixty_degrees(deg, same):
    turned = 7.0 * (np.cos(np.radians(deg)) * X + np.sin(np.radians(deg)) * Y)
    assert integrity.same_direction(evidence(3.0 * X), evidence(turned)) == same


V1, V2 = 100.0 * X, np.array([140.0, 0.0, 20.0])  # m/s: 240 m and 20 m in two seconds, by the trapezoid


@pytest.mark.parametrize("off_m, agree", [(0.0, True), (8.4, True), (8.6, False), (-8.6, False)])
def test_fixes_agree_if_they_move_as_their_velocities_say(off_m, agree):
    """Three sigma of the norm: 9 (3 + 3 + (0.7 m/s 2 s)^2) = 8.46^2 m^2."""
    first, later = gps(5.0, ZERO, V1), gps(7.0, (240.0, off_m, 20.0), V2)
    assert integrity.gps_fixes_agree(first, later, 0.7) == agree


def test_fixes_agree_only_in_time():
    """Ten seconds apart at most, the later one later, and not the same fix again."""
    for t_s, agree in ((10.0, True), (10.01, False), (0.0, False), (-1.0, False)):
        moved = gps(t_s, t_s * V1, V1)
        assert integrity.gps_fixes_agree(gps(0.0, 1e-3 * Y, V1), moved, 1.0) == agree
        moved, before = evidence(ZERO, t_s=t_s, r=t_s * V1), evidence(ZERO, r=1e-3 * Y)
        assert integrity.positions_agree(before, moved, 1.0) == agree
    assert not integrity.gps_fixes_agree(gps(0.0), gps(1.0), 1.0)
    assert not integrity.positions_agree(evidence(ZERO), evidence(ZERO, t_s=1.0), 1.0)


@pytest.mark.parametrize("off_m, agree", [(8.4, True), (8.6, False), (-8.6, False)])
def test_positions_without_velocity_agree_if_their_offset_stays(off_m, agree):
    first, later = evidence(50.0 * X, t_s=5.0), evidence(50.0 * X + off_m * Y, t_s=7.0, r=X)
    assert integrity.positions_agree(first, later, 0.7) == agree


IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def star(t_s, turned_i=ZERO, sigma=1e-4):
    return StarEvidence(t_s, rotation.quat_from_rotvec(np.array(turned_i)), sigma**2 * ONE)


@pytest.mark.parametrize("times, agree", [(0.999, True), (1.001, False)])
def test_star_fixes_differ_by_their_noise_and_by_that_of_the_gyros(times, agree):
    """Variance 2 sigma^2 + rate^2 T^2 + N^2 T per axis, of the noisiest axis; three seconds apart."""
    P_rate, noise, T = np.diag([1e-10, 4e-10, 2e-10]), 3e-9, 3.0
    variance = 1e-8 + 4e-8 + 4e-10 * T**2 + noise * T
    later = star(T, times * np.sqrt(9.0 * variance) * X, 2e-4)
    assert integrity.star_fixes_agree(star(0.0), later, P_rate, 9.0, noise) == agree
    assert integrity.star_fixes_agree(later, star(0.0), P_rate, 9.0, noise) == agree  # in either order


def test_star_fixes_agree_by_what_is_between_them_and_within_a_minute():
    common = np.array([0.3, -0.2, 0.5])  # large, so that an order of factors shows
    q = rotation.quat_multiply(rotation.quat_from_rotvec(common), rotation.quat_from_rotvec(2e-4 * X))
    later, quiet = StarEvidence(1.0, q, 1e-8 * ONE), np.zeros((3, 3))
    assert integrity.star_fixes_agree(star(0.0, common), later, quiet, 2.01)
    assert not integrity.star_fixes_agree(star(0.0, common), later, quiet, 1.99)
    for t_s, agree in ((60.0, True), (60.1, False), (0.0, False)):
        assert integrity.star_fixes_agree(star(0.0), star(t_s), quiet, 9.0) == agree


def test_star_evidence_is_in_inertial_axes():
    """The measured attitude is M = C exp(z), seen from inertia turned by C z, with a covariance M R M^T."""
    q, z, R = (
        rotation.quat_from_rotvec(np.array([0.4, 1.0, -0.3])),
        np.array([0.1, -0.2, 0.05]),
        np.diag([1.0, 4.0, 9.0]),
    )
    state = SimpleNamespace(t_s=12.5, q_ib=q)
    got, C = integrity.star_evidence(state, z, R, IDENTITY), rotation.dcm_from_quat(q)
    np.testing.assert_allclose(rotation.rotvec_from_quat(got.error_i), C @ z, atol=1e-12)
    M = C @ rotation.dcm_from_rotvec(z)
    np.testing.assert_allclose(got.R_i, M @ R @ M.T, atol=1e-12)
    assert got.t_valid_s == 12.5


def test_corrections_between_two_star_fixes_are_no_disagreement():
    """The filter turns its attitude by 4 deg between two fixes; the gyros have turned by nothing."""
    wrong, turn, R = np.array([0.02, -0.01, 0.03]), np.array([0.0, 0.07, 0.0]), 1e-10 * ONE
    true = rotation.quat_from_rotvec(np.array([0.4, 1.0, -0.3]))
    before = rotation.quat_multiply(rotation.quat_from_rotvec(wrong), true)
    after = rotation.quat_multiply(rotation.quat_from_rotvec(turn), before)
    found = []
    for t_s, q, turned_i in ((0.0, before, IDENTITY), (1.0, after, rotation.quat_from_rotvec(turn))):
        z = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q), true))
        found.append(integrity.star_evidence(SimpleNamespace(t_s=t_s, q_ib=q), z, R, turned_i))
    assert integrity.star_fixes_agree(*found, np.zeros((3, 3)), 0.01)
    uncorrected = integrity.star_evidence(SimpleNamespace(t_s=1.0, q_ib=after), z, R, IDENTITY)
    assert not integrity.star_fixes_agree(found[0], uncorrected, np.zeros((3, 3)), 16.0)
