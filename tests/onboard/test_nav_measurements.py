"""Measurements against finite differences, and the covariance engine against plain formulae."""

import numpy as np
import pytest
import unpacked
from navigation_flight import antenna_of
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from unpacked import correct

from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation import eskf, integrity, measurements
from shefex_nav.onboard.navigation.state import (
    ATT,
    CORE,
    N_CORE,
    OPTIONAL,
    NavState,
    layout,
    right_jacobian,
)
from shefex_nav.records import GpsFix, StarFix

RNG = np.random.default_rng(7)  # anew in each test: conftest.own_numbers
LAYOUT = layout()
N_ERROR = LAYOUT.n
EARTH = frames.EarthRotation(
    rotation.dcm_from_rotvec(np.array([1e-3, -2e-3, 5e-4])), np.eye(3), 2.5, 7.292115e-5
)
ARM = np.array([0.6, 0.05, -0.3])
C_BC = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
Q_BC = rotation.quat_from_dcm(C_BC)
SPIN = np.array([9.4, 0.2, -0.1])  # what the gyros measure, rad/s
FORCE = np.array([60.0, 1.0, -2.0])  # m/s^2, corrected
STEP = np.repeat([1.0, 1e-2, 1e-5, 1e-4, 1e-2, 1e-5, 1e-5], 3)


def random_state(t_s=123.4):
    return NavState(
        t_s,
        np.array([2.1e6, 0.6e6, 6.0e6]),
        np.array([1500.0, -900.0, 700.0]),
        rotation.quat_normalise(RNG.standard_normal(4)),
        1e-4 * RNG.standard_normal(3),
        0.01 * RNG.standard_normal(3),
        gyro_roll_column=3e-4 * RNG.standard_normal(3),
        mounting=2e-3 * RNG.standard_normal(3),
    )


def true_rate(state):
    """Rate for which gyros with the errors of `state` measure SPIN: (I + k e_x^T) omega + bias = SPIN."""
    response = np.eye(3) + np.outer(state.gyro_roll_column, [1.0, 0.0, 0.0])
    return np.linalg.solve(response, SPIN - state.gyro_bias)


def antenna(state):
    """Position and velocity of the antenna in e, from the motion of the point: finite difference in time."""

    def place(dt):
        turned = Rotation.from_quat(rotation.xyzw(state.q_ib)) * Rotation.from_rotvec(true_rate(state) * dt)
        r_i = state.r_i + state.v_i * dt + turned.apply(ARM)
        return frames.dcm_ie(EARTH, state.t_s + dt).T @ r_i

    h = 1e-4
    return place(0.0), (place(h) - place(-h)) / (2.0 * h)


def gps_fix(state):
    r_e, v_e = antenna(state)
    return GpsFix(state.t_s, state.t_s, True, r_e, v_e, 4.0 * np.eye(3), 0.01 * np.eye(3), 9, 2.0, "")


def star_fix(state):
    """What a star tracker without noise measures."""
    C_bc = rotation.dcm_from_rotvec(state.mounting) @ C_BC
    q_ic = rotation.quat_from_dcm(rotation.dcm_from_quat(state.q_ib) @ C_bc)
    P_c = np.diag([1e-4, 1e-4, 5e-4]) ** 2
    return StarFix(0, state.t_s, state.t_s, 0, q_ic, P_c, None, None, 0.3, 12.0, 0.05, False, False)


def estimated_antenna(state):
    return antenna_of(LAYOUT, state, EARTH, ARM, true_rate(state), FORCE, 0.0)


def gps_position(state, truth):
    return measurements.gps_position(gps_fix(truth), estimated_antenna(state))


def gps_velocity(state, truth):
    return measurements.gps_velocity(gps_fix(truth), estimated_antenna(state))


def star_attitude(state, truth):
    return unpacked.star_attitude(LAYOUT, state, star_fix(truth), C_BC, 0.0)


MODELS = [gps_position, gps_velocity, star_attitude]


@pytest.mark.parametrize("model", MODELS)
def test_innovation_of_a_perfect_measurement_is_zero(model):
    state = random_state()
    z, _, _ = model(state, state)
    assert np.abs(z).max() < {gps_position: 1e-8, gps_velocity: 1e-4, star_attitude: 1e-15 * 1e1}[model]


@pytest.mark.parametrize("model", MODELS)
def test_jacobian_is_the_derivative_of_the_measurement_with_respect_to_the_truth(model):
    """truth = estimate (+) dx: the fix moves with the truth, the prediction stays.

    The true velocity of the antenna is differentiated from its position, hence its rounding; sharper below.
    """
    state = random_state()
    _, H, _ = model(state, state)
    assert H.shape == (3, N_ERROR)
    for j in range(N_ERROR):
        dx = np.zeros(N_ERROR)
        dx[j] = STEP[j]
        slope = (
            model(state, correct(LAYOUT, state, dx))[0] - model(state, correct(LAYOUT, state, -dx))[0]
        ) / (2 * STEP[j])
        scale = np.abs(H).max() if model is star_attitude else np.abs(H[:, j]).max()
        # rounding of 6e6 m (1e-9), of the same over 2e-4 s (2e-5 m/s), of a rotation; by the step
        rounding = {gps_position: 4e-9, gps_velocity: 2e-5, star_attitude: 1e-15}[model] / STEP[j]
        assert np.abs(slope - H[:, j]).max() <= 1e-6 * scale + rounding, j


def test_jacobian_of_the_velocity_against_its_own_innovation():
    """The estimate moves, the fix stays; free of the rounding of a differentiated position, so to 1e-6."""
    state = random_state()
    fix = gps_fix(state)

    def innovation(estimate):
        return measurements.gps_velocity(fix, estimated_antenna(estimate))[0]

    _, H, _ = gps_velocity(state, state)
    for j in range(N_ERROR):
        dx = np.zeros(N_ERROR)
        dx[j] = STEP[j]
        slope = -(innovation(correct(LAYOUT, state, dx)) - innovation(correct(LAYOUT, state, -dx))) / (
            2 * STEP[j]
        )
        assert np.abs(slope - H[:, j]).max() <= 1e-6 * np.abs(H[:, j]).max() + 1e-12 / STEP[j], j


def test_covariance_of_a_star_fix_is_turned_from_camera_to_body():
    """The camera looks along body y: the large error about the boresight must come out about body y."""
    _, _, R = star_attitude(random_state(), random_state())
    assert np.allclose(np.sqrt(np.diag(R)), [1e-4, 5e-4, 1e-4])
    _, _, R = unpacked.star_attitude(LAYOUT, random_state(), star_fix(random_state()), C_BC, 3e-4)
    assert np.allclose(np.diag(R), [1e-8 + 9e-8, 25e-8 + 9e-8, 1e-8 + 9e-8])


def test_star_residual_of_a_large_error_is_that_rotation():
    """28 degrees of roll, as a scale factor of 300 ppm leaves behind."""
    truth = random_state()._replace(mounting=np.zeros(3))
    error = np.deg2rad([28.0, 0.3, -0.2])
    dx = np.zeros(N_ERROR)
    dx[ATT] = -error
    z, _, _ = star_attitude(correct(LAYOUT, truth, dx), truth)
    assert np.allclose(z, error, atol=1e-12)


def test_right_jacobian_composes_rotations():
    for phi in (np.array([0.5, -0.7, 0.3]), np.array([1e-3, 2e-3, -1e-3]), np.zeros(3)):
        d = 1e-6 * np.array([1.0, -2.0, 3.0])
        whole = Rotation.from_rotvec(phi + d)
        parts = Rotation.from_rotvec(phi) * Rotation.from_rotvec(right_jacobian(phi) @ d)
        assert (whole.inv() * parts).magnitude() < 1e-11


def random_covariance(scale):
    A = RNG.standard_normal((N_ERROR, N_ERROR))
    return (A @ A.T + N_ERROR * np.eye(N_ERROR)) * np.outer(scale, scale)


SCALE = np.repeat([2.0, 0.1, 1e-3, 1e-6, 1e-3, 1e-5, 1e-4], 3)


def test_predict_is_phi_p_phi_transposed_plus_q():
    P, Q = random_covariance(SCALE), random_covariance(0.1 * SCALE)
    Phi = np.eye(N_ERROR) + 0.01 * RNG.standard_normal((N_ERROR, N_ERROR)) * np.outer(SCALE, 1 / SCALE)
    after = unpacked.predict(LAYOUT, P.copy(), Phi, Q)
    assert np.allclose(after / np.outer(SCALE, SCALE), (Phi @ P @ Phi.T + Q) / np.outer(SCALE, SCALE))
    assert np.array_equal(after, after.T)


@pytest.mark.parametrize("model", MODELS)
def test_update_is_the_information_form_and_turns_the_attitude_error(model):
    state = random_state()
    P = random_covariance(SCALE)
    dx_true = np.linalg.cholesky(P) @ RNG.standard_normal(N_ERROR)
    z, H, R = model(state, correct(LAYOUT, state, dx_true))
    after, P_after, _, _ = unpacked.update(eskf.engine(LAYOUT), LAYOUT, state, P.copy(), z, H, R)
    S = np.outer(SCALE, SCALE)
    information = np.linalg.inv(P / S) + (H * SCALE).T @ np.linalg.inv(R) @ (H * SCALE)
    P_ref = np.linalg.inv(information) * S
    dx = P_ref @ H.T @ np.linalg.inv(R) @ z
    G = np.eye(N_ERROR)
    G[ATT, ATT] = right_jacobian(dx[ATT])
    assert np.allclose(P_after / S, G @ P_ref @ G.T / S, atol=1e-9)
    expected = correct(LAYOUT, state, dx)
    assert np.allclose(after.r_i, expected.r_i, rtol=0, atol=1e-6)
    assert np.allclose(after.q_ib, expected.q_ib, atol=1e-11)
    assert np.allclose(after.gyro_roll_column, expected.gyro_roll_column, rtol=1e-6)


def test_forgetting_a_block_cuts_its_ties_and_no_others():
    P = random_covariance(SCALE)
    after = eskf.forget(P, ATT, np.pi**2)
    assert np.allclose(after[ATT, ATT], np.pi**2 * np.eye(3))
    others = [i for i in range(N_ERROR) if not ATT.start <= i < ATT.stop]
    assert np.all(after[ATT][:, others] == 0.0) and np.all(after[:, ATT][others] == 0.0)
    assert np.array_equal(after[np.ix_(others, others)], P[np.ix_(others, others)])


def test_every_error_has_one_place():
    for names in ((), ("mounting", "gyro_roll_column"), tuple(OPTIONAL)[1:]):
        order = layout(names)
        places = [i for place in order.places.values() if place for i in range(place.start, place.stop)]
        assert sorted(places) == list(range(order.n))
        assert set(order.names) == set(names) == {k for k in OPTIONAL if order.places[k] is not None}
        assert order.n == N_CORE + sum(OPTIONAL[name] for name in names)
        assert all(order.places[name] == place for name, place in CORE.items())


@pytest.mark.parametrize("probability", [1e-2, 1e-4, 1e-6])
def test_gate_is_the_chi_square_quantile(probability):
    assert integrity.chi_square_limit(probability, 3) == pytest.approx(chi2.isf(probability, 3))
