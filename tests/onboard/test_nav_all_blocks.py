"""The filter with every block of states on and faulty sensors, names of blocks, samples of another length."""

import numpy as np
import pytest
from navigation_flight import C_BC, DEG, DT, EARTH, MODEL, PARAMS, alignment, fly, gps_fix, star_fix
from test_nav_blocks import ALL, CLOCK, DRIFT, STATES, STEPS, error_between, state_with_errors
from test_nav_blocks import RNG as RNG  # begins anew with each test of this module, too

from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.aid import Aid
from shefex_nav.onboard.navigation.blocks import LayoutError
from shefex_nav.onboard.navigation.state import ATT, CORE, OPTIONAL, POS, VEL, layout, pack


def test_sensors_without_noise_leave_no_error_with_every_block_on():
    """Faulty increments, errors known: the estimate stays on the truth, every block on its value."""
    blocks, states = fly(3.0)
    errors = state_with_errors(ALL.names)
    inside = [name for name in OPTIONAL if name in ALL.names and name not in OUTSIDE]
    known = states[0]._replace(**{name: getattr(errors, name) for name in inside})
    biases = {"gyro_bias": errors.gyro_bias, "accel_bias": errors.accel_bias}
    known = known._replace(others=np.zeros(DRIFT.size), **biases)
    drifting = Aid("drifting", tuple, None, (DRIFT,))
    params = PARAMS._replace(states=ALL.names, sigma_blocks=SIGMAS, aids=(drifting,), **CLOCK)
    nav = fusion.start(params, alignment(states[0]), EARTH)
    nav.history.x[:] = nav.history.xs[nav.history.place(0)] = pack(known)
    for k, block in enumerate(faulty(blocks, known), 1):
        fusion.advance(nav, block)
        if k % 50 == 0:
            fusion.fuse(nav, [("gps", gps_fix(blocks, states, block.t_valid_s - 0.0813, 0.08))])
        if k % 10 == 0:
            fix = star_fix(blocks, states, block.t_valid_s - 0.05, 0.05)
            q_ic = rotation.quat_multiply(fix.q_ic, mounting_in_camera(known.mounting))
            fusion.fuse(nav, [("star_tracker", fix._replace(q_ic=q_ic))])
    state, P = nav.history[-1].state, nav.history[-1].P
    sigma = np.sqrt(np.diag(P))
    dx = error_between(
        ALL, state, known._replace(r_i=states[-1].r_i, v_i=states[-1].v_i, q_ib=states[-1].q_ib)
    )
    assert np.linalg.norm(dx[POS]) < 1e-4 and np.linalg.norm(dx[VEL]) < 1e-4
    assert np.linalg.norm(dx[ATT]) < 1e-8
    assert np.abs(dx / sigma).max() < 1e-3
    assert nav.health["gps_position"].used == 6 and nav.health["star_tracker"].used > 20


# theirs are those of the truth
OUTSIDE = (
    "gravity",
    "lever_arm",
    "clock",
    "gps_latency",
    "range_bias",
)
SIGMAS = {name: np.full(size, 10.0 * STEPS[name]) for name, size in OPTIONAL.items()}


def mounting_in_camera(mounting):
    """Quaternion that turns the attitude of a nominally mounted camera into that of the true one."""
    C = C_BC.T @ rotation.dcm_from_rotvec(mounting) @ C_BC
    return rotation.quat_from_dcm(np.ascontiguousarray(C))


def faulty(blocks, errors):
    """The blocks as sensors with errors measure them, the motor burning."""

    def response(scale, misalignment):
        A = np.diag(1.0 + scale)
        A[[0, 0, 1, 1, 2, 2], [1, 2, 0, 2, 0, 1]] += misalignment
        return A

    gyro = response(errors.gyro_scale, errors.gyro_misalignment)
    accel = response(errors.accel_scale, errors.accel_misalignment)
    G = errors.gyro_g_sensitivity.reshape(3, 3)
    bias = errors.accel_bias + errors.accel_rectification
    for block in blocks:
        dtheta_b = block.dtheta_b @ gyro.T + block.dv_b @ G.T + errors.gyro_bias * DT
        yield block._replace(dtheta_b=dtheta_b, dv_b=block.dv_b @ accel.T + bias * DT)


def test_names_that_make_no_layout_are_refused():
    with pytest.raises(LayoutError, match="no block of states 'gyro_skale'"):
        layout(("gyro_skale",))
    with pytest.raises(LayoutError, match="estimate the same error"):
        layout(("mounting", "gyro_roll_column", "gyro_misalignment"))
    with pytest.raises(LayoutError, match="twice"):
        layout(("mounting", "mounting"))
    assert set(layout(()).places) == {*CORE, *OPTIONAL}


def test_a_block_without_its_sigmas_is_refused():
    start = alignment(STATES[0])
    with pytest.raises(KeyError):
        fusion.start(PARAMS._replace(states=("clock",)), start, EARTH)
    with pytest.raises(ValueError, match="2 values are needed"):
        fusion.start(PARAMS._replace(states=("clock",), sigma_blocks={"clock": np.ones(1)}), start, EARTH)


def test_two_samples_a_tick():
    """A motion sampled at 200 Hz, ticks of 10, 20 and 5 ms: as at 400 Hz, as well as the samples can tell."""
    blocks, states = fly(0.6)

    def ticks(samples):
        joined = (
            np.concatenate([np.hstack([b.dtheta_b, b.dv_b]) for b in blocks]).reshape(-1, 2, 6).sum(axis=1)
        )
        for k in range(0, len(joined), samples):
            rows, end_s = joined[k : k + samples], (k + samples) * 2 * DT
            yield blocks[0]._replace(
                t_valid_s=end_s, t_available_s=end_s, dt_s=2 * DT, dtheta_b=rows[:, :3], dv_b=rows[:, 3:]
            )

    quiet = PARAMS._replace(imu=MODEL)
    ends = []
    for samples in (2, 4, 1):
        nav = fusion.start(quiet, alignment(states[0]), EARTH)
        for block in ticks(samples):
            fusion.advance(nav, block)
        ends.append(nav.history[-1])
        assert nav.history[-1].t_s == pytest.approx(0.6)
        assert nav.history[0].t_s == pytest.approx(0.0)
        error = rotation.rotvec_between(nav.history[-1].state.q_ib, states[-1].q_ib)
        assert np.linalg.norm(error) < 1e-7 * DEG * 57.3
        assert np.linalg.norm(nav.history[-1].state.v_i - states[-1].v_i) < 1e-5
    for end in ends[1:]:
        sigma = np.sqrt(np.diag(ends[0].P))
        assert np.abs((end.P - ends[0].P) / np.outer(sigma, sigma)).max() < 1e-3  # noise by the trapezoid
