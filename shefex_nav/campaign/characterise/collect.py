"""One rendered run for the fit: what stood before the camera in each frame, and what became of it.

The scene of a frame is the one that the statistics start from (`undrawn.look`), so whatever that leaves out
of the rendered picture is in the fit. A mission shows few frames with few stars; so frames are also searched
with some of their stars taken away, which says how often what is left is identified, and wrongly.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav import prepare, simulate
from shefex_nav.campaign.characterise.fit import FitError
from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.records import CameraCommand, Detections, FrameTruth, Reason, StarFix
from shefex_nav.statistical import LOST_S
from shefex_nav.world import noise
from shefex_nav.world.camera import sightings, undrawn

MATCH_PX = 3.0  # a detection further from a source is another one
LONELY_PX = 10.0  # sources with a brighter one nearer than that say nothing of detection
ROOM = 0.75  # of the table of objects, for the brightest sources; by what is there, not by what was found
FAINT_Q = 1.0  # sources whose brightest pixel stands out less are never found
OTHERS_EVERY = 10  # frames, of sources that are no stars of the catalogue
LATE_S = 1.0  # after the last frame, for its fix
THIN_EVERY = 5  # frames, of those searched with fewer stars
THIN_FIRST = 20  # times, of each first frame
FEWEST = 1  # stars that are left
MATCHED = Reason.NONE, Reason.RESIDUALS


class Sources(NamedTuple):
    """N sources of all frames of a run."""

    frame: np.ndarray  # (N,) row of Frames
    hip: np.ndarray  # (N,) 0: not in the catalogue
    q: np.ndarray  # (N,) contrast
    features: np.ndarray  # (N, 3) what it is found by, `sightings.features`
    along: np.ndarray  # (N, 4) parts of the variance along the streak [px^2], `sightings.terms`
    across: np.ndarray  # (N, 4)
    peak: np.ndarray  # (N,) electrons in the brightest pixel
    border_px: np.ndarray  # (N,) from its streak to the nearest border
    clear: np.ndarray  # (N,) bool, no brighter source near, and so few brighter that the table has room
    found: np.ndarray  # (N,) bool
    named: np.ndarray  # (N,) bool, identified as what it is
    saturated: np.ndarray  # (N,) bool
    error: np.ndarray  # (N, 2) px, along and across; NaN if not found
    reported: np.ndarray  # (N, 2) px^2, variances along and across


class Frames(NamedTuple):
    """M frames of a run."""

    t_s: np.ndarray
    rate: np.ndarray  # rad/s, true
    exposure_s: np.ndarray
    reason: np.ndarray  # Reason
    first: np.ndarray  # bool, no fix for LOST_S
    stars: np.ndarray  # int, stars of the catalogue among the objects
    mean_dn: np.ndarray  # mean grey value against the one expected
    level_dn: np.ndarray  # the one expected
    length_px: np.ndarray  # by which the camera turns during the exposure
    objects: np.ndarray  # int, all that the detection found
    strangers: np.ndarray  # int, those of them that are no source of the sky
    error: np.ndarray  # (M, 3) rad, of the attitude; NaN without one
    sigma: np.ndarray  # (M, 3) rad, as reported


class Searches(NamedTuple):
    """K searches of frames slow enough for an attitude, whole and with stars taken away."""

    stars: np.ndarray  # int, of the catalogue among the objects
    first: np.ndarray  # bool, no fix for LOST_S before
    matched: np.ndarray  # bool, the stars were identified; whether they fit one attitude is another question
    good: np.ndarray  # bool, gave an attitude
    error: np.ndarray  # (K, 3) rad, NaN without one


class Collected(NamedTuple):
    """One run."""

    frames: Frames
    sources: Sources
    searches: Searches


class Taken(NamedTuple):
    """What the star tracker was given of a frame."""

    tracker: object
    context: object
    fix: StarFix


def flown(scenario, seed):
    """The star tracker's time in a run: list of (Taken or None, StarFix, FrameTruth), world.World"""
    world = prepare.build_world(scenario, seed)
    taken, fixes, truths = {}, [], {}

    def step(tracker, state, frame, context):
        result = star_tracker.step(tracker, state, frame, context)
        taken[frame.number] = Taken(tracker, context, result[1])
        return result

    until_s = scenario.star_tracker.off + LATE_S
    for record in simulate.route(world, scenario, seed, until_s=until_s, step=step):
        if type(record) is StarFix:
            fixes.append(record)
        elif type(record) is FrameTruth:
            truths[record.number] = record
    return [(taken.get(fix.number), fix, truths[fix.number]) for fix in fixes], world


def fixes(scenario, seed):
    """Rows of judge.Fixes of a run, with pictures or without, as far as its last frame."""
    records, _ = flown(scenario, seed)
    rows = []
    for _, fix, truth in records:
        good = fix.reason == Reason.NONE
        n = len(fix.detections.flux_dn)
        rows.append((fix.reason, fix.exposure_s, n, _error(fix.q_ic, truth, good), np.sqrt(np.diag(fix.P_c))))
    return rows


def collect(scenario, seed):
    """Fly a rendered run as far as its last frame. Scenario, int -> Collected"""
    records, world = flown(scenario, seed)
    if not records:
        raise FitError("the star tracker takes no picture: is it on before the mission's end?")
    tracker = records[0][0].tracker
    settings = tracker.params.settings
    camera = undrawn.catalogued(tracker.pairs.stars, world.camera, settings.catalogue.merge_radius)
    gain, rng = settings.exposure.gain, noise.generator(seed, "sightings")
    frames, sources, searches, fixed_s = [], [], [], -np.inf
    for row, (taken, fix, truth) in enumerate(records):
        start_s = fix.t_valid_s - 0.5 * fix.exposure_s
        command = CameraCommand(start_s, fix.exposure_s, gain)
        _, _, film, scene = undrawn.look(camera, command, world.flight.trajectory, fix.number, start_s)
        found, stars = _matched(row, fix, film, scene, camera, settings)
        sources += found
        first = fix.t_valid_s - fixed_s > LOST_S
        good = fix.reason == Reason.NONE
        fixed_s = fix.t_valid_s if good else fixed_s
        if not taken.context.rate > settings.highest_rate:
            times = THIN_FIRST if first else int(row % THIN_EVERY == 0)
            searches += _searched(taken, truth, stars, first, times, rng)
        counts = _counts(fix.detections, film, scene)
        frames.append(
            (
                fix.t_valid_s, truth.rate, fix.exposure_s, fix.reason, first, len(stars),
                fix.background_dn - film.mean_dn, film.mean_dn,
                sightings.rotation_px(camera.pinhole, film), *counts,
                _error(fix.q_ic, truth, good), np.sqrt(np.diag(fix.P_c)),
            )
        )  # fmt: skip
    return Collected(_columns(Frames, frames), _columns(Sources, sources), _columns(Searches, searches))


def _columns(kind, rows):
    """Rows as a record of arrays."""
    if not rows:
        raise FitError(f"the run shows no {kind.__name__.lower()} that statistics could be made of")
    return kind(*(np.array(column) for column in zip(*rows, strict=True)))


def _searched(taken, truth, stars, first, times, rng):
    """Searches of one frame: as it was, and `times` with some of its stars taken away. -> rows of Searches

    stars : (n,) rows of the catalogue's stars among the objects
    """
    tracker, context, fix = taken
    good = fix.reason == Reason.NONE
    rows = [(len(stars), first, fix.reason in MATCHED, good, _error(fix.q_ic, truth, good))]
    exposed = star_tracker.of_exposure(tracker, fix.exposure_s)
    for _ in range(times if len(stars) > FEWEST else 0):
        left = int(rng.integers(FEWEST, len(stars)))
        rest = np.ones(len(fix.hip), dtype=bool)
        rest[rng.permutation(stars)[left:]] = False
        fewer = Detections(*(column[rest] for column in fix.detections))
        _, reason, solution = star_tracker.attitude(exposed, fewer, context)
        good = reason == Reason.NONE
        rows.append((left, first, reason in MATCHED, good, _error(solution[0], truth, good)))
    return rows


def _error(q_ic, truth, good):
    """Rotation vector (3,) rad from an attitude to the true one; NaN without one."""
    return rotvec_between(q_ic[None], truth.q_ic[None])[0] if good else np.full(3, np.nan)


def _matched(row, fix, film, scene, camera, settings):
    """What became of the sources of one frame.

    -> rows of Sources; rows of the objects that are stars of the catalogue
    """
    hip, xy_px, electrons = scene
    seen = fix.detections
    with_others = row % OTHERS_EVERY == 0
    size = np.array([camera.pinhole.width_px, camera.pinhole.height_px])
    room = np.sort(electrons)[::-1][int(ROOM * settings.detection.most_objects) :].max(initial=0.0)
    apart = np.linalg.norm(seen.xy_px[:, None] - xy_px[None], axis=2)  # (objects, sources)
    rows, stars = [], []
    for k in np.flatnonzero((hip > 0) | with_others):
        spot = along, across, ex, ey = sightings.shape(camera.pinhole, film, *xy_px[k])
        q = sightings.contrast(along, across, electrons[k], film.noise_electrons)
        if q < FAINT_Q:
            continue
        terms = sightings.terms(along, across, electrons[k], film.noise_electrons)
        seed_sigma = settings.detection.seed_sigma
        features = sightings.features(along, across, electrons[k], film.noise_electrons, seed_sigma)
        brighter = (electrons > electrons[k]) & (np.abs(xy_px - xy_px[k]).max(axis=1) < LONELY_PX)
        clear = electrons[k] > room and not brighter.any()
        j = int(apart[:, k].argmin()) if len(apart) else 0
        found = bool(len(apart)) and apart[j, k] < MATCH_PX
        error, reported, saturated, named = (np.nan, np.nan), (np.nan, np.nan), False, False
        if found:
            turn = np.array([[ex, ey], [-ey, ex]])
            error = turn @ (seen.xy_px[j] - xy_px[k])
            reported = np.diag(turn @ seen.P_px[j] @ turn.T)
            saturated = bool(seen.n_saturated[j] > settings.exposure.saturated_pixels)
            named = bool(hip[k] > 0 and fix.hip[j] == hip[k])
            stars += [j] if hip[k] > 0 else []
        border = sightings.margin_px(xy_px[k], spot, size)
        peak = electrons[k] / (2.0 * np.pi * along * across)
        rows.append(
            (row, hip[k], q, features, *terms, peak, border, clear, found, named, saturated, error, reported)
        )
    return rows, np.unique(np.array(stars, dtype=np.int64))


def _counts(seen, film, scene):
    """(objects of a frame, those that are no source of the sky)."""
    _, xy_px, electrons = scene
    bright = electrons > FAINT_Q * 2.0 * np.pi * film.psf_sigma_px**2 * film.noise_electrons
    apart = np.linalg.norm(seen.xy_px[:, None] - xy_px[None, bright], axis=2)
    strangers = int((apart.min(axis=1, initial=np.inf) >= MATCH_PX).sum())
    return len(seen.flux_dn), strangers
