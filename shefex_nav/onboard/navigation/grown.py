"""A covariance that was too small all along: all sigmas grow, with their correlations."""

from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.navigation.state import ATT

WIDEST = 1.0  # rad, most that the sigma of an angle grows to


class Grown(NamedTuple):
    """What a measurement lets the covariance grow by before it is used."""

    factors: np.ndarray  # (n,) of each error


def grown(P, factor):
    """Grown by one factor, but for angles that are hardly known, and for errors without ties to others.

    All errors that are tied grow alike: of an attitude and a mounting of which stars have told the sum, the
    sum would look known and each of them, too, if only one grew. Without stars nothing is told of a mounting.

    P : (n, n)
    """
    tied = (P - np.diag(np.diag(P))).any(axis=1)
    factors, sigma = np.where(tied, factor, 1.0), np.sqrt(np.diag(P)[ATT])
    factors[: ATT.stop] = factor
    factors[ATT] = np.maximum(np.minimum(factor, WIDEST / sigma), 1.0)
    return Grown(factors)
