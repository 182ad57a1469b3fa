"""Mean, standard deviation, skewness and kurtosis of centroid errors, and their rows beside tables 3 to 5."""

from typing import NamedTuple

import numpy as np

from shefex_nav.papers import rows, verdict
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.impa.published import CENTROID_MEAN_PX, CENTROID_SKEWNESS, IMPA, IMPA_KURTOSIS
from shefex_nav.papers.verdict import Verdict
from shefex_nav.report import intervals

TABLES = ("global_shutter", "rolling_compensated", "rolling_uncompensated")  # 3, 4, 5
AXES = ("horizontal", "vertical")
RATES = tuple(IMPA["protocol"]["rates_deg_s"])
MOMENTS = ("std", "mean", "skewness", "kurtosis")
UNITS = {"std": " [px]", "mean": " [px]"}
MARGIN = 0.25  # of a standard deviation: what counts as the same
MEAN_RESOLVES_PX, SKEWNESS_RESOLVES = 0.05, 0.25
RESAMPLES = 1000
SAMPLES_OF_PAPER = IMPA["protocol"]["attitudes"] * IMPA["protocol"]["directions"]  # at each rate
UNBOUNDED = (
    "too few samples: a sample's kurtosis lies below that of what it is drawn from, the more the longer the "
    "tails are, and no sample bounds it from above; so one below the published one is not told from it"
)


class Figure(NamedTuple):
    """One moment of one reading at one rate. The first five name it."""

    reading: str
    table: str  # of TABLES
    moment: str  # of MOMENTS
    axis: str  # of AXES
    rate: int  # deg/s
    value: float
    low: float  # 95 %
    high: float  # of a kurtosis: of the resampled ones, which bounds nothing
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
    """95 % intervals of the four: (m, 5) power sums -> (4, 2), in the order of `moments`.

    Samples are drawn again, with replacement, all of it at once: the percentile bootstrap of
    `intervals.bootstrap`, how often each sample is drawn is multinomial. Not so the standard deviation: of 60
    samples with long tails that holds it in 86 of 100 cases, `mean_square_interval` in 90.

    The upper end of a kurtosis is none. Of 520 samples whose kurtosis is 6 to 18 it lies above the truth in
    24 to 79 of 100 cases: what has not been met is not drawn again. Nothing does better, as no upper bound
    holds for any distribution (Bahadur and Savage, Ann. Math. Stat. 27, 1956, 1115; Donoho, Ann. Stat. 16,
    1988, 1390); the lower end holds. See `judged`.
    """
    m, (mean, *_) = len(sums), moments(sums)
    drawn = rng.multinomial(m, np.full(m, 1.0 / m), RESAMPLES) @ sums
    ends = np.percentile(of_totals(drawn), [2.5, 97.5], axis=0).T
    squares = sums[:, 2] - 2.0 * mean * sums[:, 1] + mean**2 * sums[:, 0]
    ends[1] = np.sqrt(intervals.mean_square_clustered(np.maximum(squares, 0.0), sums[:, 0]))
    return ends


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
    """Row of a figure beside the published one. why: of its standard deviation, if it differs

    The paper's samples are known by their number: they are taken to scatter as these do. A kurtosis has no
    upper end. What the resampled ones reach is less than what it may be: a strict tolerance for being the
    same, and none for being another one.
    """
    goal = published(one.table, one.moment)[one.axis][RATES.index(one.rate)]
    how = {
        "std": {"rounding": 0.0005 if goal < 1.0 else 0.005, "better": "less", "why": why},
        "mean": {},
        "skewness": {"rounding": 0.005},
        "kurtosis": {"rounding": 0.005},
    }[one.moment]
    resolves = {"mean": MEAN_RESOLVES_PX, "skewness": SKEWNESS_RESOLVES}.get(one.moment, MARGIN * goal)
    quantity = f"{one.moment}, {one.axis}{UNITS.get(one.moment, '')}"
    measured, ends = one.value, (one.low, one.high)
    theirs = verdict.reach(measured, ends, goal) * np.sqrt(one.samples / SAMPLES_OF_PAPER)
    how |= {"resolves": resolves, "of_paper": (goal - theirs, goal + theirs)}
    made = rows.figure(quantity, condition, goal, measured, ends, one.samples, **how)
    if one.moment == "kurtosis":
        made = made._replace(ci95=(one.low, np.inf))
        if made.verdict == Verdict.OPEN and measured < goal:
            made = made._replace(verdict=Verdict.TOO_FEW, why=UNBOUNDED)
    return made


def shown(one):
    """Row of a figure that judges nothing: what is otherwise in it is what another row is explained by."""
    place = f"{one.table.replace('_', ' ')}, {one.rate:g} deg/s, {one.errors} clusters, {one.reading}"
    return Row(*judged(one, place)[:5])
