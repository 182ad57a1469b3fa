"""SHEFEX 4 and 5: the whole chain on rendered frames, in space, on the ground, in the night-sky scenario."""

from dataclasses import replace
from functools import cache

import numpy as np

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.onboard.startracker.identify import IDENTIFIERS
from shefex_nav.onboard.startracker.objects import detect
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.rows import figure, together
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.papers.shefex2 import chain, figures
from shefex_nav.papers.shefex2.field import CAMERA, FIELD, MERGE, YEAR
from shefex_nav.papers.shefex2.frames import DETECT, MODEL, SPACE, all_stars
from shefex_nav.papers.shefex2.published import SHEFEX
from shefex_nav.papers.stills import electrons, random_attitude, still
from shefex_nav.records import FrameTruth, Reason, StarFix
from shefex_nav.report import intervals

WRONG = np.radians(0.5)
GROUND = SPACE._replace(background_electrons=700.0 * 0.05, zero_magnitude_electrons=0.7 * 2.5e6 * 0.05)
FALSE_OBJECTS, FALSE_MAGNITUDES = 250, (3.0, 6.0)  # on the whole sky
MAGNITUDE_ERROR = 0.1
SCENARIO = "night_sky"
PLACES = ("space", "ground")
WAYS = ("as printed", "as read by us", "default")
PAPERS = WAYS[:2]  # what the text has, and with the scan of our tracker, which the text leaves room for
FRAME_S = 0.1
CHAINS = {  # (way, place) -> Reading; the ground has the uniform catalogue, as section 4 says
    ("as printed", "space"): chain.COMBINED,
    ("as printed", "ground"): chain.NIGHT_SKY,
    ("as read by us", "space"): chain.COMBINED._replace(detection=chain.BLOCKS),
    ("as read by us", "ground"): chain.NIGHT_SKY._replace(detection=chain.BLOCKS),
}


@cache
def default_pairs():
    """Pairs of the default on-board catalogue."""
    settings = replace(STAR_TRACKER.catalogue, merge_radius=1.5 * MERGE)
    return catalogue.pair_table(catalogue.build(settings, load_catalogue(8.0), YEAR), FIELD)


def sky_of(rng):
    """The stars with an error of their brightness, and false objects: directions, magnitudes."""
    u_i, magnitudes = all_stars()
    false = rng.standard_normal((FALSE_OBJECTS, 3))
    false /= np.linalg.norm(false, axis=1, keepdims=True)
    scattered = magnitudes + MAGNITUDE_ERROR * rng.standard_normal(len(magnitudes))
    return np.vstack([u_i, false]), np.append(scattered, rng.uniform(*FALSE_MAGNITUDES, FALSE_OBJECTS))


def solve_frame(image, way, place):
    """Attitude of a frame by one of the chains: q_ic, or None."""
    if way in PAPERS:
        return chain.solve(CHAINS[way, place], image)
    found, _ = detect(DETECT, MODEL, image)
    u_c, pairs = unit_vectors(CAMERA, found.xy_px), default_pairs()
    result = IDENTIFIERS["bayes"](STAR_TRACKER.identification, MODEL, pairs, u_c, found.flux_dn)
    known = result.star >= 0
    if result.reason != Reason.NONE or known.sum() < STAR_TRACKER.identification.fewest_stars:
        return None
    return chain.of_stars(found, known, u_c, pairs.stars.u_i[result.star[known]])


def verdict(q_ic, truth):
    """1 solved, 0 not solved, -1 wrong."""
    if q_ic is None:
        return 0
    return 1 if np.linalg.norm(rotvec_between(q_ic, truth)) < WRONG else -1


def measure_end_to_end(samples, seed):
    """Verdicts: (samples, 7) space and ground by all chains, and frames of the scenario."""
    stills_seed, night_seed = seed.spawn(2)
    rng = np.random.default_rng(stills_seed)
    out = np.empty((samples, len(PLACES) * len(WAYS) + 1), dtype=np.int64)
    for k in range(samples):
        q_ic, (u_i, magnitudes) = random_attitude(rng), sky_of(rng)
        for p, (place, camera) in enumerate(zip(PLACES, (SPACE, GROUND), strict=True)):
            image, _ = still(camera, u_i, electrons(camera, magnitudes), q_ic, rng)
            for w, way in enumerate(WAYS):
                out[k, len(WAYS) * p + w] = verdict(solve_frame(image, way, place), q_ic)
    out[:, -1] = night(samples, night_seed)
    return out


def night(samples, seed):
    """Verdicts of so many frames of the night-sky scenario, pointed anywhere above 45 deg: (samples,)."""
    from shefex_nav import prepare, simulate
    from shefex_nav.scenario import load, shipped

    rng = np.random.default_rng(seed)
    end_s = 1.0 + (samples + 2) * FRAME_S
    overrides = (
        f"mission.time_limit={end_s + 1.0:.2f} s",
        f"star_tracker.off={end_s:.2f} s",
        f"ground.azimuth={rng.uniform(0.0, 360.0):.2f} deg",
        f"ground.roll={-rng.uniform(45.0, 90.0):.2f} deg",
    )
    scenario = load.load(shipped.files()[SCENARIO], overrides)
    run_seed = int(rng.integers(2**31))
    world = prepare.build_world(scenario, run_seed)
    truths, fixes = {}, []
    for record in simulate.route(world, scenario, run_seed):
        if isinstance(record, FrameTruth):
            truths[record.number] = record.q_ic
        elif isinstance(record, StarFix):
            fixes.append(record)
    solved = [verdict(f.q_ic if f.reason == Reason.NONE else None, truths[f.number]) for f in fixes]
    return np.array(solved[:samples])


def conclude_end_to_end(results):
    """Rows of success and wrong attitudes."""
    verdicts = np.concatenate(results)
    n = len(verdicts)
    goals = SHEFEX["identification"]
    published = (goals["success_simulated"], goals["success_night_sky"])
    columns = [
        (f"rendered stills, {place}, chain {way}", published[p] if way in PAPERS else None)
        for p, place in enumerate(PLACES)
        for way in WAYS
    ]
    columns.append((f"scenario {SCENARIO}, {len(results)} directions", published[1]))
    rows = []
    for column, (condition, goal) in enumerate(columns):
        (solved, ci95), (wrong, wrong_ci95) = (
            _share(results, column, code, column == len(columns) - 1) for code in (1, -1)
        )
        size = n if column < len(columns) - 1 else len(results)
        given = "success", condition, goal, solved, ci95
        if goal is None:
            rows.append(Row(*given))
        else:  # 'more than' 97 and 90 per cent, in whole ones
            rows.append(figure(*given, size, rounding=0.005, resolves=0.5 * (1.0 - goal), better="more"))
        rows.append(Row("share of wrong attitudes", condition, None, wrong, wrong_ci95))
    return rows


def _share(results, column, code, by_chunk):
    """Share of a verdict in a column, and its interval.

    by_chunk : the frames of a chunk are of one direction and show the same stars: it is what was drawn
    """
    parts = np.array([(chunk[:, column] == code).sum() for chunk in results])
    wholes = np.array([len(chunk) for chunk in results])
    k, n = int(parts.sum()), int(wholes.sum())
    return k / n, together(parts, wholes) if by_chunk else intervals.proportion(k, n)


EXPERIMENTS = {
    "shefex-end-to-end": Experiment(
        samples=1000,
        unit="attitudes",
        chunk=50,
        measure=measure_end_to_end,
        conclude=conclude_end_to_end,
        draw=figures.draw_end_to_end,
    ),
}
