"""Where the inertial sensors alone would have the vehicle: the path of the filter without its corrections.

A receiver that repeats a fix holds a filter that believes it: judged by the corrected path, nothing moves. So
it is judged by the path on which the filter would have gone on from any instant without later corrections,

    r_raw(t) = r(t) - sum of (dr_k + (t - t_k) dv_k),   v_raw(t) = v(t) - sum of dv_k

over the corrections dr_k, dv_k of position and velocity at the instants t_k, inertial axes. Only differences
of it mean something. What gravity changes along a path that is corrected is left out: 1.5e-6/s^2 of a
correction.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.navigation.state import X_R, X_V


class Sums(NamedTuple):
    """Corrections until the end of a tick."""

    number: int  # of the tick
    dr: np.ndarray  # (3,) m, sum of dr_k - t_k dv_k
    dv: np.ndarray  # (3,) m/s


class RawPath:
    """Memory, changed in place; kept as far back as the filter may go back."""

    def __init__(self):
        self.sums = deque([Sums(-1, np.zeros(3), np.zeros(3))])

    def back_to(self, number):
        """The filter goes back to the end of a tick: corrections after it are not made yet."""
        while self.sums[-1].number > number:
            self.sums.pop()

    def corrected(self, number, oldest, t_s, x_before, x_after):
        """The filter has corrected its packed values at t_s in a tick; `oldest`: first it may go back to."""
        last, dv = self.sums[-1], x_after[X_V] - x_before[X_V]
        dr = x_after[X_R] - x_before[X_R] - t_s * dv
        self.sums.append(Sums(number, last.dr + dr, last.dv + dv))
        while self.sums[1].number <= oldest:
            self.sums.popleft()

    def at(self, number, t_s, x):
        """Position (3,) m and velocity (3,) m/s of the raw path at the end of a tick, inertial axes."""
        sums = next((one for one in reversed(self.sums) if one.number <= number), self.sums[0])
        return x[X_R] - sums.dr - t_s * sums.dv, x[X_V] - sums.dv
