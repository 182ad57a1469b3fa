"""Errors over time and whether the covariance describes them, over the runs of a campaign.

At one instant the runs are independent, so the sum over N runs of a normalised squared error (NEES) with d
degrees of freedom is chi-square distributed with N d, and the number of runs inside 3 sigma binomial
(Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4). Epochs
of one run are not independent: bounds hold epoch by epoch, and what is judged is the last epoch of each
phase, with Holm's correction for the number of judgements. Innovations are judged by each run's mean.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from shefex_nav.campaign.plan import BLOCKS
from shefex_nav.records import Phase
from shefex_nav.report import intervals
from shefex_nav.report.innovations import errors_last
from shefex_nav.report.navigation_errors import chi2_bounds

CORRELATED = BLOCKS[:3]  # whose NEES has the correlations between axes, without which it is no chi-square
FRAME = {"attitude": "b", "velocity": "i", "position": "i"}
AXES = "xyz"
SIGMAS = 3.0
INSIDE = float(stats.norm.cdf(SIGMAS) - stats.norm.cdf(-SIGMAS))  # probability of a normal error
DOF = 3  # of a block
MOST_SERIES = 2000  # whose series are read; the first ones, which are as random as any
BYTES_OF_EPOCH = 250  # of one run in memory: errors, sigmas, NEES, NIS of ten sensors
MOST_BYTES = 1.5e9  # of all of them
SIGNIFICANT = 0.05
PRACTICAL = 0.1  # of a mean NIS
ANEES_CONFIDENCE, CONTAINED_CONFIDENCE, BLOCK_CONFIDENCE = 0.95, 0.99, 0.99


class Series(NamedTuple):
    """Series of R runs on T common epochs; NaN where a run has none, phase -1."""

    runs: np.ndarray  # (R,)
    t_s: np.ndarray  # (T,)
    errors: np.ndarray  # (R, T, 5, 3) in SI, in the order of BLOCKS
    sigmas: np.ndarray  # (R, T, 5, 3)
    nees: np.ndarray  # (R, T, 5)
    phase: np.ndarray  # (R, T)
    nis_sum: dict  # sensor -> (R, T) since the epoch before
    nis_dof: dict  # sensor -> (R, T)
    unread: int = 0  # succeeded runs whose series are not there or cannot be read


class Contained(NamedTuple):
    """Runs inside 3 sigma at T epochs."""

    runs: np.ndarray  # (T,) that have the epoch
    share: np.ndarray  # (T, 5, 3); NaN without runs
    low: np.ndarray  # (T,) 99 % of the shares lie within these, if the covariance is right
    high: np.ndarray  # (T,)


class Normalised(NamedTuple):
    """Mean over the runs of a normalised square per degree of freedom, which should be 1, at T epochs."""

    dof: np.ndarray  # (T,) degrees of freedom of the sum
    mean: np.ndarray  # (T, ...); NaN where dof is 0
    low: np.ndarray  # (T,) 95 % lie within these, if the covariance is right
    high: np.ndarray  # (T,)


class Verdict(NamedTuple):
    """One judgement of the covariance."""

    what: str
    value: float
    low: float  # interval of the value if the covariance is right, of this judgement alone
    high: float
    samples: int
    p: float  # of a value as far off if the covariance is right
    p_holm: float  # the same, corrected for the number of judgements of its kind
    practical: float = 0.0  # distance from 1 that is let pass, and told, however certain it is

    @property
    def certain(self):
        """Whether chance does not explain it."""
        return self.p_holm < SIGNIFICANT

    @property
    def good(self):
        """Whether chance explains it, or it is off by no more than is let pass."""
        return not self.certain or abs(self.value - 1.0) <= self.practical


def read(campaign, most=MOST_SERIES, most_bytes=MOST_BYTES):
    """Series of the succeeded runs of a campaign; None if there is none.

    Of the first `most`, and of no more than fit into `most_bytes`. Runs whose file is not there, or cannot be
    read, are left out and counted.
    """
    rate_hz, runs, times, unread = campaign.head["rate"], [], [], 0
    for run in campaign.runs[campaign.succeeded][:most].tolist():
        try:
            t_s = campaign.times(run)
        except KeyError:
            unread += 1
            continue
        if len(t_s):
            runs.append(run)
            times.append(t_s)
    if not runs:
        return None
    numbers = [np.round((t_s - times[0][0]) * rate_hz).astype(int) for t_s in times]
    first = min(int(k[0]) for k in numbers)
    places = [k - first for k in numbers]
    fit = max(int(most_bytes / BYTES_OF_EPOCH / (max(int(k[-1]) for k in places) + 1)), 1)
    series = _empty(runs[:fit], places[:fit], times[0][0] + first / rate_hz, rate_hz)
    whole = [_fill(series, r, campaign, k) for r, k in enumerate(places[:fit])]
    if not all(whole):
        series = _of_runs(series, np.array(whole))
    return series._replace(unread=unread + whole.count(False)) if any(whole) else None


def _empty(runs, places, begin_s, rate_hz):
    """Series of R runs on the epochs of their places, still without anything in it."""
    R, T = len(runs), max(int(k[-1]) for k in places) + 1
    errors, sigmas = (np.full((R, T, len(BLOCKS), 3), np.nan, np.float32) for _ in range(2))
    nees, phase = np.full((R, T, len(BLOCKS)), np.nan), np.full((R, T), -1, np.int8)
    return Series(np.array(runs), begin_s + np.arange(T) / rate_hz, errors, sigmas, nees, phase, {}, {})


def _fill(series, r, campaign, k):
    """Put the arrays of the r-th run at the epochs k. -> whether they could be read"""
    try:
        one = campaign.series(int(series.runs[r]))
    except KeyError:
        return False
    for b, name in enumerate(BLOCKS):
        end = f"_{FRAME[name]}" if name in FRAME else ""
        series.errors[r, k, b], series.sigmas[r, k, b] = one[f"{name}_error{end}"], one[f"{name}_sigma{end}"]
    series.nees[r, k], series.phase[r, k] = one["nees"], one["phase"]
    sums = {"nis_sum": series.nis_sum, "nis_dof": series.nis_dof}
    for name, values in one.items():
        kind, _, sensor = name.partition(".")
        if kind in sums:
            if sensor not in sums[kind]:
                sums[kind][sensor] = np.zeros(series.phase.shape, np.float32)
            sums[kind][sensor][r, k] = values
    return True


def _of_runs(series, chosen):
    """Series of some of its runs. (R,) bool"""
    cut = {name: getattr(series, name)[chosen] for name in ("runs", "errors", "sigmas", "nees", "phase")}
    nis = ({sensor: all_runs[chosen] for sensor, all_runs in one.items()} for one in series[6:8])
    return series._replace(**cut, **dict(zip(("nis_sum", "nis_dof"), nis, strict=True)))


def contained(series):
    """Contained of Series."""
    known = np.isfinite(series.errors) & np.isfinite(series.sigmas)
    inside = known & (np.abs(series.errors) <= SIGMAS * series.sigmas)
    n = known.sum(axis=0)
    share = np.divide(inside.sum(axis=0), n, out=np.full(n.shape, np.nan), where=n > 0)
    runs, tail = n.max(axis=(1, 2)), 0.5 * (1.0 - CONTAINED_CONFIDENCE)
    bounds = [stats.binom.ppf(q, runs, INSIDE) / np.maximum(runs, 1) for q in (tail, 1.0 - tail)]
    return Contained(runs, share, *bounds)


def anees(series):
    """Normalised squared errors of Series: Normalised, its mean (T, 5)."""
    known = np.isfinite(series.nees)
    n = known.sum(axis=0)
    total = np.where(known, series.nees, 0.0).sum(axis=0)
    mean = np.divide(total, DOF * n, out=np.full(n.shape, np.nan), where=n > 0)
    return _normalised(mean, DOF * n.max(axis=1))


def anis(series):
    """Normalised squared innovations: dict sensor -> Normalised, its mean (T,)."""
    result = {}
    for sensor, dof_of_runs in series.nis_dof.items():
        if errors_last(sensor):
            continue
        total, dof = (one.sum(axis=0, dtype=float) for one in (series.nis_sum[sensor], dof_of_runs))
        mean = np.divide(total, dof, out=np.full(dof.shape, np.nan), where=dof > 0)
        result[sensor] = _normalised(mean, dof)
    return result


def _normalised(mean, dof):
    low, high = chi_square_bounds(dof, ANEES_CONFIDENCE)
    return Normalised(dof, mean, low, high)


def chi_square_bounds(dof, confidence):
    """Interval of chi-square over its degrees of freedom: arrays like dof, NaN where that is 0."""
    dof = np.asarray(dof, dtype=float)
    some = np.maximum(dof, 1.0)
    return tuple(np.where(dof > 0, end / some, np.nan) for end in chi2_bounds(some, confidence))


# ---- judgements ------------------------------------------------------------------------------------------


def last_epochs(series):
    """Each run's last epoch of each phase: dict phase -> (runs (n,), epochs (n,)) as indices."""
    result = {}
    for phase in np.unique(series.phase[series.phase >= 0]).tolist():
        there = series.phase == phase
        runs = np.flatnonzero(there.any(axis=1))
        last = there.shape[1] - 1 - np.argmax(there[:, ::-1], axis=1)
        result[phase] = runs, last[runs]
    return result


def judge_containment(series):
    """Verdicts on the share of runs inside 3 sigma at the end of each phase, axis by axis.

    One-sided: a covariance that is too large holds all of them, which the NEES shows.
    """
    found = []
    for phase, (runs, epochs) in last_epochs(series).items():
        with np.errstate(divide="ignore", invalid="ignore"):  # a sigma of 0 holds no error
            ratio = np.abs(series.errors[runs, epochs]) / series.sigmas[runs, epochs]
        for b, block in enumerate(BLOCKS):
            for axis in range(3):
                values = ratio[:, b, axis][~np.isnan(ratio[:, b, axis])]
                if not len(values):
                    continue
                n, k = len(values), int((values <= SIGMAS).sum())
                p = float(stats.binom.cdf(k, n, INSIDE))
                low = float(stats.binom.ppf(1.0 - CONTAINED_CONFIDENCE, n, INSIDE)) / n
                what = f"{block.replace('_', ' ')} {AXES[axis]} inside 3 sigma, end of {phase_name(phase)}"
                found.append(Verdict(what, k / n, low, 1.0, n, p, p))
    return with_holm(found)


def judge_nees(series):
    """Verdicts on the mean NEES over the runs at the end of each phase, block by block."""
    found = []
    for phase, (runs, epochs) in last_epochs(series).items():
        at_end = series.nees[runs, epochs]
        for b, block in enumerate(CORRELATED):
            values = at_end[:, b][np.isfinite(at_end[:, b])]
            if len(values):
                what = f"NEES of {block.replace('_', ' ')}, end of {phase_name(phase)}"
                found.append(chi_square(what, float(values.sum()), DOF * len(values), len(values)))
    return with_holm(found)


def judge_nis(series, lasting=()):
    """Verdicts on the mean NIS of each sensor. lasting : names of those whose errors last in this scenario.

    Each run's mean is one sample, so the interval is Student's over runs: innovations of one run have its
    draws in common. It is never surer than chi-square, which the sum has if they have nothing in common:
    means of a few squares are too skew for Student. With thousands of innovations the smallest fault of a
    model is certain, so a mean that is off by less than PRACTICAL is let pass and told as such. Of a single
    run chi-square alone. Where errors last, right sigmas make it less than 1: only more is judged.
    """
    found = []
    for sensor, dof_of_runs in series.nis_dof.items():
        dof = dof_of_runs.sum(axis=1, dtype=float)
        some = dof > 0
        total = series.nis_sum[sensor].sum(axis=1, dtype=float)[some]
        words = f"NIS of {sensor.replace('_', ' ')}, mean of the runs"
        if not some.any():
            continue
        one = chi_square(words, float(total.sum()), int(dof[some].sum()), int(some.sum()))
        if some.sum() > 1:
            one = _less_sure(_student(words, total / dof[some]), one)
        one = one._replace(practical=PRACTICAL)
        found.append(_above(one) if errors_last(sensor) or sensor in lasting else one)
    return with_holm(found)


def _above(one):
    """A Verdict of which only a larger value speaks against the covariance."""
    return one._replace(low=0.0, p=0.5 * one.p if one.value > 1.0 else 1.0)


def _student(what, values):
    """Verdict on the mean of n > 1 values, which should be 1."""
    mean, sigma = float(values.mean()), float(values.std(ddof=1)) / len(values) ** 0.5
    half = float(stats.t.ppf(0.5 + 0.5 * ANEES_CONFIDENCE, len(values) - 1)) * sigma
    p = 2.0 * float(stats.t.sf(abs(mean - 1.0) / sigma, len(values) - 1)) if sigma else float(mean == 1.0)
    return Verdict(what, mean, max(1.0 - half, 0.0), 1.0 + half, len(values), p, p)


def _less_sure(one, other):
    """A Verdict with the wider interval and the larger p of two."""
    p = max(one.p, other.p)
    return one._replace(low=min(one.low, other.low), high=max(one.high, other.high), p=p, p_holm=p)


def chi_square(what, total, dof, samples):
    """Verdict on a sum of squares."""
    low, high = chi_square_bounds(dof, ANEES_CONFIDENCE)
    p = 2.0 * min(float(stats.chi2.cdf(total, dof)), float(stats.chi2.sf(total, dof)))
    return Verdict(what, total / dof, float(low), float(high), samples, p, p)


def with_holm(verdicts):
    """The same Verdicts with the p of Holm's procedure (1979) over all of them."""
    corrected = holm([one.p for one in verdicts])
    return [one._replace(p_holm=float(p)) for one, p in zip(verdicts, corrected, strict=True)]


def holm(p):
    """Holm's corrected p values: (n,) -> (n,); each is right for all n tests together."""
    p = np.asarray(p, dtype=float)
    order = np.argsort(p, kind="stable")
    scaled = np.maximum.accumulate(p[order] * (len(p) - np.arange(len(p))))
    corrected = np.empty(len(p))
    corrected[order] = np.minimum(scaled, 1.0)
    return corrected


def time_averages(series):
    """Mean NEES over time and runs, over its degrees of freedom: dict block -> (value, low, high).

    Each run's average over time is one sample of its own, so the interval is over runs; 99 %, with which the
    five blocks together hold 1 in 95 % of all cases if the covariance is right.
    """
    result = {}
    for b, block in enumerate(BLOCKS):
        known = np.isfinite(series.nees[:, :, b])
        some = known.any(axis=1)
        if some.any():
            total = np.where(known, series.nees[:, :, b], 0.0).sum(axis=1)[some]
            each = total / known.sum(axis=1)[some] / DOF
            result[block] = (float(each.mean()), *intervals.mean_square(each, BLOCK_CONFIDENCE))
    return result


def phase_name(phase):
    """Name of a phase in words."""
    return Phase(phase).name.lower()
