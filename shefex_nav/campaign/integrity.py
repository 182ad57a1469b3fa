"""Integrity risk: how often errors were beyond their protection level, unnoticed, against what is stated.

Counted are the events of `report.trust`: stretches of more than its time to alert in which a quantity is
usable although its error is beyond its protection level, per hour of the time in which it is usable, over all
runs that flew to their end. `most` and `least` bound their rate one-sided at CONFIDENCE, as of a Poisson
process (Garwood 1936). Where the events of a run come together, they scatter more from run to run than its:
then events and hours count as so many fewer as have that scatter, as trials do in Korn and Graubard's
interval (`intervals.clustered`). A campaign of T usable hours without an event shows 4.6/T per hour at 99 %,
if events come alone: a risk of 1e-1 or 1e-2 per hour can be counted (`requirements.integrity_risk`, and the
levels are made for it), a smaller one cannot. Of that there is an extrapolation alone: largest error over
level of each run, r, whose square has the tail of an exponential if errors are normal, so that its maximum
over a run is Gumbel's. It says how often r would exceed 1 if the tail goes on like the body, and knows
nothing of faults not flown.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from shefex_nav.records import QUANTITIES

CONFIDENCE = 0.99
FEWEST_RUNS = 20  # [E] for a tail
SAMPLES, LARGEST = 4000, 1000  # of Gumbel's distribution that are drawn, and runs in each at most
WHERE = "summary.navigation.integrity"


class Counted(NamedTuple):
    """Integrity of one quantity in a campaign."""

    quantity: str
    hours: float  # usable, over all runs
    events: int
    rate: float | None  # per hour
    least: float | None  # one-sided bounds of the rate
    most: float | None
    risk: float  # per hour, stated
    worst: float | None  # largest error over its level
    worst_run: int | None
    tail: float | None  # extrapolated rate per hour, and its upper bound
    tail_most: float | None

    @property
    def verdict(self):
        """What the count says of the stated risk."""
        if self.rate is None:
            return "never usable"
        if self.least > self.risk:
            return "not kept"
        if self.most <= self.risk:
            return "shown"
        return "not refuted" if self.rate <= self.risk else "neither shown nor refuted"


def count(campaign):
    """Counted of each quantity: list; empty without levels."""
    risk, found = campaign.requirements.integrity_risk, []
    for quantity in QUANTITIES:
        hours, events, over = (
            campaign.numbers(f"{WHERE}.{quantity}.{name}")
            for name in ("usable_h", "misleading_events", "over_level")
        )
        known = campaign.succeeded & np.isfinite(hours) & np.isfinite(events)
        if known.any():
            found.append(_of(quantity, hours[known], events[known], over[known], campaign.runs[known], risk))
    return found


def _of(quantity, hours, events, over, runs, risk):
    total, k = float(hours.sum()), int(events.sum())
    if not total > 0.0:
        return Counted(quantity, 0.0, k, *[None] * 3, risk, *[None] * 4)
    together = _together(events, hours)
    least, most = (together * end for end in poisson(k / together, CONFIDENCE))
    used = np.isfinite(over)
    worst = int(np.nanargmax(over)) if used.any() else None
    tail = extrapolated(over[used], hours[used]) if used.sum() >= FEWEST_RUNS else (None, None)
    return Counted(
        quantity, total, k, k / total, least / total, most / total, risk,
        None if worst is None else float(over[worst]), None if worst is None else int(runs[worst]), *tail,
    )  # fmt: skip


def _together(events, hours):
    """How many times as much as a Poisson process events (n,) scatter from run to run; 1 at least."""
    k, n = float(events.sum()), len(events)
    if not k or n < 2:
        return 1.0
    rest = events - k / float(hours.sum()) * hours
    return max(n / (n - 1) * float(rest @ rest) / k, 1.0)


def poisson(k, confidence):
    """One-sided bounds of the mean of a Poisson variable of which k came: least, most. Garwood (1936)."""
    from scipy.stats import chi2

    least = 0.5 * float(chi2.ppf(1.0 - confidence, 2 * k)) if k else 0.0
    return least, 0.5 * float(chi2.ppf(confidence, 2 * k + 2))


def extrapolated(over, hours):
    """Rate per hour at which errors would exceed their level if the tail went on, and its upper bound.

    The distribution of the squares of error over level is Gumbel's, by moments. In its scale the level is
    a above its place, and is exceeded exp(-a) times a run. Were a known, mean + z deviation of a sample would
    be below it with a probability that depends on z and the size of the sample alone: the bound takes the a
    at which that of the z that was found is 1 - CONFIDENCE.

    over : (n,) largest error over its level of each run, n > 1;  hours : (n,) usable in it
    -> rate, bound at CONFIDENCE; None, None of errors that are all alike
    """
    square, per_hour = over**2, 1.0 / float(hours.mean())
    deviation = float(square.std(ddof=1))
    if not deviation > 0.0:
        return None, None
    z = (1.0 - float(square.mean())) / deviation
    likely = np.euler_gamma + z * math.pi / math.sqrt(6.0)
    means, deviations = _of_gumbel(len(over))
    least = float(np.quantile(means + z * deviations, 1.0 - CONFIDENCE))
    return tuple(math.exp(min(-a, 50.0)) * per_hour for a in (likely, least))


@cache
def _of_gumbel(n):
    """Mean and deviation of drawn samples of n of Gumbel's standard distribution: (SAMPLES,), (SAMPLES,)."""
    size = min(n, LARGEST)
    rows = np.random.default_rng(0).gumbel(size=(SAMPLES, size))
    less = math.sqrt(size / n)  # as they scatter less in larger samples
    found = (rows.mean(axis=1), np.euler_gamma), (rows.std(axis=1, ddof=1), math.pi / math.sqrt(6.0))
    return tuple(true + less * (one - true) for one, true in found)


def summary(campaign):
    """The same for `--json`: list of dicts."""
    return [one._asdict() | {"verdict": one.verdict} for one in count(campaign)]
