"""Stars and pairs as the compiled search takes them: plain arrays, small, in the order of use.

In: the stars of the on-board catalogue, its pairs and their k-vector. Out: `Stars`, `Pairs`. The search reads
a few places of these tables for each attitude it looks at; that they fit into the caches of a processor
decides its speed.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.startracker import skygrid


class Stars(NamedTuple):
    """The catalogue by direction; see SkyGrid."""

    u_i: np.ndarray  # (n, 3)
    vmag: np.ndarray  # (n,) ascending
    log_density: np.ndarray
    start: np.ndarray
    row: np.ndarray


class Pairs(NamedTuple):
    """Pairs of catalogue stars by the cosine of their angle."""

    cosine: np.ndarray  # (m,) ascending
    star: np.ndarray  # (m, 2) uint16 rows, brighter and fainter
    fainter: np.ndarray  # (m,) float32 by how many magnitudes
    count: np.ndarray  # of the k-vector, with its slope and intercept
    slope: float
    intercept: float


def build(stars, radius, cosine, first, second, index):
    """(Stars, Pairs) of an OnboardCatalogue.

    Parameters
    ----------
    stars : OnboardCatalogue
    radius : float [rad], within which the direction of the axis finds its stars
    cosine, first, second : (m,) as in StarPairs
    index : KVector of cosine
    """
    grid = skygrid.build(stars.u_i, stars.vmag, radius)
    return (
        Stars(stars.u_i, stars.vmag, grid.log_density, grid.start, grid.row),
        Pairs(
            cosine,
            np.column_stack([first, second]).astype(np.uint16),
            (stars.vmag[second] - stars.vmag[first]).astype(np.float32),
            index.count,
            index.slope,
            index.intercept,
        ),
    )
