"""What wrong constants of the receiver show in ranges and range rates, against inertial geometry."""

import numpy as np
import pytest
from navigation_flight import antenna_of
from plain import plain
from test_nav_ranges import ARM, EARTH, LAYOUT, measured, state_of, true_rate

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import integrity_constants as told
from shefex_nav.onboard.navigation import measure_ranges
from shefex_nav.onboard.navigation.state import X_Q, X_R, X_V

F_I = np.array([40.0, -55.0, 12.0])
STATE = state_of()
OMEGA_B = true_rate(STATE)
MESSAGE = measured(STATE)
LINEARISE = {told.POSITION: measure_ranges.pseudoranges, told.RATES: measure_ranges.range_rates}


def linearised(what, state=STATE, arm_b=ARM):
    antenna = antenna_of(LAYOUT, state, EARTH, arm_b, true_rate(STATE), F_I, 0.0)
    return LINEARISE[what](LAYOUT, state, MESSAGE, antenna)


def later(dt_s):
    """The state dt_s after STATE, under F_I and gravity."""
    a_i = F_I - wgs84.GM / np.linalg.norm(STATE.r_i) ** 3 * STATE.r_i
    return STATE._replace(
        t_s=STATE.t_s + dt_s,
        r_i=STATE.r_i + STATE.v_i * dt_s + 0.5 * a_i * dt_s**2,
        v_i=STATE.v_i + a_i * dt_s,
        q_ib=rotation.quat_multiply(STATE.q_ib, rotation.quat_from_rotvec(OMEGA_B * dt_s)),
    )


def shown(what):
    """What the search takes a unit of each constant to show: (5, 4)."""
    z, H, R = linearised(what)
    x = np.zeros(64)
    x[X_R], x[X_V], x[X_Q] = STATE.r_i, STATE.v_i, STATE.q_ib
    motion = OMEGA_B, F_I, frames.omega_ie_i(EARTH), ARM + STATE.lever_arm
    return plain(told._shown)(told.Shown(x, 1e-4 * np.eye(LAYOUT.n), z, H, R, *motion, -1, np.nan), what)


@pytest.mark.parametrize("what, off", [(told.POSITION, 0.05), (told.RATES, 2e-3)])
def test_ranges_measured_before_their_time(what, off):
    """The satellites say where they were; the filter asks how far it is from them a moment later.

    off : m/s that the antenna goes about the IMU as it turns, which a position leaves out; m/s^2
    """
    c = 1e-4
    changes = (linearised(what, later(c))[0] - linearised(what, later(-c))[0]) / (2.0 * c)
    got = shown(what)[:, 0]
    turning = np.linalg.norm(np.cross(OMEGA_B, ARM + STATE.lever_arm)) if what == told.POSITION else 0.0
    np.testing.assert_allclose(got, changes, atol=off + turning)
    assert np.abs(changes).max() > (500.0 if what == told.POSITION else 30.0)


@pytest.mark.parametrize("what", [told.POSITION, told.RATES])
def test_an_arm_that_is_longer(what):
    got = shown(what)
    for k in range(3):
        step = 1e-3 * np.eye(3)[k]
        changes = (linearised(what, arm_b=ARM - step)[0] - linearised(what, arm_b=ARM + step)[0]) / 2e-3
        np.testing.assert_allclose(got[:, 1 + k], changes, rtol=1e-4, atol=1e-5)
