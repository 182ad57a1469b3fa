"""A covariance that was too small all along: all sigmas grow, with their correlations."""

from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.navigation.state import ATT

MOST = 16.0  # largest factor of a standard deviation that was told
WIDEST = 1.0  # rad, most that the sigma of an angle grows to


class Grown(NamedTuple):
    """What a measurement lets the covariance grow by before it is used."""

    factors: np.ndarray  # (n,) of each error


def grown(P, factor, most):
    """Grown by one factor, but for errors that are as large as may be, and for those without ties to others.

    All errors that are tied grow alike: of an attitude and a mounting of which stars have told the sum, the
    sum would look known and each of them, too, if only one grew. Without stars nothing is told of a mounting.

    P : (n, n);  most : (n,) sigma to which an error grows at most; of an angle `WIDEST`
    """
    tied, sigma = (P - np.diag(np.diag(P))).any(axis=1), np.sqrt(np.diag(P))
    tied[: ATT.stop], most = True, most.copy()
    most[ATT] = np.minimum(most[ATT], WIDEST)
    room = np.divide(most, sigma, out=np.ones_like(sigma), where=sigma > 0.0)
    return Grown(np.where(tied, np.clip(room, 1.0, factor), 1.0))
