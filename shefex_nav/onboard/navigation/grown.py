"""A covariance that was too small all along: all sigmas grow, with their correlations."""

from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.navigation.state import ATT

MOST = 16.0  # largest factor of a standard deviation that was told
WIDEST = 1.0  # rad, most that the sigma of an angle grows to
ONE = 0.9  # [E] correlation of an attitude and a mounting from which on stars have told their sum


class Grown(NamedTuple):
    """What a measurement lets the covariance grow by before it is used."""

    factors: np.ndarray  # (n,) of each error


def grown(P, factor, most, mounting=None):
    """Grown by one factor, but for errors that are as large as may be, and for those without ties to others.

    All errors that are tied grow alike: of an attitude and a mounting of which stars have told the sum, the
    sum would look known and each of them, too, if only one grew. So both grow by what the mounting may: its
    error is that of the attitude. Without stars nothing is told of a mounting.

    P : (n, n);  most : (n,) sigma to which an error grows at most; of an angle `WIDEST`
    mounting : slice of its error, None if it is no state
    """
    tied, sigma = (P - np.diag(np.diag(P))).any(axis=1), np.sqrt(np.diag(P))
    tied[: ATT.stop], most = True, most.copy()
    most[ATT] = np.minimum(most[ATT], WIDEST)
    room = np.divide(most, sigma, out=np.ones_like(sigma), where=sigma > 0.0)
    factors = np.where(tied, np.clip(room, 1.0, factor), 1.0)
    if mounting is not None:
        one = np.abs(np.diag(P[ATT, mounting])) > ONE * sigma[ATT] * sigma[mounting]
        least = np.minimum(factors[ATT], factors[mounting])
        factors[ATT] = np.where(one, least, factors[ATT])
        factors[mounting] = np.where(one, least, factors[mounting])
    return Grown(factors)
