"""Protection level: how wrong the attitude may be without anyone on board noticing, against what is required.

About each body axis

    level = k sigma + w

k sigma is what the known errors do, k such that a normal error exceeds it with the probability that the
mission accepts. w is what a single wrong fix could do that the gate lets through: an innovation z passes if
z^T S^-1 z <= T^2, it moves the state by K z, and the worst of them moves axis j by

    w_j = T sqrt((K S K^T)_jj) = T sqrt(P_jj(before) - P_jj(after)),

the slope of the error over the test statistic times the limit of the test, as in receiver autonomous
integrity monitoring (Brown and Chin 1998; for Kalman filters Joerger and Pervan, JGCD 36 (2013)). Later fixes
take the wrong one out again at the rate at which they would reduce any error, P(after)/P(before), so w is the
worst over all fixes so far of what is left of each. A fix that has been confirmed by a second one through the
gyros can only be wrong by what that comparison lets through, T sqrt(2 R).

Two faults at once, and one that is common to all fixes (a star camera that has moved by less than the gate
notices), are beyond this.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.onboard.navigation.state import ATT
from shefex_nav.records import Doubt


class Requirement(NamedTuple):
    """What the mission asks of the attitude."""

    attitude: float  # rad, each axis
    k: float  # sigmas, of the accepted probability


class Level(NamedTuple):
    """Running protection level."""

    undetected_b: np.ndarray  # (3,) rad, w of the module's text


NO_FIX = Level(np.zeros(3))


def requirement(attitude, risk):
    """Requirement for an accepted probability `risk` that a normal error exceeds k sigma."""
    from scipy.special import ndtri

    return Requirement(attitude, float(-ndtri(0.5 * risk)))


def after_fix(level, P_before, P_after, limit, R_confirmed=None):
    """Level after a measurement has been used.

    Parameters
    ----------
    level : Level
    P_before, P_after : (n, n) of the filter, at the instant of the measurement
    limit : of its gate, chi-square
    R_confirmed : (3, 3) rad^2 of a star fix, body axes, if a second one has confirmed it

    Returns
    -------
    Level
    """
    before, after = np.diag(P_before)[ATT], np.diag(P_after)[ATT]
    new = np.sqrt(limit * np.maximum(before - after, 0.0))
    if R_confirmed is not None:
        new = np.minimum(new, np.sqrt(2.0 * limit * np.diag(R_confirmed)))
    left = level.undetected_b * np.minimum(after / before, 1.0)
    return Level(np.maximum(left, new))


def of_attitude(level, wanted, sigma_b):
    """Protection level (3,) rad for the standard deviations (3,) rad of the attitude."""
    return wanted.k * sigma_b + level.undetected_b


def doubt(protection_b, wanted, contradicted, imu_blind):
    """Doubt about a solution, the gravest first. (3,) rad, Requirement, bool, bool -> Doubt"""
    if imu_blind:
        return Doubt.IMU
    if contradicted:
        return Doubt.CONTRADICTED
    # not "greater": a level that is not a number must not pass
    return Doubt.NONE if bool(np.all(protection_b <= wanted.attitude)) else Doubt.ATTITUDE
