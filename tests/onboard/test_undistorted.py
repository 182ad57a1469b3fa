"""A lens with distortion in the star tracker: places and covariances there and back, motion, attitudes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from star_fields import CAMERA, MODEL, TRACKER, YEAR, all_stars, random_attitude, tracker_with

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry import rotation
from shefex_nav.geometry.distortion import displaced_px
from shefex_nav.geometry.pinhole import pixels, turn_slopes
from shefex_nav.geometry.shutter import row_start_s, row_times
from shefex_nav.onboard.startracker import objects, tracker
from shefex_nav.records import Detections, Frame, Reason

K = np.array([-0.7, 2.0, 1.5e-3, -0.8e-3, 0.0])  # up to 8 px
PINCUSHION = np.array([0.8, 0.0, 0.0, 0.0, 0.0])  # 2 % in the corner
F, CX, CY = CAMERA.focal_length_px, CAMERA.cx_px, CAMERA.cy_px
V_I = np.array([2.9e4, -5e3, 8e3])


def shown(k, xy_px):
    """Where a lens puts places of the pinhole, as textbooks write it. (n, 2)"""
    k1, k2, p1, p2, k3 = k
    x, y = (xy_px[:, 0] - CX) / F, (xy_px[:, 1] - CY) / F
    r2 = x**2 + y**2
    grown = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * grown + 2 * p1 * x * y + p2 * (r2 + 2 * x**2)
    v = y * grown + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y
    return np.column_stack([CX + F * u, CY + F * v])


def camera(k):
    return MODEL._replace(distortion=k, displaced_px=displaced_px(CAMERA, k))


def places(n=50, seed=4):
    return np.random.default_rng(seed).uniform([5.0, 5.0], [653.0, 487.0], (n, 2))


def listed(xy_px, P_px=None, flux=None):
    n = len(xy_px)
    none = np.zeros(n, dtype=np.int64)
    flux = np.linspace(2.0, 1.0, n) if flux is None else flux
    return Detections(xy_px, flux, none, none, np.tile(0.01 * np.eye(2), (n, 1, 1)) if P_px is None else P_px)


def test_places_and_covariances_are_those_of_the_pinhole():
    """Covariances against centroids that are drawn around their places on the detector."""
    rng, true = np.random.default_rng(1), places(5)
    seen = shown(K, true)
    A = 0.3 * rng.standard_normal((5, 2, 2))
    found = objects.ideal(camera(K), listed(seen, A @ A.mT))
    np.testing.assert_allclose(found.xy_px, true, atol=1e-7)
    for n in range(5):
        drawn = seen[n] + rng.standard_normal((20_000, 2)) @ A[n].T
        cov = np.cov(objects.ideal(camera(K), listed(drawn)).xy_px.T)
        np.testing.assert_allclose(found.P_px[n], cov, atol=0.05 * np.trace(cov))
    again, P_px = objects.on_detector(camera(K), found.xy_px, found.P_px)
    np.testing.assert_allclose(again, seen, atol=1e-7)
    np.testing.assert_allclose(P_px, A @ A.mT, rtol=1e-6)


def test_without_a_distortion_nothing_is_done():
    detections = listed(places())
    assert objects.ideal(MODEL, detections) is detections
    assert objects.on_detector(MODEL, detections.xy_px, detections.P_px) == (
        detections.xy_px,
        detections.P_px,
    )
    assert displaced_px(CAMERA, None) == 0.0


OMEGA = np.array([0.09, -0.06, 0.30])
T_S = np.linspace(-0.03, 0.03, 6001)
TURNED = [rotation.dcm_from_rotvec(t * OMEGA).T for t in T_S]


def collected(times, true):
    """Middle of the time in which a star's light is collected, and its mean place on the detector.

    true : (2,) place of the pinhole at time zero. By 6001 instants, each looked at by itself
    """
    u_c = TURNED @ np.array([(true[0] - CX) / F, (true[1] - CY) / F, 1.0])
    at = shown(K, [CX, CY] + F * u_c[:, :2] / u_c[:, 2:])
    opens_s = np.array([row_start_s(times, y) for y in at[:, 1]])
    lit = (opens_s <= T_S) & (opens_s + times.exposure_s >= T_S)
    return T_S[lit].mean(), at[lit].mean(axis=0)


@pytest.mark.parametrize("line_s", [0.0, 60e-6])
def test_spots_are_brought_to_the_frames_instant(line_s):
    """At 18 deg/s: with a rolling shutter, the motion of the pinhole would be wrong by 0.04 px."""
    times, true = row_times(0.01, line_s, CAMERA.height_px), places(8)
    seen = [collected(times, one) for one in true]
    seen_s, xy_px = np.array([t for t, _ in seen]), np.array([at for _, at in seen])
    frame = Frame(
        0, 0.0, 0.0, 0.0, 0.01, 0.0, np.zeros((CAMERA.height_px, CAMERA.width_px), np.uint8), line_s
    )
    context = tracker.NO_CONTEXT._replace(omega_c=OMEGA, P_omega_c=1e-12 * np.eye(3))
    found, told_s = objects.at_frame_instant(camera(K), frame, context, listed(xy_px), False)
    np.testing.assert_allclose(found.xy_px, shown(K, true), atol=0.01)
    np.testing.assert_allclose(told_s, seen_s, atol=5e-5)
    if line_s:
        plain, _ = objects.at_frame_instant(MODEL, frame, context, listed(xy_px), False)
        assert abs(plain.xy_px - shown(K, true)).max() > 0.03


def test_streaks_are_brought_there_by_the_motion_of_the_lens():
    times, true = row_times(0.01, 60e-6, CAMERA.height_px), places(8)
    seen = [collected(times, one) for one in true]
    seen_s, xy_px = np.array([t for t, _ in seen]), np.array([at for _, at in seen])
    x, y = ((xy_px - [CX, CY]) / F).T
    velocity = F * np.stack([np.stack(by, axis=-1) for by in turn_slopes(x, y)], axis=1) @ OMEGA
    by_pinhole = xy_px - seen_s[:, None] * velocity  # as the search along streaks says it
    found = objects.of_streaks(camera(K), times, OMEGA, by_pinhole, seen_s)
    was, left = abs(by_pinhole - shown(K, true)).max(), abs(found - shown(K, true)).max()
    assert was > 0.03
    assert left < 0.2 * was


def test_stars_are_predicted_where_the_lens_shows_them():
    """All that it brings onto the detector, none that it takes away; covariance by turned cameras."""
    rng, q_ic = np.random.default_rng(5), random_attitude(np.random.default_rng(8))
    u_i = rng.standard_normal((6000, 3))
    stars = SimpleNamespace(u_i=u_i / np.linalg.norm(u_i, axis=1)[:, None])
    A = rng.standard_normal((3, 3)) * [2e-4, 2e-4, 1e-3]
    params = TRACKER._replace(camera=camera(K))
    context = tracker.NO_CONTEXT._replace(q_ic=q_ic, P_c=A @ A.T, velocity_i=V_I)
    xy_px, P_px = objects.predicted(params, stars, context)

    def seen(q_ic):
        u_c = aberrate(stars.u_i, V_I) @ rotation.dcm_from_quat(q_ic)
        u_c = u_c[u_c[:, 2] > 0.9]
        every = shown(K, pixels(CAMERA, np.ascontiguousarray(u_c)))
        margin = objects.OUTSIDE_PX
        return every[((every > -0.5 - margin) & (every < np.array([658.5, 492.5]) + margin)).all(axis=1)]

    np.testing.assert_allclose(xy_px, seen(q_ic), atol=1e-8)
    x, y = xy_px[0]
    drawn = []
    for e in rng.standard_normal((1500, 3)):
        turned = seen(rotation.quat_multiply(q_ic, rotation.quat_from_rotvec(A @ e)))
        drawn.append(turned[np.hypot(*(turned - [x, y]).T).argmin()])
    cov, floor = np.cov(np.array(drawn).T), params.settings.centroid_floor**2 * np.eye(2)
    np.testing.assert_allclose(P_px[0] - floor, cov, atol=0.15 * np.trace(cov))


def tracker_of(model, **values):
    return tracker.init(tracker_with(TRACKER, **values)._replace(camera=model), all_stars(), YEAR)


def field(stars, k, q_ic, rng, noise_px, hole=CAMERA):
    """Detections of the catalogue stars that a lens puts on the detector, brightest first."""
    u_c = aberrate(stars.u_i, V_I) @ rotation.dcm_from_quat(q_ic)
    reach = 0.3 if k is None else 0.22  # f, of the axis: further out these polynomials fold
    ahead = np.flatnonzero(u_c[:, 2] > np.cos(np.arctan(reach)))
    xy_px = pixels(hole, np.ascontiguousarray(u_c[ahead]))
    xy_px = shown(k, xy_px) if k is not None else xy_px
    on = ((xy_px > -0.5) & (xy_px < [658.5, 492.5])).all(axis=1)
    order = np.argsort(stars.vmag[ahead[on]])
    xy_px = xy_px[on][order] + noise_px * rng.standard_normal((on.sum(), 2))
    P_px = np.tile(noise_px**2 * np.eye(2), (len(xy_px), 1, 1))
    return listed(xy_px, P_px, 10.0 ** (-0.4 * stars.vmag[ahead[on]][order]))


def attitudes(ready, k, n, noise_px, seed=0):
    """Errors (m, 3) rad and NEES of the m attitudes that come of n fields through a lens."""
    errors, nees = [], []
    for number in range(n):
        rng = np.random.default_rng([seed, number])
        q_ic = random_attitude(rng)
        detections = field(ready.pairs.stars, k, q_ic, rng, noise_px)
        context = tracker.NO_CONTEXT._replace(velocity_i=V_I)
        ideal = objects.ideal(ready.params.camera, detections)
        _, reason, (q, P_c, _) = tracker.attitude(ready, ideal, context)
        if reason == Reason.NONE:
            d = rotation.rotvec_between(q, q_ic)
            errors.append(d)
            nees.append(d @ np.linalg.solve(P_c, d))
    return np.array(errors), np.array(nees)


@pytest.mark.parametrize("k", [K, PINCUSHION])
@pytest.mark.parametrize("method", ["bayes", "pyramid"])
def test_right_calibration_gives_as_good_attitudes_as_a_pinhole(method, k):
    """Share solved, errors and NEES of 150 fields; with the pincushion stars at the border are gone."""
    ways = {"identification__method": method, "centroid_floor": 0.0}
    plain, plain_nees = attitudes(tracker_of(MODEL, **ways), np.zeros(5), 150, 0.1)
    found, nees = attitudes(tracker_of(camera(k), **ways), k, 150, 0.1)
    assert len(plain) > 140
    assert len(found) >= len(plain) - 4
    assert np.sqrt((found**2).mean(axis=0)) == pytest.approx(np.sqrt((plain**2).mean(axis=0)), rel=0.25)
    spread = 4.0 * np.sqrt(6.0 / len(found))
    assert abs(nees.mean() - 3.0) < spread and abs(plain_nees.mean() - 3.0) < spread


CORNER2 = ((329.5**2 + 246.5**2) ** 0.5 / F) ** 2


def barrel(px):
    """Radial barrel that moves the corners by about so many pixels."""
    return np.array([-px / (F * CORNER2**1.5), 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("px", [8.0, 16.0, 32.0])
@pytest.mark.parametrize("method", ["bayes", "pyramid"])
def test_strong_barrels_told_rightly_lose_no_frame(method, px):
    """Stars of the corners are far outside the pinhole's detector; `pyramid` once lost half at 32 px."""
    ways = {"identification__method": method, "centroid_floor": 0.0}
    plain = len(attitudes(tracker_of(MODEL, **ways), np.zeros(5), 60, 0.1)[0])
    found = len(attitudes(tracker_of(camera(barrel(px)), **ways), barrel(px), 60, 0.1)[0])
    assert plain > 55 and found >= plain - 1


@pytest.mark.parametrize("method", ["bayes", "pyramid"])
def test_stars_that_a_barrel_adds_outside_the_pinholes_detector_are_named(method):
    model = camera(barrel(32.0))
    ready = tracker_of(model, identification__method=method, centroid_floor=0.0)
    outside, named = 0, 0
    for number in range(50):
        rng = np.random.default_rng([11, number])
        detections = field(ready.pairs.stars, barrel(32.0), random_attitude(rng), rng, 0.1)
        ideal = objects.ideal(model, detections)
        found, reason, _ = tracker.attitude(ready, ideal, tracker.NO_CONTEXT._replace(velocity_i=V_I))
        if reason == Reason.NONE:
            out = ((ideal.xy_px < -3.0) | (ideal.xy_px > [661.0, 495.0])).any(axis=1)
            outside, named = outside + out.sum(), named + (out & (found.star >= 0)).sum()
    assert outside > 30 and named > 0.95 * outside


ASIDE = CAMERA._replace(cx_px=20.0, cy_px=20.0)  # the axis near a corner


def test_stars_are_predicted_over_the_whole_detector_wherever_the_axis_is():
    rng, q_ic = np.random.default_rng(1), random_attitude(np.random.default_rng(8))
    u_i = rng.standard_normal((20_000, 3))
    stars = SimpleNamespace(u_i=u_i / np.linalg.norm(u_i, axis=1)[:, None])
    context = tracker.NO_CONTEXT._replace(q_ic=q_ic, P_c=1e-10 * np.eye(3), velocity_i=V_I)
    params = TRACKER._replace(camera=MODEL._replace(pinhole=ASIDE))
    xy_px, _ = objects.predicted(params, stars, context)
    u_c = aberrate(stars.u_i, V_I) @ rotation.dcm_from_quat(q_ic)
    every = pixels(ASIDE, np.ascontiguousarray(u_c[u_c[:, 2] > 0.5]))

    def on(xy_px):
        return xy_px[((xy_px > -0.5) & (xy_px < [658.5, 492.5])).all(axis=1)]

    assert len(on(every)) > 40 and (np.hypot(*(on(every) - 20.0).T) > 420.0).sum() > 10
    np.testing.assert_allclose(on(xy_px), on(every), atol=1e-8)


@pytest.mark.parametrize("method", ["bayes", "pyramid"])
def test_a_field_is_identified_wherever_the_axis_is(method):
    """Lost in space, with all that is named: the list of stars around the axis reaches the far corner."""
    ready = tracker_of(MODEL._replace(pinhole=ASIDE), identification__method=method, centroid_floor=0.0)
    solved, named, seen = 0, 0, 0
    for number in range(40):
        rng = np.random.default_rng([3, number])
        q_ic = random_attitude(rng)
        detections = field(ready.pairs.stars, None, q_ic, rng, 0.1, ASIDE)
        context = tracker.NO_CONTEXT._replace(velocity_i=V_I)
        found, reason, (q, _, _) = tracker.attitude(ready, detections, context)
        if reason == Reason.NONE:
            solved, named = solved + 1, named + (found.star >= 0).sum()
            seen += len(detections.xy_px)
            assert np.linalg.norm(rotation.rotvec_between(q, q_ic)) < 3e-3
    assert solved >= 38
    assert named > 0.97 * seen


def test_wrong_calibration_turns_the_attitude_as_least_squares_of_the_displacements():
    """No noise; what is told leaves 0.1 px rms, much of it a turn. Every star weighs the same."""
    true, told = np.array([-0.376, 0.0, 0.0, 0.0, 0.0]), np.array([-0.35, 0.0, 2e-3, -1.5e-3, 0.0])
    ready = tracker_of(camera(told), centroid_floor=0.3, outlier_sigma=8.0)
    settings = replace(ready.params.settings.identification, centroid_error=1.0)
    ready = ready._replace(
        params=ready.params._replace(settings=replace(ready.params.settings, identification=settings))
    )
    seen = 0
    for number in range(40):
        rng = np.random.default_rng([7, number])
        q_ic = random_attitude(rng)
        detections = field(ready.pairs.stars, true, q_ic, rng, 1e-6)
        ideal = objects.ideal(ready.params.camera, detections)
        _, reason, (q, _, _), stars = tracker.attitude_with_stars(
            ready, ideal, tracker.NO_CONTEXT._replace(velocity_i=V_I)
        )
        if reason != Reason.NONE:
            continue
        used = np.ascontiguousarray(stars.u_i @ rotation.dcm_from_quat(q_ic))
        place = pixels(CAMERA, used)
        off = objects.ideal(camera(told), listed(shown(true, place))).xy_px - place
        x, y = ((place - [CX, CY]) / F).T
        G = F * np.stack([np.stack(by, axis=-1) for by in turn_slopes(x, y)], axis=1)
        turn = np.linalg.lstsq(G.reshape(-1, 3), off.ravel(), rcond=None)[0]
        error = rotation.rotvec_between(q_ic, q)
        assert np.linalg.norm(turn[:2]) > 1e-5  # 2 arcsec
        np.testing.assert_allclose(error, turn, atol=0.03 * np.linalg.norm(turn))
        seen += 1
    assert seen > 30
