"""Attitude that is hardly known: what the linear error model leaves out when its errors are no small angles.

Linear prediction holds for errors of the attitude up to a few degrees, of velocity under a long force
for less. Beyond, six things are put right. Where that is not exact, by more uncertainty than it may need.

**An angle is known modulo a turn.** A variance of more than pi^2/3, that of an angle of which nothing is
known, means nothing. It is taken back to that, and its ties to other errors fall as the mean of exp(i theta)
does. Where it grows past that within a tick, as of a gyro at the end of its range, they are cut.

**A missed roll loses the direction of the axis, too.** While the rate about an axis k is not known, as of a
gyro at the end of its range, the rate w across is measured in a frame that turns away. The axis then moves
by w in an unknown direction: its error grows by |w| T in a time T, in one direction, not as noise. What is
known of one direction across better than of the other is lost: the three angles of a rotation by a and a
small one across it are those of the small one turned by a/2.

**Specific force in an unknown direction.** Of a large angle h about an axis u, velocity that is gained
across u is less by 1 - cos h, of which the linear model has nothing. So it is for each of the three axes
about which the angles have no ties. The loss keeps its direction as long as the force does: it is counted
as an error of the size of its mean square, in that direction, added to the sigma that the velocity has
there. A small angle t across u has no such part together with h: C_true = exp(h u) exp(t) C levels with t
whatever h is, and t is what gravity shows. It counts for angles beyond 3 deg, and for smaller ones where a
force that lasts `LASTS` seconds takes more than `SMALL` sigmas from the velocity. An angle of 2 deg takes
0.2 m/s from a burn of 400 m/s. Of a force that turns with the vehicle, as in a spin, the mean counts.

**Specific force that is not read.** While the reading of an accelerometer axis k cannot be trusted, the force
along it is off by an unknown m, of which the filter is given the noise along k alone (`integrity_imu`). Of
the truth C_true = C exp(theta) the velocity lacks, to the second order,

    exp(theta) (f + m e_k) - f  =  theta x f + m e_k + m theta x e_k,

so there is an error across k as well, m theta x e_k. It has no mean, as m and theta know nothing of each
other, and the covariance of theta, turned by e_k, times the variance of m; of a large angle counts the sine,
whose variance is (1 - exp(-2 s^2))/2. Without it a fix that shows no velocity across k would prove that the
attitude is right, by the tie theta x f with an f that is no force. To take f_k out of the tie would not do:
where f is known to lie along the axis of theta, as weight does along that of the heading, its components
cancel each other only together, and the rest would be a tie that is none. m stays the same from fix to fix,
so n fixes say of theta what one says: the error counts `ALIKE` times as large as it is; they teach nothing.

**What a vector shows of an angle.** GPS shows how the specific force is turned. Where the vector is long
enough, its direction tells the angle as a whole (`second_order`). Else it is the sine, not the angle: of a
normal angle with variance s^2 the sine has the variance (1 - exp(-2 s^2))/2 and the tie s^2 exp(-s^2/2) to
the angle, from which follow the best linear gain and the variance that it leaves (statistical linearisation;
Gelb, Applied Optimal Estimation, 1974, section 6.2). No more is taken than by the linear gain (`take_share`).

**A lever arm in an unknown direction.** What GPS sees of it has a second order, too,
theta x (theta x l)/2. It is the same in every fix, so the mean of many fixes is no better than one. It counts
as noise `ALIKE` times as large as it is.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import rotation
from shefex_nav.geometry import triples as t3
from shefex_nav.geometry.elementary import arctan2, exp
from shefex_nav.onboard.navigation import eskf
from shefex_nav.onboard.navigation.state import ATT, POS, VEL

LARGE2 = 0.05**2  # [E] rad^2: below, the second order is less than a fortieth of the first
LASTS = 10.0  # [E] s, of a force, with no velocity fix meanwhile
SMALL = 0.1  # [E] of the sigma of the velocity: what it lacks after that time
UNKNOWN2 = np.pi**2 / 3.0  # rad^2, variance of an angle of which nothing is known
MARGIN = 1.05  # of that variance, before ties are cut
BENT2 = 0.2**2  # [E] rad^2, of an angle below which its second order is less than what GPS sees
SURE = 5.0  # of its sigma: length of a vector from which on its direction is known
ROLL, PITCH, YAW = range(ATT.start, ATT.stop)
ALIKE = 10.0  # [E] square root of the number of fixes with the same error


@inner(forceinline=True)
def widen(P, angle, speed, extra, T, q_ib):
    """Make a covariance after an interval as large as the module's text says, in place.

    P : (n, n);  angle, speed : rad, m/s, three numbers each, passed through in the interval, body axes
    extra : (3, 3) white noise of readings that cannot be trusted, as in `process_noise.of_interval`;  T : s
    q_ib : attitude, four numbers
    """
    a = ATT.start
    for k in range(3):
        if extra[1, k] > 0.0:
            _lose_force(P, k, ALIKE**2 * T * extra[1, k], q_ib)
    for k in range(3):
        if P[a + k, a + k] > MARGIN * UNKNOWN2:
            _cut(P, a + k)
            _lose_axis(P, k, angle)
            _lose_direction(P, k)
    if max(P[a, a], P[a + 1, a + 1], P[a + 2, a + 2]) > LARGE2:
        _add_second_order(P, speed, q_ib)
        return
    lasting = _lasting(speed, angle, T)
    if _is_bent(P, lasting, T):
        _add_second_order(P, lasting, q_ib)


@inner(forceinline=True)
def _lasting(speed, angle, T):
    """What of a velocity gained in T keeps its direction for `LASTS`: across the axis of a turn, its mean.

    That of a vector that turns at a rate w is 2 / (w LASTS) of it at most. -> three numbers, body axes
    """
    turned = np.sqrt(t3.dot(angle, angle))
    share = 1.0 if turned * LASTS <= 2.0 * T else 2.0 * T / (turned * LASTS)
    along = (1.0 - share) * t3.dot(speed, angle) / (turned * turned) if share < 1.0 else 0.0
    return t3.plus(t3.scaled(share, speed), along, angle)


@inner(forceinline=True)
def _is_bent(P, speed, T):
    """Whether what the velocity lacks by the second order of small angles counts beside its sigma.

    Of a velocity d the mean loss along it is (trace P - d P d / d^2) |d| / 2, that of T goes on for `LASTS`.
    """
    a, v = ATT.start, VEL.start
    length2 = t3.dot(speed, speed)
    if length2 == 0.0:
        return False
    along = _form(P, a, speed)
    lost = 0.5 * (P[a, a] + P[a + 1, a + 1] + P[a + 2, a + 2] - along / length2) * LASTS / T
    least = min(P[v, v], P[v + 1, v + 1], P[v + 2, v + 2])
    return lost * lost * length2 > SMALL * SMALL * least


@inner(forceinline=True)
def _form(P, first, u):
    """u^T P u of the block (3, 3) of P that begins at error `first`."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += u[i] * P[first + i, first + j] * u[j]
    return total


@inner
def _lose_force(P, k, variance, q_ib):
    """Velocity across accelerometer axis k, whose readings are off by `variance`, m^2/s^2. In place.

    theta x e_k = theta_j e_i - theta_i e_j with i, j, k in the order of the axes.
    """
    a, v, i, j = ATT.start, VEL.start, (k + 1) % 3, (k + 2) % 3
    x, y = _sine_share(P[a + i, a + i]), _sine_share(P[a + j, a + j])
    first, second = variance * y * y * P[a + j, a + j], variance * x * x * P[a + i, a + i]
    both = -variance * x * y * P[a + i, a + j]
    C = t3.dcm_from_quat(q_ib)
    for m in range(3):
        for n in range(m + 1):
            added = first * C[3 * m + i] * C[3 * n + i] + second * C[3 * m + j] * C[3 * n + j]
            added += both * (C[3 * m + i] * C[3 * n + j] + C[3 * m + j] * C[3 * n + i])
            P[v + m, v + n] = P[v + n, v + m] = P[v + m, v + n] + added


@inner(forceinline=True)
def _sine_share(variance):
    """Standard deviation of the sine of a normal angle over that of the angle."""
    return np.sqrt(-0.5 * np.expm1(-2.0 * variance) / variance) if variance > 0.0 else 1.0


@inner
def _add_second_order(P, speed, q_ib):
    """Noise of velocity for the second order of the attitude's error, in place."""
    values, axes = np.linalg.eigh(np.ascontiguousarray(P[ATT, ATT]))
    for k in range(3):
        if values[k] <= 0.0:
            continue
        axis = axes[0, k], axes[1, k], axes[2, k]
        _lose_across(P, values[k], axis, speed, q_ib)
        if values[k] > UNKNOWN2:
            _wrap(P, values[k], axis)


@inner
def _lose_across(P, variance, axis, speed, q_ib):
    """A large angle about an axis: what velocity gains across it is less by 1 - cos. In place."""
    small, large = np.expm1(-0.5 * variance), np.expm1(-2.0 * variance)
    lost2 = max(0.5 * large - 2.0 * small, 0.0)  # mean of (1 - cos)^2
    across = t3.quat_rotate(q_ib, t3.plus(speed, -t3.dot(axis, speed), axis))
    gained2 = t3.dot(across, across)
    if gained2 == 0.0:
        return
    v = VEL.start
    known2 = _form(P, v, across)
    # (sigma + size)^2 - sigma^2 along a unit vector, of which `across` is the length
    size, sigma = np.sqrt(lost2), np.sqrt(max(known2, 0.0)) / gained2
    for i in range(3):
        for j in range(3):
            P[v + i, v + j] += size * (2.0 * sigma + size) * across[i] * across[j]


def is_known(P):
    """Whether no angle of the attitude is large. (n, n) -> bool"""
    return P.item(ROLL, ROLL) <= LARGE2 and P.item(PITCH, PITCH) <= LARGE2 and P.item(YAW, YAW) <= LARGE2


def second_order(P, z, H, R, q_ib):
    """What an angle that a vector shows as a whole has done to position and velocity beyond the first order.

    Of an angle h about an axis u the vector d, gained across u, shows sin(h) u x d + (cos(h) - 1) d, both of
    which together tell h without doubt, where the sine alone does not tell h from pi - h. u x d is the tie
    of the angle to position and velocity over its variance. With the second order taken off, a linear update
    finds the angle itself.

    P : (n, n);  z, H, R : (m,), (m, n), (m, m) of a measurement;  q_ib : (4,)
    -> (n,) to be added to the state and taken off z, or None where the vector is too short or the angle small
    """
    if is_known(P):
        return None
    is_long, first, second, across, along = _second_order(P, z, H, R, q_ib)
    if not is_long:
        return None
    angle = arctan2(across, along)
    return (np.sin(angle) - angle) * first + (np.cos(angle) - 1.0) * second


@kernel
def _second_order(P, z, H, R, q_ib):
    """Whether the vector is long enough; first and second order of what the angle does, (n,) each;
    the components of z across the vector and along it."""
    n = len(P)
    first, second = np.zeros(n), np.zeros(n)
    values, axes = np.linalg.eigh(np.ascontiguousarray(P[ATT, ATT]))
    variance, axis_b = values[2], axes[:, 2].copy()
    if variance <= BENT2:
        return False, first, second, 0.0, 0.0
    axis_i = rotation.quat_rotate(q_ib, axis_b)
    for start in (POS.start, VEL.start):
        across = np.ascontiguousarray(P[start : start + 3, ATT]) @ axis_b / variance
        second[start : start + 3] = rotation.cross(across, axis_i)
        first[start : start + 3] = across - (across @ axis_i) * axis_i
    sees, turns = H @ first, H @ second
    length2 = sees @ sees
    noise2 = sees @ (H @ P @ H.T + R) @ sees / max(length2, 1e-300) - variance * length2
    is_long = length2 > SURE**2 * max(noise2, 0.0) and length2 > 0.0
    return is_long, first, second, sees @ z, turns @ z + length2


def take_share(dx, P, updated):
    """Covariance after a vector was seen, and of the estimated error the share that is taken.

    dx : (n,) by the linear model, changed in place
    P, updated : (n, n) before, and after by the linear model. -> (n, n)
    """
    if is_known(P):
        return updated
    turned = _along_axes(P, updated, dx)
    share, after = _by_the_sine(turned.before, turned.after)
    return _taken(turned, share, after, dx)


class Decoupled(NamedTuple):
    """Covariances and an estimated error about the axes about which the angles have no ties to each other."""

    axes: np.ndarray  # (n, n)
    P: np.ndarray  # (n, n)
    updated: np.ndarray  # (n, n)
    along: np.ndarray  # (n,)
    before: np.ndarray  # (3,) variances of the angles of P,
    after: np.ndarray  # (3,) of `updated`


@kernel
def _along_axes(P, updated, dx):
    """Turned. P, updated : (n, n);  dx : (n,)"""
    axes = np.eye(len(P))
    axes[ATT, ATT] = np.linalg.eigh(np.ascontiguousarray(P[ATT, ATT]))[1]
    P, updated, along = axes.T @ P @ axes, axes.T @ updated @ axes, axes.T @ dx
    before, after = np.diag(P)[ATT].copy(), np.diag(updated)[ATT].copy()
    return Decoupled(axes, P, updated, along, before, after)


@kernel
def _taken(turned, share, after, dx):
    """Covariance (n, n) once a share (3,) is taken that leaves the variances `after`; dx (n,) is written."""
    axes, along = turned.axes, turned.along
    updated = eskf.partly(along, turned.P, turned.updated, share)
    for i in range(3):
        k = ATT.start + i
        updated[k, k] = max(updated[k, k], after[i])
    dx[:] = axes @ along
    return axes @ updated @ axes.T


def _by_the_sine(before, after):
    """Share of the linear gain that is best for the sine of an angle, and the variance that it leaves.

    before, after : (3,) variances by the linear model. -> (3,) at most 1, (3,)
    """
    gain = np.clip(1.0 - after / before, 1e-12, 1.0)
    noise2 = before * (1.0 / gain - 1.0)
    sine2, tie = 0.5 * (1.0 - exp(-2.0 * before)), before * exp(-0.5 * before)
    taken = np.minimum(gain, tie / (sine2 + noise2))
    return taken / gain, before + taken**2 * (sine2 + noise2) - 2.0 * taken * tie


def of_arm(P, arm_b):
    """Variance of each axis of what is not linear of a vector in body axes: 0 while the attitude is known.

    P : (n, n);  arm_b : (3,) of any unit -> float, its square
    """
    if is_known(P):
        return 0.0
    P_theta = P[ATT, ATT]
    trace, length2 = float(np.trace(P_theta)), float(arm_b @ arm_b)
    across = max(trace * length2 - float(arm_b @ P_theta @ arm_b), 0.0)
    return ALIKE**2 * min(0.25 * trace * across, 4.0 * length2)


@inner
def _wrap(P, variance, axis):
    """An angle about an axis is known modulo a turn: it loses its ties as it grows beyond. In place."""
    a, n = ATT.start, P.shape[0]
    left = np.exp(0.5 * (UNKNOWN2 - variance)) * np.sqrt(UNKNOWN2 / variance)
    for j in range(n):
        tie = (1.0 - left) * (axis[0] * P[a, j] + axis[1] * P[a + 1, j] + axis[2] * P[a + 2, j])
        for i in range(3):
            P[a + i, j] -= tie * axis[i]
    for j in range(n):
        tie = (1.0 - left) * (axis[0] * P[j, a] + axis[1] * P[j, a + 1] + axis[2] * P[j, a + 2])
        for i in range(3):
            P[j, a + i] -= tie * axis[i]
    spread = UNKNOWN2 - left * left * variance
    for i in range(3):
        for j in range(3):
            P[a + i, a + j] += spread * axis[i] * axis[j]


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
            known = np.sqrt(max(P[a + i, a + i], 0.0))  # below zero by rounding, at most
            P[a + i, a + i] += moved * (2.0 * known + moved)


@inner
def _lose_direction(P, k):
    """Of the two axes across axis k the one is known no better than the other. In place."""
    i, j = ATT.start + (k + 1) % 3, ATT.start + (k + 2) % 3
    half, tie = 0.5 * (P[i, i] - P[j, j]), P[i, j]
    largest = 0.5 * (P[i, i] + P[j, j]) + np.sqrt(half * half + tie * tie)
    P[i, i] = P[j, j] = largest
    P[i, j] = P[j, i] = 0.0
