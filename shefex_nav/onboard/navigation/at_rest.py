"""The noise of the IMU while the vehicle stands still: readings against what was told of them.

Once for each GPS fix at rest the increments of the last `SPAN_S` are summed: white noise of density N^2 makes
N^2 SPAN_S of it, whatever vibrates faster is averaged, and the difference of two sums that follow on each
other knows no bias::

    sum over n differences of |d|^2 / (2 (N^2 SPAN_S + m q^2/12)) ~ chi-square, 3 n degrees of freedom,

nearly: neighbouring differences share a sum, and the limit is taken with two thirds of the degrees of
freedom for that. m samples are each rounded to the
quantum q. Rest is what GPS says: velocities of zero, positions that stay, all within
5 sigma of a fix.
"""

from collections import deque

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.onboard.navigation.integrity_windows import CHANCE
from shefex_nav.onboard.navigation.strapdown import BEFORE

SPAN_S = 0.3  # s before a fix; the memory of the filter holds little more
PAIRS = 8  # differences, at least
LEAST_S = 7.5  # between the first and the last sum: with the fixes before and after 10 s of rest
FAR = 25.0  # squared sigma of a fix
NOTABLE = 1.7  # [E] factor below which nothing is said


class Still:
    """Memory, changed in place."""

    def __init__(self):
        self.fixes = deque(maxlen=64)  # of rest: time, position, its covariance, sums (6,) rad, m/s
        self.limits = {}

    def look(self, history, k, told, fix):
        """Take a GPS fix of tick k that was used in; told : ImuModel.

        The last sum does not count: what moves the vehicle may have begun before the fix that shows it.

        -> factors of the white noise of gyros and accelerometers, 1 where it is right; None: no rest
        """
        if not fix.v_ea_e @ fix.v_ea_e < FAR * np.trace(fix.R_v_e) / 3.0:  # so is a velocity that is none
            self.fixes.clear()
            return None
        if self.fixes and np.any((fix.r_ea_e - self.fixes[0][1]) ** 2 > 2.0 * FAR * np.diag(fix.R_r_e)):
            self.fixes.clear()
        if self.fixes and fix.t_valid_s - self.fixes[-1][0] < SPAN_S:
            return None  # sums must not overlap
        sums = _sums(history, k)
        if sums is None:
            return None
        self.fixes.append((fix.t_valid_s, fix.r_ea_e, sums))
        times = [one[0] for one in self.fixes][:-1]
        if len(times) <= PAIRS or times[-1] - times[0] < LEAST_S:
            return None
        d = np.diff([one[2] for one in self.fixes][:-1], axis=0)
        self.fixes.clear()
        rounded = told.gyro_quantum**2 / 12.0 * SPAN_S / history.numbers[history.place(k), 1]
        gyro = told.gyro_random_walk**2 * SPAN_S + rounded
        return self._factor(d[:, :3], gyro), self._factor(d[:, 3:], told.accel_random_walk**2 * SPAN_S)

    def _factor(self, d, variance):
        """How many times the noise of a triad is what was told; 1 unless it is certainly more."""
        told = 2.0 * variance  # of a difference
        if told <= 0.0:
            return 1.0
        ratio = float((d * d).sum()) / told / d.size
        dof = 2 * d.size // 3
        if dof not in self.limits:
            from scipy.special import chdtri

            self.limits[dof] = float(chdtri(dof, CHANCE)) / dof
        certain = ratio > max(self.limits[dof], NOTABLE**2)
        return float(np.sqrt(ratio)) if certain else 1.0


def _sums(history, last):
    """Increments of the `SPAN_S` before the end of tick `last`: (6,) rad, m/s; None: the memory is shorter."""
    total, covered_s = np.zeros(6), 0.0
    for k in range(last, 0, -1):
        place = history.place(k)
        _, dt_s, n, _ = history.numbers[place].tolist()
        if n == 0:
            return None
        total += history.increments[place, BEFORE : BEFORE + int(n)].sum(axis=0)
        covered_s += n * dt_s
        if covered_s > SPAN_S - SAME_S:
            return total
    return None
