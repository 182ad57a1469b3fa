"""The star tracker chain: one frame in, one attitude or the reason for none out.

frame -> objects -> identify and verify -> ESOQ2 -> `StarFix`; the flags of the frame set the exposure of the
next one. What comes from the navigation, the `Context`, corrects aberration, says where to look for the stars
first, how they move (`objects`), and names the reason of a failure. The attitude is that of the stars alone;
a prediction that they contradict is forgotten, the frame is lost in space. Only with rows exposed one after
the other it rests on the rate too, whose error is solved for along. No attitude is given at rates for which
the tracker is not made, nor of rows whose places no rate has brought to one instant: an error message is
better than a wrong attitude.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.pinhole import pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_conjugate
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.onboard.startracker import catalogue as onboard_catalogue
from shefex_nav.onboard.startracker import objects, single
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.onboard.startracker.catalogue import CatalogueParams, StarPairs
from shefex_nav.onboard.startracker.detect import DetectParams
from shefex_nav.onboard.startracker.exposure import ExposureParams, flags, next_exposure
from shefex_nav.onboard.startracker.identify import IDENTIFIERS
from shefex_nav.onboard.startracker.identify.bayes import MIN_TRACKED, identify_near
from shefex_nav.onboard.startracker.identify.verify import Identification, IdentifyParams
from shefex_nav.onboard.startracker.likelihood import (
    drop_worst,
    misfit_factor,
    misfit_growth,
    sigma_of_centroids,
)
from shefex_nav.records import NO_STARS, CameraCommand, Reason, StarFix

MOST_DROPPED = 0.25  # of the identified stars; one in any case
PRIOR_DOF = 10.0  # weight of the expected variance of the centroids against the one of this frame [E]
NO_ATTITUDE = np.full(4, np.nan)
NO_COVARIANCE = np.full((3, 3), np.nan)
NO_SOLUTION = NO_ATTITUDE, NO_COVARIANCE, np.nan


class TrackerParams(NamedTuple):
    """Settings of the star tracker; the nominal camera is identify.camera."""

    catalogue: CatalogueParams
    detect: DetectParams
    identify: IdentifyParams  # its zero_flux is that of the longest exposure
    exposure: ExposureParams
    earth_velocity_i: np.ndarray  # (3,) m/s, of the Earth relative to the solar-system barycentre
    centroid_floor_px: float  # independent error of every star that no pixel's noise tells: lens, catalogue
    outlier_sigma: float  # a star further than this from the attitude of the others is left out
    latency_s: float  # from the frame in memory to the attitude
    max_rate: float  # rad/s, frames taken faster give no attitude
    sun_exclusion: float  # rad
    limb_exclusion: float  # rad
    track: bool = False  # identify near the predicted attitude first
    sigma_focal: float = 0.0  # relative error of the focal length that the calibration left
    run_length: Any = None  # multipole_chain.ChainParams, for detect.scan 'run_length'
    vectors: bool = False  # near the predicted attitude, one or two stars are given as well


class Context(NamedTuple):
    """What the navigation knows at the time of the frame; NaN or None where it does not."""

    velocity_i: np.ndarray | None  # (3,) m/s, of the vehicle relative to the solar-system barycentre
    rate: float  # rad/s
    sun_angle: float  # rad, boresight to the Sun
    limb_angle: float  # rad, boresight to the Earth's limb
    q_ic: np.ndarray | None = None  # (4,) predicted attitude of the camera
    P_c: np.ndarray | None = None  # (3, 3) rad^2, covariance of its rotation-vector error in camera axes
    omega_c: np.ndarray | None = None  # (3,) rad/s, of the camera in its axes, mean of the exposure
    P_omega_c: np.ndarray | None = None  # (3, 3) (rad/s)^2, its covariance


NO_CONTEXT = Context(None, np.nan, np.nan, np.nan)


class Tracker(NamedTuple):
    """Star tracker ready to run: settings and database."""

    params: TrackerParams
    pairs: StarPairs


class TrackerState(NamedTuple):
    """What the chain remembers from frame to frame."""

    exposure_s: float  # as commanded last
    memory: Any = None  # objects.Memory of the frame before


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
    if params.identify.method not in IDENTIFIERS:
        raise ValueError(f"unknown star identification {params.identify.method!r}")
    if params.track and params.identify.method != "bayes":
        raise ValueError(f"star identification {params.identify.method!r} cannot use a prediction")
    if params.detect.scan not in objects.WAYS:
        raise ValueError(f"unknown scan {params.detect.scan!r}; choose from: {', '.join(objects.WAYS)}")
    camera = params.identify.camera
    half_diagonal = 0.5 * np.hypot(camera.width_px, camera.height_px)
    field = 2.0 * np.arctan(half_diagonal / camera.focal_length_px)
    return Tracker(params, _pairs(params.catalogue, catalogue, julian_year, field))


def _pairs(params, catalogue, julian_year, field):
    """StarPairs of a catalogue; those made last are kept, a campaign asks for the same ones every time."""
    wanted = params, julian_year, field
    if _last and _last[0] == wanted and _last[1] is catalogue:
        return _last[2]
    pairs = onboard_catalogue.pair_table(onboard_catalogue.build(params, catalogue, julian_year), field)
    _last[:] = wanted, catalogue, pairs
    return pairs


_last = []  # what was wanted, of which catalogue, StarPairs


def start(tracker, t_s):
    """(state, command) with which the camera is switched on. Tracker, s -> TrackerState, CameraCommand."""
    exposure = tracker.params.exposure
    return TrackerState(exposure.start_s), CameraCommand(t_s, exposure.start_s, exposure.gain_db)


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
    params, exposed = tracker.params, of_exposure(tracker, frame.exposure_s)
    for seen in objects.searches(params, tracker.pairs.stars, state.memory, frame, context):
        found, reason, solution, stars = _attitude(exposed, seen.detections, context, seen.rate)
        if reason == Reason.NONE:
            break
    return concluded(tracker, state, frame, context, seen, (found, reason, solution, stars))


def of_exposure(tracker, exposure_s):
    """The tracker for frames of an exposure: how much light a star gives. Tracker, s -> Tracker"""
    params = tracker.params
    zero_flux = params.identify.zero_flux * exposure_s / params.exposure.max_s
    return tracker._replace(params=params._replace(identify=params.identify._replace(zero_flux=zero_flux)))


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
    params, (found, reason, solution, stars) = tracker.params, result
    detections, mean_dn = seen.detections, seen.statistics.mean_dn
    if context.rate > params.max_rate or not seen.at_instant:  # an unknown rate is NaN, not too high
        stars = NO_STARS
        if reason == Reason.NONE:
            reason, solution = Reason.SMEARED, NO_SOLUTION
    elif params.vectors and reason in single.UNSOLVED:
        exposed = of_exposure(tracker, frame.exposure_s)
        found, reason, stars = _single(exposed, detections, context, seen.rate, reason)
    flag_saturated, flag_no_stars = flags(params.exposure, mean_dn, detections)
    is_known = (found.star >= 0) & (found.reason == Reason.NONE)  # an ambiguous match names no star
    hip = np.where(is_known, tracker.pairs.stars.hip[found.star], 0)
    q_ic, P_c, residual_px = solution
    if reason != Reason.NONE:
        reason = explain(params, reason, mean_dn, context)
    fix = StarFix(
        number=frame.number,
        t_valid_s=frame.t_valid_s,
        t_available_s=frame.t_available_s + params.latency_s,
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
    )
    exposure_s = next_exposure(params.exposure, state.exposure_s, flag_saturated, flag_no_stars)
    command = CameraCommand(fix.t_available_s, exposure_s, params.exposure.gain_db)
    return TrackerState(exposure_s, seen.memory), fix, command


def attitude(tracker, detections, context, rate=None):
    """Identify a list of objects and find the attitude that they show.

    Parameters
    ----------
    tracker : Tracker
    detections : Detections, brightest first
    context : Context
    rate : as in `solve`

    Returns
    -------
    Identification
    Reason; NONE when there is an attitude
    (q_ic, P_c, residual_px), NO_SOLUTION without one
    """
    return _attitude(tracker, detections, context, rate)[:3]


def _attitude(tracker, detections, context, rate):
    """`attitude`, and the StarVectors of the stars that make it."""
    params = tracker.params
    u_c = unit_vectors(params.identify.camera, detections.xy_px)
    P_px = centroid_covariance(params, detections)
    ellipses = with_rate(params, detections, P_px, rate)
    found, least = _identify(tracker, u_c, detections.flux_dn, context, ellipses)
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
    params, known = tracker.params, found.star >= 0
    u_c = unit_vectors(params.identify.camera, detections.xy_px)
    P_px = centroid_covariance(params, detections)
    velocity_i = params.earth_velocity_i if context.velocity_i is None else context.velocity_i
    seen_i = aberrate(tracker.pairs.stars.u_i[found.star[known]], velocity_i)
    if rate is not None:
        rate = rate[0][known], rate[1]
    solved = _solved(params, u_c[known], seen_i, P_px[known], least, rate)
    n_used, q_ic, P_c, residual_px, used, misfit = solved
    if n_used < least or not np.isfinite(q_ic.sum() + P_c.sum()):
        return found, Reason.RESIDUALS, NO_SOLUTION, NO_STARS
    rows = np.flatnonzero(known)[used]
    if rate is not None:
        rate = rate[0][used], misfit * rate[1]
    stars = single.vectors(
        params.identify.camera,
        tracker.pairs.stars.hip[found.star[rows]],
        detections.xy_px[rows],
        misfit * P_px[rows] + focal_covariance(params, detections.xy_px[rows]),
        seen_i[used],
        rate,
        params.sigma_focal,
    )
    return found, Reason.NONE, (q_ic, P_c, residual_px), stars


def _single(tracker, detections, context, rate, reason):
    """Single stars near their predicted places. -> Identification, Reason, StarVectors"""
    params = tracker.params
    P_px = centroid_covariance(params, detections) + focal_covariance(params, detections.xy_px)
    star, stars, ambiguous = single.identify(params, tracker.pairs.stars, detections, P_px, context, rate)
    named = Identification(star, int(Reason.NONE), np.nan)
    return named, Reason.AMBIGUOUS if ambiguous else reason, stars


def _identify(tracker, u_c, flux, context, P_px):
    """(Identification, fewest stars that make an attitude)."""
    params = tracker.params
    if params.track and context.q_ic is not None and np.isfinite(context.q_ic.sum() + context.P_c.sum()):
        prediction = quat_conjugate(context.q_ic), context.P_c
        found, tracked = identify_near(params.identify, tracker.pairs, u_c, flux, prediction, P_px)
        return found, MIN_TRACKED if tracked else params.identify.min_stars
    identify = IDENTIFIERS[params.identify.method]
    return identify(params.identify, tracker.pairs, u_c, flux, P_px), params.identify.min_stars


def centroid_covariance(params, detections):
    """Covariance of each centroid, (n, 2, 2) px^2: noise, and what is wrong with every one."""
    return detections.P_px + params.centroid_floor_px**2 * np.eye(2)


def focal_covariance(params, xy_px):
    """What the error of the focal length does to each place, (n, 2, 2) px^2, for stars one by one."""
    offset_px = xy_px - np.array([params.identify.camera.cx_px, params.identify.camera.cy_px])
    return params.sigma_focal**2 * offset_px[:, :, None] * offset_px[:, None, :]


def with_rate(params, detections, P_px, rate):
    """Covariance of each centroid with what the error of the rate does to it; rate as in `solve`."""
    if rate is None:
        return P_px
    t_s, P_omega = rate
    S = t_s[:, None, None] * turn_jacobians(params.identify.camera, detections.xy_px)
    return P_px + S @ P_omega @ S.transpose(0, 2, 1)


def solve(params, u_c, seen_i, P_px, least, rate=None):
    """Attitude, its covariance and the misfit; the worst star is left out until all that are used fit.

    A neighbour too faint for the catalogue or a particle hit can shift the light of a star by more than its
    error. Neither can be foreseen, but with more than four stars it shows. The variance that P_px promises
    counts as an observation of PRIOR_DOF degrees of freedom. Streaks are less certain than spots: the misfit
    of this frame's stars corrects it; that of spots only where it is more than chance makes.

    Parameters
    ----------
    params : TrackerParams
    u_c : (n, 3) measured directions
    seen_i : (n, 3) apparent directions of the stars, aberration included
    P_px : (n, 2, 2) px^2, covariance of each centroid, without the error of the rate
    least : int, fewest stars that make an attitude
    rate : (t_s (n,), P_omega (3, 3)), when each star was seen and the covariance of the rate that brought all
        to one instant; None where none did

    Returns
    -------
    n_used : int; fewer than `least` when no attitude fits that many, or not most of the stars
    q_ic : (4,)
    P_c : (3, 3) rad^2
    residual_px : RMS distance of the used stars from where the attitude puts them
    """
    return _solved(params, u_c, seen_i, P_px, least, rate)[:4]


def _solved(params, u_c, seen_i, P_px, least, rate):
    """`solve`, and the rows of the stars used (n_used,), and by what their misfit multiplies P_px and P_c."""
    t_s, P_omega = (np.zeros(len(u_c)), np.zeros((3, 3))) if rate is None else rate
    return _solve_kernel(
        params.identify.camera,
        params.outlier_sigma,
        least,
        u_c,
        seen_i,
        P_px,
        t_s,
        P_omega,
        params.sigma_focal,
        rate is None,
    )


@njit(cache=True)
def _solve_kernel(camera, outlier_sigma, least, u_c, seen_i, P_px, t_s, P_omega, sigma_focal, spots):
    """As `_solved`, with the settings that it needs; spots: whether these are no streaks."""
    xy_px = pixels(camera, u_c)
    rows = np.arange(len(u_c))
    q_ic = esoq2(u_c, seen_i, sigma_of_centroids(camera, xy_px, P_px))
    while True:
        false_alarm = len(rows) * np.exp(-0.5 * outlier_sigma**2)
        dropped, q_ic, P_c, chi2 = drop_worst(
            camera,
            q_ic,
            xy_px[rows],
            seen_i[rows],
            P_px[rows],
            false_alarm,
            least - 1,
            t_s[rows],
            P_omega,
            sigma_focal,
        )
        if dropped >= 0:
            rows = np.delete(rows, dropped)
        if dropped < 0 or len(rows) < least:
            break
    n_used = len(rows)
    if len(u_c) - n_used > max(1.0, MOST_DROPPED * len(u_c)):
        # those that are left may as well be the ones that are wrong
        return 0, q_ic, P_c, np.nan, rows, np.nan
    offset_px = xy_px[rows] - pixels(camera, seen_i[rows] @ dcm_from_quat(q_ic))
    residual_px = np.sqrt((offset_px**2).sum() / n_used)
    dof = 2 * n_used - 3
    misfit = misfit_growth(chi2, dof, PRIOR_DOF) if spots else misfit_factor(chi2, dof, PRIOR_DOF)
    return n_used, q_ic, misfit * P_c, residual_px, rows, misfit


def explain(params, reason, mean_dn, context):
    """The most telling reason for a frame without attitude; comparisons with NaN are False."""
    if context.sun_angle < params.sun_exclusion:
        return Reason.SUN_EXCLUSION
    if context.limb_angle < params.limb_exclusion:
        return Reason.EARTH_EXCLUSION
    if mean_dn > params.exposure.max_mean_dn:
        return Reason.SATURATED
    if context.rate > params.max_rate:
        return Reason.SMEARED
    return reason
