"""Rotations against scipy's independent implementation, the group laws, and small angles."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from shefex_nav.geometry import rotation as rot

RNG = np.random.default_rng(1)  # anew in each test: conftest.own_numbers
QUATS = RNG.normal(size=(50, 4))
QUATS /= np.linalg.norm(QUATS, axis=1)[:, None]


def test_dcm_agrees_with_scipy_and_takes_b_to_a():
    for q in QUATS:
        assert_allclose(rot.dcm_from_quat(q), Rotation.from_quat(rot.xyzw(q)).as_matrix(), atol=1e-14)
    quarter_turn_about_z = rot.quat_from_rotvec(np.array([0.0, 0.0, np.pi / 2]))
    assert_allclose(rot.quat_rotate(quarter_turn_about_z, np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-15)


def test_product_is_composition():
    for p, q in zip(QUATS, QUATS[::-1], strict=True):
        C = rot.dcm_from_quat(p) @ rot.dcm_from_quat(q)
        assert_allclose(rot.dcm_from_quat(rot.quat_multiply(p, q)), C, atol=1e-14)


def test_conjugate_inverts():
    for q in QUATS:
        assert_allclose(rot.quat_multiply(q, rot.quat_conjugate(q)), [1, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-9, 1e-7, 9.9e-5, 1.01e-4, 0.1, 1.0, 3.1415])
def test_log_inverts_exp_at_every_scale(angle):
    for axis in QUATS[:10, 1:] / np.linalg.norm(QUATS[:10, 1:], axis=1)[:, None]:
        phi = angle * axis
        assert_allclose(rot.rotvec_from_quat(rot.quat_from_rotvec(phi)), phi, rtol=1e-12, atol=1e-16)


def test_log_takes_the_shorter_way():
    for q in QUATS:
        phi = rot.rotvec_from_quat(q)
        assert np.linalg.norm(phi) <= np.pi + 1e-12
        assert_allclose(rot.rotvec_from_quat(-q), phi, atol=1e-14)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0.8, 0]])
@pytest.mark.parametrize("angle", [0.0, 0.5, np.pi - 1e-9, np.pi])
def test_quat_from_dcm_in_all_branches(axis, angle):
    C = rot.dcm_from_rotvec(angle * np.array(axis, float))
    assert_allclose(rot.dcm_from_quat(rot.quat_from_dcm(C)), C, atol=1e-12)


def test_skew_and_cross():
    u, v = RNG.normal(size=(2, 3))
    assert_allclose(rot.skew(u) @ v, np.cross(u, v), atol=1e-15)
    assert_allclose(rot.cross(u, v), np.cross(u, v), atol=1e-15)


def test_rotvec_between_has_the_sign_of_the_error_state():
    error = RNG.normal(scale=0.3, size=(50, 3))
    truth = np.array(
        [rot.quat_multiply(q, rot.quat_from_rotvec(e)) for q, e in zip(QUATS, error, strict=True)]
    )
    assert_allclose(rot.rotvec_between(QUATS, truth), error, atol=1e-12)
    assert_allclose(rot.rotvec_between(QUATS, -truth), error, atol=1e-12)
    assert_allclose(rot.rotvec_between(QUATS[3], truth[3]), error[3], atol=1e-12)
    assert_allclose(rot.rotvec_between(QUATS, QUATS), 0.0, atol=1e-15)
