"""The world through a lens with distortion: what is imaged goes through it, what hits the chip does not."""

import numpy as np
import pytest
from camera_bench import CLEAN, DEG, PARAMS, T_S, build, sky, turning
from scipy.special import erf

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.geometry.shutter import duration_s, row_times
from shefex_nav.records import CameraCommand
from shefex_nav.settings import changed
from shefex_nav.world import camera
from shefex_nav.world.camera import moon, motion, optics, render, undrawn

K = (-0.7, 2.0, 1.5e-3, -0.8e-3, 0.0)  # up to 8 px
COMMAND = CameraCommand(T_S, 0.05, 24.0)
HERCULES = (110.0, 50.0)
HOLE = Pinhole(659, 493, 2520.2, 333.1, 240.7)


def formula(k, x, y):
    """Distorted x, y of X/Z, Y/Z, as textbooks write it."""
    k1, k2, p1, p2, k3 = k
    r2 = x**2 + y**2
    grown = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    return x * grown + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * grown + p1 * (
        r2 + 2 * y**2
    ) + 2 * p2 * x * y


def shown(hole, k, u_c):
    """Pixels of directions (n, 3), NaN behind the camera."""
    z = np.where(u_c[:, 2] > 0.3, u_c[:, 2], np.nan)
    x, y = formula(k, u_c[:, 0] / z, u_c[:, 1] / z)
    return np.column_stack([hole.cx_px + hole.focal_length_px * x, hole.cy_px + hole.focal_length_px * y])


def on_detector(device, k, trajectory, q_ic):
    """Numbers (n,) and places (n, 2) of all stars to V 5.5 that the formula puts on the detector."""
    catalogue, v_i = sky()[0], device.bodies.earth_v_i + trajectory.v_i[0]
    seen_i = aberrate(catalogue.u_i, v_i)
    xy_px = shown(device.pinhole, k, seen_i @ rotation.dcm_from_quat(q_ic))
    with np.errstate(invalid="ignore"):
        on = ((xy_px >= -0.5) & (xy_px <= [658.5, 492.5])).all(axis=1) & (catalogue.vmag <= 5.5)
    return catalogue.hip[on], xy_px[on]


def bent(params, k=K):
    return changed(params, {"optics.distortion": k})


def take(device, trajectory, seed=9):
    return camera.expose(device, COMMAND, trajectory, 7, T_S, np.random.default_rng(seed))


def test_listed_stars_are_those_and_where_the_formula_puts_them():
    """Also those that the lens alone brings onto the detector, and without those that it takes away."""
    device, plain, trajectory = build(bent(CLEAN)), build(CLEAN), turning(*HERCULES)
    _, truth = take(device, trajectory)
    _, other = take(plain, trajectory)
    hip, xy_px = on_detector(device, K, trajectory, truth.q_ic)
    assert sorted(truth.hip) == sorted(hip)
    place = dict(zip(hip, xy_px, strict=True))
    np.testing.assert_allclose(truth.xy_px, [place[one] for one in truth.hip], atol=2e-3)
    shared = np.intersect1d(truth.hip, other.hip)
    moved = [np.hypot(*(truth.xy_px[truth.hip == h] - other.xy_px[other.hip == h])[0]) for h in shared]
    assert max(moved) > 2.0


def test_light_is_where_the_truth_says():
    """The centre of the light of bright lone stars, without noise of the sky, beside their true places."""
    device = build(bent(changed(CLEAN, {"detector.background": 0.0, "detector.read_noise": 1e-3})))
    frame, truth = take(device, turning(*HERCULES))
    image = frame.image_dn.astype(float) - CLEAN.detector.black_level
    found = 0
    for x, y in truth.xy_px:
        column, row = round(x), round(y)
        apart = np.hypot(*(truth.xy_px - [x, y]).T)
        if not (6 < column < 652 and 6 < row < 486) or np.sort(apart)[1] < 15.0:
            continue
        patch = image[row - 5 : row + 6, column - 5 : column + 6]
        if patch.sum() < 400.0 or patch.max() > 230.0:
            continue
        at = (patch.sum(axis=0) @ np.arange(-5, 6), patch.sum(axis=1) @ np.arange(-5, 6)) / patch.sum()
        assert np.hypot(column + at[0] - x, row + at[1] - y) < 0.25
        found += 1
    assert found >= 3


@pytest.mark.parametrize("line_s", [0.0, 60e-6])
def test_streaks_are_sums_of_spots_where_the_lens_puts_them(line_s):
    """A star near a corner, the camera turns: against 4000 spots, each on the rows that are open then."""
    lens, times = optics.lens_of(HOLE, K), row_times(0.02, line_s, HOLE.height_px)
    psf, C_ic, omega_c = render.gaussian_psf(0.8), np.eye(3), np.array([0.05, -0.03, 0.4])
    step_px = optics.step_px(HOLE, lens, psf.step_px)
    path = motion.turning(HOLE, C_ic, omega_c, times, step_px)
    u_i = np.array([[0.10, -0.075, 1.0]])
    u_i /= np.linalg.norm(u_i)
    light = render.darkness(HOLE.width_px * HOLE.height_px)
    tracks = optics.tracks(HOLE, lens, path, u_i)
    assert np.hypot(*np.diff(tracks[0], axis=0).T).max() <= psf.step_px
    render.add_tracks(light, HOLE, psf, path, tracks, np.array([1e4]), 1e-3)
    drawn = light.electrons.reshape(HOLE.height_px, HOLE.width_px)
    slow, n = np.zeros_like(drawn, dtype=float), 4000
    begin_s = path.begin_s
    for t_s in begin_s + duration_s(times) * (np.arange(n) + 0.5) / n:
        C = rotation.dcm_from_rotvec(t_s * omega_c)
        (x, y) = shown(HOLE, K, u_i @ C)[0]
        low_x, low_y = int(x) - 7, int(y) - 7
        ends_x, ends_y = np.arange(low_x, low_x + 16) - 0.5 - x, np.arange(low_y, low_y + 16) - 0.5 - y
        by_x, by_y = (np.diff(0.5 * erf(ends / (0.8 * np.sqrt(2.0)))) for ends in (ends_x, ends_y))
        rows = np.arange(low_y, low_y + 15)
        starts_s = begin_s + line_s * rows
        opened = (t_s >= starts_s) & (t_s < starts_s + 0.02)
        electrons = 1e4 * duration_s(times) / n / 0.02
        slow[low_y : low_y + 15, low_x : low_x + 15] += electrons * np.outer(by_y * opened, by_x)
    assert abs(drawn - slow).max() < 0.01 * slow.max()
    assert drawn.sum() == pytest.approx(slow.sum(), rel=2e-3)


def test_the_moon_is_moved_and_keeps_its_light():
    lens, u_i = optics.lens_of(HOLE, K), np.array([0.09, 0.06, 1.0])
    u_i /= np.linalg.norm(u_i)
    path, sun_i = motion.at_rest(np.eye(3)), np.array([0.0, 0.0, -1.0])
    pictures = []
    for one in (None, lens):
        light = render.darkness(HOLE.width_px * HOLE.height_px)
        moon.add_moon(light, HOLE, path, u_i, 0.26 * DEG, sun_i, 1e6, one)
        pictures.append(light.electrons.reshape(493, 659).astype(float))
    (plain, moved), (rows, columns) = pictures, np.mgrid[0:493, 0:659]
    centres = [np.array([(p * columns).sum(), (p * rows).sum()]) / p.sum() for p in pictures]
    np.testing.assert_allclose(centres[0], shown(HOLE, (0.0,) * 5, u_i[None])[0], atol=0.05)
    np.testing.assert_allclose(centres[1], shown(HOLE, K, u_i[None])[0], atol=0.05)
    assert np.hypot(*(centres[1] - centres[0])) > 2.0
    assert moved.sum() == pytest.approx(plain.sum(), rel=0.01)


def test_what_is_not_imaged_stays_where_it_is():
    """Spots that sit still, hits, hot pixels and their columns: the same picture with and without a lens."""
    dirty = changed(
        PARAMS,
        {
            "stars.faintest": -5.0, "artefacts.false_objects": 0, "artefacts.spikes_per_frame": 8.0,
            "artefacts.upsets_per_frame": 20.0, "artefacts.trails_per_frame": 3.0,
            "artefacts.hot_pixel_smear": 0.2,
        },
    )  # fmt: skip
    trajectory = turning(*HERCULES)
    frames = [take(build(one), trajectory)[0].image_dn for one in (dirty, bent(dirty))]
    assert (frames[0] > 60).sum() > 20
    np.testing.assert_array_equal(*frames)


def test_a_distortion_of_zero_is_the_pinhole_to_the_bit():
    trajectory = turning(*HERCULES, np.array([1.0, 0.5, 2.0]) * DEG)
    device = build(bent(PARAMS, (0.0,) * 5))
    assert device.lens is None
    (plain, listed), (frame, truth) = take(build(PARAMS), trajectory), take(device, trajectory)
    np.testing.assert_array_equal(plain.image_dn, frame.image_dn)
    np.testing.assert_array_equal(listed.xy_px, truth.xy_px)


def test_sightings_are_those_of_the_rendered_truth():
    """Of the statistical star tracker: the same stars at the same places as the list of the picture."""
    device, trajectory = build(bent(CLEAN)), turning(*HERCULES)
    _, drawn = take(device, trajectory)
    _, truth, _, (hip, *_) = undrawn.look(device, COMMAND, trajectory, 7, T_S)
    order, other = np.argsort(drawn.hip), np.argsort(truth.hip)
    np.testing.assert_array_equal(drawn.hip[order], truth.hip[other])
    np.testing.assert_allclose(drawn.xy_px[order], truth.xy_px[other], atol=1e-6)
    both = np.intersect1d(hip[hip > 0], drawn.hip)
    assert len(both) == len(drawn.hip)


def test_a_principal_point_moves_the_sky_and_the_cone():
    """Far off the middle the opposite corner is seen too: more angle than half the diagonal."""
    device = build(
        changed(CLEAN, {"optics.principal_point": (20.0, 30.0), "optics.principal_point_error": 0.0})
    )
    assert (device.pinhole.cx_px, device.pinhole.cy_px) == (20.0, 30.0)
    farthest = np.arctan(np.hypot(658.5 - 20.0, 492.5 - 30.0) / device.pinhole.focal_length_px)
    assert device.corner == pytest.approx(farthest)
    trajectory = turning(*HERCULES)
    _, truth = take(device, trajectory)
    _, seen, _, _ = undrawn.look(device, COMMAND, trajectory, 7, T_S)
    hip, xy_px = on_detector(device, (0.0,) * 5, trajectory, truth.q_ic)
    assert sorted(truth.hip) == sorted(seen.hip) == sorted(hip)
    assert np.hypot(*(xy_px - (20.0, 30.0)).T).max() > 411.0  # half the diagonal


def test_nothing_is_imaged_beyond_a_fold():
    """r (1 + k1 r^2) has its largest value at r = 1 / sqrt(-3 k1): what lies beyond would come back."""
    k1 = -5.0
    lens = optics.lens_of(HOLE, (k1, 0.0, 0.0, 0.0, 0.0))
    turn = 1.0 / np.sqrt(-3.0 * k1)
    assert 0.98 * turn < lens.reach <= turn
    beyond = np.array([[HOLE.cx_px + 1.6 * turn * HOLE.focal_length_px, HOLE.cy_px]])
    assert np.isnan(optics.places(HOLE, lens, beyond)).all()
