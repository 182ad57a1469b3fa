"""Places in a picture and places behind a pinhole: what a lens with distortion is to the star tracker.

Objects are found, fitted, reported and logged where they are on the detector. Whatever reckons with
directions (identification, attitude, motion) is made for a pinhole and is given the places that it would
show. The border of the detector is no rectangle there: a star that is nearer to it than the distortion
displaces may be missing.
"""

import numpy as np

from shefex_nav.geometry.distortion import distort, slopes_at, undistort
from shefex_nav.geometry.streak import turn_jacobians


def ideal(camera, detections):
    """Detections as a pinhole would make them: places and covariances.

    camera : CameraModel;  detections : Detections on the detector;  the same object without a distortion
    """
    if camera.distortion is None:
        return detections
    hole, xy_px = camera.pinhole, np.ascontiguousarray(detections.xy_px, dtype=float)
    xy_px = undistort(hole, camera.distortion, xy_px)
    P_px = detections.P_px
    if P_px is not None:
        J = np.linalg.inv(slopes_at(hole, camera.distortion, xy_px))
        P_px = J @ P_px @ J.mT
    return detections._replace(xy_px=xy_px, P_px=P_px)


def on_detector(camera, xy_px, P_px):
    """Places and covariances in the picture of those of the pinhole. CameraModel, (n, 2), (n, 2, 2)"""
    if camera.distortion is None:
        return xy_px, P_px
    J = slopes_at(camera.pinhole, camera.distortion, xy_px)
    return distort(camera.pinhole, camera.distortion, xy_px), J @ P_px @ J.mT


def at_instant(camera, times, omega_c, xy_px, move):
    """Places in the picture at the frame's instant. CameraModel, RowTimes, (3,) rad/s, (n, 2) as found.

    move : function of places behind the pinhole: those at the instant, and when each was seen (n,), s. It
        takes the row of the pinhole for the one that was exposed; what that makes is put right here.
    -> (n, 2), (n,)
    """
    if camera.distortion is None:
        return move(xy_px)
    hole, k = camera.pinhole, camera.distortion
    behind = undistort(hole, k, np.ascontiguousarray(xy_px, dtype=float))
    moved, seen_s = move(behind)
    late_s = times.line_s * (xy_px[:, 1] - behind[:, 1])  # seen later than the row of the pinhole says
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
    behind = undistort(hole, k, np.ascontiguousarray(xy_px, dtype=float))
    said = turn_jacobians(hole, xy_px) @ omega_c
    true = np.einsum("nij,nj->ni", slopes_at(hole, k, behind), turn_jacobians(hole, behind) @ omega_c)
    return xy_px + seen_s[:, None] * (said - true)
