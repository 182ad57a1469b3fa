"""The largest errors of the phases POINTING, by which `report.error_figures` judges a run, predicted.

The largest error over a time is larger than that of the worst instant, the more so the less errors of two
instants have to do with each other: a constant error of the mounting does not add, noise of GPS does. So
histories are drawn that obey the matrices of the covariance (`linear.outputs`). The median of their largest
errors, and how far those above it lie, say how the distribution over the time follows from that at the worst
instant, for rarer errors too (`Together`).
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import sample_s
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.records import Phase
from shefex_nav.verify.bound_model import POS, PSI, VEL

EVERY_S = 1.0  # between two instants that are predicted
HISTORIES = 400
CERTAIN = 1.0 - 1e-15  # probability, beyond which digits end


class Largest(NamedTuple):
    """Largest errors of each history over m instants, (HISTORIES,); attitude: about one axis."""

    instants: int
    position: np.ndarray  # m
    velocity: np.ndarray  # m/s
    attitude: np.ndarray  # rad


def samples(trajectory, every_s=EVERY_S):
    """Samples of a Trajectory at which errors while pointing are predicted: list of int.

    They are multiples of a time, as those of star fixes are: errors are largest just before a fix.
    """
    step = round(every_s / sample_s(trajectory.t_s))
    k = np.arange(step, len(trajectory.t_s), step)
    return k[trajectory.phase[k] == Phase.POINTING].tolist()


def histories(t_s, rng):
    """Arguments of `linear.outputs` for errors at some times; {} of none. (m,) s, Generator"""
    if not len(t_s):
        return {}
    return {"rng": rng, "number": HISTORIES, "between": (float(t_s[0]), float(t_s[-1]))}


def sizes(q_ib, momentary, errors, rng):
    """Size of the errors of position and velocity, and of the largest angle about an axis, of each history.

    q_ib : (4,) truth;  momentary : errors of the moment of velocity and attitude, 1 sigma about each axis
    errors : (n, N) of `linear.Output`;  rng : of these momentary -> (3, N)
    """
    velocity, angle = (one * rng.standard_normal((3, errors.shape[1])) for one in momentary)
    attitude_b = dcm_from_quat(q_ib).T @ errors[PSI] + angle
    return np.array(
        [
            np.linalg.norm(errors[POS], axis=0),
            np.linalg.norm(errors[VEL] + velocity, axis=0),
            np.abs(attitude_b).max(axis=0),
        ]
    )


class Together(NamedTuple):
    """How probable it is that all errors of a time lie within a limit, by that of its worst instant.

    y = -log(-log(probability)). Were k independent instants like the worst one, y would be less by log(k)
    for any limit: largest errors have y of Gumbel's distribution, of scale 1. What instants have in common
    makes the largest errors scatter more: the median is that of few instants, the rare ones are of many.
    """

    middle: float  # y at the worst instant of the median of the largest errors
    scale: float  # of their y; at least 1
    most: float  # log(k) of all instants, beyond which no limit is

    def at_once(self, share):
        """Probability at the worst instant of a limit that all errors of a share of flights are within."""
        y = _y(share)
        rarer = self.middle + self.scale * (y - MEDIAN)
        return math.exp(-math.exp(-min(max(rarer, y), y + self.most)))

    def of_all(self, inside):
        """Share of flights whose errors are all within a limit. inside : its probability at the worst one"""
        if not 0.0 < inside < 1.0:
            return inside
        y = _y(inside)
        return math.exp(-math.exp(-max(min(MEDIAN + (y - self.middle) / self.scale, y), y - self.most)))


def _y(probability):
    return -math.log(-math.log(probability))


MEDIAN = _y(0.5)  # of Gumbel's distribution
UPPER = 1.178747475  # of it, mean of what is above the median, less that: 2 (gamma + E1(ln 2) + ln(ln 2))


def together(probability, variances, largest, instants):
    """Together of largest errors that were drawn.

    probability : of `within`;  variances : (3,) at the worst instant;  largest : (N,);  instants : in all
    """
    middle = float(np.median(largest))
    inside = [probability(variances, one) for one in (middle, *largest[largest > middle].tolist())]
    if len(inside) < 2 or not 0.0 < inside[0] < 1.0:
        return Together(MEDIAN, 1.0, 0.0)
    middle, *above = (_y(min(one, CERTAIN)) for one in inside)
    scale = (math.fsum(above) / len(above) - middle) / UPPER
    return Together(middle, max(scale, 1.0), math.log(instants))
