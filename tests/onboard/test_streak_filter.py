"""The matched filter and the model against their definitions written out; the threshold against noise."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.special import erf
from scipy.stats import poisson
from streak_fields import DEG, IMPA, SHEFEX, dark, detect_params, digitise, frame, motion_of

from shefex_nav.geometry.pinhole import pinhole
from shefex_nav.geometry.shutter import row_start_s, row_times
from shefex_nav.geometry.streak import place_at
from shefex_nav.onboard.startracker import matched
from shefex_nav.onboard.startracker.background import bad_map
from shefex_nav.onboard.startracker.binned import BIN, in_noise, level_of
from shefex_nav.onboard.startracker.streak_light import PIXEL_VARIANCE, draw, first_of, light_at, memory_of
from shefex_nav.onboard.startracker.streak_path import NUMBERS, Turning, path_of
from shefex_nav.onboard.startracker.streaks import detect_streaks

NO_BAD = np.zeros((0, 2), dtype=np.int64)


@pytest.mark.parametrize("bits, level, noise", [(8, 40.3, 3.1), (12, 413.6, 5.8), (16, 30000.0, 500.0)])
def test_level_and_noise_of_a_frame(bits, level, noise):
    rng = np.random.default_rng(1)
    image = np.rint(level + noise * rng.standard_normal((301, 403)))
    image = image.astype(np.uint8 if bits == 8 else np.uint16)
    sums, seen, mean_dn = level_of(image, bad_map(*image.shape, NO_BAD), 96)
    assert sums.shape == (150, 201)
    np.testing.assert_array_equal(sums[3, 7], image[6:8, 14:16].astype(int).sum())
    assert mean_dn == pytest.approx(image[:300, :402].mean())
    # one tile: 1.25 sigma / sqrt(2304 bins) of half the noise of a pixel each
    np.testing.assert_allclose(seen.background, level, atol=5.0 * 1.25 * noise / 2.0 / 48.0)
    np.testing.assert_allclose(seen.noise, np.hypot(noise, 12**-0.5), rtol=0.12)


def test_known_bad_pixels_do_not_count():
    rng = np.random.default_rng(2)
    clean = np.rint(400.0 + 6.0 * rng.standard_normal((200, 200))).astype(np.uint16)
    bad = rng.integers(0, 200, (50, 2))
    bad = np.vstack([bad, [[10, 10], [10, 11], [11, 10], [11, 11]]])  # a whole bin
    dirty = clean.copy()
    dirty[bad[:, 0], bad[:, 1]] = 4095
    sums, _, _ = level_of(dirty, bad_map(200, 200, bad), 96)
    assert np.abs(sums - 1600.0).max() < 12.0 * 6.0 * 2.0


def test_sums_are_what_they_say():
    """Slow reference: each row of the streak interpolated between two bins, three lines weighted."""
    rng = np.random.default_rng(3)
    pad, n, slope, middle, first, u0, across = 40, 9, 0.37, 31.5, 20, 5, 0.4
    bins = rng.standard_normal((64 + 2 * pad, 64 + 2 * pad)).astype(np.float32)
    values = np.empty((12, 30), dtype=np.float32)
    matched._sums(bins, pad, matched.Lines(slope, middle, first, n, u0), np.float32(across), values)

    def line(image, k, u):
        rows = np.arange(first + k, first + k + n)
        columns = u + slope * (rows - middle) + pad
        return sum(
            np.interp(c, np.arange(image.shape[1]), image[r + pad])
            for r, c in zip(rows, columns, strict=True)
        )

    def response(image, k, u):
        return line(image, k, u) + across * (line(image, k, u - 1) + line(image, k, u + 1))

    for k, i in [(0, 1), (5, 14), (11, 28)]:
        # white noise: the variance is the sum of the squares of the weights, found bin by bin
        variance = 0.0
        for r in range(first + k, first + k + n):
            base = int(np.floor(u0 + i + slope * (r - middle)))
            for c in range(base - 2, base + 4):
                unit = np.zeros_like(bins)
                unit[r + pad, c + pad] = 1.0
                variance += response(unit, k, u0 + i) ** 2
        assert values[k, i] == pytest.approx(response(bins, k, u0 + i) / np.sqrt(variance), abs=2e-4)


def test_streaks_are_found_where_they_are_in_every_direction():
    rng = np.random.default_rng(4)
    for angle in np.arange(0.0, 360.0, 30.0) * DEG:
        motion = motion_of(SHEFEX, np.array([np.cos(angle), np.sin(angle), 0.0]) * 5.0 * DEG)
        places = rng.uniform([40.0, 40.0], [619.0, 453.0], (12, 2))
        image = frame(SHEFEX, motion, places, 1500.0, rng)
        sums, level, _ = level_of(image, bad_map(*image.shape, NO_BAD), 96)
        turning = Turning(SHEFEX.camera, motion.omega_c, motion.P_omega_c, motion.times)
        grid = matched.grid_of(sums.shape, matched.looks(turning, 0.8), 0.8)
        found, noise = matched.candidates(in_noise(sums, level, 20.0, grid.pad), grid, turning, 0.8, 4.0)
        assert noise == pytest.approx(1.0, abs=0.06)
        distance = np.linalg.norm(found[:, None, 1:3] - places[None], axis=2)
        assert (distance.min(axis=0) < 2.0 * BIN).all()


def test_curvature_of_the_autocorrelation():
    """Against the autocorrelation of the sampled profile; a point and a long box are the limits."""
    x = np.arange(-200.0, 200.0, 0.05)
    for length, sigma in [(0.3, 1.0), (5.0, 0.8), (50.0, 1.1)]:
        spot = np.exp(-0.5 * (x / sigma) ** 2)
        profile = np.convolve(spot, np.abs(x) <= 0.5 * length, mode="same")
        slope = np.gradient(profile, x)
        along, across = matched.curvature(length, sigma)
        assert along == pytest.approx((slope**2).sum() / (profile**2).sum(), rel=0.02)
        assert across == pytest.approx(0.5 / sigma**2)


@pytest.mark.parametrize("sigma, most", [(1.0, 0.002), (0.6, 0.007)])
@pytest.mark.parametrize(
    "omega_c, line_s", [((0.0, 0.0, 0.0), 0.0), ((0.046, 0.019, 0.02), 0.0), ((0.046, 0.019, 0.02), 1e-3)]
)
def test_the_model_is_the_integral_over_the_pixels(sigma, most, omega_c, line_s):
    """Of a spot that moves in 1000 steps over the rows that are open then; most: part of the peak."""
    rng = np.random.default_rng(7)
    camera, times, omega_c = pinhole(64, 64, 2000.0), row_times(0.2, line_s, 64), np.array(omega_c)
    turning, path, pixel = Turning(camera, omega_c, np.zeros((3, 3)), times), np.empty(NUMBERS), np.arange(64)
    start, edges = row_start_s(times, pixel), np.linspace(-0.1 - 32.0 * line_s, 0.1 + 32.0 * line_s, 1001)
    for x, y in 31.5 + rng.uniform(-0.5, 0.5, (3, 2)):
        expected = np.zeros((64, 64))
        for begin, end in pairwise(edges):
            place = np.array(place_at(camera, omega_c, x, y, 0.5 * (begin + end)))
            below = 0.5 * erf((np.arange(65) - 0.5 - place[:, None]) / (np.sqrt(2.0) * sigma))
            across, down = np.diff(below)
            open_s = np.minimum(end, start + times.exposure_s) - np.maximum(begin, start)
            expected += np.outer(down * np.maximum(open_s, 0.0), across) / times.exposure_s
        assert path_of(turning, x, y, path)
        s = np.sqrt(sigma**2 + PIXEL_VARIANCE)
        drawn = np.array([[light_at(path, s, float(c), float(r))[0] for c in pixel] for r in pixel])
        assert np.abs(drawn - expected).max() < most * expected.max()
        assert drawn.sum() == pytest.approx(expected.sum(), rel=2e-3)


@pytest.mark.parametrize("omega_c, line_s", [((0.0, 0.0, 0.0), 0.0), ((0.046, 0.019, 0.02), 1e-3)])
def test_the_model_of_all_pixels_is_that_of_each(omega_c, line_s):
    """`draw` against `light_at`: the table is good to h^2 / 8 = 7.6e-6 of the peak, the series to 1e-6.

    Their derivatives share this, and have an end's table to look up as well.
    """
    s, path = np.sqrt(0.9**2 + PIXEL_VARIANCE), np.empty(NUMBERS)
    turning = Turning(
        pinhole(64, 64, 2000.0), np.array(omega_c), np.zeros((3, 3)), row_times(0.2, line_s, 64)
    )
    assert path_of(turning, 31.7, 32.2, path)
    pixels = first_of(memory_of(64 * 64), 64 * 64)
    pixels.x[:], pixels.y[:] = np.tile(np.arange(64.0), 64), np.repeat(np.arange(64.0), 64)
    draw(path, s, pixels)
    each = np.array([light_at(path, s, x, y) for x, y in zip(pixels.x, pixels.y, strict=True)])
    drawn = np.column_stack([pixels.model, pixels.d_along, pixels.d_across, pixels.time])
    for column, expected in zip(drawn.T, each.T, strict=True):
        np.testing.assert_allclose(column, expected, rtol=0.0, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize("bench, rate, frames", [(SHEFEX, 0.0, 30), (SHEFEX, 4.0, 30), (IMPA, 5.0, 10)])
def test_as_many_false_objects_as_wanted(bench, rate, frames):
    """Frames of pure noise: the count is Poisson's with the wanted number, known to 40 per cent [E]."""
    rng = np.random.default_rng(5)
    wanted, count = 3.0, 0
    params = detect_params(bench, most_objects=300)
    for k in range(frames):
        direction = rng.normal(size=3)
        omega_c = rate * DEG * direction / np.linalg.norm(direction)
        image = digitise(bench, dark(bench), rng)
        found, _ = detect_streaks(params, bench.model, image, motion_of(bench, omega_c, k % 2 == 1), wanted)
        count += len(found.flux_dn)
    low, high = poisson.ppf([0.001, 0.999], np.array([0.6, 1.5]) * wanted * frames)
    assert low <= count <= high


def test_the_threshold_solves_its_equation():
    for wanted in (0.1, 1.0, 10.0):
        k = matched.threshold(0.004, 1e6, wanted)
        assert 1e6 * 0.004 * k * np.exp(-0.5 * k * k) == pytest.approx(wanted, rel=1e-6)
