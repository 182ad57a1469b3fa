"""What the computer tells of its ticks, NavSolution and NavCovariance: each as a record, or all as columns.

A log takes the records as they come about. Who wants the figures of a mission alone has no use for a record
a tick: `Columns` writes them as rows of two tables, at a lower rate, and reads them once, at the end. What is
told does not change what the computer does.
"""

import numpy as np

from shefex_nav.onboard.navigation import covariance, solution

COVARIANCE_TICKS = 10  # NavCovariance at every tenth tick
_FIRST_ROWS = 1024  # of a table, which doubles when they are used up


class Records:
    """Each NavSolution and each NavCovariance is handed over as it comes about."""

    def now(self, nav, tick):
        """Of the tick that the filter has reached, number `tick` of the run: list of records."""
        told = [solution.solution(nav)]
        if tick % COVARIANCE_TICKS == 0:
            told.append(covariance.covariance(nav))
        return told

    def passed(self, nav, first, last, imu_blind):
        """Of the ticks after `first` and before `last` of the run, the one that the filter has reached.

        imu_blind : as `Watch.imu_blind`, at all of them; nothing else may have arrived at them
        -> list of (tick, list of records)
        """
        later = nav.history.newest - last  # numbers of the history, beyond those of the run
        ticks = range(first + 1, last)
        said = solution.solutions(nav, range(later + first + 1, later + last), imu_blind) if ticks else []
        return [
            (tick, [one, covariance.covariance(nav, later + tick)] if tick % COVARIANCE_TICKS == 0 else [one])
            for tick, one in zip(ticks, said, strict=True)
        ]


class Columns:
    """All is kept, and nothing handed over until the end.

    every : int, ticks from one NavSolution that is kept to the next; NavCovariance comes as always
    """

    def __init__(self, every):
        self.every = every
        self._solutions, self._covariances, self._layout = _Table(solution.WIDTH), None, None

    def now(self, nav, tick):
        """Keep what there is of a tick, as `Records.now`. -> nothing to hand over"""
        self._keep(nav, tick - 1, tick + 1, nav.history.newest - tick, nav.watch.imu_blind)
        return []

    def passed(self, nav, first, last, imu_blind):
        """Keep what there is of ticks, as `Records.passed`. -> nothing to hand over"""
        if last - first > 1:
            self._keep(nav, first, last, nav.history.newest - last, imu_blind)
        return []

    def _keep(self, nav, first, last, later, imu_blind):
        """Rows of the ticks after `first` and before `last`, which the history counts `later` higher."""
        if ticks := _among(first, last, self.every, later):
            solution.fill(nav, ticks, imu_blind, self._solutions.more(len(ticks)))
        if ticks := _among(first, last, COVARIANCE_TICKS, later):
            if self._layout is None:
                self._layout, self._covariances = nav.layout, _Table(covariance.width(nav.layout))
            covariance.fill(nav, ticks, self._covariances.more(len(ticks)))

    def solutions(self, first, last):
        """NavSolution of arrays of the ticks after first up to last that have been kept, and these ticks."""
        filled = self._solutions.filled[first // self.every : last // self.every]
        return solution.columns(filled), (first // self.every + 1 + np.arange(len(filled))) * self.every

    def covariances(self, first, last):
        """As `solutions`, NavCovariance; None where none has been kept yet."""
        if self._layout is None:
            return None
        filled = self._covariances.filled[first // COVARIANCE_TICKS : last // COVARIANCE_TICKS]
        ticks = (first // COVARIANCE_TICKS + 1 + np.arange(len(filled))) * COVARIANCE_TICKS
        return covariance.columns(self._layout, filled), ticks

    def read(self):
        """NavSolution and NavCovariance of arrays, of all that has been kept: list."""
        told = [solution.columns(self._solutions.filled)]
        if self._layout is not None:
            told.append(covariance.columns(self._layout, self._covariances.filled))
        return told


class Nothing:
    """Nothing is told."""

    def now(self, nav, tick):
        """As `Records.now`."""
        return []

    def passed(self, nav, first, last, imu_blind):
        """As `Records.passed`."""
        return []


RECORDS, NOTHING = Records(), Nothing()


def _among(first, last, every, later):
    """Multiples of `every` after `first` and before `last`, all `later` higher: range."""
    return range(later + (first // every + 1) * every, later + last, every)


class _Table:
    """Rows of numbers, one after the other."""

    def __init__(self, width):
        self._rows, self._n = np.empty((_FIRST_ROWS, width)), 0

    def more(self, count):
        """The next `count` rows, to be written."""
        if self._n + count > len(self._rows):
            self._rows = np.concatenate(
                [self._rows, np.empty((count + len(self._rows), self._rows.shape[1]))]
            )
        self._n += count
        return self._rows[self._n - count : self._n]

    @property
    def filled(self):
        """The rows that have been written."""
        return self._rows[: self._n]
