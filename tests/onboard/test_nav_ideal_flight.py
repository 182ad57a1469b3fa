"""The whole mission with an ideal IMU: the strapdown must give back the truth that the increments come from.

The truth is integrated from forces and moments by other equations; the strapdown sees its increments alone,
and the gravity of the world instead of the one that flies.
"""

from pathlib import Path

import numpy as np
import pytest
from unpacked import integrate, window

from shefex_nav.environment.gravity import gravity_e
from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation.state import NavState
from shefex_nav.prepare import earth_rotation
from shefex_nav.records import ImuBlock
from shefex_nav.scenario import load, params
from shefex_nav.world.flight import fly

SCENARIO = Path(__file__).parents[2] / "scenarios" / "shefex2_andoya.yaml"


@pytest.fixture(scope="module")
def flight():
    scenario = load.load(SCENARIO)
    earth, settings = earth_rotation(scenario), params.flight_params(scenario)
    return fly.fly(settings, earth, None).trajectory, earth, settings.gravity


@pytest.mark.compiled
@pytest.mark.slow
def test_ideal_increments_give_back_the_flight(flight):
    truth, earth, gravity = flight
    state = NavState(truth.t_s[0], truth.r_i[0], truth.v_i[0], truth.q_ib[0], *[np.zeros(3)] * 4)
    dt_s, imu = 1.0 / 400.0, None
    last = (len(truth.t_s) - 1) // 4 * 4
    for k in range(4, last + 1, 4):
        rows = slice(k - 3, k + 1)
        block = ImuBlock(truth.t_s[k], truth.t_s[k], dt_s, truth.dtheta_b[rows], truth.dv_b[rows], False)
        imu = window(block, imu)
        C_ie = frames.dcm_ie(earth, state.t_s + 2 * dt_s)
        g_i = C_ie @ gravity_e(gravity, C_ie.T @ (state.r_i + 2 * dt_s * state.v_i))
        r_i, v_i, q_ib = integrate(state, imu, 0.0, 4 * dt_s, g_i)
        state = NavState(truth.t_s[k], r_i, v_i, q_ib, *state[4:])
    turns = np.abs(truth.omega_ib_b[:, 0]).sum() * dt_s / (2 * np.pi)
    assert truth.t_s[last] - truth.t_s[0] > 490.0 and turns > 200.0
    assert np.linalg.norm(state.r_i - truth.r_i[last]) < 0.1
    assert np.linalg.norm(rotation.rotvec_between(state.q_ib, truth.q_ib[last])) < 1e-5
