"""Star camera and star tracker without pictures: the second way of `simulate`.

In the place of a picture the world says what its detection would find (`world.camera.sightings`); in the
place of the search among the catalogue, fitted shares say whether the stars of the frame are identified. All
that follows (aberration, attitude, covariance, outliers, reasons, exposure control) is the tracker's own
code, and its records go the same way at the same times. So the filter cannot tell the two apart.
"""

from bisect import bisect_right
from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply
from shefex_nav.onboard.startracker import objects
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.onboard.startracker.background import FrameStatistics
from shefex_nav.onboard.startracker.identify.bayes import MIN_TRACKED
from shefex_nav.onboard.startracker.identify.verify import Identification
from shefex_nav.records import Reason
from shefex_nav.world import noise
from shefex_nav.world.absent import STAR_NOISE
from shefex_nav.world.camera import sightings, undrawn

FRAMES = "statistical"  # the scenario's word for it
LOST_S = 1.0  # without a fix for so long, the next one is a first one


class OutsideModelError(UserError):
    """A flight for which the statistics of the star tracker do not hold."""


class IdentificationModel(NamedTuple):
    """What rendered pictures showed of the search among the catalogue, and how far they reach."""

    stars: np.ndarray  # (k,) int, catalogue stars among the objects of a frame, ascending
    first: np.ndarray  # (k,) share of frames with so many that are identified, without a fix before
    later: np.ndarray  # (k,) likewise, soon after a fix
    wrong: np.ndarray  # (k,) share of these attitudes that is wrong
    named: float  # share of the catalogue stars of an identified frame that get their name
    wrong_turns: np.ndarray  # (m, 3) rad, by how much those were wrong
    fastest: float  # rad/s, of the frames that gave an attitude


def is_wanted(scenario):
    """Whether a scenario's star tracker is to fly by statistics."""
    return scenario.star_tracker.enabled and scenario.star_tracker.frames == FRAMES


def models(scenario):
    """SightingModel and IdentificationModel of a scenario that names them."""
    model = scenario.star_tracker.model
    sight, search = model.sightings, model.identification
    table = np.array(search.table, dtype=float).reshape(-1, 4)
    return (
        sightings.SightingModel(
            detection=np.array(sight.detection),
            border_px=sight.border,
            clutter=np.array(sight.clutter),
            noise=np.array(sight.noise),
            reported=np.array(sight.reported),
            saturation_electrons=np.inf if sight.saturation is None else sight.saturation,
            mean_offset_dn=sight.mean_offset,
        ),
        IdentificationModel(
            stars=table[:, 0].astype(np.int64),
            first=table[:, 1],
            later=table[:, 2],
            wrong=table[:, 3],
            named=search.named,
            wrong_turns=np.array(search.wrong_turns, dtype=float).reshape(-1, 3),
            fastest=search.fastest,
        ),
    )


class Statistical:
    """Star camera and star tracker of one run.

    scenario, world : Scenario, prepare.World
    tracker : star_tracker.Tracker
    seed : int, of the run
    line : faults.StarLine
    """

    def __init__(self, scenario, world, tracker, seed, line):
        self.sightings, self.search = models(scenario)
        if STAR_NOISE in scenario.without:
            self.sightings = self.sightings._replace(noise=np.zeros_like(self.sightings.noise))
        settings = tracker.params.settings
        merge_radius = settings.catalogue.merge_radius
        self.camera = undrawn.catalogued(tracker.pairs.stars, world.camera, merge_radius)
        self.line, self.rng = line, noise.generator(seed, "sightings")
        self.highest_rate, self.detection = settings.highest_rate, settings.detection
        hip = tracker.pairs.stars.hip
        self.by_hip = np.argsort(hip, kind="stable")
        self.sorted_hip, self.known = hip[self.by_hip], self.search.stars.tolist()
        self.seen = {}  # Sighting of each frame under way, by its number
        self.fixed_s = -np.inf

    def expose(self, _camera, command, trajectory, number, t_start_s, _rng):
        """A frame without pixels and its truth, as `camera.expose`."""
        frame, truth, film, scene = undrawn.look(self.camera, command, trajectory, number, t_start_s)
        self._check_rate(truth)
        self.seen[number] = sightings.sight(
            self.sightings, self.camera, film, scene, self.rng, self.detection
        )
        return frame, truth

    def step(self, tracker, state, frame, context):
        """As `star_tracker.step`, of a frame of `expose`."""
        sighting = self.seen.pop(frame.number)
        if self.line.blinds(frame.t_valid_s):
            full_dn = 2.0**frame.bits - 1.0
            sighting = sightings.Sighting(sightings.NOTHING, np.zeros(0, dtype=np.int64), full_dn)
        found, least, wrong = self._identification(tracker, sighting, frame, context)
        ideal = objects.ideal(tracker.params.camera, sighting.detections)
        result = star_tracker.identified(tracker, ideal, context, found, least)
        if result[1] == Reason.NONE and self.rng.random() < wrong:
            result = self._misled(*result)
        statistics = FrameStatistics(sighting.mean_dn, np.nan, np.nan)
        seen = objects.Found(sighting.detections, statistics, int(objects.Scan.UNKNOWN), True)
        state, fix, command = star_tracker.concluded(tracker, state, frame, context, seen, result)
        if fix.reason == Reason.NONE:
            self.fixed_s = frame.t_valid_s
        return state, fix, command

    def _identification(self, tracker, sighting, frame, context):
        """(Identification, fewest stars that make an attitude, chance that it is wrong), by fitted shares."""
        rng, search = self.rng, self.search
        is_first = frame.t_valid_s - self.fixed_s > LOST_S
        settings = tracker.params.settings.identification
        least = MIN_TRACKED if settings.tracking else settings.fewest_stars
        star = np.full(len(sighting.hip), -1, dtype=np.int64)
        candidates = np.flatnonzero(sighting.hip > 0)
        chance, names = rng.random(), rng.random(len(candidates))
        if len(candidates) < least:
            return Identification(star, int(Reason.TOO_FEW_STARS), np.nan), least, 0.0
        row = bisect_right(self.known, len(candidates)) - 1
        if row < 0 and not context.rate > self.highest_rate:  # faster, it gives no attitude anyway
            raise OutsideModelError(
                f"the frame at T{frame.t_valid_s:+.2f} s shows {len(candidates)} stars of the catalogue; the "
                f"statistics of the star tracker begin at {search.stars[0]}: fly with frames: rendered, or "
                "characterise with a mission that shows so few"
            )
        share = search.first if is_first else search.later
        if row < 0 or chance >= share[row]:
            return Identification(star, int(Reason.NO_MATCH), np.nan), least, 0.0
        named = candidates[names < search.named]
        star[named] = self.by_hip[self.sorted_hip.searchsorted(sighting.hip[named])]
        reason = Reason.NONE if len(named) >= least else Reason.TOO_FEW_STARS
        return Identification(star, int(reason), np.nan), least, search.wrong[row]

    def _misled(self, found, reason, solution, stars):
        """The result of a frame, turned away as wrong ones were: the stars under the names of others.

        The catalogue's directions are turned, so that single stars and attitude say the same wrong thing. The
        names stay those of the stars that were seen: which others they would be taken for is not modelled.
        """
        turns = self.search.wrong_turns  # from the attitude to the true one
        turn = quat_from_rotvec(-turns[self.rng.integers(len(turns))])
        q_ic, *rest = solution
        wrong_ic = quat_multiply(q_ic, turn)
        C_wrong = dcm_from_quat(wrong_ic) @ dcm_from_quat(q_ic).T  # true to wrong directions in space
        return found, reason, (wrong_ic, *rest), stars._replace(u_i=stars.u_i @ C_wrong.T)

    def _check_rate(self, truth):
        """Refuse a frame that is slow enough for an attitude and faster than any that was characterised."""
        if self.search.fastest < truth.rate <= self.highest_rate:
            found, limit = np.degrees(truth.rate), np.degrees(self.search.fastest)
            raise OutsideModelError(
                f"the camera turns at {found:.3g} deg/s at T{truth.t_valid_s:+.2f} s; the statistics of the "
                f"star tracker reach to {limit:.3g} deg/s: fly with frames: rendered, or characterise with a "
                "mission that turns as fast"
            )
