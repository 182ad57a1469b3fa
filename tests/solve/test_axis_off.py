"""Wide pictures of lenses whose axis is off the middle of the picture, or that are told."""

import night_sky
import numpy as np
import pytest
from scipy.stats import chi2

from shefex_nav.geometry.distortion import distort
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import (
    dcm_from_quat,
    dcm_from_rotvec,
    quat_from_dcm,
    rotvec_from_quat,
)
from shefex_nav.solve import lens, naming
from shefex_nav.solve.camera import Camera, pinhole_of
from shefex_nav.solve.image import solve_image

YEAR = night_sky.YEAR
SIZE_PX = 1024, 768
CUT_PX = 50  # of each side of the picture that is drawn; what is left has its axis up to half of it off


def cut(rng, fov_deg, limit):
    """A picture of 1024 x 768 pixels by a pinhole, its attitude C_ci of the middle, and where the axis is."""
    width, height = 1024 + CUT_PX, 768 + CUT_PX
    shot = night_sky.shoot(rng, fov_deg=fov_deg, limit=limit, width=width, height=height)
    left, top = rng.integers(0, CUT_PX + 1, 2)
    off_px = np.array([0.5 * CUT_PX - left, 0.5 * CUT_PX - top])
    focal_px = 0.5 * width / np.tan(0.5 * np.radians(fov_deg))
    axis_C_ci = np.array(night_sky.axes(shot.ra_deg, shot.dec_deg, shot.roll_deg))
    C_ci = of_axis(axis_C_ci, -off_px / focal_px)
    image = night_sky.to_8_bit(shot.image[top : top + 768, left : left + 1024])
    return image, C_ci, off_px


def squares(C_ci, true_C_ci, P_c):
    """NEES of an attitude with covariance P_c (3, 3)."""
    d = rotvec_from_quat(quat_from_dcm(C_ci @ true_C_ci.T))
    return d @ np.linalg.solve(P_c, d)


def of_axis(C_ci, off):
    """Attitude of the axis of a pinhole whose principal point is `off` (2,) focal lengths from the middle."""
    away = np.hypot(*off)
    x, y = off * np.arctan(away) / away
    return dcm_from_rotvec(np.array([-y, x, 0.0])).T @ C_ci


def test_errors_are_what_the_covariance_says_with_the_axis_off_the_middle():
    """Mean NEES of 24 pictures of 62 deg within 99.9 % of chi squared; of the middle without it some 20.

    That of the axis as well, which is known ten times less well.
    """
    rng, values = np.random.default_rng(31), []
    for _ in range(24):
        image, C_ci, off_px = cut(rng, 62.0, 5.0)
        found = solve_image(image, epoch=YEAR)
        assert found.status == "ok"
        axis_C_ci = of_axis(C_ci, off_px / (512.0 + 0.5 * CUT_PX) * np.tan(np.radians(31.0)))
        values.append(
            (
                squares(dcm_from_quat(found.q_ci), C_ci, found.covariance),
                squares(dcm_from_quat(found.camera_q_ci), axis_C_ci, found.camera_covariance),
            )
        )
        # the axis itself is found as well, to a pixel or so
        assert np.abs(np.array(found.camera.principal_point_px) - [511.5, 383.5] - off_px).max() < 3.0
    low, high = chi2.ppf([0.0005, 0.9995], 72) / 24
    assert (low < np.mean(values, axis=0)).all() and (np.mean(values, axis=0) < high).all()


def seen(rng, fov_deg, n_stars):
    """A lens as `spread` has them, and what it shows: Lens, its prior, stars, centroids, covariances."""
    focal_px = 512.0 / np.tan(0.5 * np.radians(fov_deg))
    prior = lens.spread(640.0 / focal_px)
    is_lens = False
    while not is_lens:
        truth = lens.of_terms(dcm_from_rotvec(rng.normal(size=3)), focal_px, rng.normal(0.0, prior))
        is_lens = lens.is_lens(truth, SIZE_PX)
    xy_px = rng.uniform([0.0, 0.0], [1023.0, 767.0], (n_stars, 2))
    u_i = lens.rays(truth, SIZE_PX, xy_px) @ truth.axis_C_ci
    noise_px = rng.uniform(0.1, 0.3, n_stars)
    xy_px = lens.project(truth, u_i, SIZE_PX)[0] + noise_px[:, None] * rng.normal(size=(n_stars, 2))
    return truth, prior, u_i, xy_px, noise_px[:, None, None] ** 2 * np.eye(2)


@pytest.mark.parametrize("fov_deg", [12.0, 30.0, 62.0])
def test_errors_of_the_axis_are_what_its_covariance_says(fov_deg):
    """Mean NEES of 400 lenses within 99.9 % of chi squared: of a narrow field the prior, of a wide one stars.

    With the covariance of the middle it is some 100 and more.
    """
    rng, values = np.random.default_rng(34), []
    for _ in range(400):
        truth, prior, u_i, xy_px, P_px = seen(rng, fov_deg, 60)
        best = lens.adjust(truth, prior, u_i, xy_px, P_px, SIZE_PX)
        found, P_c = best.lens.axis_C_ci, best.covariance
        values.append([squares(found, truth.axis_C_ci, P) for P in (lens.of_axis(P_c), P_c[:3, :3])])
    nees, by_middle = np.mean(values, axis=0)
    assert chi2.ppf(0.0005, 1200) / 400 < nees < chi2.ppf(0.9995, 1200) / 400
    assert by_middle > 100.0


def test_axes_of_the_middle_and_of_the_camera():
    """q_ci looks where RA and Dec say; camera and camera_q_ci put the stars where they are seen."""
    image, _, _ = cut(np.random.default_rng(32), 62.0, 5.0)
    found = solve_image(image, epoch=YEAR)
    ra, dec = np.radians([found.ra_deg, found.dec_deg])
    middle_i = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    assert np.arccos(min(dcm_from_quat(found.q_ci)[2] @ middle_i, 1.0)) < 1e-6  # 0.001 px
    seen_px = np.array([[match.x_px, match.y_px] for match in found.matched])
    rows = [np.flatnonzero(night_sky.STARS.hip == match.hip)[0] for match in found.matched]
    u_i = night_sky.STARS.u_i[rows]
    away = np.linalg.norm(
        lens.directions(found.camera, seen_px) - u_i @ dcm_from_quat(found.camera_q_ci).T, axis=1
    )
    assert np.median(away) * found.camera.focal_length_px < 0.5
    wrong = np.linalg.norm(lens.directions(found.camera, seen_px) - u_i @ dcm_from_quat(found.q_ci).T, axis=1)
    assert np.median(wrong) > 5.0 * np.median(away)


@pytest.mark.parametrize("fov_deg", [62.0, 66.0, 69.0])
def test_a_wide_camera_that_is_told(fov_deg):
    """What is solved without a camera is solved with the right one, and with one of 2 % off."""
    rng = np.random.default_rng(33)
    for _ in range(6):
        shot = night_sky.shoot(rng, fov_deg=fov_deg, limit=5.0)
        focal_px = 512.0 / np.tan(0.5 * np.radians(fov_deg))
        for factor in (0.982, 1.0, 1.018):
            camera = Camera(1024, 768, factor * focal_px)
            found = solve_image(night_sky.to_8_bit(shot.image), epoch=YEAR, camera=camera)
            assert found.status == "ok"
            assert (found.camera_covariance == found.covariance).all()  # its axes are the told ones


@pytest.mark.parametrize("factor", [0.985, 1.0, 1.015])
def test_a_bent_camera_that_is_told_puts_the_stars_where_they_are(factor):
    """Whatever it said of the focal length; with the distortion of the told one they were 0.6 px off."""
    fov_deg, k1_edge = 60.0, -0.1
    edge = np.tan(0.5 * np.radians(fov_deg))
    focal_px, k1 = 512.0 / (edge * (1.0 + k1_edge)), k1_edge / edge**2
    shot = night_sky.shoot(np.random.default_rng(5), fov_deg=fov_deg, k1_edge=k1_edge, snr=8.0)
    camera = Camera(1024, 768, factor * focal_px, None, (k1, 0.0, 0.0, 0.0, 0.0))
    found = solve_image(shot.image, epoch=YEAR, camera=camera)
    hips = [match.hip for match in found.matched if match.hip in shot.hip]
    true_px = shot.xy_px[[np.flatnonzero(shot.hip == hip)[0] for hip in hips]]
    u_i = night_sky.STARS.u_i[[np.flatnonzero(night_sky.STARS.hip == hip)[0] for hip in hips]]
    hole = pinhole_of(found.camera)
    ideal_px = pixels(hole, np.ascontiguousarray(u_i @ dcm_from_quat(found.camera_q_ci).T))
    away_px = distort(hole, np.array(found.camera.distortion), ideal_px) - true_px
    assert len(hips) > 400 and np.hypot(*away_px.T).max() < 0.05
    assert found.residual_px < 0.25
    marks = lens.directions(found.camera, np.array([[511.5, 383.5]])) @ dcm_from_quat(found.camera_q_ci)
    ra, dec = np.radians([found.ra_deg, found.dec_deg])
    middle_i = np.array([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)])
    assert np.linalg.norm(marks[0] - middle_i) < 1e-9


@pytest.mark.parametrize("k1", [0.0, -0.3, 0.24])
def test_the_field_of_view_of_a_told_camera_is_as_well_known_as_its_focal_length(k1):
    """A bent lens changes its field faster or slower: by a pinhole's, sigma was 0.73 of the right."""
    focal_px, sigma = 986.0, 1e-4

    def across(focal_px):
        camera = Camera(1024, 768, focal_px, None, (k1, 0.0, 0.0, 0.0, 0.0))
        left, right = lens.directions(camera, np.array([[-0.5, 383.5], [1023.5, 383.5]]))
        return np.degrees(np.arccos(left @ right))

    covariance = np.zeros((11, 11))
    covariance[3, 3] = sigma**2
    best = lens.Adjusted(lens.Lens(np.eye(3), focal_px), covariance, np.ones(1, dtype=bool), 0.0, 0.0, 1.0)
    camera = Camera(1024, 768, focal_px, None, (k1, 0.0, 0.0, 0.0, 0.0))
    expected = abs(across(focal_px * (1.0 + sigma)) - across(focal_px * (1.0 - sigma))) / 2.0
    assert naming._fov_sigma(best, SIZE_PX, camera) == pytest.approx(expected, rel=1e-3)
