"""Pictures of a lens that nobody told: covariance of the attitude, other laws, saturated stars, mirrors."""

import io

import night_sky
import numpy as np
import pytest
from PIL import Image
from scipy.stats import chi2

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.environment.ephemeris import sky_bodies
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_dcm, rotvec_from_quat
from shefex_nav.solve.camera import Camera
from shefex_nav.solve.image import solve_image

YEAR = night_sky.YEAR
MERAK, DUBHE, PHECDA, ALIOTH, MEGREZ = 53910, 54061, 58001, 62956, 59774
LAWS = {
    "equidistant": lambda angle: angle,
    "stereographic": lambda angle: 2.0 * np.tan(0.5 * angle),
    "equisolid": lambda angle: 2.0 * np.sin(0.5 * angle),
}


def error(found, shot):
    """d (3,) of q_ic(true) = q_ic exp(d) [rad]."""
    true = np.array(night_sky.axes(shot.ra_deg, shot.dec_deg, shot.roll_deg))
    return rotvec_from_quat(quat_from_dcm(dcm_from_quat(found.q_ci) @ true.T))


def nees(found, shot):
    """Squared error in standard deviations, 3 expected."""
    d = error(found, shot)
    return d @ np.linalg.solve(found.covariance, d)


def compressed(image, quality=85):
    """Through JPEG."""
    file = io.BytesIO()
    Image.fromarray(night_sky.to_8_bit(image)).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file))


def test_aberration_is_taken_out_where_the_day_is_known():
    """The sky is that of the moving Earth: where the day is not known, up to 20.5 arcsec off."""
    rng, arcsec = np.random.default_rng(22), np.radians(1.0 / 3600.0)
    velocity_i = sky_bodies("2019-07-28T10:37:12").earth_v_i
    with_it, without = [], []
    for _ in range(6):
        shot = night_sky.shoot(rng, fov_deg=8.0, limit=7.3, velocity_i=velocity_i)
        image = night_sky.to_8_bit(shot.image)
        of_day, of_year = (solve_image(image, epoch=epoch) for epoch in (2019.57, 2020.0))
        assert of_day.has_no_aberration and not of_year.has_no_aberration
        with_it.append(error(of_day, shot)[:2] / arcsec)
        forward = np.array(night_sky.axes(shot.ra_deg, shot.dec_deg, shot.roll_deg)[2])
        expected = np.linalg.norm(np.cross(forward, velocity_i)) / SPEED_OF_LIGHT / arcsec
        without.append(np.hypot(*error(of_year, shot)[:2]) / arcsec - expected)
    assert np.hypot(*np.transpose(with_it)).max() < 4.0
    assert np.abs(without).max() < 4.0 and expected > 5.0


@pytest.mark.parametrize(
    "options",
    [
        {"fov_deg": 11.4, "limit": 7.0},
        {"fov_deg": 25.0, "limit": 6.0, "k1_edge": -0.02},
        {"fov_deg": 60.0, "limit": 5.0, "law": LAWS["equidistant"]},
    ],
    ids=["narrow", "barrel", "wide"],
)
def test_errors_are_what_the_covariance_says(options):
    """Mean NEES of 24 drawn attitudes within 99 % of chi squared: 72 degrees of freedom."""
    rng = np.random.default_rng(21)
    values, solved = [], 0
    for _ in range(24):
        shot = night_sky.shoot(rng, **options)
        found = solve_image(night_sky.to_8_bit(shot.image), epoch=YEAR)
        if found.status == "ok":
            solved += 1
            values.append(nees(found, shot))
    assert solved >= 22
    low, high = chi2.ppf([0.005, 0.995], 3 * solved) / solved
    assert low < np.mean(values) < high


@pytest.mark.parametrize("law", LAWS)
def test_wide_lenses_that_are_not_the_fitted_one(law):
    rng = np.random.default_rng(22)
    for fov_deg, limit in ((40.0, 5.0), (65.0, 4.5)):
        shot = night_sky.shoot(rng, fov_deg=fov_deg, limit=limit, law=LAWS[law])
        found = solve_image(compressed(shot.image), epoch=YEAR)
        assert found.status == "ok"
        assert np.abs(error(found, shot)[:2]).max() < np.radians(fov_deg) / 1024  # a pixel
        assert abs(found.fov_x_deg / fov_deg - 1.0) < 0.01
        where = dict(zip(shot.hip.tolist(), shot.xy_px, strict=True))
        off = [np.hypot(*(where[m.hip] - [m.x_px, m.y_px])) for m in found.matched if m.hip in where]
        assert len(off) >= 10 and np.percentile(off, 90) < 1.5


def test_narrow_field_when_told():
    """3 deg in the Pleiades, where eight stars are in the catalogue; not looked for without being told."""
    shot = night_sky.shoot(np.random.default_rng(23), ra_deg=56.7, dec_deg=24.1, fov_deg=3.0, limit=8.0)
    found = solve_image(night_sky.to_8_bit(shot.image), epoch=YEAR, fov_deg=3.2)
    assert found.status == "ok" and np.abs(error(found, shot)).max() < 3.0 * np.sqrt(
        np.linalg.eigvalsh(found.covariance)[-1]
    )
    assert solve_image(night_sky.to_8_bit(shot.image), epoch=YEAR).status == "failed"


def test_saturated_stars_are_named_and_do_no_harm():
    """The Plough as a JPEG: its stars are white discs."""
    rng = np.random.default_rng(24)
    shot = night_sky.shoot(
        rng, ra_deg=178.0, dec_deg=56.0, roll_deg=30.0, fov_deg=30.0, limit=6.5, sigma_px=1.4, snr=60.0
    )
    image = compressed(shot.image, 80)
    assert (image >= 254).sum() > 40
    found = solve_image(image, epoch=YEAR)
    assert {MERAK, DUBHE, PHECDA, ALIOTH, MEGREZ} <= {match.hip for match in found.matched}
    assert nees(found, shot) < chi2.ppf(0.999, 3)
    where = dict(zip(shot.hip.tolist(), shot.xy_px, strict=True))
    for match in found.matched:
        if match.hip in (MERAK, DUBHE, PHECDA, ALIOTH):
            assert np.hypot(*(where[match.hip] - [match.x_px, match.y_px])) < 0.5


def test_mirrored_when_told():
    """As the picture that is not: the same middle, up and covariance, the stars where they are seen."""
    shot = night_sky.shoot(np.random.default_rng(25), fov_deg=14.0, limit=6.5)
    image = night_sky.to_8_bit(shot.image)
    plain = solve_image(image, epoch=YEAR)
    over = np.ascontiguousarray(image[:, ::-1])
    found = solve_image(over, epoch=YEAR, mirrored=True)
    assert found.status == "ok" and found.mirrored and not plain.mirrored
    np.testing.assert_array_equal(found.q_ci, plain.q_ci)
    np.testing.assert_array_equal(found.covariance, plain.covariance)
    assert [m.hip for m in found.matched] == [m.hip for m in plain.matched]
    np.testing.assert_allclose([m.x_px for m in found.matched], [1023.0 - m.x_px for m in plain.matched])
    assert solve_image(image, epoch=YEAR, mirrored=True).reason == "not_mirrored"


def test_camera_of_a_mirrored_picture_is_turned_over():
    """Axis off the middle and decentring: the turned camera sees the turned picture."""
    from shefex_nav.solve.camera import undistorted
    from shefex_nav.solve.image import turned_over

    camera = Camera(640, 480, 700.0, (300.0, 250.0), (-0.1, 0.02, 0.003, -0.002, 0.001))
    xy = np.random.default_rng(26).uniform([0.0, 0.0], [639.0, 479.0], (20, 2))
    flip = np.array([-1.0, 1.0])
    ideal = undistorted(camera, xy) - camera.principal_point_px
    over = turned_over(camera)
    np.testing.assert_allclose(
        undistorted(over, xy * flip + [639.0, 0.0]) - over.principal_point_px, ideal * flip, atol=1e-6
    )
