"""What of a filter's run stands at its end: samples, trajectory, and the measurements that were believed.

The filter works with delays; once nothing can change a tick any more it leaves the filter's memory, and is
kept here. The instants at which anything is known, ends of ticks and of measurements between them, are the
nodes of the smoother (`nodes`), and between two of them lies an interval.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.onboard.navigation import prediction
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.fusion import UNUSED
from shefex_nav.onboard.navigation.history import History
from shefex_nav.onboard.navigation.integrity_drift import Followed
from shefex_nav.onboard.navigation.state import X_Q


class Keeping(History):
    """A filter's memory that keeps what leaves it, in the order in which it came: see `Final`."""

    def __init__(self, tick, driving=0, used_s=None):
        super().__init__(tick, driving, used_s)
        self._pieces, self._measurements = [], []

    def forget_until(self, t_s):
        """As `History`; what is let go is final."""
        count = 0
        while count + 1 < len(self.ends_s) and self.ends_s[count + 1] <= t_s:
            count += 1
        self._keep(count)
        super().forget_until(t_s)

    def _keep(self, count):
        """Keep the oldest ticks."""
        if count:
            places = [self.place(k) for k in range(count)]
            arrays = self.numbers, self.increments, self.extra, self.xs, self.drives
            self._pieces.append([array[places] for array in arrays])
            self._measurements.extend(self.measurements[k] for k in range(count))

    def final(self):
        """All ticks, those too that later measurements might have changed: `Final`. To be called once."""
        self._keep(len(self.ends_s))
        samples = max(piece[1].shape[1] for piece in self._pieces)
        columns = list(zip(*self._pieces, strict=True))
        increments = np.zeros((sum(map(len, columns[1])), samples, 6))
        at = 0
        for piece in columns[1]:
            increments[at : at + len(piece), : piece.shape[1]] = piece
            at += len(piece)
        numbers, extra, xs, drives = (np.concatenate(columns[k]) for k in (0, 2, 3, 4))
        return Final(numbers, increments, extra, xs, self._measurements, drives)


class Final(NamedTuple):
    """Ticks 0 (the start, without samples) to N of a filter's run."""

    numbers: np.ndarray  # (N + 1, 7) as of a History
    increments: np.ndarray  # (N + 1, 2 + samples, 6)
    extra: np.ndarray  # (N + 1, 2, 3)
    xs: np.ndarray  # (N + 1, X) packed values at the ends of the ticks, all measurements taken in
    measurements: list  # of tuples of sensors.Measurement, those valid within each tick
    drives: np.ndarray  # (N + 1, 6, m)


class Whole(History):
    """A History of all ticks of a Final, for `Moment`; states and covariances are not in it."""

    def __init__(self, final, P):
        self.numbers, self.increments, self.extra = final.numbers, final.increments, final.extra
        self.drives = final.drives
        self.ends_s = final.numbers[:, 0].tolist()
        self.measurements, self.oldest, self.newest = final.measurements, 0, len(self.ends_s) - 1
        self.x, self.P, self.used_s = final.xs[0].copy(), P.copy(), {}
        self.corrections = None  # nothing is judged again


class UsedMeasurement(NamedTuple):
    """A measurement that was believed, or doubted, at a node."""

    tick: int
    at_s: float  # s from the start of the tick
    measurement: object  # sensors.Measurement
    x_then: np.ndarray  # (X,) packed values that the filter had before the tick, carried to the instant


class Nodes(NamedTuple):
    """Nodes 0 ... m, of which 0 is the start, and the m intervals that end in nodes 1 ... m."""

    ticks: np.ndarray  # (m,) in which an interval lies
    parts_s: np.ndarray  # (m, 2) its beginning and end, s from the start of the tick
    ends: np.ndarray  # (N + 1,) node at the end of each tick
    seen: dict  # node -> list of UsedMeasurement, in their order
    xs: np.ndarray  # (m + 1, X) packed values of the filter


def nodes(nav, final, layout):
    """Nodes of a Final.

    Parameters
    ----------
    nav : fusion.Filter that was run
    final : Final
    layout : of what is smoothed; other errors of sensors are nothing in `xs`

    Returns
    -------
    Nodes
    """
    whole = Whole(final, nav.history.P)
    ticks, parts, ends, seen, between = [], [], [0], {}, {}
    for k in range(1, len(whole.ends_s)):
        length_s, begin_s, x = whole.length_s(k), 0.0, None
        for one in final.measurements[k]:
            if one.fate in UNUSED:
                continue
            at_s = whole.since(k, begin_s, one.fix.t_valid_s)
            x = final.xs[k - 1] if x is None else x
            if at_s > begin_s:
                x = _carried(nav, whole, k, x, begin_s, at_s)
                ticks.append(k)
                parts.append((begin_s, at_s))
                if at_s < length_s:
                    between[len(ticks)] = x
                begin_s = at_s
            seen.setdefault(len(ticks), []).append(UsedMeasurement(k, at_s, _admitted(one, nav, layout), x))
        if begin_s < length_s - SAME_S:
            ticks.append(k)
            parts.append((begin_s, length_s))
        ends.append(len(ticks))
    xs = np.empty((len(ticks) + 1, final.xs.shape[1]))
    xs[ends] = final.xs
    for node, x in between.items():
        xs[node] = x
    unknown = np.setdiff1d(np.arange(X_Q.stop, xs.shape[1]), layout.nominal)
    xs[:, unknown] = 0.0
    return Nodes(np.array(ticks), np.array(parts), np.array(ends), seen, xs)


def _admitted(measurement, nav, layout):
    """A sensors.Measurement for errors in the order of `layout`: what it lets grow has that of the filter."""
    if not isinstance(measurement.admitted, Grown | Followed):
        return measurement
    return measurement._replace(admitted=measurement.admitted.into(nav.layout, layout))


def _carried(nav, whole, k, x, begin_s, end_s):
    """Packed values x, carried over a part of tick k."""
    imu, nothing = whole.imu(k), np.zeros_like(nav.history.P)
    t_s = imu.t_end_s - imu.length_s + begin_s
    return prediction.advance(nav.constants, x, t_s, nothing, imu, begin_s, end_s)[0]
