"""Detection: statistics, objects and centroids against frames whose content is known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage
from star_fields import DETECT, MODEL, digitise, signal, spot

from shefex_nav.onboard.startracker.background import block_sums, repair, tile_statistics
from shefex_nav.onboard.startracker.objects import detect

SHAPE = (493, 659)


def test_block_sums_are_a_3x3_convolution():
    image = np.random.default_rng(1).integers(0, 256, SHAPE).astype(np.uint8)
    expected = ndimage.convolve(image.astype(np.int64), np.ones((3, 3), dtype=np.int64))
    expected[[0, -1]] = 0
    expected[:, [0, -1]] = 0
    np.testing.assert_array_equal(block_sums(image), expected)


def test_statistics_of_a_frame_with_stars_and_a_gradient():
    rng = np.random.default_rng(2)
    light = np.zeros(SHAPE) + np.linspace(0.0, 60.0, SHAPE[1])  # electrons: stray light
    for x, y in rng.uniform([20, 20], [640, 470], (60, 2)):
        spot(light, x, y, signal(2.0))
    image = digitise(rng, light)
    background, sigma, mean_dn = tile_statistics(block_sums(image), 72)
    whole_blocks = image[:492, :657]
    assert mean_dn == pytest.approx(whole_blocks.mean(), abs=0.02)
    # noise of one block of 9 pixels: shot noise of 60 + 30 electrons on average, read noise 16, quantisation
    per_pixel = np.hypot(np.sqrt(60.0 + 30.0 + 16.0**2) / 7.4, np.sqrt(1 / 12))
    assert np.median(sigma) == pytest.approx(3.0 * per_pixel, rel=0.05)
    columns = (np.arange(9) * 72 + 36) * 60.0 / SHAPE[1]
    expected = 9.0 * ((columns + 60.0) / 7.4 + 10.0)
    np.testing.assert_allclose(np.median(background, axis=0)[:9], expected, atol=1.5)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("mean", [-0.5, 0.0, 0.7, 1.5, 2.5, 4.0])  # sigma above the cut
def test_noise_that_is_cut_off_at_grey_value_zero_is_told_whole(bits, mean):
    """By quantiles alone it was half as large with a mean of 0: covariances of centroids 0.6 of the right."""
    per_pixel, kind = (2.2, np.uint8) if bits == 8 else (40.0, np.uint16)
    values = per_pixel * (mean + np.random.default_rng(3).standard_normal(SHAPE))
    image = np.clip(np.rint(values), 0, 2**bits - 1).astype(kind)
    _, sigma, _ = tile_statistics(block_sums(image), 72)
    assert np.median(sigma) == pytest.approx(3.0 * np.hypot(per_pixel, np.sqrt(1 / 12)), rel=0.06)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_straylight_across_a_dark_tile_is_no_noise_that_is_cut_off(kind):
    """It spreads as widely over its median; taken for half of a noise it was told twice as large."""
    rng = np.random.default_rng(5)
    values = 20.0 + np.linspace(0.0, 150.0, 144) + 2.0 * rng.standard_normal((144, 144))
    blocks = block_sums(np.rint(values).astype(kind))
    background, sigma, _ = tile_statistics(blocks, 144)
    inside = blocks[1:143:3, 1:143:3].astype(float)
    spread = np.quantile(inside, 0.5) - np.quantile(inside, 0.158655)
    assert background[0, 0] / 9.0 < 3.0 * spread / 3.0  # where noise would be cut off
    assert sigma[0, 0] == pytest.approx(spread, rel=0.01)


def test_a_star_on_a_sky_that_is_cut_off_has_the_error_that_its_covariance_says():
    rng, squares = np.random.default_rng(4), []
    camera = MODEL._replace(electrons_per_dn=7.4)
    for _ in range(12):
        light = np.zeros(SHAPE)
        places = np.column_stack([rng.uniform(20, 640, 30), np.linspace(20, 470, 30)])
        for x, y in places:
            spot(light, x, y, signal(rng.uniform(1.0, 4.0)))
        electrons = rng.poisson(light) + 16.0 * rng.standard_normal(SHAPE)  # the black level is 0
        image = np.clip(np.rint(electrons / 7.4), 0, 255).astype(np.uint8)
        found, _ = detect(DETECT, camera, image)
        for xy_px, P_px in zip(found.xy_px, found.P_px, strict=True):
            d = places[np.argmin(((places - xy_px) ** 2).sum(axis=1))] - xy_px
            if np.hypot(*d) < 1.5:
                squares.append(d @ np.linalg.solve(P_px, d))
    assert len(squares) > 250
    assert 0.8 < np.mean(squares) / 2.0 < 1.2  # 1.5 by quantiles alone


def test_a_frame_of_16_bits_gives_what_its_8_bits_give():
    """Grey values that fit into both types: the same statistics and the same objects."""
    rng = np.random.default_rng(8)
    light = np.zeros(SHAPE)
    for x, y in rng.uniform([20, 20], [640, 470], (30, 2)):
        spot(light, x, y, signal(3.5))
    image = digitise(rng, light)
    narrow, narrow_statistics = detect(DETECT, MODEL, image)
    wide, wide_statistics = detect(DETECT, MODEL, image.astype(np.uint16))
    np.testing.assert_allclose(wide_statistics, narrow_statistics, rtol=1e-12)
    for a, b in zip(wide, narrow, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


def test_a_bright_frame_of_16_bits():
    """Beyond the 255 grey values and 2295 block sums of 8 bits: level, noise, flux and place."""
    rng = np.random.default_rng(9)
    light = np.zeros(SHAPE)
    for x, y in [(100.2, 50.7), (400.0, 300.4)]:
        spot(light, x, y, 4e5)
    image = np.minimum(rng.poisson(light + 2500.0) * 10 + 5000, 65535).astype(np.uint16)
    found, statistics = detect(replace(DETECT, saturation=65535.0), MODEL, image)
    assert statistics.background_dn == pytest.approx(30000.0, rel=1e-3)
    assert statistics.noise_dn == pytest.approx(500.0, rel=0.02)
    np.testing.assert_array_equal(found.n_saturated[:2] > 0, True)
    place = found.xy_px[:2][np.argsort(found.xy_px[:2, 0])]
    np.testing.assert_allclose(place, [(100.2, 50.7), (400.0, 300.4)], atol=0.1)


@pytest.mark.parametrize("image", [np.zeros(SHAPE), np.zeros((4, 5, 3), np.uint8)])
def test_other_frames_are_refused(image):
    with pytest.raises(ValueError, match="uint8 or uint16"):
        detect(DETECT, MODEL, image)


def test_objects_of_a_dark_frame():
    """Every block of a noise frame is a trial of a 5.5 sigma threshold: almost none may be an object."""
    rng = np.random.default_rng(3)
    count = sum(len(detect(DETECT, MODEL, digitise(rng, np.zeros(SHAPE)))[0].flux_dn) for _ in range(20))
    assert count <= 8  # measured: 0.07 a frame; Poisson 1.4, 8 has a probability of 1e-4


@pytest.mark.parametrize(
    "sigma_px, streak_px, vmag, limit_px",
    [
        (0.6, 0.0, 5.5, 0.12),
        (0.8, 0.0, 5.5, 0.15),
        (0.8, 0.0, 4.5, 0.06),
        (0.8, 0.0, 3.0, 0.03),
        (0.8, 4.4, 4.5, 0.12),  # 2 deg/s for 50 ms
        (0.8, 4.4, 3.0, 0.05),
    ],
)
def test_centroids(sigma_px, streak_px, vmag, limit_px):
    """RMS error per axis over 96 stars at random phases of the pixel grid, and no bias."""
    rng = np.random.default_rng(4)
    light = np.zeros(SHAPE)
    xx, yy = np.meshgrid(np.arange(12) * 52 + 40, np.arange(8) * 56 + 40)
    true_px = np.column_stack([xx.ravel(), yy.ravel()]) + rng.uniform(-3.0, 3.0, (96, 2))
    for x, y in true_px:
        spot(light, x, y, signal(vmag), sigma_px, streak_px, rng.uniform(0.0, np.pi))
    found, _ = detect(replace(DETECT, most_objects=200), MODEL, digitise(rng, light))
    distance = np.linalg.norm(found.xy_px[:, None] - true_px[None], axis=2)
    assert (distance.min(axis=0) < 1.5).all()  # every star, and a streak is one object:
    assert len(found.flux_dn) <= 98
    error = found.xy_px[distance.argmin(axis=0)] - true_px
    assert np.sqrt((error**2).mean()) < limit_px
    assert (np.abs(error.mean(axis=0)) < 3.5 * limit_px / np.sqrt(96)).all()


@pytest.mark.parametrize("sigma_px, electrons", [(0.8, 300.0), (0.8, 450.0), (1.1, 500.0), (1.5, 700.0)])
def test_weighted_centroids_of_faint_stars_are_no_better_than_their_light(sigma_px, electrons):
    """Six to eight times the noise. By the pixels above the threshold alone NEES was 1.6 to 3.3 of 1."""
    rng, squares = np.random.default_rng(8), []
    settings = replace(DETECT, scan="sequential", centroid="weighted", most_objects=200)
    camera = MODEL._replace(electrons_per_dn=7.4, psf_sigma=sigma_px)
    x, y = np.meshgrid(np.arange(12) * 50 + 45, np.arange(9) * 50 + 40)
    for _ in range(5):
        places = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-0.5, 0.5, (108, 2))
        light = np.zeros(SHAPE)
        for place in places:
            spot(light, *place, electrons, sigma_px)
        found, _ = detect(settings, camera, digitise(rng, light))
        for xy_px, P_px in zip(found.xy_px, found.P_px, strict=True):
            d = places[np.argmin(((places - xy_px) ** 2).sum(axis=1))] - xy_px
            if np.hypot(*d) < 2.0:
                squares.append(d @ np.linalg.solve(P_px, d))
    assert len(squares) > 100
    assert 0.4 < np.mean(squares) / 2.0 < 1.25


def test_table_is_sorted_and_keeps_the_brightest():
    rng = np.random.default_rng(5)
    light = np.zeros(SHAPE)
    vmag = rng.permutation(np.linspace(1.0, 4.5, 24))
    xx, yy = np.meshgrid(np.arange(6) * 100 + 60, np.arange(4) * 110 + 60)
    for m, x, y in zip(vmag, xx.ravel(), yy.ravel(), strict=True):
        spot(light, x, y, signal(m))
    image = digitise(rng, light)
    found, _ = detect(replace(DETECT, most_objects=10), MODEL, image)
    assert len(found.flux_dn) == 10
    assert (np.diff(found.flux_dn) <= 0.0).all()
    brightest = np.column_stack([xx.ravel(), yy.ravel()])[np.argsort(vmag)[:10]]
    distance = np.linalg.norm(found.xy_px[:, None] - brightest[None], axis=2)
    assert (distance.min(axis=0) < 0.3).all()
    boxes = [image[int(y) - 6 : int(y) + 7, int(x) - 6 : int(x) + 7] for x, y in np.rint(found.xy_px)]
    np.testing.assert_array_equal(found.n_saturated, [(box == 255).sum() for box in boxes])
    assert found.n_saturated[0] > 1  # V = 1 at 24 dB


def test_known_bad_pixels_are_taken_out():
    rng = np.random.default_rng(6)
    image = digitise(rng, np.zeros(SHAPE))
    bad = rng.integers([1, 1], [492, 658], (40, 2)).astype(np.int64)
    bad = np.vstack([bad, bad[0] + [0, 1], [0, 0]])  # neighbours of each other, and a corner
    image[bad[:, 0], bad[:, 1]] = 255
    repaired = np.empty_like(image)
    repair(image, bad, repaired)
    assert repaired[bad[:, 0], bad[:, 1]].max() < 40
    untouched = np.ones(SHAPE, dtype=bool)
    untouched[bad[:, 0], bad[:, 1]] = False
    np.testing.assert_array_equal(repaired[untouched], image[untouched])
    assert len(detect(DETECT, MODEL._replace(bad_pixels=bad), image)[0].flux_dn) <= 1


def test_what_is_no_star_is_left_out():
    rng = np.random.default_rng(7)
    light = np.zeros(SHAPE)
    light[100, 100] += 3000.0  # a hot pixel nobody knew of
    spot(light, 300.0, 2.0, signal(2.0))  # cut off by the border
    yy, xx = np.mgrid[: SHAPE[0], : SHAPE[1]]
    light[(xx - 450) ** 2 + (yy - 250) ** 2 < 18**2] += 2000.0  # the Moon is 27 px across
    spot(light, 200.0, 300.0, signal(2.0))
    found, _ = detect(DETECT, MODEL, digitise(rng, light))
    strong = found.flux_dn > 200.0
    np.testing.assert_allclose(found.xy_px[strong], [[200.0, 300.0]], atol=0.1)
