"""Spots narrower than a pixel: where they are and how well that is known, at any place within the pixel."""

from dataclasses import replace

import numpy as np
import pytest
from star_fields import DETECT, MODEL, digitise, signal, spot

from shefex_nav.onboard.startracker import scan, shape
from shefex_nav.onboard.startracker import spot as star_light
from shefex_nav.onboard.startracker.background import block_sums, tile_statistics
from shefex_nav.onboard.startracker.objects import detect, rules

PER_DN = 7.4  # electrons, as `digitise` has it
SETTINGS = replace(DETECT, most_objects=200)
KNOWN = MODEL._replace(electrons_per_dn=PER_DN, psf_sigma=0.8)
WIDTHS = [0.45, 0.5, 0.55, 0.6, 0.7, 0.9]


def frame(rng, vmag, sigma_px, columns, streak_px=0.0, angle=0.0):
    """(image, places (n, 2)) of stars 40 px apart, anywhere within their pixels."""
    rows = -(-len(vmag) // columns)
    light = np.zeros((40 * rows + 40, 40 * columns + 40))
    k = np.arange(len(vmag))
    true_px = 40.0 * np.column_stack([k % columns + 1, k // columns + 1]) + rng.uniform(
        -0.5, 0.5, (len(k), 2)
    )
    for (x, y), v in zip(true_px, vmag, strict=True):
        spot(light, x, y, signal(v), sigma_px, streak_px, angle)
    return digitise(rng, light), true_px


def found(image, true_px, camera=KNOWN):
    """Errors (n, 2), normalised squared errors (n,), whether saturated (n,); every star is found."""
    seen, _ = detect(SETTINGS, camera, image)
    distance = np.linalg.norm(seen.xy_px[:, None] - true_px[None], axis=2)
    assert (distance.min(axis=0) < 1.0).all()
    k = distance.argmin(axis=0)
    error = seen.xy_px[k] - true_px
    nees = np.einsum("ki,kij,kj->k", error, np.linalg.inv(seen.P_px[k]), error)
    return error, nees, seen.n_saturated[k] > 0


def picture_of(image):
    """Picture without bad pixels."""
    return star_light.Picture(image, KNOWN.bad_pixels, 255, 1.0 / PER_DN)


def table_of(image):
    """Objects of a frame."""
    blocks = block_sums(image)
    background, sigma, _ = tile_statistics(blocks, 72)
    return scan.sequential(image, blocks, background, sigma, rules(SETTINGS))


@pytest.mark.parametrize("sigma_px", WIDTHS)
def test_errors_are_those_that_are_reported(sigma_px):
    """Bright, saturated and faint; an error that repeats with the pixels is less than a tenth of a sigma."""
    rng = np.random.default_rng([1, int(100 * sigma_px)])
    vmag = np.tile([1.5, 2.5, 4.0, 4.5, 5.0], 32)
    errors, nees, phase = [], [], []
    for _ in range(4):
        image, true_px = frame(rng, rng.permutation(vmag), sigma_px, 16)
        error, squared, _ = found(image, true_px)
        errors.append(error)
        nees.append(squared)
        phase.append(true_px - np.rint(true_px))
    nees, error, phase = np.concatenate(nees), np.concatenate(errors).ravel(), np.concatenate(phase).ravel()
    assert abs(nees.mean() - 2.0) < 4.0 * 2.0 / np.sqrt(len(nees))  # chi-square of two degrees: sigma 2
    repeating = np.sin(2.0 * np.pi * phase)
    swing = error @ repeating / (repeating @ repeating)
    assert abs(swing) < 4.0 * error.std() / np.sqrt(repeating @ repeating)


@pytest.mark.parametrize("sigma_px", [0.45, 0.6, 0.9])
@pytest.mark.parametrize("streak_px", [0.0, 1.5])
def test_the_shape_and_its_covariance(sigma_px, streak_px):
    """Covariance of the spot against the truth: sigma^2 and, of a streak, L^2/12 along it."""
    rng = np.random.default_rng([2, int(100 * sigma_px)])
    squared, n = [], 40
    for _ in range(n):
        angle = rng.uniform(0.0, np.pi)
        image, _ = frame(rng, [3.9, 4.2, 4.5, 4.8, 5.0, 5.0], sigma_px, 3, streak_px, angle)
        seen, P_S = shape.measure(picture_of(image), table_of(image), 0.8)
        along, streak = np.array([np.cos(angle), np.sin(angle)]), np.array([seen.streak_x, seen.streak_y])
        off = np.eye(2) * (seen.sigma_px**2 - sigma_px**2)
        off += (np.outer(streak, streak) - streak_px**2 * np.outer(along, along)) / 12.0
        d = off[[0, 0, 1], [0, 1, 1]]
        squared.append(d @ np.linalg.solve(P_S, d))
    # chi-square of three degrees of freedom: sigma sqrt(6)
    assert abs(np.mean(squared) - 3.0) < 4.0 * np.sqrt(6.0 / n)


def off_the_truth(seen, sigma_px, streak_px, angle):
    """Covariance of a spot less the true one: xx, xy, yy [px^2]."""
    along, streak = np.array([np.cos(angle), np.sin(angle)]), np.array([seen.streak_x, seen.streak_y])
    off = np.eye(2) * (seen.sigma_px**2 - sigma_px**2)
    off += (np.outer(streak, streak) - streak_px**2 * np.outer(along, along)) / 12.0
    return off[[0, 0, 1], [0, 1, 1]]


@pytest.mark.parametrize("sigma_px", [0.55, 0.8])
@pytest.mark.parametrize("streak_px", [3.0, 5.5, 10.0])
def test_the_shape_of_streaks_and_where_they_lie(sigma_px, streak_px):
    """Shape and places against the truth, and each of them against the covariance that is reported."""
    rng = np.random.default_rng([6, int(100 * sigma_px), int(10 * streak_px)])
    vmag = np.array([3.9, 4.2, 4.5, 4.8, 5.0, 5.0]) - 2.5 * np.log10(max(streak_px / 5.0, 1.0))
    squared, length, nees, n = [], [], [], 25
    for _ in range(n):
        angle = rng.uniform(0.0, np.pi)
        image, true_px = frame(rng, vmag, sigma_px, 3, streak_px, angle)
        seen, P_S = shape.measure(picture_of(image), table_of(image), 0.8)
        d = off_the_truth(seen, sigma_px, streak_px, angle)
        squared.append(d @ np.linalg.solve(P_S, d))
        length.append(np.hypot(seen.streak_x, seen.streak_y))
        nees.append(found(image, true_px)[1])
    nees = np.concatenate(nees)
    # four standard deviations of the mean of chi-squares of three and of two degrees of freedom
    assert abs(np.mean(squared) - 3.0) < 4.0 * np.sqrt(6.0 / n)
    assert abs(nees.mean() - 2.0) < 4.0 * 2.0 / np.sqrt(len(nees))
    # the model's row of spots with the variance of an even line is up to 0.09 px shorter where it fits best
    assert np.mean(length) == pytest.approx(streak_px, rel=0.03)


@pytest.mark.parametrize("streak_px", [0.0, 3.0, 10.0])
def test_a_shape_that_cannot_be_fitted_is_doubted(streak_px):
    """All pixels are bad to the fit: the moments of the scan are left, no better known than they are."""
    rng = np.random.default_rng([7, int(10 * streak_px)])
    squared = []
    for _ in range(20):
        angle = rng.uniform(0.0, np.pi)
        image, _ = frame(rng, [2.9, 3.2, 3.5, 3.8, 4.0, 4.0], 0.7, 3, streak_px, angle)
        bad = np.argwhere(image < 256)
        seen, P_S = shape.measure(picture_of(image)._replace(bad_pixels=bad), table_of(image), 0.8)
        d = off_the_truth(seen, 0.7, streak_px, angle)
        squared.append(d @ np.linalg.solve(P_S, d))
    assert np.mean(squared) < 3.0


def test_a_width_that_is_hardly_known_is_doubted():
    """Two faint stars tell the width; the slopes of a saturated one depend on it more than on the noise."""
    rng = np.random.default_rng(3)
    nees = []
    for _ in range(120):
        _, squared, saturated = found(*frame(rng, [1.0, 5.0, 5.2], 0.5, 2))
        assert saturated[0] and not saturated[1:].any()
        nees.append(squared[0])
    assert abs(np.mean(nees) - 2.0) < 4.0 * 2.0 / np.sqrt(len(nees))


@pytest.mark.parametrize("sigma_px", [0.5, 0.8])
def test_a_bad_pixel_in_a_star_says_nothing(sigma_px):
    """Each star has a dead or a hot pixel, which the tracker knows, within a pixel of its own."""
    rng = np.random.default_rng([5, int(100 * sigma_px)])
    nees = []
    for _ in range(6):
        image, true_px = frame(rng, np.tile([2.5, 4.0, 4.5, 5.0], 20), sigma_px, 10)
        bad = np.rint(true_px).astype(np.int64)[:, ::-1] + rng.integers(-1, 2, (80, 2))
        image[tuple(bad.T)] = rng.choice([0, 255], 80)
        nees.append(found(image, true_px, KNOWN._replace(bad_pixels=bad))[1])
    nees = np.concatenate(nees)
    assert abs(nees.mean() - 2.0) < 4.0 * 2.0 / np.sqrt(len(nees))


def test_a_double_star_does_not_tell_the_width():
    """The brightest clear object is two stars 1 px apart; the others are as narrow as before."""
    rng = np.random.default_rng(4)
    widths = []
    for _ in range(20):
        light = np.zeros((200, 200))
        for k in range(8):
            x, y = 40.0 + 40.0 * (k % 3) + rng.uniform(), 40.0 + 40.0 * (k // 3) + rng.uniform()
            spot(light, x, y, signal(4.4), 0.5)
        x, y = 120.0 + rng.uniform(), 120.0 + rng.uniform()
        spot(light, x, y, signal(4.4), 0.5)
        spot(light, x + 1.0, y, signal(4.6), 0.5)
        image = digitise(rng, light)
        widths.append(shape.measure(picture_of(image), table_of(image), 0.8)[0])
    assert np.mean([w.sigma_px for w in widths]) == pytest.approx(0.5, abs=0.02)
    assert np.median([np.hypot(w.streak_x, w.streak_y) for w in widths]) < 0.6


def test_how_light_changes_with_the_shape():
    """The derivatives against differences of spots drawn elsewhere (erf of each pixel's edges)."""
    x, y, sigma, window = 20.3, 18.8, 0.5, (14, 12, 13, 14)
    work, step = np.empty(star_light.WORK), 1e-3
    star_light.curves(star_light.spots_of(star_light.Shape(sigma, 0.0, 0.0)), x, y, window, work)
    left, top, width, height = window

    def drawn(great, small, angle):
        """A spot of these variances along and across: two points at the root of their difference."""
        image, d = np.zeros((40, 40)), np.sqrt(great - small)
        for side in (-d, d):
            spot(image, x + side * np.cos(angle), y + side * np.sin(angle), 0.5, np.sqrt(small))
        return image[top : top + height, left : left + width]

    still = drawn(sigma**2, sigma**2, 0.0)
    of_xx = (drawn(sigma**2 + step, sigma**2, 0.0) - still) / step
    of_yy = (drawn(sigma**2 + step, sigma**2, np.pi / 2) - still) / step
    # along the diagonal S grows by step / 2 in xx, yy and xy; against it xy shrinks
    of_xy = (
        drawn(sigma**2 + step, sigma**2, np.pi / 4) - drawn(sigma**2 + step, sigma**2, -np.pi / 4)
    ) / step
    for layer, expected in (
        (star_light.TO_XX, of_xx),
        (star_light.TO_XY, of_xy),
        (star_light.TO_YY, of_yy),
    ):
        seen = work[layer, :height, :width]
        np.testing.assert_allclose(seen, expected, atol=0.01 * np.abs(expected).max())


@pytest.mark.parametrize("length", [0.3, 2.0, 9.0])
def test_how_the_light_of_a_streak_changes_with_its_shape(length):
    """The derivatives against differences of the model, of streaks in all directions."""
    x, y, sigma, window, step = 20.3, 18.8, 0.6, (8, 7, 25, 24), 1e-3
    work = np.empty(star_light.WORK)

    def drawn(S):
        star_light.model(star_light.spots_of(shape._shape(S)), x, y, window, work)
        return work[star_light.SPOT, : window[3], : window[2]].copy()

    for angle in np.radians([0.0, 20.0, 45.0, 90.0, 130.0]):
        S = shape._symmetric(sigma**2 + length**2 / 12.0, sigma**2, angle)
        star_light.curves(star_light.spots_of(shape._shape(S)), x, y, window, work)
        layers = (star_light.TO_XX, star_light.TO_XY, star_light.TO_YY)
        seen = [work[k, : window[3], : window[2]].copy() for k in layers]
        for k in range(3):
            d = step * np.eye(3)[k]
            expected = (drawn(S + d) - drawn(S - d)) / (2.0 * step)
            np.testing.assert_allclose(seen[k], expected, atol=0.02 * np.abs(expected).max())
