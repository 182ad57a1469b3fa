"""Mean, standard deviation, skewness and kurtosis of centroid errors, and their rows beside tables 3 to 5."""

from typing import NamedTuple

import numpy as np

from shefex_nav.papers import rows
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.impa.published import IMPA, IMPA_KURTOSIS
from shefex_nav.papers.impa.published_moments import CENTROID_MEAN_PX, CENTROID_SKEWNESS
from shefex_nav.report import intervals

TABLES = ("global_shutter", "rolling_compensated", "rolling_uncompensated")  # 3, 4, 5
AXES = ("horizontal", "vertical")
RATES = tuple(IMPA["protocol"]["rates_deg_s"])
MOMENTS = ("std", "mean", "skewness", "kurtosis")
UNITS = {"std": " [px]", "mean": " [px]"}
MARGIN = 0.25  # of a standard deviation: what counts as the same
MEAN_RESOLVES_PX, SKEWNESS_RESOLVES = 0.05, 0.25
RESAMPLES = 1000


class Figure(NamedTuple):
    """One moment of one reading at one rate. The first five name it."""

    reading: str
    table: str  # of TABLES
    moment: str  # of MOMENTS
    axis: str  # of AXES
    rate: int  # deg/s
    value: float
    low: float  # 95 %
    high: float
    samples: int  # attitudes and directions that the errors come from
    errors: int


def published(table, moment):
    """Published figures of a moment: {axis: those at RATES}."""
    of = {
        "std": IMPA["centroid_error_std_px"],
        "mean": CENTROID_MEAN_PX,
        "skewness": CENTROID_SKEWNESS,
        "kurtosis": IMPA_KURTOSIS,
    }
    return of[moment][table]


def power_sums(errors, sample):
    """Number of the errors of each sample, and sums of their first four powers. (n,), (n,) -> (m, 5)"""
    _, which = np.unique(sample, return_inverse=True)
    return np.array([np.bincount(which, errors**power) for power in range(5)]).T


def moments(sums):
    """Mean, standard deviation, skewness and kurtosis of values by their power sums. (n, 5) -> (4,)"""
    return of_totals(sums.sum(axis=0))


def of_totals(totals):
    """The same of the sums over all samples. (..., 5) -> (..., 4)"""
    n = totals[..., 0]
    mean, square, cube, fourth = (totals[..., power] / n for power in range(1, 5))
    variance = square - mean**2
    third = cube - 3.0 * mean * square + 2.0 * mean**3
    spread = np.sqrt(np.maximum(variance, np.finfo(float).tiny))
    tail = fourth - 4.0 * mean * cube + 6.0 * mean**2 * square - 3.0 * mean**4
    return np.stack((mean, spread, third / spread**3, tail / spread**4), axis=-1)


def moment_intervals(sums, rng):
    """95 % intervals of the four: samples drawn again, with replacement, all of it at once. (m, 5) -> (4, 2)

    The percentile bootstrap of `intervals.bootstrap`: how often each sample is drawn is multinomial.
    """
    m = len(sums)
    drawn = rng.multinomial(m, np.full(m, 1.0 / m), RESAMPLES) @ sums
    return np.percentile(of_totals(drawn), [2.5, 97.5], axis=0).T


def mean_square_interval(squares, sample):
    """95 % interval of the mean of squares. (n,), and which sample each is of -> (low, high)"""
    sums = power_sums(squares, sample)
    return intervals.mean_square_clustered(sums[:, 1], sums[:, 0])


def rms_interval(squares, sample):
    """The same of the root of that mean."""
    low, high = mean_square_interval(squares, sample)
    return float(np.sqrt(low)), float(np.sqrt(high))


def figures_of(reading, table, rate, axis, errors, sample):
    """The four moments of some errors: list of Figure, in the order of MOMENTS.

    errors, sample : (n,) px, and which attitude and direction each is of. Those of one have a motion and a
        sky in common: the samples are what was drawn, so they are what an interval resamples.
    """
    sums = power_sums(errors, sample)
    values, ends = moments(sums), moment_intervals(sums, np.random.default_rng(0))
    out = []
    for moment in MOMENTS:
        k = ("mean", "std", "skewness", "kurtosis").index(moment)
        measured = float(values[k]), *(float(end) for end in ends[k])
        out.append(Figure(reading, table, moment, axis, int(rate), *measured, len(sums), len(errors)))
    return out


def judged(one, condition, why=""):
    """Row of a figure beside the published one. why: of its standard deviation, if it differs"""
    goal = published(one.table, one.moment)[one.axis][RATES.index(one.rate)]
    how = {
        "std": {"rounding": 0.0005 if goal < 1.0 else 0.005, "better": "less", "why": why},
        "mean": {},
        "skewness": {"rounding": 0.005},
        "kurtosis": {"rounding": 0.005},
    }[one.moment]
    resolves = {"mean": MEAN_RESOLVES_PX, "skewness": SKEWNESS_RESOLVES}.get(one.moment, MARGIN * goal)
    quantity = f"{one.moment}, {one.axis}{UNITS.get(one.moment, '')}"
    measured = one.value, (one.low, one.high), one.samples
    return rows.figure(quantity, condition, goal, *measured, resolves=resolves, **how)


def shown(one):
    """Row of a figure that judges nothing: what is otherwise in it is what another row is explained by."""
    place = f"{one.table.replace('_', ' ')}, {one.rate:g} deg/s, {one.errors} clusters, {one.reading}"
    return Row(*judged(one, place)[:5])
