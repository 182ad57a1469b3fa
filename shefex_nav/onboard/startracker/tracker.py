"""The star tracker chain: one frame in, one attitude or the reason for none out.

frame -> objects -> distortion taken out (`objects.ideal`) -> identify and verify -> ESOQ2 -> `StarFix`. What
comes from the navigation, the `Context`, corrects aberration, says where to look for the stars first, how
they move (`objects`), and names the reason of a failure. The attitude is that of the stars; a prediction
that they contradict is forgotten, the frame is lost in space. It rests on the gyros too where the rate
changes within the exposure, and with rows exposed one after the other, where the error of the rate is solved
for along. No attitude is given at rates for which the tracker is not made, nor of rows whose places no rate
has brought to one instant: an error message is better than a wrong attitude.

The flags of the frame set the exposure of the next one (SHEFEX-2 star tracker, section 3.1 and figure 2); the
gain stays where the scenario puts it.
"""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.fields import matrix, number, vector
from shefex_nav.geometry.distortion import corner_angles
from shefex_nav.onboard.startracker import best_attitude, objects, single
from shefex_nav.onboard.startracker import catalogue as onboard_catalogue
from shefex_nav.onboard.startracker import deep as deep_matching
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.catalogue import StarPairs
from shefex_nav.onboard.startracker.identify import IDENTIFIERS
from shefex_nav.onboard.startracker.identify.bayes import MIN_TRACKED, identify_near
from shefex_nav.onboard.startracker.identify.verify import Identification
from shefex_nav.onboard.startracker.methods import SCAN, STEPS, ways
from shefex_nav.onboard.startracker.settings import StarTracker, contradiction
from shefex_nav.records import NO_STARS, CameraCommand, Reason, StarFix

NO_ATTITUDE = np.full(4, np.nan)
NO_COVARIANCE = np.full((3, 3), np.nan)
NO_SOLUTION = NO_ATTITUDE, NO_COVARIANCE, np.nan


class TrackerParams(NamedTuple):
    """Settings of the star tracker, and what it knows of its camera and of the mission."""

    settings: StarTracker
    camera: CameraModel  # its zero_flux is that of the longest exposure
    earth_velocity_i: np.ndarray  # (3,) m/s, of the Earth relative to the solar-system barycentre
    vectors: bool = False  # near the predicted attitude, one or two stars are given as well

    def velocity_i(self, context):
        """(3,) m/s, of the vehicle by a Context; that of the Earth where it says none."""
        return self.earth_velocity_i if context.velocity_i is None else context.velocity_i


class Context(NamedTuple):
    """What the navigation knows at the time of the frame; NaN or None where it does not."""

    velocity_i: vector("m/s", "of the vehicle relative to the solar-system barycentre") = None
    rate: number("rad/s", "of the body") = np.nan
    sun_angle: number("rad", "boresight to the Sun") = np.nan
    limb_angle: number("rad", "boresight to the Earth's limb") = np.nan
    q_ic: vector("", "predicted attitude, camera to inertial axes", 4) = None
    P_c: matrix("rad^2", "of that, camera axes") = None  # of the rotation vector of its error
    omega_c: vector("rad/s", "mean rate of the exposure, camera axes") = None
    P_omega_c: matrix("", "of that [rad^2/s^2]") = None
    # table of `geometry.unsteady`
    unsteady_c: number("", "s from its instant; turn besides the mean rate [rad], x y z", (-1, 4)) = None
    unsteady_variance: number("rad^2", "of the mean of that, each axis") = 0.0  # the same for all stars


NO_CONTEXT = Context()


class Tracker(NamedTuple):
    """Star tracker ready to run: settings and database."""

    params: TrackerParams
    pairs: StarPairs
    deep: deep_matching.DeepStars | None = None  # with identification.deepest

    @property
    def stars(self):
        """OnboardCatalogue that the names of objects are rows of."""
        return self.pairs.stars if self.deep is None else self.deep.stars


class TrackerState(NamedTuple):
    """What the chain remembers from frame to frame."""

    exposure_s: float  # as commanded last
    memory: Any = None  # objects.Found.memory of the frame before
    misfits: float = 0.0  # share of late frames that were refused for their residuals, `denied`
    attitude: best_attitude.Seen = best_attitude.NOT_SEEN  # the last one, given out or not


def init(params, catalogue, julian_year):
    """Build the database of stars and pairs.

    Parameters
    ----------
    params : TrackerParams
    catalogue : StarCatalogue, all stars to V = 8: the faint ones shift the light of their neighbours
    julian_year : float, epoch of the mission; proper motion is corrected once, here

    Returns
    -------
    Tracker
    """
    settings, camera = params.settings, params.camera.pinhole
    method, scan = settings.identification.method, settings.detection.scan
    if method not in STEPS["identification"].ways():
        raise ValueError(f"unknown star identification {method!r}")
    if settings.identification.tracking and method != "bayes":
        raise ValueError(f"star identification {method!r} cannot use a prediction")
    if (words := contradiction(settings.identification)) is not None:
        raise ValueError(f"star identification: {words[1]}")
    if scan not in (known := ways(SCAN)):
        raise ValueError(f"unknown scan {scan!r}; choose from: {', '.join(known)}")
    angles = corner_angles(camera, params.camera.distortion)
    field = float(max(angles[0] + angles[3], angles[1] + angles[2]))  # no two stars are further apart
    pairs = _pairs(settings.catalogue, _Same(catalogue), julian_year, field, float(angles.max()))
    deep = None
    if settings.identification.deepest is not None:
        deep = deep_matching.build(settings, pairs.stars, catalogue, julian_year)
    return Tracker(params, pairs, deep)


class _Same:
    """A catalogue as a key: equal to itself alone, without a look at its arrays."""

    def __init__(self, catalogue):
        self.catalogue = catalogue

    def __hash__(self):
        return id(self.catalogue)

    def __eq__(self, other):
        return self.catalogue is other.catalogue


@lru_cache(maxsize=4)  # a campaign asks for the same ones every time, a study for those of several missions
def _pairs(settings, same, julian_year, field, radius):
    """StarPairs of settings.Catalogue, the _Same of a catalogue, year; `pair_table` has the angles."""
    stars = onboard_catalogue.build(settings, same.catalogue, julian_year)
    return onboard_catalogue.pair_table(stars, field, radius)


def start(tracker, t_s):
    """(state, command) with which the camera is switched on. Tracker, s -> TrackerState, CameraCommand."""
    exposure = tracker.params.settings.exposure
    return TrackerState(exposure.start), CameraCommand(t_s, exposure.start, exposure.gain)


def step(tracker, state, frame, context):
    """Process one frame.

    Parameters
    ----------
    tracker : Tracker
    state : TrackerState
    frame : Frame
    context : Context

    Returns
    -------
    TrackerState
    StarFix, with the attitude or the reason for none
    CameraCommand for the next frame
    """
    params = tracker.params
    search = objects.SEARCHES.get(params.settings.detection.scan, objects.as_spots)
    kept = None
    for seen in search(params, tracker.pairs.stars, state.memory, frame, context):
        ideal = objects.ideal(params.camera, seen.detections)
        result = attitude_with_stars(of_frame(tracker, frame, seen), ideal, context, seen.rate)
        solved = result[1] == Reason.NONE
        if solved or not seen.guess:
            kept = seen, result
        if solved:
            break
    return concluded(tracker, state, frame, context, *kept)


def of_frame(tracker, frame, seen):
    """`of_exposure`; what the gyros do not know of a rate that changes differs from row to row as well.

    seen : objects.Found
    """
    exposed = of_exposure(tracker, frame.exposure_s)
    if frame.line_s == 0.0 or not seen.variance:
        return exposed
    params = exposed.params
    moved_px = params.camera.pinhole.focal_length_px * math.sqrt(seen.variance)
    settings = replace(params.settings, centroid_floor=math.hypot(params.settings.centroid_floor, moved_px))
    return exposed._replace(params=params._replace(settings=settings))


def of_exposure(tracker, exposure_s):
    """The tracker for frames of an exposure: how much light a star gives. Tracker, s -> Tracker"""
    params = tracker.params
    zero_flux = params.camera.zero_flux * exposure_s / params.settings.exposure.longest
    return tracker._replace(params=params._replace(camera=params.camera._replace(zero_flux=zero_flux)))


def concluded(tracker, state, frame, context, seen, result):
    """What a frame ends with once its objects have been searched.

    Parameters
    ----------
    tracker, state, frame, context : as in `step`
    seen : objects.Found
    result : what `identified` returns

    Returns
    -------
    as `step`
    """
    settings, detections, mean_dn = tracker.params.settings, seen.detections, seen.statistics.mean_dn
    now = best_attitude.Seen(frame.t_valid_s, context.rate, result[2][0])
    is_fast = best_attitude.is_fast(settings.highest_rate, state.attitude, now)
    (found, reason, solution, stars), misfits = _given(
        tracker, state.misfits, frame, context, seen, is_fast, result
    )
    flag_saturated, flag_no_stars = flags(settings.exposure, mean_dn, detections)
    is_known = (found.star >= 0) & (found.reason == Reason.NONE)  # an ambiguous match names no star
    hip = np.where(is_known, tracker.stars.hip[found.star], 0)
    q_ic, P_c, residual_px = solution
    if seen.variance is not None:
        P_c, stars = P_c + seen.variance * np.eye(3), with_common_error(stars, seen.variance)
    fix = StarFix(
        number=frame.number,
        t_valid_s=frame.t_valid_s,
        t_available_s=frame.t_available_s + settings.latency,
        reason=int(reason),
        q_ic=q_ic,
        P_c=P_c,
        detections=detections,
        hip=hip,
        residual_px=residual_px,
        background_dn=mean_dn,
        exposure_s=frame.exposure_s,
        flag_saturated=flag_saturated,
        flag_no_stars=flag_no_stars,
        scan=seen.scan,
        stars=stars,
        straight=seen.variance is not None,
    )
    exposure_s = next_exposure(settings.exposure, state.exposure_s, flag_saturated, flag_no_stars)
    command = CameraCommand(fix.t_available_s, exposure_s, settings.exposure.gain)
    last = state.attitude if result[1] != Reason.NONE else now
    return TrackerState(exposure_s, seen.memory, misfits, last), fix, command


def _given(tracker, misfits, frame, context, seen, is_fast, result):
    """The result without what must not be given out, and the misfits after this frame.

    misfits : of the TrackerState before it;  is_fast : bool, the frame was taken too fast
    the others : as of `concluded`
    """
    params, (found, reason, solution, stars) = tracker.params, result
    if is_fast or not seen.at_instant:
        stars = NO_STARS
        if reason == Reason.NONE:
            reason, solution = Reason.SMEARED, NO_SOLUTION
    elif params.vectors and reason in single.UNSOLVED:
        ideal = objects.ideal(params.camera, seen.detections)
        found, reason, stars = _single(of_frame(tracker, frame, seen), ideal, context, seen.rate, reason)
    reason = reason if reason == Reason.NONE else explain(params, reason, seen.statistics.mean_dn, context)
    shows_lens = seen.at_instant and not is_fast  # else residuals are those of motion that nobody knows
    is_denied, after = best_attitude.denied(misfits, reason if shows_lens else None)
    if is_denied:
        stars = NO_STARS
        if reason == Reason.NONE:
            reason, solution = Reason.RESIDUALS, NO_SOLUTION
    return (found, reason, solution, stars), after


def with_common_error(stars, variance):
    """StarVectors with an error that all of them share, rad^2 on each axis.

    As independent errors it is averaged away; n times as large, it is left in the mean of n stars.
    """
    return stars._replace(P_u=stars.P_u + len(stars.hip) * variance * np.eye(2)) if variance > 0.0 else stars


def attitude(tracker, detections, context, rate=None):
    """Identify a list of objects and find the attitude that they show.

    Parameters
    ----------
    tracker : Tracker
    detections : Detections, brightest first, of an ideal pinhole
    context : Context
    rate : as in `best_attitude.of_named`

    Returns
    -------
    Identification
    Reason; NONE when there is an attitude
    (q_ic, P_c, residual_px), NO_SOLUTION without one
    """
    return attitude_with_stars(tracker, detections, context, rate)[:3]


def attitude_with_stars(tracker, detections, context, rate=None):
    """`attitude`, and the StarVectors of the stars that make it."""
    params = tracker.params
    u_c, P_px = best_attitude.directions(params, detections, rate)
    found, least = _identify(tracker, u_c, detections.flux_dn, context, P_px)
    return identified(tracker, detections, context, found, least, rate)


def identified(tracker, detections, context, found, least, rate=None):
    """The attitude that identified objects show.

    Parameters
    ----------
    tracker, detections, context, rate : as in `attitude`
    found : Identification
    least : int, fewest stars that make an attitude

    Returns
    -------
    as `attitude`, and the StarVectors of the stars that make it
    """
    if found.reason != Reason.NONE:
        return found, found.reason, NO_SOLUTION, NO_STARS
    params = tracker.params
    velocity_i = params.velocity_i(context)
    n_used, *solution, stars = best_attitude.of_named(
        params, tracker.pairs.stars, found.star, detections, velocity_i, least, rate
    )
    if n_used < least:
        return found, Reason.RESIDUALS, NO_SOLUTION, NO_STARS
    if tracker.deep is not None:
        better = deep_matching.attitude(
            params, tracker.deep, found.star, solution, detections, velocity_i, least, rate
        )
        if better is not None:
            named, solution, stars = better
            found = found._replace(star=named)
    return found, Reason.NONE, tuple(solution), stars


def _single(tracker, detections, context, rate, reason):
    """Single stars near their predicted places. -> Identification, Reason, StarVectors"""
    params = tracker.params
    P_px = best_attitude.centroid_covariance(params, detections)
    P_px = P_px + best_attitude.focal_covariance(params, detections.xy_px)
    star, stars, ambiguous = single.identify(params, tracker.pairs.stars, detections, P_px, context, rate)
    named = Identification(star, int(Reason.NONE), np.nan)
    return named, Reason.AMBIGUOUS if ambiguous else reason, stars


def _identify(tracker, u_c, flux, context, P_px):
    """(Identification, fewest stars that make an attitude)."""
    params, settings = tracker.params, tracker.params.settings.identification
    if settings.tracking and context.q_ic is not None and np.isfinite(context.q_ic.sum() + context.P_c.sum()):
        prediction = context.q_ic, context.P_c
        found, tracked = identify_near(settings, params.camera, tracker.pairs, u_c, flux, prediction, P_px)
        return found, MIN_TRACKED if tracked else settings.fewest_stars
    identify = IDENTIFIERS[settings.method]
    return identify(settings, params.camera, tracker.pairs, u_c, flux, P_px), settings.fewest_stars


def explain(params, reason, mean_dn, context):
    """The most telling reason for a frame without attitude; comparisons with NaN are False."""
    if context.sun_angle < params.camera.sun_exclusion:
        return Reason.SUN_EXCLUSION
    if context.limb_angle < params.camera.earth_exclusion:
        return Reason.EARTH_EXCLUSION
    if mean_dn > params.settings.exposure.brightest_mean:
        return Reason.SATURATED
    if context.rate > params.settings.highest_rate:
        return Reason.SMEARED
    return reason


def flags(settings, mean_dn, detections):
    """(flagSaturated, flagNoStars) of one frame. ExposureControl, float, Detections

    A planet saturates many pixels of one object; shortening the exposure for it would lose the fainter
    stars, so several objects must be saturated. A frame that is bright as a whole is flagged by its mean.
    """
    saturated = np.count_nonzero(detections.n_saturated > settings.saturated_pixels)
    flag_saturated = mean_dn > settings.brightest_mean or saturated >= settings.saturated_objects
    return flag_saturated, len(detections.flux_dn) < settings.fewest_objects


def next_exposure(settings, exposure_s, flag_saturated, flag_no_stars):
    """Exposure of the next frame [s]: one step shorter, longer or the same.

    flagSaturated goes first: a bright frame without stars must not be exposed longer.
    """
    if flag_saturated:
        return max(settings.shortest, exposure_s - settings.step)
    if flag_no_stars:
        return min(settings.longest, exposure_s + settings.step)
    return exposure_s
