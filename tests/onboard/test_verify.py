"""Verification: the odds of an attitude, and what destroys them."""

import numpy as np
import pytest
from star_fields import CAMERA, IDENTIFY, MODEL, centroid_list, random_attitude, ready_tracker, stars_in_frame

from shefex_nav.geometry.pinhole import pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.onboard.startracker.identify.verify import _match_kernel, brightness_odds, log_odds, verify
from shefex_nav.records import Reason


def true_field(seed, n_stars):
    """A frame with exactly n_stars catalogue stars: attitude, u_c, flux, star."""
    rng = np.random.default_rng(seed)
    stars = ready_tracker().pairs.stars
    while True:
        q_ic = random_attitude(rng)
        u_c, flux, star = centroid_list(rng, stars, q_ic, 0)
        if len(star) == n_stars:
            return q_ic, u_c, flux, star


def test_match_against_brute_force():
    rng = np.random.default_rng(1)
    stars = ready_tracker().pairs.stars
    for _ in range(30):
        q_ic = random_attitude(rng)
        rows, xy_px = stars_in_frame(stars, q_ic)
        detected = xy_px[rng.random(len(rows)) < 0.7] + rng.normal(0.0, 0.4, (1, 2))
        detected = np.vstack([detected, rng.uniform(0.0, 490.0, (10, 2))])
        star, distance2, n_missing = _match_kernel(
            CAMERA, q_ic, stars.u_i, stars.vmag, detected, 1.2, 0.3, 0.0
        )
        d = np.linalg.norm(detected[:, None] - xy_px[None], axis=2)
        mutual = (d == d.min(axis=0)[None]) & (d == d.min(axis=1)[:, None]) & (d < 1.2)
        expected = np.where(mutual.any(axis=1), rows[mutual.argmax(axis=1)], -1)
        np.testing.assert_array_equal(star, expected)
        np.testing.assert_allclose(np.sqrt(distance2[star >= 0]), d[mutual], atol=1e-9)
        faintest = stars.vmag[star[star >= 0]].max(initial=-np.inf)
        well_inside = ((xy_px > 5.0) & (xy_px < [653.0, 487.0])).all(axis=1)
        due = rows[well_inside & (stars.vmag[rows] < faintest - 0.3)]
        assert n_missing == len(set(due) - set(star))


def test_four_stars_that_are_all_there_is_are_enough():
    _, u_c, flux, star = true_field(2, 4)
    found = verify(IDENTIFY, MODEL, ready_tracker().pairs.stars, u_c, flux, star)
    assert found.reason == Reason.NONE
    assert found.log_odds > np.log(1e7)


def test_four_stars_among_many_bright_missing_ones_are_not():
    """Four right stars of a rich field whose brighter stars are not seen look like chance."""
    _, u_c, flux, star = true_field(3, 25)
    keep = slice(21, 25)
    found = verify(IDENTIFY, MODEL, ready_tracker().pairs.stars, u_c[keep], flux[keep], star[keep])
    assert found.reason == Reason.AMBIGUOUS


def test_extra_stars_are_found_from_four():
    _, u_c, flux, star = true_field(4, 20)
    first = np.where(np.arange(20) < 4, star, -1)
    found = verify(IDENTIFY, MODEL, ready_tracker().pairs.stars, u_c, flux, first)
    assert found.reason == Reason.NONE
    np.testing.assert_array_equal(found.star, star)


def test_one_wrong_star_in_the_identification():
    _, u_c, flux, star = true_field(5, 12)
    wrong = star.copy()
    wrong[3] = (star[3] + 700) % 2000
    assert verify(IDENTIFY, MODEL, ready_tracker().pairs.stars, u_c, flux, wrong).reason == Reason.RESIDUALS


def test_odds_count_what_they_should():
    """A missing star costs ln(1 - p), a distance d^2 / (2 sigma^2)."""
    rng = np.random.default_rng(6)
    u_c = unit_vectors(CAMERA, rng.uniform([0.0, 0.0], [658.0, 492.0], (8, 2)))
    star, zero = np.arange(8), np.zeros(8)
    settings = (CAMERA, IDENTIFY.centroid_error, IDENTIFY.detection_probability)
    base = log_odds(*settings, u_c, star, zero, 0)
    assert log_odds(*settings, u_c, star, zero, 3) - base == pytest.approx(3.0 * np.log(0.1))
    off = np.zeros(8)
    off[2] = (2.0 * IDENTIFY.centroid_error) ** 2
    assert log_odds(*settings, u_c, star, off, 0) - base == pytest.approx(-2.0)
    # faint unknown detections behind them cost no more than the choice of where to stop, ln(n)
    u_more = unit_vectors(CAMERA, np.vstack([pixels(CAMERA, u_c), rng.uniform(0.0, 490.0, (22, 2))]))
    star_more, zero_more = np.where(np.arange(30) < 8, np.arange(30), -1), np.zeros(30)
    assert log_odds(*settings, u_more, star_more, zero_more, 0) - base == pytest.approx(np.log(8 / 30))


def test_odds_against_numpy():
    """Both kernels against their equations written with arrays; covariance and its determinant by numpy."""
    rng = np.random.default_rng(9)
    u_c = unit_vectors(CAMERA, rng.uniform([0.0, 0.0], [658.0, 492.0], (20, 2)))
    star = np.where(rng.random(20) < 0.5, rng.permutation(20), -1)
    known, distance2 = star >= 0, rng.exponential(0.1, 20)
    sigma_px, p, n = 0.25, 0.9, np.arange(1, 21)
    F = sum(np.eye(3) - np.outer(u, u) for u in u_c[known]) * (CAMERA.focal_length_px / sigma_px) ** 2
    attitude = 0.5 * np.log((2 * np.pi) ** 3 / np.linalg.det(F)) - np.log(8 * np.pi**2)
    peak = np.log(p * CAMERA.width_px * CAMERA.height_px / (2 * np.pi * sigma_px**2))
    each = np.where(known, peak - distance2 / (2 * sigma_px**2), 0.0)
    best = (np.cumsum(each) - np.cumsum(known) * np.log(n)).max()
    odds = log_odds(CAMERA, sigma_px, p, u_c, star, distance2, 2)
    assert odds == pytest.approx(attitude + best - np.log(20) + 2 * np.log(0.1), rel=1e-9)

    vmag, flux = rng.uniform(2.0, 5.5, 20), rng.uniform(100.0, 3000.0, 20)
    difference = vmag[star[known]] + 2.5 * np.log10(flux[known])
    difference = (difference - np.median(difference)) / 0.3
    peak = 4.0 / (np.sqrt(2 * np.pi) * 0.3)
    each = np.log(0.8 * peak * np.exp(-0.5 * difference**2) + 0.2)
    expected = each.sum() - np.log(peak * np.sqrt(known.sum()))
    assert brightness_odds(0.3, vmag, flux, star) == pytest.approx(expected, rel=1e-12)


def test_brightness_speaks_for_the_right_stars():
    """The same geometry with shuffled brightness is less likely, and a dimmer exposure changes nothing."""
    _, u_c, flux, star = true_field(7, 9)
    stars = ready_tracker().pairs.stars
    right = verify(IDENTIFY, MODEL, stars, u_c, flux, star).log_odds
    assert verify(IDENTIFY, MODEL, stars, u_c, 0.01 * flux, star).log_odds == pytest.approx(right)
    assert verify(IDENTIFY, MODEL, stars, u_c, flux[::-1].copy(), star).log_odds < right - 5.0


def test_attitude_from_detections_alone_is_not_needed():
    """The first identification may be any four of the stars."""
    q_ic, u_c, flux, star = true_field(8, 15)
    stars = ready_tracker().pairs.stars
    for first in ([0, 1, 2, 3], [11, 12, 13, 14], [0, 5, 10, 14]):
        given = np.full(15, -1)
        given[first] = star[first]
        assert verify(IDENTIFY, MODEL, stars, u_c, flux, given).reason == Reason.NONE
    predicted = np.ascontiguousarray(stars.u_i[star] @ dcm_from_quat(q_ic))
    assert np.abs(pixels(CAMERA, predicted) - pixels(CAMERA, u_c)).max() < 1.0
