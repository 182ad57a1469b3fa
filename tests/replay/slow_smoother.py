"""The slow, obvious reference of `smoother`: the modified Bryson-Frazier form, dense, step by step.

The filter runs forward and its steps are kept; then the adjoint lambda (n,), Lambda (n, n) runs backward
from zero and carries what all later measurements say. With the covariance P of the filter at some instant

    error of the filter's estimate = -P lambda,    covariance of the smoothed estimate = P - P Lambda P

No covariance is inverted, and no noise Q is asked for, so states without noise and singular P do no harm.

The filter is a closed-loop one: after each update the estimated error dx moves into the nominal state. This
shifts the origin of the errors, which leaves the adjoint as it is, and for an attitude it turns them,
e(new) = G (e - dx), which the adjoint follows with G^T.

A filter that is linear about a given trajectory (`relinear`) does not move its estimate; there the errors
have a mean m, innovations are those about it, z - H m, and the error is m - P lambda.

References: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973), eqs. of
section 3; Bryson & Ho, Applied Optimal Control, section 13.2. The sign of lambda is Bierman's.
"""

from typing import NamedTuple

import numpy as np


class Adjoint(NamedTuple):
    """What the measurements after an instant say about the errors at it."""

    vector: np.ndarray  # (n,) lambda
    matrix: np.ndarray  # (n, n) Lambda, symmetric


def at_the_end(n):
    """Adjoint at the end of the data, where the smoothed estimate is the filter's. int -> Adjoint"""
    return Adjoint(np.zeros(n), np.zeros((n, n)))


def before_interval(adjoint, Phi):
    """Adjoint at the beginning of an interval, from that at its end.

    Parameters
    ----------
    adjoint : Adjoint
    Phi : (n, n) transition of the errors over the interval
    """
    return Adjoint(Phi.T @ adjoint.vector, Phi.T @ adjoint.matrix @ Phi)


def before_update(adjoint, P, z, H, R, G=None):
    """Adjoint before a measurement, from that after it.

    Parameters
    ----------
    adjoint : Adjoint
    P : (n, n) covariance of the filter before the measurement
    z : (m,) innovation, z = H e + noise of covariance R
    H, R : (m, n), (m, m)
    G : (n, n) how the correction turned the errors; None: it did not
    """
    vector, matrix = adjoint if G is None else before_interval(adjoint, G)
    S_H = np.linalg.solve(H @ P @ H.T + R, np.column_stack([H, z]))  # S^-1 (H, z)
    left = np.eye(len(P)) - P @ H.T @ S_H[:, :-1]  # I - K H
    vector = left.T @ vector - H.T @ S_H[:, -1]
    matrix = left.T @ matrix @ left + H.T @ S_H[:, :-1]
    return Adjoint(vector, 0.5 * (matrix + matrix.T))


def before_forgetting(adjoint, block):
    """Adjoint before the filter forgot a block of errors, from that after it.

    What comes later says nothing about errors that are not the same any more.

    adjoint : Adjoint;  block : slice or index array of the errors that were drawn anew
    """
    vector, matrix = adjoint.vector.copy(), adjoint.matrix.copy()
    vector[block] = 0.0
    matrix[block] = 0.0
    matrix[:, block] = 0.0
    return Adjoint(vector, matrix)


def smoothed(adjoint, P, mean=0.0):
    """Error of the filter's estimate as all data see it, and the covariance of what is left of it.

    Adjoint, (n, n) covariance of the filter at the same instant, mean of its errors -> (n,), (n, n)
    """
    P_s = P - P @ adjoint.matrix @ P
    return mean - P @ adjoint.vector, 0.5 * (P_s + P_s.T)
