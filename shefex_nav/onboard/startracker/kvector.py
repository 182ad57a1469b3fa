"""k-vector: range search in sorted data without a search (Mortari; SHEFEX-2 star tracker, section 3.4).

A straight line is laid through the sorted values; for each step of the line the table says how many values
lie below it. A range of values is then two divisions and two look-ups, however long the table.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner

EPSILON = 2.3e-16  # relative rounding of float64: the line begins below the first and ends above the last


class KVector(NamedTuple):
    """Index of n sorted values: line z(j) = slope j + intercept, j = 1 ... n."""

    count: np.ndarray  # (n,) int64, count[j - 1] = number of values <= z(j)
    slope: float
    intercept: float


def build(values):
    """Index of ascending values, at least two of them different. (n,) -> KVector."""
    n = len(values)
    xi = EPSILON * max(abs(values[0]), abs(values[-1]))
    slope = (values[-1] - values[0] + 2.0 * xi) / (n - 1)
    intercept = values[0] - slope - xi
    count = np.searchsorted(values, slope * np.arange(1, n + 1) + intercept, side="right")
    count[0], count[-1] = 0, n  # by construction, whatever the rounding of the line
    return KVector(count.astype(np.int64), float(slope), float(intercept))


@inner
def span(count, slope, intercept, values, low, high):
    """Positions of the values within [low, high]: first, last of values[first:last], equal when it is empty.

    The fields of KVector come one by one: compiled code takes plain arrays faster than records.
    """
    n = values.shape[0]
    # clamped before they become integers: a range far outside would overflow
    j_low = np.floor(min(max((low - intercept) / slope, 1.0), float(n)))
    j_high = np.ceil(min(max((high - intercept) / slope, 1.0), float(n)))
    a, b = count[int(j_low) - 1], count[int(j_high) - 1]
    # The line is coarser than the values: trim. The rounding of the division may also have cut one off.
    while a > 0 and values[a - 1] >= low:
        a -= 1
    while a < n and values[a] < low:
        a += 1
    while b < n and values[b] <= high:
        b += 1
    while b > 0 and values[b - 1] > high:
        b -= 1
    return a, max(a, b)
