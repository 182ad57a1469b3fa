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

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.shutter import RowTimes
from shefex_nav.geometry.unsteady import STEADY
from shefex_nav.onboard.startracker.background import SIGMA_QUANTILE, FrameStatistics, bad_map, is_bad
from shefex_nav.onboard.startracker.binned import in_noise, level_of
from shefex_nav.onboard.startracker.matched import (
    candidates,
    grid_of,
    looks,
    steps_of,
    threshold,
)
from shefex_nav.onboard.startracker.streak_field import Field, fit_field
from shefex_nav.onboard.startracker.streak_fit import fit_one
from shefex_nav.onboard.startracker.streak_light import (
    MOST_PIXELS,
    PIXEL_VARIANCE,
    Ground,
    Picture,
    Spot,
    memory_of,
    take_away,
    window_of,
)
from shefex_nav.onboard.startracker.streak_path import (
    LENGTH,
    NUMBERS,
    TX,
    TY,
    X0,
    X1,
    Y0,
    Y1,
    Turning,
    path_of,
    touching,
)
from shefex_nav.onboard.startracker.streak_search import (
    COLUMNS,
    FLUX,
    N_PIXELS,
    N_SATURATED,
    PLACE_X,
    PLACE_Y,
    RATIO,
    XX,
    XY,
    YY,
    Search,
    reach_px,
)
from shefex_nav.onboard.startracker.streak_shape import STAR, judge
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


# ----------------------------------------------------------------------------------------------------------
# Streaks near predicted places: the fit without the search through the frame.
#
# In: the frame, the motion, predicted places with covariances. Out: the stars found there. Level and noise
# come from two strips beside each streak, the noise as the median of all: 200 pixels tell it to 10 per cent
# only.


SEARCH_SIGMAS = 3.0  # around a predicted place
LEAST_SEARCH_PX = 0.5
MOST_SEARCH_PX = 20.0
STRIP_SIGMAS = 4.0  # from the line of the streak to the strips beside it
STRIP_PX = 5.0  # their width
STRIP_ENDS_PX = 8.0  # beyond the ends of the streak
MOST_STRIP = 256  # pixels of a strip that are looked at
LEAST_STRIP = 60
LEVEL_SIGMA = 0.1  # of the noise of a pixel: error of the level of a strip
TWO_ABOVE = 0.977250  # a normal variable is below its mean plus two sigma with this probability
LEAST_NOISE = np.sqrt(1.0 / 12.0)  # DN, quantisation


class Predicted(NamedTuple):
    """Predictions in view, one a row."""

    xy_px: np.ndarray  # (m, 2)
    paths: np.ndarray  # (m, NUMBERS)
    search_px: np.ndarray  # (m, 2) along and across
    ground: np.ndarray  # (m, 2) level and noise of the strips, DN


@kernel
def fit_near(picture, turning, spot, xy_px, P_px, false_objects):
    """Fit the streaks near predictions.

    Parameters
    ----------
    picture : Picture
    turning : Turning
    spot : Spot
    xy_px, P_px : (m, 2), (m, 2, 2) predictions
    false_objects : float, wanted in all

    Returns
    -------
    (stars, streak_search.COLUMNS)
    level, noise : DN, medians of the strips; NaN without one
    """
    predicted = _in_view(picture, turning, spot.s, xy_px, P_px)
    if predicted.xy_px.shape[0] == 0:
        return np.empty((0, COLUMNS)), np.nan, np.nan
    around = Ground(np.median(predicted.ground[:, 0]), np.median(predicted.ground[:, 1]))
    search_px = predicted.search_px
    area = (4.0 * (search_px[:, 0] + spot.s) * (search_px[:, 1] + spot.s)).sum()
    density = looks(turning, np.sqrt(spot.s**2 - PIXEL_VARIANCE)).density
    if not density > 0.0:
        return np.empty((0, COLUMNS)), around.level_dn, around.noise_dn
    least = threshold(density, area, false_objects)
    return _fit_each(picture, turning, spot, predicted, around, least), around.level_dn, around.noise_dn


@inner
def _in_view(picture, turning, s, xy_px, P_px):
    """The predictions in view whose surroundings are known."""
    m, n = xy_px.shape[0], 0
    out = Predicted(np.empty((m, 2)), np.empty((m, NUMBERS)), np.empty((m, 2)), np.empty((m, 2)))
    values = np.empty(MOST_STRIP)
    for k in range(m):
        path, search_px = out.paths[n], out.search_px[n]
        if not _predicted(turning, xy_px[k], P_px[k], path, search_px):
            continue
        if _strips(picture, path, s, search_px[1], values, out.ground[n]):
            out.xy_px[n] = xy_px[k]
            n += 1
    return Predicted(out.xy_px[:n], out.paths[:n], out.search_px[:n], out.ground[:n])


@inner
def _fit_each(picture, turning, spot, predicted, around, least):
    """Fit the predicted streaks, each without the light of those before it; the stars (n, COLUMNS)."""
    m, n = predicted.xy_px.shape[0], 0
    fitted, paths, memory = np.empty((m, COLUMNS)), np.empty((m, NUMBERS)), memory_of(MOST_PIXELS)
    for k in range(m):
        row, path = fitted[n], paths[n]
        path[:], row[PLACE_X], row[PLACE_Y] = predicted.paths[k], predicted.xy_px[k, 0], predicted.xy_px[k, 1]
        level, (along, across) = predicted.ground[k, 0], predicted.search_px[k]
        reach = max(along, reach_px(path[LENGTH], spot.s))
        shot = (level - around.level_dn) * spot.dn_per_electron  # a brighter background is noisier
        noise = np.sqrt(max(around.noise_dn**2 + shot, 0.25 * around.noise_dn**2))
        ground = Ground(level, noise)
        pixels, row[N_SATURATED] = window_of(picture, path, spot.s, (reach, across), ground, memory)
        for j in range(n):
            if touching(path, paths[j], spot.s, reach):
                take_away(paths[j], spot, fitted[j, FLUX], pixels)
        search = Search(along, across, least, LEVEL_SIGMA * noise)
        if pixels.x.shape[0] == 0:
            continue
        n_near = fit_one(turning, spot, search, pixels, path, row)
        if n_near > 0 and row[RATIO] >= least:
            n += judge(turning, spot, pixels, n_near, path, row) == STAR
    return fitted[:n]


@inner
def _predicted(turning, xy_px, P_px, path, search_px):
    """Path of a predicted star and how far along and across it is searched; False if it is not in view."""
    camera = turning.camera
    if not path_of(turning, xy_px[0], xy_px[1], path):
        return False
    x, y = 0.5 * (path[X0] + path[X1]), 0.5 * (path[Y0] + path[Y1])
    if not (0.0 <= x <= camera.width_px - 1.0 and 0.0 <= y <= camera.height_px - 1.0):
        return False
    tx, ty = path[TX], path[TY]
    along = P_px[0, 0] * tx * tx + (P_px[0, 1] + P_px[1, 0]) * tx * ty + P_px[1, 1] * ty * ty
    across = P_px[0, 0] * ty * ty - (P_px[0, 1] + P_px[1, 0]) * tx * ty + P_px[1, 1] * tx * tx
    search_px[0] = min(max(SEARCH_SIGMAS * np.sqrt(max(along, 0.0)), LEAST_SEARCH_PX), MOST_SEARCH_PX)
    search_px[1] = min(max(SEARCH_SIGMAS * np.sqrt(max(across, 0.0)), LEAST_SEARCH_PX), MOST_SEARCH_PX)
    return True


@inner
def _strips(picture, path, s, across_px, values, ground):
    """Level and noise of the pixels beside a streak, to ground; False if too few are in the frame."""
    image_dn, bad, _ = picture
    rows, columns = image_dn.shape
    n_along = int(path[LENGTH] + 2.0 * STRIP_ENDS_PX) + 1
    n_across = int(STRIP_PX)
    first = STRIP_SIGMAS * s + across_px
    every = max(1, (2 * n_across * n_along) // MOST_STRIP + 1)
    n = 0
    for i in range(0, n_along, every):
        along = i - STRIP_ENDS_PX
        for j in range(2 * n_across):
            across = first + (j >> 1) if j & 1 else -first - (j >> 1)
            c = int(np.rint(path[X0] + along * path[TX] - across * path[TY]))
            r = int(np.rint(path[Y0] + along * path[TY] + across * path[TX]))
            if 0 <= c < columns and 0 <= r < rows and n < values.shape[0]:
                if not is_bad(bad, r * columns + c):
                    values[n] = image_dn[r, c]
                    n += 1
    if n < LEAST_STRIP:
        return False
    part = values[:n]
    part.sort()
    ground[0], low = _quantile(part, 0.5), _quantile(part, SIGMA_QUANTILE)
    ground[1] = max(ground[0] - low, LEAST_NOISE)
    if low < 0.5:  # grey value 0, which cuts off what is below
        ground[1] = max(ground[1], _quantile(part, TWO_ABOVE) - _quantile(part, 1.0 - SIGMA_QUANTILE))
    return True


@inner
def _quantile(ordered, fraction):
    """Quantile of ordered whole numbers k, each standing for an even spread over k - 1/2 ... k + 1/2."""
    target = fraction * ordered.shape[0]
    value = ordered[min(int(np.ceil(target)), ordered.shape[0]) - 1]
    below = np.searchsorted(ordered, value)
    equal = np.searchsorted(ordered, value, side="right") - below
    return value - 0.5 + (target - below) / equal
