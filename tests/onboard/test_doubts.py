"""Attitudes that beat chance and are still not to be trusted."""

import numpy as np
from star_fields import CAMERA, random_attitude, ready_tracker

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat, rotvec_between
from shefex_nav.solve.camera import Camera
from shefex_nav.solve.centroids import solve_centroids

EPOCH = 2012.47
PUBLIC = Camera(CAMERA.width_px, CAMERA.height_px, CAMERA.focal_length_px)
PLEIADES = np.array([0.4858, 0.7754, 0.4036])  # RA 56.75, Dec 24.1 deg


def sky_field(rng, q_ic, noise_px=0.1):
    """(xy_px, flux) of the catalogue stars in the frame."""
    stars = ready_tracker().pairs.stars
    u_c = stars.u_i @ dcm_from_quat(q_ic)
    front = np.flatnonzero(u_c[:, 2] > 0.5)
    xy = pixels(CAMERA, np.ascontiguousarray(u_c[front]))
    inside = ((xy >= 0.0) & (xy <= [658.0, 492.0])).all(axis=1)
    return xy[inside] + rng.normal(0.0, noise_px, (inside.sum(), 2)), 10 ** (-0.4 * stars.vmag[front[inside]])


def solve(xy, flux):
    return solve_centroids(xy, flux, camera=PUBLIC, epoch=EPOCH)


def test_shifted_image_of_the_sky_is_refused():
    """As bright as the stars: nothing tells which is which."""
    rng = np.random.default_rng(1)
    for _ in range(40):
        xy, flux = sky_field(rng, random_attitude(rng))
        if len(xy) < 6:
            continue
        moved = xy + np.array([31.0, -12.0])
        found = solve(np.vstack([xy, moved]), np.concatenate([flux, 0.7 * flux]))
        assert found.status == "failed"


def test_image_turned_about_the_axis_is_refused():
    rng = np.random.default_rng(2)
    for _ in range(40):
        xy, flux = sky_field(rng, random_attitude(rng))
        if len(xy) < 6:
            continue
        turned = 2.0 * np.array([CAMERA.cx_px, CAMERA.cy_px]) - xy
        found = solve(np.vstack([xy, turned]), np.concatenate([flux, 0.7 * flux]))
        assert found.status == "failed"


def test_one_false_star_far_from_a_cluster_does_not_set_the_roll():
    """The Pleiades and false stars only: six stars that say nothing about the roll."""
    rng = np.random.default_rng(3)
    solved = 0
    for _ in range(300):
        q_ic = pointing_near(rng, PLEIADES)
        xy, flux = sky_field(rng, q_ic)
        u_c = PLEIADES / np.linalg.norm(PLEIADES) @ dcm_from_quat(q_ic)
        cluster = np.hypot(*(xy - pixels(CAMERA, u_c[None])[0]).T) < 45.0
        false = rng.uniform([0.0, 0.0], [658.0, 492.0], (15, 2))
        found = solve(
            np.vstack([xy[cluster], false]),
            np.concatenate([flux[cluster], 10 ** (-0.4 * rng.uniform(3.0, 5.5, 15))]),
        )
        if found.status == "ok":
            solved += 1
            q_ci = q_ic * [1.0, -1.0, -1.0, -1.0]
            assert np.linalg.norm(rotvec_between(found.q_ci, q_ci)) < np.radians(0.5)
    assert solved < 100  # most such frames cannot be solved


def pointing_near(rng, direction):
    """Random attitude with the direction somewhere in the frame."""
    while True:
        q_ic = random_attitude(rng)
        u_c = direction / np.linalg.norm(direction) @ dcm_from_quat(q_ic)
        if u_c[2] > 0.99:
            xy = pixels(CAMERA, u_c[None])[0]
            if 30 < xy[0] < 628 and 30 < xy[1] < 462:
                return q_ic


def test_errors_far_beyond_the_model_are_refused():
    """Told 0.1 px, centroids are 2 px off: no attitude rather than one of the stars that happen to fit."""
    rng = np.random.default_rng(4)
    solved, tried = 0, 0
    for _ in range(150):
        q_ic = random_attitude(rng)
        xy, flux = sky_field(rng, q_ic, noise_px=2.0)
        tried += 1
        found = solve_centroids(xy, flux, camera=PUBLIC, epoch=EPOCH, centroid_sigma_px=0.1)
        if found.status == "ok":
            solved += 1
            q_ci = q_ic * [1.0, -1.0, -1.0, -1.0]
            assert np.linalg.norm(rotvec_between(found.q_ci, q_ci)) < np.radians(0.5)
    assert solved < 0.2 * tried
