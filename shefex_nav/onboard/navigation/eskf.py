"""The measurement update of the error state through filterpy, and what goes with it.

The nominal state carries the estimate, so the error state is zero before every update (Sola,
arXiv:1711.02508, section 6). filterpy's KalmanFilter is used with H, R given with every call; its update is
the Joseph form. It does not keep P symmetric, which is done here. The prediction is compiled together with
the strapdown (`prediction`), and held against filterpy's in the tests.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.late_packages import late
from shefex_nav.onboard.navigation.state import ATT, corrected, rearranged, right_jacobian

FEW = 3  # numbers of an innovation, up to which one compiled call is faster than those of NumPy


def engine(layout):
    """filterpy.kalman.KalmanFilter for the errors; its contents do not outlive a call of this module."""
    late("filterpy")
    late("filterpy.stats", later=["logpdf"])  # of likelihoods, for which it imports scipy.stats
    late("filterpy.common", "helpers")
    late("filterpy.kalman", "kalman_filter")
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=layout.n, dim_z=3)
    kalman.inv = _inverse  # of S; filterpy's own call takes longer than its arithmetic
    kalman.no_error = np.zeros((layout.n, 1))  # what `update_packed` begins with
    return kalman


@kernel
def _inverse(S):
    """Inverse of the covariance of an innovation."""
    return np.linalg.inv(S)


@inner
def _symmetrise(P):
    """P <- (P + P^T)/2, in place."""
    for i in range(P.shape[0]):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
    return P


@kernel
def innovation(P, z, H, R):
    """Covariance S = H P H^T + R of an innovation, and its normalised square z^T S^-1 z.

    P : (n, n);  z, H, R : (m,), (m, n), (m, m) -> (m, m), float
    """
    m, n = H.shape
    S, row = np.empty((m, m)), np.empty(n)
    for i in range(m):
        row[:] = 0.0
        for k in range(n):
            if H[i, k] != 0.0:
                for j in range(n):
                    row[j] += H[i, k] * P[k, j]
        for j in range(i + 1):
            total = R[i, j]
            for k in range(n):
                total += row[k] * H[j, k]
            S[i, j] = S[j, i] = total
    return S, normalised(S, z)


@kernel
def normalised(S, z):
    """z^T S^-1 z by the Cholesky factor of S. (m, m), (m,)"""
    m, total = len(z), 0.0
    L, w = np.empty((m, m)), np.empty(m)
    for i in range(m):
        for j in range(i + 1):
            rest = S[i, j]
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            L[i, j] = np.sqrt(rest) if i == j else rest / L[j, j]
        rest = z[i]
        for k in range(i):
            rest -= L[i, k] * w[k]
        w[i] = rest / L[i, i]
        total += w[i] * w[i]
    return total


def weighed(z, R, S):
    """An innovation held against its covariance S = L L^T.

    z : (m,);  R, S : (m, m), R the noise of its sensor
    -> w = L^-1 z (m,), independent, of variance 1 where S is right; share of the sensor's own noise in S
    """
    if len(z) <= FEW:
        return _weighed(z, R, S)
    return np.linalg.solve(np.linalg.cholesky(S), z), float(np.trace(np.linalg.solve(S, R))) / len(R)


@kernel
def _weighed(z, R, S):
    """`weighed` of a few numbers, for which the calls of NumPy take longer than their arithmetic."""
    m, total = len(z), 0.0
    L = np.zeros((m, m))
    for j in range(m):
        square = 0.0
        for k in range(j):
            square += L[j, k] * L[j, k]
        L[j, j] = np.sqrt(S[j, j] - square)
        for i in range(j + 1, m):
            along = 0.0
            for k in range(j):
                along += L[i, k] * L[j, k]
            L[i, j] = (S[i, j] - along) * (1.0 / L[j, j])
    share = np.linalg.solve(S, R)
    for i in range(m):
        total += share[i, i]
    return np.linalg.solve(L, z), total / m


def take_all(dx, P, updated):
    """All of an estimated error is taken."""
    return updated


def update_packed(kalman, layout, P, measured, x, P_after, share=take_all, turns=True):
    """Nominal state and covariance after a measurement.

    After the estimated error is taken into the nominal state, the attitude error refers to new body axes:
    exp(new) = exp(-dtheta) exp(dtheta + e), so P <- G P G^T with G = Jr(dtheta) for the attitude.

    Not after a fix of the attitude. Stars say exp(z) = exp(e) exp(m), e the attitude's error, m the camera's.
    Linear at e = 0 that is e = z - m, whose turned error is -G m; but what is left after the correction is
    exp(-z) exp(e) = exp(-m). With G, the next fixes would seem to tell e from m by the angle of G, which they
    cannot.

    Parameters
    ----------
    kalman : `engine`
    layout : Layout
    P : (n, n)
    measured : z, H, R, (m,), (m, n), (m, m)
    x : (X,) packed nominal values, changed in place
    P_after : (n, n) is written
    share : (dx, P, updated) -> covariance after a share of dx, which it changes in place, is taken
    turns : False after a fix of the attitude: G is the identity

    Returns
    -------
    dx : (n,) the estimated error that was taken into the state
    G : (3, 3) by which the attitude error was turned into the new body axes
    """
    z, H, R = measured
    kalman.P = P
    kalman.x = kalman.no_error
    kalman.update(z.reshape(-1, 1), R=R, H=H)
    dx = kalman.x[:, 0]
    return dx, take_in(x, dx, layout.nominal, share(dx, P, kalman.P), P_after, turns)


@inner
def partly(dx, P, updated, share):
    """Covariance if only a share of the estimated error of the attitude is taken; dx in place.

    share : (3,). The covariance is that of the gain which is left (Brink, JGCD 40 (2017), partial update)
    """
    n = len(dx)
    left, spare, out = np.zeros(n), np.zeros(n), np.empty((n, n))
    for k in range(3):
        dx[ATT.start + k] *= share[k]
        left[ATT.start + k] = 1.0 - share[k]
        spare[ATT.start + k] = np.sqrt(2.0 * share[k] * (1.0 - share[k]))
    for i in range(n):
        for j in range(n):
            taken = left[i] * left[j] + spare[i] * spare[j]
            out[i, j] = updated[i, j] + taken * (P[i, j] - updated[i, j])
    return out


def take_in(x, dx, nominal, updated, P_after, turns=True):
    """The rest of `update_packed`, once the estimated error and the updated covariance are there. -> G"""
    G = np.eye(3)
    _take_in(x, dx, nominal, updated, P_after, G, turns)
    return G


@kernel
def _take_in(x, dx, nominal, updated, P, G, turns):
    """Estimated error into the nominal state; P from the updated covariance, symmetric, in new body axes."""
    x[:] = corrected(x, dx, nominal)
    P[:] = updated
    _symmetrise(P)
    if not turns:
        return
    G[:] = right_jacobian(dx[ATT])
    turned = G @ P[ATT]
    P[ATT] = turned
    P[:, ATT] = turned.T
    P[ATT, ATT] = np.ascontiguousarray(turned[:, ATT]) @ G.T


def forget(P, block, covariance):
    """Covariance in which nothing is known of one block of errors any more, nor its ties to others.

    P : (n, n);  block : slice of k errors;  covariance : (k, k), or a number for k variances.
    """
    P = P.copy()
    P[block] = 0.0
    P[:, block] = 0.0
    P[block, block] = np.eye(block.stop - block.start) * covariance if np.isscalar(covariance) else covariance
    return P


# ----------------------------------------------------------------------------------------------------------
# A covariance that was too small all along: all sigmas grow.


MOST_GROWN = 16.0  # largest factor of a standard deviation that was told
WIDEST_GROWN = 1.0  # rad, most that the sigma of an angle grows to


class Grown(NamedTuple):
    """What a measurement lets the covariance grow by before it is used."""

    factors: np.ndarray  # (n,) of each error, 1 or more

    def of(self, P):
        """The covariance (n, n) that has grown.

        Errors that grow alike keep their correlation. Of two that do not, both grow together as far as the
        lesser, and the rest of the other is an error of its own: P_ij min(f_i, f_j)^2. If the correlation
        stayed, an attitude that grew three times would look like the work of a scale factor that did not
        grow, and the first star fix would correct that.
        """
        square = self.factors**2
        return P * np.minimum.outer(square, square)

    def into(self, own, other):
        """The same for the errors of another Layout; those that it has alone do not grow."""
        return Grown(rearranged(self.factors, own, other, 1.0))


def grown(P, factor, most):
    """Grown by one factor, but for errors that are as large as may be, and for those without ties to others.

    A mounting before the first star has no ties: nothing was learnt of it.

    P : (n, n);  most : (n,) sigma to which an error grows at most; of an angle `WIDEST_GROWN`
    """
    tied, sigma = (P - np.diag(np.diag(P))).any(axis=1), np.sqrt(np.diag(P))
    tied[: ATT.stop], most = True, most.copy()
    most[ATT] = np.minimum(most[ATT], WIDEST_GROWN)
    room = np.divide(most, sigma, out=np.ones_like(sigma), where=sigma > 0.0)
    return Grown(np.where(tied, np.clip(room, 1.0, factor), 1.0))
