"""Matching, adjusting and doubting an attitude, against arrays and a slow search; errors round and not."""

from types import SimpleNamespace

import numpy as np
import pytest
from plain import plain
from scipy import stats
from test_odds_by_numbers import F, scene_of, view_of

from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.onboard.startracker.identify import doubts, evidence, lever
from shefex_nav.onboard.startracker.identify.ellipses import ellipses_of
from shefex_nav.onboard.startracker.identify.evidence import Prior
from shefex_nav.onboard.startracker.tables import cell_of

SIGMA_PX = 0.2  # of `scene_of`


def random_ellipses(rng, n):
    """Ellipses of n centroids, axes between 0.5 and 3 times the error of an ordinary one."""
    A = rng.standard_normal((n, 2, 2))
    return ellipses_of(SIGMA_PX**2 * (A @ np.swapaxes(A, 1, 2) + 0.25 * np.eye(2)), SIGMA_PX)


def weights(ellipses, n):
    """(n, 2, 2)"""
    if ellipses is None:
        return np.tile(np.eye(2), (n, 1, 1))
    return ellipses.weight[:, [[0, 1], [1, 2]]]


def frame(seed, round_errors, n=8, n_false=3):
    """Scene with detections near n stars of a view, the detections shuffled; and the view."""
    rng = np.random.default_rng(seed)
    stars = rng.uniform([20.0, 20.0], [640.0, 470.0], (n, 2))
    seen = np.vstack([stars + 0.4 * rng.standard_normal((n, 2)), rng.uniform(0.0, 490.0, (n_false, 2))])
    order = rng.permutation(n + n_false)
    ellipses = None if round_errors else random_ellipses(rng, n + n_false)
    det = np.argsort(order)[:n]
    return scene_of(seen[order], ellipses=ellipses), view_of(stars, det)


def with_distances(scene, view):
    """The view with the weighted squared distances of its matches, from their definition."""
    d = scene.xy_px[view.det] - view.xy_px
    W = weights(scene.ellipses, len(scene.xy_px))[view.det]
    return view._replace(distance2=np.einsum("ki,kij,kj->k", d, W, d)), d, W


def jacobians(view, scene):
    """(n, 2, 4) px of places by a turn of the stars about the camera axes and by ln f, from differences."""
    J = np.empty((len(view.det), 2, 4))
    for s, (x, y) in enumerate((view.xy_px - [scene.cx_px, scene.cy_px]) / F):
        for k in range(3):
            turned = [dcm_from_rotvec(h * np.eye(3)[k]) @ [x, y, 1.0] for h in (1e-5, -1e-5)]
            J[s, :, k] = F * np.subtract(*[one[:2] / one[2] for one in turned]) / 2e-5
        J[s, :, 3] = F * x, F * y
    return J


@pytest.mark.parametrize("round_errors", [True, False])
def test_normal_equations_are_those_of_weighted_least_squares(round_errors):
    """Rows J^T W J and J^T W r; a residual of three times the noise counts half."""
    scene, view = frame(1, round_errors)
    view, d, W = with_distances(scene, view)
    noise_px = np.sqrt(view.distance2[0]) / 3.0
    view.det[-1] = -1
    J = jacobians(view, scene)
    robust = 1.0 / (1.0 + view.distance2 / (9.0 * noise_px**2))
    assert robust[0] == pytest.approx(0.5)
    used = slice(0, len(view.det) - 1)
    N_wanted = np.einsum("s,sia,sij,sjb->ab", robust[used], J[used], W[used], J[used])
    g_wanted = np.einsum("s,sia,sij,sj->a", robust[used], J[used], W[used], d[used])
    N, g = np.full((4, 4), 7.0), np.full(4, 7.0)
    plain(evidence.information)(scene, view, len(view.det), F, noise_px, N, g)
    np.testing.assert_allclose(N, np.tril(N_wanted), rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(g, g_wanted, rtol=1e-5, atol=1e-3)


def test_the_median_of_a_few_values():
    """Those that count, which are sorted; what stands behind them stays."""
    for values in ([4.0], [3.0, 1.0], [5.0, -2.0, 4.0], [2.0, 9.0, 7.0, 1.0, 7.0, 0.0]):
        room = np.array([*values, -100.0])
        assert plain(evidence.median)(room, len(values)) == np.median(values)
        assert room.tolist() == [*sorted(values), -100.0]


@pytest.mark.parametrize("n_par", [3, 4])
def test_factor_and_solution_of_normal_equations(n_par):
    A = np.random.default_rng(2).standard_normal((4, 4))
    N = A @ A.T + np.eye(4)
    N[n_par:] = N[:, n_par:] = 0.0
    L, g = np.tril(N), np.array([1.0, -2.0, 3.0, 0.0 if n_par == 3 else 4.0])
    wanted = np.linalg.solve(N[:n_par, :n_par], g[:n_par])
    log_det = plain(evidence.cholesky)(L, n_par)
    np.testing.assert_allclose(L[:n_par, :n_par], np.linalg.cholesky(N[:n_par, :n_par]), rtol=1e-12)
    assert log_det == pytest.approx(np.linalg.slogdet(N[:n_par, :n_par])[1])
    plain(evidence.solve_cholesky)(L, g, n_par)
    np.testing.assert_allclose(g[:n_par], wanted, rtol=1e-10)
    variances = np.linalg.inv(N[:n_par, :n_par]).diagonal()[:3].sum()
    assert plain(doubts._variances)(L, n_par) == pytest.approx(variances)


def test_equations_that_do_not_tell_have_no_determinant():
    u = np.array([1.0, 2.0, 3.0, 4.0])
    assert plain(evidence.cholesky)(np.outer(u, u), 4) == -np.inf
    assert plain(evidence.cholesky)(np.zeros((4, 4)), 3) == -np.inf
    assert plain(evidence.cholesky)(np.diag([1.0, 1.0, 1e-8, 0.0]), 3) == pytest.approx(np.log(1e-8))


@pytest.mark.parametrize("seed", range(4))
def test_a_turn_is_that_of_its_rotation_vector(seed):
    """To the square of the angle, and orthonormal to rounding."""
    rng = np.random.default_rng(seed)
    C, phi = dcm_from_rotvec(rng.standard_normal(3)), 1e-3 * rng.standard_normal(4)
    wanted = dcm_from_rotvec(phi[:3]) @ C
    plain(evidence.turn)(C, phi)
    np.testing.assert_allclose(C, wanted, atol=2.0 * (phi[:3] @ phi[:3]))
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(C) == pytest.approx(1.0)


@pytest.mark.parametrize("size, seen", [(0.1, 0.2), (0.5, 0.5), (9.0, 3.4 * 0.2)])
def test_the_noise_of_a_frame_is_that_of_the_median_distance(size, seen):
    """chi-square of two degrees has its median at 2 ln 2; within one and 3.4 times what was told."""
    d2 = size**2 * stats.chi2.median(2) * np.array([0.01, 1.0, 50.0, 7.0])
    view = view_of(np.zeros((4, 2)), [0, 1, 2, -1], d2)
    got = plain(evidence.noise_seen)(scene_of(np.zeros((3, 2))), view, 4)
    assert got == pytest.approx(seen, rel=1e-3)
    empty = view_of(np.zeros((1, 2)), [-1])
    assert plain(evidence.noise_seen)(scene_of(np.zeros((3, 2))), empty, 1) == 0.2


def mutual(cost, near):
    """Matches by a slow search: each star its cheapest near detection, each detection its nearest star."""
    chosen = np.where(near, cost, np.inf)
    best = chosen.argmin(axis=1)
    return np.where(np.isfinite(chosen.min(axis=1)), best, -1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("round_errors", [True, False])
def test_each_star_takes_its_likeliest_detection_and_each_detection_its_nearest_star(seed, round_errors):
    rng, gate_px, noise_px = np.random.default_rng(seed), 40.0, 5.0
    stars, seen = rng.uniform(0.0, 120.0, (7, 2)), rng.uniform(0.0, 120.0, (9, 2))
    ellipses = None if round_errors else random_ellipses(rng, 9)
    scene, view = scene_of(seen, ellipses=ellipses), view_of(stars, [-9] * 7)
    d = seen[None] - stars[:, None]
    d2 = np.einsum("ski,kij,skj->sk", d, weights(ellipses, 9), d)
    area = np.zeros(9) if round_errors else ellipses.log_area
    wanted = mutual(d2 + 2.0 * noise_px**2 * area, d2 < gate_px**2)
    for k in range(9):  # of the stars that want a detection the nearest has it
        rivals = [s for s in range(7) if wanted[s] == k]
        for s in rivals:
            if s != min(rivals, key=lambda s, k=k: d2[s, k]):
                wanted[s] = -1
    matches = plain(evidence.match)(scene, view, 7, gate_px, noise_px)
    assert view.det.tolist() == wanted.tolist() and matches == (wanted >= 0).sum() > 2
    found = wanted >= 0
    np.testing.assert_allclose(view.distance2[found], d2[np.flatnonzero(found), wanted[found]], rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_first_match_weighs_place_and_prediction_together(seed):
    """q = d^T (gate^2 (spread + lever))^-1 d within one; the likeliest by 12.25 q + ln det."""
    rng = np.random.default_rng(seed)
    stars = rng.uniform(100.0, 160.0, (7, 2))
    seen = np.vstack([stars[:5] + 1.5 * rng.standard_normal((5, 2)), rng.uniform(100.0, 160.0, (6, 2))])
    ellipses = random_ellipses(rng, 11)
    scene, view = scene_of(seen, ellipses=ellipses), view_of(stars, [-9] * 7)
    reach = lever.lever_of(scene, ellipses, 0, 1, 0.68)
    wanted, q_of = np.full(7, -1), np.zeros(7)
    for s in range(7):
        least = np.inf
        for k in range(11):
            d = seen[k] - stars[s]
            q, det = lever.gate_of(ellipses, reach, lever.reach_of(ellipses, reach, *stars[s]), k, *d)
            if np.all(np.abs(d) <= 10.0) and q < 1.0 and 3.5**2 * q + np.log(det) < least:
                least, wanted[s], q_of[s] = 3.5**2 * q + np.log(det), k, q
    for k in range(11):
        rivals = [s for s in range(7) if wanted[s] == k]
        for s in rivals:
            if s != min(rivals, key=lambda s: q_of[s]):
                wanted[s] = -1
    matches = plain(evidence.match_first)(scene, ellipses, view, 7, 40.0, reach, 5.0)
    assert view.det.tolist() == wanted.tolist() and matches == (wanted >= 0).sum() > 2
    found = wanted >= 0
    np.testing.assert_allclose(view.distance2[found], reach.gate2 * q_of[found], rtol=1e-9)


def test_a_detection_goes_to_the_nearer_of_two_stars_whichever_comes_first():
    for places, det in (([(0.0, 0.0), (1.5, 0.0)], [-1, 0]), ([(1.5, 0.0), (0.0, 0.0)], [0, -1])):
        view = view_of(places, [-9, -9])
        assert plain(evidence.match)(scene_of([(1.0, 0.0)]), view, 2, 3.0, 0.2) == 1
        assert view.det.tolist() == det
    assert plain(evidence.match)(scene_of([(3.0, 0.0)]), view_of([(0.0, 0.0)], [-9]), 1, 3.0, 0.2) == 0


def sky(directions):
    """Stars of a catalogue whose one cell holds them all."""
    u_i = np.array(directions, dtype=float)
    u_i /= np.linalg.norm(u_i, axis=1)[:, None]
    cell = cell_of(0.0, 0.0, 1.0)
    start = np.zeros(cell + 2, dtype=np.int64)
    start[cell + 1] = len(u_i)
    return SimpleNamespace(u_i=u_i, start=start, row=np.arange(len(u_i)))


def test_stars_are_predicted_where_a_pinhole_shows_them():
    """To two pixels outside; those behind the camera never, and no more than there is room for."""
    inside, width = (329.5, 244.5), 660.0
    places = [inside, (-1.9, 100.0), (-2.1, 100.0), (width + 0.9, 90.0), (width + 1.1, 90.0), (30.0, -1.9),
              (30.0, -2.1), (30.0, 490.9), (30.0, 491.1)]  # fmt: skip
    rays = [((x - 329.5) / F, (y - 244.5) / F, 1.0) for x, y in places] + [(0.0, 0.0, -1.0)]
    view = evidence.new_view()
    scene = scene_of([(0.0, 0.0)])
    n = plain(evidence.predict)(sky(rays), scene, np.eye(3), F, view)
    assert view.row[:n].tolist() == [0, 1, 3, 5, 7]
    np.testing.assert_allclose(view.xy_px[:n], np.array(places)[[0, 1, 3, 5, 7]], atol=1e-9)
    crowd = [(0.001 * k, 0.0, 1.0) for k in range(200)]
    assert plain(evidence.predict)(sky(crowd), scene, np.eye(3), F, view) == 160 == len(view.row)


def test_gates_after_the_first():
    scene, ellipses = scene_of([(0.0, 0.0)]), random_ellipses(np.random.default_rng(0), 1)
    after = plain(evidence.after_first)
    assert after(scene, None, 99.0) == pytest.approx(14.0 * 0.2) and after(scene, None, 1.0) == 1.0
    assert after(scene, ellipses, 1.0) == pytest.approx(14.0 * 0.2)
    near = view_of(np.zeros((3, 2)), [0, -1, 2], [0.9, 9.0, 0.8])
    assert plain(evidence._all_within)(near, 3, 1.0) and not plain(evidence._all_within)(near, 3, 0.9)


def task_of(scene, view, star=None, **rest):
    star = np.full(len(scene.xy_px), -1) if star is None else np.array(star)
    best = SimpleNamespace(star=star, C=np.eye(3), score=np.array([50.0, 0.0]))
    nothing = Prior(False, np.eye(3), np.eye(3))
    values = {"stars": None, "scene": scene, "room": view, "best": best, "prior": nothing, "strict": 16.0}
    return SimpleNamespace(**{**values, **rest})


@pytest.mark.parametrize("round_errors", [True, False])
def test_what_was_found_is_recalled(round_errors):
    scene, view = frame(3, round_errors, n=4, n_false=1)
    star = np.full(5, -1)
    star[view.det[0]], star[view.det[2]] = 0, 2
    wanted, _, _ = with_distances(scene, view)
    task = task_of(scene, view._replace(det=np.full(4, 7), distance2=np.full(4, 7.0)), star)
    plain(doubts.recall)(task, 4)
    assert task.room.det.tolist() == [view.det[0], -1, view.det[2], -1]
    np.testing.assert_allclose(task.room.distance2, wanted.distance2 * [1.0, 0.0, 1.0, 0.0])


def test_a_star_is_looked_for_around_its_place():
    """45 centroid errors, 3 px at least, 10 px at most; with ellipses 4.5 of the largest noise."""
    around = plain(doubts.around)
    for error, reach in ((0.1, 4.5), (0.01, 3.0), (0.9, 10.0)):
        assert around(scene_of([(0.0, 0.0)])._replace(centroid_error=error), None) == pytest.approx(reach)
    assert around(scene_of([(0.0, 0.0)]), "ellipses") == pytest.approx(4.5 * 3.4 * 0.2)


def misfit(size_px, n=12, n_par=3):
    """`fits_badly` of n stars, all of them so far from their detections."""
    places = np.column_stack([50.0 * np.arange(n), np.full(n, 200.0)])
    seen = places + size_px * np.array([0.6, 0.8])
    return plain(doubts.fits_badly)(task_of(scene_of(seen), view_of(places, [-9] * n)), n, n_par)


@pytest.mark.parametrize("n, n_par", [(12, 3), (8, 4)])
def test_residuals_beyond_the_largest_noise_are_bad(n, n_par):
    """Nine of twelve squares against 0.55 of the quantile of 3.1 sigma, of twice as many less parameters."""
    dof, kept = 2 * n - n_par, int(np.ceil(0.75 * n))
    limit = stats.chi2.isf(stats.norm.sf(3.1), dof)  # Wilson and Hilferty are good to a few thousandths
    rim = np.sqrt(0.55 * limit * (3.4 * 0.2) ** 2 / kept)
    assert misfit(0.99 * rim, n, n_par)[0] is np.False_ and misfit(1.01 * rim, n, n_par)[0]


def test_the_variance_that_is_seen_counts_where_it_denies_what_was_told():
    """Squares of 9 of 12 over their share of a right sum, 1 - (1 + ln 4)/4, and their number."""
    nu = 0.75 * 21 - 1.0
    rim = np.sqrt(4.0 * 0.4 * 21 * 0.04 / 9)
    assert misfit(0.999 * rim)[1] == 0.0
    seen = (1.001 * rim) ** 2 * 9 / (0.4 * 21 * 0.04)
    assert misfit(1.001 * rim)[1:] == pytest.approx((seen, nu))
    # one degree of freedom: nu of 2.5 at least
    assert misfit(2.0, n=2)[1:] == pytest.approx((2 * 4.0 / (0.4 * 0.04), 2.5))
    # three quarters of exponential squares have that share of their sum
    q = np.sort(np.random.default_rng(1).exponential(size=100_000))
    assert q[:75_000].sum() / q.sum() == pytest.approx(doubts.KEPT_MEAN, abs=0.01)


@pytest.mark.parametrize("round_errors", [True, False])
@pytest.mark.parametrize("n_par", [3, 4])
def test_leverage_is_a_stars_share_of_the_information(round_errors, n_par):
    scene, view = frame(5, round_errors)
    J = jacobians(view, scene)[:, :, :n_par]
    W = weights(scene.ellipses, len(scene.xy_px))[view.det]
    each = np.einsum("sia,sij,sjb->sab", J, W, J)
    N = np.zeros((4, 4))
    for s in range(len(view.det)):
        plain(doubts._add)(N, scene, view, s, F, n_par, 1.0)
    np.testing.assert_allclose(N[:n_par, :n_par], np.tril(each.sum(axis=0)), rtol=1e-5, atol=1e-2)
    L = np.zeros((4, 4))
    L[:n_par, :n_par] = np.linalg.cholesky(each.sum(axis=0))
    for s in range(len(view.det)):
        share = np.trace(np.linalg.solve(each.sum(axis=0), each[s]))
        assert plain(doubts._leverage)(L, scene, view, s, F, n_par) == pytest.approx(share, rel=1e-4)
    before = N.copy()
    plain(doubts._add)(N, scene, view, 0, F, n_par, -1.0)
    np.testing.assert_allclose((before - N)[:n_par, :n_par], np.tril(each[0]), rtol=1e-5, atol=1e-2)


CORNER = [(20.0, 20.0), (35.0, 20.0), (20.0, 37.0), (40.0, 40.0)]
FAR = (600.0, 450.0)


def leans(monkeypatch, places, without, known=None, noise_px=0.2):
    """Whether an attitude leans on one star, if the odds without any of them are given."""
    view = view_of(places, range(len(places)))
    prior = Prior(known is not None, np.eye(3), np.eye(3) if known is None else known**2 * np.eye(3))
    asked = []

    def odds_without(stars, scene, prior, view, fit):
        asked.append(int(np.flatnonzero(view.det < 0)[0]))
        J = jacobians(view, scene)[view.det >= 0, :, : fit.n_par]  # the information of the others
        assert fit.log_det == pytest.approx(np.linalg.slogdet(np.einsum("sia,sib->ab", J, J))[1], rel=1e-5)
        assert fit.log_det == pytest.approx(2.0 * np.log(np.diag(fit.L)[: fit.n_par]).sum())
        return without

    monkeypatch.setattr(doubts, "log_odds", odds_without)
    found = plain(doubts.leans_on_one_star)(
        task_of(scene_of(places), view, prior=prior), len(places), F, noise_px, 3
    )
    assert view.det.tolist() == list(range(len(places)))
    return bool(found), asked


def test_a_star_that_sets_the_turn_must_prove_itself(monkeypatch):
    """Four stars in a corner and one far off: without it their turn is known to 0.2 px in 15, 0.5 deg."""
    assert leans(monkeypatch, [*CORNER, FAR], 33.9) == (False, [4])  # better by 16 with it
    assert leans(monkeypatch, [*CORNER, FAR], 34.1) == (True, [4])
    spread = [(20.0, 20.0), (640.0, 30.0), (30.0, 470.0), (630.0, 460.0), (330.0, 250.0)]
    assert leans(monkeypatch, spread, 99.0) == (False, [])
    assert leans(monkeypatch, [*CORNER, FAR], 99.0, noise_px=0.002) == (False, [])  # good enough without


def test_a_prediction_counts_with_the_other_stars(monkeypatch):
    """Known to 0.05 deg about each axis the corner alone is enough, known to 2 deg it is not."""
    assert leans(monkeypatch, [*CORNER, FAR], 99.0, known=np.radians(0.03)) == (False, [])
    assert leans(monkeypatch, [*CORNER, FAR], 99.0, known=np.radians(2.0)) == (True, [4])


def second(shifts, noise_px=0.2, others=0, ellipses=None):
    """Whether detections at stars moved by `shifts`, and others, look like a second image."""
    rng = np.random.default_rng(3)
    stars = np.array(
        [(60.0, 60.0), (600.0, 80.0), (90.0, 430.0), (560.0, 420.0), (330.0, 60.0), (100.0, 250.0)]
    )
    moved = [stars[k] + shift for k, shift in enumerate(shifts)]
    seen = np.vstack([stars, *moved, rng.uniform([200.0, 150.0], [500.0, 380.0], (others, 2))])
    star = np.where(np.arange(len(seen)) < 6, np.arange(len(seen)), -1)
    view = view_of(stars, range(6))
    return bool(
        plain(doubts.has_second_image)(task_of(scene_of(seen, ellipses=ellipses), view, star), 6, noise_px)
    )


def test_four_detections_with_the_same_shift_are_a_second_image():
    shift = np.array([31.0, -12.0])
    assert second([shift] * 4) and not second([shift] * 3)
    assert not second([shift * 80.5 / np.linalg.norm(shift)] * 4)  # further than a reflection goes
    assert second([shift * 79.5 / np.linalg.norm(shift)] * 4)
    assert not second([np.array([3.9, 0.0])] * 4) and second([np.array([4.1, 0.0])] * 4)  # part of the star
    apart = [
        shift + np.array([0.0, 0.35 * k]) for k in range(4)
    ]  # 5 noise_px, from one of them to the others
    assert second(apart, 0.2) and not second(apart, 0.1)
    wide = [shift + np.array([0.0, 1.6 * k]) for k in range(4)]
    assert not second(wide, 9.0)  # 1.5 px at most


def test_stars_turned_about_the_axis_are_a_second_image():
    stars = np.array([(60.0, 60.0), (600.0, 80.0), (90.0, 430.0), (560.0, 420.0)])
    turned = [2.0 * np.array([329.5, 244.5]) - 2.0 * one for one in stars]
    assert second(turned) and not second(turned[:3])


def test_shifts_are_compared_with_the_ellipses_of_both():
    """Detections three times as uncertain along the way they are apart are the same shift further apart."""
    shift = np.array([31.0, -12.0])
    apart = [shift, shift + np.array([0.0, 1.1])] * 2
    assert not second(apart, 0.2)
    P = np.tile(0.04 * np.diag([1.0, 9.0]), (10, 1, 1))
    assert second(apart, 0.2, ellipses=ellipses_of(P, 0.2))
