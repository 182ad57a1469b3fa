"""Blocks of states from outside: their law, what they drive, and a drift of the gyros that a filter finds."""

import numpy as np
import pytest
from navigation_flight import DEG, DT, EARTH, PARAMS, alignment, fly, gps_fix, star_fix
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from test_nav_blocks import (
    BLOCKS,
    COEFFICIENTS,
    DRIFT,
    DRIVE,
    OUTSIDE,
    OWN,
    STATES,
    constants_of,
    each_error,
    state_with_errors,
)
from test_nav_blocks import RNG as RNG  # begins anew with each test of this module, too
from unpacked import window

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import error_model, fusion, prediction
from shefex_nav.onboard.navigation.blocks import Block
from shefex_nav.onboard.navigation.state import ATT, NavState, layout, pack

TRUE = np.array([6e-3, -4e-3, 2e-3]) * DEG  # rad/s^2, drift of the gyros' biases since lift-off
SIGMA = 4e-3 * DEG


def drives(felt):
    """Rate errors of a drift with the time."""
    return np.vstack([felt.t_s * np.eye(3), np.zeros((3, 3))])


RAMP = Block("ramp", SIGMA**2 * np.eye(3), np.zeros(3), drives=drives)


def test_a_law_of_its_own_grows_as_its_equation_says():
    """Covariance of OWN over 2 s, many steps, against the integral of its differential equation."""
    order, imu = layout(("own",), (DRIFT, OWN)), window(BLOCKS[0])._replace(drive=COEFFICIENTS)
    state = NavState(0.0, *STATES[0][1:6], others=np.array([2e-3, -1e-3]))
    x, P, place = pack(state), np.zeros((order.n, order.n)), order.places["own"]
    P[place, place] = OWN.P
    constants = constants_of(order)
    for _ in range(200):
        x, P = prediction.advance(constants, x, 0.0, P, imu, 0.0, 0.01)

    def slope(_, flat):
        grown = OWN.F @ flat.reshape(2, 2)
        return (grown + grown.T + np.diag(OWN.walk**2)).ravel()

    expected = solve_ivp(slope, (0.0, 2.0), OWN.P.ravel(), rtol=1e-10, atol=1e-12).y[:, -1].reshape(2, 2)
    np.testing.assert_allclose(P[place, place], expected, rtol=1e-5)
    assert np.array_equal(P, P.T)
    np.testing.assert_allclose(x[order.values["own"]], expm(2.0 * OWN.F) @ state.others, rtol=1e-12)


@pytest.mark.parametrize("T", [0.01, 0.4, 2.5])
@pytest.mark.parametrize(
    "F",
    [np.array([[-10.0, 0.0], [0.0, -0.01]]), np.array([[0.0, 10.0], [-10.0, 0.0]]), OWN.F],
    ids=["fast and slow", "swinging", "own"],
)
def test_ticks_may_be_long_against_a_law(F, T):
    """Replays have ticks of seconds; exp(F T) by scipy, the noise by the integral of its equation."""
    order = layout(("own",), (block := OWN._replace(F=F, drives=None),))
    constants = prediction.constants(order, error_model.record(PARAMS), EARTH, (block,))
    imu = window(BLOCKS[0]._replace(dt_s=T / 4.0))
    state = NavState(0.0, *STATES[0][1:6], others=np.zeros(2))
    Phi, Q = prediction.growth(constants, order, state, imu, 0.0, T)
    place = order.places["own"]
    np.testing.assert_allclose(Phi[place, place], expm(F * T), atol=1e-10)

    def slope(_, flat):
        grown = F @ flat.reshape(2, 2)
        return (grown + grown.T + np.diag(OWN.walk**2)).ravel()

    expected = solve_ivp(slope, (0.0, T), np.zeros(4), rtol=1e-10, atol=1e-14).y[:, -1].reshape(2, 2)
    np.testing.assert_allclose(Q[place, place], expected, atol=5e-3 * expected.max())


def test_what_a_block_from_outside_drives_is_in_the_covariance():
    """A tick with all of OUTSIDE, against Phi P Phi^T + Q in NumPy."""
    state, imu = state_with_errors(OUTSIDE.names), window(BLOCKS[11], window(BLOCKS[10]))
    imu = imu._replace(drive=DRIVE)
    scale = np.array([step for _, _, step in each_error(OUTSIDE)])
    A = RNG.standard_normal((OUTSIDE.n, OUTSIDE.n))
    P = (A @ A.T + np.eye(OUTSIDE.n)) * np.outer(scale, scale)
    constants = constants_of(OUTSIDE)
    Phi, Q = prediction.growth(constants, OUTSIDE, state, imu, 0.001, 0.009)
    assert np.abs(Phi[:9, OUTSIDE.places["own"]]).min(axis=0).max() > 0.0
    _, found = prediction.advance(constants, pack(state), state.t_s, P, imu, 0.001, 0.009)
    expected = Phi @ P @ Phi.T + Q
    sigma = np.sqrt(np.diag(expected))
    assert np.abs((found - expected) / np.outer(sigma, sigma)).max() < 1e-12


@pytest.fixture(scope="module")
def drifting():
    """A filter that estimates the drift and one that knows nothing of it, after 20 s: {estimated: Filter}."""
    blocks, states = fly(20.0)
    found = {}
    for estimated in (True, False):
        names = (*PARAMS.states, "ramp") if estimated else PARAMS.states
        nav = fusion.start(PARAMS._replace(states=names, own_blocks=(RAMP,)), alignment(states[0]), EARTH)
        rng = np.random.default_rng(7)
        for k, block in enumerate(blocks, 1):
            rate = TRUE * (block.t_valid_s - 0.5 * len(block.dtheta_b) * DT)
            fusion.advance(nav, block._replace(dtheta_b=block.dtheta_b + rate * DT))
            if k % 50 == 0:
                fusion.fuse(nav, [("gps", gps_fix(blocks, states, block.t_valid_s - 0.0813, 0.08, rng))])
            if k % 10 == 0:
                fix = star_fix(blocks, states, block.t_valid_s - 0.05, 0.05, rng)
                fusion.fuse(nav, [("star_tracker", fix)])
        found[estimated] = nav
    return found


def attitude_error(nav):
    """Rotation from the estimate to the truth (3,), and the sigma that the filter says."""
    end, (_, states) = nav.history[-1], fly(20.0)
    error = rotation.rotvec_between(end.state.q_ib, states[-1].q_ib)
    return error, np.sqrt(np.diag(end.P)[ATT])


def test_a_drift_of_the_gyros_is_found(drifting):
    """To a quarter of what was known before, within what the filter says of it."""
    nav = drifting[True]
    end, place = nav.history[-1], nav.layout.places["ramp"]
    error = end.state.others - TRUE
    sigma = np.sqrt(np.diag(end.P)[place])
    assert np.abs(error / sigma).max() < 4.0
    assert sigma.max() < 0.25 * SIGMA
    assert nav.health["star_tracker"].used > 150
    turned, says = attitude_error(nav)
    assert np.abs(turned / says).max() < 4.0


def test_a_drift_that_is_not_estimated_is_worse(drifting):
    """The filter finds the gyros wrong, and what it says of the attitude afterwards is far less."""
    nav = drifting[False]
    (turned, says), (better, surer) = attitude_error(nav), attitude_error(drifting[True])
    assert np.linalg.norm(turned) > 3.0 * np.linalg.norm(better)
    assert np.linalg.norm(says) > 3.0 * np.linalg.norm(surer)
    assert nav.layout.places["ramp"] is None and not nav.constants.driving


def test_the_solution_is_corrected_by_what_a_block_drives(drifting):
    """The rate that is told has the drift taken out, and the sigma of it knows the drift."""
    from shefex_nav.onboard.navigation import solution

    nav, (blocks, states) = drifting[True], fly(20.0)
    told = solution.solution(nav)
    true = blocks[-1].dtheta_b[-1] / DT
    drift = TRUE * states[-1].t_s
    assert np.linalg.norm(drift) > 1e-3
    assert np.linalg.norm(told.omega_ib_b - true) < 0.1 * np.linalg.norm(drift)


def test_no_sample_is_lost_where_the_history_grows(drifting):
    """The coefficients stand in the place of their tick."""
    history = drifting[True].history
    for k in range(1, len(history)):
        imu = history.imu(k)
        middle_s = imu.t_end_s - 0.5 * imu.length_s
        np.testing.assert_allclose(imu.drive[:3], middle_s * np.eye(3), rtol=0.0, atol=1e-12)
