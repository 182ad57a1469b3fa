"""Attitude, focal length and radial distortion that fit the stars of a picture, by least squares.

In: a proposal that is right to a percent. Out: the fit with its covariance, and which detection is which
star. Distortion is Brown's k1: x = f X/Z (1 + k1 r^2) + cx, r^2 = (X^2 + Y^2) / Z^2, about the middle of the
picture.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import Pinhole, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_rotvec
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.solve.camera import pinhole_of, undistorted

GATES = (0.008, 0.005, 0.0035, 0.0025, 0.0018, 0.0018)  # of the picture's diagonal: from proposal to fit
LEAST_GATE_PX = 1.5
NOISE_GATE = 4.0  # standard deviations, in the end
LEAST_NOISE_PX = 0.08
FOR_DISTORTION = 10  # stars without which no distortion is fitted
DISTORTION_SIGMA = 4.0  # less is not significant and set to zero
CONVERGED = 3  # steps with the final gate
IDEAL = Pinhole(2, 2, 1.0, 0.0, 0.0)  # its pixels are X/Z, Y/Z


class Lens(NamedTuple):
    """Orientation and optics of one picture."""

    C_ci: np.ndarray  # (3, 3)
    focal_px: float
    k1: float


class Fit(NamedTuple):
    """Lens, and how well it is known."""

    lens: Lens
    star: np.ndarray  # (n,) row of the stars per detection, -1
    residual_px: np.ndarray  # (n, 2) detection minus star, 0 where unmatched
    noise_px: float  # of a centroid per axis, from the residuals
    sigma_log_focal: float
    sigma_k1: float  # 0 without a distortion


def project(lens, u_i, size_px):
    """Pixels of directions. (n, 3) -> xy_px (n, 2), NaN behind the camera; ideal x, y = X/Z, Y/Z (n, 2)."""
    u_c = u_i @ lens.C_ci.T
    with np.errstate(divide="ignore", invalid="ignore"):
        ideal = np.where(u_c[:, 2:] > 0.1, u_c[:, :2] / u_c[:, 2:], np.nan)
    radial = 1.0 + lens.k1 * (ideal**2).sum(axis=1, keepdims=True)
    return middle(size_px) + lens.focal_px * radial * ideal, ideal


def middle(size_px):
    """(cx, cy) of a picture (width, height)."""
    return 0.5 * (np.asarray(size_px, dtype=float) - 1.0)


def match(seen_px, xy_px, gate_px):
    """Mutually nearest stars and detections within the gate: rows of the stars (n,), -1 where none."""
    from scipy.spatial import cKDTree

    star = np.full(len(xy_px), -1)
    if len(seen_px) == 0 or len(xy_px) == 0:
        return star
    distance, nearest = cKDTree(seen_px).query(xy_px, distance_upper_bound=gate_px)
    back = cKDTree(xy_px).query(seen_px, distance_upper_bound=gate_px)[1]
    for k in np.flatnonzero(np.isfinite(distance)):
        if back[nearest[k]] == k:
            star[k] = nearest[k]
    return star


def fit(lens, u_i, xy_px, size_px, *, gates=GATES, least=4, may_distort=True):
    """Least squares from a proposal, with gates from wide to narrow; None when fewer than `least` match.

    Parameters
    ----------
    lens : Lens
    u_i : (m, 3) stars that may be in the picture
    xy_px : (n, 2) detections
    size_px : (width, height)
    gates : of the diagonal, one a step
    least : int, matches
    may_distort : bool, k1 is fitted, too, if there are stars enough and it is significant

    Returns
    -------
    Fit, or None
    """
    diagonal, start_px = float(np.hypot(*size_px)), lens.focal_px
    star, residual, noise, covariance, distorted = None, None, np.inf, None, False
    last = len(gates) + CONVERGED - 1
    for step in range(last + 1):
        wide = step < len(gates)
        gate = max(gates[step] * diagonal if wide else NOISE_GATE * noise, LEAST_GATE_PX)
        predicted, ideal = project(lens, u_i, size_px)
        inside = np.flatnonzero(((predicted > -1.0) & (predicted < np.asarray(size_px))).all(axis=1))
        star = match(predicted[inside], xy_px, gate)
        known = np.flatnonzero(star >= 0)
        if len(known) < least:
            return None
        star[known] = inside[star[known]]
        residual = np.zeros_like(xy_px)
        residual[known] = xy_px[known] - predicted[star[known]]
        if wide:
            distorted = may_distort and len(known) >= FOR_DISTORTION
        noise = noise_of(residual[known], 5 if distorted else 4)
        change, covariance = step_of(lens, ideal[star[known]], residual[known], noise, distorted)
        if step == last:
            break
        k1 = lens.k1 + change[4] if distorted else 0.0
        if step == len(gates) - 1 and abs(k1) < DISTORTION_SIGMA * np.sqrt(covariance[4, 4]):
            k1, distorted = 0.0, False
        turned = dcm_from_rotvec(change[:3]) @ lens.C_ci
        lens = Lens(turned, lens.focal_px * float(np.exp(change[3])), float(k1))
        if not 0.5 < lens.focal_px / start_px < 2.0:  # no fit, whatever it is
            return None
    sigma_k1 = float(np.sqrt(covariance[4, 4])) if distorted else 0.0
    return Fit(lens, star, residual, noise, float(np.sqrt(covariance[3, 3])), sigma_k1)


def noise_of(residual_px, n_par):
    """Standard deviation per axis from the median of the residuals; few stars, few degrees of freedom."""
    n = len(residual_px)
    median = np.median((residual_px**2).sum(axis=1)) / 1.386  # 2 ln 2: median of chi^2 with 2
    return float(max(np.sqrt(median * 2 * n / max(2 * n - n_par, 1)), LEAST_NOISE_PX))


def step_of(lens, ideal, residual_px, noise_px, distorted):
    """Gauss-Newton step: change of (turn of the stars (3,), ln f, k1) and its covariance (5, 5)."""
    x, y = ideal.T
    radial = 1.0 + lens.k1 * (x * x + y * y)
    J = np.zeros((len(x), 2, 5))
    bend = np.empty((len(x), 2, 2))  # d distorted / d ideal
    bend[:, 0, 0], bend[:, 0, 1] = radial + 2.0 * lens.k1 * x * x, 2.0 * lens.k1 * x * y
    bend[:, 1, 0], bend[:, 1, 1] = bend[:, 0, 1], radial + 2.0 * lens.k1 * y * y
    J[:, :, :3] = bend @ -turn_jacobians(IDEAL, ideal)  # the stars turn against the camera
    J[:, :, 3] = ideal * radial[:, None]
    J[:, :, 4] = ideal * (x * x + y * y)[:, None]
    J *= lens.focal_px
    weight = 1.0 / (1.0 + (residual_px**2).sum(axis=1) / (3.0 * noise_px) ** 2)
    n_par = 5 if distorted else 4
    A, b = J[:, :, :n_par].reshape(-1, n_par), residual_px.ravel()
    w = np.repeat(weight, 2)
    N = A.T @ (w[:, None] * A)
    scale = 1.0 / np.sqrt(np.diag(N))
    inverse = scale[:, None] * np.linalg.pinv(scale[:, None] * N * scale, hermitian=True) * scale
    change, covariance = np.zeros(5), np.zeros((5, 5))
    change[:n_par] = inverse @ (A.T @ (w * b))
    covariance[:n_par, :n_par] = noise_px**2 * inverse
    return change, covariance


def directions(camera, xy_px):
    """Unit vectors of pixels in camera axes. Camera, (n, 2) -> (n, 3)."""
    return unit_vectors(pinhole_of(camera), undistorted(camera, xy_px))
