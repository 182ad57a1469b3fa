"""Attitude of largest likelihood from centroids with a covariance each, and a test for a bad star.

Wahba's problem knows one weight a star. `sigma_of_centroids` gives the best one of a centroid with a 2x2
covariance; where the covariances are elongated (streaks), `refine` goes on from there to the attitude of
largest likelihood, and `drop_worst` leaves out a star that does not belong.
"""

import numpy as np
from numba import njit

from shefex_nav.geometry.pinhole import turn_slopes
from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_rotvec, quat_multiply, quat_normalise
from shefex_nav.onboard.startracker.attitude import inverse3

REFINE_STEPS = 10  # bound only: two or three are usual
REFINED = 1e-10  # rad; far below any centroid


@njit(cache=True)
def misfit_factor(chi2, dof, prior_dof):
    """By how much a covariance grows or shrinks with the misfit.

    What was said of the noise counts as an observation of prior_dof degrees of freedom, chi2 as one of dof.
    """
    return (prior_dof + chi2) / (prior_dof + dof)


@njit(cache=True)
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


@njit(cache=True)
def _observe(camera, q_ic, xy_px, v_i):
    """Residuals (n, 2) px and their derivatives (n, 2, 3) by the rotation dtheta_c; NaN behind the camera.

    A star is seen at u = C_ic' v; how q_ic exp(dtheta) moves it is what `turn_slopes` says.
    """
    n = xy_px.shape[0]
    residual, H = np.empty((n, 2)), np.empty((n, 2, 3))
    C = dcm_from_quat(q_ic)
    f = camera.focal_length_px
    for k in range(n):
        X = C[0, 0] * v_i[k, 0] + C[1, 0] * v_i[k, 1] + C[2, 0] * v_i[k, 2]
        Y = C[0, 1] * v_i[k, 0] + C[1, 1] * v_i[k, 1] + C[2, 1] * v_i[k, 2]
        Z = C[0, 2] * v_i[k, 0] + C[1, 2] * v_i[k, 1] + C[2, 2] * v_i[k, 2]
        x, y = (X / Z, Y / Z) if Z > 0.0 else (np.nan, np.nan)
        residual[k, 0] = xy_px[k, 0] - camera.cx_px - f * x
        residual[k, 1] = xy_px[k, 1] - camera.cy_px - f * y
        dx, dy = turn_slopes(x, y)
        for axis in range(3):
            H[k, 0, axis], H[k, 1, axis] = f * dx[axis], f * dy[axis]
    return residual, H


@njit(cache=True)
def _inverse2(P):
    """Inverse of a (2, 2) matrix."""
    out = np.empty((2, 2))
    det = P[0, 0] * P[1, 1] - P[0, 1] * P[1, 0]
    out[0, 0], out[0, 1], out[1, 0], out[1, 1] = P[1, 1] / det, -P[0, 1] / det, -P[1, 0] / det, P[0, 0] / det
    return out


@njit(cache=True)
def _normal(H, residual, P_px, t_s, P_omega):
    """Normal equations of the attitude, the common error of the rate eliminated.

    r_k = H_k (dtheta + t_k domega) + noise of P_px[k], domega of covariance P_omega. With
    A = sum H'W H, B = sum t H'W H, C = sum t^2 H'W H the best domega is D (sum t H'W r - B' dtheta),
    D = (C + P_omega^-1)^-1 = P_omega (I + C P_omega)^-1, which a P_omega of zero does not harm.

    Returns
    -------
    P_c (3, 3), g (3,) right side, B (3, 3), D (3, 3), c (3,) = sum t H'W r, chi2 at dtheta = 0
    """
    A, B, C = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    g, c, chi2 = np.zeros(3), np.zeros(3), 0.0
    for k in range(residual.shape[0]):
        W, t = _inverse2(P_px[k]), t_s[k]
        chi2 += _form2(W, residual[k])
        for i in range(3):
            a0 = H[k, 0, i] * W[0, 0] + H[k, 1, i] * W[1, 0]
            a1 = H[k, 0, i] * W[0, 1] + H[k, 1, i] * W[1, 1]
            right = a0 * residual[k, 0] + a1 * residual[k, 1]
            g[i] += right
            c[i] += t * right
            for j in range(3):
                both = a0 * H[k, 0, j] + a1 * H[k, 1, j]
                A[i, j] += both
                B[i, j] += t * both
                C[i, j] += t * t * both
    D = P_omega @ inverse3(np.eye(3) + C @ P_omega)
    Dc = D @ c
    return inverse3(A - B @ D @ B.T), g - B @ Dc, B, D, c, chi2 - c @ Dc


@njit(cache=True)
def refine(camera, q_ic, xy_px, v_i, P_px, t_s=None, P_omega=None):
    """Attitude of largest likelihood for centroids with covariances of any shape (Gauss-Newton).

    Minimises chi2 = sum r' P^-1 r over the attitude, r the distances [px] from the predicted places. Places
    that were brought to one instant with a rate share its error: it is estimated along, with the prior
    P_omega. With rows exposed one after the other it is mostly a shear, half of which looks like a turn about
    the boresight: taken for independent errors of the stars it would be averaged away.

    Parameters
    ----------
    camera : Pinhole
    q_ic : (4,) first attitude, e.g. of `esoq2`
    xy_px : (n, 2), n >= 2
    v_i : (n, 3) unit vectors
    P_px : (n, 2, 2) px^2, positive definite, without the error of the rate
    t_s : (n,) when each star was seen, from the instant; None: no rate was used
    P_omega : (3, 3) (rad/s)^2, covariance of the rate; None likewise

    Returns
    -------
    q_ic : (4,)
    P_c : (3, 3) rad^2, covariance of the error with q_ic(true) = q_ic exp(dtheta_c)
    chi2 : float, 2 n - 3 degrees of freedom
    """
    t, P_rate = _rate_of(t_s, P_omega, xy_px.shape[0])
    P_c, chi2 = np.full((3, 3), np.nan), np.nan
    for _ in range(REFINE_STEPS):
        residual, H = _observe(camera, q_ic, xy_px, v_i)
        P_c, g, _, _, _, _ = _normal(H, residual, P_px, t, P_rate)
        d = P_c @ g
        q_ic = quat_multiply(q_ic, quat_from_rotvec(d))
        if not d[0] ** 2 + d[1] ** 2 + d[2] ** 2 > REFINED**2:
            break
    residual, H = _observe(camera, q_ic, xy_px, v_i)
    chi2 = _normal(H, residual, P_px, t, P_rate)[5]
    return quat_normalise(q_ic), P_c, chi2


@njit(cache=True)
def _rate_of(t_s, P_omega, n):
    """Times and covariance of the rate as arrays; zeros where there is none."""
    if t_s is None or P_omega is None:
        return np.zeros(n), np.zeros((3, 3))
    return t_s, P_omega


@njit(cache=True)
def _form2(W, r):
    """r' W r of a (2, 2) matrix and a (2,) vector."""
    return W[0, 0] * r[0] ** 2 + (W[0, 1] + W[1, 0]) * r[0] * r[1] + W[1, 1] * r[1] ** 2


@njit(cache=True)
def drop_worst(camera, q_ic, xy_px, v_i, P_px, false_alarm, min_stars, t_s=None, P_omega=None):
    """Attitude by `refine`, without the worst star if that one does not belong.

    The distance r of a star from where the OTHERS put it has the covariance P + H P_others H'; with the fit
    of all stars that is r'(P - H P_c H')^-1 r, chi-square of two degrees of freedom if all errors are as P
    says; H and P_c are those of attitude and rate together. Of n stars the largest is tested, so each has
    false_alarm / n: the limit is 2 ln(n / false_alarm) (Bonferroni), and false_alarm is the probability that
    a star is dropped from a field without a bad one. For one displaced star this is the most powerful test
    (the ratio of likelihoods); how far a star must be off to be found follows from the non-central chi-square
    distribution.

    Parameters
    ----------
    camera, q_ic, xy_px, v_i, P_px, t_s, P_omega : as `refine`; n >= 3
    false_alarm : float
    min_stars : int, at least 2; no star is dropped if fewer would remain

    Returns
    -------
    dropped : int, row of the star that was left out, or -1
    q_ic, P_c, chi2 : as `refine`, without that star
    """
    n = xy_px.shape[0]
    t, P_rate = _rate_of(t_s, P_omega, n)
    q_ic, P_c, chi2 = refine(camera, q_ic, xy_px, v_i, P_px, t, P_rate)
    if n - 1 < max(min_stars, 2):
        return -1, q_ic, P_c, chi2
    residual, H = _observe(camera, q_ic, xy_px, v_i)
    _, _, B, D, c, _ = _normal(H, residual, P_px, t, P_rate)
    omega = D @ c  # at the best attitude the best error of the rate
    P_cross = -P_c @ B @ D  # of attitude and rate
    P_rest = D + D @ B.T @ P_c @ B @ D
    worst, largest = -1, 2.0 * np.log(n / false_alarm)
    for k in range(n):
        known = P_c + t[k] * (P_cross + P_cross.T) + t[k] * t[k] * P_rest
        test = _form2(_inverse2(P_px[k] - H[k] @ known @ H[k].T), residual[k] - t[k] * (H[k] @ omega))
        if test > largest:
            worst, largest = k, test
    if worst < 0:
        return -1, q_ic, P_c, chi2
    rest = np.ones(n, dtype=np.bool_)
    rest[worst] = False
    q_ic, P_c, chi2 = refine(camera, q_ic, xy_px[rest], v_i[rest], P_px[rest], t[rest], P_rate)
    return worst, q_ic, P_c, chi2
