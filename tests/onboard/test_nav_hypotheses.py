"""An attitude of which one angle is not known: its parts, the weights of the filters, their mixture."""

import numpy as np
import pytest

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import hypotheses
from shefex_nav.onboard.navigation.aid import Aid
from shefex_nav.onboard.navigation.hypotheses import Bank, split
from shefex_nav.records import Alignment

R, V = np.array([6.4e6, 0.0, 0.0]), np.array([0.0, 465.0, 0.0])
Q = rotation.quat_normalise(np.array([0.8, 0.3, -0.4, 0.2]))
LEVEL2 = np.radians(1.0) ** 2


def alignment(sigma, axis=(0.0, 0.6, 0.8)):
    """Known to 1 deg but about one axis."""
    u = np.array(axis)
    return Alignment(
        0.0, R, V, Q, 5.0, 0.1, LEVEL2 * (np.eye(3) - np.outer(u, u)) + sigma**2 * np.outer(u, u)
    )


def test_parts_cover_a_full_turn_evenly():
    parts = split(alignment(hypotheses.UNKNOWN))
    assert len(parts) == hypotheses.MEMBERS
    np.testing.assert_allclose([part.weight for part in parts], 1.0 / hypotheses.MEMBERS)
    step, u = 2.0 * np.pi / hypotheses.MEMBERS, np.array([0.0, 0.6, 0.8])
    for before, after in zip(parts, [*parts[1:], parts[0]], strict=True):
        turn = rotation.quat_multiply(rotation.quat_conjugate(before.alignment.q_ib), after.alignment.q_ib)
        np.testing.assert_allclose(np.abs(rotation.rotvec_from_quat(turn) @ u), step, rtol=1e-9)
        P = after.alignment.P_theta_b
        own = hypotheses.WIDER * step / np.sqrt(12.0)
        assert u @ P @ u == pytest.approx(own**2)
        np.testing.assert_allclose(np.sort(np.linalg.eigvalsh(P)), [LEVEL2, LEVEL2, own**2])


def test_parts_of_a_wide_gaussian_have_its_mean_and_variance():
    """Weighted second moment of the places and each part's own variance, against the angle's variance."""
    sigma = np.radians(45.0)
    parts = split(alignment(sigma))
    u = np.array([0.0, 0.6, 0.8])
    turns = [
        rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(Q), part.alignment.q_ib)) @ u
        for part in parts
    ]
    weights = np.array([part.weight for part in parts])
    own = u @ parts[0].alignment.P_theta_b @ u
    assert weights @ turns == pytest.approx(0.0, abs=1e-12)
    assert weights @ np.square(turns) + own == pytest.approx(sigma**2, rel=0.1)


def test_what_is_wide():
    assert not hypotheses.is_wide(alignment(np.radians(19.0)))
    assert hypotheses.is_wide(alignment(np.radians(21.0)))
    ends = np.diag(np.radians([20.0, 20.0, 100.0]) ** 2)  # the largest level error that a scenario may state
    assert hypotheses.wide_angles(alignment(1.0)._replace(P_theta_b=ends)) == 1
    lost = alignment(2.0)._replace(P_theta_b=np.diag([LEVEL2, 4.0, 4.0]))
    with pytest.raises(ValueError, match="two angles"):
        split(lost)


@pytest.fixture
def bank():
    """Of the navigation's test flight."""
    from navigation_flight import EARTH, PARAMS

    blind = Aid("pressure", tuple, None, sees_attitude=False)
    return Bank(PARAMS._replace(aids=(blind,)), alignment(hypotheses.UNKNOWN), EARTH)


def test_weights_follow_the_likelihood(bank):
    """One measurement with NIS 4 for a member and 10 for the others: exp(3 TEMPER) to one."""
    for member in bank.members:
        nis = 4.0 if member.number == 3 else 10.0
        member.nav.judged("gps_velocity", np.eye(3), nis)
    ratio = bank.weights[3] / bank.weights[0]
    assert ratio == pytest.approx(np.exp(hypotheses.TEMPER * 3.0))
    before = bank.weights.copy()
    for member in bank.members:  # a barometer sees no heading
        member.nav.judged("pressure", np.eye(1), float(member.number))
    np.testing.assert_array_equal(bank.weights, before)


def test_one_wrong_fix_takes_no_more_than_its_share(bank):
    for member in bank.members:
        member.nav.judged("gps_velocity", np.eye(3), 0.0 if member.number == 3 else 1e6)
    assert bank.weights[3] / bank.weights[0] == pytest.approx(
        np.exp(0.5 * hypotheses.TEMPER * hypotheses.MOST_NIS)
    )
    bank.prune()
    assert len(bank.members) == hypotheses.MEMBERS


def test_mixture_of_two_members(bank):
    """By hand: mean and covariance of position errors of two members, 3 to 1, 8 m apart."""
    bank.members = bank.members[:2]
    bank.logs[:2] = np.log([0.75, 0.25])
    bank.members[1].nav.history.x[:] = bank.members[0].nav.history.x
    bank.members[1].nav.history.x[0] += 8.0
    mixture = bank.mixture()
    assert mixture.mean[0] == pytest.approx(2.0)
    assert mixture.P[0, 0] == pytest.approx(25.0 + 0.75 * 4.0 + 0.25 * 36.0)
    found = mixture.alignment()
    np.testing.assert_allclose(found.r_i, R + np.array([2.0, 0.0, 0.0]))
    assert found.sigma_r == pytest.approx(np.sqrt(2.0 * 37.0))
    assert len(found.gyro_bias) == 3 and found.sigma_gyro_bias > 0.0


def test_it_is_settled_when_no_other_answer_has_weight(bank):
    assert not bank.mixture().is_settled
    bank.logs[:] = -30.0
    bank.logs[5] = 0.0
    bank.prune()
    mixture = bank.mixture()
    assert [member.number for member in bank.members] == [5]
    assert mixture.others == 0.0 and mixture.is_settled


def test_two_far_answers_are_not_settled_however_narrow(bank):
    bank.logs[:] = -60.0
    bank.logs[0], bank.logs[8] = 0.0, np.log(2e-4)
    bank.prune()
    mixture = bank.mixture()
    assert mixture.others == pytest.approx(2e-4, rel=1e-3) and mixture.sigma < hypotheses.NARROW
    assert not mixture.is_settled
