"""Whether fitted statistics agree with rendered runs that they were not fitted to.

The centroids of these runs against the fitted variances, and the same seeds flown with statistics: errors of
the attitudes, what the star tracker says of them, how often there is one and why not. Each figure has limits
within which the statistics serve; they are of the figure's meaning for a mission, not of chance.

Frames of one run are not independent: an exposure that a few frames of a slew have set lasts for the two
minutes after it. So what chance does to a figure is told from run to run, by leaving out one after the other
(the jackknife; Efron, The Jackknife, the Bootstrap and Other Resampling Plans, 1982, eq. 3.4). A figure that
is within its limits counts only if chance does not reach from their middle to their ends; one that is beyond
them is said to be so only if chance does not reach back. Between the two there are too few runs.
"""

from math import ceil, isfinite, isnan, nan
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr, stdtrit

from shefex_nav.campaign.characterise import fit
from shefex_nav.campaign.characterise.fit import CLIP, joined, of_sources
from shefex_nav.records import Reason
from shefex_nav.report import intervals

VARIANCE = (0.8, 1.25)  # of a ratio of variances: 12 % of a sigma
SIGMA = (0.9, 1.1)  # of a ratio of sigmas
EXPOSURE = (0.95, 1.05)  # of a ratio of mean exposures
OBJECTS = (0.95, 1.05)  # of a ratio of mean numbers
POINTS = 2.0  # per cent of the frames
GROSS = 5.0  # per cent of the centroids; one star beside a false object in a few runs
CORRELATION = 0.1
LIKELY = 0.95  # two-sided, of Student's distribution: what chance does to a figure
FEWEST_RUNS = 3  # with fewer nothing is known of chance
INSIDE, OUTSIDE, TOO_FEW = "inside", "outside", "too few runs"
FAINT, BRIGHT = 1.0, 20.0  # contrast between never found and always found


class Test(NamedTuple):
    """One figure."""

    what: str
    value: float  # NaN: there is nothing to judge, which is not good
    low: float
    high: float
    samples: int
    error: float = 0.0  # standard error over the runs that judge; NaN: nothing is known of it
    runs: int = 0  # that judge; 0: there is no chance in the figure
    least: float = 0.0  # how far chance moves it though no run differs from another: of none of n frames

    @property
    def reach(self):
        """How far chance moves the figure; infinite if nothing is known of it."""
        return max(self.spread, self.least)

    @property
    def spread(self):
        """The part of it that the runs show."""
        if not self.runs:
            return 0.0
        if not isfinite(self.error):
            return np.inf
        return float(stdtrit(self.runs - 1, 0.5 + 0.5 * LIKELY)) * self.error

    @property
    def verdict(self):
        """INSIDE, OUTSIDE or TOO_FEW."""
        beyond = max(self.low - self.value, self.value - self.high)
        if isnan(self.value) or beyond > self.reach:
            return OUTSIDE
        return INSIDE if beyond <= 0.0 and self.reach <= 0.5 * (self.high - self.low) else TOO_FEW

    @property
    def good(self):
        return self.verdict == INSIDE

    @property
    def deciding(self):
        """How many judging runs would decide, with errors like these; None: they have, or nobody knows."""
        if self.verdict != TOO_FEW or not isfinite(self.reach):
            return None
        half = 0.5 * (self.high - self.low)
        room = half if self.reach > half else max(self.low - self.value, self.value - self.high)
        return ceil(self.runs * max((self.spread / room) ** 2, self.least / room))

    def as_dict(self):
        """For the file."""
        return {
            "what": self.what, "value": None if isnan(self.value) else float(self.value),
            "low": self.low, "high": self.high, "samples": int(self.samples),
            "error": float(self.error) if isfinite(self.error) else None, "runs": self.runs,
            "verdict": self.verdict, "good": self.good,
        }  # fmt: skip


def with_errors(figures, runs):
    """Tests of all runs, each with its standard error over them.

    figures : function of a list of numbers of runs -> list of Test, the same ones for any of them
    runs : int
    """
    tests, every = figures(list(range(runs))), range(runs)
    if runs < FEWEST_RUNS:
        return [test._replace(error=nan, runs=runs) for test in tests]
    less = np.array([[test.value for test in figures([k for k in every if k != left])] for left in every])
    errors = np.sqrt((runs - 1) / runs * ((less - less.mean(axis=0)) ** 2).sum(axis=0))
    return [test._replace(error=float(one), runs=runs) for test, one in zip(tests, errors, strict=True)]


def centroids(runs, model, max_rate):
    """Tests of single centroids. list of Collected, SightingModel, rad/s -> list of Test"""
    return with_errors(lambda kept: _centroids([runs[k] for k in kept], model, max_rate), len(runs))


def _centroids(runs, model, max_rate):
    """As `centroids`, without errors."""
    sources = joined([run.sources for run in runs])
    frames = joined([run.frames for run in runs])
    slow = of_sources(runs, frames.rate <= max_rate)
    inside = sources.clear & (sources.border_px > model.border_px)
    chosen = slow & inside & sources.found & (sources.hip > 0) & ~sources.saturated
    variances = np.stack([sources.along @ model.noise, sources.across @ model.noise], axis=1)
    reported = np.stack([sources.along @ model.reported, sources.across @ model.reported], axis=1)
    gross = (sources.error**2 > CLIP**2 * variances).any(axis=1)
    vague = (sources.reported > fit.GROSS**2 * reported).any(axis=1)
    tests = [
        Test(words, 100.0 * _mean(some[chosen]), 0.0, GROSS, chosen.sum())
        for some, words in (
            (gross, f"per cent of the centroids beyond {CLIP:g} sigma: another object's light"),
            (vague, f"per cent of the centroids with {fit.GROSS:g} times the sigma: two stars in one"),
        )
    ]
    chosen &= ~gross & ~vague
    for axis, name in enumerate(("along", "across")):
        ratio = sources.error[chosen, axis] ** 2 / variances[chosen, axis]
        words = f"variance of centroids {name} the streak over the fitted"
        tests.append(Test(words, _mean(ratio), *VARIANCE, len(ratio)))
        ratio = sources.reported[chosen, axis] / reported[chosen, axis]
        words = f"variance that is reported {name} the streak over the fitted"
        tests.append(Test(words, _mean(ratio), *VARIANCE, len(ratio)))
    lag, samples = _lag(runs, chosen, sources, model)
    tests.append(
        Test("correlation of a star's error from frame to frame", lag, -CORRELATION, CORRELATION, samples)
    )
    dim = inside & (sources.q > FAINT) & (sources.q < BRIGHT)
    share = ndtr(sources.features[dim] @ model.detection)
    apart = 100.0 * (sources.found[dim].mean() - share.mean()) if dim.any() else nan
    tests.append(Test("faint sources found, per cent more than fitted", apart, -POINTS, POINTS, dim.sum()))
    return tests


def _lag(runs, chosen, sources, model):
    """(correlation of normalised errors of the same star in frames one after the other, pairs)."""
    error = sources.error / np.sqrt(
        np.stack([sources.along @ model.noise, sources.across @ model.noise], axis=1)
    )
    ends = np.cumsum([0] + [len(run.sources.hip) for run in runs])
    run_of = np.repeat(np.arange(len(runs)), np.diff(ends))
    rows = np.flatnonzero(chosen)
    rows = rows[np.lexsort((sources.frame[rows], sources.hip[rows], run_of[rows]))]
    a, b = rows[:-1], rows[1:]
    next_one = (run_of[a] == run_of[b]) & (sources.hip[a] == sources.hip[b])
    next_one &= sources.frame[b] == sources.frame[a] + 1
    a, b = a[next_one], b[next_one]
    if not len(a):
        return nan, 0
    return float((error[a] * error[b]).mean() / (error[rows] ** 2).mean()), 2 * len(a)


def flown_all(wanted, lost):
    """Test that all runs that judge could be flown with statistics. int, list of Failed -> Test"""
    reasons = "".join(f"; {one.reason}" for one in lost[:1])
    return Test(f"held-out runs that the statistics cannot fly{reasons}", len(lost), 0.0, 0.0, wanted)


class Fixes(NamedTuple):
    """Star fixes of one run, rendered or not."""

    reason: np.ndarray  # (M,)
    exposure_s: np.ndarray  # (M,)
    objects: np.ndarray  # (M,) number of all that was found
    error: np.ndarray  # (M, 3) rad, NaN without an attitude
    sigma: np.ndarray  # (M, 3) rad


def of_frames(frames):
    """Fixes of Frames."""
    return Fixes(frames.reason, frames.exposure_s, frames.objects, frames.error, frames.sigma)


def fixes(rendered, statistical, limit_wrong):
    """Tests of what the filter gets.

    Parameters
    ----------
    rendered, statistical : lists of Fixes, run by run with the same seeds
    limit_wrong : float, rad, an attitude further off is wrong
    """
    reasons = np.unique(np.concatenate([part.reason for part in (*rendered, *statistical)]))
    reasons = [Reason(reason) for reason in reasons]

    def figures(kept):
        return _fixes([rendered[k] for k in kept], [statistical[k] for k in kept], limit_wrong, reasons)

    return with_errors(figures, len(rendered))


def _fixes(rendered, statistical, limit_wrong, reasons):
    """As `fixes`, without errors, with the frames of each of the reasons."""
    tests = []
    one, other = _spread(rendered, limit_wrong), _spread(statistical, limit_wrong)
    n = sum(int((part.reason == Reason.NONE).sum()) for part in rendered)
    for name, columns in (("across the boresight", slice(0, 2)), ("about the boresight", slice(2, 3))):
        ratio = np.sqrt(_ratio(other[0][columns] ** 2, one[0][columns] ** 2))
        words = f"scatter of attitudes {name}, statistical over rendered"
        tests.append(Test(words, ratio, *SIGMA, n))
        ratio = np.sqrt(_ratio(other[1][columns] ** 2, one[1][columns] ** 2))
        words = f"sigma as reported {name}, statistical over rendered"
        tests.append(Test(words, ratio, *SIGMA, n))
    all_one, all_other = joined(rendered), joined(statistical)
    never = 100.0 * intervals.proportion(0, len(all_one.reason))[1]  # of what was in no frame
    for reason in reasons:
        shares = [100.0 * (part.reason == reason).mean() for part in (all_one, all_other)]
        name = "with an attitude" if reason == Reason.NONE else f"without, {reason.name.lower()}"
        words = f"frames {name}: {shares[0]:.2f} % rendered; points more statistical"
        apart = shares[1] - shares[0]
        tests.append(Test(words, apart, -POINTS, POINTS, len(all_one.reason), least=never))
    wrong = [int((np.linalg.norm(part.error, axis=1) > limit_wrong).sum()) for part in (all_one, all_other)]
    apart = 100.0 * (wrong[1] - wrong[0]) / len(all_one.reason)
    words = f"wrong attitudes: {wrong[0]} rendered, {wrong[1]} statistical; per cent of the frames more"
    tests.append(Test(words, apart, -0.1, 0.1, len(all_one.reason), least=never))
    ratio = _ratio(all_other.exposure_s, all_one.exposure_s)
    tests.append(Test("mean exposure, statistical over rendered", ratio, *EXPOSURE, len(all_one.reason)))
    ratio = _ratio(all_other.objects, all_one.objects)
    tests.append(
        Test("mean number of objects, statistical over rendered", ratio, *OBJECTS, len(all_one.reason))
    )
    return tests


def _spread(runs, limit_wrong):
    """Root mean square of attitudes that are not wrong about each run's mean, and of their sigmas: (3,)."""
    squares, variances, n = np.zeros(3), np.zeros(3), 0
    for part in runs:
        good = np.linalg.norm(part.error, axis=1) <= limit_wrong  # NaN is not
        if not good.any():
            continue
        error = part.error[good]
        squares += ((error - error.mean(axis=0)) ** 2).sum(axis=0)
        variances += (part.sigma[good] ** 2).sum(axis=0)
        n += int(good.sum())
    if n == 0:
        return np.full(3, nan), np.full(3, nan)
    return np.sqrt(squares / n), np.sqrt(variances / n)


def _mean(values):
    """Mean; NaN of nothing."""
    return float(values.mean()) if len(values) else nan


def _ratio(values, others):
    """Ratio of two means; NaN if there is none."""
    above, below = _mean(values), _mean(others)
    return above / below if below > 0.0 else nan
