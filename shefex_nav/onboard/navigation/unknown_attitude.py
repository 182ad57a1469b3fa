"""Attitude that is hardly known: what the linear error model leaves out when its errors are no small angles.

Linear prediction holds for errors of the attitude up to a few degrees. Beyond, five things are put right,
each by more uncertainty than it may need, never by less.

**An angle is known modulo a turn.** A variance of more than pi^2/3, that of an angle of which nothing is
known, means nothing. It is taken back to that, and its ties to all other errors are cut: after more than a
turn they say nothing any more.

**A missed roll loses the direction of the axis, too.** While the rate about an axis k is not known, as of a
gyro at the end of its range, the rate w across is measured in a frame that turns away. The axis then moves
by w in an unknown direction: its error grows by |w| T in a time T, in one direction, not as noise. What is
known of one direction across better than of the other is lost: the three angles of a rotation by a and a
small one across it are those of the small one turned by a/2.

**Specific force in an unknown direction.** To second order in the error theta the velocity gains

    C (theta x dv + theta x (theta x dv)/2)

of which the model has the first term. The second keeps its direction as long as the force does. It is counted
as an error of the size s = |theta| |theta x dv|/2, never more than 2 |dv|, in the direction of the error that
the velocity has already: sigma grows by s until a fix takes it back. The smoother is linear about the flight
itself and needs none of this.

**What a vector shows of an angle.** GPS shows how the specific force is turned: the sine of the error, not
the error. Of a normal angle with variance s^2 the sine says exp(-s^2/2) of what the angle would say. So much
of the correction is taken, and the covariance falls by the square of it (`believed`).

**A lever arm in an unknown direction.** What GPS sees of it has a second order, too,
theta x (theta x l)/2. It is the same in every fix, so the mean of many fixes is no better than one. It counts
as noise `ALIKE` times as large as it is.
"""

import numpy as np

from shefex_nav.compiled import inner
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.navigation.state import ATT, VEL

LARGE2 = 0.05**2  # [E] rad^2: below, the second order is less than a fortieth of the first
UNKNOWN2 = np.pi**2 / 3.0  # rad^2, variance of an angle of which nothing is known
MARGIN = 1.05  # of that variance, before ties are cut
ALIKE = 10.0  # [E] square root of the number of fixes with the same error


@inner(forceinline=True)
def widen(P, angle, speed):
    """Make a covariance after an interval as large as the module's text says, in place.

    P : (n, n);  angle, speed : rad, m/s, three numbers each, passed through in the interval, body axes
    """
    a = ATT.start
    _add_second_order(P, speed)
    for k in range(3):
        if P[a + k, a + k] > MARGIN * UNKNOWN2:
            _cut(P, a + k)
            _lose_axis(P, k, angle)
            _lose_direction(P, k)


@inner
def _add_second_order(P, speed):
    """Noise of velocity for the second order of the attitude's error, in place."""
    a = ATT.start
    if max(P[a, a], P[a + 1, a + 1], P[a + 2, a + 2]) <= LARGE2:
        return
    trace, along = 0.0, 0.0
    for i in range(3):
        trace += P[a + i, a + i]
        for j in range(3):
            along += speed[i] * P[a + i, a + j] * speed[j]
    gained2 = t3.dot(speed, speed)
    across = max(trace * gained2 - along, 0.0)  # mean square of theta x dv
    size = np.sqrt(min(0.25 * trace * across, 4.0 * gained2))
    for i in range(VEL.start, VEL.stop):
        P[i, i] += size * (2.0 * np.sqrt(P[i, i]) + size)


def believed(P):
    """Share of what GPS says of the attitude that is taken, each axis (3,); None: all of it. P : (n, n)"""
    variance = P[ATT, ATT].diagonal()
    return np.exp(-0.5 * variance) if variance.max() > LARGE2 else None


def of_arm(P, arm_b):
    """Variance of each axis of what is not linear of a vector in body axes: 0 while the attitude is known.

    P : (n, n);  arm_b : (3,) of any unit -> float, its square
    """
    P_theta = P[ATT, ATT]
    if P_theta.diagonal().max() <= LARGE2:
        return 0.0
    trace, length2 = float(np.trace(P_theta)), float(arm_b @ arm_b)
    across = max(trace * length2 - float(arm_b @ P_theta @ arm_b), 0.0)
    return ALIKE**2 * min(0.25 * trace * across, 4.0 * length2)


@inner
def _cut(P, k):
    """Nothing is known of error k any more, an angle, nor of its ties to others. In place."""
    for j in range(P.shape[0]):
        P[k, j] = P[j, k] = 0.0
    P[k, k] = UNKNOWN2


@inner
def _lose_axis(P, k, angle):
    """Axis k moves in an unknown direction, by the angle that was turned across it. In place."""
    a, moved2 = ATT.start, 0.0
    for i in range(3):
        if i != k:
            moved2 += angle[i] ** 2
    moved = np.sqrt(moved2)
    for i in range(3):
        if i != k:
            P[a + i, a + i] += moved * (2.0 * np.sqrt(P[a + i, a + i]) + moved)


@inner
def _lose_direction(P, k):
    """Of the two axes across axis k the one is known no better than the other. In place."""
    i, j = ATT.start + (k + 1) % 3, ATT.start + (k + 2) % 3
    half, tie = 0.5 * (P[i, i] - P[j, j]), P[i, j]
    largest = 0.5 * (P[i, i] + P[j, j]) + np.sqrt(half * half + tie * tie)
    P[i, i] = P[j, j] = largest
    P[i, j] = P[j, i] = 0.0
