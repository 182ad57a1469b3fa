"""Sightings: the drawn detections have the moments of the model, the variances those of an ideal detector."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.world.camera import sightings

MODEL = sightings.SightingModel(
    detection=np.array([-6.0, 4.0, 2.0]),
    border_px=3.0,
    noise=np.array([1e-3, 1.5, 1.4]),
    reported=np.array([2e-3, 1.2, 1.6]),
    saturation_electrons=2500.0,
    mean_offset_dn=0.5,
)
HOLE = pinhole(659, 493, 24.95e-3 / 9.9e-6)
CAMERA = SimpleNamespace(pinhole=HOLE, params=SimpleNamespace(width_px=659, height_px=493, bits=8))
CONFIDENCE = 1e-5  # of a false alarm, each test


def exposure(omega_c=(0.0, 0.0, 0.0), mean_dn=20.0):
    return sightings.Exposure(0.8, 17.0, 0.05, np.array(omega_c), 7.4, mean_dn)


def scene(n, electrons, xy=(200.0, 300.0), hip=7):
    return np.full(n, hip, dtype=np.int64), np.tile(np.array(xy), (n, 1)), np.full(n, float(electrons))


def sight(film, stars, seed=0, most=10**6):
    rng = np.random.default_rng(seed)
    return sightings.sight(MODEL, CAMERA, film, stars, rng, most=most, full_dn=255)


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
    w, s, ratio2 = np.sqrt(0.64 + length**2 / 12.0), 0.8, (17.0 / electrons) ** 2
    for axis, (own, other) in ((direction, (w, s)), (np.array([-direction[1], direction[0]]), (s, w))):
        parts = np.array([1.0, own**2 / electrons, 8.0 * np.pi * own**3 * other * ratio2])
        assert within(((error @ axis) ** 2).mean() / (MODEL.noise @ parts), m)
        np.testing.assert_allclose(axis @ seen.detections.P_px[0] @ axis, MODEL.reported @ parts, rtol=1e-6)
    a, b = error @ direction, error @ np.array([-direction[1], direction[0]])
    assert abs(np.corrcoef(a, b)[0, 1]) < 5.0 / np.sqrt(m)


def test_terms_are_the_bounds_of_a_spot_drawn_in_pixels():
    """Cramer-Rao bound of a Gaussian spot in noise, from the derivative of the picture itself."""
    along, across, electrons, noise = 1.7, 0.9, 900.0, 17.0
    x, y = np.meshgrid(np.arange(-40, 41) * 0.25, np.arange(-40, 41) * 0.25)
    spot = np.exp(-0.5 * (x**2 / along**2 + y**2 / across**2)) / (2.0 * np.pi * along * across)
    slope = -x / along**2 * spot
    background = (noise / electrons) ** 2 / (slope**2 * 0.25**2).sum()
    shot = 1.0 / electrons / (slope**2 / np.maximum(spot, 1e-300) * 0.25**2).sum()
    t_along, _ = sightings.terms(along, across, electrons, noise)
    np.testing.assert_allclose(t_along, (1.0, shot, background), rtol=1e-3)


def test_share_of_sources_found_follows_the_contrast():
    n, film = 5000, exposure()
    for electrons in (250.0, 380.0, 600.0):
        q = electrons / (2.0 * np.pi * 0.64 * 17.0)
        share = 1.0 / (1.0 + np.exp(6.0 - 4.0 * np.log(q)))
        found = len(sight(film, scene(n, electrons), seed=3).hip)
        assert abs(found - n * share) < 4.5 * np.sqrt(n * share * (1.0 - share))


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


def test_stars_that_the_catalogue_merges_are_one_source_at_their_centre_of_light():
    u_i = np.array([[1.0, 0.0, 0.0], [1.0, 1e-4, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 5e-5]])
    u_i /= np.linalg.norm(u_i, axis=1, keepdims=True)
    source = sightings.sky.ordered(
        u_i, np.array([300.0, 100.0, 50.0, 80.0]), np.array([11, 12, 13, 0]), np.ones(4, dtype=bool)
    )
    stars = SimpleNamespace(hip=np.array([11, 99]), u_i=np.array([u_i[0], [0.0, 0.0, 1.0]]))
    camera = SimpleNamespace(sky=source, _replace=lambda sky: sky)
    merged = sightings.catalogued(stars, camera, 2e-4)
    assert sorted(merged.hip.tolist()) == [0, 0, 11]  # the false object next to it stays by itself
    k = merged.hip.tolist().index(11)
    assert merged.flux[k] == 400.0
    np.testing.assert_allclose(merged.u_i[k][:2], [1.0, 0.25e-4], atol=1e-8)
