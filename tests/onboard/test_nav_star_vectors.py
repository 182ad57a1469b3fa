"""Single stars in the filter: their model by differences, what one star is worth, wrong ones, many of them.

The flight is that of `navigation_flight`, the camera that of the star tracker's tests; stars stand anywhere.
"""

from functools import cache

import numpy as np
import pytest
from navigation_flight import C_BC, DEG, EARTH, MODEL, PARAMS, alignment, fly, star_fix, state_at
from scipy.spatial.transform import Rotation
from star_fields import CAMERA
from test_nav_blocks import ALL, ROLL, STEPS, state_with_errors

from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import cross_axes, cross_covariance, pixels, unit_vectors
from shefex_nav.onboard import computer
from shefex_nav.onboard.navigation import eskf, fusion, integrity_protection, measure_stars, measurements
from shefex_nav.onboard.navigation.state import ATT, correct, layout
from shefex_nav.onboard.startracker import likelihood
from shefex_nav.records import GateResult, NavHealth, Reason, StarFix, StarVectors

VECTORS = PARAMS._replace(stars="vectors")
MOUNT = layout().places["mounting"]
SIGMA_PX = 0.2
START_S = 21.0  # thrust is over
BLOCKS, STATES = fly(40.0)


def camera_attitude(state):
    """C_ic of a state, through scipy: mounting and attitude as rotations, one after the other."""
    turned = Rotation.from_quat(rotation.xyzw(state.q_ib)) * Rotation.from_rotvec(np.array(state.mounting))
    return (turned * Rotation.from_matrix(C_BC)).as_matrix()


def seen(truth, xy_px, rng=None, t_seen_s=None, P_omega_c=None, sigma_focal=0.0):
    """StarVectors of stars that the camera of `truth` sees at xy_px; with noise if there is a generator."""
    m = len(xy_px)
    u_i = unit_vectors(CAMERA, xy_px) @ camera_attitude(truth).T
    noisy = xy_px if rng is None else xy_px + SIGMA_PX * rng.standard_normal((m, 2))
    P_px = np.tile(SIGMA_PX**2 * np.eye(2), (m, 1, 1))
    return StarVectors(
        np.arange(1, m + 1),
        unit_vectors(CAMERA, noisy),
        cross_covariance(CAMERA, noisy, P_px),
        u_i,
        np.zeros(m) if t_seen_s is None else t_seen_s,
        np.zeros((3, 3)) if P_omega_c is None else P_omega_c,
        sigma_focal,
    )


def frame_of(t_s, stars, q_ic=None, P_c=None, latency_s=0.1):
    """StarFix with stars, and with an attitude if there is one."""
    reason = Reason.TOO_FEW_STARS if q_ic is None else Reason.NONE
    q_ic, P_c = np.full(4, np.nan) if q_ic is None else q_ic, np.full((3, 3), np.nan) if P_c is None else P_c
    return StarFix(
        0, t_s, t_s + latency_s, int(reason), q_ic, P_c, None, stars.hip, 0.3, 12.0, 0.05, False, False,
        stars=stars,
    )  # fmt: skip


def places(rng, m):
    """m places in the picture, (m, 2) px."""
    return rng.random((m, 2)) * [CAMERA.width_px - 1.0, CAMERA.height_px - 1.0]


def test_cross_axes_and_their_covariance():
    """e1, e2, u are right-handed axes; the covariance against differences of directions along them."""
    rng = np.random.default_rng(1)
    xy_px = places(rng, 40)
    u = unit_vectors(CAMERA, xy_px)
    E = cross_axes(u)
    frame = np.concatenate([E, u[:, None]], axis=1)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.tile(np.eye(3), (40, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, atol=1e-14)
    P_px = np.tile([[0.3, 0.1], [0.1, 0.2]], (40, 1, 1))
    J = np.empty((40, 2, 2))
    for axis in range(2):
        step = 1e-3 * np.eye(2)[axis]
        du = (unit_vectors(CAMERA, xy_px + step) - unit_vectors(CAMERA, xy_px - step)) / 2e-3
        J[:, :, axis] = np.einsum("kij,kj->ki", E, du)
    expected = J @ P_px @ J.transpose(0, 2, 1)
    np.testing.assert_allclose(cross_covariance(CAMERA, xy_px, P_px), expected, rtol=1e-6)


@pytest.mark.parametrize("order", [ALL, ROLL, layout()], ids=["all", "no mounting", "default"])
def test_jacobian_is_the_derivative_of_where_the_camera_sees_the_stars(order):
    """Every column against differences of E u_c of the moved truth, to 1e-6 of the largest element."""
    rng = np.random.default_rng(3)
    state = state_with_errors(order.names)
    xy_px = places(rng, 7)
    stars = seen(state, xy_px)
    z, H, R = measure_stars.star_vectors(order, state, frame_of(state.t_s, stars), C_BC, 0.0)
    assert np.abs(z).max() < 1e-15 and H.shape == (14, order.n) and R.shape == (14, 14)
    E = cross_axes(stars.u_c)

    def predicted(truth):
        return np.einsum("kij,kj->ki", E, stars.u_i @ camera_attitude(truth)).ravel()

    for name, place in order.places.items():
        for j in range(place.start, place.stop) if place else ():
            dx = np.zeros(order.n)
            dx[j] = STEPS[name]
            up, down = predicted(correct(order, state, dx)), predicted(correct(order, state, -dx))
            slope = (up - down) / (2.0 * STEPS[name])
            assert np.abs(slope - H[:, j]).max() <= 1e-6 * np.abs(H).max(), (name, j)


def test_innovation_is_the_distance_on_the_sky():
    """A camera that is 20 degrees off: the norm of the two rows of each star is the sine of its angle."""
    rng = np.random.default_rng(4)
    state = state_with_errors(layout().names)
    stars = seen(state, places(rng, 5))
    turned = correct(layout(), state, np.eye(layout().n)[ATT.start + 1] * 20.0 * DEG)
    z, _, _ = measure_stars.star_vectors(layout(), turned, frame_of(state.t_s, stars), C_BC, 0.0)
    cosine = np.sum(stars.u_c * (stars.u_i @ camera_attitude(turned)), axis=1)
    np.testing.assert_allclose(np.linalg.norm(z.reshape(-1, 2), axis=1), np.sqrt(1.0 - cosine**2), rtol=1e-10)


def test_what_stars_share_is_in_their_covariance():
    """Floor, rate, focal length: the covariance of directions turned and scaled by random samples."""
    rng = np.random.default_rng(5)
    state = state_with_errors(layout().names)
    xy_px, floor = places(rng, 4), 1e-4
    t_s = np.array([-0.01, -0.004, 0.003, 0.012])
    L = np.diag([2e-3, 5e-3, 8e-3])
    focal = 2e-3
    stars = seen(state, xy_px, t_seen_s=t_s, P_omega_c=L @ L, sigma_focal=focal)
    _, _, R = measure_stars.star_vectors(layout(), state, frame_of(state.t_s, stars), C_BC, floor)
    n, u, E = 40000, stars.u_c, cross_axes(stars.u_c)
    turn = floor * rng.standard_normal((n, 1, 3)) + t_s[:, None] * (rng.standard_normal((n, 1, 3)) @ L)
    own = np.einsum("kij,nkj->nki", np.linalg.cholesky(stars.P_u), rng.standard_normal((n, 4, 2)))
    longer = CAMERA._replace(focal_length_px=CAMERA.focal_length_px * (1.0 - focal))
    outwards = np.einsum("kij,kj->ki", E, unit_vectors(longer, xy_px)) * rng.standard_normal((n, 1, 1))
    rows = (np.einsum("kij,nkj->nki", E, np.cross(u, turn)) + own + outwards).reshape(n, 8)
    sigma = np.sqrt(np.diag(R))
    # correlations of 40000 samples have a standard deviation of 0.005 at most
    assert np.abs((np.cov(rows.T) - R) / np.outer(sigma, sigma)).max() < 0.03


@pytest.mark.parametrize("rolling", [False, True], ids=["global", "rolling"])
def test_many_stars_say_what_their_attitude_says(rolling):
    """20 fields of 12 stars: updates by stars and by the attitude of largest likelihood made of them."""
    rng = np.random.default_rng(6)
    order = layout()
    kalman = eskf.engine(order)
    for _ in range(20):
        truth = state_with_errors(order.names)
        xy_px = places(rng, 12)
        t_s = (xy_px[:, 1] - 246.0) * 60e-6 if rolling else np.zeros(12)
        P_omega = (2e-3) ** 2 * np.eye(3) if rolling else np.zeros((3, 3))
        stars = seen(truth, xy_px, rng, t_s, P_omega)
        q_true = rotation.quat_from_dcm(camera_attitude(truth))
        P_px = np.tile(SIGMA_PX**2 * np.eye(2), (12, 1, 1))
        noisy = pixels(CAMERA, stars.u_c)
        q_ic, P_c, _ = likelihood.refine(CAMERA, q_true, noisy, stars.u_i, P_px, t_s, P_omega)
        fix = frame_of(truth.t_s, stars, q_ic, P_c)
        A = 1e-4 * rng.standard_normal((order.n, order.n))
        P = A @ A.T + 1e-8 * np.eye(order.n)
        dx = np.zeros(order.n)
        dx[ATT] = 2e-3 * rng.standard_normal(3)
        estimate = correct(order, truth, dx)
        whole = eskf.update(
            kalman, order, estimate, P, *measurements.star_attitude(order, estimate, fix, C_BC, 5e-5)
        )
        single_stars = eskf.update(
            kalman, order, estimate, P, *measure_stars.star_vectors(order, estimate, fix, C_BC, 5e-5)
        )
        sigma = np.sqrt(np.diag(whole.P))
        assert np.abs((single_stars.P - whole.P) / np.outer(sigma, sigma)).max() < 2e-3
        apart = rotation.rotvec_between(whole.state.q_ib, single_stars.state.q_ib)
        assert np.abs(apart / sigma[ATT]).max() < 0.05


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
    for n, block in enumerate(blocks, 1):
        fusion.advance(nav, block)
        due = [fix for fix in waiting if fix.t_available_s <= block.t_valid_s + 1e-9]
        waiting = waiting[len(due) :]
        outputs = computer.conclude(nav, n, [], due)
        results += [record for record in outputs if isinstance(record, kind)]
    return results


def camera_error(nav, mounting, axes):
    """Error of the camera's attitude and its sigma at the last tick, rad, about camera-fixed axes (k, 3)."""
    tick = nav.history[-1]
    truth = STATES[round(tick.t_s * 100)]._replace(mounting=mounting)
    turn = camera_attitude(tick.state).T @ camera_attitude(truth)
    P_c = computer.camera_covariance(nav.layout, tick.P, C_BC)
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
    """Against the largest effect of random innovations on the rim of each star's gate."""
    nav, _ = started()
    tick, limit = nav.history[-1], nav.limit(2)
    stars = seen(STATES[round(tick.t_s * 100)], places(np.random.default_rng(5), 3))
    _, H, R = measure_stars.star_vectors(nav.layout, tick.state, frame_of(tick.t_s, stars), C_BC, 0.0)
    S = H @ tick.P @ H.T + R
    K = tick.P @ H.T @ np.linalg.inv(S)
    P_after = tick.P - K @ S @ K.T
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)
    worst = np.zeros(3)
    for k in range(0, 6, 2):
        rim = np.linalg.cholesky(S[k : k + 2, k : k + 2]) @ np.array([np.cos(angle), np.sin(angle)])
        worst = np.maximum(worst, np.abs(K[ATT, k : k + 2] @ rim * np.sqrt(limit)).max(axis=1))
    found = integrity_protection.slope_of_vectors(nav.layout, tick.P, P_after, limit, H, R)
    np.testing.assert_allclose(found.table[integrity_protection.WORST], worst, rtol=1e-6)
    np.testing.assert_allclose(found.table[integrity_protection.VARIANCE], np.diag(P_after)[ATT])
    assert np.all(found.table[integrity_protection.LEFT_STARS] < 1.0)


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
