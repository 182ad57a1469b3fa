"""What shows that noise is larger than told: windows of innovations, the share of process noise, rest.

**Windows** over the innovations of a sensor: are they too large, and do they hang together? Innovations of a
filter whose model is right are white and as large as it says. With w = L^-1 z, S = L L^T, over the last n of
them, d numbers each, three statistics say what is wrong::

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

from collections import deque
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import kernel
from shefex_nav.geometry import sums
from shefex_nav.onboard.navigation import momentary, prediction
from shefex_nav.onboard.navigation.integrity import Innovations, chi_square_limit
from shefex_nav.onboard.navigation.strapdown import BEFORE

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


# ----------------------------------------------------------------------------------------------------------
# How much of what innovations scatter comes from process noise, and so how large that noise is.
#
# Carried along is P_Q, the part of the covariance of the error that process noise has brought in since a
# start, under the gains that the filter has used, whatever they were (Joseph's form without the
# measurement)::
#
#     P_Q <- Phi P_Q Phi^T + Q,    P_Q <- (I - K H) P_Q (I - K H)^T
#
# If the noise is g times as large, in variance, as the filter counts it, an innovation of S = H P H^T + R has
#
#     E[z^T S^-1 z] = m + (g - 1) tr(S^-1 H P_Q H^T)
#
# which solved over many innovations gives g (covariance matching: Myers and Tapley, IEEE TAC 21, 1976, with
# the share of the noise under way in the place of its differences). The mean of tr(.)/m is the share of
# process noise in the innovations: where it is small, g cannot be told from chance, and that is said.


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


# ----------------------------------------------------------------------------------------------------------
# The noise of the IMU while the vehicle stands still: readings against what was told of them.
#
# When a GPS fix has arrived, the increments of the last two spans of `SPAN_S` are summed. White noise of
# density N^2 makes N^2 SPAN_S of each, and the difference d of the two knows no bias. An error of the moment
# (`momentary`: vibration swings and comes back, counts carry their remainder on) of s rms has a part in each
# end of the two spans, twice in the one between them, 6 s^2 in all::
#
#     sum over n fixes of |d|^2 / (2 (N^2 SPAN_S + 3 s^2)) ~ chi-square, 3 n degrees of freedom
#
# The vibration is the one that was told without a motor. The sums of a swing do not grow with their span as
# those of noise do: the span is as long as the memory of the filter allows, and what is less than `SHAKEN`
# times the variance that was told is left to a swing that was not. One that turns where it stands, or is
# moved once, does not scatter as noise does (`_is_noise`). Rest is what GPS says: velocities of zero and
# positions that stay, all within 5 sigma of a fix, and gyros that show no turn; at the fix after as well:
# what moves the vehicle begins before the fix that shows it.


SPAN_S, SUMS = 0.3, 2  # s, in all what the memory of the filter has
FIXES = 8  # at rest, at least
LEAST_S = 6.5  # between the first and the last of them: 10 s of rest have as many, a second apart
FAR = 25.0  # squared sigma of a fix
SHAKEN = 3.6  # [E]
TURNS = np.radians(1.0)  # rad/s [E], of a vehicle that does not stand still; and 3 sigma of the bias
LEAST_WHITE = 0.4  # [E] of the variance side by side over that of all, or its inverse
JOLT = 0.5  # [E] share of one difference in all of them


class Still:
    """Memory, changed in place."""

    def __init__(self):
        self.fixes = deque(maxlen=64)  # of rest: time, position, sums (SUMS, 6) rad, m/s

    def look(self, history, params, fix):
        """Take a GPS fix that was used in. history : History;  params : NavParams;  fix : GpsFix

        -> factors of the white noise of gyros and accelerometers, 1 where it is right; None: no rest
        """
        if not fix.v_ea_e @ fix.v_ea_e < FAR * np.trace(fix.R_v_e) / 3.0:  # so is a velocity that is none
            self.fixes.clear()
            return None
        if self.fixes and np.any((fix.r_ea_e - self.fixes[0][1]) ** 2 > 2.0 * FAR * np.diag(fix.R_r_e)):
            self.fixes.clear()
        now_s = history.ends_s[-1]
        if self.fixes and now_s - self.fixes[-1][0] < SUMS * SPAN_S - SAME_S:
            return None  # sums must not overlap
        sums = _sums(history)
        if sums is None:
            return None
        if (sums[:, :3] ** 2).sum(axis=1).max() > ((TURNS + 3.0 * params.sigma_gyro_bias) * SPAN_S) ** 2:
            self.fixes.clear()  # it stands still, and turns
            return None
        self.fixes.append((now_s, fix.r_ea_e, sums))
        if len(self.fixes) <= FIXES or self.fixes[-2][0] - self.fixes[0][0] < LEAST_S:
            return None
        found = np.array([one[2] for one in self.fixes][:-1])
        self.fixes.clear()
        told, (velocity2, attitude2) = params.imu, momentary.variances(momentary.of(params), 0.0)
        return (
            self._factor(found[:, :, :3], told.gyro_random_walk, 3.0 * attitude2),
            self._factor(found[:, :, 3:], told.accel_random_walk, 3.0 * velocity2),
        )

    def _factor(self, sums, walk, other):
        """How many times the noise of a triad is what was told; 1 unless it is certainly more.

        sums : (n, SUMS, 3);  walk : sqrt of the density;  other : variance by rounding and swing
        """
        if walk <= 0.0:
            return 1.0
        d, white = sums[:, 1] - sums[:, 0], walk**2 * SPAN_S
        variance, dof = 0.5 * float((d * d).mean()), d.size
        if not _is_noise(sums, d, variance):
            return 1.0
        if variance < max(chi_square_limit(CHANCE, dof) / dof, SHAKEN) * (white + other):
            return 1.0
        return float(np.sqrt((variance - other) / white))


def _is_noise(sums, d, variance):
    """Whether sums scatter as noise does, as much a second apart as side by side, and with no single jolt.

    sums : (n, SUMS, 3);  d : (n, 3) differences side by side, of which `variance` is half the mean square
    """
    if variance <= 0.0:
        return False
    apart = float(sums.reshape(-1, 3).var(axis=0, ddof=1).mean())
    jolt = float((d * d).sum(axis=1).max()) / float((d * d).sum())
    return LEAST_WHITE * apart < variance < apart / LEAST_WHITE and jolt < JOLT


def _sums(history):
    """Increments of the last spans, oldest first: (SUMS, 6) rad, m/s; None: the memory is shorter.

    A span is whole ticks, and as near to `SPAN_S` as they allow.
    """
    total, covered_s, span = np.zeros((SUMS, 6)), 0.0, SUMS - 1
    for k in range(len(history) - 1, 0, -1):
        place = history.place(k)
        _, dt_s, n = history.numbers[place, :3].tolist()
        if n == 0:
            return None
        total[span] += history.increments[place, BEFORE : BEFORE + int(n)].sum(axis=0)
        covered_s += n * dt_s
        if covered_s > (SUMS - span) * SPAN_S - 0.5 * n * dt_s:
            if span == 0:
                return total
            span -= 1
    return None
