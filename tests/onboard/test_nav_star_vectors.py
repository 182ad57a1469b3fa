"""Single stars in the filter in flight: what one star is worth, wrong ones, many of them.

The flight is that of `navigation_flight`, the camera that of the star tracker's tests; stars stand anywhere.
"""

from functools import cache

import numpy as np
import pytest
from navigation_flight import C_BC, DEG, EARTH, MODEL, PARAMS, alignment, fly, star_fix, state_at
from scipy.spatial.transform import Rotation
from star_fields import CAMERA
from star_sights import SIGMA_PX, camera_attitude, frame_of, places, seen
from unpacked import tick

from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import cross_axes, pixels, unit_vectors
from shefex_nav.onboard import navigator
from shefex_nav.onboard.navigation import fusion, integrity_protection, measure_stars, protected
from shefex_nav.onboard.navigation.state import ATT, MOUNTING, layout
from shefex_nav.onboard.navigator import Navigator
from shefex_nav.onboard.startracker import likelihood
from shefex_nav.records import GateResult, NavHealth

VECTORS = PARAMS._replace(stars="vectors")
MOUNT = layout().places["mounting"]
START_S = 21.0  # thrust is over
BLOCKS, STATES = fly(40.0)


def mission(rng, bias, params=VECTORS):
    """Filter at START_S whose attitude two fixes have settled, gyros with noise and a bias, and the truth."""
    first = round(START_S * 100)
    blocks = []
    for block in BLOCKS[first:]:
        noise = MODEL.gyro_random_walk * np.sqrt(block.dt_s) * rng.standard_normal((4, 3))
        blocks.append(block._replace(dtheta_b=block.dtheta_b + bias * block.dt_s + noise))
    nav = fusion.start(params, alignment(STATES[first], rng), EARTH)
    return nav, blocks


def flown(nav, blocks, fixes, kind=GateResult):
    """Hand fixes over when they are available, through the executive. -> list of records of a kind"""
    waiting, results = sorted(fixes, key=lambda fix: fix.t_available_s), []
    software = Navigator(nav)
    for block in blocks:
        due = [fix for fix in waiting if fix.t_available_s <= block.t_valid_s + 1e-9]
        waiting = waiting[len(due) :]
        outputs = tick(software, block, due)
        results += [record for record in outputs if isinstance(record, kind)]
    return results


def camera_error(nav, mounting, axes):
    """Error of the camera's attitude and its sigma at the last tick, rad, about camera-fixed axes (k, 3)."""
    tick = nav.history[-1]
    truth = STATES[round(tick.t_s * 100)]._replace(mounting=mounting)
    turn = camera_attitude(tick.state).T @ camera_attitude(truth)
    P_c = navigator.camera_covariance(nav.layout.at, tick.P, C_BC)
    return axes @ Rotation.from_matrix(turn).as_rotvec(), np.sqrt(np.diag(axes @ P_c @ axes.T))


@cache
def one_star_a_frame(seed, same):
    """Attitude from two fixes, then 17 s with one star a frame, and without any star.

    -> error and sigma, and those without stars, (3,) about e1, e2 across the last star and about itself;
    GateResult
    """
    rng = np.random.default_rng(seed)
    bias = 10.0 * DEG / 3600.0 * rng.standard_normal(3)
    mounting = PARAMS.sigma_blocks["mounting"] * rng.standard_normal(3)
    params = VECTORS._replace(sigma_gyro_bias=10.0 * DEG / 3600.0)
    nav, blocks = mission(rng, bias, params)
    start = [star_fix(BLOCKS, STATES, START_S + t_s, 0.1, rng, mounting) for t_s in (0.2, 0.3)]
    direction, fixes = None, []
    for k in range(170):
        t_s = START_S + 0.5 + 0.1 * k
        truth = state_at(BLOCKS, STATES, t_s)[0]._replace(mounting=mounting)
        if direction is None or not same:
            xy_px = places(rng, 1)
            direction = unit_vectors(CAMERA, xy_px) @ camera_attitude(truth).T
        if same:  # the vehicle tumbles, the star is where it is
            xy_px = pixels(CAMERA, direction @ camera_attitude(truth))
        fixes.append(frame_of(t_s, seen(truth, xy_px, rng)))
    idle, _ = mission(np.random.default_rng(seed), bias, params)
    results = flown(nav, blocks, start + fixes)
    flown(idle, blocks, start)
    u = fixes[-1].stars.u_c
    axes = np.concatenate([cross_axes(u)[0], u])
    return *camera_error(nav, mounting, axes), *camera_error(idle, mounting, axes), results


SEEDS = range(1, 7)


@pytest.mark.compiled
@pytest.mark.parametrize("seed", SEEDS)
def test_one_star_a_frame_another_each_time_bounds_all_axes(seed):
    """Every axis, that about the boresight too: within 4 sigma, sigma a tenth of that without stars."""
    error, sigma, _, idle, results = one_star_a_frame(seed, False)
    print(seed, error / sigma, sigma / DEG * 3600, idle / DEG * 3600)
    assert np.all(np.abs(error) < 4.0 * sigma)
    assert np.all(sigma[:2] < 0.1 * idle[:2]) and sigma[2] < 0.4 * idle[2]
    used = [result for result in results if result.sensor == "star_vectors"]
    assert len(used) == 170 and sum(result.accepted for result in used) >= 168
    assert {result.dof for result in used} == {2}


@pytest.mark.compiled
@pytest.mark.parametrize("seed", SEEDS)
def test_one_star_always_the_same_bounds_the_axes_across_it(seed):
    """About the star nothing is learnt, and the covariance says so: six seeds, each within 3 sigma."""
    error, sigma, _, idle, _ = one_star_a_frame(seed, True)
    print(seed, error / sigma, sigma / DEG * 3600, idle / DEG * 3600)
    assert np.all(np.abs(error) < 3.0 * sigma)
    assert np.all(sigma[:2] < 0.1 * idle[:2]) and sigma[2] > 0.5 * idle[2]


def started():
    """Filter whose attitude two fixes have settled, its blocks, and the number of ticks that took."""
    nav, blocks = mission(np.random.default_rng(1), np.zeros(3))
    rng = np.random.default_rng(2)
    flown(nav, blocks[:50], [star_fix(BLOCKS, STATES, START_S + t_s, 0.1, rng) for t_s in (0.2, 0.3)])
    assert nav.health["star_tracker"].used == 1
    return nav, blocks[50:]


def test_a_wrong_star_is_gated_out_alone():
    """Star 3 of 6 is half a degree off: the others are used as if it were not there, and the log names it."""
    nav, blocks = started()
    other, _ = started()
    t_s = START_S + 0.52
    truth, _ = state_at(BLOCKS, STATES, t_s)
    rng = np.random.default_rng(3)
    stars = seen(truth, places(rng, 6), rng)
    off = np.array([0.0, 0.5 * DEG, 0.0])
    wrong = stars._replace(
        u_c=np.where(stars.hip[:, None] == 3, stars.u_c + np.cross(off, stars.u_c), stars.u_c)
    )
    wrong = wrong._replace(u_c=wrong.u_c / np.linalg.norm(wrong.u_c, axis=1, keepdims=True))
    keep = stars.hip != 3
    rest = stars._replace(
        **{name: getattr(stars, name)[keep] for name in ("hip", "u_c", "P_u", "u_i", "t_seen_s")}
    )
    (result,) = flown(nav, blocks[:15], [frame_of(t_s, wrong)])
    (without,) = flown(other, blocks[:15], [frame_of(t_s, rest)])
    assert result.accepted and result.dof == 10 and result.note == "rejected: HIP 3"
    assert without.accepted and without.dof == 10 and without.note == ""
    assert result.nis == pytest.approx(without.nis)
    np.testing.assert_allclose(nav.history[-1].x, other.history[-1].x, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(nav.history[-1].P, other.history[-1].P, rtol=1e-9, atol=1e-20)


def test_the_first_attitude_is_that_of_two_fixes():
    """Before it, single stars are not even asked; the fixes of those frames are."""
    nav, blocks = mission(np.random.default_rng(1), np.zeros(3))
    rng, fixes = np.random.default_rng(2), []
    for t_s in START_S + np.array([0.1, 0.2, 0.3, 0.4]):
        truth, _ = state_at(BLOCKS, STATES, t_s)
        stars = seen(truth, places(rng, 5), rng)
        fixes += [frame_of(t_s, stars)] if len(fixes) == 1 else []  # a frame without attitude
        fixes.append(star_fix(BLOCKS, STATES, t_s, 0.1, rng)._replace(stars=stars))
    results = flown(nav, blocks[:60], fixes)
    assert [result.sensor for result in results] == ["star_tracker"] * 2 + ["star_vectors"] * 2
    assert [result.accepted for result in results] == [False, True, True, True]


def test_contradiction_is_left_to_the_attitudes():
    """All stars of each frame off alike: after 1.9 s of fixes that agree the attitude is reset to theirs.

    Single stars in frames without attitude never do that, and a frame that fits ends the contradiction.
    """
    nav, blocks = started()
    rng, off = np.random.default_rng(4), np.array([0.0, 0.02, 0.01])
    t_s = START_S + 0.5 + 0.1 * np.arange(1, 24)
    inertial = rotation.dcm_from_quat(state_at(BLOCKS, STATES, t_s[0])[0].q_ib) @ off
    whole, single_stars = [], []
    for t in t_s:
        truth, _ = state_at(BLOCKS, STATES, t)
        turned_b = rotation.dcm_from_quat(truth.q_ib).T @ inertial
        q_ib = rotation.quat_multiply(truth.q_ib, rotation.quat_from_rotvec(turned_b))
        stars = seen(truth._replace(q_ib=q_ib), places(rng, 6), rng)
        whole.append(star_fix(BLOCKS, STATES, t, 0.1, rng, turned_b)._replace(stars=stars))
        single_stars.append(frame_of(t, stars))
    results = flown(nav, blocks[:250], whole)
    sensors = [result.sensor for result in results]
    notes = [result.note for result in results]
    assert sensors[:40:2] == ["star_vectors"] * 20 and sensors[1:40:2] == ["star_tracker"] * 20
    assert set(notes[:39]) == {"rejected"} and notes[39] == "attitude reset"
    assert sensors[40:] == ["star_vectors"] * 3 and set(notes[40:]) == {""}
    alone, _ = started()
    results = flown(alone, blocks[:250], single_stars)
    assert {result.sensor for result in results} == {"star_vectors"}
    assert {result.note for result in results} == {"rejected"} and alone.health["star_tracker"].rejected == 0
    some, _ = started()
    truth, _ = state_at(BLOCKS, STATES, t_s[6])
    flown(some, blocks[:250], [*whole[:5], frame_of(t_s[6], seen(truth, places(rng, 1), rng))])
    assert some.health["star_tracker"].rejected == 0


def test_a_camera_that_is_knocked_is_admitted_with_single_stars_too():
    """By 0.3 deg across the boresight, after stars have been used one by one: that much is admitted."""
    nav, blocks = started()
    rng, off, fixes = np.random.default_rng(4), np.array([0.3 * DEG, 0.0, 0.0]), []
    for t_s in START_S + 0.5 + 0.1 * np.arange(1, 29):
        truth, _ = state_at(BLOCKS, STATES, t_s)
        moved = truth._replace(mounting=off if t_s > START_S + 1.0 else np.zeros(3))
        stars = seen(moved, places(rng, 6), rng)
        fixes.append(star_fix(BLOCKS, STATES, t_s, 0.1, rng, moved.mounting)._replace(stars=stars))
    results = flown(nav, blocks[:300], fixes)
    (reset,) = (result for result in results if "reset" in result.note)
    assert reset.note == "attitude reset, or the camera has moved"
    tick = nav.history[-1]
    assert np.sqrt(np.trace(tick.P[ATT, ATT])) < 0.5 * DEG  # not the whole circle, as when it is forgotten
    # what is between attitude and mounting stays open: together they say where the camera looks
    moved = STATES[round(tick.t_s * 100)]._replace(mounting=off)
    turn = Rotation.from_matrix(camera_attitude(tick.state).T @ camera_attitude(moved)).as_rotvec()
    assert np.linalg.norm(turn) < 0.05 * DEG
    assert np.sqrt(tick.P[MOUNT, MOUNT][0, 0]) > 0.15 * DEG


def test_what_one_wrong_star_could_do():
    """Against the largest effect of innovations on the rim of each star's gate, given the others."""
    nav, _ = started()
    tick, limit = nav.history[-1], nav.limits[2]
    stars = seen(STATES[round(tick.t_s * 100)], places(np.random.default_rng(5), 3))
    _, H, R = measure_stars.star_vectors(nav.layout, tick.state, frame_of(tick.t_s, stars), C_BC, 0.0)
    S = H @ tick.P @ H.T + R
    K = tick.P @ H.T @ np.linalg.inv(S)
    P_after = tick.P - K @ S @ K.T
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)
    worst = np.zeros(3)
    for k in range(0, 6, 2):
        # wrong by as much as the gate of this star lets through, all others as predicted
        rest = [j for j in range(6) if j not in (k, k + 1)]
        S_others = S[np.ix_(rest, rest)]
        tied = S[k : k + 2, rest] @ np.linalg.solve(S_others, S[rest, k : k + 2])
        rim = np.linalg.cholesky(S[k : k + 2, k : k + 2] - tied) @ np.array([np.cos(angle), np.sin(angle)])
        worst = np.maximum(worst, np.abs(K[ATT, k : k + 2] @ rim * np.sqrt(limit)).max(axis=1))
    axes = protected.level_axes(nav.earth, tick.t_s, tick.x)
    mounting = int(nav.layout.at[MOUNTING])
    table = integrity_protection._slope_of_vectors(tick.P, P_after, limit, H, R, mounting, axes)
    body = protected.BODY
    np.testing.assert_allclose(table[integrity_protection.WORST, body], worst, rtol=1e-6)
    np.testing.assert_allclose(table[integrity_protection.AFTER, body] ** 2, np.diag(P_after)[ATT])
    assert np.all(table[integrity_protection.LEFT_STARS, body] < 1.0)


@pytest.mark.parametrize("way", ["attitude", "vectors"])
def test_a_wrong_gyro_is_noticed_either_way(way):
    """200 arcsec/s across the boresight from 3 s after the first stars on: told in a second and a half."""
    rng = np.random.default_rng(8)
    params = VECTORS._replace(stars=way)
    nav, blocks = mission(rng, np.zeros(3), params)
    begin_s, bias = START_S + 3.5, np.array([0.0, 0.0, 200.0 / 3600.0 * DEG])
    blocks = [
        block._replace(dtheta_b=block.dtheta_b + bias * block.dt_s) if block.t_valid_s > begin_s else block
        for block in blocks[:600]
    ]
    fixes = []
    for t_s in START_S + 0.2 + 0.1 * np.arange(50):
        truth, _ = state_at(BLOCKS, STATES, t_s)
        stars = seen(truth, places(rng, 10), rng)
        P_px = np.tile(SIGMA_PX**2 * np.eye(2), (10, 1, 1))
        q_ic = rotation.quat_from_dcm(camera_attitude(truth))
        q_ic, P_c, _ = likelihood.refine(CAMERA, q_ic, pixels(CAMERA, stars.u_c), stars.u_i, P_px)
        fixes.append(frame_of(t_s, stars, q_ic, P_c, 0.05))
    said = flown(nav, blocks, fixes, NavHealth)
    wrong = [record for record in said if record.source.startswith("gyro") and not record.healthy]
    assert wrong[0].source == "gyro z" and len({record.source for record in wrong}) == 1
    assert begin_s < wrong[0].t_s < begin_s + 1.5
    assert nav.history[-1].state.gyro_bias[2] == pytest.approx(bias[2], rel=0.1)
