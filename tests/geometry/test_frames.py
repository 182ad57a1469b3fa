"""Earth-fixed and inertial states: inverse of each other, and velocity as the derivative of position."""

import numpy as np
from numpy.testing import assert_allclose

from shefex_nav.geometry import frames, rotation, wgs84

EARTH = frames.EarthRotation(
    C_iq=rotation.dcm_from_rotvec(np.array([1e-3, -2e-3, 5e-4])),
    C_re=rotation.dcm_from_rotvec(np.array([2e-6, 4e-7, 0.0])),
    angle_0=2.5,
    rate=wgs84.OMEGA,
)
R_E = np.array([2.1e6, 0.6e6, 6.0e6])
V_E = np.array([100.0, -2000.0, 900.0])


def test_there_and_back():
    r_i, v_i = frames.inertial_from_ecef(EARTH, 123.4, R_E, V_E)
    r_e, v_e = frames.ecef_from_inertial(EARTH, 123.4, r_i, v_i)
    assert_allclose(r_e, R_E, atol=1e-8)
    assert_allclose(v_e, V_E, atol=1e-11)


def test_inertial_velocity_is_the_derivative_of_inertial_position():
    t, h = 50.0, 0.01
    before, _ = frames.inertial_from_ecef(EARTH, t - h, R_E - h * V_E, V_E)
    after, _ = frames.inertial_from_ecef(EARTH, t + h, R_E + h * V_E, V_E)
    _, v_i = frames.inertial_from_ecef(EARTH, t, R_E, V_E)
    assert_allclose((after - before) / (2 * h), v_i, atol=1e-5)


def test_earth_turns_eastwards_about_its_axis():
    axis = frames.omega_ie_i(EARTH)
    assert_allclose(np.linalg.norm(axis), wgs84.OMEGA, rtol=1e-12)
    turn = frames.dcm_ie(EARTH, 10.0) @ frames.dcm_ie(EARTH, 0.0).T
    assert_allclose(turn, rotation.dcm_from_rotvec(10.0 * axis), atol=1e-12)
