"""Windows over the innovations of a sensor: are they too large, and do they hang together?

Innovations of a filter whose model is right are white and as large as it says. With w = L^-1 z, S = L L^T,
over the last n of them, d numbers each, three statistics say what is wrong::

    size        sum |w_k|^2                                ~ chi-square, n d degrees of freedom
    run         |sum w_k|^2 / n                            ~ chi-square, d degrees of freedom
    neighbours  sum w_k . w_(k-1) / sum |w_k|^2  times sqrt(n d)   ~ normal

Too large and hanging together: what comes between two measurements, process noise, is larger than the filter
believes, so its gain is too low and what it misses is there again in the next innovation. Too large and
white: the noise of the measurement itself. A gain that is too high makes neighbours of opposite sign.
A run of one sign shows where every innovation is small against its S, which an error that lasts has made
large.

R. K. Mehra, On the identification of variances and adaptive Kalman filtering, IEEE TAC 15 (1970); Bar-Shalom,
Li, Kirubarajan, Estimation with applications to tracking and navigation (2001), section 5.4.

Each statistic is tested at `CHANCE`. A flight has some 2000 innovations, two windows and two statistics that
may raise an alarm: fewer than one alarm in 1e5 flights whose model is right.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import sums
from shefex_nav.onboard.navigation.integrity import Innovations, chi_square_limit

LENGTHS = (20, 60)  # [E] innovations
CHANCE = 1e-9  # of exceeding a limit, per innovation, window and statistic
TOGETHER = 3.0  # sigma: neighbours hang together
WHITE = 2.0  # sigma: they do not


class Finding(NamedTuple):
    """What a window says of its innovations."""

    large: bool  # they are too large
    process: bool  # they are too large and hang together, or all on one side
    sensor: bool  # they are too large and white
    excess: float  # mean normalised innovation squared over its degrees of freedom: 1 is right
    full: bool  # whether the longest window is


QUIET = Finding(False, False, False, 1.0, False)


def neighbours(w):
    """How far whitened innovations (n, d) hang together, in sigmas of white ones."""
    return float((w[1:] * w[:-1]).sum()) / float((w * w).sum()) * np.sqrt(w.size)


@kernel
def _statistics(w):
    """Size, run and neighbours of the module's text. (n, d), contiguous -> three numbers"""
    n, d = w.shape
    total, squares, products = np.zeros(d), np.empty(n * d), np.empty(n * d - d)
    for k in range(n):
        for i in range(d):
            total[i] += w[k, i]
            squares[k * d + i] = w[k, i] * w[k, i]
            if k > 0:
                products[k * d - d + i] = w[k, i] * w[k - 1, i]
    size = sums.pairwise(squares)
    return size, (total @ total) / n, sums.pairwise(products) / size * np.sqrt(n * d)


class Window(Innovations):
    """Innovations of one sensor, judged over `LENGTHS`."""

    def __init__(self):
        super().__init__(LENGTHS[-1])

    def take(self, w):
        """Take a whitened innovation (d,) in. -> Finding"""
        self.add(w)
        found = QUIET
        for n in LENGTHS:
            if self.n >= n:
                one = self._judged(n, n == LENGTHS[-1])
                found = one._replace(large=found.large or one.large, process=found.process or one.process)
        return found

    def _judged(self, n, longest):
        """Finding of the last n innovations; only the longest window tells white ones from others."""
        d = self.kept.shape[1]
        size, run, near = _statistics(self.last(n))
        large, excess = size > chi_square_limit(CHANCE, n * d), size / (n * d)
        process = large and near > TOGETHER
        one_sided = run > chi_square_limit(CHANCE, d) and near > TOGETHER
        return Finding(large, process or one_sided, longest and large and near < WHITE, excess, longest)
