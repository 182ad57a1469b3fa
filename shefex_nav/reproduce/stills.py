"""Single frames of stars at an attitude of one's choice, by the renderer and the detector of the simulated
world but without a vehicle; for experiments on images.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import Pinhole, pixels
from shefex_nav.geometry.rotation import dcm_from_quat, dcm_from_rotvec
from shefex_nav.geometry.shutter import RowTimes, duration_s, instant_after_s, row_start_s
from shefex_nav.world.camera import detector, render


class Electronics(NamedTuple):
    """Detector: as the fields of `CameraParams`, at 0 dB."""

    read_noise_electrons: float  # > 0
    full_well_electrons: float
    electrons_per_dn: float
    black_level_dn: float
    bits: int = 8


class StillCamera(NamedTuple):
    """A camera on a bench."""

    pinhole: Pinhole
    sigma_psf_px: float
    electronics: Electronics
    background_electrons: float  # per pixel and exposure
    zero_magnitude_electrons: float  # of the exposure of a row, from a star of magnitude 0
    times: RowTimes | None = None  # needed when the camera turns


def electrons(camera, magnitudes):
    """Light of stars on the detector."""
    return camera.zero_magnitude_electrons * 10.0 ** (-0.4 * np.asarray(magnitudes))


def still(camera, u_i, light, q_ic, rng, *, omega_c=None):
    """One frame.

    Parameters
    ----------
    camera : StillCamera
    u_i : (n, 3) directions as the camera sees them
    light : (n,) electrons of the exposure of one row from a star at rest; with a rolling shutter a star that
        moves is seen for longer or shorter than that
    q_ic : (4,) attitude at the frame's instant, the middle of the exposure of the middle of the rows
    rng : Generator of the noise
    omega_c : (3,) rad/s, inertial rate in camera axes, constant in the frame; None: the camera stands still

    Returns
    -------
    image_dn : (rows, columns) uint8, or uint16 with more than 8 bits
    xy_px : (n, 2) place of each star at the frame's instant; NaN behind the camera

    Raises
    ------
    ValueError : the camera turns and has no times
    """
    hole, psf = camera.pinhole, render.gaussian_psf(camera.sigma_psf_px)
    if omega_c is not None and camera.times is None:
        raise ValueError("a camera that turns needs the times of its rows (StillCamera.times)")
    C_ic = dcm_from_quat(q_ic)
    least = 0.05 * np.hypot(camera.electronics.read_noise_electrons, np.sqrt(camera.background_electrons))
    sheet = render.darkness(hole.width_px * hole.height_px)
    if omega_c is None:
        render.add_points(sheet, hole, psf, np.ascontiguousarray(C_ic.T)[None], u_i, light, least)
    else:
        sheet.electrons[:] = _turning(camera, u_i, light, C_ic, np.asarray(omega_c, dtype=float)).ravel()
        lit = np.flatnonzero(sheet.electrons > least)
        sheet.lit[: len(lit)] = lit
        sheet.n_lit[0] = len(lit)
    cells = detector.background_cells(camera.electronics, 0.0, camera.background_electrons)
    grey = detector.background(hole.width_px * hole.height_px, cells, rng)
    lit = render.lit_pixels(sheet)
    mean = camera.background_electrons + sheet.electrons[lit].astype(float)
    grey[lit] = detector.digitise(camera.electronics, 0.0, mean, rng)
    return grey.reshape(hole.height_px, hole.width_px), pixels(hole, u_i @ C_ic)


def _turning(camera, u_i, light, C_ic, omega_c):
    """Mean electrons of stars: (rows, columns)."""
    from scipy.special import ndtr

    hole, times, sigma = camera.pinhole, camera.times, camera.sigma_psf_px
    image = np.zeros((hole.height_px, hole.width_px))
    n = 2 + int(3.0 * np.linalg.norm(omega_c) * duration_s(times) * hole.focal_length_px)
    step_s = duration_s(times) / n
    reach = int(np.ceil(5.0 * sigma)) + 1
    edges = np.arange(-reach, reach + 2) - 0.5
    for k in range(n):
        t_s = (k + 0.5) * step_s - instant_after_s(times)
        places = pixels(hole, u_i @ (C_ic @ dcm_from_rotvec(t_s * omega_c)))
        for (x, y), amount in zip(places, light, strict=True):
            if not (-reach < x < hole.width_px - 1 + reach and -reach < y < hole.height_px - 1 + reach):
                continue
            column, row = int(np.floor(x + 0.5)), int(np.floor(y + 0.5))
            rows = np.arange(row - reach, row + reach + 1)
            starts = row_start_s(times, rows)
            open_s = np.minimum(t_s + 0.5 * step_s, starts + times.exposure_s)
            open_s = np.maximum(open_s - np.maximum(t_s - 0.5 * step_s, starts), 0.0)
            if not open_s.any():
                continue
            in_rows = np.diff(ndtr((row + edges - y) / sigma)) * open_s / times.exposure_s
            spot = amount * np.outer(in_rows, np.diff(ndtr((column + edges - x) / sigma)))
            top, left = max(0, row - reach), max(0, column - reach)
            bottom, right = min(hole.height_px, row + reach + 1), min(hole.width_px, column + reach + 1)
            image[top:bottom, left:right] += spot[
                top - row + reach : bottom - row + reach, left - column + reach : right - column + reach
            ]
    return image
