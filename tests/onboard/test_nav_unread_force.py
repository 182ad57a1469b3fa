"""An accelerometer axis at the end of its range, and an attitude that is hardly known: what GPS may teach."""

import numpy as np
import pytest
from navigation_flight import DT, EARTH, PARAMS, Q_0, R_0, V_0, alignment, gps_fix
from scipy import stats
from unpacked import propagate, window

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import error_model, fusion, integrity_imu, integrity_watch, prediction
from shefex_nav.onboard.navigation.state import ATT, VEL, NavState, initial, layout, pack
from shefex_nav.onboard.navigation.strapdown import ImuWindow
from shefex_nav.onboard.navigation.unknown_attitude import ALIKE, UNKNOWN2
from shefex_nav.records import ImuBlock

RANGE, MISSED, AXIS = 100.0, 50.0, 2  # m/s^2, m/s^2, z
RULES = integrity_imu.NO_RULES._replace(range=np.array([np.inf, RANGE]), missed=np.array([1.0, MISSED]))
WATCHED = PARAMS._replace(integrity=integrity_watch.DEFAULT._replace(imu=RULES))
ORDER = layout(PARAMS.states)
START = NavState(0.0, R_0, V_0, Q_0, *[np.zeros(3)] * 4)
RATE = np.array([0.05, 0.02, -0.03])  # rad/s
BEGIN_S, END_S, FIX_S = 0.5, 2.0, 0.5  # of the readings at the end of the range; between two fixes


def truth(force):
    """Blocks and states of a fall with a specific force along z from BEGIN_S until END_S."""
    blocks, states, imu = [], [START], None
    for k in range(round(100 * (END_S + 0.5))):
        t_s = (k + 1) / 100.0
        f_b = np.zeros(3)
        f_b[AXIS] = force if BEGIN_S < t_s <= END_S else 0.0
        block = ImuBlock(t_s, t_s, DT, np.tile(RATE * DT, (4, 1)), np.tile(f_b * DT, (4, 1)), False)
        imu = window(block, imu)
        r_i, v_i, q_ib = propagate(states[-1], imu, 0.0, 4 * DT, EARTH)
        blocks.append(block)
        states.append(NavState(t_s, r_i, v_i, q_ib, *START[4:]))
    return blocks, states


def flown(force, sigma, rng):
    """Error of attitude and velocity, and their covariance, of a filter that reads the end of the range."""
    blocks, states = truth(force)
    started = alignment(START, rng)
    q_ib = rotation.quat_multiply(Q_0, rotation.quat_from_rotvec(sigma * rng.standard_normal(3)))
    nav = fusion.start(WATCHED, started._replace(q_ib=q_ib, P_theta_b=sigma**2 * np.eye(3)), EARTH)
    for block in blocks:
        dv_b = block.dv_b + 1e-5 * rng.standard_normal((4, 3))
        read = BEGIN_S < block.t_valid_s <= END_S
        if read:
            dv_b[:, AXIS] = RANGE * DT
        fusion.advance(nav, block._replace(dv_b=dv_b, saturated=read))
        if round(100 * block.t_valid_s) % round(100 * FIX_S) == 0:
            fusion.fuse(nav, [("gps", gps_fix(blocks, states, block.t_valid_s - 1e-4, 0.0, rng))])
    state, P = nav.history[-1].state, nav.history.P
    theta = rotation.rotvec_between(state.q_ib, states[-1].q_ib)
    return theta, states[-1].v_i - state.v_i, P


@pytest.mark.parametrize("sigma", [0.05, 0.3, np.sqrt(UNKNOWN2)])
@pytest.mark.parametrize("drawn", [True, False])
def test_readings_at_the_end_of_the_range_teach_nothing_false_of_the_attitude(sigma, drawn):
    """Truth: a force that differs from the reading by what it may miss, or, as of a fault, none at all."""
    rng, runs, attitude, velocity = np.random.default_rng(9), 20, [], []
    for _ in range(runs):
        force = RANGE + MISSED * rng.standard_normal() if drawn else 0.0
        theta, dv_i, P = flown(force, sigma, rng)
        attitude.append(theta @ np.linalg.solve(P[ATT, ATT], theta))
        velocity.append(dv_i @ np.linalg.solve(P[VEL, VEL], dv_i))
    low, high = stats.chi2.ppf([1e-3, 1.0 - 1e-3], 3 * runs) / runs
    assert np.mean(attitude) < high and np.mean(velocity) < high
    assert np.mean(attitude) > low or sigma > 1.0  # an error is half a turn at most


def one_tick(P, f_b, extra):
    """Covariance after a tick with white noise of more, body axes."""
    increments = np.tile(np.concatenate([np.zeros(3), f_b]) * DT, (6, 1))
    imu = ImuWindow(0.01, DT, increments, 0.0, extra)
    constants = prediction.constants(ORDER, error_model.record(PARAMS), EARTH)
    return prediction.advance(constants, pack(START), 0.0, P, imu, 0.0, 4 * DT)


def test_a_missed_force_is_felt_across_by_the_error_of_the_attitude():
    """Covariance of m theta x e_z with theta drawn, `ALIKE` times as large as it is."""
    rng, m = np.random.default_rng(4), 30.0
    _, P = initial(PARAMS, ORDER, alignment(START), EARTH)
    root = 0.03 * rng.standard_normal((3, 3))
    P[ATT, ATT] = root @ root.T
    extra = np.zeros((3, 3))
    extra[1, AXIS] = (m * 0.01) ** 2 / 0.01
    C = rotation.dcm_from_quat(Q_0)
    (_, with_it), (_, without) = (one_tick(P, np.zeros(3), e) for e in (extra, np.zeros((3, 3))))
    added = C.T @ (with_it - without)[VEL, VEL] @ C
    theta = rng.multivariate_normal(np.zeros(3), P[ATT, ATT], 20000)
    expected = ALIKE**2 * (0.01 * m) ** 2 * np.cov(np.cross(theta, np.eye(3)[AXIS]).T)
    expected[AXIS, AXIS] += (0.01 * m) ** 2
    np.testing.assert_allclose(added, expected, atol=0.03 * expected.max())


def test_what_is_lost_across_is_bounded_as_a_sine_is():
    _, P = initial(PARAMS, ORDER, alignment(START), EARTH)
    P[ATT, ATT] = UNKNOWN2 * np.eye(3)
    extra = np.zeros((3, 3))
    extra[1, AXIS] = 1.0
    C = rotation.dcm_from_quat(Q_0)
    (_, with_it), (_, without) = (one_tick(P, np.zeros(3), e) for e in (extra, np.zeros((3, 3))))
    across = np.diag(C.T @ (with_it - without)[VEL, VEL] @ C)[:2]
    np.testing.assert_allclose(across, 0.5 * ALIKE**2 * 0.01, rtol=0.01)
