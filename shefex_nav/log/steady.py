"""What a flight tells at every tick, as columns: truth, control, IMU, solution and covariance.

They grow while it flies, and whoever writes a log takes what is new. A flight passes on all other records one
by one; the place of each says between which rows of the columns it belongs, so that all of them together have
one order:

    of each tick, what happens in it: an Event; truth; control; IMU; what arrives, and what the software makes
    of it; solution; covariance; how long the search of a picture took
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.records import ControlSample, ImuBlock, NavCovariance, NavSolution, TruthSample

EVENTS, ARRIVED, MEASURED = 0, 4, 7  # order within a tick, of records
_ORDER = {TruthSample: 1, ControlSample: 2, ImuBlock: 3, NavSolution: 5, NavCovariance: 6}  # of columns
PLACES = 8  # of a tick


class Reached(NamedTuple):
    """A flight has come to the end of a tick: the columns have it. In no log."""

    t_s: float
    phase: int  # Phase


class Steady:
    """Columns of a flight on its way.

    known : list of (record of arrays, (N,) ticks at which its rows come), what is known beforehand
    told : navigator.Columns, which gets the rest
    place : of the record that the flight passes on; it counts PLACES to a tick
    """

    def __init__(self, known, told):
        self.told, self.place = told, 0
        self._known = [(arrays, PLACES * ticks + _ORDER[type(arrays)]) for arrays, ticks in known]
        self._taken = 0  # the place before which everything has been taken

    def at(self, tick, order):
        """The flight passes on records of a tick: EVENTS, ARRIVED or MEASURED."""
        self.place = PLACES * tick + order

    def take(self):
        """What is new: list of (record of arrays over n, (n,) places)."""
        new, since, self._taken = [], self._taken, self.place
        for arrays, places in self._known:
            begin, end = np.searchsorted(places, [since, self.place])
            new.append((_part(arrays, begin, end), places[begin:end]))
        for kind, told in ((NavSolution, self.told.solutions), (NavCovariance, self.told.covariances)):
            # ticks whose place is not before `since`, and before the one that has been reached
            first, last = ((place - 1 - _ORDER[kind]) // PLACES for place in (since, self.place))
            if (found := told(max(first, 0), max(last, 0))) is not None:
                arrays, ticks = found
                new.append((arrays, PLACES * ticks + _ORDER[kind]))
        return [(arrays, places) for arrays, places in new if len(places)]

    def read(self):
        """Everything until now: list of records of arrays. Without solutions where another software flies."""
        known = [_part(arrays, 0, np.searchsorted(places, self.place)) for arrays, places in self._known]
        return known + [one for one in self.told.read() if len(one.t_s)]


def _part(arrays, begin, end):
    """Rows of a record of arrays."""
    return type(arrays)(*(np.ascontiguousarray(column[begin:end]) for column in arrays))
