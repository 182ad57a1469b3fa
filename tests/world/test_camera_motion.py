"""The camera in motion: rows that are exposed in their own time, against a plain sum over instants."""

import numpy as np
import pytest
from camera_bench import CLEAN, DEG, T_S, build, turning
from scipy.special import ndtr

from shefex_nav.geometry import pinhole, rotation, streak
from shefex_nav.geometry.shutter import duration_s, instant_after_s, row_start_s, row_times
from shefex_nav.papers.stills import StillCamera, still
from shefex_nav.records import CameraCommand
from shefex_nav.settings import changed
from shefex_nav.world import camera
from shefex_nav.world.camera import camera as stages
from shefex_nav.world.camera import motion, render
from shefex_nav.world.camera import shutter as shutters
from shefex_nav.world.camera.detector import Electronics

HOLE = pinhole.pinhole(96, 128, 2889.0)
SIGMA, ELECTRONS = 1.1, 1e5
PSF = render.gaussian_psf(SIGMA)
PLACES = np.array([[48.3, 64.7], [22.2, 95.9], [70.0, 30.4]])
EXPOSURE_S = 0.05
GLOBAL = row_times(EXPOSURE_S, 0.0, HOLE.height_px)
ROLLING = row_times(EXPOSURE_S, EXPOSURE_S / HOLE.height_px, HOLE.height_px)
SLOW_ROWS = row_times(EXPOSURE_S / 10, EXPOSURE_S / HOLE.height_px, HOLE.height_px)  # a slit runs over it
RATES = {  # deg/s about x, y, z
    "along the columns": (5.0, 0.0, 0.0),
    "against the rows": (-5.0, 0.0, 0.0),
    "along the rows": (0.0, 5.0, 0.0),
    "oblique, about the boresight": (6.0, -7.0, 60.0),
    "about the boresight": (0.0, 0.0, 40.0),
    "slow": (0.1, 0.15, 0.3),
}


def summed(times, omega_c, places, electrons, n=3000):
    """Electrons of stars as a sum over n instants of still pictures, each in the rows open then."""
    columns, rows = np.arange(HOLE.width_px), np.arange(HOLE.height_px)
    u_c = pinhole.unit_vectors(HOLE, places)
    starts_s = row_start_s(times, rows)
    image = np.zeros((HOLE.height_px, HOLE.width_px))
    step_s = duration_s(times) / n
    for k in range(n):
        t_s = (k + 0.5) * step_s - instant_after_s(times)
        open_s = np.minimum(t_s + 0.5 * step_s, starts_s + times.exposure_s) - np.maximum(
            t_s - 0.5 * step_s, starts_s
        )
        xy_px = pinhole.pixels(HOLE, u_c @ rotation.dcm_from_rotvec(omega_c * t_s))
        for x, y in xy_px:
            along_x = ndtr((columns + 0.5 - x) / SIGMA) - ndtr((columns - 0.5 - x) / SIGMA)
            along_y = ndtr((rows + 0.5 - y) / SIGMA) - ndtr((rows - 0.5 - y) / SIGMA)
            image += np.outer(along_y * np.maximum(open_s, 0.0), along_x)
    return electrons / times.exposure_s * image


def rendered(times, omega_c, places, electrons, least=1e-3):
    light = render.darkness(HOLE.width_px * HOLE.height_px)
    path = motion.turning(HOLE, np.eye(3), omega_c, times, PSF.step_px)
    u_c = pinhole.unit_vectors(HOLE, places)
    render.add_points(light, HOLE, PSF, path, u_c, np.full(len(places), electrons), least)
    return light.electrons.reshape(HOLE.height_px, HOLE.width_px).astype(float)


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("times", [GLOBAL, ROLLING, SLOW_ROWS], ids=["global", "rolling", "slit"])
def test_rows_collect_light_while_they_are_open(times, rate):
    omega_c = np.array(RATES[rate]) * DEG
    expected = summed(times, omega_c, PLACES, ELECTRONS)
    image = rendered(times, omega_c, PLACES, ELECTRONS)
    tolerance = 3e-3 if times.line_s == 0.0 or times is ROLLING else 1e-2
    assert np.abs(image - expected).max() < tolerance * expected.max()
    assert image.sum() == pytest.approx(expected.sum(), rel=3e-4)


@pytest.mark.parametrize("rate", RATES)
def test_light_of_a_star_is_its_flux_for_the_time_that_it_is_seen(rate):
    omega_c = np.array(RATES[rate]) * DEG
    for times in (GLOBAL, ROLLING, SLOW_ROWS):
        place = PLACES[:1]
        begin_s, end_s = streak.seen_from_to(HOLE, times, omega_c, *place[0])
        expected = ELECTRONS * (end_s - begin_s) / times.exposure_s
        assert rendered(times, omega_c, place, ELECTRONS).sum() == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_length_of_a_streak_along_the_columns(sign):
    """IMPA equations (8)-(11): a star runs dk = T / (T_row - t_l) rows with the shutter, fewer against it.

    The length of a uniform streak is sqrt(12) times the deviation of its light, without that of the spot and
    the pixel, which the shutter stretches by 1 / (1 - t_l / T_row).
    """
    omega_c = np.array([sign * 6.0 * DEG, 0.0, 0.0])
    image = rendered(ROLLING, omega_c, PLACES[:1], ELECTRONS)
    rows = np.arange(HOLE.height_px)
    profile = image.sum(axis=1) / image.sum()
    _, speed = streak.velocity(HOLE, omega_c, *PLACES[0])
    row_s = 1.0 / abs(speed)  # T_row: for one row of its way
    stretch = 1.0 / (1.0 - sign * ROLLING.line_s / row_s)
    variance = profile @ rows**2 - (profile @ rows) ** 2 - (SIGMA**2 + 1.0 / 12.0) * stretch**2
    expected = EXPOSURE_S / (row_s - sign * ROLLING.line_s)
    assert np.sqrt(12.0 * variance) == pytest.approx(expected, rel=1e-3)


def test_a_star_crosses_its_place_at_the_instant_wherever_it_is():
    """Middle of the light in the rows: the place at the time at which its row is half exposed."""
    omega_c = np.array([0.0, 6.0, 0.0]) * DEG
    for place in PLACES:
        image = rendered(ROLLING, omega_c, place[None], ELECTRONS)
        middle_x = (image.sum(axis=0) / image.sum()) @ np.arange(HOLE.width_px)
        t_s = row_start_s(ROLLING, place[1]) + 0.5 * EXPOSURE_S
        expected, _ = streak.place_at(HOLE, omega_c, *place, t_s)
        assert middle_x == pytest.approx(expected, abs=5e-3)
        assert abs(middle_x - place[0]) > 0.5 or abs(t_s) < 0.01


def test_tracks_are_points_whose_places_are_given():
    omega_c = np.array(RATES["oblique, about the boresight"]) * DEG
    path = motion.turning(HOLE, np.eye(3), omega_c, ROLLING, PSF.step_px)
    u_c = pinhole.unit_vectors(HOLE, PLACES)
    xy_px = np.stack([pinhole.pixels(HOLE, u_c @ C_ci.T) for C_ci in path.C_ci], axis=1)
    light = render.darkness(HOLE.width_px * HOLE.height_px)
    render.add_tracks(light, HOLE, PSF, path, xy_px, np.full(3, ELECTRONS), 1e-3)
    expected = rendered(ROLLING, omega_c, PLACES, ELECTRONS).ravel()
    np.testing.assert_allclose(light.electrons, expected, atol=0.01)


# --- whole frames ---

LINE_S = 0.05 / 493
COMMAND = CameraCommand(T_S, 0.05, 24.0)
HERCULES = (110.0, 50.0)


def test_times_of_a_rolling_frame():
    device = build(changed(CLEAN, {"detector.shutter": "rolling", "detector.line_time": LINE_S}))
    frame, truth = camera.expose(device, COMMAND, turning(*HERCULES), 3, T_S, np.random.default_rng(1))
    assert frame.line_s == LINE_S
    assert frame.t_valid_s == truth.t_valid_s == pytest.approx(T_S + 0.025 + 246 * LINE_S)
    assert frame.t_available_s == pytest.approx(T_S + 0.05 + 492 * LINE_S + CLEAN.detector.readout)


@pytest.mark.parametrize("line_s", [0.0, LINE_S])
def test_frames_follow_the_attitude_as_it_was(line_s, monkeypatch):
    """A rate that changes: the light's centre against the mean place while the row of the star is open."""
    device = build(
        changed(CLEAN, {"detector.shutter": "rolling", "detector.line_time": line_s, "stars.faintest": 5.0})
    )
    trajectory, kept = accelerated(), {}

    def read_out(device, background, slope, command, rng):
        kept["light"] = device.light.electrons.reshape(493, 659).astype(float)
        return np.zeros((493, 659), np.uint8)

    monkeypatch.setattr(stages, "_read_out", read_out)
    monkeypatch.setattr(stages, "FAINT", 1e-3)
    frame, truth = camera.expose(device, COMMAND, trajectory, 0, T_S, np.random.default_rng(4))
    hole, times = device.pinhole, row_times(0.05, line_s, 493)
    n = 20_000
    t_s = frame.t_start_s + (np.arange(n) + 0.5) / n * duration_s(times)
    C_ci = np.empty((n, 3, 3))
    motion.attitudes_at(trajectory.q_ib, device.q_bc, (t_s - T_S) * 400.0, C_ci)
    u_i = pinhole.unit_vectors(hole, truth.xy_px) @ rotation.dcm_from_quat(truth.q_ic).T
    tested = 0
    for star, place in enumerate(truth.xy_px):
        path = pinhole.pixels(hole, np.einsum("kij,j->ki", C_ci, u_i[star]))
        starts_s = row_start_s(times, path[:, 1]) + frame.t_valid_s
        seen = path[(t_s >= starts_s) & (t_s < starts_s + 0.05)]
        middle = seen.mean(axis=0)
        left, top = (middle - 20).astype(int)
        others = np.delete(truth.xy_px, star, axis=0)
        alone = np.hypot(*(others - place).T).min() > 70.0
        if alone and left >= 0 and top >= 0 and left < 659 - 41 and top < 493 - 41:
            patch = kept["light"][top : top + 41, left : left + 41]
            x = left + patch.sum(axis=0) @ np.arange(41) / patch.sum()
            y = top + patch.sum(axis=1) @ np.arange(41) / patch.sum()
            assert (x, y) == pytest.approx(tuple(middle), abs=0.01)
            assert np.ptp(seen, axis=0).max() > 3.0
            tested += 1
    assert tested >= 2


def accelerated():
    """A trajectory whose rate changes from 10 deg/s by 10 in the frame."""
    trajectory = turning(*HERCULES)
    q, omega_b = [trajectory.q_ib[0]], trajectory.omega_ib_b.copy()
    for k in range(1, len(trajectory.t_s)):
        middle_s = trajectory.t_s[k] - T_S - 0.00125
        rate_c = np.array([8.0, 6.0, 0.0]) * DEG * (1.0 - 20.0 * middle_s)
        omega_b[k] = CLEAN.mounting.C_bc @ rate_c
        q.append(rotation.quat_multiply(q[-1], rotation.quat_from_rotvec(omega_b[k] / 400.0)))
    return trajectory._replace(q_ib=np.array(q), omega_ib_b=omega_b)


@pytest.mark.parametrize("step_px", [1e3, 3.0, 1.0, 0.3])  # of 15 px: 1, 9, 26 and 87 steps
def test_steps_have_the_mean_of_a_path_whose_rate_changes(step_px):
    """Mean of alpha t^2 / 2 over T: alpha T^2 / 24. The chord of one step has three times as much."""
    device, trajectory = build(CLEAN), accelerated()
    times = row_times(0.05, 0.0, 493)
    move = motion.during(device.pinhole, trajectory, device.q_bc, T_S + 0.025, times, step_px)
    change = -20.0 * np.array([8.0, 6.0, 0.0]) * DEG  # rad/s^2, in camera axes
    q_ic = [rotation.quat_from_dcm(np.ascontiguousarray(C.T)) for C in (move.C_ci, *move.path.C_ci)]
    turns = [rotation.rotvec_between(q_ic[0], q) for q in q_ic[1:]]
    weight = np.ones(len(turns))
    weight[[0, -1]] = 0.5
    np.testing.assert_allclose(
        np.average(turns, axis=0, weights=weight), change * 0.05**2 / 24.0, rtol=0.01, atol=1e-7
    )


@pytest.mark.parametrize("line_s", [0.0, LINE_S])
def test_rates_in_a_frame_are_those_of_its_samples(line_s):
    """Mean and greatest rate, and steps as short as the fastest of them wants, in array expressions."""
    device, trajectory, rng = build(CLEAN), turning(*HERCULES), np.random.default_rng(7)
    trajectory = trajectory._replace(omega_ib_b=rng.normal(0.0, 20.0 * DEG, trajectory.omega_ib_b.shape))
    times, t_valid_s, step_px = row_times(0.05, line_s, 493), T_S + 0.1517, 0.3
    q_bc = rotation.quat_from_rotvec(rng.standard_normal(3))
    found = motion.during(device.pinhole, trajectory, q_bc, t_valid_s, times, step_px)
    begin_s = t_valid_s - T_S - instant_after_s(times)
    first, last = int(400.0 * begin_s), int(np.ceil(400.0 * (begin_s + duration_s(times))))
    omega_b = trajectory.omega_ib_b[first : last + 1]
    C_bc = rotation.dcm_from_quat(q_bc)
    assert found.rate == pytest.approx(np.linalg.norm(omega_b, axis=1).max(), rel=1e-14)
    np.testing.assert_allclose(found.omega_ib_i, found.C_ci.T @ C_bc.T @ omega_b.mean(axis=0), rtol=1e-12)
    speed = max(motion.fastest(device.pinhole, omega_c) for omega_c in omega_b @ C_bc)
    assert len(found.path.C_ci) - 1 == np.ceil(speed * duration_s(times) / step_px)


def test_rolling_exposures_end_with_the_last_row():
    device = build(changed(CLEAN, {"detector.shutter": "rolling", "detector.line_time": LINE_S}))
    with pytest.raises(ValueError, match="outside the trajectory"):
        camera.expose(device, COMMAND, turning(*HERCULES), 0, T_S + 0.42, np.random.default_rng(1))
    camera.expose(device, COMMAND, turning(*HERCULES), 0, T_S + 0.40, np.random.default_rng(1))


def test_rolling_frames_overlap_and_come_in_their_order():
    """Every 60 ms a frame of which the last row closes after 100 ms; none that the trajectory would cut."""
    device = build(changed(CLEAN, {"detector.shutter": "rolling", "detector.line_time": LINE_S}))
    trajectory = turning(*HERCULES)
    shutter = shutters.Shutter(device, trajectory, every=6, last_s=1e9, rng=np.random.default_rng(1))
    arrived = []
    for n in range(50):
        now_s = T_S + 0.01 * n
        arrived += [(now_s, frame) for frame, _ in shutter.arrived(now_s)]
        shutter.tick(n, now_s, [COMMAND] if n == 0 else [])
    starts = [frame.t_start_s - T_S for _, frame in arrived]
    np.testing.assert_allclose(starts, 0.06 * np.arange(len(starts)), atol=1e-9)
    assert len(starts) == 7  # at 0.42 s there are only 80 ms left
    for now_s, frame in arrived:
        assert 0.0 <= now_s - frame.t_available_s + 1e-6 < 0.01


# --- stills ---

TRACKER = StillCamera(
    pinhole.pinhole(256, 256, 2889.0),
    SIGMA,
    Electronics(50.0, 65e3, 16.0, 32.0, 12),
    6100.0,
    1.46e6,
    row_times(0.2, 0.2 / 1024, 256),
)


def test_stills_at_rest_turning_and_without_times():
    u_i = np.array([[0.0, 0.0, 1.0], [0.01, -0.02, 1.0], [0.0, 0.0, -1.0]])
    u_i /= np.linalg.norm(u_i, axis=1, keepdims=True)
    light, q_ic = np.full(3, 3e5), np.array([1.0, 0.0, 0.0, 0.0])
    resting, xy_px = still(TRACKER, u_i, light, q_ic, np.random.default_rng(1))
    assert resting.dtype == np.uint16
    assert np.isnan(xy_px[2]).all()
    assert resting.max() > 2000
    omega_c = np.array([2.0, -3.0, 1.0]) * DEG
    moving, places = still(TRACKER, u_i, light, q_ic, np.random.default_rng(1), omega_c=omega_c)
    np.testing.assert_array_equal(places, xy_px)
    begin_s, end_s = streak.seen_from_to(TRACKER.pinhole, TRACKER.times, omega_c, *xy_px[0])
    level = 6100.0 / 16.0 + 32.0
    # both stars: the light of the two, with the noise of 2 x 256^2 pixels
    total = (moving - level).sum() * 16.0 / 3e5
    seen = [
        np.subtract(*streak.seen_from_to(TRACKER.pinhole, TRACKER.times, omega_c, *p)[::-1]) / 0.2
        for p in xy_px[:2]
    ]
    assert total == pytest.approx(sum(seen), abs=4.0 * 256 * 93.0 / 3e5 + 0.02)
    assert (end_s - begin_s) / 0.2 == pytest.approx(seen[0])
    with pytest.raises(ValueError, match="times"):
        still(TRACKER._replace(times=None), u_i, light, q_ic, np.random.default_rng(1), omega_c=omega_c)
