"""One or two stars of a frame near their predicted places: the right ones, or none and a reason."""

import numpy as np
import pytest
from star_fields import (
    CAMERA,
    DEG,
    EXPOSURE,
    MODEL,
    TRACKER,
    digitise,
    random_attitude,
    ready_tracker,
    signal,
    spot,
    stars_in_frame,
    tracker_with,
)

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.pinhole import cross_axes, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply
from shefex_nav.onboard.startracker import single, tracker
from shefex_nav.records import Detections, Frame, Reason

ARCSEC = DEG / 3600.0
VELOCITY = np.array([-29500.0, 3000.0, 1500.0])  # m/s
PARAMS = tracker_with(
    TRACKER._replace(camera=MODEL._replace(zero_flux=1e6), vectors=True),
    identification__method="bayes",
    identification__tracking=True,
    identification__magnitude_tolerance=1.0,
)
NOISE_PX = 0.1
ELECTRONS_PER_DN = 7.4  # of the frames


def catalogue():
    return ready_tracker().pairs.stars


def seen_sky():
    """On-board catalogue as the moving vehicle sees it."""
    return catalogue()._replace(u_i=aberrate(catalogue().u_i, VELOCITY))


def predicted(rng, q_ic, sigma):
    """Context whose attitude is wrong by as much as its covariance says."""
    off = quat_multiply(q_ic, quat_from_rotvec(sigma * rng.standard_normal(3)))
    return tracker.NO_CONTEXT._replace(velocity_i=VELOCITY, q_ic=off, P_c=sigma**2 * np.eye(3))


def objects(xy_px, magnitude, n_saturated=0):
    """Detections at places, brightest first, and their covariance."""
    n = len(xy_px)
    order = np.argsort(magnitude)
    P_px = np.tile(NOISE_PX**2 * np.eye(2), (n, 1, 1))
    flux = 1e6 * 10.0 ** (-0.4 * np.asarray(magnitude, dtype=float)[order])
    saturated = np.full(n, n_saturated)
    return Detections(np.asarray(xy_px, dtype=float)[order], flux, np.full(n, 9), saturated, P_px), P_px


def named(rng, q_ic, sigma, xy_px, magnitude, **changed):
    """hip of each object (n,), 0 where unnamed, StarVectors, ambiguous."""
    detections, P_px = objects(xy_px, magnitude, **changed)
    star, stars, ambiguous = single.identify(
        PARAMS, catalogue(), detections, P_px, predicted(rng, q_ic, sigma)
    )
    return np.where(star >= 0, catalogue().hip[star], 0), stars, ambiguous


def field(rng, least):
    """(q_ic, rows, xy_px) of a field with so many stars."""
    while True:
        q_ic = random_attitude(rng)
        rows, xy_px = stars_in_frame(seen_sky(), q_ic, margin_px=10.0)
        if len(rows) >= least:
            return q_ic, rows, xy_px


@pytest.mark.parametrize("count", [1, 2])
def test_right_stars_among_false_objects(count):
    """300 fields, one or two of their stars and five false objects, prediction good to 30 arcsec.

    Not one wrong name; nearly every star that has no neighbour in the catalogue is named.
    """
    rng = np.random.default_rng(20 + count)
    wrong = right = 0
    for _ in range(300):
        q_ic, rows, xy_px = field(rng, 4)
        chosen = rng.choice(len(rows), count, replace=False)
        places = np.vstack([xy_px[chosen], rng.uniform([0, 0], [658, 492], (5, 2))])
        places[:count] += NOISE_PX * rng.standard_normal((count, 2))
        magnitude = np.concatenate([seen_sky().vmag[rows[chosen]], rng.uniform(1.5, 5.5, 5)])
        hip, stars, _ = named(rng, q_ic, 30.0 * ARCSEC, places, magnitude)
        order = np.argsort(magnitude)
        truth = np.concatenate([catalogue().hip[rows[chosen]], np.zeros(5, int)])[order]
        wrong += np.sum((hip != 0) & (hip != truth))
        right += np.sum((hip != 0) & (hip == truth))
        assert np.array_equal(stars.hip, hip[hip > 0])
        angle = np.linalg.norm(stars.u_c - stars.u_i @ dcm_from_quat(q_ic), axis=1)
        assert np.all(angle[np.isin(stars.hip, truth)] < 6.0 * NOISE_PX / CAMERA.focal_length_px)
    print(count, wrong, right / (300 * count))
    assert wrong == 0 and right > 0.9 * 300 * count


def test_false_objects_alone_are_hardly_ever_named():
    """1000 frames of 8 false objects: by chance at most CHANCE of the stars in each field get a name."""
    rng = np.random.default_rng(23)
    found = expected = 0
    for _ in range(1000):
        q_ic, rows, _ = field(rng, 4)
        hip, _, _ = named(
            rng, q_ic, 30.0 * ARCSEC, rng.uniform([0, 0], [658, 492], (8, 2)), rng.uniform(1.5, 5.5, 8)
        )
        found += np.sum(hip > 0)
        expected += single.CHANCE * len(rows)
    print(found, expected)
    assert found < expected


def test_a_wide_prediction_leaves_every_star_ambiguous():
    rng = np.random.default_rng(24)
    for _ in range(20):
        q_ic, rows, xy_px = field(rng, 6)
        hip, stars, ambiguous = named(rng, q_ic, 0.3 * DEG, xy_px[:2], seen_sky().vmag[rows[:2]])
        assert not hip.any() and not len(stars.hip) and ambiguous


def test_two_objects_near_one_star_and_two_stars_near_one_object():
    rng = np.random.default_rng(25)
    q_ic, rows, xy_px = field(rng, 6)
    vmag = seen_sky().vmag[rows[0]]
    hip, _, ambiguous = named(rng, q_ic, 1.0 * ARCSEC, [xy_px[0], xy_px[0] + [0.5, 0.3]], [vmag, vmag + 0.5])
    assert not hip.any() and ambiguous
    C = dcm_from_quat(q_ic)
    beside = unit_vectors(CAMERA, xy_px[:1] + np.array([0.5, 0.3])) @ C.T  # another star half a pixel away
    twin = catalogue()._replace(
        hip=np.append(catalogue().hip, 999999),
        u_i=np.vstack([catalogue().u_i, aberrate(beside, -VELOCITY)]),
        vmag=np.append(catalogue().vmag, vmag),
    )
    detections, P_px = objects(xy_px[:1], [vmag])
    star, _, ambiguous = single.identify(PARAMS, twin, detections, P_px, predicted(rng, q_ic, 1.0 * ARCSEC))
    assert star[0] < 0 and ambiguous
    star, _, _ = single.identify(PARAMS, catalogue(), detections, P_px, predicted(rng, q_ic, 1.0 * ARCSEC))
    assert star[0] == rows[0]


def test_brightness_must_fit_unless_the_star_is_saturated():
    rng = np.random.default_rng(26)
    q_ic, rows, xy_px = field(rng, 6)
    vmag = seen_sky().vmag[rows[0]]
    for fainter, n_saturated, expected in (
        (2.0, 0, False),
        (-2.0, 0, False),
        (2.0, 3, True),
        (-2.0, 3, False),
    ):
        hip, _, _ = named(rng, q_ic, 5.0 * ARCSEC, xy_px[:1], [vmag + fainter], n_saturated=n_saturated)
        assert hip.any() == expected, (fainter, n_saturated)


def test_stars_that_no_single_turn_explains_are_refused():
    """Each within its own gate of a prediction of 40 arcsec, but 2 px nearer to each other than the stars."""
    rng = np.random.default_rng(27)
    q_ic, rows, xy_px = field(rng, 6)
    apart = xy_px[1] - xy_px[0]
    pushed = xy_px[:2] + np.outer([1.0, -1.0], apart / np.linalg.norm(apart))
    context = tracker.NO_CONTEXT._replace(
        velocity_i=VELOCITY, q_ic=q_ic, P_c=(40.0 * ARCSEC) ** 2 * np.eye(3)
    )
    for places, expected in ((xy_px[:2], 2), (pushed, 0), (pushed[:1], 1)):
        detections, P_px = objects(places, seen_sky().vmag[rows[: len(places)]])
        star, _, ambiguous = single.identify(PARAMS, catalogue(), detections, P_px, context)
        assert (star >= 0).sum() == expected
        assert ambiguous == (expected == 0)


def rendered(rng, q_ic, rows, xy_px, params, sigma=20.0 * ARCSEC):
    """StarFix of a frame that shows these stars alone."""
    light = np.zeros((CAMERA.height_px, CAMERA.width_px))
    for row, (x, y) in zip(rows, xy_px, strict=True):
        spot(light, x, y, signal(seen_sky().vmag[row]))
    zero_flux = signal(0.0, EXPOSURE.longest) / ELECTRONS_PER_DN
    params = params._replace(camera=params.camera._replace(zero_flux=zero_flux))
    ready = ready_tracker()._replace(params=params)
    state, _ = tracker.start(ready, 0.9)
    frame = Frame(0, 1.0, 1.025, 1.065, 0.05, EXPOSURE.gain, digitise(rng, light))
    return tracker.step(ready, state, frame, predicted(rng, q_ic, sigma))[1]


@pytest.mark.parametrize("count", [1, 2])
def test_frames_with_one_and_two_stars(count):
    """No attitude, but the stars: named in the log, at their places, with an honest covariance.

    Thirty frames, stars of magnitude 3 to 4.5, whose centroids have no error but that of the pixels' noise;
    chi-square of the directions within 99.9 %.
    """
    from scipy.stats import chi2

    camera = PARAMS.camera._replace(electrons_per_dn=ELECTRONS_PER_DN, psf_sigma=0.8)
    params = tracker_with(PARAMS._replace(camera=camera), centroid_floor=1e-3)
    rng = np.random.default_rng(30 + count)
    total = dof = frames = 0
    while frames < 30:
        q_ic, rows, xy_px = field(rng, 6)
        vmag = seen_sky().vmag[rows]
        bright = np.flatnonzero((vmag > 3.0) & (vmag < 4.5))[:count]
        if len(bright) < count:
            continue
        frames += 1
        fix = rendered(rng, q_ic, rows[bright], xy_px[bright], params)
        assert fix.reason == Reason.TOO_FEW_STARS and np.isnan(fix.q_ic).all()
        assert set(fix.stars.hip) <= set(catalogue().hip[rows[bright]])
        assert set(fix.hip) - {0} == set(fix.stars.hip)
        E = cross_axes(fix.stars.u_c)
        d = np.einsum("kij,kj->ki", E, fix.stars.u_i @ dcm_from_quat(q_ic))
        total += np.einsum("ki,kij,kj->", d, np.linalg.inv(fix.stars.P_u), d)
        dof += 2 * len(d)
        if frames <= 3:  # the navigation does not ask for single stars
            fix = rendered(rng, q_ic, rows[bright], xy_px[bright], PARAMS._replace(vectors=False))
            assert fix.reason == Reason.TOO_FEW_STARS and not len(fix.stars.hip) and not fix.hip.any()
    print(count, total / dof, dof)
    assert dof > 0.9 * 2 * 30 * count
    low, high = chi2.interval(0.999, dof)
    assert low < total < high


def test_solved_frames_give_the_stars_of_their_attitude():
    rng = np.random.default_rng(33)
    q_ic, rows, xy_px = field(rng, 10)
    fix = rendered(rng, q_ic, rows, xy_px, PARAMS)
    assert fix.reason == Reason.NONE and len(fix.stars.hip) >= 8
    assert set(fix.stars.hip) <= set(fix.hip) - {0}
    turned = fix.stars.u_i @ dcm_from_quat(fix.q_ic)
    assert np.linalg.norm(turned - fix.stars.u_c, axis=1).max() < 1.5 / CAMERA.focal_length_px


def test_a_camera_that_turns_too_fast_gives_no_stars():
    rng = np.random.default_rng(34)
    q_ic, rows, xy_px = field(rng, 6)
    fix = rendered(rng, q_ic, rows[:1], xy_px[:1], tracker_with(PARAMS, highest_rate=-1.0))
    assert np.isnan(predicted(rng, q_ic, 1e-4).rate) and len(fix.stars.hip)  # an unknown rate is not too high
    params = tracker_with(PARAMS, highest_rate=1.0 * DEG)
    ready = ready_tracker()._replace(params=params)
    state, _ = tracker.start(ready, 0.9)
    light = np.zeros((CAMERA.height_px, CAMERA.width_px))
    spot(light, *xy_px[0], signal(2.0))
    frame = Frame(0, 1.0, 1.025, 1.065, 0.05, EXPOSURE.gain, digitise(rng, light))
    context = predicted(rng, q_ic, 20.0 * ARCSEC)._replace(rate=2.0 * DEG)
    fix = tracker.step(ready, state, frame, context)[1]
    assert fix.reason == Reason.SMEARED and not len(fix.stars.hip)
