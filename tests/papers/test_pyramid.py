"""Pyramid identification on lists of centroids from all over the sky: right or nothing."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from slow_identify import Sky, volume
from star_fields import (
    CAMERA,
    CATALOGUE,
    DEG,
    IDENTIFY,
    MODEL,
    YEAR,
    all_stars,
    centroid_list,
    random_attitude,
    ready_tracker,
)

from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.papers.shefex2.methods import pyramid
from shefex_nav.records import Reason

WRONG = np.radians(0.5)


def statistics(seed, n_frames, **field):
    """(solved, frames with at least 4 stars, wrong attitudes, wrong stars)."""
    rng = np.random.default_rng(seed)
    pairs = ready_tracker().pairs
    solved = possible = wrong = wrong_stars = 0
    for _ in range(n_frames):
        q_ic = random_attitude(rng)
        u_c, flux, star = centroid_list(rng, pairs.stars, q_ic, **field)
        possible += (star >= 0).sum() >= 4
        found = pyramid.identify(IDENTIFY, MODEL, pairs, u_c, flux)
        known = found.star >= 0
        if found.reason != Reason.NONE:
            assert not known.any()
            continue
        q = esoq2(u_c[known], pairs.stars.u_i[found.star[known]], np.ones(known.sum()))
        solved += 1
        wrong += np.linalg.norm(rotvec_between(q, q_ic)) > WRONG
        wrong_stars += (found.star[known] != star[known]).sum()
    return solved, possible, wrong, wrong_stars


@pytest.mark.parametrize("n_false, share", [(0, 0.995), (1, 0.99), (5, 0.98)])
def test_solves_what_can_be_solved(n_false, share):
    """Measured on 2000 frames: all of those with 4 stars or more but 0.5 per cent at 5 false objects."""
    solved, possible, wrong, wrong_stars = statistics(11 + n_false, 300, n_false=n_false)
    assert wrong == 0
    assert wrong_stars <= 1  # a false object may sit on a star's place
    assert solved >= share * possible - 1


def test_false_objects_in_the_majority_give_no_wrong_attitude():
    solved, _, wrong, _ = statistics(31, 200, n_false=15)
    assert wrong == 0
    assert solved > 60  # with the 15 brightest objects; the false ones are brighter than most stars


def test_noise_is_never_a_star_field():
    rng = np.random.default_rng(41)
    pairs = ready_tracker().pairs
    for _ in range(400):
        n = int(rng.integers(6, 25))
        u_c = unit_vectors(CAMERA, rng.uniform([0.0, 0.0], [658.0, 492.0], (n, 2)))
        flux = np.sort(10.0 ** rng.uniform(-2.2, 0.0, n))[::-1].copy()
        found = pyramid.identify(IDENTIFY, MODEL, pairs, u_c, flux)
        assert found.reason in (Reason.NO_MATCH, Reason.AMBIGUOUS, Reason.RESIDUALS)
        assert (found.star == -1).all()


def test_mirrored_sky_is_not_accepted():
    """A camera whose x axis is wired the wrong way round sees all angles right and no star field."""
    rng = np.random.default_rng(51)
    pairs = ready_tracker().pairs
    for _ in range(100):
        u_c, flux, _ = centroid_list(rng, pairs.stars, random_attitude(rng), 0, noise_px=0.0)
        mirrored = np.ascontiguousarray(u_c * [-1.0, 1.0, 1.0])
        assert pyramid.identify(IDENTIFY, MODEL, pairs, mirrored, flux).reason != Reason.NONE


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_too_few_detections(n):
    u_c = unit_vectors(CAMERA, np.random.default_rng(6).uniform(0.0, 400.0, (n, 2)))
    found = pyramid.identify(IDENTIFY, MODEL, ready_tracker().pairs, u_c, np.ones(n))
    assert found.reason == Reason.TOO_FEW_STARS
    assert len(found.star) == n


def test_coincident_and_equal_detections():
    """The same spot many times, and stars of the same brightness: nothing breaks, nothing is found."""
    u_c = unit_vectors(CAMERA, np.repeat([[100.0, 100.0], [300.0, 200.0]], 5, axis=0))
    found = pyramid.identify(IDENTIFY, MODEL, ready_tracker().pairs, u_c, np.ones(10))
    assert found.reason != Reason.NONE


def test_wrong_focal_length_finds_little_and_nothing_wrong():
    rng = np.random.default_rng(61)
    pairs = ready_tracker().pairs
    for _ in range(100):
        q_ic = random_attitude(rng)
        u_c, flux, _ = centroid_list(rng, pairs.stars, q_ic, 1)
        u_c = np.ascontiguousarray(u_c * [1.005, 1.005, 1.0])
        u_c /= np.linalg.norm(u_c, axis=1, keepdims=True)
        found = pyramid.identify(IDENTIFY, MODEL, pairs, u_c, flux)
        known = found.star >= 0
        if found.reason == Reason.NONE:
            q = esoq2(u_c[known], pairs.stars.u_i[found.star[known]], np.ones(known.sum()))
            assert np.linalg.norm(rotvec_between(q, q_ic)) < WRONG


def test_smart_triads_are_all_triads():
    triads = pyramid.smart_triads(15)
    assert {tuple(t) for t in triads} == set(combinations(range(15), 3))
    assert len(triads) == 455
    # in the plain order the brightest object, if false, would spoil the first 91 triads
    assert (triads[:10] == 0).any(axis=1).sum() == 1


def reference(params, pairs, u_c):
    """`match` with sets: the stars of the first triad on which exactly one pyramid stands, or None."""
    sky, tolerance, n = Sky(pairs), params.tolerance, len(u_c)
    for triad in pyramid.smart_triads(n).tolist():
        standing = []
        for abc in sky.tuples(u_c, triad, tolerance):
            if volume(u_c, triad) * volume(sky.u_i, abc) <= 0.0:
                continue
            row = dict(zip(triad, abc, strict=True))
            for d in set(range(n)) - set(triad):
                fourth = {q[3] for q in sky.tuples(u_c, [*triad, d], tolerance) if q[:3] == abc}
                if len(fourth) == 1:
                    row[d] = fourth.pop()
            if len(row) > 3:
                standing.append([row.get(k, -1) for k in range(n)])
        if len(standing) == 1:
            return standing[0]
    return None


def small_pairs():
    stars = catalogue.build(replace(CATALOGUE, faintest=4.6), all_stars(), YEAR)
    return catalogue.pair_table(stars, 18.6 * DEG)


@pytest.mark.parametrize("tolerance, n_false", [(0.018 * DEG, 2), (0.15 * DEG, 1)])
def test_match_against_sets_of_pairs(tolerance, n_false):
    """Also with a tolerance so wide that triangles and pyramids are ambiguous."""
    rng = np.random.default_rng(71)
    pairs, params = small_pairs(), replace(IDENTIFY, tolerance=tolerance, most_centroids=7)
    for _ in range(12):
        u_c, flux, star = centroid_list(rng, pairs.stars, random_attitude(rng), n_false)
        u_c, flux, star = u_c[:7], flux[:7], star[:7]
        if len(star) < 4:
            continue
        found, expected = pyramid.match(params, MODEL, pairs, u_c, flux), reference(params, pairs, u_c)
        if expected is None:
            assert found.reason == Reason.NO_MATCH and (found.star == -1).all()
        else:
            assert found.reason == Reason.NONE
            np.testing.assert_array_equal(found.star, expected)


def three_stars(rng, pairs):
    while True:
        u_c, flux, star = centroid_list(rng, pairs.stars, random_attitude(rng), 0)
        if len(star) == 3:
            return u_c, flux, star


def test_a_triangle_is_believed_only_on_demand():
    rng, pairs = np.random.default_rng(81), small_pairs()
    n_right = 0
    for _ in range(20):
        u_c, flux, star = three_stars(rng, pairs)
        assert pyramid.match(IDENTIFY, MODEL, pairs, u_c, flux).reason == Reason.TOO_FEW_STARS
        found = pyramid.match(IDENTIFY, MODEL, pairs, u_c, flux, accept_triangle=True)
        if found.reason == Reason.NONE:
            n_right += (found.star == star).all()
    assert n_right >= 18
    u_c, flux, star = three_stars(rng, pairs)  # with a fourth that is none of the catalogue
    u_c = np.vstack([u_c, unit_vectors(CAMERA, np.array([[333.0, 222.0]]))])
    found = pyramid.match(IDENTIFY, MODEL, pairs, u_c, np.append(flux, flux[-1] / 2), accept_triangle=True)
    assert found.reason == Reason.NONE
    np.testing.assert_array_equal(found.star, [*star, -1])


def test_cos_error_is_the_equation_of_the_paper():
    """c = 1, 18.57 deg, 0.15 px of 0.02 deg: 1.7e-5; the chosen 5.5e-5 is c = 3.3."""
    plain = pyramid.cos_error(1.0, 18.57 * DEG, 0.15, 0.02 * DEG)
    assert plain == pytest.approx(np.sin(18.57 * DEG) * 0.15 * 0.02 * DEG, rel=1e-3)
    assert pyramid.cos_error(3.3, 18.57 * DEG, 0.15, 0.02 * DEG) == pytest.approx(5.5e-5, rel=0.01)


def test_constant_tolerance_of_the_cosine():
    """With SHEFEX's cosError the pyramid works as well; with one too small it finds little."""
    rng, pairs = np.random.default_rng(91), ready_tracker().pairs
    fields = [centroid_list(rng, pairs.stars, random_attitude(rng), 0) for _ in range(60)]
    fields = [field for field in fields if len(field[2]) >= 4]

    def solved(cos_error):
        results = [pyramid.match(IDENTIFY, MODEL, pairs, u_c, flux, cos_error) for u_c, flux, _ in fields]
        return sum(found.reason == Reason.NONE for found in results)

    assert solved(5.5e-5) >= 0.97 * len(fields)
    assert solved(2e-7) < 0.2 * len(fields)


def test_angles_outside_the_table_match_nothing():
    """A camera with twice the field of the table: no angle can be looked up."""
    u_c = unit_vectors(
        CAMERA._replace(focal_length_px=600.0), np.array([[0, 0], [658, 0], [0, 492], [658, 492]], float)
    )
    for method in (pyramid.identify, pyramid.match):
        found = method(IDENTIFY, MODEL, ready_tracker().pairs, u_c, np.ones(4))
        assert found.reason == Reason.NO_MATCH and (found.star == -1).all()
