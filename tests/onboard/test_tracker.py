"""The chain on frames: right attitudes, honest sigmas, a reason for every frame without one."""

import numpy as np
import pytest
from star_fields import (
    CAMERA,
    DEG,
    EXPOSURE,
    TRACKER,
    all_stars,
    random_attitude,
    ready_tracker,
    sky_frame,
    stars_in_frame,
    tracker_with,
)

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply, rotvec_between
from shefex_nav.onboard.startracker import best_attitude, tracker
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.records import Detections, Frame, Reason

VELOCITY = np.array([-29500.0, 3000.0, 1500.0])  # m/s: the Earth's, and a rocket's
CONTEXT = tracker.NO_CONTEXT._replace(velocity_i=VELOCITY)


def frame(image_dn, number=0, exposure_s=0.05):
    return Frame(number, 1.0, 1.0 + 0.5 * exposure_s, 1.065, exposure_s, EXPOSURE.gain, image_dn)


def process(image_dn, context=CONTEXT):
    ready = ready_tracker()
    state, _ = tracker.start(ready, 0.9)
    return tracker.step(ready, state, frame(image_dn), context)


def seen_sky():
    """On-board catalogue as the moving vehicle sees it."""
    stars = ready_tracker().pairs.stars
    return stars._replace(u_i=aberrate(stars.u_i, VELOCITY))


def sky_with_stars(rng, least=7):
    while True:
        q_ic = random_attitude(rng)
        if len(stars_in_frame(seen_sky(), q_ic, margin_px=5.0)[0]) >= least:
            return q_ic


def test_frames_of_the_whole_sky():
    """Static and at 2 deg/s: nothing wrong, better than 0.1 deg about each axis, sigmas honest."""
    rng = np.random.default_rng(1)
    sky, normalised = seen_sky(), []
    n_possible = n_solved = 0
    for k in range(60):
        q_ic = random_attitude(rng)
        n_possible += len(stars_in_frame(sky, q_ic, margin_px=5.0)[0]) >= 4
        image_dn = sky_frame(rng, sky, q_ic, streak_px=4.4 * (k % 2), angle=rng.uniform(0.0, np.pi))
        _, fix, _ = process(image_dn)
        assert len(fix.hip) == len(fix.detections.flux_dn)
        if fix.reason != Reason.NONE:
            assert np.isnan(fix.q_ic).all() and np.isnan(fix.P_c).all() and np.isnan(fix.residual_px)
            continue
        n_solved += 1
        error = rotvec_between(fix.q_ic, q_ic)
        assert (np.abs(error) < 0.1 * DEG).all()
        assert fix.residual_px < 0.5
        normalised.append(error @ np.linalg.solve(fix.P_c, error))
    assert n_solved >= n_possible - 2
    # 3 if the sigmas were exact; 60 frames would then give 2.1 ... 3.9 (99.7 per cent)
    assert 1.2 < np.mean(normalised) < 3.9


def test_the_record_of_a_solved_frame():
    rng = np.random.default_rng(2)
    q_ic = sky_with_stars(rng)
    state, fix, command = process(sky_frame(rng, seen_sky(), q_ic))
    assert fix.reason == Reason.NONE
    assert (fix.number, fix.t_valid_s, fix.exposure_s) == (0, 1.025, 0.05)
    assert fix.t_available_s == pytest.approx(1.065 + TRACKER.settings.latency)
    assert command == (fix.t_available_s, 0.05, EXPOSURE.gain)
    assert state.exposure_s == 0.05
    rows, xy_px = stars_in_frame(seen_sky(), q_ic)
    place = dict(zip(ready_tracker().pairs.stars.hip[rows], xy_px, strict=True))
    identified = np.flatnonzero(fix.hip)
    assert len(identified) >= 4
    for k in identified:
        assert np.linalg.norm(fix.detections.xy_px[k] - place[fix.hip[k]]) < 1.0
    sigma = np.sqrt(np.diag(fix.P_c))
    assert 1e-6 < sigma[0] < 1e-4 and 3.0 * sigma[0] < sigma[2] < 1e-3


def test_aberration_is_corrected_and_matters():
    """30 km/s shift the sky by 20 arcsec: with the velocity the error is a few arcsec, without it is not."""
    rng = np.random.default_rng(3)
    while True:
        q_ic = sky_with_stars(rng, least=15)
        boresight_i = dcm_from_quat(q_ic)[:, 2]
        across = VELOCITY - (VELOCITY @ boresight_i) * boresight_i
        if np.linalg.norm(across) > 28000.0:
            break
    image_dn = sky_frame(rng, seen_sky(), q_ic)
    arcsec = DEG / 3600.0
    _, corrected, _ = process(image_dn)
    assert np.linalg.norm(rotvec_between(corrected.q_ic, q_ic)[:2]) < 6.0 * arcsec
    _, still, _ = process(image_dn, CONTEXT._replace(velocity_i=np.zeros(3)))
    expected = np.linalg.norm(across) / 299792458.0
    assert np.linalg.norm(rotvec_between(still.q_ic, q_ic)[:2]) == pytest.approx(expected, abs=6.0 * arcsec)
    _, annual, _ = process(image_dn, tracker.NO_CONTEXT)  # the Earth's velocity alone is 2 arcsec off
    assert np.linalg.norm(rotvec_between(annual.q_ic, corrected.q_ic)) < 4.0 * arcsec


@pytest.mark.parametrize(
    "changed, expected",
    [
        ({}, Reason.TOO_FEW_STARS),
        ({"rate": 3.0 * DEG}, Reason.SMEARED),
        ({"sun_angle": 80.0 * DEG, "rate": 3.0 * DEG}, Reason.SUN_EXCLUSION),
        ({"limb_angle": 30.0 * DEG}, Reason.EARTH_EXCLUSION),
        ({"sun_angle": 100.0 * DEG, "limb_angle": 60.0 * DEG, "rate": 1.0 * DEG}, Reason.TOO_FEW_STARS),
    ],
)
def test_reason_for_an_empty_frame(changed, expected):
    image_dn = np.random.default_rng(4).normal(20.0, 2.4, (493, 659)).round().astype(np.uint8)
    _, fix, command = process(image_dn, CONTEXT._replace(**changed))
    assert fix.reason == expected
    assert fix.flag_no_stars and not fix.flag_saturated
    assert command.exposure_s == EXPOSURE.longest


def test_no_attitude_faster_than_the_tracker_is_made_for():
    rng = np.random.default_rng(5)
    image_dn = sky_frame(rng, seen_sky(), sky_with_stars(rng))
    _, good, _ = process(image_dn, CONTEXT._replace(rate=2.4 * DEG))
    _, fast, _ = process(image_dn, CONTEXT._replace(rate=2.6 * DEG))
    _, unknown, _ = process(image_dn, tracker.NO_CONTEXT)
    assert good.reason == unknown.reason == Reason.NONE
    assert fast.reason == Reason.SMEARED
    assert np.isnan(fast.q_ic).all() and np.isnan(fast.P_c).all()


def test_exclusion_angles_never_veto_an_attitude():
    rng = np.random.default_rng(5)
    q_ic = sky_with_stars(rng)
    pessimist = tracker.Context(VELOCITY, 1.0 * DEG, 10.0 * DEG, -10.0 * DEG)
    _, fix, _ = process(sky_frame(rng, seen_sky(), q_ic), pessimist)
    assert fix.reason == Reason.NONE


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_uniform_frames(grey):
    state, fix, _ = process(np.full((493, 659), grey, dtype=np.uint8))
    assert fix.reason == (Reason.TOO_FEW_STARS if grey == 0 else Reason.SATURATED)
    assert fix.flag_saturated == (grey > 100)
    assert state.exposure_s == (0.048 if grey > 100 else 0.05)
    assert fix.background_dn == pytest.approx(grey)


def test_pure_noise_and_gradients_give_no_attitude():
    rng = np.random.default_rng(6)
    for k in range(20):
        image = rng.normal(30.0, 3.0, (493, 659)) + np.linspace(0.0, 10.0 * k, 659)
        image[rng.integers(2, 491, 40 * k), rng.integers(2, 657, 40 * k)] += 80.0
        _, fix, _ = process(np.clip(np.rint(image), 0, 255).astype(np.uint8))
        assert fix.reason != Reason.NONE


def agreed(stars, rows, xy_px):
    """n_used, q_ic, P_c, residual_px of named objects, each known to 0.05 px; the stars seen from rest."""
    n, params = len(rows), tracker_with(TRACKER, centroid_floor=0.0)
    nothing, P_px = np.zeros(n, dtype=np.int64), np.tile(0.05**2 * np.eye(2), (n, 1, 1))
    found = Detections(xy_px, np.ones(n), nothing, nothing, P_px)
    return best_attitude.of_named(params, stars, rows, found, np.zeros(3), 4)[:4]


def test_a_shifted_star_is_left_out_or_refused():
    """One centroid 0.8 px off: with many stars it is dropped, with four there is no attitude to trust."""
    rng = np.random.default_rng(7)
    stars = ready_tracker().pairs.stars
    for n, accepted in ((12, True), (4, False)):
        q_ic = sky_with_stars(rng, least=n)
        rows, xy_px = stars_in_frame(stars, q_ic, margin_px=5.0)
        rows, xy_px = rows[:n], xy_px[:n] + rng.normal(0.0, 0.05, (n, 2))
        xy_px[2] += [0.6, -0.6]
        u_c, sigma_px = unit_vectors(CAMERA, xy_px), np.full(n, 0.05)
        n_used, q, P_c, residual_px = agreed(stars, rows, xy_px)
        assert (n_used >= 4) == accepted
        if accepted:
            assert n_used == n - 1
            assert residual_px < 0.15
            error = rotvec_between(q, q_ic)
            assert error @ np.linalg.solve(P_c, error) < 16.3  # 99.9 per cent of chi-square, 3 dof
            biased = rotvec_between(esoq2(u_c, stars.u_i[rows], sigma_px), q_ic)
            assert np.linalg.norm(error) < np.linalg.norm(biased)


def test_exposure_follows_the_flags_over_frames():
    """Bright frames shorten it to the floor in 2 ms steps, empty ones lengthen it back to the ceiling."""
    ready = ready_tracker()
    state, command = tracker.start(ready, 0.0)
    bright = np.full((493, 659), 200, dtype=np.uint8)
    empty = np.full((493, 659), 10, dtype=np.uint8)
    exposures_ms = []
    for image_dn in [bright] * 9 + [empty] * 9:
        state, _, command = tracker.step(ready, state, frame(image_dn, 0, command.exposure_s), CONTEXT)
        exposures_ms.append(round(1e3 * command.exposure_s))
    assert exposures_ms == [48, 46, 44, 42, 40, 38, 36, 35, 35, 37, 39, 41, 43, 45, 47, 49, 50, 50]


def test_unknown_method_is_refused_at_once():
    params = tracker_with(TRACKER, identification__method="astrology")
    with pytest.raises(ValueError, match="astrology"):
        tracker.init(params, all_stars(), 2012.47)


def test_a_database_is_made_once_for_the_same_catalogue(monkeypatch):
    """A campaign asks for it with every run; a catalogue equal in all but one field is another one."""
    monkeypatch.setattr(tracker.onboard_catalogue, "build", lambda *asked: asked)
    monkeypatch.setattr(tracker.onboard_catalogue, "pair_table", lambda *asked: list(asked))
    tracker._pairs.cache_clear()
    try:
        first = tracker.init(TRACKER, all_stars(), 2012.47).pairs
        assert tracker.init(TRACKER, all_stars(), 2012.47).pairs is first
        assert tracker.init(TRACKER, all_stars(), 2012.48).pairs is not first
        other = all_stars()._replace(epoch=2000.0)
        made = tracker.init(TRACKER, other, 2012.47).pairs
        assert made is not first and made[0][1] is other
    finally:
        tracker._pairs.cache_clear()


def test_database_covers_the_diagonal_of_the_field():
    pairs = ready_tracker().pairs
    assert 18.4 * DEG < np.arccos(pairs.cosine[0]) < 18.7 * DEG
    assert len(pairs.stars.hip) > 2800
    assert len(all_stars().hip) > 10 * len(pairs.stars.hip)


def tracking(image_dn, q_ic, sigma):
    """StarFix of a frame with a predicted attitude."""
    ready = ready_tracker()
    params = tracker_with(TRACKER, identification__method="bayes", identification__tracking=True)
    ready = ready._replace(params=params)
    state, _ = tracker.start(ready, 0.9)
    context = CONTEXT._replace(q_ic=q_ic, P_c=sigma**2 * np.eye(3))
    return tracker.step(ready, state, frame(image_dn), context)[1]


def test_three_stars_are_enough_with_a_prediction():
    rng = np.random.default_rng(11)
    checked = solved = 0
    while checked < 8:
        q_ic = random_attitude(rng)
        n_stars = len(stars_in_frame(seen_sky(), q_ic, margin_px=5.0)[0])
        if n_stars != 3 or len(stars_in_frame(seen_sky(), q_ic, margin_px=-3.0)[0]) != 3:
            continue
        image_dn = sky_frame(rng, seen_sky(), q_ic)
        _, lost, _ = process(image_dn)
        assert lost.reason != Reason.NONE
        off = quat_multiply(q_ic, quat_from_rotvec(0.03 * DEG * rng.standard_normal(3)))
        found = tracking(image_dn, off, 0.05 * DEG)
        checked += 1
        if found.reason == Reason.NONE:
            solved += 1
            assert np.linalg.norm(rotvec_between(found.q_ic, q_ic)) < 0.1 * DEG
    assert solved >= 6  # a star near the border or beside a false object may cost the third


def test_what_is_not_known_is_no_prediction():
    rng = np.random.default_rng(13)
    q_ic = sky_with_stars(rng)
    image_dn = sky_frame(rng, seen_sky(), q_ic)
    for q, sigma in ((np.full(4, np.nan), 1e-3), (q_ic, np.nan)):
        found = tracking(image_dn, q, sigma)
        assert found.reason == Reason.NONE
        assert np.linalg.norm(rotvec_between(found.q_ic, q_ic)) < 0.1 * DEG


def test_stars_that_disagree_make_no_attitude():
    """Six of ten shifted alike: whichever are dropped, too many are."""
    rng = np.random.default_rng(14)
    stars = ready_tracker().pairs.stars
    q_ic = sky_with_stars(rng, least=10)
    rows, xy_px = stars_in_frame(stars, q_ic, margin_px=5.0)
    rows, xy_px = rows[:10], xy_px[:10] + rng.normal(0.0, 0.05, (10, 2))
    xy_px[:6] += [5.0, -5.0]
    n_used, *_ = agreed(stars, rows, xy_px)
    assert n_used < 4


def test_a_wrong_prediction_is_forgotten():
    """10 deg off and sure of itself: the frame is solved as if there were no prediction."""
    rng = np.random.default_rng(12)
    for _ in range(10):
        q_ic = sky_with_stars(rng)
        axis = rng.standard_normal(3)
        off = quat_multiply(q_ic, quat_from_rotvec(10.0 * DEG * axis / np.linalg.norm(axis)))
        found = tracking(sky_frame(rng, seen_sky(), q_ic), off, 0.01 * DEG)
        assert found.reason == Reason.NONE
        assert np.linalg.norm(rotvec_between(found.q_ic, q_ic)) < 0.1 * DEG
