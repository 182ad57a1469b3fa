"""IMPA tables 3 to 5: errors of the centroids at the frame's instant, and ours on the same frames.

Each sample is an attitude and a direction; at each rate and with each shutter two contiguous frames are made.
Of the second one every cluster that the fusion kept is compared with the star nearest to its compensated
place, if there is one within SAME_PX; the same pairs make the table without compensation. Ours are compared
with the nearest star too. A star is apart where no other one's streak comes within BLEND_PX of its own: of
those that are not a cluster may hold two, and the paper does not say what it compares them with.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply
from shefex_nav.onboard.startracker import best_attitude
from shefex_nav.papers.experiment import Experiment
from shefex_nav.papers.impa import bound, centroid_tables, experiments, field, flight, trackers
from shefex_nav.papers.impa.centroid_tables import BOX, COLUMNS, JOINT, KINDS, PUBLISHED, with_spot
from shefex_nav.papers.impa.methods import chain, multipole
from shefex_nav.papers.impa.methods import clusters as cluster
from shefex_nav.papers.impa.methods.compensate import FORMS
from shefex_nav.papers.impa.published import IMPA

SAME_PX = 5.0  # a cluster further from every star is none, or a piece of a broken streak
BLEND_PX = 5.0  # between two streaks: the spots of both, three sigma each, are not parted by a gap
INSTANTS = np.linspace(-0.5, 0.5, 9)  # of an exposure: a streak of 51 px has one every 6
SAMPLES = 520  # each direction and attitude as evenly as can be, at five rates with two shutters
OWN_EVERY = 3  # samples; no divisor of 26 directions or 200 attitudes, so that it meets them all


class Truth(NamedTuple):
    """Stars of a frame."""

    xy_px: np.ndarray  # (n, 2) at the instant
    light: np.ndarray  # (n,) electrons of a row's exposure
    apart: np.ndarray  # (n,) bool


def truth(shutter, case, number):
    """What is to be seen in a frame: Truth."""
    q_ic = field.attitude_at(case, number)
    u_i, light = flight.near_stars(field.camera(shutter), q_ic)
    return Truth(pixels(field.CAMERA, u_i @ dcm_from_quat(q_ic)), light, apart(case, number, u_i))


def apart(case, number, u_i):
    """Which stars have a streak of their own in a frame. Case, int, (n, 3) -> (n,) bool"""
    from scipy.spatial import cKDTree

    q_ic = field.attitude_at(case, number)
    turned = (quat_from_rotvec(case.omega_c * field.EXPOSURE_S * part) for part in INSTANTS)
    paths = np.array([pixels(field.CAMERA, u_i @ dcm_from_quat(quat_multiply(q_ic, one))) for one in turned])
    length = np.linalg.norm(paths[-1] - paths[0], axis=1).max(initial=0.0)
    middle = paths[len(INSTANTS) // 2]
    one, other = cKDTree(middle).query_pairs(length + BLEND_PX, output_type="ndarray").T
    between = np.linalg.norm(paths[:, None, one] - paths[None, :, other], axis=-1).min(axis=(0, 1))
    out = np.ones(len(u_i), dtype=bool)
    out[np.concatenate([one, other])[np.tile(between <= BLEND_PX, 2)]] = False
    return out


def nearest(xy_px, stars):
    """Star nearest to each place, -1 beyond SAME_PX: (n,) int."""
    if not len(xy_px) or not len(stars):
        return np.full(len(xy_px), -1)
    distance = np.linalg.norm(xy_px[:, None] - stars[None], axis=2)
    row = distance.argmin(axis=1)
    return np.where(distance.min(axis=1) < SAME_PX, row, -1)


def published_errors(times, first, second, stars):
    """Errors of the paper's centroids in the second of two frames.

    Returns
    -------
    star : (m,) row of Truth of each fused cluster, -1 for none
    errors : (3, m, 2) px; compensated as in FORMS, and not compensated
    is_recognised : (m,) bool
    """
    settings = trackers.DETECT.run_length
    one, two = (cluster.find(trackers.DETECT, trackers.MODEL, image) for image in (first, second))
    rows, shift_px = chain.fused(settings, one, two, second.shape)
    moved = [chain.compensated(settings, times, two, rows, shift_px, form) for form in FORMS]
    places = [*(streaks.xy_px for streaks in moved), two.xy_px[rows]]
    star = nearest(places[0], stars.xy_px)
    return star, np.array(places) - stars.xy_px[star], recognised(times, two.energy_dn[rows], moved[0])


def recognised(times, energy_dn, streaks):
    """Which streaks the paper's identification names, believed as published. (m,) -> (m,) bool"""
    flux_dn, order = chain.brightest_first(times, energy_dn, streaks)
    u_c = unit_vectors(trackers.MODEL.pinhole, streaks.xy_px[order])
    found = multipole.match(trackers.IDENTIFY, trackers.MODEL, field.pairs(False), u_c, flux_dn[order])
    out = np.zeros(len(flux_dn), dtype=bool)
    out[order] = found.star >= 0
    return out


def published_rows(kinds, case, frames, stars, times):
    """Rows of the paper's chain: list of (len(COLUMNS),). kinds: of errors as `published_errors` has them."""
    star, errors, is_recognised = published_errors(times, *frames, stars)
    rows = []
    for kind, error in zip(kinds, errors, strict=False):
        for s, e, known in zip(star, error, is_recognised, strict=True):
            row = _row(case, kind, s, e, stars.light[s])
            row[COLUMNS.index("apart")], row[COLUMNS.index("recognised")] = stars.apart[s], known
            rows.append(row)
    return rows, set(star[star >= 0])


def frames_of(shutter, case, seed, with_own=True):
    """Rows of one case and shutter: (m, len(COLUMNS))."""
    noise, gyro_rng, *others = (np.random.default_rng(s) for s in seed.spawn(4))
    stars, times = truth(shutter, case, 1), field.times(shutter)
    kinds = PUBLISHED[:1] if shutter == "global_shutter" else PUBLISHED[1:]
    frames = flight.pictures(shutter, case, noise)
    rows, seen = published_rows(kinds, case, frames, stars, times)
    box = field.box(float(IMPA["camera"]["psf_diameter_px"]))
    spots = {BOX: {"psf": box}, JOINT: {"sigma_px": flight.JOINT.sigma_px}}
    for (name, how), rng in zip(spots.items(), others, strict=True):
        named = [with_spot(kind, name) for kind in kinds]
        rows += published_rows(named, case, flight.pictures(shutter, case, rng, **how), stars, times)[0]
    if with_own:
        rows += own_rows(shutter, case, frames[1], stars, seen, gyro_rng)
    return rows


def own_rows(shutter, case, image_dn, stars, seen, gyro_rng):
    """Rows of ours. seen: rows of Truth that the published threshold detects."""
    times, camera, rows = field.times(shutter), field.camera(shutter), []
    omega_c, P_omega_c = field.gyro(case, gyro_rng)
    found = trackers.streaks_of(image_dn, omega_c, P_omega_c, times)
    motion = trackers.streaks.Motion(omega_c, P_omega_c, times)
    rate = trackers.objects.rate_of(field.CAMERA, motion, found)
    P_px = best_attitude.with_rate(trackers.own(), found, found.P_px, rate)
    kind = "ours_" + shutter.split("_")[0]
    for k, s in enumerate(nearest(found.xy_px, stars.xy_px)):
        error = found.xy_px[k] - stars.xy_px[s]
        if s < 0:
            rows.append(_row(case, kind, s, error, np.nan))
            continue
        best = bound.bound(camera, case.omega_c, P_omega_c, stars.xy_px[s], stars.light[s])
        rows.append(_row(case, kind, s, error, stars.light[s], P_px[k], best, s in seen))
    return rows


def _row(case, kind, star, error, light, P_px=None, best=None, seen=True):
    """One row of COLUMNS."""
    row = np.full(len(COLUMNS), np.nan)
    row[:6] = round(np.degrees(case.rate)), KINDS.index(kind), star >= 0, *error, light
    if best is not None:
        turned = bound.along_across(error[None], np.array([best.heading]))[0]
        C = trackers.turn2(best.heading)
        least = C.T @ best.P_px @ C
        row[6:-3] = (
            seen, best.snr, best.inside, *turned, least[0, 0], least[1, 1],
            error @ np.linalg.solve(P_px, error),
        )  # fmt: skip
    return row


def each_case(samples, seed, first):
    """Number, Case, shutter and SeedSequence of all that samples first ... consist of: iterator."""
    for number, own in zip(range(first, first + samples), seed.spawn(samples), strict=True):
        for rate, one in zip(field.RATES, own.spawn(len(field.RATES)), strict=True):
            case = field.pair(rate, number)
            for shutter, noise in zip(field.SHUTTERS, one.spawn(2), strict=True):
                yield number, case, shutter, noise


def measure(samples, seed, first):
    """Samples first ... of the centroids: {'rows': (m, len(COLUMNS))}."""
    rows = []
    for number, case, shutter, noise in each_case(samples, seed, first):
        found = np.array(frames_of(shutter, case, noise, number % OWN_EVERY == 0))
        found = found.reshape(-1, len(COLUMNS))
        found[:, COLUMNS.index("sample")] = number
        rows.append(found)
    return {"rows": np.concatenate(rows)}


# what makes the results or says what a stored number means
KEPT = (*experiments.KEPT, "impa.centroids", "impa.centroid_tables", "impa.bound")

EXPERIMENTS = {
    "impa-centroids": Experiment(
        samples=SAMPLES,
        unit="attitudes and directions, each at five rates with both shutters",
        chunk=5,
        measure=measure,
        conclude=centroid_tables.conclude,
        draw=centroid_tables.draw,
        designed=True,
        kept=KEPT,
    ),
}
