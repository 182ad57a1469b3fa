"""Whole frames: geometry, photometry, motion, stray light, defects."""

import erfa
import numpy as np
import pytest
from camera_bench import CLEAN, DEG, PARAMS, T_S, build, sky, turning

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.environment.stars import silicon_magnitude
from shefex_nav.geometry import pinhole, rotation, wgs84
from shefex_nav.geometry.shutter import row_times
from shefex_nav.records import CameraCommand
from shefex_nav.settings import changed
from shefex_nav.world import camera
from shefex_nav.world.camera import camera as stages
from shefex_nav.world.camera import detector, motion

COMMAND = CameraCommand(T_S, 0.05, 24.0)
HERCULES = (110.0, 50.0)  # azimuth, elevation [deg] of free sky
PER_DN = detector.electronics(PARAMS.detector, 24.0).electrons_per_dn


def take(device, trajectory, seed=9, command=COMMAND):
    return camera.expose(device, command, trajectory, 7, T_S, np.random.default_rng(seed))


def test_times_and_shape():
    frame, truth = take(build(PARAMS), turning(*HERCULES))
    assert frame.image_dn.shape == (493, 659)
    assert frame.image_dn.dtype == np.uint8
    assert frame.number == truth.number == 7
    assert frame.t_valid_s == truth.t_valid_s == T_S + 0.025
    assert frame.t_available_s == pytest.approx(T_S + 0.05 + 0.015)
    assert (frame.exposure_s, frame.gain_db) == (0.05, 24.0)


def test_true_attitude_includes_the_mounting_error():
    device = build(PARAMS)
    omega_c = np.array([1.0, 0.5, 2.0]) * DEG
    trajectory = turning(*HERCULES, omega_c)
    _, truth = take(device, trajectory)
    nominal = rotation.quat_multiply(trajectory.q_ib[10], rotation.quat_from_dcm(PARAMS.mounting.C_bc))
    error_c = rotation.rotvec_between(nominal, truth.q_ic)  # sample 10 is the middle of the exposure
    mounting = rotation.rotvec_between(rotation.quat_from_dcm(PARAMS.mounting.C_bc), device.q_bc)
    np.testing.assert_allclose(error_c, mounting, atol=1e-10)
    assert truth.rate == pytest.approx(np.linalg.norm(omega_c))


def test_stars_are_where_an_independent_projection_puts_them():
    catalogue, bodies, _ = sky()
    device = build(CLEAN)
    trajectory = turning(*HERCULES)
    _, truth = take(device, trajectory)
    v = (bodies.earth_v_i + trajectory.v_i[0]) / SPEED_OF_LIGHT
    seen_i = erfa.ab(catalogue.u_i, v, 1e12, np.sqrt(1.0 - v @ v))
    u_c = seen_i @ rotation.dcm_from_quat(truth.q_ic)
    hole = device.pinhole
    x = hole.cx_px + hole.focal_length_px * u_c[:, 0] / u_c[:, 2]
    y = hole.cy_px + hole.focal_length_px * u_c[:, 1] / u_c[:, 2]
    inside = (u_c[:, 2] > 0) & (x >= -0.5) & (x <= 658.5) & (y >= -0.5) & (y <= 492.5)
    expected = inside & (catalogue.vmag <= 5.5)
    assert set(truth.hip) == set(catalogue.hip[expected])
    order = {hip: k for k, hip in enumerate(catalogue.hip)}
    rows = [order[hip] for hip in truth.hip]
    np.testing.assert_allclose(truth.xy_px, np.column_stack([x, y])[rows], atol=1e-6)


def isolated(truth, catalogue, low, high):
    """Listed stars between two V magnitudes, 8 px inside the frame, without a rendered neighbour within
    12 px: rows of the catalogue and positions."""
    rows, positions = [], []
    rendered_i = catalogue.u_i[catalogue.vmag <= PARAMS.stars.faintest]
    for hip, xy in zip(truth.hip, truth.xy_px, strict=True):
        row = np.flatnonzero(catalogue.hip == hip)[0]
        near = np.count_nonzero(rendered_i @ catalogue.u_i[row] > np.cos(12 * 9.9e-6 / 24.95e-3))
        inside = (8 < xy[0] < 650) and (8 < xy[1] < 484)
        if inside and near == 1 and low <= catalogue.vmag[row] <= high:
            rows.append(row)
            positions.append(xy)
    return np.array(rows), np.array(positions)


@pytest.mark.parametrize("omega_c", [(0.0, 0.0, 0.0), (1.4 * DEG, 1.4 * DEG, 0.0)])
def test_photometry_and_centres_of_light(omega_c):
    """Mean of 40 frames, 11 x 11 px: flux and centre within 4 sigma of the expected ones."""
    catalogue, _, _ = sky()
    device = build(CLEAN)
    trajectory = turning(*HERCULES, omega_c)
    rng = np.random.default_rng(10)
    frames_dn = []
    for _ in range(40):
        frame, truth = camera.expose(device, COMMAND, trajectory, 0, T_S, rng)
        frames_dn.append(frame.image_dn.astype(float))
    mean_dn = np.mean(frames_dn, axis=0)
    background_dn = 16.0 + 400.0 * 0.05 / PER_DN
    rows, positions = isolated(truth, catalogue, 3.6, 5.5)
    assert len(rows) >= 4
    for row, (x, y) in zip(rows, positions, strict=True):
        column, line = round(x), round(y)
        patch = mean_dn[line - 5 : line + 6, column - 5 : column + 6] - background_dn
        electrons = patch.sum() * PER_DN
        magnitude = silicon_magnitude(catalogue.vmag[[row]], catalogue.bv[[row]])[0]
        expected = 2.5e6 * 10.0 ** (-0.4 * magnitude) * 0.05
        sigma = np.sqrt((expected + 121 * (16.0**2 + 20.0)) / 40)
        assert abs(electrons - expected) < 4 * sigma, catalogue.hip[row]
        offsets = np.arange(-5, 6)
        centre_x = column + patch.sum(axis=0) @ offsets / patch.sum()
        centre_y = line + patch.sum(axis=1) @ offsets / patch.sum()
        # the noise of an unweighted centroid over 121 px
        sigma_px = np.sqrt(10.0 * 121 * (16.0**2 + 20.0) / 40) / expected
        assert abs(centre_x - x) < 4 * sigma_px + 0.01
        assert abs(centre_y - y) < 4 * sigma_px + 0.01


def test_star_of_fifth_magnitude_stands_18_to_47_grey_values_high():
    catalogue, _, _ = sky()
    device = build(CLEAN)
    heights = []
    for azimuth in (90.0, 110.0, 130.0, 150.0):
        for exposure_s in (0.035, 0.05):
            frame, truth = take(device, turning(azimuth, 50.0), command=CameraCommand(T_S, exposure_s, 24.0))
            _, positions = isolated(truth, catalogue, 4.9, 5.1)
            for x, y in positions:
                patch = frame.image_dn[round(y) - 1 : round(y) + 2, round(x) - 1 : round(x) + 2]
                heights.append(patch.max() - 18.7)
    assert len(heights) >= 6
    assert 18.0 < np.mean(heights) < 47.0


def test_same_seed_same_bytes_and_no_trace_of_earlier_frames():
    trajectory = turning(*HERCULES)
    device = build(PARAMS)
    first, _ = take(device, trajectory)
    take(device, turning(200.0, 45.0), seed=20)
    again, _ = take(device, trajectory)
    fresh, _ = take(build(PARAMS), trajectory)
    np.testing.assert_array_equal(first.image_dn, again.image_dn)
    np.testing.assert_array_equal(first.image_dn, fresh.image_dn)
    assert not device.light.electrons.any()
    other, _ = take(device, trajectory, seed=11)
    assert np.any(first.image_dn != other.image_dn)


def test_another_run_is_another_camera():
    one, two = build(PARAMS, 1), build(PARAMS, 2)
    assert one.pinhole != two.pinhole
    assert np.any(one.q_bc != two.q_bc)
    assert np.any(one.bad_pixel_map != two.bad_pixel_map)
    # nominal scatter of the brightness, 0.1 mag
    flux = [device.sky.flux[device.sky.hip > 0] for device in (one, two)]
    scatter = 2.5 * np.log10(flux[0] / flux[1])
    assert scatter.std() == pytest.approx(0.1 * np.sqrt(2), rel=0.02)


def mean_light(device, trajectory, monkeypatch, faint):
    """Noise-free electrons of a frame."""
    monkeypatch.setattr(stages, "FAINT", faint)
    kept = {}

    def read_out(device, background, slope, command, rng):
        kept["light"] = device.light.electrons.copy()
        return np.zeros((493, 659), np.uint8)

    monkeypatch.setattr(stages, "_read_out", read_out)
    take(device, trajectory)
    return kept["light"]


@pytest.mark.parametrize(
    "omega_c",
    [
        (540 * DEG, 0.0, 0.0),  # the spin of the boost
        (5 * DEG, 0.0, 540 * DEG),
        (3.0, 1.0, 0.0),
    ],
)
def test_what_is_too_faint_to_draw_is_below_the_noise(omega_c, monkeypatch):
    device = build(PARAMS)
    trajectory = turning(*HERCULES, omega_c)
    faint = stages.FAINT
    some = mean_light(device, trajectory, monkeypatch, faint)
    everything = mean_light(device, trajectory, monkeypatch, 0.0)
    noise = np.sqrt(16.0**2 + 20.0)
    assert np.abs(everything - some).max() < 4 * faint * noise  # several may overlap
    assert some.max() > 2.0 * noise  # and the bright ones are there
    assert np.count_nonzero(some) < np.count_nonzero(everything)


def test_steps_follow_the_fastest_star_in_the_frame():
    """The fastest of the corners moves no more than psf.step_px, and not much less, between attitudes."""
    device = build(PARAMS)
    step_px, times = device.psf.step_px, row_times(0.05, 0.0, 493)
    corners = np.array([[-0.5, -0.5], [658.5, -0.5], [-0.5, 492.5], [658.5, 492.5], [329.0, 246.0]])
    for omega_c in ((20 * DEG, 0, 0), (0, 30 * DEG, 0), (0, 0, 200 * DEG), (10 * DEG, 10 * DEG, 100 * DEG)):
        trajectory = turning(*HERCULES, omega_c)
        path = motion.during(device.pinhole, trajectory, device.q_bc, T_S + 0.025, times, step_px).path
        k = len(path.C_ci) // 2
        u_i = pinhole.unit_vectors(device.pinhole, corners) @ path.C_ci[k]
        before = pinhole.pixels(device.pinhole, u_i @ path.C_ci[k].T)
        after = pinhole.pixels(device.pinhole, u_i @ path.C_ci[k + 1].T)
        longest = np.linalg.norm(after - before, axis=1).max()
        assert 0.35 * step_px < longest <= 1.001 * step_px


def test_sun_in_the_exclusion_angle():
    device = build(PARAMS)
    outside, truth = take(device, turning(*HERCULES))
    assert truth.exclusion_met
    assert np.degrees(truth.sun_angle) == pytest.approx(114.9, abs=0.3)  # Sun at azimuth 308.6, elevation 13
    assert np.degrees(truth.limb_angle) == pytest.approx(50.0 + 13.35, abs=0.3)
    assert outside.image_dn.mean() == pytest.approx(18.7, abs=0.2)

    near, truth = take(device, turning(230.0, 45.0))
    assert not truth.exclusion_met
    assert 70.0 < np.degrees(truth.sun_angle) < 85.0
    assert near.image_dn.mean() > 1.5 * outside.image_dn.mean()
    blinded, truth = take(device, turning(305.0, 45.0))
    assert np.degrees(truth.sun_angle) < 50.0
    assert blinded.image_dn.mean() > 254.0


def test_no_stray_light_of_a_sun_behind_the_earth():
    """20 000 km from the Earth, on either side; boresight 70 deg from the Sun."""
    sun_i = sky()[1].sun_u_i
    z_i = np.cos(70.0 * DEG) * sun_i + np.sin(70.0 * DEG) * wgs84.perpendicular(sun_i)
    x_i = wgs84.perpendicular(z_i)
    q_ic = rotation.quat_from_dcm(np.column_stack([x_i, np.cross(z_i, x_i), z_i]))
    still, device = turning(*HERCULES), build(changed(PARAMS, {"mounting.error": 0.0}))
    q_ib = rotation.quat_multiply(q_ic, rotation.quat_from_dcm(PARAMS.mounting.C_bc.T))
    n = len(still.t_s)
    lit, dark = (
        take(device, still._replace(q_ib=np.tile(q_ib, (n, 1)), r_i=np.tile(way * 20e6 * sun_i, (n, 1))))
        for way in (1.0, -1.0)
    )
    assert lit[1].sun_angle == dark[1].sun_angle == pytest.approx(70.0 * DEG)
    assert (lit[1].exclusion_met, lit[1].sun_hidden) == (False, False)
    assert (dark[1].exclusion_met, dark[1].sun_hidden) == (True, True)
    assert lit[0].image_dn.mean() > 100.0
    assert dark[0].image_dn.mean() == pytest.approx(18.7, abs=0.2)


def test_bright_limb_and_dark_limb():
    """Towards the Sun the limb 10 deg below the boresight blinds; on the night side it does not."""
    only_earth = changed(
        PARAMS, {"stray_light.baffle": -1.0, "stray_light.sun_exclusion": -np.pi}
    )  # the Sun gives no stray light
    bright, truth = take(build(only_earth), turning(308.0, 5.0))
    assert np.degrees(truth.limb_angle) < 20.0
    assert not truth.exclusion_met
    assert bright.image_dn.mean() > 250.0
    dark, _ = take(build(only_earth), turning(128.0, 32.0))
    assert dark.image_dn.mean() < 25.0


def test_no_stars_through_the_earth():
    no_stray = changed(CLEAN, {"stray_light.rate_at_exclusion": 0.0, "stray_light.direct_rate": 0.0})
    frame, truth = take(build(no_stray), turning(110.0, -60.0))
    assert truth.limb_angle < 0.0
    assert len(truth.hip) == 0
    assert frame.image_dn.max() < 18.7 + 7 * 2.3


def test_crescent_moon_in_the_frame():
    """Three days after new Moon: a thin saturated crescent, 23 px across, at azimuth 273, elevation 13."""
    no_stray = changed(CLEAN, {"stray_light.rate_at_exclusion": 0.0, "stray_light.direct_rate": 0.0})
    frame, _ = take(build(no_stray), turning(274.0, 13.0), command=CameraCommand(T_S, 0.002, 24.0))
    rows, columns = np.nonzero(frame.image_dn == 255)
    assert 15 < max(np.ptp(rows), np.ptp(columns)) <= 24
    assert 20 < len(rows) < 150  # a full Moon would be 410


def test_hot_and_dead_pixels_show_and_the_map_holds_those_known():
    device = build(
        changed(
            PARAMS,
            {
                "artefacts.hot_pixel_weakest": 30000.0,
                "artefacts.hot_pixel_strongest": 100000.0,
                "artefacts.false_objects": 0,
            },
        )
    )
    trajectory = turning(200.0, 45.0)
    images = [take(device, trajectory, seed)[0].image_dn for seed in range(12)]
    rows, columns = device.bad_pixel_map.T
    median = np.median(images, axis=0)
    known = median[rows, columns]
    assert np.count_nonzero(known > 200) >= PARAMS.artefacts.hot_pixels - 3  # a few may lie beside each other
    unknown = device.bad_pixels.hot[PARAMS.artefacts.hot_pixels :]
    assert np.all(median.ravel()[unknown] > 200)
    dead = np.array(images).reshape(12, -1)[:, device.bad_pixels.dead]
    assert dead.mean() == pytest.approx(PARAMS.detector.black_level, abs=4 * 2.2 / np.sqrt(120))


def test_false_objects_stay_in_the_sky_and_spikes_do_not():
    """Bright pixels of two frames of one run: the same for false objects, others for spikes."""
    many = changed(
        CLEAN,
        {
            "artefacts.false_objects": 20000,
            "artefacts.false_brightest": 3.0,
            "artefacts.false_faintest": 3.5,
            "stars.faintest": -5.0,
        },
    )
    device = build(many)
    one, truth = take(device, turning(*HERCULES), 1)
    two, _ = take(device, turning(*HERCULES), 2)
    assert len(truth.hip) == 0
    bright = (one.image_dn > 60) & (two.image_dn > 60)
    assert bright.sum() > 0.9 * (one.image_dn > 60).sum() > 100
    spiky = build(
        changed(
            CLEAN,
            {
                "artefacts.spikes_per_frame": 30.0,
                "artefacts.false_brightest": 3.0,
                "artefacts.false_faintest": 3.5,
                "stars.faintest": -5.0,
            },
        )
    )
    one, _ = take(spiky, turning(*HERCULES), 1)
    two, _ = take(spiky, turning(*HERCULES), 2)
    assert (one.image_dn > 60).sum() > 100
    assert ((one.image_dn > 60) & (two.image_dn > 60)).sum() < 0.1 * (one.image_dn > 60).sum()


def test_exposure_beyond_the_flight_is_an_error():
    with pytest.raises(ValueError, match="outside the trajectory"):
        camera.expose(build(PARAMS), COMMAND, turning(*HERCULES), 0, T_S + 0.47, np.random.default_rng(1))


def test_no_star_is_seen_through_the_moon():
    """A Moon without light of its own before the brightest star: that one is gone, the others stay."""
    catalogue, bodies, _ = sky()
    trajectory, device = turning(*HERCULES), build(CLEAN)
    frame, truth = take(device, trajectory)
    inside = ((truth.xy_px > 30.0) & (truth.xy_px < [629.0, 463.0])).all(axis=1)
    vmag = np.array([catalogue.vmag[catalogue.hip == hip][0] for hip in truth.hip])
    star = int(np.argmin(np.where(inside, vmag, np.inf)))
    u_c = pinhole.unit_vectors(device.pinhole, truth.xy_px[star : star + 1])[0]
    moon_r_i = trajectory.r_i[10] + 3.844e8 * (rotation.dcm_from_quat(truth.q_ic) @ u_c)
    dark = device._replace(bodies=bodies._replace(moon_r_i=moon_r_i), full_moon_flux=0.0)
    covered, seen = take(dark, trajectory)
    radius_px = device.pinhole.focal_length_px * 1737.4 / 384400.0
    near = np.linalg.norm(truth.xy_px - truth.xy_px[star], axis=1) < radius_px
    assert near[star] and set(seen.hip) == set(truth.hip[~near])
    x, y = np.rint(truth.xy_px[star]).astype(int)
    background = np.median(frame.image_dn)
    assert frame.image_dn[y, x] > background + 100
    assert covered.image_dn[y - 2 : y + 3, x - 2 : x + 3].max() < background + 15


def test_faint_stray_light_that_slopes_leaves_no_negative_charge():
    """Less light than the background is rounded to, and none besides: a dark picture, no error."""
    slope = {"detector.background": 0.0, "stray_light.gradient": 1.0, "stray_light.rate_at_exclusion": 0.1}
    frame, _ = take(build(changed(CLEAN, slope)), turning(*HERCULES))
    assert np.median(frame.image_dn) == PARAMS.detector.black_level
