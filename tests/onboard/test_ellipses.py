"""Identification with an error ellipse for each centroid: against plain formulas, and fields of streaks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from star_fields import CAMERA, IDENTIFY, MODEL, centroid_list, random_attitude, ready_tracker

from shefex_nav.geometry.pinhole import pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, dcm_from_rotvec, rotvec_between
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.onboard.startracker.identify import (
    IDENTIFIERS,
    bayes,
    doubts,
    ellipses,
    evidence,
    lever,
    odds,
)
from shefex_nav.onboard.startracker.likelihood import refine
from shefex_nav.records import Reason

SIGMA = 0.15
PARAMS = replace(IDENTIFY, centroid_error=SIGMA, magnitude_error=0.2)
WRONG = np.radians(0.5)
MIDDLE = np.array([CAMERA.cx_px, CAMERA.cy_px])


def covariances(rng, n, along=(0.2, 1.5), across=(0.06, 0.3)):
    """(n, 2, 2) px^2, in all directions."""
    angle = rng.uniform(0.0, np.pi, n)
    t = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    outer = t[:, :, None] * t[:, None, :]
    s, b = rng.uniform(*along, (n, 1, 1)), rng.uniform(*across, (n, 1, 1))
    return s**2 * outer + b**2 * (np.eye(2) - outer)


def drawn(rng, P):
    return np.einsum("nij,nj->ni", np.linalg.cholesky(P), rng.standard_normal((len(P), 2)))


def streaks(rng, n_false, **options):
    """(xy_px, flux, P_px, star, q_ic): stars with errors as P_px says, false ones with some P_px."""
    q_ic = random_attitude(rng)
    u_c, flux, star = centroid_list(rng, ready_tracker().pairs.stars, q_ic, n_false, noise_px=0.0)
    P = covariances(rng, len(flux), **options)
    return pixels(CAMERA, u_c) + drawn(rng, P), flux, P, star, q_ic


def scene_of(xy_px, flux, P_px):
    width, height = float(CAMERA.width_px), float(CAMERA.height_px)
    return evidence.Scene(
        xy_px, -2.5 * np.log10(flux), True, width, height, CAMERA.focal_length_px, CAMERA.cx_px, CAMERA.cy_px,
        5.0, SIGMA, 0.2, ellipses.ellipses_of(P_px, SIGMA),
    )  # fmt: skip


def stars_seen(stars, q_ic):
    """(rows, xy_px) of the stars in the frame or 2 px outside."""
    xy = pixels(CAMERA, np.ascontiguousarray(stars.u_i @ dcm_from_quat(q_ic)))
    with np.errstate(invalid="ignore"):
        rows = np.flatnonzero(((xy >= -2.0) & (xy <= [660.0, 494.0])).all(axis=1))
    return rows, xy[rows]


def test_ellipses_against_numpy():
    rng = np.random.default_rng(1)
    P = covariances(rng, 40)
    made = ellipses.ellipses_of(P, SIGMA)
    for k in range(40):
        d = rng.normal(size=2)
        assert ellipses.weighted2(made, k, *d) == pytest.approx(SIGMA**2 * d @ np.linalg.solve(P[k], d))
        assert ellipses.log_area(made, k) == pytest.approx(0.5 * np.linalg.slogdet(P[k] / SIGMA**2)[1])
        W = SIGMA**2 * np.linalg.inv(P[k])
        np.testing.assert_allclose(ellipses.weigh(made, k, *d), W @ d)
        p, q, r = ellipses.factor(made, k)
        R = np.array([[p, q], [0.0, r]])
        np.testing.assert_allclose(R.T @ R, W)
        S = 0.5 * (P[k] + P[0])
        assert ellipses.along(made, k, 0, *d) == pytest.approx(d @ S @ d / (d @ d) / SIGMA**2)
        between = d @ np.linalg.solve(S, d) * SIGMA**2
        assert ellipses.between2(made, k, 0, *d) == pytest.approx(between)


def test_axes_are_bounded():
    """A promise of no error at all is worth the floor; an endless ellipse ends."""
    P = np.array([np.diag([1e-12, 1e-12]), np.diag([1e8, 1e-12]), np.diag([0.04, 0.09])])
    made = ellipses.ellipses_of(P, SIGMA)
    floor, longest = ellipses.LEAST**2, (ellipses.LONGEST_PX / SIGMA) ** 2
    np.testing.assert_allclose(made.spread[0], [floor, 0.0, floor])
    np.testing.assert_allclose(made.spread[1], [longest, 0.0, floor], rtol=1e-9)
    np.testing.assert_allclose(made.spread[2], np.array([0.04, 0.0, 0.09]) / SIGMA**2)
    np.testing.assert_allclose(made.spread[:, [0, 2]] * made.weight[:, [0, 2]], 1.0)


def test_lever_against_random_errors():
    """Covariance of a place that a pair predicts: the pair moved by its errors, many times."""
    rng = np.random.default_rng(2)
    P = np.array([[[0.5, 0.3], [0.3, 0.4]], [[0.1, -0.1], [-0.1, 0.9]], [[0.05, 0.0], [0.0, 0.2]]])
    pair, place = np.array([[200.0, 150.0], [350.0, 300.0]]), np.array([480.0, 120.0])
    scene = scene_of(np.vstack([pair, place]), np.ones(3), P)
    made = lever.lever_of(scene, scene.ellipses, 0, 1, SIGMA)
    gate = np.array(lever.reach_of(scene.ellipses, made, *place))
    e = np.stack([rng.multivariate_normal(np.zeros(2), P[k], 200_000) for k in range(2)])
    d = pair[1] - pair[0]
    across = np.array([-d[1], d[0]]) / np.linalg.norm(d)
    turn = (e[1] - e[0]) @ across / np.linalg.norm(d)
    arm = place - pair.mean(axis=0)
    moved = e.mean(axis=0) + turn[:, None] * [-arm[1], arm[0]]
    expected = np.cov(moved.T)
    np.testing.assert_allclose(
        gate[[0, 1, 2]] / lever.STAR_GATE**2, expected[[0, 0, 1], [0, 1, 1]], rtol=0.02
    )
    off = np.array([1.0, -2.0])
    share, _ = lever.gate_of(scene.ellipses, made, tuple(gate), 2, *off)
    chi2 = off @ np.linalg.solve(expected + P[2], off)
    assert share == pytest.approx(chi2 / lever.STAR_GATE**2, rel=0.02)


def test_matches_are_the_likeliest_detections():
    stars, view = ready_tracker().pairs.quick[0], evidence.new_view()
    compared = 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        xy, flux, P, _, q_ic = streaks(rng, 40)
        scene = scene_of(xy, flux, P)
        C = dcm_from_quat(q_ic).T.copy()
        n = evidence.predict(stars, scene, C, scene.focal_px, view)
        rows, predicted = stars_seen(stars, q_ic)
        np.testing.assert_array_equal(view.row[:n], rows)
        evidence.match(scene, view, n, 4.5 * SIGMA, SIGMA)
        d = xy[None] - predicted[:, None]
        d2 = np.einsum("skj,kji,ski->sk", d, np.linalg.inv(P), d)
        density = np.where(d2 < 4.5**2, -d2 - np.linalg.slogdet(P)[1], -np.inf)
        best = np.where(np.isfinite(density.max(axis=1)), density.argmax(axis=1), -1)
        for s in range(n):
            rivals = np.flatnonzero(best == best[s]) if best[s] >= 0 else np.array([s])
            wins = d2[s, best[s]] == d2[rivals, best[s]].min()
            assert view.det[s] == (best[s] if wins else -1)
            if view.det[s] >= 0:
                assert view.distance2[s] == pytest.approx(SIGMA**2 * d2[s, best[s]])
                compared += 1
    assert compared > 300


@pytest.mark.slow
def test_adjusted_attitude_is_that_of_largest_likelihood():
    """Gauss-Newton on all stars with their covariances, another implementation; no outliers here."""
    stars = ready_tracker().pairs.quick[0]
    compared = 0
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        xy, flux, P, star, q_ic = streaks(rng, 0, along=(0.1, 0.6), across=(0.05, 0.2))
        if (star >= 0).sum() < 8:
            continue
        start = dcm_from_rotvec(rng.normal(0.0, 2e-4, 3)) @ dcm_from_quat(q_ic).T
        scene, view = scene_of(xy, flux, P), evidence.new_view()
        wide = lever.no_lever(14.0 * SIGMA)
        trial = evidence.Trial(start, scene.focal_px, 3)
        out = evidence.adjust(stars, scene, trial, view, 10.0, wide, 4)
        n, L = out.n, out.L
        known = view.det[:n] >= 0
        det, row = view.det[:n][known], view.row[:n][known]
        q, P_c, _ = refine(CAMERA, q_ic, xy[det], stars.u_i[row], P[det])
        turn = start @ dcm_from_quat(q)  # nearly the unit matrix
        off = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        assert (np.abs(off) < 0.6 * np.sqrt(np.diag(P_c))).all()  # stars beyond 2 sigma weigh less in one
        information = np.linalg.inv(P_c) * SIGMA**2
        assert np.abs((L @ L.T)[:3, :3] / information - 1.0)[np.diag_indices(3)].max() < 0.6
        compared += 1
    assert compared > 5


def test_odds_of_places_against_normal_densities():
    stars, view, compared = ready_tracker().pairs.quick[0], evidence.new_view(), 0
    for seed in range(8):
        rng = np.random.default_rng(200 + seed)
        xy, flux, P, _, q_ic = streaks(rng, 5)
        scene = scene_of(xy, flux, P)
        C = dcm_from_quat(q_ic).T.copy()
        n = evidence.predict(stars, scene, C, scene.focal_px, view)
        evidence.match(scene, view, n, 4.5 * SIGMA, SIGMA)
        known = np.flatnonzero(view.det[:n] >= 0)
        n_det, of_det = len(flux), np.full(len(flux), -1.0)
        of_det[view.det[known]] = 1.0
        crowding = odds.crowding_of(scene, of_det)
        value = []
        for scale in evidence.NOISE_SCALES:
            place = {}
            for s in known:
                k = view.det[s]
                off = xy[k] - view.xy_px[s]
                near = multivariate_normal(cov=scale**2 * P[k]).pdf(off)
                far = multivariate_normal(cov=16.0 * scale**2 * P[k]).pdf(off)
                place[k] = np.log(659.0 * 493.0 * (0.94 * near + 0.06 * far)) - crowding[k]
            best = -np.inf
            for j in range(1, n_det + 1):
                used = [place[k] for k in place if k < j]
                chance = np.log(np.arange(j - len(used) + 1, j + 1)).sum()
                best = max(best, np.log(0.8 if j == n_det else 0.2 / n_det) + sum(used) - chance)
            value.append(best + 1.5 * np.log(2.0 * np.pi * (scale * SIGMA) ** 2) - 0.5 * 30.0)
        total = np.log(np.dot(evidence.NOISE_WEIGHTS, np.exp(np.array(value) - max(value)))) + max(value)
        assert odds.place_odds(scene, view, n, 30.0, 3) == pytest.approx(total)
        compared += len(known)
    assert compared > 40


def test_leverage_is_the_share_of_the_information():
    rng = np.random.default_rng(3)
    stars, view = ready_tracker().pairs.quick[0], evidence.new_view()
    xy, flux, P, _, q_ic = streaks(rng, 0)
    scene = scene_of(xy, flux, P)
    n = evidence.predict(stars, scene, dcm_from_quat(q_ic).T.copy(), scene.focal_px, view)
    evidence.match(scene, view, n, 4.5 * SIGMA, SIGMA)
    f = scene.focal_px
    parts = {}
    for s in np.flatnonzero(view.det[:n] >= 0):
        J = np.array(evidence.jacobian(*((view.xy_px[s] - MIDDLE) / f)))[:6].reshape(2, 3) * f
        parts[s] = J.T @ np.linalg.inv(P[view.det[s]]) @ J * SIGMA**2
    L = np.linalg.cholesky(sum(parts.values()))
    full = np.zeros((4, 4))
    full[:3, :3] = L
    for s, part in parts.items():
        share = np.trace(np.linalg.solve(L @ L.T, part))
        assert doubts._leverage(full, scene, view, s, f, 3) == pytest.approx(share)


def outcome(rng, n_fields, n_false, told=lambda P: P, near=False, **options):
    """(solved, possible, wrong) of fields of streaks; told: what is said of their covariances."""
    pairs, solved, possible, wrong = ready_tracker().pairs, 0, 0, 0
    for _ in range(n_fields):
        xy, flux, P, star, q_ic = streaks(rng, n_false, **options)
        u_c, said = unit_vectors(CAMERA, xy), told(P)
        if near:
            found, _ = bayes.identify_near(
                PARAMS, MODEL, pairs, u_c, flux, (q_ic, np.eye(3) * np.radians(0.05) ** 2), said
            )
        else:
            found = IDENTIFIERS["bayes"](PARAMS, MODEL, pairs, u_c, flux, said)
        known = found.star >= 0
        possible += (star >= 0).sum() >= 5
        if found.reason == Reason.NONE:
            q = esoq2(u_c[known], pairs.stars.u_i[found.star[known]], np.ones(known.sum()))
            q, P_c, _ = refine(CAMERA, q, xy[known], pairs.stars.u_i[found.star[known]], P[known])
            solved += 1
            wrong += np.linalg.norm(rotvec_between(q, q_ic)) > max(WRONG, 4.0 * np.sqrt(np.trace(P_c)))
    return solved, possible, wrong


def test_long_streaks_need_their_covariance():
    """Errors of 1 to 3 px along, 0.1 px across: told, nearly all are solved; as circles of 0.15 px, half."""
    long = {"along": (1.0, 3.0), "across": (0.06, 0.15)}
    solved, possible, wrong = outcome(np.random.default_rng(4), 100, 10, **long)
    assert wrong == 0
    assert solved >= 0.95 * possible
    round_solved, _, wrong = outcome(np.random.default_rng(4), 100, 10, told=lambda P: None, **long)
    assert wrong == 0
    assert round_solved < 0.7 * possible


def test_circles_of_the_usual_size_are_as_none():
    rng, pairs, same = np.random.default_rng(5), ready_tracker().pairs, 0
    for _ in range(100):
        q_ic = random_attitude(rng)
        u_c, flux, _ = centroid_list(rng, pairs.stars, q_ic, 5)
        plain = bayes.identify(PARAMS, MODEL, pairs, u_c, flux)
        told = bayes.identify(
            PARAMS, MODEL, pairs, u_c, flux, np.tile(np.eye(2) * SIGMA**2, (len(flux), 1, 1))
        )
        same += plain.reason == told.reason and (plain.star == told.star).all()
        if plain.reason == told.reason == Reason.NONE and (plain.star == told.star).all():
            assert told.log_odds == pytest.approx(plain.log_odds, abs=0.2)  # where Newton stops
    assert same >= 98


@pytest.mark.parametrize(
    "told",
    [
        lambda P: P / 1.5**2,
        lambda P: P * 2.0**2,
        lambda P: P[:, ::-1, ::-1].copy(),  # mirrored at the diagonal: a wrong orientation
        lambda P: P[::-1].copy(),  # of another detection
    ],
    ids=["too small", "too large", "turned", "shuffled"],
)
def test_wrong_covariances_give_no_wrong_attitude(told):
    solved, possible, wrong = outcome(np.random.default_rng(6), 100, 10, told=told, along=(0.2, 0.6))
    assert wrong == 0
    assert solved >= 0.8 * possible


def test_prediction_with_streaks():
    solved, possible, wrong = outcome(np.random.default_rng(7), 150, 20, near=True)
    assert wrong == 0
    assert solved >= 0.99 * possible


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_false_detections_with_any_covariance_are_never_a_star_field(size):
    rng, pairs = np.random.default_rng(8), ready_tracker().pairs
    for _ in range(40):
        n = int(rng.integers(6, 60))
        u_c = unit_vectors(CAMERA, rng.uniform([0.0, 0.0], [658.0, 492.0], (n, 2)))
        flux = np.sort(10.0 ** rng.uniform(-2.2, 0.0, n))[::-1].copy()
        found = bayes.identify(PARAMS, MODEL, pairs, u_c, flux, size * covariances(rng, n))
        assert found.reason == Reason.NO_MATCH
        assert (found.star == -1).all()


@pytest.mark.parametrize(
    "bad",
    [
        np.diag([np.nan, 1.0]),
        np.diag([np.inf, 1.0]),
        np.zeros((2, 2)),
        np.diag([1.0, -1.0]),
        np.diag([-1.0, -1.0]),
        np.array([[1.0, 1.0], [1.0, 1.0]]),
        np.array([[1.0, 2.0], [2.0, 1.0]]),
        np.array([[1.0, 0.5], [0.0, 1.0]]),
    ],
)
def test_what_is_no_covariance_is_refused(bad):
    rng, pairs = np.random.default_rng(9), ready_tracker().pairs
    xy, flux, P, _, q_ic = streaks(rng, 3)
    P[2] = bad
    with pytest.raises(ValueError, match="P_px"):
        bayes.identify(PARAMS, MODEL, pairs, unit_vectors(CAMERA, xy), flux, P)
    with pytest.raises(ValueError, match="P_px"):
        bayes.identify_near(PARAMS, MODEL, pairs, unit_vectors(CAMERA, xy), flux, (q_ic, np.eye(3)), P)
    with pytest.raises(ValueError, match="shape"):
        bayes.identify(PARAMS, MODEL, pairs, unit_vectors(CAMERA, xy), flux, P[:-1])
    with pytest.raises(ValueError, match="shape"):
        bayes.identify(PARAMS, MODEL, pairs, unit_vectors(CAMERA, xy), flux, P[:, 0])
