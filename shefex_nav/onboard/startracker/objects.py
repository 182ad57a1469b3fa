"""The objects of a frame: places and light, searched by what the tracker knows of motion and attitude.

In: a frame, the navigation's `Context`, what is remembered of the frame before. Out: objects at the frame's
instant, and how they were found.

As spots (`detect`), a frame is searched without the rate, which brings what was found to one instant. The
route of the data is that of the SHEFEX-2 star tracker (section 3.2), one file a step:

    frame -> background: bad pixels out, sums of 3x3 pixels, level and noise in tiles
          -> scan: objects above the threshold, in one pass or by searching the maximum
          -> shape and fit, or centroid of the scan: place and covariance of each

Along streaks (`streaks`), the rate of the camera says what a star looks like at every place: then faint stars
are found at rates at which no pixel of them stands out, and their places are those of one instant whatever
the shutter did. With a narrow prediction of the attitude the places of the stars are known too and only those
are looked at; if they do not show the stars, the whole frame is. Without a rate a frame is searched for
spots, which is right for a camera that is nearly at rest. Other searches are added to `SEARCHES`.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry import unsteady
from shefex_nav.geometry.distortion import distort, farthest_px, slopes_at, undistort
from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.geometry.shutter import row_times
from shefex_nav.geometry.streak import middles_seen, turn_jacobian, turn_jacobians
from shefex_nav.geometry.unsteady import STEADY
from shefex_nav.onboard.startracker import fit, scan
from shefex_nav.onboard.startracker.background import FrameStatistics, survey
from shefex_nav.onboard.startracker.methods import Table
from shefex_nav.onboard.startracker.spot import Picture
from shefex_nav.records import Detections, Scan

SPOTS = {"sequential": Scan.SEQUENTIAL, "maximum": Scan.MAXIMUM}
KNOWN_PX = 1.0  # a rate is known if its error moves no star by more in half of the frame [E]
ROUGHLY_PX = 10.0  # the same, of a rate that is known roughly: spots of a rolling shutter, brought by it
PIXEL_SIGMA_PX = math.sqrt(1.0 / 12.0)  # of light that falls anywhere on a pixel
NARROW_PX = 4.0  # a prediction is narrow if its error moves no star in the frame by more, 1 sigma [E]
FEWEST = 3  # predicted stars that are worth looking at
OUTSIDE_PX = 2.0  # a star predicted just beyond the border may be inside


class Found(NamedTuple):
    """The objects of one frame."""

    detections: Detections
    statistics: FrameStatistics
    scan: int  # Scan
    at_instant: bool  # the places are those of the frame's instant
    memory: Any = None  # what the same search is given with the next frame
    # (t_s (n,), P_omega (3, 3)): when each was seen, and of the rate that brought them to one instant
    rate: Any = None
    # rad^2 on each axis, of what a rate that changes has moved all places by; None: that was not looked at
    variance: float | None = None
    guess: bool = False  # of no account if it shows no attitude


def detect(settings, camera, image_dn, centres=None):
    """Objects in a frame.

    Parameters
    ----------
    settings : Detection
    camera : CameraModel
    image_dn : (rows, columns) uint8 or uint16; settings.saturation in the same grey values
    centres : function in the place of the one that the settings name

    Returns
    -------
    Detections, brightest first, at most settings.most_objects
    FrameStatistics
    """
    image_dn = np.ascontiguousarray(image_dn)
    if image_dn.ndim != 2 or image_dn.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"image: expected grey values of shape (rows, columns), uint8 or uint16, "
            f"got {image_dn.dtype} of shape {image_dn.shape}"
        )
    image_dn, blocks, background, sigma, *levels = survey(image_dn, camera.bad_pixels, settings.tile)
    table = SCANS[settings.scan](image_dn, blocks, background, sigma, rules(settings))
    centres = centres or CENTROIDS[settings.centroid]
    xy_px, flux_dn, P_px = centres(settings, camera, image_dn, table)
    detections = Detections(*_brightest_first(table, xy_px, flux_dn, P_px))
    return detections, FrameStatistics(*levels)


@kernel
def _brightest_first(table, xy_px, flux_dn, P_px):
    """The columns of Detections, sorted by the light that the centroid found."""
    n = len(flux_dn)
    order = np.argsort(-flux_dn, kind="mergesort")
    xy_sorted, P_sorted = np.empty((n, 2)), np.empty((n, 2, 2))
    n_pixels, n_saturated = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    for k in range(n):
        row = order[k]
        xy_sorted[k], P_sorted[k] = xy_px[row], P_px[row]
        n_pixels[k], n_saturated[k] = int(table[row, scan.PIXELS]), int(table[row, scan.SATURATED])
    return xy_sorted, flux_dn[order], n_pixels, n_saturated, P_sorted


def rules(settings):
    """The settings of a scan, in the types of its kernel. Detection -> scan.Rules"""
    return scan.Rules(
        int(settings.tile),
        float(settings.seed_sigma),
        float(settings.grow_sigma),
        int(settings.fewest_pixels),
        int(settings.most_pixels),
        float(settings.largest_peak),
        int(settings.saturation),
        int(settings.most_objects),
    )


def by_fit(settings, camera, image_dn, table):
    """Place, flux and covariance of the objects by fitting the star shape of the frame."""
    bad_pixels = np.ascontiguousarray(camera.bad_pixels, dtype=np.int64)
    picture = Picture(image_dn, bad_pixels, int(settings.saturation), 1.0 / camera.electrons_per_dn)
    return fit.centroids(picture, table, float(camera.psf_sigma))


def by_scan(settings, camera, image_dn, table):
    """... as the scan found them."""
    xy_px, flux_dn, P_px = scan.weighted(table, 1.0 / camera.electrons_per_dn)
    P_px = P_px * scan.few_pixels(table, float(camera.psf_sigma))[:, None, None]
    return xy_px, flux_dn, P_px + scan.lost_covariance(table)


SCANS = Table("scan", sequential=scan.sequential, maximum=scan.maximum_search)
CENTROIDS = Table("centroid", fit=by_fit, weighted=by_scan)


def as_spots(params, stars, memory, frame, context):
    """By a scan, the sequential one if another search is set.

    A search says what it has found, the likelier first; the next is looked at if one shows no attitude.

    Parameters
    ----------
    params : TrackerParams
    stars : the stars on board, `StarPairs.stars`
    memory : Found.memory of the frame before, or None
    frame : Frame
    context : Context

    Returns
    -------
    iterable of Found
    """
    spots = of_spots(params.settings.detection)
    detections, statistics = detect(spots, params.camera, frame.image_dn)
    kind = int(SPOTS.get(spots.scan, Scan.OTHER))
    if not can_be_brought(params.camera.pinhole, frame, context):
        return [Found(detections, statistics, kind, frame.line_s == 0.0)]
    fits, found = spots.centroid == "fit", []
    for one in turning(params.settings.highest_rate, frame, context):
        brought, seen_s = at_frame_instant(params.camera, frame, one, detections, fits)
        rate = None if frame.line_s == 0.0 else (seen_s, one.P_omega_c)
        known = {"rate": rate, "variance": variance_of(one), "guess": one is not context}
        found.append(Found(brought, statistics, kind, True, **known))
    return found


def turning(highest_rate, frame, context):
    """How the camera may be turning: as the context says; of a rolling shutter, if that is too fast for any
    attitude, hardly as well, for it may be a gyro that is wrong (`best_attitude`). -> list of Context
    """
    if frame.line_s == 0.0 or not context.rate > highest_rate:
        return [context]
    P_omega_c = (0.5 * highest_rate) ** 2 * np.eye(3)
    still = {"omega_c": np.zeros(3), "P_omega_c": P_omega_c, "unsteady_c": None, "unsteady_variance": 0.0}
    return [context, context._replace(**still)]


def can_be_brought(camera, frame, context):
    """Whether the rate can bring spots to the frame's instant. Pinhole, Frame, Context -> bool.

    With a global shutter all are seen at once: only what is unsteady has to be taken out. With a rolling one
    the error of the rate, which all stars share, is estimated with the attitude.
    """
    if frame.line_s:
        return rate_error_px(camera, frame, context) < ROUGHLY_PX
    is_known = context.unsteady_c is not None and context.omega_c is not None
    return is_known and bool(np.isfinite(context.omega_c.sum()))


def variance_of(context):
    """`Found.variance` of places that a context has brought to one instant."""
    return None if context.unsteady_c is None else context.unsteady_variance


def at_frame_instant(camera, frame, context, detections, fits):
    """Detections at the frame's instant, without those that outran the rows; when each was seen (n,), s.

    fits : whether places are those of a fit, or moments
    """
    sigma_px = math.hypot(camera.psf_sigma, PIXEL_SIGMA_PX) if fits else math.inf
    exposed = frame.exposure_s, frame.line_s, frame.image_dn.shape[0]
    unsteady_c = STEADY if context.unsteady_c is None else context.unsteady_c

    def move(xy_px):
        return unsteady.at_instant(camera.pinhole, sigma_px, exposed, context.omega_c, unsteady_c, xy_px)

    xy_px, seen_s = at_instant_by_lens(camera, frame.line_s, context.omega_c, detections.xy_px, move)
    good = np.isfinite(xy_px.sum(axis=1))
    if good.all():
        return detections._replace(xy_px=xy_px), seen_s
    kept = detections._make(column[good] for column in detections._replace(xy_px=xy_px))
    return kept, seen_s[good]


def of_spots(settings):
    """Settings of Detection with a scan of single frames: their own, else the sequential one."""
    return replace(settings, scan="sequential") if settings.scan in SEARCHES else settings


def along_streaks(params, stars, memory, frame, context):
    """Along streaks if the rate is known and low enough for an attitude, else as spots. As `as_spots`."""
    is_slow = not context.rate > params.settings.highest_rate  # an unknown rate is NaN
    if is_slow and rate_error_px(params.camera.pinhole, frame, context) < KNOWN_PX:
        return _along_streaks(params, stars, frame, context)
    return as_spots(params, stars, memory, frame, context)


SEARCHES = Table("search", streaks=along_streaks)  # and as spots


def _along_streaks(params, stars, frame, context):
    """Around the predicted places, if they are known; then in the whole frame."""
    from shefex_nav.onboard.startracker import streaks

    settings, camera, hole = params.settings.detection, params.camera, params.camera.pinhole
    times = row_times(frame.exposure_s, frame.line_s, frame.image_dn.shape[0])
    unsteady_c = STEADY if context.unsteady_c is None else context.unsteady_c
    motion = streaks.Motion(context.omega_c, context.P_omega_c, times, unsteady_c)
    if params.settings.identification.tracking and is_narrow(hole, context):
        xy_px, P_px = predicted(params, stars, context)
        if len(xy_px) >= FEWEST:
            near = streaks.detect_near(settings, camera, frame.image_dn, motion, xy_px, P_px)
            yield _of_streaks(camera, motion, context, near, Scan.STREAKS_NEAR)
    whole = streaks.detect_streaks(settings, camera, frame.image_dn, motion)
    yield _of_streaks(camera, motion, context, whole, Scan.STREAKS)


def _of_streaks(camera, motion, context, found, kind):
    """Found of what a search along streaks finds: (Detections, FrameStatistics)."""
    detections, statistics = found
    rate, variance = rate_of(camera.pinhole, motion, detections), variance_of(context)
    xy_px = of_streaks(camera, motion.times, motion.omega_c, detections.xy_px, rate[0])
    detections = detections._replace(xy_px=xy_px)
    return Found(detections, statistics, int(kind), True, rate=rate, variance=variance)


def rate_of(camera, motion, detections):
    """What detections that a rate has brought to one instant owe to it: `Found.rate`."""
    P_omega_c = np.zeros((3, 3)) if motion.P_omega_c is None else motion.P_omega_c
    return middles_seen(camera, motion.times, motion.omega_c, detections.xy_px), P_omega_c


def rate_error_px(camera, frame, context):
    """By how much the error of the rate moves a star in half of the frame, 1 sigma, at most: float.

    Infinite where no rate is known. Pinhole, Frame, Context
    """
    if context.omega_c is None or context.P_omega_c is None or not np.isfinite(context.omega_c.sum()):
        return np.inf
    half_s = 0.5 * (frame.exposure_s + frame.line_s * (frame.image_dn.shape[0] - 1))
    return half_s * _largest_sigma_px(camera, context.P_omega_c)


def is_narrow(camera, context):
    """Whether the predicted attitude says where the stars are. Pinhole, Context -> bool."""
    if context.q_ic is None or context.P_c is None:
        return False
    return bool(np.isfinite(context.q_ic.sum()) and _largest_sigma_px(camera, context.P_c) < NARROW_PX)


def _largest_sigma_px(camera, P_c):
    """By how much turns of covariance P_c (3, 3) move the stars in the corners, the largest axis: float."""
    if not np.isfinite(P_c.sum()):
        return np.inf
    largest = 0.0
    for x in (0.0, camera.width_px - 1.0):
        for y in (0.0, camera.height_px - 1.0):
            H = turn_jacobian(camera, x, y)
            largest = max(largest, np.linalg.eigvalsh(H @ P_c @ H.T)[-1])
    return np.sqrt(largest)


def predicted(params, stars, context):
    """Where the stars on board must be on the detector at the frame's instant.

    Returns
    -------
    xy_px : (m, 2)
    P_px : (m, 2, 2) px^2, covariance of each place
    """
    camera = params.camera.pinhole
    C_ci = dcm_from_quat(context.q_ic).T
    outside_px = OUTSIDE_PX + params.camera.displaced_px
    seen_px = farthest_px(camera, params.camera.distortion) + outside_px
    cosine = math.cos(math.atan(seen_px / camera.focal_length_px))
    ahead_i = stars.u_i[stars.u_i @ C_ci[2] > cosine]
    u_c = np.ascontiguousarray(aberrate(ahead_i, params.velocity_i(context)) @ C_ci.T)
    ideal_px = pixels(camera, u_c)
    H = turn_jacobians(camera, ideal_px)
    P_px = H @ context.P_c @ H.transpose(0, 2, 1) + params.settings.centroid_floor**2 * np.eye(2)
    xy_px, P_px = on_detector(params.camera, ideal_px, P_px)
    inside = (xy_px > -0.5 - OUTSIDE_PX) & (
        xy_px < np.array([camera.width_px, camera.height_px]) - 0.5 + OUTSIDE_PX
    )
    inside = inside.all(axis=1)
    return xy_px[inside], P_px[inside]


# ----------------------------------------------------------------------------------------------------------
# Places in a picture and places behind a pinhole: what a lens with distortion is to the star tracker.
#
# Objects are found, fitted, reported and logged where they are on the detector. Whatever reckons with
# directions (identification, attitude, motion) is made for a pinhole and is given the places that it would
# show. The border of the detector is no rectangle there: a star that is nearer to it than the distortion
# displaces may be missing.


def ideal(camera, detections):
    """Detections as a pinhole would make them: places and covariances.

    camera : CameraModel;  detections : Detections on the detector;  the same object without a distortion
    """
    if camera.distortion is None:
        return detections
    xy_px, P_px = behind_pinhole(camera, detections.xy_px), detections.P_px
    if P_px is not None:
        J = np.linalg.inv(slopes_at(camera.pinhole, camera.distortion, xy_px))
        P_px = J @ P_px @ J.mT
    return detections._replace(xy_px=xy_px, P_px=P_px)


def behind_pinhole(camera, xy_px):
    """Places that a pinhole would show for those in the picture of a distorting lens. CameraModel, (n, 2)"""
    return undistort(camera.pinhole, camera.distortion, np.ascontiguousarray(xy_px, dtype=float))


def on_detector(camera, xy_px, P_px):
    """Places and covariances in the picture of those of the pinhole. CameraModel, (n, 2), (n, 2, 2)"""
    if camera.distortion is None:
        return xy_px, P_px
    J = slopes_at(camera.pinhole, camera.distortion, xy_px)
    return distort(camera.pinhole, camera.distortion, xy_px), J @ P_px @ J.mT


def at_instant_by_lens(camera, line_s, omega_c, xy_px, move):
    """Places in the picture at the frame's instant. CameraModel, s a row, (3,) rad/s, (n, 2) as found.

    move : function of places behind the pinhole: those at the instant, and when each was seen (n,), s. It
        takes the row of the pinhole for the one that was exposed; what that makes is put right here.
    -> (n, 2), (n,)
    """
    if camera.distortion is None:
        return move(xy_px)
    hole, k = camera.pinhole, camera.distortion
    behind = behind_pinhole(camera, xy_px)
    moved, seen_s = move(behind)
    late_s = line_s * (xy_px[:, 1] - behind[:, 1])  # seen later than the row of the pinhole says
    moved = moved - late_s[:, None] * (turn_jacobians(hole, behind) @ omega_c)
    return distort(hole, k, moved), seen_s + late_s


def of_streaks(camera, times, omega_c, xy_px, seen_s):
    """Places at the frame's instant of streaks that a search for a pinhole's has fitted in the picture.

    It brought them there by the pinhole's motion at the place on the detector, from when they were seen. The
    image of the lens moves by J(ideal place) times the motion at that place instead.

    seen_s : (n,) s, by that search -> (n, 2) px
    """
    if camera.distortion is None or times.line_s == 0.0:
        return xy_px
    hole, k = camera.pinhole, camera.distortion
    behind = behind_pinhole(camera, xy_px)
    said = turn_jacobians(hole, xy_px) @ omega_c
    true = np.einsum("nij,nj->ni", slopes_at(hole, k, behind), turn_jacobians(hole, behind) @ omega_c)
    return xy_px + seen_s[:, None] * (said - true)
