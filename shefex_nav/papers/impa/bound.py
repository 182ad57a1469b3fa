"""The best that any unbiased centroid of a streak can do: the Cramer-Rao bound, and the matched-filter SNR.

The mean light of a star is its Gaussian spot carried along its path while each row is open; from it and its
derivatives by the place and the light comes the information of the pixels, each with the noise of background,
read-out and the star itself. The rate is known to the tracker with an error; what that leaves open of the
place at the frame's instant is added, since no centroid of one star can undo it.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from shefex_nav.geometry.shutter import row_start_s
from shefex_nav.geometry.streak import place_at, rate_lever, seen_from_to, velocity

STEP_PX = 0.25  # between two spots of a streak
DERIVATIVE_PX = 0.05
MARGIN_PX = 8


class Bound(NamedTuple):
    """What the pixels of one streak hold."""

    P_px: np.ndarray  # (2, 2) px^2, least covariance of the place; NaN for a star off the detector
    snr: float  # of the light through the matched filter, place known
    inside: bool  # the whole streak is on the detector
    heading: float  # rad, direction of the motion at the instant


def mean_light(camera, sigma_px, times, omega_c, xy_px, box):
    """Mean of a star's light in a box of pixels, for one electron per row exposure.

    Parameters
    ----------
    camera : Pinhole
    sigma_px : float, of the spot
    times : RowTimes
    omega_c : (3,) rad/s
    xy_px : (2,) place at the frame's instant
    box : left, right, top, bottom; pixels, the last ones included

    Returns
    -------
    (rows, columns)
    """
    left, right, top, bottom = box
    begin_s, end_s = seen_from_to(camera, times, omega_c, xy_px[0], xy_px[1])
    margin_s = 0.1 * (end_s - begin_s) + times.line_s * MARGIN_PX
    speed = np.hypot(*velocity(camera, omega_c, xy_px[0], xy_px[1]))
    n = 8 + int(speed * (end_s - begin_s + 2.0 * margin_s) / STEP_PX)
    step_s = (end_s - begin_s + 2.0 * margin_s) / n
    t_s = begin_s - margin_s + (np.arange(n) + 0.5) * step_s
    places = np.array([place_at(camera, omega_c, xy_px[0], xy_px[1], t) for t in t_s])
    rows = np.arange(top, bottom + 1)
    start_s = row_start_s(times, rows)
    opened = np.minimum(t_s[:, None] + 0.5 * step_s, start_s + times.exposure_s)
    opened -= np.maximum(t_s[:, None] - 0.5 * step_s, start_s)
    in_rows = _shares(places[:, 1], top, bottom, sigma_px) * np.maximum(opened, 0.0) / times.exposure_s
    return in_rows.T @ _shares(places[:, 0], left, right, sigma_px)


def _shares(centres, first, last, sigma_px):
    """Share of Gaussian spots in each pixel first ... last of an axis: (n, pixels)."""
    edges = np.arange(first, last + 2) - 0.5
    return np.diff(ndtr((edges - centres[:, None]) / sigma_px), axis=1)


def bound(still_camera, omega_c, P_omega_c, xy_px, electrons):
    """Cramer-Rao bound of a star's place.

    Parameters
    ----------
    still_camera : StillCamera with times
    omega_c, P_omega_c : (3,) rad/s the true rate, (3, 3) covariance of the known one
    xy_px : (2,) true place at the instant
    electrons : float, of one row's exposure at rest

    Returns
    -------
    Bound
    """
    camera, times = still_camera.pinhole, still_camera.times
    begin_s, end_s = seen_from_to(camera, times, omega_c, xy_px[0], xy_px[1])
    ends = np.array([place_at(camera, omega_c, *xy_px, t) for t in (begin_s, 0.0, end_s)])
    if not np.isfinite(ends).all():
        return Bound(np.full((2, 2), np.nan), 0.0, False, 0.0)
    low = np.floor(np.minimum(ends[0], ends[2]) - MARGIN_PX).astype(int)
    high = np.ceil(np.maximum(ends[0], ends[2]) + MARGIN_PX).astype(int)
    inside = bool((low >= 0).all() and high[0] < camera.width_px and high[1] < camera.height_px)
    box = low[0], high[0], low[1], high[1]

    def light(dx, dy):
        place = np.array([xy_px[0] + dx, xy_px[1] + dy])
        return electrons * mean_light(camera, still_camera.sigma_psf_px, times, omega_c, place, box)

    mean, h = light(0.0, 0.0), DERIVATIVE_PX
    by = [(light(h, 0.0) - light(-h, 0.0)) / (2 * h), (light(0.0, h) - light(0.0, -h)) / (2 * h), mean]
    electronics = still_camera.electronics
    variance = still_camera.background_electrons + electronics.read_noise**2
    variance = variance + electronics.electrons_per_dn**2 / 12.0 + mean
    information = np.array([[(a * b / variance).sum() for b in by] for a in by])
    P_px = np.linalg.inv(information)[:2, :2]
    J = rate_lever(camera, times, omega_c, *xy_px)
    heading = float(np.arctan2(*velocity(camera, omega_c, *xy_px)[::-1]))
    return Bound(P_px + J @ P_omega_c @ J.T, float(np.sqrt(information[2, 2])), inside, heading)


def along_across(vectors, heading):
    """Components along the motion and across it. (n, 2), (n,) -> (n, 2)."""
    c, s = np.cos(heading), np.sin(heading)
    return np.column_stack([c * vectors[:, 0] + s * vectors[:, 1], c * vectors[:, 1] - s * vectors[:, 0]])
