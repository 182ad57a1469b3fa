"""Statistics of a filter's errors over runs, and the bounds that they have to keep.

Errors of one run are correlated in time, so the mean over a phase of the normalised squared error (NEES) of
one run scatters far more than its number of epochs suggests. Its bounds come from histories of errors that
obey the filter's own matrices (`linear.outputs`): the mean over n runs has the distribution of the mean of
n such histories. NIS needs no histories, because innovations of a consistent filter are white: its sum is
chi-square distributed (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, 5.4).
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.report.navigation_errors import chi2_bounds

RESAMPLED = 20000  # means of n histories in one field, of which the quantiles are taken


class Verdict(NamedTuple):
    """A statistic and the interval in which it has to lie."""

    what: str
    value: float
    low: float
    high: float
    samples: int

    @property
    def good(self):
        """Whether it lies in there."""
        return bool(self.low <= self.value <= self.high)


class Common(NamedTuple):
    """Mean of (o + c)^T P^-1 (o + c) over a phase, o each run's own error, c one that all runs have."""

    own: np.ndarray  # (m,) o^T P^-1 o
    cross: np.ndarray  # (m, k) o^T P^-1 c
    same: np.ndarray  # (k,) c^T P^-1 c


def mean_interval(per_history, n, probability):
    """Interval that holds the mean over n runs with a probability, each run being like one of the histories.

    A mean of squares has a gamma distribution, nearly: all of it for a constant error and for independent
    epochs. Its mean is known, histories obey the covariance that they are normalised by; the histories tell
    the scatter. Their own mean, or the largest of them, would lay the ends where chance has it: by 1000 of
    them, means of a hundred runs would be outside of 99.9 % twice as often.

    Parameters
    ----------
    per_history : (m,) the statistic of each history, over its degrees of freedom: 1 is expected
    n : number of runs
    probability : e.g. 0.999

    Returns
    -------
    low, high : float
    """
    variance = float(np.mean((np.asarray(per_history) - 1.0) ** 2)) / n
    dof = 2.0 / variance
    low, high = chi2_bounds(dof, probability)
    return float(low / dof), float(high / dof)


def one_draw_interval(common, n, probability, rng):
    """Interval of the mean over n runs of which a part of the error is the same in all, drawn once.

    Parameters
    ----------
    common : Common
    n, probability : as of `mean_interval`
    rng : Generator

    Returns
    -------
    low, high : float
    """
    own, cross, same = common
    means = np.empty(RESAMPLED)
    for k, j in enumerate(rng.integers(len(same), size=RESAMPLED)):
        runs = rng.integers(len(own), size=n)
        means[k] = own[runs].mean() + 2.0 * cross[runs, j].mean() + same[j]
    return _middle(means, probability)


def _middle(means, probability):
    """Interval that holds a share of the means (m,)."""
    tail = 0.5 * (1.0 - probability)
    low, high = np.quantile(means, [tail, 1.0 - tail])
    return float(low), float(high)


def nis_interval(dof, probability):
    """Interval of the mean NIS per degree of freedom over `dof` degrees of freedom in all."""
    low, high = chi2_bounds(dof, probability)
    return float(low / dof), float(high / dof)


def containment_interval(n, probability, sigmas=3.0):
    """Least and largest share of n independent runs whose error may lie within some sigmas."""
    from scipy.stats import binom, norm

    inside = norm.cdf(sigmas) - norm.cdf(-sigmas)
    tail = 0.5 * (1.0 - probability)
    low, high = binom.ppf([tail, 1.0 - tail], n, inside) / n
    return float(low), float(high)
