"""What a requirement says of predicted errors: within which limit the stated share of flights stays.

Navigation errors at entry and the largest while pointing are predicted; protection levels, usability, star
fixes and all that the vehicle does are not.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.report import requirements as judging
from shefex_nav.verify.trade import pointing, within
from shefex_nav.verify.trade.predict import ENTRY, POINTING

FIELDS = {  # quantity: field of Errors, how its limit is meant
    "position": ("position_i", within.length),
    "velocity": ("velocity_i", within.length),
    "attitude": ("attitude_b", within.axes),
}
PREDICTED = {  # requirement: when, quantity
    **{f"{name}_at_entry": (ENTRY, name) for name in FIELDS},
    **{f"{name}_while_pointing": (POINTING, name) for name in FIELDS},
}


class Judged(NamedTuple):
    """A requirement and a prediction."""

    name: str
    limit: float  # in `unit`, as the next two
    found: float | None  # the stated share of flights is within it; None: no entry, or it never points
    sigma: float | None  # of the whole error; of an attitude, of its largest axis
    unit: str
    share: float | None  # of the flights within the limit

    @property
    def k(self):
        """`found` in sigmas."""
        return self.found / self.sigma if self.sigma else None

    @property
    def used(self):
        """Share of the limit that is used up."""
        return float("inf") if self.found is None else self.found / self.limit

    @property
    def met(self):
        """Whether the stated share of flights is within the limit."""
        return self.used <= 1.0


def judge(requirements, prediction):
    """list of Judged, of what a scenario requires and a covariance can say. Requirements, Prediction"""
    limits = judging.limits(requirements)
    return [
        _judged(name, limits[name], prediction, requirements.probability)
        for name in PREDICTED
        if name in limits
    ]


def unpredicted(requirements):
    """Names of what is required and a covariance says nothing of: list."""
    return [name for name in judging.limits(requirements) if name not in PREDICTED]


def _judged(name, limit, prediction, share):
    what, quantity = PREDICTED[name]
    (field, probability), measure = FIELDS[quantity], judging.MEASURES[name]
    errors = prediction.at(what)
    if errors is None:
        return Judged(name, limit, None, None, measure.unit, None)
    P = getattr(errors, field)
    variances = np.diag(P) if probability is within.axes else np.linalg.eigvalsh(P)
    sigma = sqrt(max(variances)) if probability is within.axes else sqrt(sum(variances))
    inside, within_limit = share, probability(variances, limit / measure.factor)
    if what == POINTING:
        drawn = prediction.while_pointing
        of_time = pointing.together(probability, variances, getattr(drawn, quantity), drawn.instants)
        inside, within_limit = of_time.at_once(share), of_time.of_all(within_limit)
    found = within.least_limit(probability, inside, variances)
    return Judged(
        name,
        limit,
        found * measure.factor,
        sigma * measure.factor,
        measure.unit,
        within_limit,
    )
