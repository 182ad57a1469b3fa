"""Detection of stars in motion, when the rate is known: the gyro tells the shape of every streak.

In: one frame and the motion of the camera. Out: `Detections` at the frame's instant, brightest first, and the
statistics of the frame.

    frame -> binned: bins of 2x2 pixels, level and noise in tiles
          -> matched: sums along the streaks; candidates above a low threshold
          -> streak_field: each candidate at full resolution, without the light of its neighbours
               -> streak_light: pixels of its window, the model of a streak (its numbers: streak_path)
               -> streak_search: where along the streak it is
               -> streak_fit: place at the instant, flux, covariance
               -> streak_shape: what does not look like a star's streak is refused
          -> threshold of the matched signal-to-noise ratio, from the wanted number of false objects

`detect_near` does the same in windows around predicted places only (streak_near). With a rate of zero the
streaks are spots and all holds as well. Stars that outrun the rows of a rolling shutter or leave a streak
longer than the frame's shorter side are not found; at rates where all do so there are no detections.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.shutter import RowTimes
from shefex_nav.geometry.unsteady import STEADY
from shefex_nav.onboard.startracker.background import FrameStatistics, bad_map
from shefex_nav.onboard.startracker.binned import in_noise, level_of
from shefex_nav.onboard.startracker.matched import (
    candidates,
    grid_of,
    looks,
    steps_of,
    threshold,
)
from shefex_nav.onboard.startracker.streak_field import Field, fit_field
from shefex_nav.onboard.startracker.streak_light import (
    MOST_PIXELS,
    PIXEL_VARIANCE,
    Picture,
    Spot,
    memory_of,
)
from shefex_nav.onboard.startracker.streak_near import fit_near
from shefex_nav.onboard.startracker.streak_path import Turning
from shefex_nav.onboard.startracker.streak_search import (
    COLUMNS,
    FLUX,
    N_PIXELS,
    N_SATURATED,
    PLACE_X,
    PLACE_Y,
    XX,
    XY,
    YY,
)
from shefex_nav.records import Detections

FALSE_OBJECTS = 0.5  # wanted number of objects in a frame that are noise
FIRST_PART = 0.8  # of the threshold, for candidates: the bins lose a tenth of a star's ratio
CLIP_PART = 0.5  # of the threshold: what one bin may add to the filtered value of a streak
SPOT_STEPS = 3  # a sum of fewer bins is not clipped
FALSE_NEAR = 0.05  # wanted number of objects near predictions that are noise
MEAN_EVERY = 16


class Motion(NamedTuple):
    """How the camera turned during the exposure."""

    omega_c: np.ndarray  # (3,) rad/s, of the camera in its own axes, mean of the exposure
    P_omega_c: np.ndarray | None  # (3, 3) (rad/s)^2, its covariance; None: taken as exact
    times: RowTimes
    unsteady_c: np.ndarray = STEADY  # (m, 4), how it turned besides: table of `geometry.unsteady`


def detect_streaks(settings, camera, image_dn, motion, false_objects=FALSE_OBJECTS):
    """Stars in a frame of a turning camera.

    Parameters
    ----------
    settings : Detection; of it tile, saturation and most_objects
    camera : CameraModel
    image_dn : (rows, columns) uint8 or uint16
    motion : Motion
    false_objects : float, wanted number of objects in a frame that are noise

    Returns
    -------
    Detections, brightest first, at most settings.most_objects; places at the instant, some outside the frame
    FrameStatistics
    """
    picture, turning, spot = _checked(settings, camera, image_dn, motion)
    sums, level, mean_dn = level_of(picture.image_dn, picture.bad, settings.tile)
    sigma = float(camera.psf_sigma)
    seen = looks(turning, sigma)
    fitted = np.empty((0, COLUMNS))
    if seen.density > 0.0:
        k = threshold(seen.density, float(image_dn.size), float(false_objects))
        grid = grid_of(sums.shape, seen, sigma)
        bins = in_noise(sums, level, _clip(k, seen.longest_px, sigma), grid.pad)
        found, noise = candidates(bins, grid, turning, sigma, FIRST_PART * k)
        field = Field(picture, turning, level, k * noise, memory_of(MOST_PIXELS))
        fitted = fit_field(field, spot, found)
    statistics = FrameStatistics(mean_dn, float(np.median(level.background)), float(np.median(level.noise)))
    return _detections(fitted, settings.most_objects), statistics


def detect_near(settings, camera, image_dn, motion, xy_px, P_px, false_objects=FALSE_NEAR):
    """Stars near predicted places only, for tracking.

    Each is searched SEARCH_SIGMAS around its prediction, against the background of the strips beside it.

    Parameters
    ----------
    settings, camera, image_dn, motion : as `detect_streaks`
    xy_px : (m, 2) predicted places at the instant
    P_px : (m, 2, 2) px^2, their covariances
    false_objects : float, wanted number of objects, over all predictions, that are noise

    Returns
    -------
    Detections, brightest first: the predictions that were found
    FrameStatistics, of the strips; the mean of every MEAN_EVERY-th row of the frame
    """
    picture, turning, spot = _checked(settings, camera, image_dn, motion)
    xy_px, P_px = np.ascontiguousarray(xy_px, dtype=float), np.ascontiguousarray(P_px, dtype=float)
    if xy_px.ndim != 2 or xy_px.shape[1] != 2 or P_px.shape != (len(xy_px), 2, 2):
        raise ValueError(f"predictions: expected (m, 2) and (m, 2, 2), got {xy_px.shape} and {P_px.shape}")
    fitted, level, noise = fit_near(picture, turning, spot, xy_px, P_px, float(false_objects))
    statistics = FrameStatistics(float(picture.image_dn[::MEAN_EVERY].mean()), level, noise)
    return _detections(fitted, settings.most_objects), statistics


def _checked(settings, camera, image_dn, motion):
    """Picture, Turning and Spot, in the types of the kernels."""
    image_dn, hole = np.ascontiguousarray(image_dn), camera.pinhole
    if image_dn.dtype not in (np.uint8, np.uint16) or image_dn.shape != (hole.height_px, hole.width_px):
        raise ValueError(
            f"image: expected uint8 or uint16 of shape {(hole.height_px, hole.width_px)}, "
            f"got {image_dn.dtype} of shape {image_dn.shape}"
        )
    omega_c = np.ascontiguousarray(motion.omega_c, dtype=float)
    P_omega_c = np.zeros((3, 3)) if motion.P_omega_c is None else np.array(motion.P_omega_c, dtype=float)
    if omega_c.shape != (3,) or P_omega_c.shape != (3, 3):
        raise ValueError(f"motion: expected a rate (3,) and (3, 3), got {omega_c.shape}, {P_omega_c.shape}")
    if not np.isfinite(omega_c.sum() + P_omega_c.sum()):
        raise ValueError("motion: the rate or its covariance is not finite")
    picture = Picture(image_dn, bad_map(*image_dn.shape, camera.bad_pixels), int(settings.saturation))
    spot = Spot(np.sqrt(float(camera.psf_sigma) ** 2 + PIXEL_VARIANCE), 1.0 / camera.electrons_per_dn)
    return picture, Turning(hole, omega_c, P_omega_c, motion.times, motion.unsteady_c, spot.s), spot


def _clip(k, longest_px, sigma_px):
    """Largest value of a bin, in its own sigma: of a streak of n bins one adds c / sqrt(n) to the sum."""
    steps = steps_of(longest_px, 0.0, sigma_px)
    return CLIP_PART * k * np.sqrt(1.5 * steps) if steps > SPOT_STEPS else np.inf


def _detections(fitted, most_objects):
    """Records of the fitted stars, brightest first."""
    fitted = fitted[np.argsort(-fitted[:, FLUX], kind="mergesort")][:most_objects]
    P_px = np.empty((len(fitted), 2, 2))
    P_px[:, 0, 0], P_px[:, 1, 1] = fitted[:, XX], fitted[:, YY]
    P_px[:, 0, 1] = P_px[:, 1, 0] = fitted[:, XY]
    return Detections(
        xy_px=fitted[:, [PLACE_X, PLACE_Y]],
        flux_dn=fitted[:, FLUX].copy(),
        n_pixels=fitted[:, N_PIXELS].astype(np.int64),
        n_saturated=fitted[:, N_SATURATED].astype(np.int64),
        P_px=P_px,
    )
