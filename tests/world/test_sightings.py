"""Sightings: the drawn detections have the moments of the model, the variances those of an ideal detector."""

from types import SimpleNamespace

import numpy as np
import pytest
from camera_bench import CLEAN, T_S, build, turning
from scipy.stats import chi2, norm

from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import pinhole, pixels, unit_vectors
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.records import CameraCommand
from shefex_nav.world import camera
from shefex_nav.world.camera import sightings, undrawn

MODEL = sightings.SightingModel(
    detection=np.array([-0.1, 0.9, 0.5]),
    border_px=3.0,
    clutter=np.zeros(2),
    noise=np.array([1e-3, 1.5, 1.4, 0.02]),
    reported=np.array([2e-3, 1.2, 1.6, 0.03]),
    saturation_electrons=2500.0,
    mean_offset_dn=0.5,
)
HOLE = pinhole(659, 493, 24.95e-3 / 9.9e-6)
CAMERA = SimpleNamespace(pinhole=HOLE, settings=SimpleNamespace(detector=SimpleNamespace(bits=8)))
SEED_SIGMA = 5.5
CONFIDENCE = 1e-5  # of a false alarm, each test


def exposure(omega_c=(0.0, 0.0, 0.0), mean_dn=20.0):
    return undrawn.Exposure(0.8, 17.0, 0.05, np.array(omega_c), 7.4, mean_dn)


def scene(n, electrons, xy=(200.0, 300.0), hip=7):
    return np.full(n, hip, dtype=np.int64), np.tile(np.array(xy), (n, 1)), np.full(n, float(electrons))


def sight(film, stars, seed=0, most=10**6, model=MODEL):
    detection = SimpleNamespace(most_objects=most, saturation=255.0, seed_sigma=SEED_SIGMA)
    return sightings.sight(model, CAMERA, film, stars, np.random.default_rng(seed), detection)


def within(mean_square_ratio, n):
    """Whether a mean of n squares of standard normal numbers is what chance allows."""
    return chi2.ppf(CONFIDENCE / 2, n) / n < mean_square_ratio < chi2.ppf(1.0 - CONFIDENCE / 2, n) / n


@pytest.mark.parametrize("omega_c", [(0.0, 0.0, 0.0), (0.03, 0.01, 0.02), (0.0, -0.04, 0.0)])
def test_centroids_scatter_along_and_across_the_streak_as_the_model_says(omega_c):
    n, electrons, place = 20_000, 4000.0, np.array([600.0, 40.0])
    film = exposure(omega_c)
    seen = sight(film, scene(n, electrons, place))
    m = len(seen.hip)
    assert m > 0.99 * n
    error = seen.detections.xy_px - place
    # the streak from first principles: where the star goes while the camera turns by omega_c dt
    u_c = np.array([place[0] - HOLE.cx_px, place[1] - HOLE.cy_px, HOLE.focal_length_px])
    moved = u_c - np.cross(np.array(omega_c) * 1e-6, u_c)
    way = (HOLE.focal_length_px * (moved[:2] / moved[2] - u_c[:2] / u_c[2]) / 1e-6) * film.exposure_s
    length = np.hypot(*way)
    direction = way / length if length else np.array([1.0, 0.0])
    pixel, ratio2 = 1.0 / 12.0, (17.0 / electrons) ** 2
    w, s = np.sqrt(0.64 + length**2 / 12.0 + pixel), np.sqrt(0.64 + pixel)
    sharp = np.exp(-4.0 * np.pi**2 * (0.64 - 0.25))
    for axis, (own, other) in ((direction, (w, s)), (np.array([-direction[1], direction[0]]), (s, w))):
        parts = np.array([1.0, own**2 / electrons, 8.0 * np.pi * own**3 * other * ratio2, sharp])
        assert within(((error @ axis) ** 2).mean() / (MODEL.noise @ parts), m)
        np.testing.assert_allclose(axis @ seen.detections.P_px[0] @ axis, MODEL.reported @ parts, rtol=1e-6)
    a, b = error @ direction, error @ np.array([-direction[1], direction[0]])
    assert abs(np.corrcoef(a, b)[0, 1]) < 5.0 / np.sqrt(m)


def test_terms_are_the_bounds_of_a_spot_drawn_in_pixels():
    """Cramer-Rao bound of a Gaussian spot in noise, from the derivative of the picture itself."""
    along, across, electrons, noise = 1.7, 0.9, 900.0, 17.0
    wide, narrow = np.sqrt(along**2 + 1.0 / 12.0), np.sqrt(across**2 + 1.0 / 12.0)  # as pixels see it
    x, y = np.meshgrid(np.arange(-40, 41) * 0.25, np.arange(-40, 41) * 0.25)
    spot = np.exp(-0.5 * (x**2 / wide**2 + y**2 / narrow**2)) / (2.0 * np.pi * wide * narrow)
    slope = -x / wide**2 * spot
    background = (noise / electrons) ** 2 / (slope**2 * 0.25**2).sum()
    shot = 1.0 / electrons / (slope**2 / np.maximum(spot, 1e-300) * 0.25**2).sum()
    t_along, t_across = sightings.terms(along, across, electrons, noise)
    np.testing.assert_allclose(t_along[:3], (1.0, shot, background), rtol=1e-3)
    assert t_along[3] == t_across[3]
    assert sightings.terms(1.0, 0.5, electrons, noise)[0][3] == 1.0  # sharpness, defined at half a pixel
    # power of a Gaussian spot's spectrum at one cycle a pixel, by Fourier transform
    u = np.arange(-400, 401) * 0.01
    powers = []
    for sigma in (0.5, 0.6):
        profile = np.exp(-0.5 * (u / sigma) ** 2) / (np.sqrt(2.0 * np.pi) * sigma)
        powers.append(abs((profile * np.exp(-2j * np.pi * u)).sum() * 0.01) ** 2)
    lost = sightings.terms(1.0, 0.6, electrons, noise)[0][3]
    np.testing.assert_allclose(lost, powers[1] / powers[0], rtol=1e-4)


@pytest.mark.parametrize(("along", "across"), [(0.8, 0.8), (0.55, 0.55), (1.5, 0.7), (6.1, 0.9)])
def test_features_are_the_height_of_the_middle_block_above_the_threshold(along, across):
    """Light of a streak over 3x3 pixels, by summing it up point by point."""
    electrons, noise = 2000.0, 17.0
    length = np.sqrt(12.0 * (along**2 - across**2))
    way = (np.arange(4000) + 0.5) / 4000.0 * length - 0.5 * length
    step = 0.01
    x = np.arange(-150, 150) * step + 0.5 * step
    spot = np.exp(-0.5 * (x / across) ** 2) / (np.sqrt(2.0 * np.pi) * across)
    drawn = np.exp(-0.5 * ((x[:, None] - way[None, ::20]) / across) ** 2).mean(axis=1)
    drawn /= np.sqrt(2.0 * np.pi) * across
    block = electrons * spot.sum() * step * drawn.sum() * step
    z = (block - SEED_SIGMA * 3.0 * noise) / np.sqrt(9.0 * noise**2 + block)
    found = sightings.features(along, across, electrons, noise, SEED_SIGMA)
    places = (length / 13.0) ** 2 * np.exp(2.0 - 2.0 * length / 13.0)
    np.testing.assert_allclose(found, (1.0, z, places), rtol=1e-3, atol=1e-3)


def test_share_of_sources_found_follows_the_height_above_the_threshold():
    n, film = 5000, exposure()
    shares = []
    for electrons in (250.0, 380.0, 600.0):
        features = sightings.features(0.8, 0.8, electrons, 17.0, SEED_SIGMA)
        shares.append(norm.cdf(MODEL.detection @ features))
        found = len(sight(film, scene(n, electrons), seed=3).hip)
        assert abs(found - n * shares[-1]) < 4.5 * np.sqrt(n * shares[-1] * (1.0 - shares[-1])) + 1e-9
    assert shares[0] < 0.2 and shares[-1] > 0.9


def test_clutter_is_as_frequent_as_the_model_says_and_grows_with_the_streaks():
    """Numbers of Poisson; anywhere within the border, no star, not saturated, the first to be left out."""
    model, n = MODEL._replace(clutter=np.array([0.5, 2.0])), 3000
    nothing = scene(0, 0.0)
    slow, fast = exposure(), exposure((0.3, 0.0, 0.0))
    length_px = HOLE.focal_length_px * 0.3 * fast.exposure_s
    for film, mean in ((slow, 0.5), (fast, 0.5 + 2.0 * min(length_px / 20.0, 1.0) ** 2)):
        seen = [sight(film, nothing, seed=k, model=model) for k in range(n)]
        counts = np.array([len(one.hip) for one in seen])
        assert abs(counts.mean() - mean) < 4.5 * np.sqrt(mean / n)
        assert abs(counts.var() / mean - 1.0) < 4.5 * np.sqrt((2.0 + 1.0 / mean) / n)
        places = np.concatenate([one.detections.xy_px for one in seen])
        assert places.min() > 2.0 and (places < [656.0, 490.0]).all()
        assert not any(one.hip.any() or one.detections.n_saturated.any() for one in seen)
    many = model._replace(clutter=np.array([50.0, 0.0]))
    full = sight(slow, scene(30, 1e4), most=40, model=many)
    assert full.hip.tolist() == [7] * 30 + [0] * 10
    assert len(sight(exposure(mean_dn=255.0), nothing, model=many).hip) == 0


def test_nothing_at_the_border_nothing_in_white_frames_no_more_than_the_table_holds():
    film = exposure()
    assert len(sight(film, scene(50, 1e5, (2.4, 200.0))).hip) == 0
    assert len(sight(film, scene(50, 1e5, (2.6, 200.0))).hip) == 50
    assert len(sight(exposure(mean_dn=255.0), scene(50, 1e5)).hip) == 0
    hip, xy_px, electrons = scene(60, 1e4)
    electrons[:] = np.linspace(9e3, 3e4, 60)
    hip[:] = np.arange(60) + 1
    seen = sight(film, (hip, xy_px, electrons), most=40)
    assert seen.hip.tolist() == list(range(60, 20, -1))  # the brightest, brightest first
    saturated = electrons[::-1][:40] / (2.0 * np.pi * 0.64) > 2500.0
    np.testing.assert_array_equal(seen.detections.n_saturated > 1, saturated)
    assert seen.mean_dn == 20.5


def test_a_streak_over_the_border_is_not_found():
    """45 pixels along y: with its middle 22 pixels from the border it touches it, with 28 it does not."""
    film = exposure((0.36, 0.0, 0.0))
    length_px = HOLE.focal_length_px * 0.36 * film.exposure_s
    assert 44.0 < length_px < 46.0
    for y, found in ((length_px / 2.0 + 1.0, 0), (length_px / 2.0 + 5.0, 50)):
        assert len(sight(film, scene(50, 1e6, (329.0, y))).hip) == found
        assert len(sight(film, scene(50, 1e6, (329.0, 492.0 - y))).hip) == found
    assert len(sight(film, scene(50, 1e6, (6.0, 246.0))).hip) == 50  # along the border it does not matter


def accelerating(alpha, middle_s):
    """Trajectory that turns about the camera's x axis, alpha [rad/s^2]; middle_s after its start it rests."""
    still = turning(110.0, 50.0)
    t_s, about_b = still.t_s - still.t_s[0] - middle_s, CLEAN.mounting.C_bc @ np.array([1.0, 0.0, 0.0])
    turns = [rotation.quat_from_rotvec(0.5 * alpha * t**2 * about_b) for t in t_s]
    q_ib = [rotation.quat_multiply(q, turn) for q, turn in zip(still.q_ib, turns, strict=True)]
    return still._replace(q_ib=np.array(q_ib), omega_ib_b=alpha * t_s[:, None] * about_b)


def test_with_an_angular_acceleration_stars_stand_where_the_picture_has_the_middle_of_their_light():
    """Mean of 60 rendered frames, against the places of `look` and against those of the frame's instant."""
    alpha, exposure_s = 4.0, 0.05  # a T^2 / 24 is 1.05 pixels, the streak 3.2 long
    trajectory = accelerating(alpha, 0.1 + 0.5 * exposure_s)
    device, rng, given = build(CLEAN), np.random.default_rng(4), (trajectory, 0, T_S + 0.1)
    command = CameraCommand(T_S, exposure_s, 24.0)
    picture = np.mean([camera.expose(device, command, *given, rng)[0].image_dn for _ in range(60)], axis=0)
    _, truth, _, (hip, xy_px, electrons) = undrawn.look(device, command, *given)
    instant = dict(zip(truth.hip.tolist(), truth.xy_px, strict=True))
    around = np.arange(-7, 8)
    errors, shifts = [], []
    for k in np.flatnonzero((electrons > 1500.0) & (electrons < 15e3)):
        x, y = np.round(xy_px[k]).astype(int)
        beside = (np.abs(xy_px - xy_px[k]).max(axis=1) < 11.0) & (electrons > 0.02 * electrons[k])
        if beside.sum() > 1 or not (9 < x < 649 and 9 < y < 483):
            continue
        patch = picture[y - 7 : y + 8, x - 7 : x + 8] - np.median(picture)
        centre = np.array([x, y]) + (patch.sum(axis=0) @ around, patch.sum(axis=1) @ around) / patch.sum()
        errors.append(centre - xy_px[k])
        shifts.append(instant[int(hip[k])][1] - xy_px[k][1])
    assert len(errors) >= 3
    # an unweighted centroid over 225 pixels of noise 17 electrons: 0.1 pixels for the faintest of them
    assert np.abs(errors).max() < 0.35 and np.abs(np.mean(errors, axis=0)).max() < 0.1
    np.testing.assert_allclose(np.abs(shifts), alpha * exposure_s**2 / 24.0 * HOLE.focal_length_px, rtol=0.1)


def test_the_middle_of_the_light_is_that_of_all_instants():
    """Axes of any direction and an acceleration: 3001 instants; and the same arithmetic in arrays."""
    rng, exposure_s = np.random.default_rng(6), 0.05
    xy_px = rng.uniform(20.0, 470.0, (30, 2))
    C_ci = rotation.dcm_from_rotvec(rng.standard_normal(3))

    def path(alpha_c, omega_c, t_s):
        """C_ci at times from the middle, at which the rate is omega_c."""
        turns = np.multiply.outer(t_s, omega_c) + 0.5 * np.multiply.outer(t_s**2, alpha_c)
        return np.array([rotation.dcm_from_rotvec(turn).T @ C_ci for turn in turns])

    t_s = np.linspace(-0.5, 0.5, 3001) * exposure_s
    u_i = unit_vectors(HOLE, xy_px) @ C_ci
    for _ in range(5):
        alpha_c = 4.0 * rng.standard_normal(3)
        moves = path(alpha_c, np.zeros(3), t_s)
        mean_px = np.mean([pixels(HOLE, u_i @ C.T) for C in moves], axis=0)
        step = moves[[0, -1]] + moves.mean(axis=0) - 0.5 * (moves[0] + moves[-1])
        shift_px = undrawn._mean_places(HOLE, step, C_ci, xy_px) - xy_px
        assert np.linalg.norm(shift_px, axis=1).max() > 0.3
        np.testing.assert_allclose(shift_px, mean_px - xy_px, atol=2e-3)

        ends = path(alpha_c, np.radians(5.0) * rng.standard_normal(3), t_s[[0, -1]])
        D = 0.5 * (ends[0] + ends[1]) @ C_ci.T
        bend_c = 0.5 * np.array([D[1, 2] - D[2, 1], D[2, 0] - D[0, 2], D[0, 1] - D[1, 0]])
        expected = xy_px + turn_jacobians(HOLE, xy_px) @ bend_c
        np.testing.assert_allclose(undrawn._mean_places(HOLE, ends, C_ci, xy_px), expected, atol=1e-11)


def test_stars_that_the_catalogue_merges_are_one_source_at_their_centre_of_light():
    u_i = np.array([[1.0, 0.0, 0.0], [1.0, 1e-4, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 5e-5]])
    u_i /= np.linalg.norm(u_i, axis=1, keepdims=True)
    source = undrawn.sky.ordered(
        u_i, np.array([300.0, 100.0, 50.0, 80.0]), np.array([11, 12, 13, 0]), np.ones(4, dtype=bool)
    )
    stars = SimpleNamespace(hip=np.array([11, 99]), u_i=np.array([u_i[0], [0.0, 0.0, 1.0]]))
    camera = SimpleNamespace(sky=source, _replace=lambda sky: sky)
    merged = undrawn.catalogued(stars, camera, 2e-4)
    assert sorted(merged.hip.tolist()) == [0, 0, 11]  # the false object next to it stays by itself
    k = merged.hip.tolist().index(11)
    assert merged.flux[k] == 400.0
    np.testing.assert_allclose(merged.u_i[k][:2], [1.0, 0.25e-4], atol=1e-8)
