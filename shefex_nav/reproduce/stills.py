"""Single frames of stars at an attitude of one's choice, by the renderer and the detector of the simulated
world but without a vehicle; for experiments on images.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.geometry.rotation import dcm_from_quat, dcm_from_rotvec
from shefex_nav.world.camera import detector, render


class Electronics(NamedTuple):
    """Detector: as the fields of `CameraParams`, at 0 dB."""

    read_noise_electrons: float  # > 0
    full_well_electrons: float
    electrons_per_dn: float
    black_level_dn: float


class StillCamera(NamedTuple):
    """A camera on a bench."""

    pinhole: Pinhole
    sigma_psf_px: float
    electronics: Electronics
    background_electrons: float  # per pixel and exposure
    zero_magnitude_electrons: float  # of the exposure, from a star of magnitude 0


def electrons(camera, magnitudes):
    """Light of stars on the detector."""
    return camera.zero_magnitude_electrons * 10.0 ** (-0.4 * np.asarray(magnitudes))


def still(camera, u_i, light, q_ic, rng, *, turn_c=None):
    """One frame.

    Parameters
    ----------
    camera : StillCamera
    u_i : (n, 3) directions as the camera sees them
    light : (n,) electrons
    q_ic : (4,) attitude in the middle of the exposure
    rng : Generator of the noise
    turn_c : (3,) rad, rotation vector of the exposure in camera axes; None: the camera stands still

    Returns
    -------
    image_dn : (rows, columns) uint8
    xy_px : (n, 2) mean place of each star's light; NaN behind the camera
    """
    hole, psf = camera.pinhole, render.gaussian_psf(camera.sigma_psf_px)
    C_ic = dcm_from_quat(q_ic)
    if turn_c is None:
        C_ci = np.ascontiguousarray(C_ic.T)[None]
    else:
        n = 2 + int(2.0 * np.linalg.norm(turn_c) * hole.focal_length_px)  # steps under half a pixel
        parts = (np.arange(n) + 0.5) / n - 0.5
        C_ci = np.array([(C_ic @ dcm_from_rotvec(part * turn_c)).T for part in parts])
    least = 0.05 * np.hypot(camera.electronics.read_noise_electrons, np.sqrt(camera.background_electrons))
    sheet = render.darkness(hole.width_px * hole.height_px)
    xy_px = render.add_points(sheet, hole, psf, C_ci, u_i, light, least)
    pairs = detector.background_pairs(camera.electronics, 0.0, camera.background_electrons)
    grey = detector.background(hole.width_px * hole.height_px, pairs, rng)
    lit = render.lit_pixels(sheet)
    mean = camera.background_electrons + sheet.electrons[lit].astype(float)
    grey[lit] = detector.digitise(camera.electronics, 0.0, mean, rng)
    return grey.reshape(hole.height_px, hole.width_px), xy_px
