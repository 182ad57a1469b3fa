"""The model of single stars in the filter: by differences, by samples, against an attitude of many."""

import numpy as np
import pytest
from navigation_flight import C_BC, DEG
from star_fields import CAMERA
from star_sights import SIGMA_PX, camera_attitude, frame_of, places, seen
from test_nav_blocks import ALL, ROLL, STEPS, state_with_errors
from test_nav_blocks import RNG as RNG  # begins anew with each test of this module, too
from unpacked import correct, star_attitude, update

from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import cross_axes, cross_covariance, pixels, unit_vectors
from shefex_nav.onboard.navigation import eskf, measure_stars
from shefex_nav.onboard.navigation.state import ATT, layout
from shefex_nav.onboard.startracker import likelihood


def test_cross_axes_and_their_covariance():
    """e1, e2, u are right-handed axes; the covariance against differences of directions along them."""
    rng = np.random.default_rng(1)
    xy_px = places(rng, 40)
    u = unit_vectors(CAMERA, xy_px)
    E = cross_axes(u)
    frame = np.concatenate([E, u[:, None]], axis=1)
    np.testing.assert_allclose(frame @ frame.transpose(0, 2, 1), np.tile(np.eye(3), (40, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0, atol=1e-14)
    A = rng.standard_normal((40, 2, 2))
    P_px = A @ A.transpose(0, 2, 1) + 0.1 * np.eye(2)
    J = np.empty((40, 2, 2))
    for axis in range(2):
        step = 1e-3 * np.eye(2)[axis]
        du = (unit_vectors(CAMERA, xy_px + step) - unit_vectors(CAMERA, xy_px - step)) / 2e-3
        J[:, :, axis] = np.einsum("kij,kj->ki", E, du)
    expected = J @ P_px @ J.transpose(0, 2, 1)
    scale = np.trace(expected, axis1=1, axis2=2)[:, None, None]
    np.testing.assert_allclose(cross_covariance(CAMERA, xy_px, P_px) / scale, expected / scale, atol=1e-7)


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
        rate = likelihood.CommonErrors(t_s, P_omega, 0.0)
        q_ic, P_c, _ = likelihood.refine(CAMERA, q_true, noisy, stars.u_i, P_px, rate)
        fix = frame_of(truth.t_s, stars, q_ic, P_c)
        A = 1e-4 * rng.standard_normal((order.n, order.n))
        P = A @ A.T + 1e-8 * np.eye(order.n)
        dx = np.zeros(order.n)
        dx[ATT] = 2e-3 * rng.standard_normal(3)
        estimate = correct(order, truth, dx)
        whole = update(kalman, order, estimate, P, *star_attitude(order, estimate, fix, C_BC, 5e-5))
        single_stars = update(
            kalman, order, estimate, P, *measure_stars.star_vectors(order, estimate, fix, C_BC, 5e-5)
        )
        sigma = np.sqrt(np.diag(whole.P))
        assert np.abs((single_stars.P - whole.P) / np.outer(sigma, sigma)).max() < 2e-3
        apart = rotation.rotvec_between(whole.state.q_ib, single_stars.state.q_ib)
        assert np.abs(apart / sigma[ATT]).max() < 0.05
