"""Real time: every tick of the software on board begins when a clock says so, and its answers are timed.

Nothing but the clock differs: the software gets the same ticks and gives the same answers as without. A tick
that begins late, because a picture was drawn or the answer before came late, does not shift those after it.
"""

import time
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import TICK_HZ

SLOWEST = 1e-3  # [E] mission time over real time: ten minutes take a week


class RealTime(NamedTuple):
    """How well a flight has kept its pace."""

    pace: float  # mission time over real time that was asked for
    ticks: int
    mission_s: float  # from the begin of the first tick to the end of the last one
    elapsed_s: float  # likewise, of the clock
    begin_late_s: dict  # median, p99, max: ticks that begin later than they should
    answer_s: dict  # likewise: from the begin of a tick to the answer, without the drawing of pictures
    late_answers: int  # ticks whose answer took longer than a tick lasts


class Pace:
    """The clock of one flight.

    pace : mission time over real time, above 0
    clock, sleep : as of the module time, s
    """

    def __init__(self, pace, clock=time.perf_counter, sleep=time.sleep):
        self.pace = pace
        self._clock, self._sleep = clock, sleep
        self._period_s = 1.0 / (TICK_HZ * pace)
        self._software = self._first_s = self._last_s = None
        self._late_s, self._answer_s = [], []

    def around(self, software):
        """A `driving.Software` that flies `software` with this clock."""
        self._software = software
        return self

    def advance(self, blocks, first, _last):
        """As of `driving.Software`: one tick, when it is due."""
        now_s = self._clock()
        if self._first_s is None:
            self._first_s = now_s
        due_s = self._first_s + len(self._late_s) * self._period_s
        while now_s < due_s:
            self._sleep(due_s - now_s)
            now_s = self._clock()
        self._late_s.append(now_s - due_s)
        made = self._software.advance(blocks, first, first + 1)
        self._answer_s.append(self._clock() - now_s)
        return made

    def update(self, arrived):
        """As of `driving.Software`."""
        began_s = self._clock()
        outputs = self._software.update(arrived)
        self._last_s = self._clock()
        self._answer_s[-1] += self._last_s - began_s
        return outputs

    def close(self):
        """As of `driving.Software`."""
        self._software.close()

    def real_time(self):
        """RealTime of the ticks so far; None before the first."""
        if self._last_s is None:
            return None
        return RealTime(
            pace=self.pace,
            ticks=len(self._late_s),
            mission_s=len(self._late_s) / TICK_HZ,
            elapsed_s=max(self._last_s, self._first_s + len(self._late_s) * self._period_s) - self._first_s,
            begin_late_s=_spread(self._late_s),
            answer_s=_spread(self._answer_s),
            late_answers=int(np.sum(np.array(self._answer_s) > self._period_s)),
        )


def _spread(values):
    """Median, 99th percentile and largest of some values."""
    median, p99 = np.percentile(values, [50.0, 99.0]).tolist()
    return {"median": median, "p99": p99, "max": float(max(values))}
