"""What moves or hits: particles, satellites and debris, smeared hot pixels, stray light that is not even."""

import numpy as np
import pytest
from camera_bench import CLEAN, DEG, PARAMS, T_S, build, turning
from scipy.special import ndtr

from shefex_nav.geometry import pinhole
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.geometry.shutter import row_times
from shefex_nav.papers.stills import StillCamera, still
from shefex_nav.records import CameraCommand
from shefex_nav.settings import changed
from shefex_nav.world import camera
from shefex_nav.world.camera import hits, motion, movers
from shefex_nav.world.camera.detector import Electronics

COMMAND = CameraCommand(T_S, 0.05, 24.0)
HERCULES = (110.0, 50.0)
SIZE = 40, 30
EMPTY = changed(CLEAN, {"stars.faintest": -5.0})
PER_DN = PARAMS.detector.conversion * 10.0 ** (-24.0 / 20.0)


def take(device, trajectory, seed=9, command=COMMAND, t_s=T_S):
    return camera.expose(device, command, trajectory, 7, t_s, np.random.default_rng(seed))[0].image_dn


def picture(found):
    image = np.zeros(SIZE[0] * SIZE[1])
    np.add.at(image, found.pixel, found.electrons)
    return image.reshape(SIZE[1], SIZE[0])


def test_an_upset_keeps_its_charge_in_a_few_pixels():
    places = np.array([[10.0, 12.0], [20.5, 5.0], [-0.4, 29.3]])
    image = picture(hits.upsets(*SIZE, places[:1], np.array([8000.0])))
    assert image.sum() == pytest.approx(8000.0, rel=1e-3)
    assert image[12, 10] == pytest.approx(8000.0 * (1.0 - 2.0 * ndtr(-0.5 / hits.DIFFUSION_PX)) ** 2)
    image = picture(hits.upsets(*SIZE, places[1:2], np.array([8000.0])))
    assert image[5, 20] == pytest.approx(image[5, 21])  # on the edge between both
    assert image[5, 20:22].sum() > 0.85 * 8000.0
    assert picture(hits.upsets(*SIZE, places[2:], np.array([8000.0]))).sum() < 0.7 * 8000.0  # off the edge


@pytest.mark.parametrize(
    "ends", [((3.2, 4.1), (31.7, 22.8)), ((30.0, 20.0), (5.0, 20.0)), ((7.0, 3.0), (7.0, 9.9))]
)
def test_a_trail_leaves_charge_in_proportion_to_its_way_in_each_pixel(ends):
    image = picture(hits.trail(*SIZE, *ends, 500.0))
    fine = np.linspace(0.0, 1.0, 200_001)[:, None]
    x, y = (np.array(ends[0]) + fine * np.subtract(ends[1], ends[0])).T
    length = np.hypot(*np.subtract(ends[1], ends[0]))
    expected = np.zeros_like(image)
    np.add.at(
        expected, (np.floor(y + 0.5).astype(int), np.floor(x + 0.5).astype(int)), 500.0 * length / 200_001
    )
    np.testing.assert_allclose(image, expected, atol=0.5)
    assert image.sum() == pytest.approx(500.0 * length)


def test_a_trail_ends_at_the_edge_of_the_detector():
    image = picture(hits.trail(*SIZE, (35.0, 15.0), (60.0, 15.0), 100.0))
    assert image.sum() == pytest.approx(450.0)  # from 35 to 39.5


def test_particles_hit_single_frames_and_do_not_change_the_noise_of_other_pixels():
    quiet = take(build(EMPTY), turning(*HERCULES))
    rough = changed(
        EMPTY,
        {
            "artefacts.upsets_per_frame": 20.0,
            "artefacts.trails_per_frame": 3.0,
            "artefacts.particle_weakest": 3000.0,
            "artefacts.particle_strongest": 30000.0,
        },
    )
    device = build(rough)
    one, two = take(device, turning(*HERCULES)), take(device, turning(*HERCULES), seed=10)
    hit = one != quiet
    assert 20 < hit.sum() < 3000
    assert (one[hit].astype(int) - quiet[hit]).min() > -40  # charge is added; the rest is noise
    bright = one > 150
    assert bright.sum() > 15
    assert (bright & (two > 150)).sum() < 0.1 * bright.sum()
    np.testing.assert_array_equal(one, take(build(rough), turning(*HERCULES)))  # same seed, same hits


def test_the_numbers_of_particles():
    """400 frames: the mean number within 4 sigma; lengths and charges within their limits."""
    params = changed(
        EMPTY,
        {
            "artefacts.upsets_per_frame": 2.0,
            "artefacts.particle_weakest": 1000.0,
            "artefacts.particle_strongest": 4000.0,
        },
    )
    rng = np.random.default_rng(3)
    charge = [hits.of_frame(params.artefacts, params.detector, rng).electrons.sum() for _ in range(400)]
    mean = 3e3 / np.log(4.0)  # of what is even in the logarithm
    square = 0.5 * (16e6 - 1e6) / np.log(4.0)
    assert np.mean(charge) == pytest.approx(2.0 * mean, abs=4.0 * np.sqrt(2.0 * square / 400) + 0.01 * mean)
    params = changed(
        EMPTY,
        {
            "artefacts.trails_per_frame": 5.0,
            "artefacts.trail_longest": 50.0,
            "artefacts.particle_weakest": 100.0,
            "artefacts.particle_strongest": 101.0,
        },
    )
    for _ in range(20):
        assert hits.of_frame(params.artefacts, params.detector, rng).electrons.max() <= 101.0 * np.sqrt(2.0)


def test_stills_take_hits():
    device = StillCamera(
        pinhole.pinhole(*SIZE, 2889.0), 1.1, Electronics(50.0, 65e3, 16.0, 32.0, 12), 6100.0, 1.46e6
    )
    nothing = np.empty((0, 3)), np.empty(0), np.array([1.0, 0.0, 0.0, 0.0])
    added = hits.upsets(*SIZE, np.array([[10.0, 12.0]]), np.array([20e3]))
    with_hit, _ = still(device, *nothing, np.random.default_rng(1), hits=added)
    without, _ = still(device, *nothing, np.random.default_rng(1))
    np.testing.assert_array_equal(np.argwhere(with_hit > without + 300), [[12, 10]])
    unlit, _ = still(device, *nothing, np.random.default_rng(1))  # no trace of the hit
    np.testing.assert_array_equal(unlit, without)


def test_movers_run_along_great_circles():
    some = movers.draw(50, (1e-3, 1e-2), np.ones(50), np.random.default_rng(2))
    h = 1e-3
    for t_s in (0.0, 77.0):
        u_i = movers.directions(some, t_s)
        speed = (movers.directions(some, t_s + h) - movers.directions(some, t_s - h)) / (2.0 * h)
        np.testing.assert_allclose(np.linalg.norm(u_i, axis=1), 1.0)
        np.testing.assert_allclose(np.linalg.norm(speed, axis=1), some.rate, rtol=1e-6)
        normal = np.cross(u_i, speed) / some.rate[:, None]
        np.testing.assert_allclose(normal, np.cross(some.a_i, some.b_i), atol=1e-6)
    assert some.rate.min() > 1e-3
    assert some.rate.max() < 1e-2


def test_places_of_movers_over_a_frame():
    hole = pinhole.pinhole(659, 493, 2520.0)
    times = row_times(0.05, 1e-4, 493)
    omega_c = np.array([1.0, -2.0, 5.0]) * DEG
    some = movers.draw(30, (1e-3, 1e-1), np.ones(30), np.random.default_rng(2))
    C_ic = np.column_stack([some.b_i[0], np.cross(some.a_i[0], some.b_i[0]), some.a_i[0]])
    path = motion.refined(motion.turning(hole, C_ic, omega_c, times, 1.0), 250.0, 1.0)
    xy_px = movers.tracks(some, hole, path, 12.0)
    for k in (0, 3, len(path.C_ci) - 1):
        t_s = path.begin_s + k * path.step_s
        u_i = movers.directions(some, 12.0 + t_s)
        exact = motion.turning(hole, C_ic, omega_c, times, 1.0)._replace(begin_s=t_s)
        C_ci = motion._turning_kernel(C_ic, omega_c, exact.begin_s, 0.0, 1)[0]
        expected = pinhole.pixels(hole, u_i @ C_ci.T)
        shown = np.abs(expected).max(axis=1) < 2000.0
        assert shown.any()
        np.testing.assert_allclose(xy_px[shown, k], expected[shown], atol=0.01)


def test_satellites_cross_the_field_as_streaks_of_their_own():
    """A camera at rest and one satellite of 1 deg/s, 44 px/s to the right, in three frames."""
    device, trajectory = build(EMPTY), turning(*HERCULES)
    still_path = motion.during(
        device.pinhole, trajectory, device.q_bc, T_S + 0.025, row_times(0.05, 0.0, 493), 1.0
    )
    C_ic = still_path.C_ci.T
    angle = 1.0 * DEG * (T_S + 0.2)  # it crosses the boresight at T_S + 0.2 s, to the right
    a_i = C_ic[:, 2] * np.cos(angle) - C_ic[:, 0] * np.sin(angle)
    b_i = C_ic[:, 2] * np.sin(angle) + C_ic[:, 0] * np.cos(angle)
    moving = movers.Movers(a_i[None], b_i[None], np.array([1.0 * DEG]), np.array([2.5e6]))
    device = device._replace(movers=moving)
    hole = device.pinhole
    for start_s in (0.05, 0.15, 0.3):
        image = take(device, trajectory, t_s=T_S + start_s).astype(float) - 18.7
        image[image < 25.0] = 0.0
        rows, columns = np.nonzero(image)
        assert np.ptp(columns) - np.ptp(rows) == pytest.approx(2520 * DEG * 0.05, abs=1.5)
        middle = image.sum(axis=0) @ np.arange(659) / image.sum()
        expected = hole.cx_px + hole.focal_length_px * np.tan(DEG * (start_s + 0.025 - 0.2))
        assert middle == pytest.approx(expected, abs=0.15)


def test_objects_enter_and_leave_and_many_do_not_disturb_the_stars():
    crowd = changed(
        EMPTY,
        {"artefacts.moving_objects": 4000, "artefacts.false_brightest": 2.0, "artefacts.false_faintest": 2.5},
    )
    one, two = (take(build(crowd), turning(*HERCULES), t_s=T_S + t) for t in (0.0, 0.4))
    assert (one > 60).sum() > 20
    assert ((one > 60) & (two > 60)).sum() < 0.5 * (one > 60).sum()
    # the stars, their brightness and the bad pixels of a run are as without
    with_them, without = build(changed(PARAMS, {"artefacts.moving_objects": 50})), build(PARAMS)
    np.testing.assert_array_equal(with_them.sky.flux, without.sky.flux)
    np.testing.assert_array_equal(with_them.bad_pixels.hot, without.bad_pixels.hot)


def test_hot_pixels_trail_down_their_column():
    smeared = changed(
        EMPTY,
        {
            "artefacts.hot_pixels": 40,
            "artefacts.hot_pixel_weakest": 200000.0,
            "artefacts.hot_pixel_strongest": 200010.0,
            "artefacts.hot_pixel_smear": 0.3,
        },
    )
    device = build(smeared)
    short = CameraCommand(T_S, 0.01, 24.0)
    mean = np.mean([take(device, turning(200.0, 45.0), seed, short) for seed in range(60)], axis=0)
    level = np.median(mean)
    rows, columns = np.divmod(device.bad_pixels.hot, 659)
    kept = rows < 493 - 16
    behind = np.array(
        [mean[r + 1 : r + 16, c] - level for r, c in zip(rows[kept], columns[kept], strict=True)]
    )
    charge = behind.mean(axis=0) * PER_DN
    expected = 0.3 * 2e5 * 0.01 * np.exp(-np.arange(1, 16) / 3.0) / np.exp(-np.arange(1, 16) / 3.0).sum()
    sigma = 20.0 / np.sqrt(60 * kept.sum())
    assert np.abs(charge - expected).max() < 6.0 * sigma + 0.02 * expected.max()
    itself = (mean[rows, columns] - level).mean() * PER_DN
    assert itself == pytest.approx(0.7 * 2e5 * 0.01, rel=0.02)


def test_stray_light_is_brighter_on_the_side_of_the_sun():
    """Outside the exclusion angle: a plane whose slope is the gradient, its mean that of even stray light."""
    uneven = changed(EMPTY, {"stray_light.gradient": 0.5})
    trajectory = turning(218.0, 45.0)
    images = [
        np.mean([take(build(p), trajectory, seed) for seed in range(8)], axis=0) for p in (EMPTY, uneven)
    ]
    device = build(uneven)
    _, truth = camera.expose(device, COMMAND, trajectory, 0, T_S, np.random.default_rng(1))
    stray = (images[0].mean() - 16.0) - 20.0 / PER_DN  # DN
    assert stray > 5.0
    assert images[1].mean() == pytest.approx(images[0].mean(), abs=0.05)
    rows, columns = np.mgrid[:493, :659]
    design = np.column_stack([np.ones(rows.size), (columns - 329).ravel(), (rows - 246).ravel()])
    plane = np.linalg.lstsq(design, images[1].ravel(), rcond=None)[0]
    toward = dcm_from_quat(truth.q_ic).T @ device.bodies.sun_u_i
    slope = 0.5 * stray / (0.5 * np.hypot(493, 659)) * toward[:2] / np.hypot(*toward[:2])
    np.testing.assert_allclose(plane[1:], slope, atol=0.03 * np.hypot(*slope))
