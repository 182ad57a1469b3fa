"""The rows that the integration writes, as columns of the record: piece by piece, while they are at hand.

And what a flight tells of its truth, as columns: at the ticks of the on-board clock, and of the control.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S, SAMPLES_PER_TICK, TICK_HZ
from shefex_nav.compiled import kernel
from shefex_nav.records import ControlSample, TruthSample
from shefex_nav.world.flight.dynamics import ROW, STATE
from shefex_nav.world.flight.integrate import Samples

CONTROL_TICKS = 10  # between two records of the attitude control
MOST_LEFT = 0.8  # share of the samples from which on the record is left as it is
AT_ONCE = 4096  # samples of a piece, which stays in the cache of the processor


class Columns(NamedTuple):
    """Arrays over N samples, named as in `records.Trajectory`."""

    r_i: np.ndarray  # (N, 3), as the next ones but q_ib
    v_i: np.ndarray
    q_ib: np.ndarray  # (N, 4)
    omega_ib_b: np.ndarray
    f_b: np.ndarray
    dtheta_b: np.ndarray
    dv_b: np.ndarray
    air: np.ndarray  # (6, N), the last numbers of a row: mass, Mach number, dynamic pressure, thrust, height,
    # total angle of attack


class Memory:
    """Where the arrays of a flight lie; another one may put them elsewhere, `room.Room`."""

    @staticmethod
    def empty(shape):
        """Array of floats, not written."""
        return np.empty(shape)

    @staticmethod
    def part(column):
        """The first rows of such an array, or its first columns, without the place of the rest."""
        return column.copy()

    @staticmethod
    def release():
        """What has been written or read of the arrays need not be at hand."""


MEMORY = Memory()


class Record:
    """The record of a flight on its way: room for n samples, of which sample k is at t_start + k dt."""

    def __init__(self, t_start, dt, n, room=MEMORY):
        self._room = room
        self._samples = Samples(t_start, dt, np.zeros((AT_ONCE, ROW)), None, n)
        threes = (room.empty((n, 3)) for _ in range(6))
        r_i, v_i, omega_b, f_b, dtheta_b, dv_b = threes
        self.columns = Columns(r_i, v_i, room.empty((n, 4)), omega_b, f_b, dtheta_b, dv_b, room.empty((6, n)))

    @property
    def samples(self):
        """Samples that come here; made anew, for a record that held its own method would wait for a search of
        cycles, with all of its arrays."""
        return self._samples._replace(take=self.take)

    def __len__(self):
        return len(self.columns.r_i)

    def take(self, first, rows):
        """Rows (m, ROW) of the samples from `first` on."""
        _write(rows, first, self.columns)
        self._room.release()

    def until(self, k):
        """Columns of the samples before k; few of all are copied, so that the place of the rest is free."""
        *columns, air = self.columns
        found = Columns(*(column[:k] for column in columns), air[:, :k])
        return found if k > MOST_LEFT * len(self) else Columns(*map(self._room.part, found))


@kernel
def _write(rows, first, columns):
    """Write rows (n, `dynamics.ROW`) into Columns from a sample on."""
    r_i, v_i, q_ib, omega_b, f_b, dtheta_b, dv_b, air = columns
    for i in range(rows.shape[0]):
        k = first + i
        for j in range(3):
            r_i[k, j], v_i[k, j], omega_b[k, j] = rows[i, j], rows[i, 3 + j], rows[i, 10 + j]
            dtheta_b[k, j], dv_b[k, j], f_b[k, j] = rows[i, 13 + j], rows[i, 16 + j], rows[i, STATE + j]
        for j in range(4):
            q_ib[k, j] = rows[i, 6 + j]
        for j in range(6):
            air[j, k] = rows[i, STATE + 3 + j]


def truth_of(trajectory, every, last=None):
    """TruthSample of arrays over the ticks every, 2 every ... of a Trajectory. last : tick; None: its last"""
    end = len(trajectory.t_s) if last is None else last * SAMPLES_PER_TICK + 1
    k = np.arange(every * SAMPLES_PER_TICK, end, every * SAMPLES_PER_TICK)
    return TruthSample(
        trajectory.t_s[k],
        trajectory.phase[k].astype(np.int64),
        *(column[k] for column in (trajectory.r_i, trajectory.v_i, trajectory.q_ib)),
        *(column[k] for column in (trajectory.omega_ib_b, trajectory.f_b, trajectory.angle_of_attack)),
    )


def control_samples(control, trajectory):
    """Of every tenth tick that has one, the last sample. ControlHistory or None -> ControlSample, arrays"""
    if control is None or not len(control.t_s):
        return None
    period_s = CONTROL_TICKS / TICK_HZ
    slot = np.ceil((control.t_s - trajectory.t_s[0] - SAME_S) / period_s)
    last = np.flatnonzero(np.diff(slot, append=np.inf))  # of each interval
    columns = control.t_s, control.pointing_error, control.torque_b, control.propellant_kg
    return ControlSample(*(column[last] for column in columns))
