"""Protection level: how wrong the attitude may be without anyone on board noticing, against what is required.

About each body axis

    level = k sigma + w

k sigma is what the known errors do, k such that a normal error exceeds it with the probability that the
mission accepts. w is what a single wrong fix could do that the gate lets through: an innovation z passes if
z^T S^-1 z <= T^2, it moves the state by K z, and the worst of them moves axis j by

    w_j = T sqrt((K S K^T)_jj) = T sqrt(P_jj(before) - P_jj(after)),

the slope of the error over the test statistic times the limit of the test, as in receiver autonomous
integrity monitoring (Brown and Chin 1998; for Kalman filters Joerger and Pervan, JGCD 36 (2013)). Later fixes
take the wrong one out again at the rate at which they reduce errors, so w is the worst over all fixes so far
of what is left of each. What a star fix has misled is what star fixes measure, attitude and mounting
together, and goes as H P H^T; what another sensor has done to the attitude goes as P. A fix that has been
confirmed by a second one through the gyros can only be wrong by what that comparison lets through,
T sqrt(2 R). And a star fix that passes the gate bounds what other sensors may have done before: had it been
more than 2 T sqrt(S), the gate's T and as much for noise that hides it, the fix would not have passed.

Two faults at once, and one that is common to all fixes (a star camera that has moved by less than the gate
notices), are beyond this.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.onboard.navigation.state import ATT, MOUNTING
from shefex_nav.records import Doubt

NO_DOUBT, TOO_HIGH = int(Doubt.NONE), int(Doubt.ATTITUDE)  # for kernels


class Requirement(NamedTuple):
    """What the mission asks of the attitude."""

    attitude: float  # rad, each axis
    k: float  # sigmas, of the accepted probability


class Level(NamedTuple):
    """Running protection level."""

    stars_b: np.ndarray  # (3,) rad, w of the module's text, of star fixes
    others_b: np.ndarray  # (3,) rad, and of other sensors


NO_FIX = Level(np.zeros(3), np.zeros(3))


def requirement(attitude, risk):
    """Requirement for an accepted probability `risk` that a normal error exceeds k sigma."""
    from scipy.special import ndtri

    return Requirement(attitude, float(-ndtri(0.5 * risk)))


class Slope(NamedTuple):
    """What a wrong fix could have done to the attitude, and what this fix has left of older errors."""

    stars: bool  # of a star fix
    table: np.ndarray  # (5, 3), its rows are the following


WORST = 0  # rad, at the instant of the fix
VARIANCE = 1  # rad^2, of the attitude after it
LEFT = 2  # share of older errors of other sensors
LEFT_STARS = 3  # share of those of star fixes
MOST = 4  # rad, that an older error of other sensors can have been


@kernel
def _slope(P_before, P_after, limit):
    """Table of a `Slope` that says nothing of star fixes."""
    out = np.empty((5, 3))
    for i in range(3):
        k = ATT.start + i
        before, after = P_before[k, k], P_after[k, k]
        out[WORST, i], out[VARIANCE, i] = np.sqrt(limit * max(before - after, 0.0)), after
        out[LEFT, i], out[LEFT_STARS, i], out[MOST, i] = min(after / before, 1.0), 1.0, np.inf
    return out


@inner
def _seen(P, h):
    """Variance of what a row of H sees."""
    total = 0.0
    for j in range(len(h)):
        if h[j] != 0.0:
            for k in range(len(h)):
                total += h[j] * P[j, k] * h[k]
    return total


@kernel
def _slope_of_stars(P_before, P_after, limit, H, R, confirmed):
    """Table of a `Slope` of a star fix."""
    out = _slope(P_before, P_after, limit)
    for i in range(3):
        before = _seen(P_before, H[i])
        if confirmed:
            out[WORST, i] = min(out[WORST, i], np.sqrt(2.0 * limit * R[i, i]))
        out[LEFT_STARS, i] = min(_seen(P_after, H[i]) / before, 1.0)
        out[MOST, i] = 2.0 * np.sqrt(limit * (before + R[i, i]))
    return out


@kernel
def _slope_of_vectors(P_before, P_after, limit, H, R, mounting):
    """Table of a `Slope` of single stars; mounting: its first error, -1 if there is none."""
    out, row = _slope(P_before, P_after, limit), np.empty(P_before.shape[0])
    out[WORST] = _worst_of(P_before, H, R, limit, 2)
    for i in range(3):  # what stars have misled is attitude and mounting together
        row[:] = 0.0
        row[ATT.start + i] = 1.0
        if mounting >= 0:
            row[mounting + i] = 1.0
        out[LEFT_STARS, i] = min(_seen(P_after, row) / _seen(P_before, row), 1.0)
    return out


def slope(P_before, P_after, limit):
    """Slope of a fix of another sensor than the star tracker.

    P_before, P_after : (n, n) of the filter, at the instant of the fix;  limit : of its gate, chi-square
    """
    return Slope(False, _slope(P_before, P_after, limit))


def slope_of_stars(P_before, P_after, limit, H, R, confirmed):
    """Slope of a star fix, whose three rows are about the body axes.

    As `slope`, and
    H, R : (3, n), (3, 3) rad^2, of the fix
    confirmed : whether a second fix agrees with it
    """
    return Slope(True, _slope_of_stars(P_before, P_after, limit, H, R, confirmed))


def slope_of_vectors(layout, P_before, P_after, limit, H, R):
    """Slope of stars that were used and gated one by one, two rows each: of the star that could do worst.

    Star k passes if z_k^T S_kk^-1 z_k <= limit and moves the state by K_k z_k, K_k its columns of the gain,
    so the worst of it about axis j is sqrt(limit (K_k S_kk K_k^T)_jj).

    layout : Layout;  limit : of the gate of one star;  H, R : (2 m, n), (2 m, 2 m);  else as `slope`
    """
    H, R = np.ascontiguousarray(H), np.ascontiguousarray(R)
    return Slope(True, _slope_of_vectors(P_before, P_after, limit, H, R, int(layout.at[MOUNTING])))


@inner
def _worst_of(P, H, R, limit, size):
    """What the worst group of `size` rows can do to the attitude, (3,) rad."""
    PH = P @ H.T
    S = H @ PH + R
    K = np.linalg.solve(S, PH[ATT.start : ATT.stop].T.copy()).T
    worst = np.zeros(3)
    for first in range(0, H.shape[0], size):
        for i in range(3):
            variance = 0.0
            for j in range(first, first + size):
                for k in range(first, first + size):
                    variance += K[i, j] * S[j, k] * K[i, k]
            worst[i] = max(worst[i], np.sqrt(limit * max(variance, 0.0)))
    return worst


@kernel
def _slope_of_ranges(P_before, P_after, limit, H, R):
    """Table of a `Slope` of ranges."""
    out = _slope(P_before, P_after, limit)
    out[WORST] = _worst_of(P_before, H, R, limit, 1)
    return out


def slope_of_ranges(P_before, P_after, limit, H, R):
    """Slope of satellites that were used and gated one by one, a row each: of the one that could do worst.

    limit : of the gate of one satellite;  H, R : (m, n), (m, m);  else as `slope`
    """
    H, R = np.ascontiguousarray(H), np.ascontiguousarray(R)
    return Slope(False, _slope_of_ranges(P_before, P_after, limit, H, R))


def after_fix(level, found, P_now):
    """Level after a fix has been used and the time since then has been taken again.

    What later fixes, used already, do to the effect of a late one is in P: it shrinks as P has since.

    level : Level;  found : Slope;  P_now : (n, n) -> Level
    """
    after = _after_fix(level.stars_b, level.others_b, found.stars, found.table, P_now)
    return Level(after[0], after[1])


@kernel
def _after_fix(stars_b, others_b, of_stars, table, P_now):
    """stars_b and others_b of the next `Level`, the rows of a (2, 3) array."""
    after = np.empty((2, 3))
    for i in range(3):
        variance = P_now[ATT.start + i, ATT.start + i]
        now = table[WORST, i] * np.sqrt(min(variance / table[VARIANCE, i], 1.0))
        after[0, i] = stars_b[i] * table[LEFT_STARS, i]
        after[1, i] = min(others_b[i], table[MOST, i]) * table[LEFT, i]
        if of_stars:
            after[0, i] = max(after[0, i], now)
        else:
            after[1, i] = max(after[1, i], now)
    return after


@inner
def of_axis(stars, others, k, sigma):
    """Protection level of an axis, rad, for the standard deviation of its angle and the slopes of a `Level`.

    k : of the Requirement. What is not a number stays none.
    """
    return k * sigma + max(stars, others) if stars == stars and others == others else np.nan


@inner
def doubt(protection_b, limit, graver):
    """Doubt about a solution. (3,) rad; rad, of the Requirement; Doubt that there is in any case, or NONE"""
    if graver != NO_DOUBT:
        return graver
    for level in protection_b:
        if not level <= limit:  # not "greater": a level that is not a number must not pass
            return TOO_HIGH
    return NO_DOUBT
