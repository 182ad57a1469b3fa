"""Adjusting an attitude on a sky of a few stars, and how a search is set up and judged around it."""

import numpy as np
import pytest
from plain import plain
from test_evidence_by_numbers import jacobians, random_ellipses, sky
from test_odds_by_numbers import C_CI, F, scene_of

from shefex_nav.geometry.rotation import dcm_from_rotvec, quat_from_dcm
from shefex_nav.onboard.startracker.identify import bayes, evidence, lever, odds, screen

PLACES = np.array([(60.0, 60.0), (600.0, 80.0), (90.0, 430.0), (560.0, 420.0), (330.0, 60.0), (120.0, 250.0)])
MIDDLE = np.array([329.5, 244.5])
STARS = sky(np.column_stack([(PLACES - MIDDLE) / F, np.ones(6)]))


@pytest.fixture(autouse=True)
def one_cell(monkeypatch):
    """The sky of a test is one cell, whichever way the camera looks."""
    cell = evidence.cell_of(0.0, 0.0, 1.0)
    monkeypatch.setattr(evidence, "cell_of", lambda *_: cell)


def adjusted(seen, turn=(0.0, 0.0, 0.0), gate_px=6.0, n_par=3, min_stars=4, ellipses=None):
    scene, view = scene_of(seen, ellipses=ellipses), evidence.new_view()
    C = dcm_from_rotvec(np.array(turn))
    trial, reach = evidence.Trial(C, F, n_par), plain(lever.no_lever)(gate_px)
    return plain(evidence.adjust)(STARS, scene, trial, view, gate_px, reach, min_stars), view, scene


@pytest.mark.parametrize("n_par", [3, 4])
def test_an_attitude_is_turned_until_its_stars_fit(n_par):
    """Off by 3 px: found to rounding, with the information of its stars and the noise that was told."""
    fit, view, scene = adjusted(PLACES, (2e-3, -1e-3, 3e-3), n_par=n_par)
    assert fit.n == 6 and fit.n_par == n_par and view.det[:6].tolist() == list(range(6))
    np.testing.assert_allclose(fit.C, np.eye(3), atol=1e-8)
    assert fit.focal_px == pytest.approx(F, rel=1e-8) and fit.noise_px == pytest.approx(0.2)
    J = jacobians(view._replace(xy_px=view.xy_px[:6], det=view.det[:6]), scene)[:, :, :n_par]
    N = np.einsum("sia,sib->ab", J, J)
    np.testing.assert_allclose(np.tril(fit.L)[:n_par, :n_par], np.linalg.cholesky(N), rtol=1e-3, atol=0.1)
    assert fit.log_det == pytest.approx(np.linalg.slogdet(N)[1], abs=1e-2)


def test_it_ends_with_the_first_step_that_moves_no_star(monkeypatch):
    """Off by 3 px, the first step is right and the second finds nothing to do; two stars beside need more."""
    times, predict = [], plain(evidence.predict)
    monkeypatch.setattr(evidence, "predict", lambda *given: times.append(1) or predict(*given))
    adjusted(PLACES, (2e-3, -1e-3, 3e-3))
    assert len(times) == 2


def test_it_does_not_end_with_a_star_beside_that_moves_nothing():
    """Two opposite stars, pulled outwards by 1.2 px, turn nothing; they are left out all the same."""
    seen = PLACES.copy()
    for k in (0, 3):
        outward = PLACES[k] - MIDDLE
        seen[k] += 1.2 * outward / np.linalg.norm(outward)
    fit, view, _ = adjusted(seen)
    assert np.flatnonzero(view.det[: fit.n] < 0).tolist() == [0, 3] and fit.noise_px == pytest.approx(0.2)


def test_a_focal_length_that_is_off_is_found_if_it_is_free():
    """A part in 200: 2 px at the corners, with noise that is told ten times smaller."""
    seen = MIDDLE + 1.005 * (PLACES - MIDDLE)
    free, _, _ = adjusted(seen, n_par=4)
    assert free.focal_px == pytest.approx(1.005 * F, rel=1e-7) and free.noise_px == pytest.approx(0.2)
    held, _, _ = adjusted(seen, n_par=3)
    assert held.focal_px == F and held.noise_px > 0.3


def test_a_field_that_does_not_hold_the_stars_is_no_fit():
    assert adjusted(PLACES[:3])[0].n == 0 and adjusted(PLACES[:3], min_stars=3)[0].n == 6
    assert adjusted(PLACES, (0.0, 0.02, 0.0))[0].n == 0  # 20 px beside
    far = PLACES.copy()
    far[0] += [0.0, 5.0]  # within the first gate and not within 14 centroid errors
    fit, view, _ = adjusted(far)
    assert view.det[0] == -1 and fit.n == 6
    np.testing.assert_allclose(fit.C, np.eye(3), atol=1e-7)
    near = PLACES.copy()
    near[0] += [0.0, 1.2]  # within 14 of the told noise, not within 4.5 of what is seen
    fit, view, _ = adjusted(near)
    assert view.det[0] == -1 and np.abs(fit.C - np.eye(3)).max() < 1e-7


def test_two_stars_do_not_tell_three_angles_about_their_line():
    """Three at one place: singular, no fit."""
    one = sky(np.tile([[0.0, 0.0, 1.0]], (4, 1)))
    scene, view = scene_of(np.tile(MIDDLE, (4, 1)) + 1e-3 * np.arange(8).reshape(4, 2)), evidence.new_view()
    fit = plain(evidence.adjust)(
        one, scene, evidence.Trial(np.eye(3), F, 3), view, 6.0, plain(lever.no_lever)(6.0), 1
    )
    assert fit.n == 0 and fit.log_det == -np.inf


def test_errors_that_are_not_round_are_weighed():
    """Detections off along their long axes are as good: the attitude stays where the short ones say."""
    rng = np.random.default_rng(3)
    ellipses = random_ellipses(rng, 6)
    fit, view, _ = adjusted(PLACES, (1e-4, -1e-4, 2e-4), ellipses=ellipses, gate_px=3.0)
    assert fit.n == 6 and view.det[:6].tolist() == list(range(6))
    np.testing.assert_allclose(fit.C, np.eye(3), atol=1e-8)


def test_odds_are_the_product_of_their_terms(monkeypatch):
    calls = {}

    def given(name, value):
        def term(*arguments):
            calls[name] = arguments
            return value

        return term

    for k, name in enumerate(("place", "attitude", "focal", "brightness", "completeness")):
        monkeypatch.setattr(odds, f"{name}_odds", given(f"{name}_odds", 2.0**k))
    monkeypatch.setattr(odds, "zero_point", lambda *given: -11.0)
    fit = evidence.Fit(C_CI, 999.0, 4, 6, np.eye(4), 17.0, 0.3)
    assert plain(odds.log_odds)("stars", "scene", "prior", "view", fit) == 31.0
    assert calls["place_odds"] == ("scene", "view", 6, 17.0, 4)
    assert calls["attitude_odds"][2] is fit.L and calls["attitude_odds"][3] == 0.3
    assert calls["focal_odds"] == ("scene", 999.0, 4)
    assert calls["brightness_odds"][-1] == calls["completeness_odds"][-1] == -11.0


def solved(monkeypatch, n=9, P=1e-8, known=True, q=None, reasons=(5, 0), fewest=4):
    """How `solve_kernel` searches: (searches, conclusions) with tasks as they were given."""
    searches, concluded = [], []
    monkeypatch.setattr(
        bayes, "new_seen", lambda scene, ellipses: screen.Seen(None, scene.xy_px, ellipses, None, None)
    )
    monkeypatch.setattr(bayes, "track", lambda task, budget: searches.append(("track", task, budget)) or 10)
    monkeypatch.setattr(
        bayes, "lost_in_space", lambda task, pairs, budget: searches.append(("lost", task, budget)) or 100
    )

    def conclude(task, numbers, number, work, tracked):
        concluded.append((task, number, work, tracked))
        return (reasons[0] if tracked else reasons[1], "tracked" if tracked else "lost")

    monkeypatch.setattr(bayes, "conclude", conclude)
    numbers = bayes.Numbers(660.0, 490.0, F, 329.5, 244.5, 5.0, 0.2, 0.25, 1e-7, fewest, 80_000)
    q = quat_from_dcm(C_CI.T) if q is None else q
    xy, mag = np.random.default_rng(1).uniform(0.0, 480.0, (n, 2)), np.arange(float(n))
    P_c = np.diag([P, 0.5 * P, 0.2 * P])
    got = plain(bayes.solve_kernel)(None, None, numbers, xy, mag, True, (known, q, P_c))
    return got, searches, concluded


def test_a_prediction_is_tried_first_and_then_nothing_is_assumed(monkeypatch):
    """Three stars near a narrow prediction, by the false alarms alone; without one CHANCE is in the limit."""
    got, searches, concluded = solved(monkeypatch)
    assert [name for name, *_ in searches] == ["track", "lost"] and got[1] == "lost"
    tracked, lost = (task for _, task, _ in searches)
    np.testing.assert_allclose(tracked.prior.C_ci, C_CI, atol=1e-12)
    assert tracked.prior.known and not lost.prior.known
    assert (tracked.min_stars, lost.min_stars) == (3, 4)
    strict = -np.log(1e-7)
    assert tracked.threshold == tracked.strict == pytest.approx(strict)
    assert lost.threshold == pytest.approx(np.log(0.003 / 1e-7))
    assert lost.strict == pytest.approx(strict + np.log(0.3))
    assert [(number, work, was) for _, number, work, was in concluded] == [(9, 10, True), (9, 110, False)]
    assert all(budget == 80_000 for *_, budget in searches)
    got, searches, _ = solved(monkeypatch, reasons=(0, 0))
    assert got[1] == "tracked" and len(searches) == 1


def test_when_a_prediction_is_no_use(monkeypatch):
    lost_only = lambda **given: [name for name, *_ in solved(monkeypatch, **given)[1]]  # noqa: E731
    assert lost_only(known=False) == ["lost"]
    assert lost_only(q=np.full(4, np.nan)) == ["lost"] and lost_only(P=np.nan) == ["lost"]
    assert lost_only(n=3) == ["track"] and lost_only(n=2) == []
    wide = solved(monkeypatch, P=np.radians(0.31) ** 2)[1]
    assert wide[0][1].min_stars == 4
    assert solved(monkeypatch, P=np.radians(0.29) ** 2)[1][0][1].min_stars == 3
    assert lost_only(n=3, P=1.0) == []
    many = solved(monkeypatch, n=500)
    assert len(many[1][0][1].scene.mag) == bayes.MAX_DETECTIONS and many[2][0][1] == 500
