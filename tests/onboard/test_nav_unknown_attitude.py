"""Attitude that is hardly known: the covariance holds what a linear model of errors leaves out."""

import numpy as np
import pytest
from navigation_flight import DEG, DT, EARTH, PARAMS, Q_0, R_0, V_0, alignment

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import (
    error_model,
    eskf,
    fusion,
    integrity_imu,
    integrity_watch,
    prediction,
)
from shefex_nav.onboard.navigation.state import ATT, VEL, NavState, initial, layout, pack
from shefex_nav.onboard.navigation.strapdown import ImuWindow
from shefex_nav.onboard.navigation.unknown_attitude import LARGE2, UNKNOWN2, second_order, take_share
from shefex_nav.records import ImuBlock

RANGE = 4.0  # rad/s, of the gyros
RULES = integrity_imu.NO_RULES._replace(range=np.array([RANGE, np.inf]), missed=np.array([RANGE, 50.0]))
WATCHED = PARAMS._replace(integrity=integrity_watch.DEFAULT._replace(imu=RULES))
ORDER = layout(PARAMS.states)
START = NavState(0.0, R_0, V_0, Q_0, *[np.zeros(3)] * 4)


def window(omega_b, f_b):
    """One tick at a steady rate and specific force."""
    increments = np.tile(np.concatenate([omega_b, f_b]) * DT, (6, 1))
    return ImuWindow(0.01, DT, increments, 0.0, np.zeros((3, 3)))


def predicted(P, seconds, f_b):
    """Covariance after some seconds."""
    imu, x, t_s = window(np.zeros(3), f_b), pack(START), 0.0
    model = error_model.record(PARAMS)
    for _ in range(round(100 * seconds)):
        x, P = prediction.advance(prediction.constants(ORDER, model, EARTH), x, t_s, P, imu, 0.0, 4 * DT)
        t_s += 4 * DT
    return P


def covariance_with(sigma_rad):
    """That of the alignment, but for the attitude."""
    _, P = initial(PARAMS, ORDER, alignment(START), EARTH)
    P[ATT, ATT] = sigma_rad**2 * np.eye(3)
    return P


def is_covariance(P):
    d = np.sqrt(np.diag(P))
    return np.array_equal(P, P.T) and np.linalg.eigvalsh(P / np.outer(d, d)).min() > -1e-9


def test_small_errors_grow_by_the_linear_model_alone():
    P, imu = (
        covariance_with(0.02 * np.sqrt(LARGE2)),
        window(np.array([1.0, 0.1, 0.0]), np.array([30.0, 1.0, 0.0])),
    )
    model = error_model.record(PARAMS)
    constants = prediction.constants(ORDER, model, EARTH)
    _, after = prediction.advance(constants, pack(START), 0.0, P, imu, 0.0, 4 * DT)
    growth = prediction.growth(constants, ORDER, START, imu, 0.0, 4 * DT)
    linear = growth.Phi @ P @ growth.Phi.T + growth.Q
    scale = np.sqrt(np.diag(linear))
    assert np.abs((after - linear) / np.outer(scale, scale)).max() < 1e-12


@pytest.mark.parametrize("sigma", [0.01, 0.02, 0.04, 0.1, 0.3, 1.0])
def test_velocity_under_thrust_in_a_direction_that_is_hardly_known(sigma):
    """Truth: C exp(theta) f t with theta drawn. The sigma of each axis of velocity is not too small."""
    f_b, seconds = np.array([40.0, 0.0, 0.0]), 4.0
    P = predicted(covariance_with(sigma), seconds, f_b)
    rng = np.random.default_rng(3)
    theta = sigma * rng.standard_normal((4000, 3))
    gained = np.array([rotation.dcm_from_rotvec(one) @ f_b * seconds - f_b * seconds for one in theta])
    C_ib = rotation.dcm_from_quat(Q_0)
    P_v = C_ib.T @ P[VEL, VEL] @ C_ib
    rms = np.sqrt((gained**2).mean(axis=0))
    assert np.all(rms < 1.05 * np.sqrt(np.diag(P_v)))
    nees = np.einsum("ki,ij,kj->k", gained, np.linalg.inv(P_v), gained)
    assert nees.mean() < 3.0
    # the first order alone says nothing of the axis of the thrust, where up to all of it is lost
    assert rms[0] > 0.3 * sigma**2 * f_b[0] * seconds
    assert is_covariance(P)


def missed_spin(spin, lean, seconds, rng):
    """Errors of the attitude with a spin beyond the range, and a slow turn of the axis: a flight.

    spin, lean : rad/s, truth about the roll axis, and of that axis in inertial space. -> error (3,) rad, P
    """
    nav = fusion.start(WATCHED, alignment(START, rng), EARTH)
    q_ib, n, phase = Q_0, round(100 * seconds), 2.0 * np.pi * rng.random()
    for k in range(n):
        dtheta_b = np.empty((4, 3))
        for m in range(4):
            roll = phase + spin * (4 * k + m + 0.5) * DT  # the axis turns about what is still outside
            dtheta_b[m] = np.array([spin, lean * np.cos(roll), -lean * np.sin(roll)]) * DT
            q_ib = rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(dtheta_b[m]))
        clipped = np.clip(dtheta_b, -RANGE * DT, RANGE * DT)
        dv_b = 1e-6 * rng.standard_normal((4, 3))
        t_s = (k + 1) * 4 * DT
        fusion.advance(nav, ImuBlock(t_s, t_s, DT, clipped, dv_b, bool(abs(spin) >= RANGE)))
    state, P = nav.history[-1].state, nav.history.P
    return rotation.rotvec_between(q_ib, state.q_ib), P[ATT, ATT]


@pytest.mark.parametrize("ratio", [1.02, 1.5, 3.0])
def test_a_missed_spin_leaves_roll_and_axis_unknown(ratio):
    """The axis turns by 20 deg while the roll is not known: the error of the axis stays within its sigma."""
    rng, nees = np.random.default_rng(5), []
    for _ in range(12):
        error, P = missed_spin(ratio * RANGE, 4.0 * DEG, 5.0, rng)
        assert P[0, 0] > 0.9 * UNKNOWN2
        axis2 = error[1] ** 2 + error[2] ** 2 if abs(error[0]) < 0.1 else tilt(error) ** 2
        nees.append(axis2 / (P[1, 1] + P[2, 2]))
        assert axis2 < 9.0 * (P[1, 1] + P[2, 2])
    assert np.mean(nees) < 1.5


def tilt(error):
    """Angle between the roll axes of two attitudes that a rotation vector is apart."""
    return float(np.arccos(np.clip(rotation.dcm_from_rotvec(error)[0, 0], -1.0, 1.0)))


def test_within_the_range_nothing_is_unknown():
    error, P = missed_spin(0.9 * RANGE, 4.0 * DEG, 5.0, np.random.default_rng(6))
    assert np.sqrt(np.diag(P)).max() < 0.2 * DEG and np.abs(error).max() < 0.5 * DEG


def test_an_angle_is_known_modulo_a_turn_and_its_ties_are_cut():
    P = covariance_with(0.01)
    P[ATT.start, ATT.start] = 100.0
    tie = 0.5 * np.sqrt(P[ATT.start, ATT.start] * P[VEL.start, VEL.start])
    P[ATT.start, VEL.start] = P[VEL.start, ATT.start] = tie
    after = predicted(P, 0.01, np.zeros(3))
    assert after[ATT.start, ATT.start] == UNKNOWN2
    assert not np.delete(after[ATT.start], ATT.start).any()
    assert is_covariance(after)


def test_a_missed_roll_loses_the_direction_of_what_is_wrong_across():
    """Truth: a leaning of which the direction is known, and any roll. Its three angles have no direction."""
    rng, sigma = np.random.default_rng(7), np.array([0.2, 0.02])
    P = covariance_with(0.01)
    P[ATT, ATT] = np.diag([100.0, *sigma**2])
    after = predicted(P, 0.01, np.zeros(3))[ATT, ATT]
    assert after[1, 1] == after[2, 2] and after[1, 2] == 0.0
    errors = []
    for lean in sigma * rng.standard_normal((2000, 2)):
        roll = rng.uniform(-np.pi, np.pi)
        leant = rotation.quat_from_rotvec(np.array([0.0, *lean]))
        turned = rotation.quat_from_rotvec(np.array([roll, 0.0, 0.0]))
        errors.append(rotation.rotvec_from_quat(rotation.quat_multiply(leant, turned)))
    nees = (np.array(errors)[:, 1:] ** 2 / np.diag(after)[1:]).sum(axis=1)
    assert nees.mean() < 2.0
    assert (np.array(errors)[:, 2] ** 2).mean() > 10.0 * sigma[1] ** 2  # what the weaker axis was believed


def updated(P, z, share, noise=1e-3):
    """Estimated attitude and covariance after one look at how far the body is rolled."""
    H = np.zeros((1, ORDER.n))
    H[0, ATT.start] = 1.0
    P_after = np.empty_like(P)
    engine, x = eskf.engine(ORDER), pack(START)
    measured = np.array([z]), H, np.array([[noise**2]])
    dx, _ = eskf.update_packed(engine, ORDER, P, measured, x, P_after, share)
    return dx[ATT.start], P_after


@pytest.mark.parametrize("noise", [1e-3, 0.3, 1.0])
@pytest.mark.parametrize("sigma", [0.1, 0.5, 1.0, 1.8])
def test_the_sine_of_an_angle_says_less_than_the_angle(sigma, noise):
    """Truth: an angle is drawn, its sine is seen. The sigma of the estimate is that of its error."""
    P, rng, left = covariance_with(sigma), np.random.default_rng(8), []
    for theta in sigma * rng.standard_normal(1000):
        estimate, after = updated(P, np.sin(theta) + noise * rng.standard_normal(), take_share, noise)
        left.append(theta - estimate)
    known2 = after[ATT.start, ATT.start]
    assert 0.8 * known2 < np.mean(np.square(left)) < 1.2 * known2
    assert known2 < sigma**2
    assert np.linalg.eigvalsh(after).min() > -1e-9


def test_what_is_known_takes_all_of_a_correction():
    P = covariance_with(0.9 * np.sqrt(LARGE2))
    whole, after = updated(P, 0.1, eskf.take_all)
    same, after_same = updated(P, 0.1, take_share)
    assert whole == same and np.array_equal(after, after_same)


def test_an_angle_that_grows_beyond_a_turn_loses_its_ties_little_by_little():
    """Truth: the mean of exp(i theta) v falls by exp(-growth/2) as a variance grows."""
    P, grown = covariance_with(0.01), 0.02 * UNKNOWN2
    k, v = ATT.start, VEL.start
    P[k, k] = UNKNOWN2 + grown
    P[k, v] = P[v, k] = 0.5 * np.sqrt(P[k, k] * P[v, v])
    after = predicted(P, 0.01, np.zeros(3))
    assert after[k, k] == UNKNOWN2 and is_covariance(after)
    tie = after[k, v] / np.sqrt(after[k, k] * after[v, v])
    assert tie == pytest.approx(0.5 * np.exp(-0.5 * grown), rel=1e-2)


def gained(length, sigma_v=0.05):
    """Heading of which nothing is known, and a velocity that was gained meanwhile. -> P, axis_i, (3,) m/s"""
    axis_i = rotation.quat_rotate(Q_0, np.array([0.0, 0.0, 1.0]))
    along = rotation.quat_rotate(Q_0, np.array([length, 0.0, 0.0]))
    P = covariance_with(0.001)
    P[ATT.stop - 1, ATT.stop - 1] = UNKNOWN2
    P[VEL, VEL] = sigma_v**2 * np.eye(3)
    E = np.eye(len(P))
    E[VEL, ATT.stop - 1] = np.cross(axis_i, along)
    return E @ P @ E.T, axis_i, along


@pytest.mark.parametrize("heading_deg", [-175.0, -100.0, -20.0, 5.0, 60.0, 120.0, 170.0])
def test_the_direction_of_a_long_vector_tells_any_heading(heading_deg):
    """Truth: the velocity that was gained, turned by the heading. Its sine alone has two answers."""
    P, axis_i, along = gained(8.0)
    H, R, heading = np.zeros((3, ORDER.n)), 0.05**2 * np.eye(3), heading_deg * DEG
    H[:, VEL] = np.eye(3)
    z = rotation.dcm_from_rotvec(heading * axis_i) @ along - along
    shift = second_order(P, z, H, R, Q_0)
    engine, P_after = eskf.engine(ORDER), np.empty_like(P)
    dx, _ = eskf.update_packed(engine, ORDER, P, (z - H @ shift, H, R), pack(START), P_after)
    assert dx[ATT][2] == pytest.approx(heading, abs=0.01) and abs(dx[ATT][:2]).max() < 1e-3
    np.testing.assert_allclose((dx + shift)[VEL], z, atol=0.01)
    assert np.sqrt(P_after[ATT.stop - 1, ATT.stop - 1]) == pytest.approx(0.05 * np.sqrt(2.0) / 8.0, rel=0.05)


def test_a_short_vector_and_a_known_angle_are_left_to_the_linear_update():
    H, R = np.zeros((3, ORDER.n)), 0.05**2 * np.eye(3)
    H[:, VEL] = np.eye(3)
    assert second_order(gained(0.1)[0], np.zeros(3), H, R, Q_0) is None
    assert second_order(gained(8.0)[0], np.zeros(3), H, R, Q_0) is not None
    assert second_order(covariance_with(0.04), np.zeros(3), H, R, Q_0) is None
