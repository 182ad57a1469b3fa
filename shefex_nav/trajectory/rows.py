"""What every reader of a trajectory gives: rows in inertial axes, and how finely they are written."""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.elementary import log10
from shefex_nav.scenario.data_table import DataError, Table

FEWEST = 4  # rows
MOST_DIGITS = 12  # after the point
LEAST_SIGNIFICANT, TELLING = 4, 20  # digits, and numbers, by which a number of digits is no chance
CHECKED = 5000  # numbers of a column whose digits are counted, evenly over all of it


class Attitudes(NamedTuple):
    """Attitude at M instants."""

    table: Table
    t_s: np.ndarray  # (M,) mission time
    q_ib: np.ndarray  # (M, 4)
    rounding: float  # rad


class Rows(NamedTuple):
    """A trajectory at N instants."""

    table: Table
    t_s: np.ndarray  # (N,) mission time
    r_i: np.ndarray  # (N, 3) m
    v_i: np.ndarray  # (N, 3) m/s
    a_i: np.ndarray | None  # (N, 3) m/s^2
    rounding_m: float
    rounding_m_s: float
    attitudes: Attitudes | None  # None: it is made along the velocity
    known: object = None  # world.flight.given.KnownPhases of a log
    others: tuple = ()  # (words, v_i (N, 3)) of what the velocities might be otherwise


def ascending(table, t_s):
    """Refuse times that do not grow from row to row, and files with too few rows."""
    back = np.flatnonzero(np.diff(t_s) <= 0.0)
    if len(back):
        row = int(back[0]) + 1
        words = f"time {t_s[row]:.6f} s does not follow on {t_s[row - 1]:.6f} s in the row before"
        raise DataError(f"{table.place(row)}: {words}")
    if len(t_s) < FEWEST:
        raise DataError(f"{table.file}: has {len(t_s)} rows; a trajectory needs {FEWEST} at least")


def rounding(values):
    """Half of the last digit with which numbers are written, 0 if they are written in full.

    (N, k) -> that of the column written most finely: the others may have come out even; of numbers with so
    many significant digits (3.857421e+04) that of the largest. Only numbers that change tell: a vehicle that
    waits at zero says nothing of the digits of its flight.
    """
    changing = [_some(column[_changes(column)]) for column in values.T]
    after_point = min((_half_a_digit(one) for one in changing if len(one)), default=0.0)
    return max(after_point, _half_a_digit_of_largest(np.concatenate([*changing, np.zeros(0)])))


def _changes(column):
    """(N,) bool: numbers that differ from one beside them."""
    steps = np.diff(column) != 0.0
    return np.append(steps, False) | np.append(False, steps)


def _some(column):
    """Up to some CHECKED numbers of a column, evenly over all of it."""
    return column[:: max(1, len(column) // CHECKED)]


def _half_a_digit_of_largest(numbers):
    """Half of the last digit of the largest of numbers (N,) that have as many significant digits; else 0."""
    size = np.abs(numbers[numbers != 0.0])
    if len(size) < TELLING:
        return 0.0
    exponent = np.floor(log10(size))
    after_point = _digits(size)
    significant = _digits(size / 10.0**exponent) + 1
    most, finest = significant.max(), after_point.max()
    if not LEAST_SIGNIFICANT <= most <= MOST_DIGITS or np.mean(significant == most) < 0.5:
        return 0.0
    if finest > 0 and np.mean(after_point == finest) >= 0.5:  # they have as many after the point
        return 0.0
    return 0.5 * 10.0 ** (exponent.max() - most + 1.0)


def _digits(size):
    """(N,) digits after the point that numbers need, MOST_DIGITS where these are not enough."""
    found = np.full(len(size), MOST_DIGITS)
    for digits in reversed(range(MOST_DIGITS)):
        scaled = size * 10.0**digits
        found[np.abs(scaled - np.rint(scaled)) <= 1e-6 + 1e-15 * scaled] = digits
    return found


def _half_a_digit(column):
    for digits in range(MOST_DIGITS):
        scaled = column * 10.0**digits
        if np.max(np.abs(scaled)) > 1e15:
            break
        if np.all(np.abs(scaled - np.rint(scaled)) <= 1e-6 + 4e-16 * np.abs(scaled)):
            return 0.5 * 10.0**-digits
    return 0.0


def clock_rounding(values):
    """Half of the last digit of times (N,), 0 if they are evenly spaced, and so exact."""
    steps = np.diff(values)
    return 0.0 if np.ptp(steps) <= 1e-6 * steps.mean() else _half_a_digit(_some(values))


def moved(v, clock_s):
    """What the rounding of a clock, s, makes of positions: m, by velocities (N, 3) relative to the Earth."""
    return clock_s * float(np.linalg.norm(v, axis=1).max())


def unit_quaternions(table, q):
    """Quaternions (M, 4) of length one; DataError where a row has none."""
    length = np.linalg.norm(q, axis=1)
    bad = np.flatnonzero(np.abs(length - 1.0) > 0.05)
    if len(bad):
        words = f"the quaternion has the length {length[bad[0]]:.4g}; expected one of length 1"
        raise DataError(f"{table.place(int(bad[0]))}: {words}")
    return q / length[:, None]
