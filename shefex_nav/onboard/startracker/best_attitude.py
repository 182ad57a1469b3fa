"""The attitude that the identified stars of a frame agree on, its covariance, and which of them do not."""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.pinhole import cross_covariance, pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, rotvec_between
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.onboard.startracker.attitude import esoq2
from shefex_nav.onboard.startracker.likelihood import (
    CommonErrors,
    drop_worst,
    misfit_factor,
    misfit_growth,
    sigma_of_centroids,
)
from shefex_nav.records import Reason, StarVectors

MOST_DROPPED = 0.25  # of the identified stars; one in any case
PRIOR_DOF = 10.0  # weight of the expected variance of the centroids against the one of this frame [E]


class Criteria(NamedTuple):
    """By what the stars of a frame are judged."""

    centroid_floor: float  # px, error of any centroid, per axis, beside the one that it is said to have
    outlier_sigma: float  # a star that is further from where the others put it is left out
    least: int  # fewest stars that make an attitude
    spots: bool  # no streaks: only a misfit that is more than chance makes changes the covariance


def directions(params, detections, rate=None):
    """Direction of each object, (n, 3) in camera axes, and `centroid_covariance`."""
    floor = params.settings.centroid_floor
    u_c, P_px = _directions_kernel(params.camera.pinhole, detections.xy_px, detections.P_px, floor)
    return u_c, with_rate(params, detections, P_px, rate)


@kernel
def _directions_kernel(camera, xy_px, P_px, floor):
    """`directions` of places (n, 2) and their noise (n, 2, 2) px^2; floor : px, error of any centroid."""
    P_px = P_px.copy()
    for k in range(len(P_px)):
        for i in range(2):
            P_px[k, i, i] += floor**2
    return unit_vectors(camera, xy_px), P_px


def centroid_covariance(params, detections, rate=None):
    """Covariance of each centroid, (n, 2, 2) px^2: noise, what is wrong with every one, and `with_rate`."""
    return directions(params, detections, rate)[1]


def focal_covariance(params, xy_px):
    """What the error of the focal length does to each place, (n, 2, 2) px^2, for stars one by one."""
    offset_px = xy_px - np.array([params.camera.pinhole.cx_px, params.camera.pinhole.cy_px])
    return params.camera.focal_length_error**2 * offset_px[:, :, None] * offset_px[:, None, :]


def with_rate(params, detections, P_px, rate):
    """Covariance of each centroid with what the error of the rate does to it; rate as in `of_named`."""
    return P_px if rate is None else P_px + by_rate(params.camera.pinhole, detections.xy_px, rate)


def by_rate(camera, xy_px, rate):
    """What the error of a rate (t_s (n,), P_omega (3, 3)) does to places: (n, 2, 2) px^2. Pinhole, (n, 2)"""
    S = rate[0][:, None, None] * turn_jacobians(camera, xy_px)
    return S @ rate[1] @ S.transpose(0, 2, 1)


def of_named(params, stars, star, detections, velocity_i, least, rate=None):
    """Attitude of the named objects of a frame, its covariance and misfit, and what each star says by itself.

    The worst star is left out until all that are used fit. A neighbour too faint for the catalogue or a
    particle hit can shift the light of a star by more than its error. Neither can be foreseen, but with more
    than four stars it shows. The variance that the centroids promise counts as an observation of PRIOR_DOF
    degrees of freedom. Streaks are less certain than spots: the misfit of this frame's stars corrects it;
    that of spots only where it is more than chance makes.

    Parameters
    ----------
    params : TrackerParams
    stars : OnboardCatalogue
    star : (n,) int64 row of the catalogue for each object, -1 where it has no name
    detections : Detections, n of them
    velocity_i : (3,) m/s, of the vehicle relative to the solar-system barycentre
    least : int, fewest stars that make an attitude
    rate : (t_s (n,), P_omega (3, 3)), when each object was seen and the covariance of the rate that brought
        all to one instant; None where none did

    Returns
    -------
    n_used : int; fewer than `least` when no attitude fits that many, or not most of the stars; 0 as well
        where the attitude is no number
    q_ic : (4,)
    P_c : (3, 3) rad^2
    residual_px : RMS distance of the used stars from where the attitude puts them
    StarVectors of the stars used
    """
    t_s, P_omega = (np.zeros(len(star)), np.zeros((3, 3))) if rate is None else rate
    settings, camera = params.settings, params.camera
    criteria = settings.centroid_floor, settings.outlier_sigma, least, rate is None
    *solution, used, u_c, P_u, seen_i, t_s, P_omega = _named_kernel(
        camera.pinhole, criteria, stars.u_i, star, detections.xy_px, detections.P_px, velocity_i,
        (t_s, P_omega, camera.focal_length_error),
    )  # fmt: skip
    vectors = StarVectors(stars.hip[star[used]], u_c, P_u, seen_i, t_s, P_omega, camera.focal_length_error)
    return *solution, vectors


@kernel
def _named_kernel(camera, criteria, u_i, star, xy_px, P_px, velocity_i, common):
    """Four of `of_named`, then rows of the stars used and of `StarVectors` all but names and sigma_focal.

    criteria, common : the fields of Criteria, and of CommonErrors for all n objects: plain tuples, which
        take less time to hand over
    u_i : (m, 3) of the catalogue
    """
    criteria, common = Criteria(*criteria), CommonErrors(*common)
    rows, sigma_focal = np.flatnonzero(star >= 0), common.sigma_focal
    xy_px, P_px, t_s = xy_px[rows], P_px[rows], common.t_s[rows]
    for k in range(len(rows)):
        for i in range(2):
            P_px[k, i, i] += criteria.centroid_floor**2
    u_c, seen_i = unit_vectors(camera, xy_px), aberrate(u_i[star[rows]], velocity_i)
    n_used, q_ic, P_c, residual_px, used, misfit = _solve_kernel(
        camera, criteria, u_c, seen_i, P_px, CommonErrors(t_s, common.P_omega, sigma_focal)
    )
    if not np.isfinite(q_ic.sum() + P_c.sum()):
        n_used = 0
    xy_px, P_px = xy_px[used], P_px[used]
    offset = np.array([camera.cx_px, camera.cy_px])
    for k in range(len(used)):
        off_px = xy_px[k] - offset
        for i in range(2):
            for j in range(2):
                P_px[k, i, j] = misfit * P_px[k, i, j] + sigma_focal**2 * off_px[i] * off_px[j]
    P_u = cross_covariance(camera, xy_px, P_px)
    solution = n_used, q_ic, P_c, residual_px
    return *solution, rows[used], u_c[used], P_u, seen_i[used], t_s[used], misfit * common.P_omega


@inner
def _solve_kernel(camera, criteria, u_c, seen_i, P_px, common):
    """Attitude of stars, all of which have a name: four of `of_named`, rows of the stars used, and misfit.

    criteria : Criteria;  common : CommonErrors
    u_c, seen_i : (n, 3) measured directions; apparent ones, aberration included
    P_px : (n, 2, 2) px^2, of the centroids, without the errors that are shared
    misfit : by what that of the stars multiplies P_px and P_c
    """
    xy_px = pixels(camera, u_c)
    rows = np.arange(len(u_c))
    q_ic = esoq2(u_c, seen_i, sigma_of_centroids(camera, xy_px, P_px))
    while True:
        false_alarm = len(rows) * np.exp(-0.5 * criteria.outlier_sigma**2)
        theirs = CommonErrors(common.t_s[rows], common.P_omega, common.sigma_focal)
        dropped, q_ic, P_c, chi2 = drop_worst(
            camera, q_ic, xy_px[rows], seen_i[rows], P_px[rows], false_alarm, criteria.least - 1, theirs
        )
        if dropped >= 0:
            rows = np.delete(rows, dropped)
        if dropped < 0 or len(rows) < criteria.least:
            break
    n_used = len(rows)
    if len(u_c) - n_used > max(1.0, MOST_DROPPED * len(u_c)):
        # those that are left may as well be the ones that are wrong
        return 0, q_ic, P_c, np.nan, rows, np.nan
    offset_px = xy_px[rows] - pixels(camera, seen_i[rows] @ dcm_from_quat(q_ic))
    residual_px = np.sqrt((offset_px**2).sum() / n_used)
    dof = 2 * n_used - 3
    misfit = misfit_growth(chi2, dof, PRIOR_DOF) if criteria.spots else misfit_factor(chi2, dof, PRIOR_DOF)
    return n_used, q_ic, misfit * P_c, residual_px, rows, misfit


# ----------------------------------------------------------------------------------------------------------
# Whether the frames of late deny what the star tracker is told of its camera.
#
# A lens that is not as it is told has its stars elsewhere in every frame. Nearly all such frames are
# refused for their residuals, a right one is once in a thousand; but now and then a few stars fit each
# other, and make an attitude whose covariance knows nothing of the rest. While most frames are refused, it
# is not given out.
#
# The memory is of frames, not of time: a lens does not get better while none are taken. After a disturbance
# that made residuals and is over, up to 14 good frames are withheld.


RECENT = 20  # frames, over which the share is averaged
MOST_REFUSED = 0.5  # share of them that may be refused for residuals


def denied(share, reason):
    """Whether the attitude of a frame is not to be given out, and the share of late frames with it.

    share : of frames refused for residuals, of those that had an attitude or residuals, 0 at the start
    reason : Reason of this frame by itself; None of one that does not count
    """
    if reason not in (Reason.NONE, Reason.RESIDUALS):
        return share > MOST_REFUSED, share
    return share > MOST_REFUSED, share + ((reason == Reason.RESIDUALS) - share) / RECENT


# ----------------------------------------------------------------------------------------------------------
# How fast the camera turns by its own attitudes, where the gyros say too fast for any.
#
# A gyro that is suddenly off by more than the highest rate would take the stars from the filter at the
# instant at which they alone show that it is wrong. Stars that were identified in two frames, one soon
# after the other, and have turned far less than the gyros say, are believed: two frames are not mistaken
# for the same wrong sky. The gyros have to say too fast at both, for a camera that has just begun to turn
# has not turned much. The filter then has fixes that contradict its gyros, and finds out which of them it
# is.


LONGEST_S = 1.5  # [E] between two frames, in which a camera does not turn there and back
LESS = 0.5  # [E] of the rate of the gyros, below which the stars contradict it


class Seen(NamedTuple):
    """The attitude of a frame, whether it was given out or not."""

    t_valid_s: float
    rate: float  # rad/s, by the gyros; NaN: not known
    q_ic: np.ndarray  # (4,), NaN: none


NOT_SEEN = Seen(np.nan, np.nan, np.full(4, np.nan))


def is_fast(highest, before, now):
    """Whether a frame was taken while the camera turned too fast; not if its rate is not known.

    highest : rad/s, for which the tracker is made
    before, now : Seen of the last attitude and of the frame
    """
    if not now.rate > highest:
        return False
    since_s, least = now.t_valid_s - before.t_valid_s, min(before.rate, now.rate)
    if not (0.0 < since_s <= LONGEST_S and least > highest) or np.isnan(now.q_ic[0]):
        return True
    turned = np.linalg.norm(rotvec_between(before.q_ic, now.q_ic))
    return bool(turned >= since_s * min(highest, LESS * least))
