"""The adjustment of attitude, focal length and distortion, and the price of it."""

import numpy as np
import pytest

from shefex_nav.geometry import distortion
from shefex_nav.geometry.pinhole import turn_slopes
from shefex_nav.geometry.rotation import dcm_from_rotvec, quat_from_dcm, rotvec_from_quat
from shefex_nav.solve import lens, naming, proof, steps

SIZE = (1024, 768)


def scene(rng, n, k1=0.0, noise_px=0.0):
    """A lens, stars in its view, and where they are detected."""
    true = lens.Lens(dcm_from_rotvec(rng.normal(size=3)), 2000.0, (k1, 0.0, 0.0, 0.0, 0.0))
    xy = rng.uniform([-0.24, -0.18], [0.24, 0.18], (n, 2))
    u_c = np.column_stack([xy, np.ones(n)])
    u_i = u_c / np.linalg.norm(u_c, axis=1, keepdims=True) @ true.C_ci
    seen = lens.project(true, u_i, SIZE)[0]
    return true, u_i, seen + rng.normal(0.0, noise_px, seen.shape)


@pytest.mark.parametrize("k1", [0.0, -0.2, 0.15])
def test_without_noise_the_truth_comes_back(k1):
    rng = np.random.default_rng(1)
    for _ in range(5):
        true, u_i, xy_px = scene(rng, 25, k1)
        near = lens.Lens(dcm_from_rotvec(1e-3 * rng.normal(size=3)) @ true.C_ci, 2008.0)
        found = lens.fit(near, u_i, xy_px, SIZE)
        np.testing.assert_array_equal(found.star, np.arange(25))
        assert abs(found.lens.focal_px / 2000.0 - 1.0) < 1e-4
        # what the prior takes of 25 per cent of a corner is a hundredth of a pixel
        assert np.abs(lens.project(found.lens, u_i, SIZE)[0] - xy_px).max() < 0.05
        assert np.linalg.norm(rotvec_from_quat(quat_from_dcm(found.lens.C_ci @ true.C_ci.T))) < 1e-5


def test_errors_are_what_the_covariance_says():
    """Normalised errors of focal length and noise over 60 fields: unit variance within 3 sigma of chi^2."""
    rng = np.random.default_rng(2)
    normalised, noise = [], []
    for _ in range(60):
        true, u_i, xy_px = scene(rng, 30, noise_px=0.3)
        found = lens.fit(true, u_i, xy_px, SIZE, may_distort=False)
        normalised.append(np.log(found.lens.focal_px / 2000.0) / np.sqrt(found.covariance[3, 3]))
        noise.append(found.noise_px)
    assert abs(np.mean(np.square(normalised)) - 1.0) < 3.0 * np.sqrt(2.0 / 60)
    assert abs(np.mean(noise) - 0.3) < 0.03


def test_too_few_stars_fit_nothing():
    true, u_i, xy_px = scene(np.random.default_rng(3), 3)
    assert lens.fit(true, u_i, xy_px, SIZE) is None
    assert lens.fit(true, u_i, np.zeros((0, 2)), SIZE) is None


def test_what_was_adjusted_has_its_price():
    """The range of focal lengths and the lenses tried count linearly; what may bend costs, too."""
    rng = np.random.default_rng(4)
    true, u_i, xy_px = scene(rng, 30, noise_px=0.3)
    plain = lens.fit(true, u_i, xy_px, SIZE, may_distort=False)
    once, twice = (proof.price(plain, SIZE, log_range)[1] for log_range in (0.7, 1.4))
    assert abs(twice - once - np.log(2.0)) < 1e-9
    assert abs(proof.price(plain, SIZE, 1.4, 3)[1] - twice - np.log(3.0)) < 1e-9
    P_c = proof.price(plain, SIZE, 1.4)[0]
    cells = 8.0 * np.pi**2 / np.sqrt((2.0 * np.pi) ** 3 * np.linalg.det(2.0 * P_c))
    assert twice > np.log(cells) > 15.0
    free = lens.fit(true, u_i, xy_px, SIZE)
    assert proof.price(free, SIZE, 1.4)[1] > twice
    farther = free._replace(lens=free.lens._replace(k=(3.0 * free.prior[0], 0.0, 0.0, 0.0, 0.0)))
    at_middle = free._replace(lens=free.lens._replace(k=lens.NO_DISTORTION))
    differ = proof.price(farther, SIZE, 1.4)[1] - proof.price(at_middle, SIZE, 1.4)[1]
    assert abs(differ - 4.5) < 1e-9


@pytest.mark.parametrize("off", [(0.0, 0.0), (0.02, -0.015)])
def test_slopes_are_derivatives(off):
    """Of the pixels by the eleven unknowns, against differences; the axis in the middle, and 2 % off.

    Off it, the turn is about the axes of the lens: those by the turn of the middle are turned by as much.
    """
    rng = np.random.default_rng(5)
    k = (-0.2, 0.1, 0.003, -0.002, -0.03)
    at = lens.Lens(dcm_from_rotvec(rng.normal(size=3)), 900.0, k, off)
    xy = rng.uniform([-0.6, -0.5], [0.6, 0.5], (12, 2))
    u_c = np.column_stack([xy, np.ones(12)])
    u_i = u_c / np.linalg.norm(u_c, axis=1, keepdims=True) @ at.C_ci
    to_axis = at.axis_C_ci @ at.C_ci.T
    J = steps.jacobians(at.focal_px, at.terms, lens.project(at, u_i, SIZE)[1])

    def moved(n, by):
        change = np.zeros(11)
        change[n] = by
        turned = dcm_from_rotvec(change[:3]) @ at.C_ci
        one = lens.of_terms(turned, at.focal_px * np.exp(change[3]), at.terms + change[4:])
        return lens.project(one, u_i, SIZE)[0]

    for n in range(11):
        numeric = (moved(n, 1e-6) - moved(n, -1e-6)) / 2e-6
        by = J[:, :, :3] @ to_axis[:, n] if n < 3 else J[:, :, n]
        if n > 3 and any(off):  # terms of the lens turn it a little against the middle: a part of the turn
            turns = J[:, :, :3].reshape(-1, 3)
            part, *_ = np.linalg.lstsq(turns, (numeric - by).ravel(), rcond=None)
            assert np.abs(part).max() < 0.01
            by = by + (turns @ part).reshape(by.shape)
        np.testing.assert_allclose(by, numeric, atol=1e-4)


def test_lenses_that_fold_are_none():
    """r (1 + k1 r^2) has its largest value at r = 1 / sqrt(-3 k1): a corner beyond is nobody's image."""
    turn, corner = dcm_from_rotvec(np.zeros(3)), 0.5 * np.hypot(*SIZE) / 900.0
    assert lens.is_lens(lens.Lens(turn, 900.0), SIZE)
    for share, is_one in ((0.7, True), (1.3, False)):
        k1 = -share * 4.0 / 27.0 / corner**2  # the largest value is 2 / (3 sqrt(-3 k1)): at 1.0 the corner
        assert lens.is_lens(lens.Lens(turn, 900.0, (k1, 0.0, 0.0, 0.0, 0.0)), SIZE) == is_one


def mutually_nearest(stars, xy_px, gate_px):
    """Rows of the stars (n,), -1 where none, by all distances."""
    apart = np.hypot(*(xy_px[:, None] - stars[None]).transpose(2, 0, 1))
    nearest, back = apart.argmin(axis=1), apart.argmin(axis=0)
    rows = np.arange(len(xy_px))
    return np.where((apart[rows, nearest] < gate_px) & (back[nearest] == rows), nearest, -1)


@pytest.mark.parametrize("k", [(0.0,) * 5, (-0.2, 0.1, 0.003, -0.002, -0.03)])
def test_angles_at_the_edges_are_those_of_the_rays(k):
    """Between left and right, and of the farthest corner, by the dot products of their directions."""
    at = lens.Lens(np.eye(3), 900.0, k)
    w, h = SIZE
    left, right = lens.rays(at, SIZE, np.array([[-0.5, 0.5 * (h - 1)], [w - 0.5, 0.5 * (h - 1)]]))
    assert lens.across(at, SIZE) == pytest.approx(np.arccos(left @ right), rel=1e-9)
    corners = np.array([[x, y] for x in (-0.5, w - 0.5) for y in (-0.5, h - 0.5)])
    assert lens.corner_angle(at, SIZE) == pytest.approx(np.arccos(lens.rays(at, SIZE, corners)[:, 2].min()))


def test_the_compiled_steps_see_the_lens_that_the_module_sees():
    """Pixels, their slopes and who is near whom: `steps` for the adjustment, `lens` for everybody else."""
    rng = np.random.default_rng(8)
    turn = dcm_from_rotvec(rng.normal(size=3))
    at = lens.Lens(turn, 900.0, (-0.2, 0.1, 0.003, -0.002, -0.03), (0.008, -0.011))
    u_i = rng.normal(size=(4000, 3))  # all directions, also behind the camera
    u_i /= np.linalg.norm(u_i, axis=1, keepdims=True)
    ideal, seen, inside = np.empty((4000, 2)), np.empty((4000, 2)), np.empty(4000, dtype=np.bool_)
    steps.project(at.C_ci, at.focal_px, at.terms, u_i, tuple(map(float, SIZE)), ideal, seen, inside)
    seen_px, ideal_px = lens.project(at, u_i, SIZE)
    np.testing.assert_allclose(seen, seen_px, rtol=1e-9)
    np.testing.assert_allclose(ideal, ideal_px, rtol=1e-9)
    np.testing.assert_array_equal(inside, ((seen_px > -1.0) & (seen_px < SIZE)).all(axis=1))
    assert 100 < inside.sum() < 1000 and np.isnan(seen_px[:, 0]).sum() > 1500
    # derivatives by the turn of the camera: the lens's slopes times those of X/Z and Y/Z
    few = np.ascontiguousarray(ideal[inside][:50])
    J, bent = steps.jacobians(at.focal_px, at.terms, few), distortion.slopes(at.k, few)
    by_x, by_y = np.array([turn_slopes(x, y) for x, y in few]).transpose(1, 0, 2)
    for row in range(2):
        slope = -at.focal_px * (bent[:, row, :1] * by_x + bent[:, row, 1:] * by_y)
        np.testing.assert_allclose(J[:, row, :3], slope, rtol=1e-9, atol=1e-9)
    # the wide gates hold several stars
    xy_px = rng.uniform(0.0, SIZE, (300, 2))
    stars = np.ascontiguousarray(seen_px[inside])
    for gate_px in (2.0, 10.0, 60.0):
        star = np.empty(300, dtype=np.int64)
        known = steps.match(seen_px, inside, xy_px, gate_px, star)  # those behind the camera are NaN
        nearest = mutually_nearest(stars, xy_px, gate_px)
        np.testing.assert_array_equal(star, np.where(nearest >= 0, np.flatnonzero(inside)[nearest], -1))
        np.testing.assert_array_equal(naming.matched(stars, xy_px, gate_px), nearest)
        assert known == (star >= 0).sum()
    assert known > 50
