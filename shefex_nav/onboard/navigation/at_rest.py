"""The noise of the IMU while the vehicle stands still: readings against what was told of them.

When a GPS fix has arrived, the increments of the last two spans of `SPAN_S` are summed. White noise of
density N^2 makes N^2 SPAN_S of each, and the difference d of the two knows no bias. An error of the moment
(`momentary`: vibration swings and comes back, counts carry their remainder on) of s rms has a part in each
end of the two spans, twice in the one between them, 6 s^2 in all::

    sum over n fixes of |d|^2 / (2 (N^2 SPAN_S + 3 s^2)) ~ chi-square, 3 n degrees of freedom

The vibration is the one that was told without a motor. The sums of a swing do not grow with their span as
those of noise do: the span is as long as the memory of the filter allows, and what is less than `SHAKEN`
times the variance that was told is left to a swing that was not. One that turns where it stands, or is moved
once, does not scatter as noise does (`_is_noise`). Rest is what GPS says: velocities of zero and positions
that stay, all within 5 sigma of a fix, and gyros that show no turn; at the fix after as well: what moves the
vehicle begins before the fix that shows it.
"""

from collections import deque

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.onboard.navigation import momentary
from shefex_nav.onboard.navigation.integrity import chi_square_limit
from shefex_nav.onboard.navigation.integrity_windows import CHANCE
from shefex_nav.onboard.navigation.strapdown import BEFORE

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
