"""Errors over time and whether the covariance describes them, over the runs of a campaign.

At one instant the runs are independent, so the sum over N runs of a normalised squared error (NEES) with d
degrees of freedom is chi-square distributed with N d, and the number of runs inside 3 sigma binomial
(Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation, section 5.4). Epochs
of one run are not independent: bounds hold epoch by epoch, and what is judged is the last epoch of each
phase, with Holm's correction for the number of judgements.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.report import intervals

BLOCKS = ("attitude", "velocity", "position", "gyro_bias", "accel_bias")  # columns of the NEES
CORRELATED = BLOCKS[:3]  # whose NEES has the correlations between axes, without which it is no chi-square
FRAME = {"attitude": "b", "velocity": "i", "position": "i"}
AXES = "xyz"
SIGMAS = 3.0
DOF = 3  # of a block
MOST_RUNS = 2000  # whose series are read; the first ones, which are as random as any
SIGNIFICANT = 0.05
ANEES_CONFIDENCE, CONTAINED_CONFIDENCE, BLOCK_CONFIDENCE = 0.95, 0.99, 0.99


class Series(NamedTuple):
    """Series of R runs on T common epochs; NaN where a run has none, phase -1."""

    runs: np.ndarray  # (R,)
    t_s: np.ndarray  # (T,)
    errors: np.ndarray  # (R, T, 5, 3) in SI, in the order of BLOCKS
    sigmas: np.ndarray  # (R, T, 5, 3)
    nees: np.ndarray  # (R, T, 5)
    phase: np.ndarray  # (R, T)
    nis_sum: dict  # sensor -> (T,) over all runs
    nis_dof: dict  # sensor -> (T,)


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

    @property
    def good(self):
        """Whether chance explains it."""
        return self.p_holm >= SIGNIFICANT


def read(campaign, most=MOST_RUNS):
    """Series of the succeeded runs of a campaign, of the first `most`; None if there is none."""
    runs = campaign.runs[campaign.succeeded][:most]
    rate_hz = campaign.head["rate"]
    found, numbers = [], []
    for run in runs.tolist():
        one = campaign.series(run)
        if len(one["t_s"]):
            found.append(one)
            numbers.append(np.round((one["t_s"] - found[0]["t_s"][0]) * rate_hz).astype(int))
    if not found:
        return None
    first = min(int(k[0]) for k in numbers)
    return _stack(runs, found, [k - first for k in numbers], found[0]["t_s"][0] + first / rate_hz, rate_hz)


def _stack(runs, found, places, begin_s, rate_hz):
    """Series of the runs' arrays at their places on the common epochs."""
    R, T = len(found), max(int(k[-1]) for k in places) + 1
    errors, sigmas = (np.full((R, T, len(BLOCKS), 3), np.nan, np.float32) for _ in range(2))
    nees, phase = np.full((R, T, len(BLOCKS)), np.nan), np.full((R, T), -1, np.int8)
    sums = {"nis_sum": {}, "nis_dof": {}}
    for r, (one, k) in enumerate(zip(found, places, strict=True)):
        for b, name in enumerate(BLOCKS):
            end = f"_{FRAME[name]}" if name in FRAME else ""
            errors[r, k, b], sigmas[r, k, b] = one[f"{name}_error{end}"], one[f"{name}_sigma{end}"]
        nees[r, k], phase[r, k] = one["nees"], one["phase"]
        for name, values in one.items():
            kind, _, sensor = name.partition(".")
            if kind in sums:
                np.add.at(sums[kind].setdefault(sensor, np.zeros(T)), k, values)
    return Series(runs, begin_s + np.arange(T) / rate_hz, errors, sigmas, nees, phase, **sums)


def inside_probability(sigmas=SIGMAS):
    """Probability that a normal error lies within some sigmas."""
    from scipy import stats

    return float(stats.norm.cdf(sigmas) - stats.norm.cdf(-sigmas))


def contained(series):
    """Contained of Series."""
    from scipy import stats

    known = np.isfinite(series.errors) & np.isfinite(series.sigmas)
    inside = known & (np.abs(series.errors) <= SIGMAS * series.sigmas)
    n = known.sum(axis=0)
    share = np.divide(inside.sum(axis=0), n, out=np.full(n.shape, np.nan), where=n > 0)
    runs, tail = n.max(axis=(1, 2)), 0.5 * (1.0 - CONTAINED_CONFIDENCE)
    bounds = [
        stats.binom.ppf(q, runs, inside_probability()) / np.maximum(runs, 1) for q in (tail, 1.0 - tail)
    ]
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
    for sensor, dof in series.nis_dof.items():
        total = series.nis_sum[sensor]
        mean = np.divide(total, dof, out=np.full(dof.shape, np.nan), where=dof > 0)
        result[sensor] = _normalised(mean, dof)
    return result


def _normalised(mean, dof):
    low, high = chi_square_bounds(dof, ANEES_CONFIDENCE)
    return Normalised(dof, mean, low, high)


def chi_square_bounds(dof, confidence):
    """Interval of chi-square over its degrees of freedom: arrays like dof, NaN where that is 0."""
    from scipy import stats

    dof = np.asarray(dof, dtype=float)
    some, tail = np.maximum(dof, 1.0), 0.5 * (1.0 - confidence)
    return tuple(np.where(dof > 0, stats.chi2.ppf(q, some) / some, np.nan) for q in (tail, 1.0 - tail))


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
    from scipy import stats

    expected, found = inside_probability(), []
    for phase, (runs, epochs) in last_epochs(series).items():
        ratio = np.abs(series.errors[runs, epochs]) / series.sigmas[runs, epochs]
        for b, block in enumerate(BLOCKS):
            for axis in range(3):
                values = ratio[:, b, axis][np.isfinite(ratio[:, b, axis])]
                if not len(values):
                    continue
                n, k = len(values), int((values <= SIGMAS).sum())
                p = float(stats.binom.cdf(k, n, expected))
                low = float(stats.binom.ppf(1.0 - CONTAINED_CONFIDENCE, n, expected)) / n
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
                found.append(_chi_square(what, float(values.sum()), DOF * len(values), len(values)))
    return with_holm(found)


def judge_nis(series):
    """Verdicts on the mean NIS of each sensor, whose innovations are white if the filter is right."""
    found = []
    for sensor, dof in series.nis_dof.items():
        if dof.sum():
            total = float(series.nis_sum[sensor].sum())
            words = f"NIS of {sensor.replace('_', ' ')}"
            found.append(_chi_square(words, total, int(dof.sum()), len(series.runs)))
    return with_holm(found)


def _chi_square(what, total, dof, samples):
    """Verdict on a sum of squares."""
    from scipy import stats

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

    Each run's average over time is one sample of its own, so the interval is Student's over runs; 99 %, with
    which the five blocks together hold 1 in 95 % of all cases if the covariance is right.
    """
    result = {}
    for b, block in enumerate(BLOCKS):
        known = np.isfinite(series.nees[:, :, b])
        some = known.any(axis=1)
        if some.any():
            total = np.where(known, series.nees[:, :, b], 0.0).sum(axis=1)[some]
            each = total / known.sum(axis=1)[some] / DOF
            low, high = intervals.mean(each, BLOCK_CONFIDENCE)
            result[block] = (float(each.mean()), max(low, 0.0), high)
    return result


def phase_name(phase):
    """Name of a phase in words."""
    from shefex_nav.records import Phase

    return Phase(phase).name.lower()
