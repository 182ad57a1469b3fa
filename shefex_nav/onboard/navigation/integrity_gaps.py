"""Gaps in the readings of an axis that follow each other: what they have missed may add up with one sign.

A mean that is held lags behind a rate that grows, in every gap to the same side. Charged one by one, as of
errors that know nothing of each other, every second block lost for 27 s of a spin-up by 0.42 rad/s^2 was 35
sigma: 62 deg. By the readings before and after a gap the mean was off by d on average. So

    S <- S exp(-t/T) + d (time without readings),     V <- V exp(-2t/T) + (what is charged),     T = SIGN_S

and at the end of a gap as much more is charged as V is less than S^2. Of readings that vibrate d has either
sign, and S^2 stays below V. A fix says the sum so far, but of the last second: a filter follows an error that
lasts with a lag (`integrity_force`).
"""

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.onboard.navigation.integrity_force import FOLLOWED_S

SIGN_S = 10.0  # [E] for how long the error of a sensor that cannot be trusted keeps its sign


@inner(forceinline=True)
def fade(axis, duration_s):
    """The gaps so far are older by the duration of a block."""
    if axis.given > 0.0:
        kept = np.exp(-duration_s / SIGN_S)
        axis.missed *= kept
        axis.given *= kept * kept
        axis.lately *= np.exp(-duration_s / FOLLOWED_S)


@inner(forceinline=True)
def closed(axis, missed, own, ended_s):
    """What is charged beside its own variance for a gap that is over at ended_s, rad^2 or m^2/s^2.

    missed : rad or m/s, by the readings before and after it;  own : its own variance
    """
    axis.missed, axis.lately, axis.ended_s = axis.missed + missed, axis.lately + missed, ended_s
    more = max(axis.missed * axis.missed - axis.given - own, 0.0)
    axis.given += own + more
    return more


def fixed(axes, t_valid_s):
    """A fix of t_valid_s says what the gaps before it have missed. axes : of a triad, changed in place"""
    for axis in axes:
        if axis["given"] > 0.0 and t_valid_s > axis["ended_s"]:
            axis["missed"], axis["given"] = axis["lately"], axis["lately"] ** 2
