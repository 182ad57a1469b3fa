"""Single frames of stars at an attitude of one's choice, by the renderer and the detector of the simulated
world but without a vehicle; for experiments on images.
"""

from functools import lru_cache
from math import atan, cos, hypot, pi, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import Pinhole, pixels
from shefex_nav.geometry.rotation import dcm_from_quat, quat_normalise
from shefex_nav.geometry.shutter import RowTimes, instant_after_s
from shefex_nav.world.camera import detector, motion, render
from shefex_nav.world.camera.hits import NO_HITS, add_hits

FAINT = 0.05  # light below this fraction of the noise is not drawn
MARGIN = 0.01  # rad around the field of view, for the spots


class StillCamera(NamedTuple):
    """A camera on a bench."""

    pinhole: Pinhole
    sigma_psf_px: float
    electronics: detector.Electronics
    background_electrons: float  # per pixel and exposure
    zero_magnitude_electrons: float  # of the exposure of a row, from a star of magnitude 0
    times: RowTimes | None = None  # needed when the camera turns
    psf: render.Psf | None = None  # of another spot than the Gaussian of sigma_psf_px


def random_attitude(rng):
    """Quaternion of an attitude, all equally likely. Generator -> (4,)"""
    return quat_normalise(rng.standard_normal(4))


def on_detector(camera, xy_px, margin_px=-0.5):
    """Which places are on the detector and further than a margin from its outermost pixels' middles.

    Pinhole, (n, 2), px -> (n,) bool, False for NaN
    """
    size = np.array([camera.width_px, camera.height_px])
    with np.errstate(invalid="ignore"):  # NaN behind the camera
        return ((xy_px > margin_px) & (xy_px < size - 1.0 - margin_px)).all(axis=1)


def electrons(camera, magnitudes):
    """Light of stars on the detector."""
    return camera.zero_magnitude_electrons * 10.0 ** (-0.4 * np.asarray(magnitudes))


def still(camera, u_i, light, q_ic, rng, *, omega_c=None, hits=NO_HITS):
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
    hits : Hits, charge that is in this frame besides: see `world.camera.hits`

    Returns
    -------
    image_dn : (rows, columns) uint8, or uint16 with more than 8 bits
    xy_px : (n, 2) place of each star at the frame's instant; NaN behind the camera

    Raises
    ------
    ValueError : the camera turns and has no times
    """
    if omega_c is not None and camera.times is None:
        raise ValueError("a camera that turns needs the times of its rows (StillCamera.times)")
    hole, electronics, background = camera.pinhole, camera.electronics, camera.background_electrons
    psf = render.gaussian_psf(camera.sigma_psf_px) if camera.psf is None else camera.psf
    C_ic = dcm_from_quat(q_ic)
    if omega_c is None:
        path, cone = motion.at_rest(np.ascontiguousarray(C_ic.T)), 0.0
    else:
        omega_c = np.asarray(omega_c, dtype=float)
        path = motion.turning(hole, C_ic, omega_c, camera.times, psf.step_px)
        cone = float(np.linalg.norm(omega_c)) * instant_after_s(camera.times)
    cone += atan(0.5 * hypot(hole.width_px, hole.height_px) / hole.focal_length_px) + MARGIN
    near = u_i @ C_ic[:, 2] > cos(min(pi, cone))
    least = FAINT * hypot(electronics.read_noise, sqrt(background))
    sheet = _sheet(hole.width_px * hole.height_px)
    render.darken(sheet)  # what the frame before left
    render.add_points(sheet, hole, psf, path, u_i[near], np.asarray(light, dtype=float)[near], least)
    add_hits(sheet, hits)
    grey = detector.background(
        hole.width_px * hole.height_px, detector.background_cells(electronics, background), rng
    )
    lit = render.lit_pixels(sheet)
    mean = background + sheet.electrons[lit].astype(float)
    grey[lit] = detector.digitise(electronics, mean, rng)
    return grey.reshape(hole.height_px, hole.width_px), pixels(hole, u_i @ C_ic)


@lru_cache(maxsize=2)
def _sheet(n_pixels):
    """Work memory for the light of a frame: new memory for every frame would cost more than its stars."""
    return render.darkness(n_pixels)
