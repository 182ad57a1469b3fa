"""Roll, pitch and heading against scipy, and their Jacobian against small turns."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from shefex_nav.geometry import euler, rotation

ANGLES = np.radians([(10.0, -20.0, 300.0), (-170.0, 80.0, 45.0), (0.0, 0.0, 0.0), (95.0, -60.0, 181.0)])


@pytest.mark.parametrize("angles", ANGLES)
def test_matrix_is_scipys_and_comes_back(angles):
    roll, pitch, heading = angles
    C_nb = euler.dcm_from_euler(roll, pitch, heading)
    expected = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    np.testing.assert_allclose(C_nb, expected, atol=1e-14)
    back = np.array(euler.euler_from_dcm(C_nb))
    np.testing.assert_allclose((back - angles + np.pi) % (2.0 * np.pi) - np.pi, 0.0, atol=1e-12)


def test_level_and_east():
    """A body that looks east with its right wing down: y points south and down."""
    C_nb = euler.dcm_from_euler(np.radians(30.0), 0.0, np.radians(90.0))
    np.testing.assert_allclose(C_nb[:, 0], [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(C_nb[:, 1], [-np.cos(np.radians(30.0)), 0.0, 0.5], atol=1e-15)


@pytest.mark.parametrize("angles", ANGLES)
def test_jacobian_is_the_derivative(angles):
    roll, pitch, heading = angles
    C_nb, step = euler.dcm_from_euler(roll, pitch, heading), 1e-6
    J = euler.euler_jacobian(roll, pitch)
    for k in range(3):
        turn = np.zeros(3)
        turn[k] = step
        forward = np.array(euler.euler_from_dcm(C_nb @ rotation.dcm_from_rotvec(turn)))
        backward = np.array(euler.euler_from_dcm(C_nb @ rotation.dcm_from_rotvec(-turn)))
        difference = ((forward - backward + np.pi) % (2.0 * np.pi) - np.pi) / (2.0 * step)
        np.testing.assert_allclose(J[:, k], difference, atol=1e-8)
