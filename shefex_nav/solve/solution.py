"""What was found in a picture, and where it points in the angles of astronomers."""

from typing import NamedTuple

import numpy as np

from shefex_nav.solve.camera import Camera
from shefex_nav.solve.header import AS_STORED


class Match(NamedTuple):
    """A star of the catalogue in the picture."""

    hip: int  # Hipparcos number
    x_px: float  # where it was detected
    y_px: float
    vmag: float  # with a StarCamera in the band of its catalogue


class ImageSolution(NamedTuple):
    """What `solve_image` found; NaN and None without a solution.

    RA, Dec and roll are of the middle of the picture. Where no camera is told, `q_ci` and the covariance are,
    too: z is the middle. Of a camera that is told they are of its own axes: z is the axis of its lens.
    `camera` puts stars where they are in the picture with `camera_q_ci`, whose z is always the axis of the
    lens, at `camera.principal_point_px`. Where that was found, the axis is known less well than the middle:
    `camera_covariance` is its.
    """

    status: str  # 'ok' or 'failed'
    reason: str  # empty, or why: a key of `table.WHY`
    ra_deg: float  # of the middle of the picture, ICRS
    dec_deg: float
    roll_deg: float  # position angle of image up, from north through east, 0 to 360
    fov_x_deg: float
    fov_y_deg: float
    matched: list  # of Match, brightest first
    false_probability: float  # bound of the probability that chance made this; 1 without a solution
    wall_ms: float  # from the grey values to the solution; tables are not counted when they are made
    q_ci: np.ndarray  # (4,) ICRS to axes through the middle of the picture; of a told camera to its own
    camera: Camera | None  # focal length, principal point and distortion as found, or as they were told
    xy_px: np.ndarray  # (n, 2) all detections, brightest first
    # None without a solution
    covariance: np.ndarray | None = None  # (3, 3) rad^2, error of q_ic = conjugate of q_ci, camera axes
    # of a StarCamera that is told: (3, 3) rad^2, the part that differs between pictures; otherwise None
    noise_covariance: np.ndarray | None = None
    residual_px: float | None = None  # RMS of the stars used against the attitude
    fov_sigma_deg: float | None = None  # of fov_x_deg; None with a StarCamera
    mirrored: bool = False  # told to be: q_ci and camera are those of the picture turned over, left for right
    aberration_removed: bool = False  # angles are those of the ICRS
    julian_year: float | None = None  # of the sky and, where it is removed, of the aberration
    orientation: int = AS_STORED  # of EXIF, 1 to 8: by it the picture was turned first, as viewers do
    # it was not turned: places and angles are of the pixels of a StarCamera's detector
    as_stored: bool = False
    date_from: str = ""  # who said julian_year: epoch, picture, camera (the file of a StarCamera), today
    # (4,) ICRS to the axes of `camera`, z through its principal point: what it projects stars with
    camera_q_ci: np.ndarray | None = None
    # (3, 3) rad^2, error of the conjugate of camera_q_ci, axes of `camera`; of one that is told covariance
    camera_covariance: np.ndarray | None = None


def failed(reason, ms, xy_px):
    """ImageSolution of a picture without an attitude."""
    nan = float("nan")
    return ImageSolution("failed", reason, nan, nan, nan, nan, nan, [], 1.0, ms, np.full(4, nan), None, xy_px)


def marks(size_px):
    """Pixels that `angles` needs of a picture (width, height): (6, 2).

    The middle, one pixel above it, and the middles of the left, right, upper and lower edge.
    """
    (width, height), (cx, cy) = size_px, (0.5 * (size_px[0] - 1.0), 0.5 * (size_px[1] - 1.0))
    right, bottom = width - 0.5, height - 0.5
    return np.array([[cx, cy], [cx, cy - 1.0], [-0.5, cy], [right, cy], [cx, -0.5], [cx, bottom]])


def direction(u_i):
    """Right ascension and declination of a direction (3,) in the ICRS: 2 floats [deg]."""
    ra, dec = _ra_dec(u_i)
    return float(np.degrees(ra % (2.0 * np.pi))), float(np.degrees(dec))


def _ra_dec(u_i):
    """The same, rad."""
    return np.arctan2(u_i[1], u_i[0]), np.arcsin(np.clip(u_i[2], -1.0, 1.0))


def angles(u_i):
    """Right ascension and declination of the middle, position angle of up, fields of view across and down.

    u_i : (6, 3) directions of the `marks`, ICRS -> 5 floats [deg]; the position angle counts from north
    through east
    """
    centre, up = u_i[0], u_i[1]
    ra, dec = _ra_dec(centre)
    north = np.array([-np.sin(dec) * np.cos(ra), -np.sin(dec) * np.sin(ra), np.cos(dec)])
    east = np.array([-np.sin(ra), np.cos(ra), 0.0])
    roll = np.arctan2(up @ east, up @ north)
    fov = [2.0 * np.arcsin(0.5 * np.linalg.norm(u_i[k] - u_i[k + 1])) for k in (2, 4)]
    return tuple(float(np.degrees(v)) for v in (ra % (2.0 * np.pi), dec, roll % (2.0 * np.pi), *fov))
