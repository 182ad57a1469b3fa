"""The published chain on rendered streaks: signs, one instant, flux, and an attitude from two frames."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import erf
from star_fields import CATALOGUE, DEG, DETECT, IDENTIFY, all_stars

from shefex_nav.geometry.pinhole import pinhole, pixels
from shefex_nav.geometry.rotation import (
    dcm_from_quat,
    quat_from_rotvec,
    quat_multiply,
    quat_normalise,
    rotvec_between,
)
from shefex_nav.geometry.shutter import row_times
from shefex_nav.geometry.streak import place_at, seen_from_to
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.papers.impa.methods.chain import attitude, objects
from shefex_nav.records import Reason

CAMERA = pinhole(1024, 1024, 52e-3 / 18e-6)  # the paper's, with its exposure
EXPOSURE_S, SIGMA_PX, ELECTRONS_PER_DN = 0.2, 1.1, 16.0
GLOBAL, ROLLING = row_times(EXPOSURE_S, 0.0, 1024), row_times(EXPOSURE_S, EXPOSURE_S / 1024, 1024)
SETTINGS = replace(DETECT, saturation=4063.0)
ZERO_DN = 7.3e6 * EXPOSURE_S / ELECTRONS_PER_DN
MODEL = CameraModel(CAMERA, electrons_per_dn=ELECTRONS_PER_DN, zero_flux=ZERO_DN)


def add_streak(electrons, times, omega_c, xy_px, rate_electrons_s):
    """Light of one star in steps of a quarter of a pixel, each row taking what falls while it is open."""
    begin, end = seen_from_to(CAMERA, times, omega_c, *xy_px)
    margin_s = 8.0 * times.line_s  # rows that the spot reaches before and after its middle
    ends = [np.array(place_at(CAMERA, omega_c, *xy_px, t)) for t in (begin, end)]
    n = max(1, int(4.0 * np.linalg.norm(ends[1] - ends[0])))
    edges = np.linspace(begin - margin_s, end + margin_s, n + 1)
    opens = (np.arange(1024) - times.middle_row) * times.line_s - 0.5 * times.exposure_s
    for t_0, t_1 in pairwise(edges):
        x, y = place_at(CAMERA, omega_c, *xy_px, 0.5 * (t_0 + t_1))
        c = np.arange(max(0, int(x) - 6), min(1024, int(x) + 8))
        r = np.arange(max(0, int(y) - 6), min(1024, int(y) + 8))
        if len(c) == 0 or len(r) == 0:
            continue
        open_s = np.clip(np.minimum(t_1, opens[r] + times.exposure_s) - np.maximum(t_0, opens[r]), 0.0, None)
        gx, gy = (np.diff(erf((np.append(k, k[-1] + 1) - 0.5 - at) / (SIGMA_PX * 2**0.5))) / 2
                  for k, at in ((c, x), (r, y)))  # fmt: skip
        electrons[np.ix_(r, c)] += rate_electrons_s * np.outer(gy * open_s, gx)


def frame(rng, times, omega_c, xy_px, vmag):
    """Grey values of the paper's camera: 6100 electrons of background, 50 of read-out noise."""
    electrons = np.zeros((1024, 1024))
    for place, magnitude in zip(xy_px, vmag, strict=True):
        add_streak(electrons, times, omega_c, place, 7.3e6 * 10.0 ** (-0.4 * magnitude))
    electrons += 6100.0
    electrons += rng.standard_normal(electrons.shape) * np.sqrt(electrons + 50.0**2)
    return np.clip(np.rint(electrons / ELECTRONS_PER_DN + 32.0), 0, 4095).astype(np.uint16)


PLACES = np.array([[x, y] for x in (170.0, 512.0, 860.0) for y in (80.3, 300.1, 512.4, 730.8, 940.6)])
MAGNITUDES = np.linspace(1.0, 2.4, len(PLACES))


def two_frames(rng, times, omega_c):
    """Detections of the second of two contiguous frames, where the stars are at PLACES at its instant."""
    before = np.array([place_at(CAMERA, omega_c, x, y, -EXPOSURE_S) for x, y in PLACES])
    clusters, nothing = objects(SETTINGS, MODEL, times, None, frame(rng, times, omega_c, before, MAGNITUDES))
    assert len(nothing.flux_dn) == 0
    return objects(SETTINGS, MODEL, times, clusters, frame(rng, times, omega_c, PLACES, MAGNITUDES))


def offsets(detections):
    """Distance of each star's detection from its place, (n, 2); every star has one and nothing else has."""
    table = detections.xy_px[None] - PLACES[:, None]
    nearest = np.linalg.norm(table, axis=2).argmin(axis=1)
    assert len(set(nearest)) == len(detections.flux_dn) == len(PLACES)
    return table[np.arange(len(PLACES)), nearest], nearest


@pytest.mark.parametrize("direction", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0.7, -0.7, 0.2)])
@pytest.mark.parametrize("times", [GLOBAL, ROLLING])
def test_streaks_are_brought_to_the_instant(direction, times):
    """3 deg/s, 150 px/s: uncompensated up to 13 px off in the first and last rows."""
    omega_c = 3.0 * DEG * np.array(direction) / np.linalg.norm(direction)
    clusters, detections = two_frames(np.random.default_rng(1), times, omega_c)
    offset, rows = offsets(detections)
    limit = 0.4 if times is GLOBAL else 2.0  # the spot at the ends, carried by half of the exposure
    assert np.abs(offset).max() < limit
    if times is ROLLING:
        raw = np.linalg.norm(clusters.xy_px[:, None] - PLACES[None], axis=2).min(axis=0)
        assert raw.max() > 10.0 and np.sqrt((raw**2).mean()) > 8.0 * np.sqrt((offset**2).mean())
    expected = ZERO_DN * 10.0 ** (-0.4 * MAGNITUDES)
    ratio = detections.flux_dn[rows] / expected
    assert (ratio > 0.80).all() and (ratio < 1.02).all()  # what is below the threshold is lost
    assert (np.diff(detections.flux_dn) <= 0.0).all()
    chi2 = np.einsum("ki,kij,kj->k", offset, np.linalg.inv(detections.P_px[rows]), offset)
    assert 2.0 / 25.0 < chi2.mean() < 2.0 * 2.0  # covers the errors, and is not five sigmas wide for one


def test_at_rest_nothing_is_carried():
    for times in (GLOBAL, ROLLING):
        _, detections = two_frames(np.random.default_rng(2), times, np.zeros(3))
        offset, _ = offsets(detections)
        assert np.abs(offset).max() < 0.1


def test_what_the_border_cuts_is_no_star():
    omega_c = np.array([0.0, -3.0 * DEG, 0.0])  # to the right
    rng, xy_px = np.random.default_rng(3), np.array([[1015.0, 500.0], [600.0, 500.0]])
    before = np.array([place_at(CAMERA, omega_c, x, y, -EXPOSURE_S) for x, y in xy_px])
    clusters, _ = objects(SETTINGS, MODEL, GLOBAL, None, frame(rng, GLOBAL, omega_c, before, [2.0, 2.0]))
    clusters, detections = objects(
        SETTINGS, MODEL, GLOBAL, clusters, frame(rng, GLOBAL, omega_c, xy_px, [2.0, 2.0])
    )
    assert len(clusters.energy_dn) == 2 and len(detections.flux_dn) == 1
    np.testing.assert_allclose(detections.xy_px[0], [600.0, 500.0], atol=0.4)


def test_an_object_of_one_frame_only_is_dropped():
    """A particle hit is not in the frame before."""
    rng, omega_c = np.random.default_rng(4), np.zeros(3)
    image = frame(rng, GLOBAL, omega_c, PLACES[:3], MAGNITUDES[:3])
    clusters, _ = objects(SETTINGS, MODEL, GLOBAL, None, image)
    hit = image.copy()
    hit[620:622, 700:703] += 800
    clusters, detections = objects(SETTINGS, MODEL, GLOBAL, clusters, hit)
    assert len(clusters.energy_dn) == 4 and len(detections.flux_dn) == 3


@pytest.mark.parametrize("rate_deg_s, times", [(0.0, ROLLING), (1.0, GLOBAL), (2.0, ROLLING)])
def test_an_attitude_from_two_frames(rate_deg_s, times):
    """The real sky to 6.5, those to 5.5 on board: towards Orion, where it is rich enough."""
    limit = replace(CATALOGUE, merge_radius=3.0 / CAMERA.focal_length_px)
    field = 2.0 * np.arctan(np.hypot(512.0, 512.0) / CAMERA.focal_length_px)
    pairs = catalogue.pair_table(catalogue.build(limit, all_stars(), 2000.0), field)
    settings = replace(
        IDENTIFY,
        method="multipole", tolerance=100.0 / 3600.0 * DEG, most_centroids=200, fewest_stars=5,
        centroid_error=0.5, detection_probability=0.7,
    )  # fmt: skip
    sky = catalogue.build(replace(limit, faintest=6.5, merge_radius=0.0), all_stars(), 2000.0)
    omega_c = rate_deg_s * DEG * np.array([0.6, 0.0, 0.8])
    rng = np.random.default_rng(5)
    orion_i = sky.u_i[sky.hip == 26311][0]  # epsilon Orionis
    q_ic = quat_normalise(np.concatenate([[1.0 + orion_i[2]], np.cross([0.0, 0.0, 1.0], orion_i)]))
    clusters = None
    for k in range(2):
        if k > 0:
            q_ic = quat_multiply(q_ic, quat_from_rotvec(omega_c * EXPOSURE_S))
        u_c = np.ascontiguousarray(sky.u_i @ dcm_from_quat(q_ic))
        xy_px = pixels(CAMERA, u_c)
        with np.errstate(invalid="ignore"):
            near = ((xy_px > -40.0) & (xy_px < 1063.0)).all(axis=1)
        image = frame(rng, times, omega_c, xy_px[near], sky.vmag[near])
        clusters, detections = objects(SETTINGS, MODEL, times, clusters, image)
    for published in (True, False):
        found, q_found = attitude(settings, MODEL, pairs, detections, published)
        assert found.reason == Reason.NONE and (found.star >= 0).sum() >= 5
        error = np.abs(rotvec_between(q_found, q_ic)) / DEG
        assert (error < [0.1, 0.1, 0.5]).all()
    few = type(detections)(*(column[:4] for column in detections))
    found, q_found = attitude(settings, MODEL, pairs, few)
    assert found.reason == Reason.TOO_FEW_STARS and np.isnan(q_found).all()
