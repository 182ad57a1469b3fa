"""Ratio of the RMS of two kinds of missions, from samples that share their draws or do not.

A are the squared errors of the one kind, B those of the other, R = sqrt(E[A] / E[B]). With common random
numbers (Owen, Monte Carlo theory, methods and examples, 2013, section 8.6) A_k and B_k of one number k have
all in common but what is compared. There are n pairs and m further A, N = n + m. Three estimates:

independent   sqrt(mean_N A / mean_n B), each sample drawn by itself, whether or not it has pairs; variance of
              ln R^2: var A / (N E[A]^2) + var B / (n E[B]^2). Of samples with pairs its interval is too
              wide where A and B go together, too narrow where they go against each other.
paired        sqrt(mean_n A / mean_n B), of the pairs alone, drawn as pairs. With equal relative variances v
              and the correlation rho of A and B: 2 v (1 - rho) / n.
controlled    the further A as well. mean_n A - mean_N A has the expectation zero, and goes with mean_n B: it
              is a control variate for it (Owen, section 8.9) with the coefficient of the regression,

                  E[B] = mean_n B - beta (mean_n A - mean_N A),   beta = cov_n(A, B) / var_n(A),
                  R = sqrt(mean_N A / E[B]),

              which is the regression estimator of double sampling (Cochran, Sampling techniques, 3rd ed.
              1977, chapter 12). Variance, likewise: v (1 - rho^2) / n + v (1 - rho)^2 / N. That is never more
              than that of the pairs, and less than that of independent samples where rho > 0. beta is
              estimated anew in each sample of the bootstrap, so that what it costs is in the interval.

Intervals are percentiles of the bootstrap over runs or pairs (Efron and Tibshirani, An introduction to the
bootstrap, 1993, chapter 13): they ask for no distribution of the errors.
"""

from typing import NamedTuple

import numpy as np

LIKELY = 0.95
DRAWS = 10_000  # of the bootstrap
AT_A_TIME = 500  # of them, in memory


class Estimate(NamedTuple):
    """A ratio about each axis."""

    name: str
    ratio: np.ndarray  # (3,)
    low: np.ndarray  # (3,) ends of its 95 % interval
    high: np.ndarray  # (3,)

    @property
    def width(self):
        """Of the intervals, as the mean logarithm of their ends over the axes."""
        return float(np.mean(np.log(self.high / self.low)))


def independent(a, b, rng, draws=DRAWS):
    """Estimate of all a over all b, (N, 3) and (n, 3) errors, drawn apart."""
    return _estimate("independent", [_columns(a), _columns(b)], lambda a, b: a[0] / b[0], rng, draws)


def paired(a, b, rng, draws=DRAWS):
    """Estimate of a over b, errors (n, 3) of the same missions, drawn together."""
    return _estimate("paired", [_columns(a, b)], lambda both: both[0] / both[1], rng, draws)


def controlled(a, b, further, rng, draws=DRAWS):
    """Estimate of a over b, errors (n, 3) of the same missions, and further a (m, 3)."""
    n, m = len(a), len(further)
    squares = np.square(a), np.square(b)
    pairs = np.stack([*squares, squares[0] ** 2, squares[0] * squares[1]], axis=1)

    def ratio(both, alone):
        mean_a, mean_b, mean_aa, mean_ab = both
        all_a = (n * mean_a + m * alone[0]) / (n + m)
        beta = (mean_ab - mean_a * mean_b) / (mean_aa - mean_a**2)
        expected_b = mean_b - beta * (mean_a - all_a)
        return np.divide(all_a, expected_b, out=np.full_like(all_a, np.inf), where=expected_b > 0.0)

    return _estimate("controlled", [pairs, _columns(further)], ratio, rng, draws)


def correlation(a, b):
    """(3,) correlation of the squared errors of pairs, a and b (n, 3)."""
    return np.array([np.corrcoef(a[:, axis] ** 2, b[:, axis] ** 2)[0, 1] for axis in range(3)])


def _columns(*errors):
    """(n, parts, 3) squared errors of runs that are drawn together."""
    return np.stack([np.square(part) for part in errors], axis=1)


def _estimate(name, groups, ratio, rng, draws):
    """Estimate of the root of `ratio`, a function of the means of each group.

    groups : list of (n, k, 3), each drawn by itself; the function gets of each its means (k, ..., 3)
    """
    found = np.sqrt(ratio(*(group.mean(axis=0) for group in groups)))
    drawn = []
    for begin in range(0, draws, AT_A_TIME):
        count = min(AT_A_TIME, draws - begin)
        drawn.append(np.sqrt(ratio(*(_resampled(group, count, rng) for group in groups))))
    tail = 50.0 * (1.0 - LIKELY)
    return Estimate(name, found, *np.percentile(np.concatenate(drawn), [tail, 100.0 - tail], axis=0))


def _resampled(group, count, rng):
    """Means of `count` samples with replacement: (k, count, 3)."""
    n = len(group)
    weights = rng.multinomial(n, np.full(n, 1.0 / n), size=count) / n
    return np.moveaxis(np.tensordot(weights, group, axes=1), 1, 0)
