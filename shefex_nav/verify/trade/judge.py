"""What a requirement says of predicted errors: within which limit the stated share of flights stays.

Navigation errors at entry and the largest while pointing are predicted; protection levels, usability, star
fixes and all that the vehicle does are not. Of a vector the length counts, of an attitude the largest angle
about an axis, as in `report.requirements`.
"""

from math import erf, pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.special import erf as errors

from shefex_nav.report import requirements as judging
from shefex_nav.verify.trade import pointing
from shefex_nav.verify.trade.predict import ENTRY, POINTING

NODES = np.polynomial.legendre.leggauss(40)  # of each of two integrals, and their weights
FARTHEST = 9.0  # sigmas; beyond it there is nothing


def length(variances, limit):
    """Probability that a Gaussian vector is not longer than a limit. (3,) principal variances, float

    The direction of the smallest variance is integrated in closed form; of the other two each by Gauss's rule
    over the angle whose sine is their share of what is left of the limit, which has no edge at its end.
    """
    third, second, first = np.sqrt(np.sort(np.maximum(variances, 0.0)))
    if limit <= 0.0:
        return 0.0
    if first == 0.0:
        return 1.0
    x, weight_x = _nodes(first, np.array(limit))
    left = np.sqrt(np.maximum(limit**2 - x**2, 0.0))
    y, weight_y = _nodes(second, left)
    rest = np.sqrt(np.maximum(left[:, None] ** 2 - y**2, 0.0))

    inside = errors(rest / (sqrt(2.0) * third)) if third > 0.0 else np.ones_like(rest)
    return float(min(1.0, weight_x @ (weight_y * inside).sum(axis=1)))


def _nodes(sigma, limit):
    """Places within +-limit and their weights of a normal distribution: (..., n) twice. limit : (...)"""
    at, weight = NODES
    limit = np.asarray(limit)[..., None]
    if sigma == 0.0:
        return np.zeros(limit.shape), np.ones(limit.shape)
    share = np.minimum(1.0, FARTHEST * sigma / np.maximum(limit, 1e-300))
    widest = np.arcsin(share)
    place = limit * np.sin(widest * at)
    density = np.exp(-0.5 * (place / sigma) ** 2) / (sqrt(2.0 * pi) * sigma)
    return place, density * limit * np.cos(widest * at) * widest * weight


def axes(variances, limit):
    """Probability that no component is larger than a limit, at least: as if independent (Sidak 1967).

    (3,) variances about the axes, float -> float
    """
    found = 1.0
    for variance in variances:
        found *= erf(limit / sqrt(2.0 * variance)) if variance > 0.0 else 1.0
    return found


def least_limit(probability, share, variances):
    """The limit within which a share of errors lies.

    probability : `length` or `axes`;  share : below 1;  variances : (3,)
    """
    from scipy.optimize import brentq

    high = sqrt(max(float(np.sum(variances)), 0.0))
    if high == 0.0:
        return 0.0
    while probability(variances, high) < share:
        high *= 2.0
    return float(
        brentq(lambda limit: probability(variances, limit) - share, 0.0, high, rtol=1e-9, xtol=1e-12 * high)
    )


FIELDS = {  # quantity: field of Errors, how its limit is meant
    "position": ("position_i", length),
    "velocity": ("velocity_i", length),
    "attitude": ("attitude_b", axes),
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
    variances = np.diag(P) if probability is axes else np.linalg.eigvalsh(P)
    sigma = sqrt(max(variances)) if probability is axes else sqrt(sum(variances))
    inside, within_limit = share, probability(variances, limit / measure.factor)
    if what == POINTING:
        drawn = prediction.while_pointing
        of_time = pointing.together(probability, variances, getattr(drawn, quantity), drawn.instants)
        inside, within_limit = of_time.at_once(share), of_time.of_all(within_limit)
    found = least_limit(probability, inside, variances)
    return Judged(
        name,
        limit,
        found * measure.factor,
        sigma * measure.factor,
        measure.unit,
        within_limit,
    )
