"""Terms of the odds of an attitude, one at a time, as densities and probabilities of textbooks."""

from types import SimpleNamespace

import numpy as np
import pytest
from plain import plain
from scipy import integrate, stats

from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.onboard.startracker.identify import bayes, evidence, odds, screen, verify
from shefex_nav.onboard.startracker.identify.evidence import Prior, Scene
from shefex_nav.records import Reason

C_CI = dcm_from_rotvec(np.array([0.3, -1.0, 0.4]))
F = 1000.0


def scene_of(xy_px, mag=None, has_flux=True, ellipses=None, border=5.0):
    xy_px = np.array(xy_px, dtype=float).reshape(-1, 2)
    mag = np.zeros(len(xy_px)) if mag is None else np.array(mag, dtype=float)
    return Scene(xy_px, mag, has_flux, 660.0, 490.0, F, 329.5, 244.5, border, 0.2, 0.25, ellipses)


def view_of(xy_px, det, distance2=None, row=None):
    n = len(det)
    return evidence.View(
        np.arange(n) if row is None else np.array(row), np.array(xy_px, dtype=float).reshape(-1, 2),
        np.array(det, dtype=np.int64), np.zeros(n) if distance2 is None else np.array(distance2),
        np.empty(64, dtype=np.int64), np.empty(160),
    )  # fmt: skip


def test_lost_in_space_any_attitude_is_as_likely():
    """1/(8 pi^2) over all rotations: by angle, 4 pi times the integral of 2 (1 - cos a) da is 8 pi^2."""
    whole, _ = integrate.quad(lambda a: 4.0 * np.pi * 2.0 * (1.0 - np.cos(a)), 0.0, np.pi)
    nothing = Prior(False, C_CI, np.eye(3))
    got = plain(odds.attitude_odds)(nothing, C_CI, np.eye(4), 0.2)
    assert np.exp(got) * whole == pytest.approx(1.0)


def test_a_prediction_is_a_normal_density_of_twice_its_covariance():
    """And the attitude's own uncertainty on it, by the diagonal of its factor. Six turns, no two alike."""
    rng = np.random.default_rng(1)
    A = 0.02 * rng.standard_normal((3, 3))
    P, L, noise_px = A @ A.T + 1e-5 * np.eye(3), np.diag([200.0, 300.0, 50.0, 1.0]), 0.2
    S = 2.0 * P + np.diag((noise_px / np.array([200.0, 300.0, 50.0])) ** 2)
    for _ in range(6):
        phi = rng.multivariate_normal(np.zeros(3), P)
        got = plain(odds.attitude_odds)(Prior(True, C_CI, P), dcm_from_rotvec(phi) @ C_CI, L, noise_px)
        assert got == pytest.approx(stats.multivariate_normal(np.zeros(3), S).logpdf(phi), rel=1e-6)


def test_a_prediction_half_a_turn_off_is_far_off():
    """The sine of half a turn is none; the turn about z is pi, of a sigma of 20 deg."""
    prior, known = Prior(True, C_CI, np.radians([1.0, 1.0, 20.0]) ** 2 * np.eye(3)), np.diag([1e6] * 4)
    odds_at = [
        plain(odds.attitude_odds)(prior, dcm_from_rotvec(np.array([0.0, 0.0, angle])) @ C_CI, known, 0.2)
        for angle in (0.0, 0.5 * np.pi, np.pi - 1e-9)
    ]
    squares = np.array([0.0, 0.5, 1.0]) ** 2 * np.pi**2 / (2.0 * np.radians(20.0) ** 2)
    np.testing.assert_allclose(odds_at[0] - np.array(odds_at), 0.5 * squares, atol=1e-6)


def test_the_focal_length_has_a_prior_that_is_one_in_all():
    """A probability that it is right, a normal density of ln f where it is not: together one."""
    scene = scene_of([(0.0, 0.0)])
    free = plain(odds.focal_odds)
    off, _ = integrate.quad(lambda s: np.exp(free(scene, F * np.exp(s), 4)), -0.05, 0.05, points=[0.0])
    assert np.exp(free(scene, F, 3)) + off == pytest.approx(1.0, abs=1e-6)
    assert free(scene, F, 4) > free(scene, 1.001 * F, 4) > free(scene, 0.99 * F, 4)
    assert np.exp(free(scene, F, 3)) == pytest.approx(0.8)
    sigma = np.sqrt(-0.5 * 0.01**2 / (free(scene, F * np.exp(0.01), 4) - free(scene, F, 4)))
    assert sigma == pytest.approx(0.004)


def brightness(mag, vmag, zero, det=None, has_flux=True, catalogue=None):
    """Odds of brightnesses; densities of the catalogue's magnitudes are those of a table 0.1 n."""
    vmag = np.array(vmag)
    catalogue = vmag if catalogue is None else np.array(catalogue)
    stars = SimpleNamespace(vmag=catalogue, log_density=-1.0 - 0.1 * np.arange(len(catalogue)))
    det = np.arange(len(vmag)) if det is None else det
    view = view_of(np.zeros((len(det), 2)), det)
    return plain(odds.brightness_odds)(
        stars, scene_of(np.zeros((len(mag), 2)), mag, has_flux), view, len(det), zero
    )


def test_brightnesses_against_their_densities():
    """Two normal densities and a floor, against that of the catalogue; the zero point costs its prior.

    0.65 of the stars scatter by sigma, 0.25 by 2.5 sigma, 0.1 evenly over 8 mag; a tenth of the frames say
    nothing.
    """
    mag, vmag, sigma, zero = np.array([-8.0, -7.1, -6.6, -5.0]), np.array([2.0, 3.0, 3.1, 4.2]), 0.25, -10.0
    d = mag[:3] - vmag[:3] - zero
    density = 0.65 * stats.norm.pdf(d, scale=sigma) + 0.25 * stats.norm.pdf(d, scale=2.5 * sigma) + 0.1 / 8.0
    each = np.log(density) - np.array([-1.0, -1.1, -1.2])
    expected = np.median(mag) - vmag[2]  # the middle of the catalogue, as it is sorted
    prior = stats.norm.logpdf(zero, expected, 0.7) - stats.norm.logpdf(0.0, 0.0, sigma / np.sqrt(3.0))
    wanted = np.logaddexp(np.log(0.9) + each.sum() + prior, np.log(0.1))
    assert brightness(mag, vmag, zero, det=np.array([0, 1, 2, -1])) == pytest.approx(wanted, abs=0.01)
    assert brightness(mag, vmag, zero, has_flux=False) == 0.0
    assert brightness(mag, vmag, 90.0) == pytest.approx(np.log(0.1), abs=1e-6)  # at most that much is lost


def test_the_zero_point_is_the_median_of_the_matched():
    stars = SimpleNamespace(vmag=np.array([1.0, 2.0, 3.0, 4.0]))
    scene, view = scene_of(np.zeros((3, 2)), [-9.0, -7.5, -6.0]), view_of(np.zeros((4, 2)), [0, -1, 1, 2])
    assert plain(odds.zero_point)(stars, scene, view, 4) == -10.0  # of -10, -10.5, -10


def test_factorials():
    assert odds.LOG_FACTORIAL[:7].tolist() == pytest.approx(np.log([1, 1, 2, 6, 24, 120, 720]))
    assert len(odds.LOG_FACTORIAL) == screen.MAX_DETECTIONS + 1


@pytest.mark.parametrize("n, crowded", [(3, True), (2, False)])
def test_a_crowd_is_more_likely_chance_by_its_density(n, crowded):
    """Of three neighbours within r the density is 3/(pi r^2): beyond four times the usual it counts."""
    far = [(600.0, 40.0), (40.0, 400.0), (300.0, 60.0), (90.0, 90.0), (500.0, 300.0), (350.0, 450.0)]
    near = [(200.0 + r, 250.0) for r in (3.0, 7.0, 12.0)][:n]
    scene = scene_of([(200.0, 250.0), *near, *far])
    of_det = np.full(len(scene.xy_px), -1.0)
    of_det[0] = 0.0
    got = plain(odds.crowding_of)(scene, of_det)
    usual = 4.0 * len(scene.xy_px) / (660.0 * 490.0)
    assert got[0] == (pytest.approx(np.log(3.0 / (np.pi * 144.0) / usual)) if crowded else 0.0)
    assert not got[1:].any()


@pytest.mark.parametrize("a, b", [(0.0, -1.0), (-700.0, -3.0), (5.0, 5.0), (-np.inf, 2.0), (800.0, 790.0)])
def test_sums_of_probabilities_are_told_by_their_logarithms(a, b):
    assert plain(odds.add_logs)(a, b) == pytest.approx(np.logaddexp(a, b))
    assert plain(odds.add_logs)(-np.inf, -np.inf) == -np.inf


def test_stars_near_the_border_or_beside_a_brighter_one_may_be_missing():
    """Those at least 5 px inside, and 8 px from any brighter one, should be seen."""
    places = [
        (100.0, 100.0), (107.9, 100.0), (100.0, 108.1), (4.9, 50.0), (5.1, 150.0), (50.0, 4.9), (150.0, 5.1),
        (654.1, 70.0), (653.9, 170.0), (70.0, 484.1), (170.0, 483.9),
    ]  # fmt: skip
    view, scene = view_of(places, [-1] * len(places)), scene_of([(0.0, 0.0)])
    due = [plain(odds._is_due)(scene, view, len(places), s) for s in range(len(places))]
    assert due == [True, False, True, False, True, False, True, False, True, False, True]


def test_detection_falls_softly_with_magnitude():
    """A logistic of 0.17 mag: halves within 0.19 mag, and a few far fainter ones are seen."""

    def share(vmag, limit):
        return plain(odds.detectable)(np.exp((vmag - limit) / 0.17))

    assert share(2.0, 6.0) == pytest.approx(1.0) and share(12.0, 6.0) == pytest.approx(0.03)
    assert share(6.0, 6.0) == pytest.approx(0.5 * 1.03)
    logistic = stats.logistic(loc=6.0, scale=0.17)
    for vmag in (5.5, 5.81, 6.19, 6.7):
        assert share(vmag, 6.0) == pytest.approx(0.03 + 0.97 * logistic.sf(vmag))


@pytest.mark.parametrize("n, has_flux", [(4, True), (4, False), (150, True)])
def test_a_pattern_has_the_probability_of_each_star(n, has_flux):
    """For each share and limit the product over the stars, also of so many that it is no number any longer.

    Of a limit that is brighter than the catalogue's, a half for each detection that is fainter by 0.3 mag.
    """
    rng, faintest, zero = np.random.default_rng(n), 5.5, -9.0
    vmag, det = np.sort(rng.uniform(3.0, faintest, n)), np.where(np.arange(n) % 2, -1, np.arange(n) // 2)
    places = np.column_stack([20.0 + 60.0 * (np.arange(n) % 10), 20.0 + 30.0 * (np.arange(n) // 10)])
    mag = np.sort(rng.uniform(zero + 3.0, zero + 6.0, n // 2))
    stars, terms = SimpleNamespace(vmag=np.append(vmag, faintest)), []
    for step, prior in zip(odds.LIMITS, odds.LIMIT_WEIGHTS, strict=True):
        fainter = (mag > zero + faintest - step + 0.3).sum() if step > 0.0 and has_flux else 0
        for share, weight in zip(odds.SHARES, odds.SHARE_WEIGHTS, strict=True):
            p = share * (0.03 + 0.97 * stats.logistic(faintest - step, 0.17).sf(vmag))
            pattern = np.log(np.where(det >= 0, p, 1.0 - p)).sum()
            terms.append(np.log(prior * weight) + pattern + fainter * np.log(0.5))
    scene, view = scene_of(np.zeros((n // 2, 2)), mag, has_flux), view_of(places, det)
    got = plain(odds.completeness_odds)(stars, view, n, scene, zero)
    assert got == pytest.approx(np.logaddexp.reduce(terms), abs=1e-9)


def test_many_stars_that_are_missing_do_not_underflow():
    """150 bright stars, none of them seen: 45 per cent are missing each at the very best."""
    n = 150
    places = np.column_stack([20.0 + 60.0 * (np.arange(n) % 10), 20.0 + 30.0 * (np.arange(n) // 10)])
    stars, view = SimpleNamespace(vmag=np.append(np.full(n, 2.0), 9.0)), view_of(places, [-1] * n)
    got = plain(odds.completeness_odds)(stars, view, n, scene_of([(0.0, 0.0)], [-9.0]), -18.0)
    wanted = np.log(0.1) + n * np.log(0.45)
    assert got == pytest.approx(wanted, abs=0.3) and got < wanted


def test_odds_of_places_with_a_focal_length_that_is_free():
    """The volume of a fourth parameter; without a flux the brightest are no better data than the others.

    One matched star of three detections: N = 1/3 of chance, and no choice of how many are data.
    """
    scene, view = scene_of([(100.0, 100.0), (300.0, 50.0), (500.0, 400.0)], has_flux=False), None
    view = view_of([(100.0, 100.0), (40.0, 400.0)], [0, -1], [0.09, 0.0])
    log_det, total = 30.0, []
    for scale, weight in zip((1.0, 1.8, 3.4), (0.45, 0.28, 0.27), strict=True):
        s = scale * 0.2
        density = (
            0.94 * np.exp(-0.045 / s**2) / s**2 + 0.06 * np.exp(-0.045 / (4 * s) ** 2) / (4 * s) ** 2
        ) / (2 * np.pi)
        volume = 2.0 * np.log(2.0 * np.pi * s**2) - 0.5 * log_det
        total.append(np.log(weight) + volume + np.log(660.0 * 490.0 * density / 3.0))
    got = plain(odds.place_odds)(scene, view, 2, log_det, 4)
    assert got == pytest.approx(np.logaddexp.reduce(total))


@pytest.mark.parametrize("brightest", [True, False])
def test_where_brightness_counts_the_brightest_detections_may_be_all_the_data(brightest):
    """With 0.8 all n detections are data, with 0.2/n each number of the brightest; the likeliest way counts.

    One of three is matched: the first, and one or no false one beside it, or the last, and all count.
    """
    place = (100.0, 100.0) if brightest else (500.0, 400.0)
    scene = scene_of([(100.0, 100.0), (300.0, 50.0), (500.0, 400.0)], [-9.0, -8.0, -7.0])
    view, log_det, total = view_of([place], [0 if brightest else 2], [0.09]), 30.0, []
    for scale, weight in zip((1.0, 1.8, 3.4), (0.45, 0.28, 0.27), strict=True):
        s = scale * 0.2
        density = (
            0.94 * np.exp(-0.045 / s**2) / s**2 + 0.06 * np.exp(-0.045 / (4 * s) ** 2) / (4 * s) ** 2
        ) / (2 * np.pi)
        match, volume = np.log(660.0 * 490.0 * density), 1.5 * np.log(2.0 * np.pi * s**2) - 0.5 * log_det
        ways = [np.log(0.8) + match - np.log(3.0)]  # of 3 data one is matched: 2!/3!
        if brightest:
            ways += [np.log(0.2 / 3.0) + match, np.log(0.2 / 3.0) + match - np.log(2.0)]
        else:
            ways += [np.log(0.2 / 3.0)] * 2  # no match among the first or the first two
        total.append(np.log(weight) + volume + max(ways))
    assert plain(odds.place_odds)(scene, view, 1, log_det, 3) == pytest.approx(np.logaddexp.reduce(total))


@pytest.mark.parametrize("seen, grows", [(0.5, False), (1.0, False), (9.0, True)])
def test_an_unknown_variance_makes_errors_of_students_distribution(seen, grows):
    """chi2 of 6 degrees and 4 of what was told: factor (4 + chi2)/10, what exceeds 1 times 10/8."""
    chi2 = 10.0 * seen - 4.0
    wanted = 1.0 + (seen - 1.0) * stats.t(10).var() if grows else seen
    assert plain(bayes.variance_seen)(chi2, 6) == pytest.approx(wanted)


def best_of(score, k=5):
    star = np.full(8, -1, dtype=np.int64)
    star[:k] = 10 + np.arange(k)
    A = np.random.default_rng(4).standard_normal((4, 4))
    L = np.linalg.cholesky(A @ A.T + 1e6 * np.eye(4))
    return SimpleNamespace(C=C_CI, star=star, trial_C=np.zeros((3, 3)), L=L, score=np.array(score))


def task_of(score, min_stars=4, threshold=15.0, error_px=0.2):
    scene = SimpleNamespace(centroid_error=error_px)
    return SimpleNamespace(
        best=best_of(score), threshold=threshold, min_stars=min_stars, stars=None, scene=scene, room=None
    )


def told(monkeypatch, score, badly=(False, 0.0, 0.0), leans=False, image=False, neighbour=False, **task):
    """Verdict with given answers of the doubts."""
    monkeypatch.setattr(bayes, "margin", lambda task: task.best.score[0] - max(task.best.score[1], 0.0))
    monkeypatch.setattr(bayes, "predict", lambda *a: 5)
    monkeypatch.setattr(bayes, "recall", lambda *a: None)
    monkeypatch.setattr(bayes, "fits_badly", lambda *a: badly)
    monkeypatch.setattr(bayes, "leans_on_one_star", lambda *a: leans)
    monkeypatch.setattr(bayes, "has_second_image", lambda *a: image)
    monkeypatch.setattr(bayes, "is_named_for_a_neighbour", lambda *a: neighbour)
    reason, denied, _ = plain(bayes.verdict)(task_of(score, **task))
    return Reason(reason).name if reason else "", denied


GOOD = [20.0, -3.0, 3.0, 0.5, F, 0.2]


def test_an_attitude_is_given_out_only_without_a_doubt(monkeypatch):
    assert told(monkeypatch, GOOD, badly=(False, 5.0, 9.0)) == ("", 5.0)
    assert told(monkeypatch, GOOD, badly=(True, 5.0, 9.0)) == ("RESIDUALS", 5.0)
    assert told(monkeypatch, GOOD, leans=True)[0] == told(monkeypatch, GOOD, image=True)[0] == "AMBIGUOUS"
    assert told(monkeypatch, GOOD, neighbour=True)[0] == "AMBIGUOUS"
    assert told(monkeypatch, [14.9, *GOOD[1:]])[0] == "NO_MATCH"
    assert told(monkeypatch, [15.0, *GOOD[1:]])[0] == ""
    assert told(monkeypatch, [20.0, 5.1, *GOOD[2:]])[0] == "AMBIGUOUS"  # a rival that is hardly worse
    assert told(monkeypatch, [20.0, 4.9, *GOOD[2:]])[0] == ""
    assert told(monkeypatch, [14.0, *GOOD[1:]], min_stars=9)[0] == "TOO_FEW_STARS"
    assert told(monkeypatch, [14.0, *GOOD[1:]], min_stars=8)[0] == "NO_MATCH"


def concluded(monkeypatch, score, reason=0, denied=0.0, nu=9.0, tracked=False, again=None):
    """Solution, what was looked at, the task; again: score and reason with the noise that a frame shows."""
    looked, verdicts = [], [(reason, denied, nu)]
    grown = task_of(again[0], error_px=1.0) if again else None

    def with_noise(task, growth):
        assert growth == pytest.approx(np.sqrt(denied)) and task.scene.centroid_error == 0.2
        verdicts.append((again[1], 0.0, 0.0))
        return grown

    monkeypatch.setattr(bayes, "margin", lambda task: task.best.score[0] - max(task.best.score[1], 0.0))
    monkeypatch.setattr(bayes, "verdict", lambda task: verdicts[-1])
    monkeypatch.setattr(bayes, "look", lambda *a: looked.append(a))
    monkeypatch.setattr(bayes, "with_noise", with_noise)
    numbers = SimpleNamespace(centroid_error=0.2, focal_px=F)
    task = task_of(score)
    found = bayes.Solution(*plain(bayes.conclude)(task, numbers, 12, 77, tracked))
    return found, looked, grown or task


def test_what_is_given_out_has_the_covariance_of_its_information(monkeypatch):
    """sigma^2 (L L')^-1, by the told sigma^2 times what the residuals say."""
    got, looked, task = concluded(monkeypatch, GOOD)
    information = (task.best.L @ task.best.L.T)[:3, :3]
    factor = (4.0 + 0.5 / 0.04) / (4.0 + 7.0)  # ten numbers, three parameters
    factor = 1.0 + (factor - 1.0) * stats.t(11).var()
    np.testing.assert_allclose(got.P_c, factor * 0.04 * np.linalg.inv(information), rtol=1e-9)
    assert got.star.tolist() == [10, 11, 12, 13, 14] + [-1] * 7 and not looked
    assert (got.reason, got.log_odds, got.work, got.tracked) == (0, 20.0, 77, False)
    four = [*GOOD[:2], 4.0, *GOOD[3:]]
    got, _, task = concluded(monkeypatch, four)
    whole = np.linalg.inv(task.best.L @ task.best.L.T)[:3, :3]
    factor = 1.0 + ((4.0 + 0.5 / 0.04) / (4.0 + 6.0) - 1.0) * stats.t(10).var()
    np.testing.assert_allclose(got.P_c, factor * 0.04 * whole, rtol=1e-9)
    refused, _, _ = concluded(monkeypatch, GOOD, reason=3)
    assert refused.reason == 3 and np.all(refused.star == -1) and len(refused.star) == 12
    assert np.isnan(refused.q_ci).all() and refused.P_c.shape == (3, 3) and np.isnan(refused.P_c).all()


def test_few_stars_that_deny_the_told_noise_have_that_of_their_neighbourhood(monkeypatch):
    """Which five squares tell, by Student's distribution; however large it is, no other fit is tried."""
    for denied in (30.0, 300.0):
        got, _, task = concluded(monkeypatch, GOOD, denied=denied, nu=5.0)
        information = (task.best.L @ task.best.L.T)[:3, :3]
        variance = 0.04 * denied * stats.t(5).var()
        np.testing.assert_allclose(got.P_c, variance * np.linalg.inv(information), rtol=1e-9)
        refused, _, _ = concluded(monkeypatch, GOOD, int(Reason.RESIDUALS), denied, nu=5.0)
        assert refused.reason == Reason.RESIDUALS


@pytest.mark.parametrize("reason", [0, int(Reason.RESIDUALS)])
def test_a_frame_that_denies_the_told_noise_is_judged_by_the_one_it_shows(monkeypatch, reason):
    weaker = [16.0, -3.0, 3.0, 0.5, F, 1.0]
    got, _, task = concluded(monkeypatch, GOOD, reason, 30.0, again=(weaker, 0))
    information = (task.best.L @ task.best.L.T)[:3, :3]
    variance = 0.5 / 7.0 * stats.t(7).var()  # of the residuals alone
    np.testing.assert_allclose(got.P_c, variance * np.linalg.inv(information), rtol=1e-9)
    assert got.reason == 0 and got.log_odds == 16.0
    assert got.false_probability == pytest.approx(0.003 * np.exp(-16.0))
    for score, after in (([14.9, *weaker[1:]], 0), (weaker, int(Reason.RESIDUALS))):
        got, _, _ = concluded(monkeypatch, GOOD, reason, 30.0, again=(score, after))
        assert got.reason == Reason.RESIDUALS and np.isnan(got.q_ci).all()
    assert concluded(monkeypatch, GOOD, int(Reason.AMBIGUOUS), 30.0)[0].reason == Reason.AMBIGUOUS
    assert concluded(monkeypatch, GOOD, reason, 144.0)[0].reason == Reason.RESIDUALS  # how much, is not seen


@pytest.mark.parametrize("n_par, growth", [(3, 4.0), (4, 4.0), (3, 80.0)])
def test_another_noise_is_that_of_all_that_is_looked_at_again(monkeypatch, n_par, growth):
    """From the attitude and the focal length that were found, the focal length free if it was; the prior and
    the rival stay."""
    looked = []
    monkeypatch.setattr(bayes, "look", lambda *a: looked.append(a))
    fields = {name: object() for name in bayes.Task._fields}
    score = np.array([20.0, 3.0, n_par, 0.5, 1.01 * F, 0.2])
    told = bayes.Scene(*[object() for _ in bayes.Scene._fields])._replace(centroid_error=0.15)
    task = bayes.Task(**fields)._replace(scene=told, best=best_of(score))
    again = plain(bayes.with_noise)(task, growth)
    (asked, focal_px, gate_px, lever, free) = looked[0]
    assert asked is again and focal_px == 1.01 * F and free == (n_par == 4)
    assert gate_px == pytest.approx(min(4.5 * 0.15 * growth, 10.0)) and lever.near2 == gate_px**2
    assert again.scene == told._replace(centroid_error=0.15 * growth)
    assert again._replace(scene=told, best=task.best) == task
    np.testing.assert_array_equal(again.best.trial_C, task.best.C)
    assert again.best.score.tolist() == [-np.inf, 3.0, 3.0, 0.0, 1.0, 1.0]


@pytest.mark.parametrize("nu", [2.75, 4.25, 11.0, 25.0])
def test_the_tail_of_an_attitude_whose_noise_the_residuals_tell(nu):
    """A bound of Student's tail, and not twice as large where it matters."""
    for sigma_deg in (0.01, 0.05, 0.1, 0.2):
        P_c = np.diag([1.0, 2.0, 7.0]) * np.radians(sigma_deg) ** 2 / 10.0
        x = 0.5 / sigma_deg * np.sqrt(nu / (nu - 2.0))
        tail = 2.0 * stats.t(nu).sf(x)
        assert tail < plain(bayes.beyond)(P_c, nu) < 2.0 * tail


def test_noise_of_another_size_needs_an_attitude_that_is_well_known(monkeypatch):
    """Residuals of five times the told error, of ten numbers less three: 0.5 deg once in a thousand."""
    for chi2, beyond, reason in (
        (0.99, 2e-3, 0), (1.01, 2e-3, int(Reason.RESIDUALS)), (1.01, 0.9e-3, 0)
    ):  # fmt: skip
        monkeypatch.setattr(bayes, "beyond", lambda P_c, nu, beyond=beyond: beyond)
        score = [*GOOD[:3], chi2 * 7.0 * (5.0 * 0.2) ** 2, *GOOD[4:]]
        for again in (None, (score, 0)):  # of the told error, also after another fit
            got = concluded(monkeypatch, score, denied=30.0 if again else 0.0, again=again)[0]
            assert got.reason == reason and np.isnan(got.P_c).all() == np.isnan(got.q_ci).all() == (
                reason > 0
            )
            assert (got.star >= 0).any() == (reason == 0)


def test_the_expected_number_of_chance_attitudes(monkeypatch):
    """0.003 exp(-ln B) of a search, exp(-ln B) near a prediction; a rival counts by its odds; one at most."""
    chance = lambda *a, **k: concluded(monkeypatch, *a, **k)[0].false_probability  # noqa: E731
    assert chance(GOOD) == pytest.approx(0.003 * np.exp(-20.0))
    assert chance(GOOD, tracked=True) == pytest.approx(np.exp(-20.0))
    assert chance([20.0, 3.0, *GOOD[2:]]) == pytest.approx(0.003 * np.exp(-20.0) + np.exp(-17.0))
    assert chance([-9.0, -9.0, *GOOD[2:]]) == 1.0


def test_a_noisy_frame_is_looked_at_again_with_its_focal_length_free(monkeypatch):
    noisy = [*GOOD[:5], 0.27]
    _, looked, task = concluded(monkeypatch, noisy)
    _, focal_px, gate_px, _, free = looked[0]
    assert focal_px == F and gate_px == pytest.approx(14.0 * 0.2) and free
    np.testing.assert_array_equal(task.best.trial_C, C_CI)
    for score in ([*GOOD[:5], 0.25], [14.0, *noisy[1:]], [*noisy[:2], 4.0, *noisy[3:]]):
        assert not concluded(monkeypatch, score)[1]


def test_nothing_found_is_worse_than_anything():
    best = plain(bayes.new_best)(3)
    assert best.score[0] == best.score[1] == -np.inf and np.all(best.star == -1)
    failed = verify.nothing(4, Reason.RESIDUALS)
    assert (
        failed.star.tolist() == [-1] * 4 and failed.reason == Reason.RESIDUALS and failed.log_odds == -np.inf
    )
