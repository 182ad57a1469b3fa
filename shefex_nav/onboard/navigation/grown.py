"""A covariance that was too small all along: all sigmas grow."""

from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.navigation.state import ATT, rearranged

MOST = 16.0  # largest factor of a standard deviation that was told
WIDEST = 1.0  # rad, most that the sigma of an angle grows to


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

    P : (n, n);  most : (n,) sigma to which an error grows at most; of an angle `WIDEST`
    """
    tied, sigma = (P - np.diag(np.diag(P))).any(axis=1), np.sqrt(np.diag(P))
    tied[: ATT.stop], most = True, most.copy()
    most[ATT] = np.minimum(most[ATT], WIDEST)
    room = np.divide(most, sigma, out=np.ones_like(sigma), where=sigma > 0.0)
    return Grown(np.where(tied, np.clip(room, 1.0, factor), 1.0))
