"""Large corrections of the attitude: what a filter may conclude from them about the camera's mounting."""

import numpy as np
import pytest
from navigation_flight import ARCSEC, C_BC, DEG, EARTH, P_STAR_C, PARAMS, alignment, fly
from plain import plain
from unpacked import star_attitude, update

from shefex_nav.geometry import rotation
from shefex_nav.onboard import navigator
from shefex_nav.onboard.navigation import eskf, fusion, gate
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.sensor import Measurement
from shefex_nav.onboard.navigation.state import ATT, POS, X_MOUNTING, NavState, initial_covariance, layout
from shefex_nav.records import GpsFix, StarFix

LAYOUT = layout(("mounting",))
MOUNTING = LAYOUT.places["mounting"]
SIGMA_MOUNTING = 70.0 * ARCSEC


def fixes(rng, mounting, q_ib, number):
    """Star fixes of a camera that is off by `mounting`."""
    for _ in range(number):
        q = rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(mounting))
        q = rotation.quat_multiply(q, rotation.quat_from_dcm(C_BC))
        q = rotation.quat_multiply(
            q, rotation.quat_from_rotvec(0.1 * np.sqrt(np.diag(P_STAR_C)) * rng.standard_normal(3))
        )
        yield StarFix(0, 0.0, 0.0, 0, q, 0.01 * P_STAR_C, None, None, 0.3, 12.0, 0.05, False, False)


def after(angle, turns, seed):
    """Error of the mounting over its sigma, and that over the one before; the attitude is off by `angle`."""
    rng = np.random.default_rng(seed)
    q_ib, mounting = rotation.quat_normalise(rng.standard_normal(4)), SIGMA_MOUNTING * rng.standard_normal(3)
    axis = rng.standard_normal(3)
    wrong = rotation.quat_multiply(q_ib, rotation.quat_from_rotvec(angle * axis / np.linalg.norm(axis)))
    state = NavState(0.0, np.zeros(3), np.zeros(3), wrong, np.zeros(3), np.zeros(3))
    P = np.eye(LAYOUT.n)
    P[ATT, ATT], P[MOUNTING, MOUNTING] = angle**2 * np.eye(3), SIGMA_MOUNTING**2 * np.eye(3)
    kalman = eskf.engine(LAYOUT)
    for fix in fixes(rng, mounting, q_ib, 20):
        z, H, R = star_attitude(LAYOUT, state, fix, C_BC, 0.0)
        state, P, _, _ = update(kalman, LAYOUT, state, P, z, H, R, turns)
    sigma = np.sqrt(np.diag(P)[MOUNTING])
    return (mounting - state.mounting) / sigma, sigma / SIGMA_MOUNTING


@pytest.mark.parametrize("angle", [0.2 * DEG, 2.5 * DEG, 10.0 * DEG, 60.0 * DEG])
def test_a_large_correction_says_nothing_about_the_mounting(angle):
    """Attitude and mounting add up in every star fix, whatever the attitude was believed to be before."""
    off = []
    for seed in range(20):
        error, share = after(angle, False, seed)
        off.append(error)
        assert share == pytest.approx(np.ones(3), abs=0.02)
    assert np.mean(np.square(off)) == pytest.approx(1.0, abs=0.8)  # 60 numbers; sigma 0.18


def test_turned_with_the_correction_it_would():
    """Why the covariance is not turned: after 10 deg the filter would claim to know the mounting better."""
    _, share = after(10.0 * DEG, True, 1)
    assert share.min() < 0.7


def test_which_blocks_a_reset_cuts():
    """All that a forgotten sensor measures; none if an error is admitted, also of blocks without ties."""
    nav = fusion.start(PARAMS, alignment(fly(0.1)[1][0]), EARTH)
    H = np.zeros((3, nav.layout.n))
    places, one = nav.layout.places, Measurement("star_tracker", None, Fate.RESET)
    mounting = places["mounting"]
    P = nav.history.P.copy()
    others = np.delete(np.arange(nav.layout.n), np.r_[mounting])
    assert not P[mounting][:, others].any()
    admitted, cut = gate.forgotten(nav, P, one._replace(admitted=0.01), H)
    assert cut == () and np.allclose(admitted - P, np.diag(np.diag(admitted - P)))
    assert np.diag(admitted - P)[mounting] == pytest.approx(1e-4)
    P[ATT, mounting] = P[mounting, ATT] = 1e-9 * np.eye(3)
    forgotten, cut = gate.forgotten(nav, P, one, H)
    assert cut == (places["attitude"], mounting)
    assert not forgotten[ATT, mounting].any() and forgotten[0, 0] == P[0, 0]
    assert np.array_equal(forgotten[ATT, ATT], np.pi**2 * np.eye(3))  # nothing is known of an attitude
    assert np.array_equal(forgotten[mounting, mounting], initial_covariance(PARAMS, "mounting"))
    nav.history.x[X_MOUNTING] = learnt = np.array(
        [1e-3, -2e-3, 0.0]
    )  # it stays, and is known no better for it
    again, _ = gate.forgotten(nav, P, one, H)
    gained = again[mounting, mounting] - initial_covariance(PARAMS, "mounting")
    np.testing.assert_allclose(gained, np.diag(learnt**2), atol=1e-18)
    found = {"gyro_bias": np.array([0.0, 1e-3, 0.0])}
    _, cut = gate.forgotten(nav, P, one._replace(admitted=found), H)
    assert cut == ()


@pytest.mark.parametrize("names", [("mounting", "lever_arm"), ("lever_arm",)])
def test_the_camera_is_known_as_attitude_and_mounting_together(names):
    """Turns add: J P J^T with J = C_cb (1 1) of the two blocks; without a state the mounting is as told."""
    order, rng = layout(names), np.random.default_rng(5)
    A = rng.standard_normal((order.n, order.n))
    P, J = A @ A.T, np.zeros((3, order.n))
    J[:, ATT] = C_BC.T
    if "mounting" in names:
        J[:, order.places["mounting"]] = C_BC.T
    found = plain(navigator.camera_covariance)(order.at, P, C_BC)
    np.testing.assert_allclose(found, J @ P @ J.T, rtol=1e-12)


def test_a_fix_without_height_leaves_the_height_known():
    """Nothing is known of the level plane any more, and of the height what was known before."""
    nav = fusion.start(PARAMS, alignment(fly(0.1)[1][0]), EARTH)
    rng, n = np.random.default_rng(4), nav.layout.n
    axes = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    H = np.zeros((2, n))
    H[:, POS] = axes[:, :2].T
    A = rng.standard_normal((n, n))
    P = A @ A.T
    fix = GpsFix(0.0, 0.0, True, np.zeros(3), np.zeros(3), np.eye(3), np.eye(3), 8, 1.0, "", horizontal=True)
    forgotten, cut = gate.forgotten(nav, P, Measurement("gps_position", fix, Fate.RESET), H)
    down = axes[:, 2]
    assert cut == ()
    assert down @ forgotten[POS, POS] @ down == pytest.approx(down @ P[POS, POS] @ down, rel=1e-6)
    assert np.allclose(down @ forgotten[POS, 3:], down @ P[POS, 3:])
    assert min(axes[:, k] @ forgotten[POS, POS] @ axes[:, k] for k in range(2)) > 0.99e10
