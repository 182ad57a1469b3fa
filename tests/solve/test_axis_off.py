"""Wide pictures of lenses whose axis is off the middle of the picture, or that are told."""

import night_sky
import numpy as np
import pytest
from scipy.stats import chi2

from shefex_nav.geometry.rotation import (
    dcm_from_quat,
    dcm_from_rotvec,
    quat_from_dcm,
    rotvec_from_quat,
)
from shefex_nav.solve import lens
from shefex_nav.solve.camera import Camera
from shefex_nav.solve.image import solve_image

YEAR = night_sky.YEAR
CUT_PX = 50  # of each side of the picture that is drawn; what is left has its axis up to half of it off


def cut(rng, fov_deg, limit):
    """A picture of 1024 x 768 pixels by a pinhole, its attitude C_ci of the middle, and where the axis is."""
    width, height = 1024 + CUT_PX, 768 + CUT_PX
    shot = night_sky.shoot(rng, fov_deg=fov_deg, limit=limit, width=width, height=height)
    left, top = rng.integers(0, CUT_PX + 1, 2)
    off_px = np.array([0.5 * CUT_PX - left, 0.5 * CUT_PX - top])
    focal_px = 0.5 * width / np.tan(0.5 * np.radians(fov_deg))
    axis_C_ci = np.array(night_sky.axes(shot.ra_deg, shot.dec_deg, shot.roll_deg))
    away = np.hypot(*off_px) / focal_px
    x, y = off_px / focal_px * np.arctan(away) / away
    C_ci = dcm_from_rotvec(np.array([-y, x, 0.0])) @ axis_C_ci
    image = night_sky.to_8_bit(shot.image[top : top + 768, left : left + 1024])
    return image, C_ci, off_px


def test_errors_are_what_the_covariance_says_with_the_axis_off_the_middle():
    """Mean NEES of 24 pictures of 62 deg within 99.9 % of chi squared; of the middle without it some 20."""
    rng, values = np.random.default_rng(31), []
    for _ in range(24):
        image, C_ci, off_px = cut(rng, 62.0, 5.0)
        found = solve_image(image, epoch=YEAR)
        assert found.status == "ok"
        d = rotvec_from_quat(quat_from_dcm(dcm_from_quat(found.q_ci) @ C_ci.T))
        values.append(d @ np.linalg.solve(found.covariance, d))
        # the axis itself is found as well, to a pixel or so
        assert np.abs(np.array(found.camera.principal_point_px) - [511.5, 383.5] - off_px).max() < 3.0
    assert chi2.ppf(0.0005, 72) / 24 < np.mean(values) < chi2.ppf(0.9995, 72) / 24


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
            assert solve_image(night_sky.to_8_bit(shot.image), epoch=YEAR, camera=camera).status == "ok"
