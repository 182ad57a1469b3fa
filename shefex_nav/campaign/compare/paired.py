"""Two samples of the same seeds: their difference, how certain it is, and what may be said of it.

Of a figure: mean of the differences B - A of the pairs, with Student's interval over the pairs. Of what
happened or did not (a requirement met, a run failed): difference of the shares, with the interval of Bonett
and Price. Its verdict is McNemar's exact test over the pairs in which it happened to one of the two alone; of
few pairs that is stricter than the interval. Neither draws random numbers. The confidence of each interval is
95 %: of twenty rows without a difference, one shows one by chance.

Fewer than FEW pairs have no verdict: Student's interval of two or three needs differences of a normal law,
and of five pairs all have one sign by chance in 2 of 2^5.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.report import intervals

ROUNDING = 1e-12  # of the figures: a smaller difference is the order in which one has been summed
CONFIDENCE = intervals.CONFIDENCE
A_BETTER, B_BETTER, NOT_SEEN = -1, 1, 0  # verdicts; None: there is no interval
NOT_JUDGED = 2  # verdict where the difference is not that of the two sides alone
EQUAL = 3  # verdict of an interval without zero that is nowhere as large as NEGLIGIBLE
OPEN = 4  # verdict of pairs that differ and are too few
FEW = 6
NEGLIGIBLE = 1e-3  # of the larger of the two means: certain, and of no use to anybody


class Sample(NamedTuple):
    """A figure over the runs of one side that are paired and have it."""

    n: int
    median: float
    mean: float
    rms: float


class Difference(NamedTuple):
    """Of one figure, over the pairs in which both have it."""

    n: int
    mean: float  # of B - A; of a figure that should be near a value: of its distance from it
    low: float | None  # of its interval; None without one, also where every pair is equal
    high: float | None
    better: int  # pairs in which B is better
    worse: int  # in which A is
    verdict: int | None
    why: str = ""  # there is no interval, it is not judged, or it is open


class Share(NamedTuple):
    """How often something happened."""

    k: int
    n: int
    low: float | None  # of its probability
    high: float | None


class ShareDifference(NamedTuple):
    """Of what happened or did not, over the pairs in which both were judged; shares of these pairs."""

    n: int
    mean: float
    low: float | None
    high: float | None
    verdict: int | None
    why: str = ""


def sample(values):
    """Sample of (n,) values, n >= 1."""
    values = np.asarray(values, dtype=float)
    rms = float(np.sqrt(np.mean(values**2)))
    return Sample(len(values), float(np.median(values)), float(values.mean()), rms)


def difference(a, b, *, larger_is_better=False):
    """Difference of two samples (n,), (n,), n >= 1, row k of both of one seed."""
    a, b = (np.asarray(side, dtype=float) for side in (a, b))
    found = b - a
    found[np.isfinite(found) & (np.abs(found) <= ROUNDING * np.maximum(np.abs(a), np.abs(b)))] = 0.0
    worse = -found if larger_is_better else found
    n, mean, counts = len(found), float(found.mean()), (int((worse < 0.0).sum()), int((worse > 0.0).sum()))
    if not found.any():  # without scatter there is no interval, nor anything to be certain of
        return Difference(n, 0.0, None, None, 0, 0, NOT_SEEN)
    if why := _no_interval(found):
        return Difference(n, mean, None, None, *counts, None, why)
    low, high = intervals.mean(found)
    if n < FEW:
        return Difference(n, mean, low, high, *counts, OPEN, _few(n))
    verdict = _verdict(low, high, larger_is_better)
    if verdict != NOT_SEEN and max(-low, high) < NEGLIGIBLE * max(abs(a.mean()), abs(b.mean())):
        verdict = EQUAL
    return Difference(n, mean, low, high, *counts, verdict)


def _few(n):
    return f"only {n} pairs"


def _no_interval(found):
    """Why there is no interval of the mean of differences (n,); '' if there is one."""
    if len(found) == 1:
        return "one pair"
    if not np.isfinite(found).all():
        return "not finite"
    if np.ptp(found) == 0.0:
        return "all differences are equal: their scatter is not known"
    return ""


def _verdict(low, high, larger_is_better):
    """Verdict of an interval of B - A, or of what has its sign."""
    if low <= 0.0 <= high:
        return NOT_SEEN
    return B_BETTER if (low > 0.0) == larger_is_better else A_BETTER


def share(happened):
    """Share of a sequence of truths; without any, no interval."""
    k, n = sum(happened), len(happened)
    return Share(k, n, *(intervals.proportion(k, n) if n else (None, None)))


def share_difference(a, b, *, good):
    """ShareDifference of two sequences of truths, row k of both of one seed, n >= 1.

    good : whether it is good that it happens
    """
    n = len(a)
    only_a = sum(x and not y for x, y in zip(a, b, strict=True))
    only_b = sum(y and not x for x, y in zip(a, b, strict=True))
    mean, apart = (only_b - only_a) / n, only_a + only_b
    if not apart:
        return ShareDifference(n, 0.0, None, None, NOT_SEEN)
    if n == 1:
        return ShareDifference(n, mean, None, None, None, "one pair")
    if n < FEW:
        return ShareDifference(n, mean, *intervals.paired_shares(only_a, only_b, n), OPEN, _few(n))
    low, high = (p - 0.5 for p in intervals.proportion(only_b, apart))
    verdict = _verdict(low, high, good)
    return ShareDifference(n, mean, *intervals.paired_shares(only_a, only_b, n), verdict)
