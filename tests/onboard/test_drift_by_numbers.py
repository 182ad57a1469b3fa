"""What a drift has done to the errors, from one measurement to the next: against differences of a flight."""

import numpy as np
import pytest
from plain import plain

from shefex_nav.geometry import rotation, wgs84
from shefex_nav.onboard.navigation import integrity_drift
from shefex_nav.onboard.navigation.state import ATT, BA, BG, N_NOMINAL, POS, VEL, X_Q, X_R, X_V, layout

GAP_S, STEPS = 0.01, 20
R_I, V_I = np.array([3.1e6, -2.0e6, 5.3e6]), np.array([900.0, -2100.0, 1500.0])
C_IB, OMEGA_B = rotation.dcm_from_rotvec(np.array([0.4, -1.1, 0.7])), np.array([0.9, -0.3, 0.5])
F_B = np.array([60.0, -7.0, 4.0])
UNIT = {"r": 1e4, "v": 100.0, "turn": 1e-3, "gyro": 1e-3, "accel": 1.0, "gravity": 1.0}
NONE = {name: np.zeros(3) for name in UNIT}


def flown(r, v, turn, gyro, accel, gravity):
    """Position, velocity and C_ib after GAP_S of a vehicle whose state differs by so much at the begin.

    Gravity is that of a point mass; sensors read too much by their biases, so rate and force are less.
    """
    r_i, v_i, C_ib = R_I + r, V_I + v, C_IB @ rotation.dcm_from_rotvec(turn)
    dt_s = GAP_S / STEPS
    half = rotation.dcm_from_rotvec((OMEGA_B - gyro) * 0.5 * dt_s)
    for _ in range(STEPS):
        C_ib = C_ib @ half
        g_i = -wgs84.GM * r_i / np.linalg.norm(r_i) ** 3
        dv = dt_s * (C_ib @ (F_B - accel) + g_i + gravity)
        r_i, v_i, C_ib = r_i + dt_s * (v_i + 0.5 * dv), v_i + dv, C_ib @ half
    return r_i, v_i, C_ib


def packed(r_i, v_i, C_ib):
    x = np.zeros(N_NOMINAL)
    x[X_R], x[X_V], x[X_Q] = r_i, v_i, rotation.quat_from_dcm(np.ascontiguousarray(C_ib))
    return x


@pytest.mark.parametrize(
    "name, shown",
    [
        ("r", (POS, VEL)),
        ("v", (POS,)),
        ("turn", (POS, VEL, ATT)),
        ("gyro", (ATT,)),
        ("accel", (POS, VEL)),
        ("gravity", (POS, VEL)),
    ],
)
def test_an_error_grows_as_the_flight_that_has_it_differs(name, shown):
    """To first order over the gap, as is said: what a gyro's error does to the attitude, and no more."""
    order = layout(("gravity",))
    places = {
        "r": POS, "v": VEL, "turn": ATT, "gyro": BG, "accel": BA, "gravity": order.places["gravity"]
    }  # fmt: skip
    r_i, v_i, C_ib = flown(**NONE)
    B = np.zeros((order.n, 3))
    B[places[name]] = UNIT[name] * np.eye(3)
    before, wanted = B.copy(), B.copy()
    plain(integrity_drift._carry)(
        order.at, B, packed(r_i, v_i, C_ib), (GAP_S, V_I, C_IB), OMEGA_B, 0.0, np.zeros((6, 0))
    )
    for k in range(3):
        (r, v, C), (r_0, v_0, C_0) = (
            flown(**NONE | {name: sign * UNIT[name] * np.eye(3)[k]}) for sign in (1.0, -1.0)
        )
        turned = 0.5 * C_ib.T @ (C - C_0)
        wanted[POS, k], wanted[VEL, k] = 0.5 * (r - r_0), 0.5 * (v - v_0)
        wanted[ATT, k] = turned[2, 1], turned[0, 2], turned[1, 0]
    for rows in shown:
        grown, found = wanted[rows] - before[rows], B[rows] - before[rows]
        assert np.abs(grown).max() > 0.0
        np.testing.assert_allclose(found, grown, atol=0.02 * np.abs(grown).max(), rtol=0.0)
    assert np.array_equal(B[ATT.stop :], before[ATT.stop :])


def test_errors_of_gravity_without_a_state_are_none():
    order = layout(())
    B = np.ones((order.n, 1))
    with_it, at = np.ones((layout(("gravity",)).n, 1)), layout(("gravity",)).at
    for one, places in ((B, order.at), (with_it, at)):
        plain(integrity_drift._carry)(
            places, one, packed(*flown(**NONE)), (GAP_S, V_I, C_IB), OMEGA_B, 0.0, np.zeros((6, 0))
        )
    np.testing.assert_allclose(with_it[VEL] - B[VEL], GAP_S)  # m/s, of 1 m/s^2 on each axis
    np.testing.assert_allclose(with_it[POS] - B[POS], 0.5 * GAP_S**2)


@pytest.mark.parametrize(
    "name, numbers, rows, says",
    [
        ("gps_position", 3, None, True),
        ("gps_position", 2, None, False),
        ("gps_velocity", 3, None, False),
        ("gps_range", 3, None, False),  # with the clock unknown no height
        ("gps_range", 4, None, True),
        ("gps_range", 5, [True, True, False, True, False], False),
        ("gps_range", 5, [True, True, False, True, True], True),
        ("gps_range_rate", 5, None, False),
    ],
)
def test_what_says_all_of_a_position(name, numbers, rows, says):
    rows = None if rows is None else np.array(rows)
    assert integrity_drift._says_all(name, np.zeros(numbers), rows) == says
