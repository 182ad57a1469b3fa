"""Pictures by the package's renderer through a lens that is bent: stars are put where the lens shows them."""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment.stars import aberrate, at_epoch, load_catalogue
from shefex_nav.geometry.pinhole import Pinhole, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.papers.stills import StillCamera, electrons, random_attitude, still
from shefex_nav.solve.calibration.lens_fit import places
from shefex_nav.solve.told import MINUTES, earth_velocity
from shefex_nav.world.camera.detector import Electronics

YEAR = 2012.47
STARS = at_epoch(load_catalogue(8.0), YEAR)
SIZE_PX = 659, 493
READ_NOISE, PER_DN, BLACK_DN, PSF_PX = 16.0, 7.44, 16.0, 0.8  # SHEFEX-2 at 24 dB
ZERO_FLUX = 2.5e6 * 0.05  # electrons of an exposure, from a star of magnitude 0


class Camera(NamedTuple):
    """A camera as it is."""

    values: np.ndarray  # (8,) of lens_fit.NAMES
    hot: np.ndarray  # (k, 2) row, column
    hot_electrons: np.ndarray  # (k,)


def camera_of(rng, focal_px=2520.0, n_hot=40):
    """A camera whose lens is drawn from what lenses are like: by the priors of the fit."""
    from shefex_nav.solve.lens import OFF_CENTRE, middle, spread

    diagonal = float(np.hypot(*SIZE_PX))
    off = rng.normal(0.0, 3.0 * OFF_CENTRE * diagonal, 2)
    k = rng.normal(0.0, spread(0.5 * diagonal / focal_px)[:5])
    values = np.concatenate([[focal_px * rng.uniform(0.97, 1.03)], middle(SIZE_PX) + off, k])
    hot = np.column_stack([rng.integers(5, SIZE_PX[1] - 5, n_hot), rng.integers(5, SIZE_PX[0] - 5, n_hot)])
    return Camera(values, np.unique(hot, axis=0), rng.uniform(150.0, 5000.0, len(np.unique(hot, axis=0))))


def shoot(rng, camera, *, background=20.0, psf_px=PSF_PX, q_ic=None):
    """Grey values (rows, columns) of a drawn attitude."""
    q_ic = random_attitude(rng) if q_ic is None else q_ic
    C_ci = dcm_from_quat(q_ic).T
    u_i = aberrate(STARS.u_i, earth_velocity(round(YEAR * MINUTES)))
    ahead = u_i @ C_ci[2] > np.cos(0.25)
    at = places(camera.values, C_ci, u_i[ahead], SIZE_PX)
    hole = Pinhole(*SIZE_PX, 2520.0, *(0.5 * (np.array(SIZE_PX) - 1.0)))
    bent_i = unit_vectors(hole, np.ascontiguousarray(at)) @ C_ci
    body = StillCamera(
        hole, psf_px, Electronics(READ_NOISE, 30000.0, PER_DN, BLACK_DN), background, ZERO_FLUX
    )
    image, _ = still(body, bent_i, electrons(body, STARS.vmag[ahead]), q_ic, rng)
    grey = image.astype(float)
    rows, columns = camera.hot.T
    grey[rows, columns] += camera.hot_electrons / PER_DN
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
