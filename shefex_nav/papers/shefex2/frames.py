"""SHEFEX 3.2: frames of its camera, and two ways to scan them."""

import time
from dataclasses import replace
from functools import cache

import numpy as np

from shefex_nav.environment.stars import load_catalogue, silicon_magnitude
from shefex_nav.onboard.startracker import background, scan
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.objects import rules
from shefex_nav.papers import rows
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.shefex2.field import CAMERA, in_view
from shefex_nav.papers.shefex2.published import SHEFEX
from shefex_nav.papers.stills import StillCamera, electrons, on_detector, random_attitude, still
from shefex_nav.papers.verdict import POINTS
from shefex_nav.report import intervals
from shefex_nav.world.camera.detector import Electronics

# the camera of the mission at 24 dB and 50 ms: see scenarios/shefex2_andoya.yaml
PER_DN = 118.0 * 10.0 ** (-24.0 / 20.0)
SPACE = StillCamera(CAMERA, 0.8, Electronics(16.0, 30e3, PER_DN, 16.0), 400.0 * 0.05, 2.5e6 * 0.05)
DETECT = STAR_TRACKER.detection
MODEL = CameraModel(CAMERA, electrons_per_dn=PER_DN)


@cache
def all_stars():
    """Directions and silicon magnitudes of the stars to V 8: (n, 3), (n,)."""
    stars = load_catalogue(8.0)
    return stars.u_i, silicon_magnitude(stars.vmag, stars.bv)


OBJECTS = (12, 20)  # of a frame, and fixed as the most: the paper does not say how many it had [E]
FAINTEST = {12: 5.5, 20: 6.0}  # silicon magnitude: as many stars to 5.5 are a rare field
REPEATS = 5
SCANS = (scan.sequential, scan.maximum_search)
RATIO = SHEFEX["scan_ms_on_650MHz"]["maximum_search"] / SHEFEX["scan_ms_on_650MHz"]["sequential"]
PRINTED = SHEFEX["scan_ms_on_650MHz"]  # to 1 and 0.1 ms
ROUNDING = RATIO * (0.5 / PRINTED["maximum_search"] + 0.05 / PRINTED["sequential"])


def frame_of(rng, n_stars):
    """A frame with the n brightest stars of a random field of view, all clear of the border, and no more."""
    u_i, magnitudes = all_stars()
    while True:
        q_ic = random_attitude(rng)
        rows, xy_px = in_view(u_i, q_ic)
        rows = rows[on_detector(CAMERA, xy_px, 10.0)]
        rows = rows[np.argsort(magnitudes[rows])][:n_stars]
        separate = np.arccos(np.clip(u_i[rows] @ u_i[rows].T, -1.0, 1.0)) + 9.0 * np.eye(len(rows))
        bright = len(rows) == n_stars and magnitudes[rows[-1]] < FAINTEST[n_stars]
        if bright and separate.min() > 12.0 / CAMERA.focal_length_px:
            return still(SPACE, u_i[rows], electrons(SPACE, magnitudes[rows]), q_ic, rng)[0]


def measure_scan(samples, seed):
    """Of each frame and number of objects, as `_timed`: (samples, len(OBJECTS), 4)."""
    rng = np.random.default_rng(seed)
    out = np.empty((samples, len(OBJECTS), 4))
    for k in range(samples + 1):  # the first one compiles
        for n, objects in enumerate(OBJECTS):
            out[k - 1, n] = _timed(frame_of(rng, objects), rules(replace(DETECT, most_objects=objects)))
    return out


def _timed(image, chosen):
    """Of one frame: seconds of SCANS and of the steps before them, medians, and whether the tables agree."""
    blocks = background.block_sums(image)
    level, sigma, _ = background.tile_statistics(blocks, DETECT.tile)
    seconds, tables = np.full((REPEATS, 3), np.inf), []
    for repeat in range(REPEATS):
        for s, method in enumerate(SCANS):
            work = blocks.copy()
            begin = time.perf_counter()
            table = method(image, work, level, sigma, chosen)
            seconds[repeat, s] = time.perf_counter() - begin
            if repeat == 0:
                tables.append(table)
        begin = time.perf_counter()
        background.tile_statistics(background.block_sums(image), DETECT.tile)
        seconds[repeat, 2] = time.perf_counter() - begin
    return (*np.median(seconds, axis=0), same_objects(*tables))


def same_objects(one, other):
    """Whether two tables hold the same objects: as many pixels each, at the same place.

    Not to the last digit: an object on the edge of a tile takes the background of the tile it was met in.
    """
    if len(one) != len(other):
        return False
    one, other = (table[np.argsort(table[:, scan.X])] for table in (one, other))
    place = np.abs(one[:, [scan.X, scan.Y]] - other[:, [scan.X, scan.Y]]).max(initial=0.0)
    return bool((one[:, scan.PIXELS] == other[:, scan.PIXELS]).all() and place < 0.1)


FASTER = "frames whose sequential scan is the faster"
MOST = {"least": np.nextafter(0.5, 1.0), "resolves": POINTS}


def _faster(ratio):
    """Share of the frames with a ratio above 1, its interval, and their number."""
    k, n = int((ratio > 1.0).sum()), len(ratio)
    return k / n, intervals.proportion(k, n), n


def conclude_scan(results):
    """Rows of the ratio and what it is made of.

    The paper's method has no background step: the ratio with it stands beside the one that is judged.
    """
    fewer, more = np.concatenate(results).transpose(1, 0, 2)
    judged, with_more = _ratio_row(OBJECTS[0], fewer), _ratio_row(OBJECTS[1], more)
    words = f"a maximum search passes once more over the frame for each object; with {OBJECTS[1]} of them"
    judged = rows.explained(judged, with_more, f"shefex-scan/{OBJECTS[1]} objects", words, passes=True)
    faster = _faster(fewer[:, 1] / fewer[:, 0])
    return [
        rows.statement(FASTER, f"{OBJECTS[0]} objects", None, *faster, **MOST),
        judged,
        rows.variant(with_more),
        *_scan_rows(OBJECTS[0], fewer),
        *_scan_rows(OBJECTS[1], more),
    ]


def _ratio_row(objects, seconds):
    """Ratio of the scans alone beside the published one. (n, 4) of `measure_scan`"""
    ratio = seconds[:, 1] / seconds[:, 0]
    given = f"{objects} objects, median of frames, scan alone", RATIO, float(np.median(ratio))
    how = {"rounding": ROUNDING, "resolves": 1.0}
    return rows.figure(RATIO_WORDS, *given, intervals.percentile(ratio, 50.0), len(ratio), **how)


def _scan_rows(objects, seconds):
    """What the ratio is made of, without a verdict."""
    sequential, maximum, before, same = seconds.T
    condition = f"{objects} objects, median of frames"
    whole = (maximum + before) / (sequential + before)
    return [
        rows.median(RATIO_WORDS, f"{condition}, with background and noise of the frame", whole),
        rows.median("sequential scan [ms]", condition, 1e3 * sequential),
        rows.median("maximum search [ms]", condition, 1e3 * maximum),
        rows.share("frames with the same objects by both", condition, same.sum(), len(same)),
    ]


RATIO_WORDS = "time of maximum search over sequential scan"
