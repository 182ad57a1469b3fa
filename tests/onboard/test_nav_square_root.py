"""The covariance of a whole flight three ways: as it flies, through filterpy, and as square roots by QR."""

import numpy as np
import pytest
from navigation_flight import EARTH, PARAMS, alignment, fly, gps_fix, star_fix
from unpacked import predict

from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.state import ATT, OPTIONAL, layout, pack

BLOCKS, STATES = fly(30.0)
BLOCKS_ON = {
    "15": (),
    "21": ("gyro_roll_column", "mounting"),
    "42": ("gyro_scale", "gyro_misalignment", "gyro_g_sensitivity", "accel_scale", "mounting", "lever_arm"),
}
LINEAR_DEG = 0.02  # of larger attitude errors the second order counts under thrust
SIGMAS = {"gyro_g_sensitivity": 1e-6, "lever_arm": 0.1}


def flight(names):
    """Records of the filter over 30 s: boost and coast, GPS at 1 Hz and stars at 10 Hz, both late."""
    sigmas = {name: np.full(OPTIONAL[name], SIGMAS.get(name, 1e-4)) for name in names}
    params, records = PARAMS._replace(states=names, sigma_blocks=sigmas), []
    rng = np.random.default_rng(4)
    nav = fusion.start(params, alignment(STATES[0], rng, LINEAR_DEG), EARTH, records.append)
    P = nav.history[0].P
    fixes = [("gps", gps_fix(BLOCKS, STATES, float(t), 0.2, rng)) for t in range(1, 30)]
    fixes += [("star_tracker", star_fix(BLOCKS, STATES, 22.0031 + 0.1 * k, 0.1, rng)) for k in range(70)]
    fixes.sort(key=lambda pair: pair[1].t_available_s)
    for block in BLOCKS:
        fusion.advance(nav, block)
        due = [pair for pair in fixes if pair[1].t_available_s <= block.t_valid_s + 1e-9]
        fixes = fixes[len(due) :]
        if due:
            fusion.fuse(nav, due)
    fusion.finish(nav)
    return nav.layout, P, records


def root(P):
    """S with S S^T = P for a covariance that may be singular."""
    sigma = np.sqrt(np.maximum(np.diag(P), 1e-300))
    values, vectors = np.linalg.eigh(P / np.outer(sigma, sigma))
    return sigma[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def triangle(A):
    """Lower triangular S with S S^T = A A^T, by QR of the transpose (Kaminski, Bryson & Schmidt 1971)."""
    return np.linalg.qr(A.T, mode="r").T


def update(S, z, H, R):
    """Square-root update by one QR of the array [[R^1/2, H S], [0, S]]. -> dx, S after it"""
    m, n = H.shape
    array = np.zeros((m + n, m + n))
    array[:m, :m], array[:m, m:], array[m:, m:] = root(R), H @ S, S
    array = triangle(array)
    return array[m:, :m] @ np.linalg.solve(array[:m, :m], z), array[m:, m:]


@pytest.mark.compiled
@pytest.mark.parametrize("names", BLOCKS_ON.values(), ids=BLOCKS_ON)
def test_covariance_of_a_flight_as_square_roots_and_through_filterpy(names):
    """Independent of the filter but for Phi, Q, z, H, R of each step: 1e-9 of sigma all along."""
    order, P, records = flight(names)
    S, worst, updates = root(P), np.zeros(3), 0
    for record in records:
        if isinstance(record, fusion.Interval):
            S = triangle(np.hstack([record.Phi @ S, root(record.Q)]))
            P_filterpy = predict(order, record.P, record.Phi, record.Q)
            worst[0] = max(worst[0], apart(P_filterpy, record.P_after))
        else:
            assert record.fate == Fate.USED
            dx, S = update(S, record.z, record.H, record.R)
            S[ATT] = record.G @ S[ATT]
            worst[1] = max(worst[1], np.abs((dx - record.dx) / np.sqrt(np.diag(record.P))).max())
            updates += 1
        worst[2] = max(worst[2], apart(S @ S.T, record.P_after))
    assert len(records) - updates > 3000 and updates >= 120
    assert records[-1].t_end_s == pytest.approx(30.0)
    assert np.all(worst < 1e-9), worst


def apart(P, reference):
    """Largest difference of two covariances in units of sigma."""
    sigma = np.sqrt(np.diag(reference))
    return np.abs((P - reference) / np.outer(sigma, sigma)).max()


@pytest.mark.compiled
def test_records_are_in_order_and_without_gaps():
    """Each begins where the one before it ended, in time, state and covariance, but for rounding."""
    _, P, records = flight(BLOCKS_ON["21"])
    t_s, state = 0.0, None
    for record in records:
        begin_s = record.t_begin_s if isinstance(record, fusion.Interval) else record.t_s
        assert begin_s == pytest.approx(t_s, abs=1e-6)
        assert apart(record.P, P) < 1e-9
        if state is not None:
            np.testing.assert_allclose(pack(record.state), pack(state), rtol=1e-12, atol=1e-15)
        t_s = record.t_end_s if isinstance(record, fusion.Interval) else record.t_s
        state, P = record.state_after, record.P_after


def test_the_size_of_the_largest_layout_is_as_said():
    assert layout(BLOCKS_ON["42"]).n == 42
