"""Stars that can be used each by itself: those of an attitude, or one or two near their predicted places.

In: the identified stars of a solved frame, or the objects of an unsolved one and the navigation's prediction.
Out: `StarVectors`.

With a prediction a single object can be named, but only if it can be nothing else. A star that is not the
only one of the catalogue near its object, whose object is not the only one near it, whose brightness is
another, or near which an object might as well lie by chance, is not named; and stars that are named must be
where ONE attitude within the covariance of the prediction puts them all, or none of them is believed. What
passes is then as sure as the prediction itself, which is why the navigation starts with attitudes, of which
each stands on its own.
"""

import math

import numpy as np

from shefex_nav.environment.stars import aberrate
from shefex_nav.geometry.distortion import farthest_px
from shefex_nav.geometry.elementary import log10
from shefex_nav.geometry.pinhole import cross_covariance, pixels, unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.geometry.streak import turn_jacobians
from shefex_nav.late_packages import special
from shefex_nav.onboard.startracker.best_attitude import with_rate
from shefex_nav.records import NO_STARS, Reason, StarVectors

MISSED = 1e-4  # probability that a star is further from its predicted place than its gate
GATE2 = -2.0 * math.log(MISSED)  # chi-square, 2 degrees of freedom
RIVAL = 2.0  # times the gate: within it there must be no other star, and no other object
CHANCE = 1e-3  # [E] expected number of objects in a gate that are there by chance
UNSOLVED = (Reason.TOO_FEW_STARS, Reason.NO_MATCH, Reason.AMBIGUOUS)  # of which single stars may be used


def vectors(camera, hip, xy_px, P_px, seen_i, rate, sigma_focal):
    """StarVectors of identified stars.

    Parameters
    ----------
    camera : Pinhole, nominal
    hip : (m,)
    xy_px : (m, 2)
    P_px : (m, 2, 2) px^2, covariance of each centroid by itself
    seen_i : (m, 3) apparent directions
    rate : (t_s (m,), P_omega (3, 3)), or None where no rate brought the stars to one instant
    sigma_focal : relative error of the focal length

    Returns
    -------
    StarVectors
    """
    t_s, P_omega = (np.zeros(len(hip)), np.zeros((3, 3))) if rate is None else rate
    return StarVectors(
        np.asarray(hip, dtype=np.int64), unit_vectors(camera, xy_px), cross_covariance(camera, xy_px, P_px),
        seen_i, t_s, P_omega, sigma_focal,
    )  # fmt: skip


def identify(params, stars, detections, P_px, context, rate=None):
    """Name the objects that can only be one star, with the prediction that there is.

    Parameters
    ----------
    params : TrackerParams; camera.zero_flux is that of the frame's exposure, NaN: brightness says nothing
    stars : OnboardCatalogue
    detections : Detections
    P_px : (n, 2, 2) px^2, covariance of each centroid by itself
    context : Context
    rate : as of `vectors`, of all detections

    Returns
    -------
    star : (n,) int64 row of the catalogue, -1 where unnamed
    StarVectors of those that are named
    ambiguous : bool, there were objects near predicted places, but nothing can be said of any of them
    """
    star = np.full(len(detections.xy_px), -1, dtype=np.int64)
    if not len(star) or context.q_ic is None or not np.isfinite(context.q_ic.sum() + context.P_c.sum()):
        return star, NO_STARS, False
    camera = params.camera.pinhole
    rows, seen_i, xy_px = _ahead(params, stars, context)
    H = turn_jacobians(camera, xy_px)
    of_objects = with_rate(params, detections, P_px, rate)
    S = H @ context.P_c @ H.transpose(0, 2, 1) + of_objects[:, None]  # (n, m, 2, 2)
    d = detections.xy_px[:, None] - xy_px
    distance2 = _squared(S, d)
    inside = (distance2 < GATE2) & _bright_as(params, stars.vmag[rows], detections)
    near = distance2 < RIVAL**2 * GATE2
    expected = len(star) / (camera.width_px * camera.height_px) * np.pi * GATE2 * np.sqrt(_det(S))
    sure = inside & (near.sum(0) == 1) & (near.sum(1) == 1)[:, None] & (expected < CHANCE)
    k, s = np.nonzero(sure)
    if not len(k) or not _one_attitude(context.P_c, H[s], d[k, s], P_px[k], _of(rate, k)):
        return star, NO_STARS, bool(inside.any())
    star[k] = rows[s]
    found = vectors(
        camera,
        stars.hip[rows[s]],
        detections.xy_px[k],
        P_px[k],
        np.ascontiguousarray(seen_i[s]),
        _of(rate, k),
        params.camera.focal_length_error,
    )
    return star, found, False


def _ahead(params, stars, context):
    """Stars of the catalogue around the predicted field: rows (m,), apparent directions, places [px]."""
    camera = params.camera.pinhole
    C_ci = dcm_from_quat(context.q_ic).T
    half_px = farthest_px(camera, params.camera.distortion)
    angle = 1.5 * math.atan(half_px / camera.focal_length_px)  # beyond the border, for a wide prior
    rows = np.flatnonzero(stars.u_i @ C_ci[2] > math.cos(angle))
    seen_i = aberrate(stars.u_i[rows], params.velocity_i(context))
    return rows, seen_i, pixels(camera, np.ascontiguousarray(seen_i @ C_ci.T))


def _bright_as(params, vmag, detections):
    """Whether each object is as bright as each star, (n, m); a saturated one may be brighter than seen."""
    tolerance, zero_flux = params.settings.identification.magnitude_tolerance, params.camera.zero_flux
    if not np.isfinite(zero_flux):
        return np.ones((len(detections.flux_dn), len(vmag)), dtype=bool)
    magnitude = -2.5 * log10(detections.flux_dn / zero_flux)
    fainter = magnitude[:, None] - vmag
    saturated = (np.asarray(detections.n_saturated) > 0)[:, None]
    return (fainter > -tolerance) & ((fainter < tolerance) | saturated)


def _one_attitude(P_c, H, d, P_px, rate):
    """Whether the distances (m, 2) px of stars from their predicted places can be one turn of the camera."""
    m = len(d)
    A = H.reshape(2 * m, 3)
    S = A @ P_c @ A.T
    for k in range(m):
        S[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] += P_px[k]
    if rate is not None:
        L = np.repeat(rate[0], 2)[:, None] * A
        S += L @ rate[1] @ L.T
    r = d.ravel()
    return bool(r @ np.linalg.solve(S, r) < special().chdtri(2 * m, MISSED))


def _of(rate, k):
    """The rate of some of the objects."""
    return None if rate is None else (rate[0][k], rate[1])


def _det(S):
    return S[..., 0, 0] * S[..., 1, 1] - S[..., 0, 1] * S[..., 1, 0]


def _squared(S, d):
    """d^T S^-1 d of (..., 2, 2) and (..., 2)."""
    x, y = d[..., 0], d[..., 1]
    return (S[..., 1, 1] * x * x - 2.0 * S[..., 0, 1] * x * y + S[..., 0, 0] * y * y) / _det(S)
