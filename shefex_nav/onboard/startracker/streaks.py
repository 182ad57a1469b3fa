"""Detection of stars in motion, when the rate is known: the gyro tells the shape of every streak.

In: one frame and the motion of the camera. Out: `Detections` at the frame's instant, brightest first, and the
statistics of the frame.

    frame -> binned: bins of 2x2 pixels, level and noise in tiles
          -> matched: sums along the streaks; candidates above a low threshold
          -> streak_fit: each candidate at full resolution; place at the instant, flux, covariance
          -> streak_shape: what does not look like a star's streak is refused
          -> threshold of the matched signal-to-noise ratio, from the wanted number of false objects

With a rate of zero the streaks are spots and all holds as well. `detect_near` does the same in windows around
predicted places only.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.geometry.shutter import RowTimes
from shefex_nav.onboard.startracker import streak_near as near
from shefex_nav.onboard.startracker.binned import BIN, bad_map, in_noise, interpolated, level_of
from shefex_nav.onboard.startracker.detect import FrameStatistics
from shefex_nav.onboard.startracker.matched import (
    MIDDLE_X,
    MIDDLE_Y,
    candidates,
    looks,
    pad_of,
    steps_of,
    threshold,
    tile_side,
)
from shefex_nav.onboard.startracker.streak_fit import (
    COLUMNS,
    FLUX,
    LEVEL,
    N_PIXELS,
    N_SATURATED,
    PLACE_X,
    PLACE_Y,
    RATIO,
    XX,
    XY,
    YY,
    fit_one,
    reach_px,
    width2,
)
from shefex_nav.onboard.startracker.streak_light import (
    MOST_PIXELS,
    PIXEL_VARIANCE,
    ROWS,
    collect,
    take_away,
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
    place_of_middle,
    touching,
)
from shefex_nav.onboard.startracker.streak_shape import MISFIT, SHORT_SIGMAS, STAR, judge
from shefex_nav.records import Detections

FALSE_OBJECTS = 0.5  # wanted number of objects in a frame that are noise
FIRST_PART = 0.8  # of the threshold, for candidates: the bins lose a tenth of a star's ratio
CLIP_PART = 0.5  # of the threshold: what one bin may add to the filtered value of a streak
LEVEL_SIGMA = 0.05  # of the noise of a pixel: error of the level between tiles [E]
SPOT_STEPS = 3  # a sum of fewer bins is not clipped
ACROSS_PX = 1.5  # that a candidate may be off its line
BRIGHT = 25.0  # signal-to-noise ratio of the stars that show their width
WIDTH_PART = 0.02  # stars are fitted again if their width is off by more
WIDTHS = (0.7, 1.5)  # of the expected one, that are believed
IN_LINE_RATIO = 1.6  # of the light of two parts of a longer streak
IN_LINE_SIGMAS = 1.0  # they lie so close to one line
IN_LINE_PART = 1.25  # and the middles are at most so many lengths apart
GROWN = 1.6  # by more light than that no star grows when others are no longer taken away
FALSE_NEAR = 0.05  # wanted number of objects near predictions that are noise
MEAN_EVERY = 16


class Motion(NamedTuple):
    """How the camera turned during the exposure."""

    omega_c: np.ndarray  # (3,) rad/s, of the camera in its own axes, mean of the exposure
    P_omega_c: np.ndarray | None  # (3, 3) (rad/s)^2, its covariance; None: taken as exact
    times: RowTimes


def detect_streaks(params, camera, image_dn, motion, false_objects=FALSE_OBJECTS):
    """Stars in a frame of a turning camera.

    Parameters
    ----------
    params : DetectParams; of it bad_pixels, tile_px, saturation_dn, electrons_per_dn, psf_sigma_px and
        max_objects
    camera : Pinhole of the whole image
    image_dn : (rows, columns) uint8 or uint16
    motion : Motion
    false_objects : float, wanted number of objects in a frame that are noise

    Returns
    -------
    Detections, brightest first, at most params.max_objects; places at the instant, some outside the frame
    FrameStatistics
    """
    image_dn, omega_c, P_omega_c = _checked(camera, image_dn, motion)
    bad = bad_map(*image_dn.shape, params.bad_pixels)
    sums, level, mean_dn = level_of(image_dn, bad, params.tile_px)
    sigma, times = float(params.psf_sigma_px), motion.times
    density, longest, gradient = looks(camera, times, omega_c, sigma)
    k = threshold(density, float(image_dn.size), float(false_objects))
    side = tile_side(gradient)
    pad = pad_of(side, longest, sigma)
    bins = in_noise(sums, level, _clip(k, longest, sigma), pad)
    found, noise = candidates(bins, sums.shape, pad, side, camera, times, omega_c, sigma, FIRST_PART * k)
    fitted, n = _fit_all(
        image_dn,
        bad,
        camera,
        (omega_c, times),
        P_omega_c,
        level,
        found,
        sigma,
        1.0 / params.electrons_per_dn,
        int(params.saturation_dn),
        k * noise,
    )
    statistics = FrameStatistics(mean_dn, float(np.median(level.background)), float(np.median(level.noise)))
    return _detections(fitted[:n], params.max_objects), statistics


def detect_near(params, camera, image_dn, motion, xy_px, P_px, false_objects=FALSE_NEAR):
    """Stars near predicted places only, for tracking.

    Each is searched SEARCH_SIGMAS around its prediction, against the background of the strips beside it.

    Parameters
    ----------
    params, camera, image_dn, motion : as `detect_streaks`
    xy_px : (m, 2) predicted places at the instant
    P_px : (m, 2, 2) px^2, their covariances
    false_objects : float, wanted number of objects, over all predictions, that are noise

    Returns
    -------
    Detections, brightest first: the predictions that were found
    FrameStatistics, of the strips; the mean of every MEAN_EVERY-th row of the frame
    """
    image_dn, omega_c, P_omega_c = _checked(camera, image_dn, motion)
    xy_px, P_px = np.ascontiguousarray(xy_px, dtype=float), np.ascontiguousarray(P_px, dtype=float)
    if xy_px.ndim != 2 or xy_px.shape[1] != 2 or P_px.shape != (len(xy_px), 2, 2):
        raise ValueError(f"predictions: expected (m, 2) and (m, 2, 2), got {xy_px.shape} and {P_px.shape}")
    sigma, times = float(params.psf_sigma_px), motion.times
    bad = bad_map(*image_dn.shape, params.bad_pixels)
    fitted, n, level, noise = near.fit_near(
        image_dn,
        bad,
        camera,
        (omega_c, times),
        P_omega_c,
        xy_px,
        P_px,
        sigma,
        1.0 / params.electrons_per_dn,
        int(params.saturation_dn),
        float(false_objects),
    )
    statistics = FrameStatistics(float(image_dn[::MEAN_EVERY].mean()), level, noise)
    return _detections(fitted[:n], params.max_objects), statistics


def _checked(camera, image_dn, motion):
    """Frame, rate and covariance in the types of the kernels."""
    image_dn = np.ascontiguousarray(image_dn)
    if image_dn.dtype not in (np.uint8, np.uint16) or image_dn.shape != (camera.height_px, camera.width_px):
        raise ValueError(
            f"image: expected uint8 or uint16 of shape {(camera.height_px, camera.width_px)}, "
            f"got {image_dn.dtype} of shape {image_dn.shape}"
        )
    omega_c = np.ascontiguousarray(motion.omega_c, dtype=float)
    P_omega_c = np.zeros((3, 3)) if motion.P_omega_c is None else np.array(motion.P_omega_c, dtype=float)
    if omega_c.shape != (3,) or P_omega_c.shape != (3, 3):
        raise ValueError(f"motion: expected a rate (3,) and (3, 3), got {omega_c.shape}, {P_omega_c.shape}")
    if not np.isfinite(omega_c.sum() + P_omega_c.sum()):
        raise ValueError("motion: the rate or its covariance is not finite")
    return image_dn, omega_c, P_omega_c


def _clip(k, longest_px, sigma_px):
    """Largest value of a bin, in its own sigma: of a streak of n bins one adds c / sqrt(n) to the sum."""
    steps = steps_of(longest_px, 0.0, sigma_px)
    return CLIP_PART * k * np.sqrt(1.5 * steps) if steps > SPOT_STEPS else np.inf


def _detections(fitted, max_objects):
    """Records of the fitted stars, brightest first."""
    fitted = fitted[np.argsort(-fitted[:, FLUX], kind="mergesort")][:max_objects]
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


@njit(cache=True)
def _fit_all(
    image_dn, bad, camera, motion, P_omega_c, level, found, sigma, dn_per_electron, saturation_dn, least
):
    """Fit the candidates, brightest first, each without the light of those before it, and judge them.

    A streak that another one touches is fitted and judged again when all are known, and so are all if the
    bright ones are wider or narrower than expected.

    Returns
    -------
    fitted : (candidates, COLUMNS)
    n : number of stars, in the first rows
    """
    work, no_search = np.empty((ROWS, MOST_PIXELS)), (0.0, 0.0)
    fitted, paths = np.empty((found.shape[0], COLUMNS)), np.empty((found.shape[0], NUMBERS))
    verdict, widths = np.empty(found.shape[0], dtype=np.int64), np.empty(found.shape[0])
    subtract = np.ones(found.shape[0], dtype=np.bool_)
    s, n_fits, n_widths = np.sqrt(sigma**2 + PIXEL_VARIANCE), 0, 0
    for k in range(found.shape[0]):
        row, path = fitted[n_fits], paths[n_fits]
        x, y = found[k, MIDDLE_X], found[k, MIDDLE_Y]
        row[PLACE_X], row[PLACE_Y] = place_of_middle(camera, motion[1], motion[0], x, y, path)
        if not np.isfinite(row[PLACE_X]):
            continue
        around = _tile_level(level, path)
        n = _window(
            image_dn,
            bad,
            path,
            s,
            around,
            saturation_dn,
            dn_per_electron,
            paths,
            fitted,
            subtract,
            n_fits,
            -1,
            work,
            row,
        )
        if n == 0 or not fit_one(
            camera,
            motion,
            P_omega_c,
            s,
            dn_per_electron,
            around[1],
            LEVEL_SIGMA,
            no_search,
            least,
            n,
            path,
            work,
            row,
        ):
            continue
        if row[RATIO] < least:
            continue
        verdict[n_fits] = judge(camera, P_omega_c, s, dn_per_electron, n, path, work, row)
        if verdict[n_fits] == STAR and row[RATIO] > BRIGHT and row[N_SATURATED] == 0:
            widths[n_widths] = width2(s, row[LEVEL], n, work)
            n_widths += 1
        n_fits += 1
    expected, first_verdict, first_flux = s, verdict[:n_fits].copy(), fitted[:n_fits, FLUX].copy()
    if n_widths > 0:
        seen = np.sqrt(np.median(widths[:n_widths]))
        if WIDTHS[0] * s < seen < WIDTHS[1] * s and abs(seen - s) > WIDTH_PART * s:
            s = seen
    row, path = np.empty(COLUMNS), np.empty(NUMBERS)
    for k in range(n_fits):
        for j in range(n_fits):
            subtract[j] = first_verdict[j] == STAR
            if first_verdict[k] != STAR and _end_to_end(paths[k], paths[j], s):
                subtract[j] = False  # what goes on past its ends is not excused by what goes on there
        first = 0 if first_verdict[k] != STAR else k + 1
        if s == expected and not _has_neighbour(paths, subtract, k, first, n_fits, s):
            continue
        row[:], path[:] = fitted[k], paths[k]
        around = _tile_level(level, path)
        n = _window(
            image_dn,
            bad,
            path,
            s,
            around,
            saturation_dn,
            dn_per_electron,
            paths,
            fitted,
            subtract,
            n_fits,
            k,
            work,
            row,
        )
        if n > 0 and fit_one(
            camera,
            motion,
            P_omega_c,
            s,
            dn_per_electron,
            around[1],
            LEVEL_SIGMA,
            no_search,
            least,
            n,
            path,
            work,
            row,
        ):
            fitted[k], paths[k] = row, path
            verdict[k] = judge(camera, P_omega_c, s, dn_per_electron, n, path, work, row)
            if row[FLUX] > GROWN * first_flux[k]:
                verdict[k] = MISFIT  # it was a part of something that is no star
    return _stars(fitted[:n_fits], paths, verdict, least, s)


@njit(cache=True)
def _stars(fitted, paths, verdict, least, s):
    """Move the stars to the first rows; returns the rows and how many they are."""
    n, n_fits = 0, fitted.shape[0]
    in_line = np.zeros(n_fits, dtype=np.bool_)
    for k in range(n_fits):
        for j in range(n_fits):
            if j != k and verdict[j] == STAR and fitted[j, RATIO] >= least:
                in_line[k] |= _is_in_line(fitted[k], paths[k], fitted[j], paths[j], s)
    for k in range(n_fits):
        if verdict[k] == STAR and fitted[k, RATIO] >= least and not in_line[k]:
            fitted[n] = fitted[k]
            n += 1
    return fitted, n


@njit(cache=True)
def _is_in_line(fitted, path, other_fitted, other, s):
    """Whether two streaks look like one that is longer: end to end, on one line and as bright.

    Of true stars, about one in 500 has another one there by chance.
    """
    ratio = fitted[FLUX] / other_fitted[FLUX]
    return ratio < IN_LINE_RATIO and ratio * IN_LINE_RATIO > 1.0 and _end_to_end(path, other, s)


@njit(cache=True)
def _end_to_end(path, other, s):
    """Whether two streaks touch or overlap on the same line."""
    if path[LENGTH] < SHORT_SIGMAS * s:
        return False
    ex = 0.5 * (other[X0] + other[X1] - path[X0] - path[X1])
    ey = 0.5 * (other[Y0] + other[Y1] - path[Y0] - path[Y1])
    along, across = abs(ex * path[TX] + ey * path[TY]), abs(ey * path[TX] - ex * path[TY])
    between = along / path[LENGTH]
    return across < IN_LINE_SIGMAS * s and between < IN_LINE_PART


@njit(cache=True)
def _tile_level(level, path):
    """Background and noise of a pixel in the middle of a streak."""
    row = (0.5 * (path[Y0] + path[Y1]) - 0.5) / BIN
    column = (0.5 * (path[X0] + path[X1]) - 0.5) / BIN
    background = interpolated(level.background, level.tile, row, column)
    return background, interpolated(level.noise, level.tile, row, column)


@njit(cache=True)
def _window(
    image_dn,
    bad,
    path,
    s,
    around,
    saturation_dn,
    dn_per_electron,
    paths,
    fitted,
    subtract,
    n_fits,
    own,
    work,
    row,
):
    """Collect the pixels of a streak, without the light of those that are to be subtracted; their number."""
    extra = (reach_px(path[LENGTH], s), ACROSS_PX)
    n, row[N_SATURATED] = collect(image_dn, bad, path, s, extra, around[0], around[1], saturation_dn, work)
    for j in range(n_fits):
        if j != own and subtract[j] and touching(path, paths[j], s, extra[0]):
            take_away(paths[j], s, fitted[j, FLUX], dn_per_electron, n, work)
    return n


@njit(cache=True)
def _has_neighbour(paths, subtract, k, first, n, s):
    """Whether one of the streaks first ... n - 1 that are subtracted is near streak k."""
    for j in range(first, n):
        if j != k and subtract[j] and touching(paths[k], paths[j], s, reach_px(paths[k, LENGTH], s)):
            return True
    return False
