"""Spearman's rank correlation with a p value that holds far out, where a correction for many tests looks.

The usual p value takes Student's distribution for the correlation. Where that says 1e-4, which is 5 % of 500
pairs, the truth is more than twice as much for 12 results and worse for fewer; a correlation of 1 gets p = 0.
Here p is that of all orders of one of the two, ties as they are:

- For few results these are counted.
- For more, their distribution is taken for the symmetric one of Pearson's with its variance and kurtosis
  (Pitman 1937, J. R. Stat. Soc. Suppl. 4, 225), half a step wider for its being discrete. At 1e-4 without
  ties that errs to the safe side: by 3 for 11 results, by 1.3 for 20.
- Where both sides keep one value in half of the runs, or have but two, the distribution is a few lumps that
  no curve follows. There p is that of Fisher's exact test, whether one leaves its usual value where the other
  does.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

FEWEST = 4  # results, which a moment of fourth order takes
EXACT = 10  # results up to which all orders are counted
ROUND = 1e-9


class Ranked(NamedTuple):
    """What a correlation takes of its one side."""

    ranks: np.ndarray  # (n,) whole numbers from 0, with the distances of ranks
    off: np.ndarray  # (n,) from their mean
    squares: float  # sum of these squared
    excess: float  # k-statistic of fourth order over the square of that of second
    unusual: np.ndarray  # (n,) whether it is not the most frequent value
    lumps: bool  # that one has half of the runs, or there are but two


def ranked(values):
    """-> Ranked of values (n,), not all the same, n >= FEWEST"""
    from scipy import stats

    ranks = stats.rankdata(values)
    twice = np.rint(2.0 * (ranks - ranks.min())).astype(np.int64)
    whole = (twice // np.gcd.reduce(twice)).astype(float)
    n, off = len(whole), whole - whole.mean()
    m2, m4 = float(np.mean(off**2)), float(np.mean(off**4))
    k2 = n * m2 / (n - 1.0)
    k4 = n**2 * ((n + 1.0) * m4 - 3.0 * (n - 1.0) * m2**2) / ((n - 1.0) * (n - 2.0) * (n - 3.0))
    each, counts = np.unique(whole, return_counts=True)
    unusual = whole != each[np.argmax(counts)]
    return Ranked(whole, off, n * m2, k4 / k2**2, unusual, len(each) == 2 or 2 * counts.max() >= n)


def correlation(a, b):
    """Of two Ranked of the same runs: rho, two-sided p."""
    n, unit = len(a.ranks), float(np.sqrt(a.squares * b.squares))
    rho = float(np.clip(a.off @ b.off / unit, -1.0, 1.0))
    if n <= EXACT:
        orders = (tuple(np.sort(one.ranks).tolist()) for one in (a, b))
        return rho, _far(_sums(*orders), a.ranks, b.ranks)
    if a.lumps and b.lumps:
        counts = sorted(int(one.unusual.sum()) for one in (a, b))
        return rho, _far(_tables(n, *counts), a.unusual.astype(float), b.unusual.astype(float))
    return rho, min(_approximate(max(abs(rho) - 0.5 / unit, 0.0), n, a.excess, b.excess), 1.0)


def _far(shares, a, b):
    """Share of the orders whose sum of products is as far from its mean as that of a and b (n,) is."""
    mean = a.sum() * b.sum() / len(a)
    far = np.abs(np.arange(len(shares)) - mean) >= abs(float(a @ b) - mean) - ROUND
    return min(float(shares[far].sum()), 1.0)


@lru_cache(maxsize=4096)
def _tables(n, ones, others):
    """Shares of the orders of ones among n runs that have 0, 1, ... of these in common with others."""
    from scipy import stats

    return stats.hypergeom.pmf(np.arange(min(ones, others) + 1), n, ones, others)


def _approximate(rho, n, excess_a, excess_b):
    """Two-sided p of |rho| over all orders, from their second and fourth moment."""
    from scipy import special

    variance = 1.0 / (n - 1.0)
    shape = (n - 2.0) * (n - 3.0) / (3.0 * n * (n - 1.0) ** 2) * excess_a * excess_b
    kurtosis = 3.0 * (n - 1.0) / (n + 1.0) * (1.0 + shape)
    # not lighter than Student's, whose tails end at 1: others end before it, where there are results still
    kurtosis = max(kurtosis, 3.0 * (n - 1.0) / (n + 1.0))
    if abs(kurtosis - 3.0) < 1e-6:
        return float(2.0 * special.ndtr(-rho / np.sqrt(variance)))
    if kurtosis < 3.0:  # type II: a beta distribution
        s = 1.5 * (kurtosis - 1.0) / (3.0 - kurtosis)
        end = np.sqrt(variance * (2.0 * s + 1.0))
        return float(2.0 * special.betainc(s, s, 0.5 * (1.0 - min(rho / end, 1.0))))
    free = 4.0 + 6.0 / (kurtosis - 3.0)  # type VII: Student's, of another width
    return float(2.0 * special.stdtr(free, -rho * np.sqrt(free / ((free - 2.0) * variance))))


@lru_cache(maxsize=256)
def _sums(a, b):
    """Shares of the orders of b (tuple of whole numbers, sorted) that give each sum of products with a."""
    few, many = sorted((a, b), key=lambda one: np.prod(np.unique(one, return_counts=True)[1] + 1.0))
    values, sizes = np.unique(np.array(few, dtype=np.int64), return_counts=True)
    strides = np.concatenate([[1], np.cumprod(sizes + 1)[:-1]])
    top = int(np.dot(a, b))  # of both in the same order, the largest
    counts = np.zeros((int(np.prod(sizes + 1)), top + 1))  # by how many of each value are placed
    counts[0, 0] = 1.0
    for state in range(len(counts) - 1):
        used = state // strides % (sizes + 1)
        factor = int(many[int(used.sum())])
        for value, stride in zip(values[used < sizes], strides[used < sizes], strict=True):
            step = factor * int(value)
            counts[state + stride, step:] += counts[state, : top + 1 - step]
    return counts[-1] / counts[-1].sum()
