"""The covariance engine: prediction and update of the error state through filterpy.

The nominal state carries the estimate, so the error state is zero before every update (Sola,
arXiv:1711.02508, section 6). filterpy's KalmanFilter is used with F, Q, H, R given with every call; its
update is the Joseph form. It does not keep P symmetric, which is done here.
"""

import numpy as np
from numba import njit

from shefex_nav.onboard.navigation.state import ATT, N_ERROR, correct, right_jacobian


def engine():
    """filterpy.kalman.KalmanFilter for the 21 errors; its contents do not outlive a call of this module."""
    from filterpy.kalman import KalmanFilter  # takes seconds to import, so not with the package

    return KalmanFilter(dim_x=N_ERROR, dim_z=3)


def predict(kalman, P, Phi, Q):
    """Covariance after an interval: Phi P Phi^T + Q, (21, 21)."""
    kalman.P = P
    kalman.predict(F=Phi, Q=Q)
    return _symmetrise(kalman.P)


@njit(cache=True)
def _symmetrise(P):
    """P <- (P + P^T)/2, in place."""
    for i in range(P.shape[0]):
        for j in range(i):
            P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
    return P


def innovation_statistics(P, z, H, R):
    """Normalised innovation squared z^T (H P H^T + R)^-1 z."""
    return float(z @ np.linalg.solve(H @ P @ H.T + R, z))


def update(kalman, state, P, z, H, R):
    """Nominal state and covariance after a measurement.

    After the estimated error is taken into the nominal state, the attitude error refers to new body axes:
    exp(new) = exp(-dtheta) exp(dtheta + e), so P <- G P G^T with G = Jr(dtheta) for the attitude.

    Returns
    -------
    state : NavState
    P : (21, 21)
    """
    kalman.P = P
    kalman.x = np.zeros((N_ERROR, 1))
    kalman.update(z.reshape(-1, 1), R=R, H=H)
    dx = kalman.x[:, 0]
    kalman.x = np.zeros((N_ERROR, 1))
    G = right_jacobian(np.ascontiguousarray(dx[ATT]))
    P = _symmetrise(kalman.P)
    P[ATT] = G @ P[ATT]
    P[:, ATT] = P[:, ATT] @ G.T
    return correct(state, dx), P


def forget(P, block, sigma):
    """Covariance in which nothing is known of one block of errors any more, nor its ties to others.

    P : (21, 21);  block : slice of `state`;  sigma : standard deviation given to each axis.
    """
    P = P.copy()
    P[block] = 0.0
    P[:, block] = 0.0
    P[block, block] = sigma**2 * np.eye(3)
    return P
