"""The star camera as the software that flies knows it."""

from typing import Any, NamedTuple

import numpy as np

NO_PIXELS = np.zeros((0, 2), dtype=np.int64)


class CameraModel(NamedTuple):
    """What calibration and the settings of the star camera tell; a value that is left out is not known."""

    pinhole: Any = None  # Pinhole without errors: size of the detector, focal length over pixel size, axis
    bad_pixels: np.ndarray = NO_PIXELS  # (n, 2) int64 row, column of those found bad before flight
    electrons_per_dn: float = np.inf  # conversion of the detector at the gain that is set; inf: no shot noise
    psf_sigma: float = 1.0  # px, width of a spot where the frame does not show it (interpolation: anywhere)
    # light of a star of magnitude 0 in the unit of the fluxes: zero-magnitude flux times exposure over
    # electrons per DN; of the longest exposure, in `tracker.of_exposure` of that of a frame
    zero_flux: float = np.nan
    focal_length_error: float = 0.0  # relative, that the calibration left
    sun_exclusion: float = 0.0  # rad, boresight to the Sun
    earth_exclusion: float = -np.inf  # rad, boresight to the Earth's limb
    distortion: np.ndarray | None = None  # (5,) of `geometry.distortion`; None: a lens without
    displaced_px: float = 0.0  # by the distortion, at most
