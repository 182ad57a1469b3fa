"""What was learnt from a contradicted sensor is given back; readings that are none teach nothing."""

import numpy as np
from navigation_flight import DEG, EARTH, PARAMS, alignment, fly

from shefex_nav.geometry import rotation, wgs84
from shefex_nav.onboard.navigation import fusion, integrity_learnt
from shefex_nav.onboard.navigation.state import ATT, X_MOUNTING, X_R, X_V, right_jacobian

NAV = fusion.start(PARAMS, alignment(fly(0.1)[1][0]), EARTH)
ORDER = NAV.layout
MOUNT = ORDER.places["mounting"]


def test_gained_certainty_and_the_correction_come_back():
    """A bias that has been moved by b and become certain is known no better than from the start and by b."""
    x, P = NAV.history.x.copy(), NAV.history.P.copy()
    start = P[9:12, 9:12].diagonal().copy()
    P[9:12, 9:12] *= 1e-4
    x[10:13] = np.array([1e-4, 0.0, -2e-4])  # packed: r, v, q, then the gyro bias
    added = integrity_learnt.doubts(PARAMS, ORDER, None, x, P)["gyro_bias"]
    assert np.allclose(P[9:12, 9:12].diagonal() + added**2, start + x[10:13] ** 2)


def test_what_is_split_leaves_what_stars_see():
    """Attitude and mounting become uncertain by as much, the sum that a star fix measures does not."""
    rng = np.random.default_rng(2)
    x, P = NAV.history.x.copy(), NAV.history.P.copy()
    x[X_MOUNTING] = 0.2 * rng.standard_normal(3)  # far from nothing: signs and turns must be right
    H = np.zeros((3, ORDER.n))
    H[:, ATT] = rotation.dcm_from_rotvec(x[X_MOUNTING]).T
    H[:, MOUNT] = right_jacobian(x[X_MOUNTING])
    wider, sigma = P.copy(), DEG * np.array([0.5, 0.2, 0.9])
    integrity_learnt.add(wider, ORDER, x, {integrity_learnt.SPLIT: sigma})
    assert np.allclose((wider - P)[MOUNT, MOUNT], np.diag(sigma**2))
    assert np.trace((wider - P)[ATT, ATT]) > 0.9 * (sigma**2).sum()
    assert np.allclose(H @ (wider - P) @ H.T, 0.0, atol=1e-18)


def test_a_gain_that_teaches_nothing():
    """Learnt blocks stay as they are; the rest gets what it gets, and the covariance is that of the gain."""
    rng = np.random.default_rng(3)
    A = rng.standard_normal((ORDER.n, ORDER.n))
    P, H, R = A @ A.T, rng.standard_normal((3, ORDER.n)), np.eye(3)
    learnt, x, after = integrity_learnt.places(ORDER), NAV.history.x.copy(), np.empty_like(P)
    z = 1e-6 * rng.standard_normal(3)
    dx, _ = integrity_learnt.update_without(ORDER, P, (z, H, R), x, after)
    assert not dx[learnt].any() and dx[~learnt].any()
    assert np.allclose(after[np.ix_(learnt, learnt)], P[np.ix_(learnt, learnt)])
    optimal = P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)
    assert np.linalg.eigvalsh(after - optimal).min() > -1e-3  # never claims more than the optimal gain has
    free = np.ix_(~learnt, ~learnt)
    assert np.allclose(after[free], optimal[free], atol=1e-3)  # what is not held has its optimal gain


def test_specific_force_since_a_velocity_fix():
    """Free fall adds nothing, whatever gravity does; a push of 30 m/s is seen."""
    memory, x = integrity_learnt.Learnt(), NAV.history.x.copy()
    assert memory.pushed(0.0, x) == np.inf
    memory.moving(0.0, x)
    r, v = x[X_R].copy(), x[X_V].copy()
    for _ in range(2000):  # 20 s
        v -= 0.01 * wgs84.GM / (r @ r) ** 1.5 * r
        r += 0.01 * v
    fallen = x.copy()
    fallen[X_R], fallen[X_V] = r, v
    assert memory.pushed(20.0, fallen) < 0.5
    fallen[X_V] += [0.0, 30.0, 0.0]
    assert abs(memory.pushed(20.0, fallen) - 30.0) < 0.5
