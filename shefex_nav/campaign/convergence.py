"""How an estimate settles with the number of runs, and how many more a wanted precision takes."""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import tolerance
from shefex_nav.campaign.statistics import percentile
from shefex_nav.report import intervals

STEPS = 40  # numbers of runs at which an estimate is shown


class Course(NamedTuple):
    """An estimate after the first n runs, for M values of n."""

    n: np.ndarray  # (M,)
    value: np.ndarray  # (M,)
    low: np.ndarray  # (M,) of its 95 % interval; NaN where the sample is too small for that end
    high: np.ndarray  # (M,)


class Needed(NamedTuple):
    """What a precision takes."""

    half_width: float  # of the 95 % interval now; infinite where the sample is too small for it
    wanted: float
    total: int  # runs that give it, if the next ones are like those that are there
    still: int  # more than there are


def success_course(passed):
    """Course of a success rate after the first n of the runs. (N,) bool"""
    k, at = np.cumsum(passed), _steps(len(passed))
    ends = np.array([intervals.proportion(int(k[n - 1]), int(n)) for n in at])
    return Course(at, k[at - 1] / at, ends[:, 0], ends[:, 1])


def percentile_course(values, percent):
    """Course of a percentile after the first n of the values. (N,), float"""
    at = _steps(len(values))
    rows = [percentile(values[:n], percent) for n in at]
    columns = [[math.nan if x is None else x for x in (row.value, row.low, row.high)] for row in rows]
    return Course(at, *np.array(columns).T)


def _steps(n):
    """Numbers of runs up to n, evenly by their logarithm: (M,)."""
    return np.unique(np.round(np.geomspace(1, n, min(STEPS, n))).astype(int))


def needed_for_rate(passed, of, wanted):
    """Runs for a success rate to +- wanted (0.01: one point): Needed.

    The number is sought for which the interval at the rate found so far is that narrow.
    """
    _check(wanted, of)
    rate, now = passed / of, _half(passed / of, of)
    total = tolerance.first(lambda n: _half(rate, n) <= wanted, 0)
    return Needed(now, wanted, total, max(total - of, 0))


def _half(rate, n):
    """Half the width of the interval of a rate after n runs."""
    low, high = intervals.proportion(round(rate * n), n)
    return 0.5 * (high - low)


def needed_for_percentile(now, n, wanted):
    """Runs for a percentile to +- wanted, in its unit: Needed.

    The interval shrinks with the square root of the number, and never exists below the number whose extremes
    enclose the percentile.

    now : statistics.Percentile;  n : values that it comes from;  wanted : float
    """
    _check(wanted, n)
    least = intervals.values_needed(now.percent)
    if now.low is None or now.high is None:
        return Needed(math.inf, wanted, least, max(least - n, 1))
    half = 0.5 * (now.high - now.low)
    total = max(least, math.ceil(n * (half / wanted) ** 2))
    return Needed(half, wanted, total, max(total - n, 0))


def _check(wanted, n):
    if not wanted > 0.0 or n < 1:
        raise ValueError(f"expected a precision greater than zero and at least one run, got {wanted}, {n}")
