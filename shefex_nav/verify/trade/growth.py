"""How errors grow along one flight, and what its fixes measure, computed once for all that is tried on it.

Transition and noise of an interval are linear in what differs from one set of instruments to another: a
source of errors is a state with a column of its own whatever its size, and white noise adds up by kind. So
the samples of the IMU are gone through once. Noise of the counts goes with the square of the rate, which
counts with its mean over a piece; but for that the numbers are those of `bound`.
"""

import numpy as np

from shefex_nav.clock import sample_s
from shefex_nav.verify import bound, bound_model, linear
from shefex_nav.verify.bound_model import N_NAV

PIECE_S = 0.5  # of which longer intervals are put together
MOST_UPDATES = 20_000  # that are kept


class Growth:
    """Intervals and updates of one flight under one vibration. flight : bound.Flight, any that flies it"""

    def __init__(self, flight):
        self._dt_s = sample_s(flight.trajectory.t_s)
        self._piece = round(PIECE_S / self._dt_s)
        self._layout = bound_model.sources(flight.imu, flight.camera, 0.0, np.inf)
        self._pieces, self._intervals, self._updates = {}, {}, {}

    def of(self, flight, layout):
        """OneOf of them. bound.Flight, bound_model.Layout"""
        return OneOf(self, flight, layout)

    def interval(self, flight, before, end):
        """X (9, n), Q (4, 9, 9), path of `_joined` over the samples after `before` up to `end`."""
        if (before, end) not in self._intervals:
            self._intervals[before, end] = self._joined(flight, before, end)
        return self._intervals[before, end]

    def update(self, make, flight, layout, k, fix):
        """linear.Update of a fix at sample k, by a function of `bound` that makes it."""
        quanta = flight.imu.gyro.quantum, flight.imu.accelerometer.quantum  # which are noise of a fix
        key = id(fix), layout.n, *quanta
        if key not in self._updates:
            if len(self._updates) >= MOST_UPDATES:
                self._updates.clear()
            self._updates[key] = make(flight, layout, self._dt_s, k, fix), fix  # which keeps its id alive
        return self._updates[key][0]

    def _joined(self, flight, before, end):
        """X (9, n), Q (4, 9, 9) of a unit of each white noise, path over the Earth: piece by piece."""
        grid = np.arange(before // self._piece + 1, (end - 1) // self._piece + 1) * self._piece
        X, units = np.eye(N_NAV, self._layout.n), np.zeros((4, N_NAV, N_NAV))
        for first, last in zip((before, *grid.tolist()), (*grid.tolist(), end), strict=True):
            if (first, last) not in self._pieces:
                self._pieces[first, last] = self._made(flight, first, last)
            after, added = self._pieces[first, last]
            A = after[:, :N_NAV]
            X = A @ X
            X[:, N_NAV:] += after[:, N_NAV:]
            units = A @ units @ A.T + added
        return X, units, bound.path_over_earth(flight, before, end)

    def _made(self, flight, before, end):
        """X (9, n) of `bound_model.spread`, Q (4, 9, 9), of one piece."""
        samples = bound.samples(flight, self._layout, self._dt_s, before, end)
        walks = np.full((end - before, 2), self._dt_s)
        X, (by_gyro, by_accelerometer) = bound_model.spread(
            self._layout, samples._replace(walks=walks), self._dt_s
        )
        counted = bound.remainders(flight.trajectory, before, end).mean() / self._dt_s
        return X, np.array([by_gyro, counted * by_gyro, by_accelerometer, counted * by_accelerometer])


class OneOf:
    """Intervals and updates for one set of instruments. growth : Growth of the flight that they fly"""

    def __init__(self, growth, flight, layout):
        gyro, accelerometer = flight.imu.gyro, flight.imu.accelerometer
        sizes = gyro.random_walk, gyro.quantum, accelerometer.random_walk, accelerometer.quantum
        self._growth, self._flight, self._layout = growth, flight, layout
        self._dt_s, self._variances = sample_s(flight.trajectory.t_s), np.square(sizes)
        self._fading = bound_model.fading(layout)

    def interval(self, before, end):
        """linear.DrivenInterval over the samples after `before` up to `end`."""
        X, units, path = self._growth.interval(self._flight, before, end)
        Q = (self._variances @ units.reshape(len(units), -1)).reshape(N_NAV, N_NAV)
        if X.shape[1] < self._layout.n:  # errors of other instruments do not move the navigation
            X = np.hstack([X, np.zeros((N_NAV, self._layout.n - X.shape[1]))])
        faded = self._fading.over(self._dt_s * (end - before), path)
        return linear.DrivenInterval(float(self._flight.trajectory.t_s[end]), X, Q, *faded)

    def update(self, make, k, fix):
        """linear.Update of a fix at sample k, by a function of `bound` that makes it."""
        return self._growth.update(make, self._flight, self._layout, k, fix)
