"""The algebra on tuples against scipy and NumPy, which know nothing of it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from shefex_nav.geometry import triples as t3

RNG = np.random.default_rng(1)  # anew in each test: conftest.own_numbers
A, B = RNG.normal(size=(2, 3, 3))
U, V, W = RNG.normal(size=(3, 3))


def nine(C):
    return t3.matrix(np.ascontiguousarray(C))


def square(numbers):
    return np.reshape(numbers, (3, 3))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 9.9e-5, 1.01e-4, 0.1, 1.0, 3.1])
def test_exp_and_log_at_every_scale(angle):
    """Both branches of the series, all axes; scalar first."""
    for axis in [*np.eye(3), *(RNG.normal(size=(5, 3)))]:
        phi = angle * axis / np.linalg.norm(axis)
        q = np.array(t3.quat_from_rotvec(tuple(phi)))
        assert_allclose(q[[1, 2, 3, 0]], Rotation.from_rotvec(phi).as_quat(), rtol=1e-14, atol=1e-16)
        assert_allclose(t3.rotvec_from_quat(tuple(q)), phi, rtol=1e-11, atol=1e-16)
        assert_allclose(t3.rotvec_from_quat(tuple(-q)), phi, rtol=1e-11, atol=1e-16)


def test_quaternions_turn_as_scipy_turns():
    one, other = Rotation.from_rotvec(U), Rotation.from_rotvec(V)
    p, q = (tuple(rotation.as_quat()[[3, 0, 1, 2]]) for rotation in (one, other))
    assert_allclose(t3.quat_rotate(p, tuple(W)), one.apply(W), atol=1e-14)
    assert_allclose(t3.quat_rotate(t3.quat_multiply(p, q), tuple(W)), one.apply(other.apply(W)), atol=1e-14)
    assert_allclose(t3.quat_rotate(t3.quat_conjugate(p), tuple(W)), one.inv().apply(W), atol=1e-14)
    assert_allclose(square(t3.dcm_from_quat(p)), one.as_matrix(), atol=1e-14)
    assert_allclose(t3.quat_normalise(tuple(3.0 * x for x in p)), p, atol=1e-15)


def test_matrices_are_numpys():
    skew = np.cross(W, np.eye(3)).T  # skew @ u = w x u
    for got, wanted in (
        (square(t3.product(nine(A), nine(B))), A @ B),
        (square(t3.transposed(nine(A))), A.T),
        (square(t3.inverse(nine(A))), np.linalg.inv(A)),
        (square(t3.composed(2.0, tuple(U), tuple(V), tuple(W))), 2.0 * np.eye(3) + np.outer(U, V) + skew),
        (t3.rotated(nine(A), tuple(U)), A @ U),
        (t3.cross(tuple(U), tuple(V)), np.cross(U, V)),
        (t3.plus(tuple(U), 2.0, tuple(V)), U + 2.0 * V),
        (t3.dot(tuple(U), tuple(V)), U @ V),
    ):
        assert_allclose(got, wanted, rtol=1e-12, atol=1e-13)
    out = np.empty((3, 3))
    t3.store(out, nine(A))
    assert np.array_equal(out, A)


def test_arrays_do_for_vectors_and_quaternions():
    q = np.array(t3.quat_from_rotvec(U))
    assert t3.quat_rotate(q, V) == t3.quat_rotate(tuple(q), tuple(V))
