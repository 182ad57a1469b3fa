"""How much of what innovations scatter comes from process noise, and so how large that noise is.

Carried along is P_Q, the part of the covariance of the error that process noise has brought in since a start,
under the gains that the filter has used, whatever they were (Joseph's form without the measurement)::

    P_Q <- Phi P_Q Phi^T + Q,    P_Q <- (I - K H) P_Q (I - K H)^T

If the noise is g times as large, in variance, as the filter counts it, an innovation of S = H P H^T + R has

    E[z^T S^-1 z] = m + (g - 1) tr(S^-1 H P_Q H^T)

which solved over many innovations gives g (covariance matching: Myers and Tapley, IEEE TAC 21, 1976, with the
share of the noise under way in the place of its differences). The mean of tr(.)/m is the share of process
noise in the innovations: where it is small, g cannot be told from chance, and that is said.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.navigation import prediction

MORE = 1.01  # for rounding


class Estimate(NamedTuple):
    """What innovations say of the process noise."""

    count: int  # innovations
    share: float  # of process noise in them, mean
    growth: float  # variance of the noise over that which the filter counts
    sigma: float  # standard deviation of `growth`, by the number of innovations


class Share:
    """P_Q and sums over innovations, changed in place.

    number : tick of the History that P_Q belongs to
    """

    def __init__(self, history):
        self.P, self.number = np.zeros_like(history.P), history.newest
        self.begin()

    def begin(self, skip=0):
        """Sum anew, but for the next `skip` innovations: the noise that the filter counts is another."""
        self.skip, self.count, self.rows, self.over, self.by_noise = skip, 0, 0, 0.0, 0.0

    def carry(self, nav, number):
        """On to a tick of the History that is not older than the one reached."""
        history = nav.history
        if number <= self.number or self.number < history.oldest:
            self.number = max(self.number, history.oldest)
            return
        x, xs, Ps = history.xs[self.number % len(history.xs)].copy(), *map(np.empty_like, history.arrays[3:5])
        memory = history.arrays._replace(xs=xs, Ps=Ps, x=x, P=self.P)
        prediction.propagate(nav.constants, memory, self.number + 1, 0.0, number, np.inf)
        self.number = number

    def innovation(self, z, H, S):
        """Take an innovation (m,) with H (m, n), S (m, m) of the instant reached into the sums."""
        if self.skip:
            self.skip -= 1
            return
        solved = np.linalg.solve(S, np.column_stack([z, H @ self.P @ H.T]))
        self.count += 1
        self.rows += len(z)
        self.over += float(z @ solved[:, 0]) - len(z)
        self.by_noise += float(np.trace(solved[:, 1:]))

    def corrected(self, P, H, S):
        """The filter has used a measurement; P (n, n) before it.

        P_Q is a part of P. Where it is more, gains were others than these, as at a reset: it begins anew.
        """
        if (np.diag(self.P) > MORE * np.diag(P)).any():
            self.P[:] = 0.0
            self.begin(self.skip)
        left = np.eye(len(P)) - P @ H.T @ np.linalg.solve(S, H)
        updated = left @ self.P @ left.T
        self.P = 0.5 * (updated + updated.T)  # what rounding leaves of a difference grows by each prediction

    def estimate(self):
        """Estimate, or None before there is anything."""
        if not self.rows or self.by_noise <= 0.0:
            return None
        growth, share = 1.0 + self.over / self.by_noise, self.by_noise / self.rows
        return Estimate(self.count, share, growth, float(np.sqrt(2.0 * self.rows)) / self.by_noise)

    def fade(self):
        """Let the past count half."""
        self.count, self.rows = self.count // 2, self.rows // 2
        self.over, self.by_noise = 0.5 * self.over, 0.5 * self.by_noise
