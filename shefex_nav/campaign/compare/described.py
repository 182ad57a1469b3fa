"""Whether the covariance of each side describes its errors: block by block, at the ends of phases, at entry.

The judgement is that of a campaign's report (`over_time`): at one instant the runs are independent, so the
sum of their normalised squared errors is chi-square distributed. Nothing is compared here: a filter with
small errors may say too much of itself, and one with large errors may be honest.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import over_time
from shefex_nav.campaign.compare.given import CAMPAIGN
from shefex_nav.campaign.over_time import CORRELATED, DOF

ENTRY, ENTRY_S = "entry", "navigation.at_entry.t_s"
RATE_HZ = 10.0  # at which a log is looked at, as a campaign keeps it
CHANCE = "as chance would have it"
SMALL, RIGHT, LARGE = "small", "right", "large"  # sigmas, against the errors


class Described(NamedTuple):
    """What the runs of a side say of one block of its covariance at one instant."""

    block: str  # position, velocity, attitude
    when: str
    t_s: float  # median over the runs
    verdict: over_time.Verdict  # its value is the mean NEES per degree of freedom
    sigma_over_error: float  # root mean squares over the runs, of the whole block; infinite without an error

    @property
    def kind(self):
        """SMALL or LARGE if chance does not explain the NEES, else RIGHT."""
        if not self.verdict.certain:
            return RIGHT
        return SMALL if self.verdict.value > 1.0 else LARGE

    @property
    def outside(self):
        """Whether the NEES lies outside of what is expected of it alone, whatever the verdict says."""
        return not self.verdict.low <= self.verdict.value <= self.verdict.high

    @property
    def times(self):
        """How many times the sigmas are too large or too small, by the NEES; infinite without any error."""
        value = self.verdict.value
        return max(value, 1.0 / value) ** 0.5 if value > 0.0 else math.inf

    def result(self):
        """Plain dict for JSON."""
        one = self.verdict
        return {
            "block": self.block,
            "when": self.when,
            "t_s": self.t_s,
            "runs": one.samples,
            "nees_per_dof": one.value,
            "expected": [one.low, one.high],
            "p_holm": one.p_holm,
            "sigma_over_error": self.sigma_over_error if math.isfinite(self.sigma_over_error) else None,
            "sigmas": {SMALL: "too small", RIGHT: "right", LARGE: "too large"}[self.kind],
            "times": self.times if math.isfinite(self.times) else None,
        }


class _Log:
    """As much of a results.Campaign as `over_time.read` asks for, of the one run of a log."""

    head = {"rate": RATE_HZ}  # noqa: RUF012 not changed
    runs, succeeded = np.array([0]), np.array([True])

    def __init__(self, data):
        self._data = data

    def series(self, run):
        from shefex_nav.campaign import series

        truth = self._data.truth
        unknown = np.full((len(truth.t_s), 6), np.nan)  # a log does not have the true biases
        with np.errstate(divide="ignore", invalid="ignore"):
            return series.series(self._data, truth, unknown, RATE_HZ)

    def times(self, run):
        return self.series(run)["t_s"]


def of_side(side):
    """list of Described of a sides.Side, in the order of time; empty where it gives no covariance."""
    kept = _kept(side)
    series = None if kept is None else over_time.read(kept)
    if series is None:
        return []
    instants = {
        f"end of {over_time.phase_name(phase)}": at for phase, at in over_time.last_epochs(series).items()
    }
    instants |= _entry(side, series)
    found = []
    for when, (runs, epochs) in instants.items():
        for block in CORRELATED:
            values = series.nees[runs, epochs, over_time.BLOCKS.index(block)]
            known = np.isfinite(values)
            if known.any():
                found.append(_judged(series, block, when, runs[known], epochs[known]))
    verdicts = over_time.with_holm([one.verdict for one in found])
    found = [one._replace(verdict=verdict) for one, verdict in zip(found, verdicts, strict=True)]
    return sorted(found, key=lambda one: (over_time.CORRELATED[::-1].index(one.block), one.t_s))


def _kept(side):
    """What has the series of a Side; None where it has none."""
    if side.kind != CAMPAIGN:
        return None if side.data is None or not len(side.data.truth.t_s) else _Log(side.data)
    from shefex_nav.campaign import results

    return results.open_campaign(side.where)


def _entry(side, series):
    """{ENTRY: (runs, epochs)} of the runs of a Side that have one; empty without."""
    times = {one.run: one.get(ENTRY_S) for one in side.runs.values()}
    if side.kind != CAMPAIGN:
        times = dict.fromkeys(series.runs.tolist(), *times.values())
    runs = [r for r, run in enumerate(series.runs.tolist()) if times.get(run) is not None]
    at_s = np.array([times[series.runs[r]] for r in runs])
    epochs = np.abs(series.t_s - at_s[:, None]).argmin(axis=1) if runs else at_s
    return {ENTRY: (np.array(runs), epochs)} if runs else {}


def _judged(series, block, when, runs, epochs):
    """Described of a block, of runs that have it there, still without the correction of Holm."""
    b = over_time.BLOCKS.index(block)
    values = series.nees[runs, epochs, b]
    what, n = f"NEES of {block}, {when}", len(runs)
    verdict = over_time.chi_square(what, float(values.sum()), DOF * n, n)
    error, sigma = (
        np.sqrt(np.mean(np.sum(one[runs, epochs, b].astype(float) ** 2, axis=1)))
        for one in (series.errors, series.sigmas)
    )
    ratio = float(sigma / error) if error > 0.0 else math.inf
    return Described(block, when, float(np.median(series.t_s[epochs])), verdict, ratio)


def rows(found):
    """Texts of a list of Described: (block, when, NEES, expected, sigma over error, verdict), grouped.

    What is alike at all instants is one row; else each instant that is wrong has its own.
    """
    for block in dict.fromkeys(one.block for one in found):
        of_block = [one for one in found if one.block == block]
        right = [one for one in of_block if one.kind == RIGHT]
        wrong = [one for one in of_block if one.kind != RIGHT]
        if len(wrong) == len(of_block) and len({one.kind for one in wrong}) == 1:
            groups = [wrong]
        else:
            groups = [*([one] for one in wrong), *([right] if right else [])]
        for group in groups:
            yield (block, _when(group, of_block), *_figures(group, len(found))), group[0].kind != RIGHT


def _when(group, of_block):
    if len(group) == 1:
        return group[0].when
    if len(group) < len(of_block):
        return "at all others"
    return f"{'entry and ' if any(one.when == ENTRY for one in group) else ''}all ends of phases"


def _figures(group, together):
    """NEES, what is expected, sigma over error, verdict of Described of one kind: texts.

    together : how many are judged together
    """
    verdicts = [one.verdict for one in group]
    low, high = min(one.low for one in verdicts), max(one.high for one in verdicts)
    nees = _range([one.value for one in verdicts])
    ratio = _range([one.sigma_over_error for one in group])
    words = f"{CHANCE}{_outside(group, together)}"
    if (kind := group[0].kind) != RIGHT:
        times = _range([one.times for one in group], digits=2)
        words = "no error at all" if times == "inf" else f"sigmas {times} times too {kind}"
        if len(group) > 1:
            words += f", most at {max(group, key=lambda one: one.times).when}"
    return nees, f"{low:.2g} to {high:.2g}", ratio, words


def _outside(group, together):
    """Why values beyond what is printed beside them are no fault; '' where there are none."""
    if not (n := sum(one.outside for one in group)):
        return ""
    which = "outside" if len(group) == 1 else f"{n} of {len(group)} outside"
    return f": {which} if judged alone, not among all {together}"


def _range(values, digits=3):
    """`0.8` or `0.8 to 1.2`."""
    low, high = (f"{value:.{digits}g}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"
