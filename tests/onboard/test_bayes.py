"""Identification by odds against chance: its parts against slow references, and random fields."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import expit, logsumexp
from star_fields import CAMERA, IDENTIFY, MODEL, centroid_list, random_attitude, ready_tracker

from shefex_nav.geometry.pinhole import pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, dcm_from_rotvec, rotvec_between
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.onboard.startracker.identify import IDENTIFIERS, bayes, evidence, lever, odds, screen, search
from shefex_nav.records import Reason

PARAMS = replace(IDENTIFY, centroid_error=0.15, magnitude_error=0.2)
WRONG = np.radians(0.5)
AT_REST = lever.no_lever(1.0)
NO_PRIOR = evidence.Prior(False, np.eye(3), np.zeros((3, 3)))


def scene_of(xy_px, magnitude):
    order = np.argsort(magnitude)
    width, height = float(CAMERA.width_px), float(CAMERA.height_px)
    return evidence.Scene(
        np.ascontiguousarray(xy_px[order]), magnitude[order], True, width, height, CAMERA.focal_length_px,
        CAMERA.cx_px, CAMERA.cy_px, 5.0, 0.15, 0.2, None,
    )  # fmt: skip


def field(seed, n_false=5, **options):
    """(scene, C_ci, star) of a random frame."""
    rng = np.random.default_rng(seed)
    q_ic = random_attitude(rng)
    u_c, flux, star = centroid_list(rng, ready_tracker().pairs.stars, q_ic, n_false, **options)
    return scene_of(pixels(CAMERA, u_c), -2.5 * np.log10(flux)), dcm_from_quat(q_ic).T.copy(), star


def stars_and_pairs():
    return ready_tracker().pairs.quick


def test_jacobian_against_differences():
    for x, y in ((0.1, -0.05), (-0.13, 0.09)):
        J = np.array(evidence.jacobian(x, y))
        p = np.array([x, y, 1.0])
        for axis in range(3):
            turned = dcm_from_rotvec(1e-6 * np.eye(3)[axis]) @ p
            slope = (turned[:2] / turned[2] - [x, y]) / 1e-6
            np.testing.assert_allclose(slope, [J[axis], J[3 + axis]], atol=1e-6)
        np.testing.assert_allclose(J[6:], [x, y])


def test_view_and_matches_against_brute_force():
    stars, _ = stars_and_pairs()
    view = evidence.new_view()
    for seed in range(20):
        scene, C, _ = field(seed)
        n = evidence.predict(stars, scene, C, scene.focal_px, view)
        u_c = stars.u_i @ C.T
        xy = pixels(CAMERA, np.ascontiguousarray(u_c))
        with np.errstate(invalid="ignore"):
            rows = np.flatnonzero(((xy >= -2.0) & (xy <= [660.0, 494.0])).all(axis=1))
        np.testing.assert_array_equal(view.row[:n], rows)
        np.testing.assert_allclose(view.xy_px[:n], xy[rows], atol=1e-8)
        matches = evidence.match(scene, view, n, 3.0, 0.15)
        d = np.linalg.norm(xy[rows][:, None] - scene.xy_px[None], axis=2)
        mutual = (d == d.min(axis=0)[None]) & (d == d.min(axis=1)[:, None]) & (d < 3.0)
        np.testing.assert_array_equal(view.det[:n], np.where(mutual.any(axis=1), mutual.argmax(axis=1), -1))
        assert matches == mutual.sum()


@pytest.mark.parametrize("n_par, focal", [(3, 1.0), (4, 1.006)])
def test_adjustment_finds_the_attitude_and_the_focal_length(n_par, focal):
    stars, _ = stars_and_pairs()
    for seed in range(10):
        scene, C, star = field(seed, n_false=0, noise_px=0.0)
        if (star >= 0).sum() < 6:
            continue
        middle = np.array([CAMERA.cx_px, CAMERA.cy_px])
        scene = scene._replace(xy_px=middle + focal * (scene.xy_px - middle))
        start = dcm_from_rotvec(np.array([1e-3, -8e-4, 2e-3])) @ C
        view = evidence.new_view()
        trial = evidence.Trial(start, scene.focal_px, n_par)
        out = evidence.adjust(stars, scene, trial, view, 10.0, AT_REST, 4)
        assert out.n > 0
        assert out.focal_px / scene.focal_px == pytest.approx(focal, abs=1e-5)
        assert np.abs(start @ C.T - np.eye(3)).max() < 2e-5
        np.testing.assert_allclose(start @ start.T, np.eye(3), atol=1e-12)


def crowding_of_one(xy_px, k):
    """ln of density of the neighbours of detection k over four times the usual one, if more than two."""
    d2 = np.delete(((xy_px - xy_px[k]) ** 2).sum(axis=1), k)
    usual = 4.0 * len(xy_px) / (659.0 * 493.0)
    near = d2[d2 < 3.0 / (np.pi * usual)]
    return np.log(len(near) / (np.pi * max(near.max(), 1.0) * usual)) if len(near) >= 3 else 0.0


def test_odds_against_plain_formulas():
    stars, _ = stars_and_pairs()
    view = evidence.new_view()
    for seed in range(5):
        scene, C, _ = field(seed)
        trial = evidence.Trial(C, scene.focal_px, 3)
        fit = evidence.adjust(stars, scene, trial, view, 5.0, AT_REST, 4)
        n, L, log_det = fit.n, fit.L, fit.log_det
        assert log_det == pytest.approx(np.linalg.slogdet((L @ L.T)[:3, :3])[1]) or n == 0
        det, row, d2 = view.det[:n], view.row[:n], view.distance2[:n]
        known, n_det = det >= 0, len(scene.mag)
        crowding = np.array([crowding_of_one(scene.xy_px, k) for k in det])
        terms = []
        for scale, weight in zip(evidence.NOISE_SCALES, evidence.NOISE_WEIGHTS, strict=True):
            s2 = (0.15 * scale) ** 2
            density = 0.94 * np.exp(-0.5 * d2 / s2) / s2 + 0.06 * np.exp(-0.5 * d2 / (16 * s2)) / (16 * s2)
            place = np.log(659.0 * 493.0 / (2 * np.pi) * density) - crowding
            best = -np.inf
            for j in range(1, n_det + 1):
                used = known & (det < j)
                chance = np.log(np.arange(j - used.sum() + 1, j + 1)).sum()
                share = 0.8 if j == n_det else 0.2 / n_det
                best = max(best, np.log(share) + place[used].sum() - chance)
            terms.append(np.log(weight) + 1.5 * np.log(2 * np.pi * s2) - 0.5 * log_det + best)
        assert odds.place_odds(scene, view, n, log_det, 3) == pytest.approx(logsumexp(terms))
        zero = np.median(scene.mag[det[known]] - stars.vmag[row[known]])
        assert odds.zero_point(stars, scene, view, n) == pytest.approx(zero)


def test_completeness_against_plain_formulas():
    stars, _ = stars_and_pairs()
    view = evidence.new_view()
    for seed in range(5):
        scene, C, _ = field(seed)
        trial = evidence.Trial(C, scene.focal_px, 3)
        n = evidence.adjust(stars, scene, trial, view, 5.0, AT_REST, 4).n
        row, seen = view.row[:n], view.det[:n] >= 0
        zero = odds.zero_point(stars, scene, view, n)
        counted = seen | np.array([odds._is_due(scene, view, n, s) for s in range(n)])
        terms = []
        for step, limit_weight in zip(odds.LIMITS, odds.LIMIT_WEIGHTS, strict=True):
            limit = stars.vmag[-1] - step
            fainter = (scene.mag > zero + limit + 0.3).sum() if step > 0.0 else 0
            for share, share_weight in zip(odds.SHARES, odds.SHARE_WEIGHTS, strict=True):
                p = share * (0.03 + 0.97 * expit((limit - stars.vmag[row]) / 0.17))
                pattern = np.where(seen, np.log(p), np.log(1.0 - p))[counted].sum()
                terms.append(np.log(limit_weight * share_weight) + pattern + fainter * np.log(0.5))
        assert odds.completeness_odds(stars, view, n, scene, zero) == pytest.approx(logsumexp(terms))


def test_priors_of_completeness_are_probabilities():
    assert sum(odds.LIMIT_WEIGHTS) == pytest.approx(1.0)
    assert sum(odds.SHARE_WEIGHTS) == pytest.approx(1.0)


def test_scan_against_brute_force():
    """Every pair of stars with the right angle and brightness, in both orders, and what it predicts."""
    stars, pairs = stars_and_pairs()
    scene, _, _ = field(3, n_false=10)
    u_c = screen.directions(scene, scene.focal_px)
    seen, i, j = screen.new_seen(scene, scene.ellipses), 0, 1
    T, reach = screen.triad(u_c[i], u_c[j]), lever.lever_of(scene, None, i, j, 0.5)
    frame, gate = screen.frame_of(scene, scene.focal_px, 99, 5), (-0.8, 1.2)
    two = screen.TwoSeen(T, reach, gate, (-1, -1), (i, j))
    angle = np.arccos(u_c[i] @ u_c[j])
    begin, end = search.position(pairs, np.cos(angle + 5e-4)), search.position(pairs, np.cos(angle - 5e-4))
    assert begin == np.searchsorted(pairs.cosine, np.cos(angle + 5e-4))
    entry, checked = 2 * begin, 0
    while entry < 2 * end:
        entry, C, _ = screen.scan(stars, pairs, seen, two, frame, 0, entry, 2 * end)
        if entry == 2 * end:
            break
        a, b = pairs.star[entry // 2]
        a, b = (b, a) if entry % 2 else (a, b)
        assert gate[0] < stars.vmag[b] - stars.vmag[a] < gate[1]
        C_ci = np.array(C).reshape(3, 3)
        np.testing.assert_allclose(C_ci @ C_ci.T, np.eye(3), atol=1e-9)
        assert np.linalg.norm(C_ci @ (stars.u_i[a] - stars.u_i[b]) - (u_c[i] - u_c[j])) < 6e-4
        hits, _ = screen.screen.py_func(stars, seen, C, frame, reach, a, b)
        assert hits == min(brute_hits(stars, scene, C_ci, reach, a, b), 5)
        entry, checked = entry + 1, checked + 1
        if checked == 150:
            break
    assert checked > 100


def brute_hits(stars, scene, C_ci, reach, a, b):
    """Stars but a and b with a detection within their gate."""
    xy = pixels(CAMERA, np.ascontiguousarray(stars.u_i @ C_ci.T))
    hits = 0
    for s in range(len(xy)):
        x, y = xy[s]
        if s in (a, b) or not (0.0 <= x <= 658.0 and 0.0 <= y <= 492.0):
            continue
        r2 = (x - reach.x) ** 2 + (y - reach.y) ** 2
        gate2 = min(reach.near2 + reach.far2 * r2, lever.REACH_PX**2)
        hits += ((scene.xy_px - xy[s]) ** 2).sum(axis=1).min() < gate2
    return hits


def statistics(seed, n_frames, **options):
    """(solved, frames with at least 4 stars, wrong attitudes, wrong stars) of the common signature."""
    rng = np.random.default_rng(seed)
    pairs = ready_tracker().pairs
    solved = possible = wrong = wrong_stars = 0
    for _ in range(n_frames):
        q_ic = random_attitude(rng)
        u_c, flux, star = centroid_list(rng, pairs.stars, q_ic, **options)
        found = IDENTIFIERS["bayes"](PARAMS, MODEL, pairs, u_c, flux)
        possible += (star >= 0).sum() >= 4
        known = found.star >= 0
        if found.reason != Reason.NONE:
            assert not known.any()
            continue
        q = esoq2(u_c[known], pairs.stars.u_i[found.star[known]], np.ones(known.sum()))
        solved += 1
        wrong += np.linalg.norm(rotvec_between(q, q_ic)) > WRONG
        wrong_stars += (found.star[known] != star[known]).sum()
    return solved, possible, wrong, wrong_stars


@pytest.mark.parametrize("n_false", [0, 5, 15])
def test_solves_what_can_be_solved(n_false):
    solved, possible, wrong, wrong_stars = statistics(11 + n_false, 300, n_false=n_false)
    assert wrong == 0
    assert wrong_stars <= 2  # a false object may sit on a star's place
    assert solved >= possible - 2


def test_more_noise_than_said():
    solved, possible, wrong, _ = statistics(7, 200, n_false=5, noise_px=0.5, magnitude_scatter=0.3)
    assert wrong == 0
    assert solved >= 0.96 * possible


def test_noise_is_never_a_star_field():
    rng = np.random.default_rng(41)
    pairs = ready_tracker().pairs
    for _ in range(100):
        n = int(rng.integers(6, 25))
        u_c = unit_vectors(CAMERA, rng.uniform([0.0, 0.0], [658.0, 492.0], (n, 2)))
        flux = np.sort(10.0 ** rng.uniform(-2.2, 0.0, n))[::-1].copy()
        found = bayes.identify(PARAMS, MODEL, pairs, u_c, flux)
        assert found.reason == Reason.NO_MATCH
        assert (found.star == -1).all()


def test_mirrored_sky_is_not_accepted():
    rng = np.random.default_rng(51)
    pairs = ready_tracker().pairs
    for _ in range(50):
        u_c, flux, _ = centroid_list(rng, pairs.stars, random_attitude(rng), 0, noise_px=0.0)
        mirrored = np.ascontiguousarray(u_c * [-1.0, 1.0, 1.0])
        assert bayes.identify(PARAMS, MODEL, pairs, mirrored, flux).reason != Reason.NONE


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_too_few_detections(n):
    u_c = unit_vectors(CAMERA, np.random.default_rng(6).uniform(0.0, 400.0, (n, 2)))
    found = bayes.identify(PARAMS, MODEL, ready_tracker().pairs, u_c, np.ones(n))
    assert found.reason == Reason.TOO_FEW_STARS
    assert len(found.star) == n


def test_work_is_bounded():
    """The budget, and at most one more pair; several budgets where partners cannot be looked for."""
    stars, pairs = stars_and_pairs()
    rng = np.random.default_rng(8)
    for n in (12, 40, 200):
        numbers = bayes.Numbers(
            659.0, 493.0, CAMERA.focal_length_px, CAMERA.cx_px, CAMERA.cy_px, 5.0, 0.15, 0.2, 1e-7, 4, 50_000
        )
        xy = rng.uniform([0.0, 0.0], [658.0, 492.0], (n, 2))
        found = bayes.Solution(
            *bayes.solve_kernel(stars, pairs, numbers, xy, np.sort(rng.random(n)), True, bayes.NO_PREDICTION)
        )
        assert found.reason == Reason.NO_MATCH and len(found.star) == n
        budgets = 1.0 if n <= search.MOST_FILTERED else search.MOST_GROWTH
        assert found.work < 50_000 * (budgets + 1.0)


@pytest.mark.parametrize("need", [0, 2])
def test_a_scan_in_pieces_finds_what_one_finds(need):
    """Entries of any first and last number: brightness is compared many at a time."""
    stars, pairs = stars_and_pairs()
    scene, _, _ = field(3, n_false=10)
    u_c = screen.directions(scene, scene.focal_px)
    seen, T = screen.new_seen(scene, None), screen.triad(u_c[0], u_c[1])
    two = screen.TwoSeen(T, lever.lever_of(scene, None, 0, 1, 0.5), (-0.8, 1.2), (-1, -1), (0, 1))
    frame = screen.frame_of(scene, scene.focal_px, 99, 5)
    first, last = 1001, 1001 + 3 * screen.AT_ONCE + 7

    def found(step):
        entries = []
        for begin in range(first, last, step):
            entry, end = begin, min(begin + step, last)
            while entry < end:
                entry, _, _ = screen.scan(stars, pairs, seen, two, frame, need, entry, end)
                entries += [entry] if entry < end else []
                entry += 1
        return entries

    whole = found(last - first)
    assert found(1) == found(50) == found(screen.AT_ONCE + 1) == whole
    fainter = pairs.fainter[first // 2 : last // 2 + 1].astype(float)
    every = np.stack([fainter, -fainter], axis=1).ravel()[first % 2 :][: last - first]
    passed = first + np.flatnonzero((every > -0.8) & (every < 1.2))
    assert set(whole) <= set(passed.tolist()) and (need or whole == passed.tolist())
