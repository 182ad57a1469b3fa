"""What is owed for axes of the IMU that are not read: by force that turns gyros, and by gaps in a row.

**Force.** Gyros that answer to it, by G, turn the attitude while it is not read. An accelerometer axis that
cannot be read is off by a force m, and the rate by sigma_G m about each axis. Both last: the angle grows as
sigma_G u, u the integral of m, and not as the root of the time. Since m was known last, m_0 at the time 0,
it has run away by the rate c at most, and it is at most s, of what a sensor of that range is made for. Over
the last t of a time T since then

    u(t) = t min(s, m_0 + c (tau + T - t/2)),        angle^2 = sigma_G^2 u^2,     tau as in `integrity_imu`.

A reading that is held was right at first, m_0 = 0; one at the end of its range may be off by all of that. A
peak of vibration there is none of these.

- **A star fix** says the angle, from which it counts again, as if a second old: the filter follows an error
  that lasts with a lag, which white noise of the time between two fixes alone would not cover. What GPS has
  shown of that second, m_0 times it, stays shown.
- **A GPS velocity** says u since the one before: it is what the velocity has been corrected by along the roll
  axis, p. These errors are of one sign as G is, so they count as one, (sum of |p|)^2, and m_0 is |p| over the
  time, or where one was known before, a mean over tau if that is longer. Across the roll axis a spin turns
  the force, of which GPS shows less than the gyros sense; there nothing is taken from it.

The charge is made on the attitude alone: which sign it has, an unknown G does not say.
"""

import numpy as np

from shefex_nav.compiled import inner, rows
from shefex_nav.onboard.navigation.integrity_readings import MEAN_S

FOLLOWED_S = 1.0  # [E] of an angle that lasts, as a filter with ten star fixes a second follows it
LIT = 4.0  # [E] c over `ImuRules.change`: a motor is lit faster than thrust changes while it burns
OF_RANGE = 3.0  # [E] sigmas of specific force in the range of a sensor that was chosen for it
ROLL = 0  # the axis whose force keeps its direction

FORCE = rows(
    [
        ("lasting_s", float),  # for which the angle has grown since it was known
        ("known_s", float),  # since m was
        ("before", float),  # m/s^2, m_0; inf: unknown
        ("shown", float),  # m/s, sum of |p| so far, to which the next |p| is added before squaring
        ("owed", float),  # m^2/s^2, by what (sum of |p|)^2 has grown since the last block: the next adds it
    ]
)


@inner(forceinline=True)
def begin(force, held):
    """An axis is not read any more. held : whether it is given a reading that was right then"""
    force.lasting_s = force.known_s = 0.0
    force.before = 0.0 if held else np.inf
    force.shown = force.owed = 0.0


@inner(forceinline=True)
def added(force, most, change, duration_s):
    """u^2 that is to be added, m^2/s^2, after a further time in which the axis was not read.

    most : m/s^2, s of the module's text;  change : m/s^3, c over LIT
    """
    u2 = squared(force.lasting_s, force.known_s, force.before, most, change)
    force.lasting_s += duration_s
    force.known_s += duration_s
    return squared(force.lasting_s, force.known_s, force.before, most, change) - u2


@inner(forceinline=True)
def paid(force):
    """What is owed, m^2/s^2, for a block that gives it to the filter; from now on nothing is."""
    owed = force.owed
    force.owed = 0.0
    return owed


@inner(forceinline=True)
def squared(lasting_s, known_s, before, most, change):
    """u^2 of the module's text, m^2/s^2: t, T, m_0, s; c over LIT."""
    return (lasting_s * min(most, before + LIT * change * (MEAN_S + known_s - 0.5 * lasting_s))) ** 2


@inner(forceinline=True)
def largest(rules, at_end):
    """s of an accelerometer axis, m/s^2, by (5, 2) `ImuRules`; at_end: its readings are at the end."""
    limit, wrong = rules[1, 1], rules[4, 1] if at_end else rules[2, 1]
    if not np.isfinite(limit):
        return wrong
    return max(wrong, limit if at_end else limit / OF_RANGE)


# ----------------------------------------------------------------------------------------------------------
# Gaps in the readings of an axis that follow each other: what they have missed may add up with one sign.
#
# A mean that is held lags behind a rate that grows, in every gap to the same side. Charged one by one, as of
# errors that know nothing of each other, every second block lost for 27 s of a spin-up by 0.42 rad/s^2 was 35
# sigma: 62 deg. By the readings before and after a gap the mean was off by d on average. So
#
#     S <- S exp(-t/T) + d (time without readings),     V <- V exp(-2t/T) + (what is charged),     T = SIGN_S
#
# and at the end of a gap as much more is charged as V is less than S^2. Of readings that vibrate d has
# either sign, and S^2 stays below V. A fix says the sum so far, but of the last second: a filter follows an
# error that lasts with a lag as above.


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
