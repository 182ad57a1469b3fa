"""Which way a frame is searched, and where stars are predicted."""

from types import SimpleNamespace

import numpy as np
import pytest
from star_fields import IDENTIFY, MODEL, TRACKER, all_stars, random_attitude, ready_tracker, tracker_with

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry import rotation
from shefex_nav.geometry.pinhole import pinhole, pixels, unit_vectors
from shefex_nav.onboard.startracker import objects, tracker
from shefex_nav.onboard.startracker.identify.bayes import identify_near
from shefex_nav.papers.impa.methods import search
from shefex_nav.records import Frame, Reason, Scan

CAMERA = pinhole(659, 493, 2520.2)
PARAMS = tracker_with(TRACKER, highest_rate=1.0, identification__tracking=True)._replace(
    camera=MODEL._replace(pinhole=CAMERA), earth_velocity_i=np.array([2.0e4, -1.0e4, 1.5e4])
)
Q_IC = rotation.quat_normalise(np.array([0.3, -0.5, 0.7, 0.2]))
RATE = np.array([0.02, -0.05, 0.1])


def context(**known):
    return tracker.NO_CONTEXT._replace(rate=0.1, **known)


def sky(line_s=0.0, dtype=np.uint8, number=0, t_s=0.0):
    """An empty frame with noise."""
    image = np.random.default_rng(1).normal(20.0, 2.0, (493, 659)).clip(0, 255).astype(dtype)
    return Frame(number, t_s, t_s + 0.025, t_s + 0.06, 0.05, 0.0, image, line_s)


def stars(n=4000, seed=2):
    u_i = np.random.default_rng(seed).standard_normal((n, 3))
    return SimpleNamespace(u_i=u_i / np.linalg.norm(u_i, axis=1)[:, None])


def test_stars_are_predicted_where_the_camera_sees_them():
    """Against all stars, aberrated by the exact formula, one by one."""
    catalogue = stars()
    velocity_i = np.array([7e3, 1e3, 2.9e4])
    P_c = np.diag([1e-4, 2e-4, 1e-3]) ** 2
    known = context(q_ic=Q_IC, P_c=P_c, velocity_i=velocity_i)
    xy_px, P_px = objects.predicted(PARAMS, catalogue, known)
    u_c = aberrate(catalogue.u_i, velocity_i) @ rotation.dcm_from_quat(Q_IC)
    every = pixels(CAMERA, np.ascontiguousarray(u_c))
    margin = objects.OUTSIDE_PX
    inside = np.all((every > -0.5 - margin) & (every < np.array([658.5, 492.5]) + margin), axis=1)
    np.testing.assert_allclose(np.sort(xy_px, axis=0), np.sort(every[inside], axis=0), atol=1e-9)
    assert len(xy_px) > 10 and P_px.shape == (len(xy_px), 2, 2)


def test_covariance_of_a_predicted_place_is_that_of_turned_cameras():
    """The camera turned by errors drawn from P_c, the stars projected again."""
    rng = np.random.default_rng(3)
    A = rng.standard_normal((3, 3)) * [2e-4, 2e-4, 1e-3]
    P_c = A @ A.T
    known = context(q_ic=Q_IC, P_c=P_c)
    xy_px, P_px = objects.predicted(PARAMS, stars(), known)
    u_c = np.column_stack(
        [(xy_px - [CAMERA.cx_px, CAMERA.cy_px]) / CAMERA.focal_length_px, np.ones(len(xy_px))]
    )
    u_c /= np.linalg.norm(u_c, axis=1)[:, None]
    seen = np.array(
        [pixels(CAMERA, u_c @ rotation.dcm_from_rotvec(A @ e)) for e in rng.standard_normal((4000, 3))]
    )
    for k in range(len(xy_px)):
        found = np.cov(seen[:, k].T)
        expected = P_px[k] - PARAMS.settings.centroid_floor**2 * np.eye(2)
        np.testing.assert_allclose(found, expected, atol=0.1 * np.trace(expected))


@pytest.mark.parametrize(
    "sigma, omega, known",
    [
        (1e-3, RATE, True),  # 1e-3 rad/s moves a star by 0.06 px in half an exposure
        (0.1, RATE, False),
        (np.inf, RATE, False),
        (1e-3, np.full(3, np.nan), False),
    ],
)
def test_a_rate_is_known_if_it_says_where_the_light_went(sigma, omega, known):
    told = context(omega_c=omega, P_omega_c=np.diag([sigma**2] * 3))
    assert (objects.rate_error_px(CAMERA, sky(), told) < objects.KNOWN_PX) == known
    assert objects.rate_error_px(CAMERA, sky(), tracker.NO_CONTEXT) == np.inf


def test_rows_that_follow_each_other_want_a_better_rate():
    told = context(omega_c=RATE, P_omega_c=0.012**2 * np.eye(3))
    assert objects.rate_error_px(CAMERA, sky(), told) < objects.KNOWN_PX
    assert objects.rate_error_px(CAMERA, sky(line_s=1e-4), told) > objects.KNOWN_PX


def test_a_prediction_is_narrow_in_all_axes():
    def narrow(*sigma):
        return objects.is_narrow(CAMERA, context(q_ic=Q_IC, P_c=np.diag(sigma) ** 2))

    assert narrow(1e-3, 1e-3, 5e-3)
    assert not narrow(3e-3, 1e-3, 5e-3)
    assert not narrow(1e-3, 1e-3, 2e-2)  # 8 px in the corner
    assert not objects.is_narrow(CAMERA, tracker.NO_CONTEXT)


@pytest.mark.parametrize("scan", ["sequential", "maximum", "streaks"])
def test_without_a_rate_a_frame_is_searched_for_spots(scan):
    params = tracker_with(PARAMS, detection__scan=scan)
    search = objects.SEARCHES.get(scan, objects.as_spots)
    (found,) = search(params, stars(), None, sky(), tracker.NO_CONTEXT)
    assert found.scan == (Scan.MAXIMUM if scan == "maximum" else Scan.SEQUENTIAL)
    assert found.at_instant
    (found,) = search(params, stars(), None, sky(line_s=1e-4), tracker.NO_CONTEXT)
    assert not found.at_instant


def test_frames_follow_each_other_without_a_gap():
    first, second = sky(t_s=1.0), sky(t_s=1.05)
    memory = search.Memory(first.t_valid_s, first.exposure_s, None)
    assert search.follows(memory, second)
    assert not search.follows(memory, sky(t_s=1.1))  # one is missing
    assert not search.follows(memory, second._replace(exposure_s=0.04))
    assert not search.follows(None, second)


@pytest.mark.parametrize("n_false", [0, 200])
def test_a_wrong_prediction_confirms_nothing_by_looking_only_where_it_predicts(n_false):
    """Predictions 0.3 to 3 deg off, as narrow as they may be; whatever is in their windows is taken."""
    rng, camera, pairs = np.random.default_rng(7), MODEL.pinhole, ready_tracker().pairs
    sky = all_stars()
    sky_i, vmag = sky.u_i[sky.vmag <= 6.0], sky.vmag[sky.vmag <= 6.0]
    params = TRACKER._replace(earth_velocity_i=np.zeros(3))
    sigma = 0.97 * objects.NARROW_PX / camera.focal_length_px
    P_c = np.diag([sigma, sigma, 3.0 * sigma]) ** 2
    n_lists = 0
    for _ in range(400):
        q_ic = random_attitude(rng)
        off = rng.standard_normal(3)
        off *= np.radians(rng.uniform(0.3, 3.0)) / np.linalg.norm(off)
        told = rotation.quat_multiply(q_ic, rotation.quat_from_rotvec(off))
        xy_px, mag = in_view(sky_i, vmag, q_ic, n_false, rng)
        predicted_px, _ = objects.predicted(params, pairs.stars, context(q_ic=told, P_c=P_c))
        near = np.linalg.norm(xy_px[:, None] - predicted_px[None], axis=2) < 3.0 * objects.NARROW_PX
        rows = np.flatnonzero(near.any(axis=1))
        rows = rows[np.argsort(mag[rows])]
        if len(rows) < 3:
            continue
        n_lists += 1
        u_c = unit_vectors(camera, np.ascontiguousarray(xy_px[rows]))
        P_px = np.tile(0.08**2 * np.eye(2), (len(rows), 1, 1))
        prediction = told, P_c
        found, _ = identify_near(IDENTIFY, MODEL, pairs, u_c, 10.0 ** (-0.4 * mag[rows]), prediction, P_px)
        if found.reason == Reason.NONE:
            known = found.star >= 0
            seen_px = pixels(camera, pairs.stars.u_i[found.star[known]] @ rotation.dcm_from_quat(q_ic))
            assert np.linalg.norm(seen_px - xy_px[rows][known], axis=1).max() < 1.0
    assert n_lists > 20  # in most frames fewer than three windows hold anything


def in_view(sky_i, vmag, q_ic, n_false, rng):
    """Places and magnitudes of the stars of a frame, and of false objects."""
    camera = MODEL.pinhole
    xy_px = pixels(camera, np.ascontiguousarray(sky_i @ rotation.dcm_from_quat(q_ic)))
    size = np.array([camera.width_px, camera.height_px]) - 1.0
    inside = np.flatnonzero(((xy_px > 0.0) & (xy_px < size)).all(axis=1))
    xy_px = xy_px[inside] + 0.08 * rng.standard_normal((len(inside), 2))
    mag = vmag[inside] + 0.15 * rng.standard_normal(len(inside))
    xy_px = np.vstack([xy_px, rng.uniform(0.0, size, (n_false, 2))])
    return xy_px, np.concatenate([mag, rng.choice(vmag, n_false)])
