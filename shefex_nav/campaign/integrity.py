"""Integrity risk: how often errors were beyond their protection level, unnoticed, against what is stated.

Counted are the events of `report.trust`: stretches of more than its time to alert in which a quantity is
usable although its error is beyond its protection level, per hour of the time in which it is usable, over all
runs that flew to their end. Events come as a Poisson process; `most` and `least` bound its rate one-sided at
CONFIDENCE (Garwood 1936). A campaign of T usable hours without an event shows 4.6/T per hour at 99 %: a risk
of 1e-1 or 1e-2 per hour can be counted (`requirements.integrity_risk`, and the levels are made for it), a
smaller one cannot. Of that there is an extrapolation alone: largest error over level of each run, r, whose
square has the tail of an exponential if errors are normal, so that its maximum over a run is Gumbel's. It
says how often r would exceed 1 if the tail goes on like the body, and knows nothing of faults not flown.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.records import QUANTITIES

CONFIDENCE = 0.99
FEWEST_RUNS = 20  # [E] for a tail
BOOTSTRAPS = 200
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
    least, most = poisson(k, CONFIDENCE)
    used = np.isfinite(over)
    worst = int(np.nanargmax(over)) if used.any() else None
    tail = extrapolated(over[used], hours[used]) if used.sum() >= FEWEST_RUNS else (None, None)
    return Counted(
        quantity, total, k, k / total, least / total, most / total, risk,
        None if worst is None else float(over[worst]), None if worst is None else int(runs[worst]), *tail,
    )  # fmt: skip


def poisson(k, confidence):
    """One-sided bounds of the mean of a Poisson variable of which k came: least, most. Garwood (1936)."""
    from scipy.stats import chi2

    least = 0.5 * float(chi2.ppf(1.0 - confidence, 2 * k)) if k else 0.0
    return least, 0.5 * float(chi2.ppf(confidence, 2 * k + 2))


def extrapolated(over, hours):
    """Rate per hour at which errors would exceed their level if the tail went on, and its upper bound.

    over : (n,) largest error over its level of each run;  hours : (n,) usable in it
    -> rate, bound at CONFIDENCE of a bootstrap over the runs
    """
    rng, n = np.random.default_rng(0), len(over)
    rates = [_rate(over[rng.integers(0, n, n)]) for _ in range(BOOTSTRAPS)]
    per_hour = 1.0 / float(hours.mean())
    return _rate(over) * per_hour, float(np.quantile(rates, CONFIDENCE)) * per_hour


def _rate(over):
    """Mean number of times in a run that the square of error over level exceeds one: Gumbel, by moments."""
    square = over**2
    scale = math.sqrt(6.0) / math.pi * float(square.std(ddof=1))
    if not scale > 0.0:
        return 0.0 if square[0] < 1.0 else math.inf
    return math.exp(min((float(square.mean()) - np.euler_gamma * scale - 1.0) / scale, 50.0))


def summary(campaign):
    """The same for `--json`: list of dicts."""
    return [one._asdict() | {"verdict": one.verdict} for one in count(campaign)]
