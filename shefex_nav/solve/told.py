"""Attitude from a picture of a camera that is known: the star tracker that flies, lost in space.

In: grey values as the detector gives them, a StarCamera, what is known of the exposure. Out: an attitude with
its covariance, or the reason for none. Detection, centroids, identification and attitude are those of
`onboard/startracker`. What flies besides, a rate from gyros, is not there: the streak of the stars says
whether the camera turned too fast, and rows that are exposed one after the other give no attitude.

The covariance has two parts. Noise of the centroids differs from picture to picture. What the calibration
left of focal length and principal point is the same in all pictures of a camera; it is added here, because
the attitude is meant as it is, not as a mounting would take it up.
"""

from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache
from time import perf_counter

import numpy as np

from shefex_nav.environment.ephemeris import sky_bodies
from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import turn_slopes, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat, quat_conjugate
from shefex_nav.onboard.startracker import best_attitude, objects
from shefex_nav.onboard.startracker import tracker as star_tracker
from shefex_nav.onboard.startracker.objects import ideal
from shefex_nav.onboard.startracker.shape import streak_px
from shefex_nav.onboard.startracker.spot import Picture
from shefex_nav.records import Reason
from shefex_nav.solve.camera import of_pinhole, undistorted
from shefex_nav.solve.field import Field
from shefex_nav.solve.header import Taken, says_day
from shefex_nav.solve.picture import PictureError
from shefex_nav.solve.solution import ImageSolution, Match, angles, failed, marks

SHORT_PX = 3.0  # a shorter streak does no harm, and may be a wrong width of the spots
FOCAL_SIGMA = 5.0  # by so much the stars may contradict the focal length that is told
MINUTES = 365 * 24 * 60  # of a year: so finely the velocity of the Earth is looked up
_ready = set()  # types of grey values for which all kernels are loaded


@dataclass(frozen=True, eq=False)
class StarCamera:
    """A star camera and its star tracker, as they are told to `solve_image`.

    params : tracker.TrackerParams; the distortion of its camera is taken out of the centroids
    principal_point_error : px, 1 sigma per axis, what the calibration left
    bits : of a grey value
    line_s : from the start of one row to the next; 0 with a global shutter
    julian_year : of pictures that do not say when they were taken; None: such are refused
    """

    params: star_tracker.TrackerParams
    principal_point_error: float = 0.0
    bits: int = 8
    line_s: float = 0.0
    julian_year: float | None = None


def solve(image, camera, taken=None, record=None):
    """Attitude of a picture of a StarCamera.

    Parameters
    ----------
    image : (rows, columns) uint8 or uint16, grey values as the detector gives them
    camera : StarCamera
    taken : Taken; without an instant the camera's is meant, without an exposure the longest, without a
        velocity that of the centre of the Earth
    record : image.Record; its field is filled with the objects that the star tracker found

    Returns
    -------
    ImageSolution with covariances

    Raises
    ------
    PictureError : a picture that this camera does not make, or of an instant that nobody says
    """
    image_dn, taken = checked(image, camera), taken or Taken()
    year = camera.julian_year if taken.julian_year is None else taken.julian_year
    if year is None:  # the aberration of another day would be an error of up to 40 arcsec
        words = "give DATE-OBS, --epoch YEAR, or an epoch in the camera file"
        raise PictureError(f"image: does not say when it was taken; {words}")
    tracker = tracker_of(camera, round(year * 365.25))
    velocity_i = earth_velocity(round(year * MINUTES)) if says_day(year) else np.zeros(3)
    if says_day(year) and taken.velocity_i is not None:
        velocity_i = velocity_i + taken.velocity_i
    if image_dn.dtype not in _ready:  # compiled code is loaded before the clock runs
        _solve(image_dn, camera, tracker, velocity_i, taken.exposure_s)
        _ready.add(image_dn.dtype)
    found = _solve(image_dn, camera, tracker, velocity_i, taken.exposure_s, record)
    return found._replace(julian_year=year, date_from="camera" if taken.julian_year is None else "picture")


def _solve(image_dn, camera, tracker, velocity_i, exposure_s, record=None):
    """`solve` when all is ready."""
    began = perf_counter()
    settings, model = tracker.params.settings, tracker.params.camera
    exposure_s = settings.exposure.longest if exposure_s is None else exposure_s
    seen, statistics, length_px = _detect(settings.detection, model, image_dn)
    detections = ideal(model, seen)
    if record is not None:
        record.field = _field_of(seen, statistics)

    def refused(reason):
        return failed(reason, 1e3 * (perf_counter() - began), seen.xy_px)

    highest_px = settings.highest_rate * exposure_s * model.pinhole.focal_length_px
    if camera.line_s > 0.0:
        return refused("rolling")
    if length_px > max(highest_px, SHORT_PX):
        return refused("smeared")
    exposed = star_tracker.of_exposure(tracker, exposure_s)
    context = star_tracker.NO_CONTEXT._replace(velocity_i=velocity_i)
    found, reason, solution, used = star_tracker.attitude_with_stars(exposed, detections, context)
    if reason != Reason.NONE:
        return refused(_why(exposed, detections, context, reason, statistics.mean_dn))
    q_ic, noise, residual_px = solution
    hip = np.where(found.star >= 0, tracker.stars.hip[found.star], 0)
    makes_it = set(used.hip.tolist())
    rows = [k for k, one in enumerate(hip.tolist()) if one in makes_it]
    P_px = best_attitude.centroid_covariance(tracker.params, detections)[rows]
    constant, focal = _calibration(camera, detections.xy_px[rows], P_px, used.u_i, q_ic)
    if abs(focal) > FOCAL_SIGMA:
        return refused("focal_length")
    known = np.flatnonzero(hip)
    stars, q_ci = tracker.stars, quat_conjugate(q_ic)
    matched = [
        Match(*values)
        for values in zip(
            hip[known].tolist(), *seen.xy_px[known].T.tolist(), stars.vmag[found.star[known]].tolist(),
            strict=True,
        )
    ]  # fmt: skip
    hole = model.pinhole
    told = lens_of(camera)
    size_px = told.width_px, told.height_px
    marks_i = unit_vectors(hole, undistorted(told, marks(size_px))) @ dcm_from_quat(q_ci)
    return ImageSolution(
        "ok", "", *angles(marks_i), matched, float(np.exp(-found.log_odds)),
        1e3 * (perf_counter() - began), q_ci, told, seen.xy_px, noise + constant, noise, residual_px,
        aberration_removed=bool(np.any(velocity_i)), camera_q_ci=q_ci, camera_covariance=noise + constant,
    )  # fmt: skip


def _field_of(seen, statistics):
    """Detections of the star tracker as a Field; what it refuses it does not keep."""
    nobody = np.zeros((0, 2)), np.zeros(0, dtype=int)
    return Field(
        seen.xy_px, seen.P_px, seen.flux_dn, seen.n_saturated > 0, np.ones(len(seen.flux_dn), dtype=bool),
        seen.n_pixels, 1, statistics.noise_dn, *nobody,
    )  # fmt: skip


def lens_of(camera):
    """Camera of a StarCamera: its lens."""
    return of_pinhole(camera.params.camera.pinhole, camera.params.camera.distortion)


def checked(image, camera):
    """The picture as an array that the detection takes; PictureError if the camera makes none such."""
    hole, image = camera.params.camera.pinhole, np.asarray(image)
    if image.ndim != 2:
        raise PictureError(f"image: has shape {image.shape}; expected (rows, columns) of one grey value each")
    if image.shape != (hole.height_px, hole.width_px):
        raise PictureError(
            f"image: has {image.shape[1]} x {image.shape[0]} pixels, "
            f"the camera {hole.width_px} x {hole.height_px}"
        )
    if image.dtype.kind not in "ui":
        raise PictureError(f"image: has values of type {image.dtype}; expected whole grey values")
    deep = camera.bits > 8
    if image.dtype == (np.uint16 if deep else np.uint8) and camera.bits in (8, 16):
        return np.ascontiguousarray(image)
    if deep and image.dtype.itemsize == 1:
        raise PictureError(f"image: has 8 bits a pixel, the camera's grey values {camera.bits}")
    low, high = 0 if image.dtype.kind == "u" else int(image.min()), int(image.max())
    if low < 0 or high >= 2**camera.bits:
        raise PictureError(
            f"image: has grey values from {low} to {high}; those of the camera have {camera.bits} bits, "
            f"0 to {2**camera.bits - 1}"
        )
    return np.ascontiguousarray(image, dtype=np.uint16 if deep else np.uint8)


def _detect(settings, model, image_dn):
    """Detections, FrameStatistics, and the length of the streak of the stars [px]."""
    spots, length_px = objects.of_spots(settings), 0.0

    def centres(settings, camera, image_dn, table):
        nonlocal length_px
        picture = Picture(
            image_dn, np.ascontiguousarray(camera.bad_pixels, dtype=np.int64), int(settings.saturation),
            1.0 / camera.electrons_per_dn,
        )  # fmt: skip
        length_px = streak_px(picture, table, float(camera.psf_sigma))
        return objects.CENTROIDS[settings.centroid](settings, camera, image_dn, table)

    return *objects.detect(spots, model, image_dn, centres), length_px


def _why(tracker, detections, context, reason, mean_dn):
    """Word for what the star tracker says; of stars that fit only when they are mirrored, that."""
    if mean_dn > tracker.params.settings.exposure.brightest_mean:
        return "saturated"
    if reason in (Reason.NO_MATCH, Reason.AMBIGUOUS, Reason.RESIDUALS):
        hole = tracker.params.camera.pinhole
        turned = detections.xy_px * [-1.0, 1.0] + [2.0 * hole.cx_px, 0.0]
        flip = np.array([[1.0, -1.0], [-1.0, 1.0]])
        mirrored = detections._replace(xy_px=turned, P_px=detections.P_px * flip)
        if star_tracker.attitude(tracker, mirrored, context)[1] == Reason.NONE:
            return "mirrored"
    return Reason(reason).name.lower()


def _calibration(camera, xy_px, P_px, seen_i, q_ic):
    """What errors of the calibration do to an attitude.

    The attitude is the weighted least squares of rotation and focal length, the latter with its sigma as
    prior. A principal point that is off by d moves all stars by d.

    Parameters
    ----------
    camera : StarCamera
    xy_px, P_px : (n, 2), (n, 2, 2) px^2, of the stars that make the attitude
    seen_i : (n, 3) their apparent directions
    q_ic : (4,)

    Returns
    -------
    P_c : (3, 3) rad^2, of the errors of focal length and principal point
    focal : error of the focal length that the stars show, in standard deviations
    """
    hole, sigma = camera.params.camera.pinhole, camera.params.camera.focal_length_error
    f = hole.focal_length_px
    u_c = seen_i @ dcm_from_quat(q_ic)
    x, y = u_c[:, 0] / u_c[:, 2], u_c[:, 1] / u_c[:, 2]
    G = np.zeros((len(x), 2, 6))  # by rotation, focal length, principal point
    for row, by_turn in enumerate(turn_slopes(x, y)):
        for axis in range(3):
            G[:, row, axis] = f * by_turn[axis]
    G[:, 0, 3], G[:, 1, 3] = f * x, f * y
    G[:, 0, 4], G[:, 1, 5] = 1.0, 1.0
    rest = xy_px - np.column_stack([hole.cx_px + f * x, hole.cy_px + f * y])
    G_flat, WG = G.reshape(-1, 6), (np.linalg.inv(P_px) @ G).reshape(-1, 6)
    M = G_flat.T @ WG
    free = np.linalg.inv(M[:4, :4])
    focal = free[3] @ (WG[:, :4].T @ rest.ravel()) / np.sqrt(free[3, 3] + sigma**2)
    answer, by_focal = np.zeros((4, 4)), np.zeros(3)
    if sigma > 0.0:
        M[3, 3] += sigma**-2
        answer = np.linalg.inv(M[:4, :4])
        by_focal = answer[:3, 3] / sigma
    else:
        answer[:3, :3] = np.linalg.inv(M[:3, :3])
    by_point = (answer @ M[:4, 4:])[:3]
    P_c = np.outer(by_focal, by_focal) + camera.principal_point_error**2 * by_point @ by_point.T
    return P_c, float(focal)


@lru_cache(maxsize=4)
def tracker_of(camera, day):
    """Tracker of a StarCamera with the stars of a day since the year 0."""
    return star_tracker.init(camera.params, load_catalogue(8.0), day / 365.25)


@lru_cache(maxsize=64)
def earth_velocity(minute):
    """Velocity of the Earth relative to the barycentre [m/s] at a Julian year of so many minutes: (3,)."""
    moment = datetime(2000, 1, 1, 12) + timedelta(days=(minute / MINUTES - 2000.0) * 365.25)
    return sky_bodies(moment.isoformat()).earth_v_i
