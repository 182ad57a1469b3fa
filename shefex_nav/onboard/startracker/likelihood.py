"""Attitude of largest likelihood from centroids with a covariance each, and a test for a bad star.

Wahba's problem knows one weight a star. `sigma_of_centroids` gives the best one of a centroid with a 2x2
covariance; where the covariances are elongated (streaks), `refine` goes on from there to the attitude of
largest likelihood, and `drop_worst` leaves out a star that does not belong.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel, lent
from shefex_nav.geometry import triples as t3
from shefex_nav.geometry.pinhole import turn_slopes
from shefex_nav.geometry.rotation import quat_from_rotvec, quat_multiply, quat_normalise
from shefex_nav.onboard.startracker.attitude import inverse3, product, times

REFINE_STEPS = 10  # bound only: two or three are usual
REFINED = 1e-10  # rad; far below any centroid
UNKNOWNS = 7  # attitude, and what all stars of a frame share: rate, focal length
FOCAL = 6  # its place among them
CHANCE = 3.0  # standard deviations of chi squared that are no misfit


class CommonErrors(NamedTuple):
    """Errors that all n stars of a frame share. None in its place: there are none."""

    t_s: np.ndarray  # (n,) when each star was seen, from the instant to which a rate has brought its place
    P_omega: np.ndarray  # (3, 3) (rad/s)^2, covariance of that rate
    sigma_focal: float  # relative error of the focal length


@kernel
def misfit_factor(chi2, dof, prior_dof):
    """By how much a covariance grows or shrinks with the misfit.

    What was said of the noise counts as an observation of prior_dof degrees of freedom, chi2 as one of dof.
    """
    return (prior_dof + chi2) / (prior_dof + dof)


@inner
def misfit_growth(chi2, dof, prior_dof):
    """By how much a covariance grows with a misfit that chance does not explain; 1 for any smaller one.

    For noise that is predicted: to follow the chance of each frame, as `misfit_factor` does, would make the
    covariance itself noisy and too small for as many errors as too large.
    """
    return max(1.0, misfit_factor(chi2 - CHANCE * np.sqrt(2.0 * dof), dof, prior_dof))


@inner
def sigma_of_centroids(camera, xy_px, P_px):
    """Standard deviation of each direction, per axis, from the covariance of its centroid.

    sigma^2 = trace(J P J') / 2 with J the derivative of the direction: the mean of the two axes across it,
    and the best single weight where the directions of the elongations are not known. Towards the corner a
    pixel is a smaller angle: 1.8 per cent of sigma at 9 degrees.

    Parameters
    ----------
    camera : Pinhole
    xy_px : (n, 2)
    P_px : (n, 2, 2) px^2

    Returns
    -------
    (n,) rad
    """
    sigma = np.empty(xy_px.shape[0])
    f = camera.focal_length_px
    for k in range(xy_px.shape[0]):
        x, y = (xy_px[k, 0] - camera.cx_px) / f, (xy_px[k, 1] - camera.cy_px) / f
        norm2 = 1.0 + x * x + y * y
        # J'J = (I - (x, y)(x, y)' / norm2) / (norm2 f^2)
        along = x * x * P_px[k, 0, 0] + x * y * (P_px[k, 0, 1] + P_px[k, 1, 0]) + y * y * P_px[k, 1, 1]
        trace = (P_px[k, 0, 0] + P_px[k, 1, 1] - along / norm2) / (norm2 * f * f)
        sigma[k] = np.sqrt(0.5 * trace)
    return sigma


@inner
def _observe(camera, q_ic, xy_px, v_i, t_s):
    """Residuals (n, 2) px and their derivatives G (n, 2, 7) by the `UNKNOWNS`; NaN behind the camera.

    A star is seen at u = C_ic' v; how q_ic exp(dtheta) moves it is what `turn_slopes` says. A rate that is
    wrong by domega turns it by t domega, a focal length that is wrong by a part d moves it outwards by d.
    """
    n = xy_px.shape[0]
    residual, G = np.empty((n, 2)), np.empty((n, 2, UNKNOWNS))
    C_ci = t3.transposed(t3.dcm_from_quat(q_ic))
    f = camera.focal_length_px
    for k in range(n):
        X, Y, Z = t3.rotated(C_ci, t3.row(v_i, k))
        x, y = (X / Z, Y / Z) if Z > 0.0 else (np.nan, np.nan)
        residual[k, 0] = xy_px[k, 0] - camera.cx_px - f * x
        residual[k, 1] = xy_px[k, 1] - camera.cy_px - f * y
        dx, dy = turn_slopes(x, y)
        for axis in range(3):
            G[k, 0, axis], G[k, 1, axis] = f * dx[axis], f * dy[axis]
            G[k, 0, 3 + axis], G[k, 1, 3 + axis] = t_s[k] * f * dx[axis], t_s[k] * f * dy[axis]
        G[k, 0, FOCAL], G[k, 1, FOCAL] = f * x, f * y
    return residual, G


@inner
def _inverse2(P):
    """Inverse of a (2, 2) matrix: four numbers, row by row."""
    det = P[0, 0] * P[1, 1] - P[0, 1] * P[1, 0]
    return P[1, 1] / det, -P[0, 1] / det, -P[1, 0] / det, P[0, 0] / det


@inner
def _normal(G, residual, P_px, P_common):
    """Normal equations of the attitude, the errors that all stars share eliminated.

    r_k = H_k dtheta + N_k d + noise of P_px[k], [H N] = G, d of covariance P_common (4, 4). With
    A = sum H'W H, B = sum H'W N, C = sum N'W N the best d is D (sum N'W r - B' dtheta),
    D = (C + P_common^-1)^-1 = P_common (I + C P_common)^-1, which a P_common of zero does not harm.

    Returns
    -------
    P : (7, 7) covariance of dtheta and d
    g : (3,) right side of the attitude: dtheta = P[:3, :3] g
    d : (4,) best d at dtheta = 0
    chi2 : float, at dtheta = 0 and that d
    """
    G, residual, P_px = lent((G, residual, P_px))
    M, b, chi2 = np.zeros((UNKNOWNS, UNKNOWNS)), np.zeros(UNKNOWNS), 0.0
    for k in range(residual.shape[0]):
        W = _inverse2(P_px[k])
        chi2 += _form2(W, residual[k])
        for i in range(UNKNOWNS):
            a0 = G[k, 0, i] * W[0] + G[k, 1, i] * W[2]
            a1 = G[k, 0, i] * W[1] + G[k, 1, i] * W[3]
            b[i] += a0 * residual[k, 0] + a1 * residual[k, 1]
            for j in range(UNKNOWNS):
                M[i, j] += a0 * G[k, 0, j] + a1 * G[k, 1, j]
    D = _shared(M[3:, 3:], P_common)
    BD = product(M[:3, 3:], D)
    P_c = inverse3(M[:3, :3] - product(BD, M[:3, 3:].T))
    P_c_BD = product(P_c, BD)
    P = np.empty((UNKNOWNS, UNKNOWNS))
    P[:3, :3], P[:3, 3:], P[3:, :3], P[3:, 3:] = P_c, -P_c_BD, -P_c_BD.T, D + product(BD.T, P_c_BD)
    d = times(D, b[3:])
    return P, b[:3] - times(M[:3, 3:], d), d, chi2 - (b[3:] * d).sum()


@inner
def _shared(C, P):
    """D = P (I + C P)^-1 of symmetric (4, 4) matrices, of which P may be singular.

    D' = (I + P C)^-1 P by elimination of the columns in turn, the largest remaining element of each first.
    D is symmetric but for rounding, which the mean of the two takes out.
    """
    n = P.shape[0]
    left, right = np.eye(n) + product(P, C), P.copy()
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(left[i, k]) > abs(left[best, k]):
                best = i
        for j in range(n):
            left[k, j], left[best, j] = left[best, j], left[k, j]
            right[k, j], right[best, j] = right[best, j], right[k, j]
        for i in range(n):
            if i != k:
                factor = left[i, k] / left[k, k]
                for j in range(n):
                    left[i, j] -= factor * left[k, j]
                    right[i, j] -= factor * right[k, j]
    for k in range(n):
        for j in range(n):
            right[k, j] /= left[k, k]
    return 0.5 * (right + right.T)


@kernel
def refine(camera, q_ic, xy_px, v_i, P_px, common=None):
    """Attitude of largest likelihood for centroids with covariances of any shape (Gauss-Newton).

    Minimises chi2 = sum r' P^-1 r over the attitude, r the distances [px] from the predicted places. Places
    that were brought to one instant with a rate share its error: it is estimated along, with the prior
    P_omega. With rows exposed one after the other it is mostly a shear, half of which looks like a turn about
    the boresight: taken for independent errors of the stars it would be averaged away. What the calibration
    left of the focal length they share likewise: taken for errors of the stars it would drown what the bright
    ones tell. What it does to the attitude stays the same from frame to frame, as the mounting does, and is
    not in P_c.

    Parameters
    ----------
    camera : Pinhole
    q_ic : (4,) first attitude, e.g. of `esoq2`
    xy_px : (n, 2), n >= 2
    v_i : (n, 3) unit vectors
    P_px : (n, 2, 2) px^2, positive definite, without the errors that are shared
    common : CommonErrors, or None

    Returns
    -------
    q_ic : (4,)
    P_c : (3, 3) rad^2, covariance of the error with q_ic(true) = q_ic exp(dtheta_c)
    chi2 : float, 2 n - 3 degrees of freedom
    """
    errors = _all_common(common, xy_px.shape[0])
    P_common = _covariance(errors)
    P_c, chi2 = np.full((3, 3), np.nan), np.nan
    for _ in range(REFINE_STEPS):
        residual, G = _observe(camera, q_ic, xy_px, v_i, errors.t_s)
        P, g, _, _ = _normal(G, residual, P_px, P_common)
        d = times(P[:3, :3], g)
        P_c = _less_constant(P, errors.sigma_focal)
        q_ic = quat_multiply(q_ic, quat_from_rotvec(d))
        if not d[0] ** 2 + d[1] ** 2 + d[2] ** 2 > REFINED**2:
            break
    residual, G = _observe(camera, q_ic, xy_px, v_i, errors.t_s)
    chi2 = _normal(G, residual, P_px, P_common)[3]
    return quat_normalise(q_ic), P_c, chi2


@inner
def _less_constant(P, sigma_focal):
    """Covariance of the attitude (3, 3) without the share of the focal length, from all of `_normal`.

    The attitude answers to an error of the focal length with w = -P[attitude, FOCAL] / sigma^2, because
    P[attitude, FOCAL] = -P_c B D and, with the prior P_common, D = (I - D C) P_common.
    """
    P_c = P[:3, :3].copy()
    if sigma_focal > 0.0:
        for i in range(3):
            for j in range(3):
                P_c[i, j] -= P[i, FOCAL] * P[j, FOCAL] / sigma_focal**2
    return P_c


@inner
def _all_common(common, n):
    """CommonErrors of n stars, zero where there are none."""
    if common is None:
        return CommonErrors(np.zeros(n), np.zeros((3, 3)), 0.0)
    return common


@inner
def _covariance(errors):
    """Covariance of what all stars share, rate and focal length: (4, 4)."""
    P = np.zeros((UNKNOWNS - 3, UNKNOWNS - 3))
    P[FOCAL - 3, FOCAL - 3] = errors.sigma_focal**2
    P[:3, :3] = errors.P_omega
    return P


@inner
def _form2(W, r):
    """r' W r of a matrix as of `_inverse2` and a (2,) vector."""
    return W[0] * r[0] ** 2 + (W[1] + W[2]) * r[0] * r[1] + W[3] * r[1] ** 2


@inner
def drop_worst(camera, q_ic, xy_px, v_i, P_px, false_alarm, min_stars, common=None):
    """Attitude by `refine`, without the worst star if that one does not belong.

    The distance r of a star from where the OTHERS put it has the covariance P + G P_others G'; with the fit
    of all stars that is r'(P - G P_all G')^-1 r, chi-square of two degrees of freedom if all errors are as P
    says; G and P_all are those of attitude and common errors together. Of n stars the largest is tested, so
    each has false_alarm / n: the limit is 2 ln(n / false_alarm) (Bonferroni), and false_alarm is the
    probability that a star is dropped from a field without a bad one. For one displaced star this is the most
    powerful test (the ratio of likelihoods); how far a star must be off to be found follows from the
    non-central chi-square distribution.

    Parameters
    ----------
    camera, q_ic, xy_px, v_i, P_px, common : as `refine`; n >= 3
    false_alarm : float
    min_stars : int, at least 2; no star is dropped if fewer would remain

    Returns
    -------
    dropped : int, row of the star that was left out, or -1
    q_ic, P_c, chi2 : as `refine`, without that star
    """
    n = xy_px.shape[0]
    errors = _all_common(common, n)
    q_ic, P_c, chi2 = refine(camera, q_ic, xy_px, v_i, P_px, errors)
    if n - 1 < max(min_stars, 2):
        return -1, q_ic, P_c, chi2
    residual, G = _observe(camera, q_ic, xy_px, v_i, errors.t_s)
    P_all, _, d, _ = _normal(G, residual, P_px, _covariance(errors))
    worst, largest = -1, 2.0 * np.log(n / false_alarm)
    for k in range(n):
        rest = residual[k] - times(G[k, :, 3:], d)
        test = _form2(_inverse2(P_px[k] - product(product(G[k], P_all), G[k].T)), rest)
        if test > largest:
            worst, largest = k, test
    if worst < 0:
        return -1, q_ic, P_c, chi2
    rest_of = np.ones(n, dtype=np.bool_)
    rest_of[worst] = False
    left = CommonErrors(errors.t_s[rest_of], errors.P_omega, errors.sigma_focal)
    q_ic, P_c, chi2 = refine(camera, q_ic, xy_px[rest_of], v_i[rest_of], P_px[rest_of], left)
    return worst, q_ic, P_c, chi2
