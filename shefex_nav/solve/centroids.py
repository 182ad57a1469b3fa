"""Attitude from a list of centroids: the star identification of this package for any camera.

In: centroids and, if known, their brightness. Out: attitude, stars, covariance and the probability that it is
wrong, or the reason for none. The catalogue and its pairs are built at the first call with a camera, epoch
and magnitude, and kept.
"""

from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.geometry.pinhole import Pinhole, unit_vectors
from shefex_nav.geometry.rotation import quat_conjugate
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.onboard.startracker.attitude import covariance, esoq2
from shefex_nav.onboard.startracker.identify import IDENTIFIERS, bayes
from shefex_nav.onboard.startracker.identify.verify import IdentifyParams
from shefex_nav.records import Reason

MERGE_PX = 2.0  # closer stars are one point of light
UNDISTORT_STEPS = 20
NO_COVARIANCE = np.zeros((3, 3))
NO_ROTATION = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True)
class Camera:
    """A camera. Pixel (0, 0) is the centre of the top-left pixel, x right, y down, z along the boresight.

    principal_point_px: (x, y), by default the middle of the detector. distortion: None or
    (k1, k2, p1, p2, k3) of Brown and Conrady in the order of OpenCV, from the ideal to the distorted image.
    """

    width_px: int
    height_px: int
    focal_length_px: float
    principal_point_px: tuple | None = None
    distortion: tuple | None = None

    def __post_init__(self):
        for name in ("width_px", "height_px", "focal_length_px"):
            value = getattr(self, name)
            if not (np.isscalar(value) and isfinite(value) and value > 0):
                raise ValueError(f"Camera.{name}: expected a positive number, got {value!r}")
        if self.principal_point_px is None:
            centre = (0.5 * (self.width_px - 1), 0.5 * (self.height_px - 1))
        else:
            centre = _numbers("Camera.principal_point_px", self.principal_point_px, (2,))
        object.__setattr__(self, "principal_point_px", tuple(float(v) for v in centre))
        if self.distortion is not None:
            values = _numbers("Camera.distortion", self.distortion, (5,))
            object.__setattr__(self, "distortion", tuple(float(v) for v in values))


class StarSolution(NamedTuple):
    """What `solve_centroids` found."""

    status: str  # 'ok' or 'failed'
    reason: str  # empty, or why: too_few_stars, no_match, ambiguous, residuals
    q_ci: np.ndarray  # (4,) ICRS to camera, Hamilton, scalar first; NaN without a solution
    hip: np.ndarray  # (n,) int64 Hipparcos number of each centroid, 0 where unmatched
    covariance: np.ndarray  # (3, 3) rad^2, of the rotation-vector error in camera axes; NaN likewise
    false_probability: float  # bound of the probability that chance made this; 1 without a solution


def solve_centroids(
    xy_px,
    flux,
    *,
    camera,
    epoch,
    method="default",
    max_magnitude=5.5,
    centroid_sigma_px=0.15,
    magnitude_sigma=0.2,
    false_limit=1e-7,
    prediction=None,
):
    """Identify the stars of a frame and find the attitude of the camera.

    Positions are those of the catalogue at the epoch; aberration (20 arcsec, nearly the same for the whole
    field) is not corrected.

    Parameters
    ----------
    xy_px : (n, 2) centroids, in any order
    flux : (n,) brightness in any unit, or None
    camera : Camera
    epoch : float, Julian year, e.g. 2012.47
    method : 'default' or a key of IDENTIFIERS
    max_magnitude : float, V of the faintest catalogue stars to use
    centroid_sigma_px : float, standard deviation of a centroid per axis
    magnitude_sigma : float, scatter of -2.5 log10 flux against V
    false_limit : float, accepted probability that a solution is chance
    prediction : None or (q_ci, P): attitude and covariance (3, 3) [rad^2] of its error in camera axes

    Returns
    -------
    StarSolution; a frame that cannot be solved is not an error
    """
    xy_px, magnitude, order = _checked(xy_px, flux, camera)
    for name, value in (("centroid_sigma_px", centroid_sigma_px), ("magnitude_sigma", magnitude_sigma)):
        if not 0.0 < value < 100.0:
            raise ValueError(f"{name}: expected a positive number, got {value!r}")
    if not 0.0 < false_limit < 1.0:
        raise ValueError(f"false_limit: expected a probability between 0 and 1, got {false_limit!r}")
    prior = bayes.NO_PREDICTION if prediction is None else _prediction(prediction)
    sky = _sky(camera, epoch, max_magnitude)
    if camera.distortion is not None:
        xy_px = undistort(sky.pinhole, np.array(camera.distortion), xy_px)
    if method in ("default", "bayes"):
        settings = sky.settings._replace(
            sigma_px=float(centroid_sigma_px),
            magnitude_sigma=float(magnitude_sigma),
            false_limit=float(false_limit),
        )
        reason, star, q_ci, P_c, _, wrong, _ = bayes.solve_kernel(
            sky.stars, sky.index, settings, xy_px, magnitude, flux is not None, *prior
        )
    else:
        sigmas = (centroid_sigma_px, magnitude_sigma, false_limit)
        reason, star, q_ci, P_c, wrong = _by_method(method, sky, xy_px, flux, order, sigmas)
    hip = np.zeros(len(star), dtype=np.int64)
    if reason != 0:
        return StarSolution("failed", Reason(reason).name.lower(), q_ci, hip, P_c, 1.0)
    known = star >= 0
    hip[order[known]] = sky.hip[star[known]]
    return StarSolution("ok", "", q_ci, hip, P_c, wrong)


class _Sky(NamedTuple):
    """Catalogue and pairs for one camera and epoch."""

    pinhole: Pinhole
    hip: np.ndarray
    pairs: catalogue.StarPairs
    stars: bayes.Stars
    index: bayes.Pairs
    settings: bayes.Settings


@lru_cache(maxsize=8)
def _sky(camera, epoch, max_magnitude):
    """Build what does not change from frame to frame."""
    if not (np.isscalar(epoch) and isfinite(epoch) and 1900.0 < epoch < 2200.0):
        raise ValueError(f"epoch: expected a Julian year between 1900 and 2200, got {epoch!r}")
    if not 0.0 < max_magnitude <= 8.0:
        raise ValueError(f"max_magnitude: expected V between 0 and 8, got {max_magnitude!r}")
    cx, cy = camera.principal_point_px
    pinhole = Pinhole(camera.width_px, camera.height_px, float(camera.focal_length_px), cx, cy)
    right, bottom = camera.width_px - 0.5, camera.height_px - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]])
    displaced = 0.0
    if camera.distortion is not None:
        ideal = undistort(pinhole, np.array(camera.distortion), corners)
        displaced = float(np.abs(ideal - corners).max())
    field = 2.0 * np.arctan((np.hypot(*(corners - [cx, cy]).T).max() + displaced) / pinhole.focal_length_px)
    params = catalogue.CatalogueParams(
        kind="magnitude_limited",
        max_magnitude=float(max_magnitude),
        merge_radius=MERGE_PX / pinhole.focal_length_px,
        keep_magnitude=0.0,
        n_stars=0,
    )
    stars = catalogue.build(params, load_catalogue(8.0), float(epoch))
    pairs = catalogue.pair_table(stars, 1.03 * field)  # the focal length may be a little shorter
    settings = bayes.Settings(
        float(camera.width_px), float(camera.height_px), pinhole.focal_length_px, cx, cy,
        bayes.BORDER_PX + displaced, 0.0, 0.0, 0.0, bayes.MIN_STARS, bayes.BUDGET,
    )  # fmt: skip
    return _Sky(pinhole, stars.hip, pairs, *bayes.tables(pairs), settings)


@njit(cache=True)
def undistort(pinhole, distortion, xy_px):
    """Pixels of an ideal pinhole from distorted ones, by iteration. Pinhole, (5,), (n, 2) -> (n, 2)."""
    k1, k2, p1, p2, k3 = distortion
    out = np.empty_like(xy_px)
    for k in range(xy_px.shape[0]):
        u = (xy_px[k, 0] - pinhole.cx_px) / pinhole.focal_length_px
        v = (xy_px[k, 1] - pinhole.cy_px) / pinhole.focal_length_px
        x, y = u, v
        for _ in range(UNDISTORT_STEPS):
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            dx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
            dy = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
            x, y = (u - dx) / radial, (v - dy) / radial
        out[k, 0] = pinhole.cx_px + pinhole.focal_length_px * x
        out[k, 1] = pinhole.cy_px + pinhole.focal_length_px * y
    return out


def _numbers(name, value, shape):
    """Finite float array of a shape, where None is any length; or a ValueError that says what is wrong."""
    try:
        array = np.array(value, dtype=np.float64, order="C")  # a copy: one layout, one compilation
    except (TypeError, ValueError):
        raise ValueError(f"{name}: expected numbers of shape {shape}, got {value!r}") from None
    fits = array.ndim == len(shape) and all(
        wanted in (None, has) for wanted, has in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name}: expected shape {str(shape).replace('None', 'n')}, got {array.shape}")
    if not isfinite(array.sum()):  # one NaN or infinity is enough
        raise ValueError(f"{name}: contains NaN or infinite values")
    return array


def _checked(xy_px, flux, camera):
    """Centroids and magnitudes, brightest first, and their order."""
    if not isinstance(camera, Camera):
        raise ValueError(f"camera: expected a Camera, got {camera!r}")
    xy_px = _numbers("xy_px", xy_px, (None, 2)) if len(xy_px) else np.zeros((0, 2))
    n = xy_px.shape[0]
    if flux is None:
        return xy_px, np.zeros(n), np.arange(n)
    flux = _numbers("flux", flux, (n,))
    if n and flux.min() <= 0.0:
        raise ValueError("flux: expected positive values")
    order = np.argsort(-flux, kind="stable")
    return xy_px[order], -2.5 * np.log10(flux[order]), order


def _prediction(prediction):
    """Checked (True, q_ci, P)."""
    try:
        q_ci, P = prediction
    except (TypeError, ValueError):
        raise ValueError("prediction: expected (q_ci, covariance)") from None
    q_ci, P = _numbers("prediction q_ci", q_ci, (4,)), _numbers("prediction covariance", P, (3, 3))
    norm = np.linalg.norm(q_ci)
    if not 0.9 < norm < 1.1:
        raise ValueError(f"prediction q_ci: expected a unit quaternion, got norm {norm:.3g}")
    if np.linalg.eigvalsh(0.5 * (P + P.T))[0] <= 0.0:
        raise ValueError("prediction covariance: expected a positive definite matrix")
    return True, q_ci / norm, np.ascontiguousarray(0.5 * (P + P.T))


def _by_method(method, sky, xy_px, flux, order, sigmas):
    """Another method of the package, lost in space."""
    if method not in IDENTIFIERS:
        known = ", ".join(["default", *IDENTIFIERS])
        raise ValueError(f"method: {method!r} is not known; choose from: {known}")
    centroid_sigma_px, magnitude_sigma, false_limit = sigmas
    f = sky.pinhole.focal_length_px
    params = IdentifyParams(
        method=method,
        camera=sky.pinhole,
        tolerance=3.0 * np.sqrt(2.0) * centroid_sigma_px / f,
        max_centroids=15,
        min_stars=4,
        sigma_px=centroid_sigma_px,
        gate_sigma=4.5,
        detection_probability=0.9,
        magnitude_margin=0.3,
        magnitude_sigma=magnitude_sigma,
        false_alarm=false_limit,
    )
    u_c = unit_vectors(sky.pinhole, xy_px)
    brightness = np.ones(len(xy_px)) if flux is None else np.asarray(flux, dtype=float)[order]
    found = IDENTIFIERS[method](params, sky.pairs, u_c, brightness)
    if found.reason != Reason.NONE:
        return found.reason, found.star, np.full(4, np.nan), np.full((3, 3), np.nan), 1.0
    known = found.star >= 0
    sigma = np.full(known.sum(), centroid_sigma_px / f)
    q_ic = esoq2(u_c[known], sky.pairs.stars.u_i[found.star[known]], sigma)
    return 0, found.star, quat_conjugate(q_ic), covariance(u_c[known], sigma), float(np.exp(-found.log_odds))
