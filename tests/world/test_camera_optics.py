"""Mounting, calibration errors, stray light, and what the Earth hides."""

from dataclasses import replace

import numpy as np
import pytest
from camera_bench import DEG, PARAMS, sky

from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.world.camera import artefacts, camera, moon, optics
from shefex_nav.world.camera import sky as sources


def test_mounting_errors_have_the_given_size_about_each_axis():
    rng = np.random.default_rng(1)
    nominal = rotation.quat_from_dcm(PARAMS.mounting.C_bc)
    loose = replace(PARAMS.mounting, error=1e-3)
    errors = np.array(
        [rotation.rotvec_between(nominal, optics.true_mounting(loose, rng)) for _ in range(2000)]
    )
    np.testing.assert_allclose(errors.std(axis=0), 1e-3, rtol=0.06)  # 3.8 sigma of 2000 draws
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=1e-4)


def test_boresight_looks_along_body_y_and_rows_along_the_roll_axis():
    q_bc = optics.true_mounting(replace(PARAMS.mounting, error=0.0), np.random.default_rng(1))
    np.testing.assert_allclose(rotation.quat_rotate(q_bc, np.array([0.0, 0.0, 1.0])), [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(rotation.quat_rotate(q_bc, np.array([1.0, 0.0, 0.0])), [1, 0, 0], atol=1e-12)


def test_calibration_errors():
    cameras = [
        optics.true_pinhole(PARAMS.optics, PARAMS.detector, np.random.default_rng(seed))
        for seed in range(500)
    ]
    focal = np.array([camera.focal_length_px for camera in cameras]) / (24.95e-3 / 9.9e-6) - 1.0
    centre = np.array([(camera.cx_px, camera.cy_px) for camera in cameras]) - [329.0, 246.0]
    assert focal.std() == pytest.approx(1e-4, rel=0.13)  # 4 sigma of 500 draws
    np.testing.assert_allclose(centre.std(axis=0), 0.3, rtol=0.13)
    exact = replace(PARAMS.optics, focal_length_error=0.0, principal_point_error=0.0)
    nominal = optics.true_pinhole(exact, PARAMS.detector, np.random.default_rng(1))
    fov = 2 * np.degrees(np.arctan(0.5 * np.array([659, 493]) / nominal.focal_length_px))
    np.testing.assert_allclose(fov, [14.87, 11.15], atol=0.05)  # the paper's, with f = 25 mm


def test_stray_light_over_the_angle_to_the_sun():
    def sun(degrees):
        return optics.stray_light(degrees * DEG, 90 * DEG, 50 * DEG, PARAMS.stray_light)

    assert sun(90.0) == pytest.approx(PARAMS.stray_light.rate_at_exclusion)
    assert sun(85.0) == pytest.approx(10.0 * PARAMS.stray_light.rate_at_exclusion)
    assert sun(115.0) * 0.05 < 0.001  # electrons per frame: nothing
    angles = np.linspace(0.0, 180.0, 721)
    rates = np.array([sun(angle) for angle in angles])
    assert np.all(np.diff(rates) <= 0.0)
    saturating = 255 * 7.4 / 2e-3  # electrons/s that fill 8 bits at 24 dB in 2 ms
    assert np.all(rates[angles < 50.0] > saturating)
    edge = replace(PARAMS.stray_light, tenfold_angle=1e-10)  # of a baffle that has one
    inside, outside = (optics.stray_light(angle * DEG, 90 * DEG, 50 * DEG, edge) for angle in (89.0, 91.0))
    assert (inside, outside) == (edge.direct_rate, 0.0)


def test_share_of_the_sun_above_the_limb():
    """Of points spread evenly over a disc of 16 arcmin, those above a straight edge."""
    across = np.linspace(-1.0, 1.0, 2001)
    x, y = np.meshgrid(across, across)
    height = y[x**2 + y**2 < 1.0]
    for limb in np.radians(np.array([-12.0, -5.0, 0.0, 3.0, 14.0]) / 60.0):
        expected = (height > -limb / (15.99 / 60.0 * DEG)).mean()
        assert optics.share_above(limb) == pytest.approx(expected, abs=1e-3)
    assert [optics.share_above(limb * DEG) for limb in (-90.0, -0.267, 0.267, 90.0)] == [0.0, 0.0, 1.0, 1.0]


def test_stray_light_sinks_with_the_sun_behind_the_limb():
    earth, settings = sky()[2], PARAMS.stray_light
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, 100.0).T)
    sun_u_i, above = np.array([1.0, 0.0, 0.0]), np.array([-0.5, 0.0, np.sqrt(0.75)])
    boresight_i = np.array([np.cos(1.3), 0.0, np.sin(1.3)])  # 74 deg from the Sun
    rates, limbs = [], []
    for height in np.linspace(900e3, 1100e3, 401):  # the Sun rises 30 deg below the horizontal of 1000 km
        r_i = (wgs84.A + height) * above
        *angles, share, _ = camera.aimed(boresight_i, r_i, C_ei, sun_u_i)
        rates.append(camera.stray_rate(settings, *angles, share, 0.0))
        limbs.append(wgs84.limb_angle(C_ei @ r_i, C_ei @ sun_u_i))
    lit = camera.stray_rate(settings, *angles, 1.0, 0.0)
    limbs, rates = np.array(limbs), np.array(rates)
    assert np.all(rates[limbs < -optics.SUN_RADIUS] == 0.0) and rates[0] == 0.0
    assert np.all(rates[limbs > optics.SUN_RADIUS] == lit) and rates[-1] == lit > 1e4
    assert np.all(np.diff(rates) >= 0.0)
    assert np.interp(0.0, limbs, rates) == pytest.approx(0.5 * lit, rel=0.02)


def test_limb_is_bright_by_day_and_dark_at_night():
    r_i = np.array([0.0, 0.0, wgs84.A + 177e3])
    boresight_i = np.array([np.cos(0.9), 0.0, np.sin(0.9)])
    dip = np.arccos(wgs84.A / (wgs84.A + 177e3))

    def sun(elevation):  # as seen from the tangent point, in the plane of the boresight
        angle = elevation + dip
        return np.array([-np.cos(angle), 0.0, np.sin(angle)])

    def light(elevation):
        return optics.limb_sunlight(boresight_i, r_i, sun(elevation))

    assert light(np.pi / 2) == pytest.approx(1.0, abs=1e-3)
    assert light(0.5) == pytest.approx(np.sin(0.5), rel=0.01)
    assert light(0.0) == pytest.approx(optics.TWILIGHT)
    assert light(-0.5) < 1e-3
    assert np.isfinite(optics.limb_sunlight(r_i / np.linalg.norm(r_i), r_i, sun(0.3)))  # straight up


def test_the_earth_hides_what_is_below_its_limb():
    earth = sky()[2]
    C_ie = frames.dcm_ie(earth, 100.0)
    C_ei = np.ascontiguousarray(C_ie.T)
    rng = np.random.default_rng(2)
    u_i = rng.standard_normal((2000, 3))
    u_i /= np.linalg.norm(u_i, axis=1, keepdims=True)
    for latitude in (0.0, 70.0 * DEG):
        r_e = wgs84.ecef_from_geodetic(latitude, 0.3, 177e3)
        limb = np.array([wgs84.limb_angle(r_e, C_ei @ u) for u in u_i])
        hidden = sources.behind_earth(u_i, C_ie @ r_e, C_ei)
        clear = np.abs(limb) > 1e-6
        np.testing.assert_array_equal(hidden[clear], limb[clear] < 0.0)
        assert 0.35 < hidden.mean() < 0.45  # (1 - sin(dip)) / 2 with a dip of 13.4 deg


def test_bad_pixels_and_what_is_known_of_them():
    defects = artefacts.bad_pixels(PARAMS.artefacts, PARAMS.detector, np.random.default_rng(3))
    assert len(defects.hot) == PARAMS.artefacts.hot_pixels + PARAMS.artefacts.unknown_bad_pixels
    assert len(defects.known) == PARAMS.artefacts.hot_pixels + PARAMS.artefacts.dead_pixels
    known = set(map(tuple, defects.known))
    assert len(known) == len(defects.known)
    listed = [tuple(divmod(pixel, PARAMS.detector.columns)) in known for pixel in defects.hot]
    assert sum(listed) == PARAMS.artefacts.hot_pixels
    assert not any(listed[PARAMS.artefacts.hot_pixels :])
    assert all(tuple(divmod(pixel, PARAMS.detector.columns)) in known for pixel in defects.dead)
    assert np.all((defects.hot_rate >= 2e3) & (defects.hot_rate <= 1e5))


def test_planets_and_moon_from_the_vehicle():
    _, bodies, _ = sky()
    r_i = np.array([0.0, 0.0, 6.5e6])
    toward_i, radius = moon.seen_from(bodies, r_i)
    geocentric = bodies.moon_r_i / np.linalg.norm(bodies.moon_r_i)
    assert 0.5 < np.degrees(np.arccos(toward_i @ geocentric)) < 1.0  # parallax
    assert np.degrees(radius) == pytest.approx(0.26, abs=0.02)
    magnitudes = artefacts.planet_magnitudes(bodies)
    assert np.argmin(magnitudes) == 1  # Venus
    assert -4.8 < magnitudes[1] < -4.3
    assert -13.6 < artefacts.full_moon_magnitude(bodies) < -12.6
