"""An attitude of which one angle is hardly known: filters, each sure of another angle, until one is right.

The error model is linear, so one filter with a heading that may be anything converges to wrong headings and
believes them. Here the angle's range is divided among filters, each with a part that is small enough for it.
All get the same measurements; what is improbable for one of them takes weight from it,

    ln w_k <- ln w_k - TEMPER (min(nis, MOST_NIS) + ln det S)/2,

nis and S being those of the innovation before the gate (multiple-model estimation, Bar-Shalom, Li and
Kirubarajan, Estimation with Applications to Tracking and Navigation, 11.6.2). Measurements are less
independent than a likelihood takes them to be, and one wrong fix must not decide: hence TEMPER and MOST_NIS.
It is settled when the filters that have weight agree: mean and covariance of the mixture are then those of a
single filter, which is started from them.

On board a Bank stands in the place of the filter: tick by tick all its filters get the same, the one with
most weight stands for them towards the star tracker, and what is told is the mixture of all.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import rotation
from shefex_nav.geometry.elementary import exp, log
from shefex_nav.onboard.navigation import fusion, ticks
from shefex_nav.onboard.navigation.history import History, Tick
from shefex_nav.onboard.navigation.state import ATT, BG, POS, VEL, X_BG, X_Q, X_R, X_V
from shefex_nav.records import Alignment

WIDE = np.radians(20.0)  # [E] sigma of an angle beyond which one linear filter cannot start
UNKNOWN = np.pi / np.sqrt(3.0)  # rad, sigma of an angle of which nothing is known
MEMBERS = 16  # [E] on a full turn
WIDER = 1.5  # [E] sigma of a member over that of an even distribution in its part: the parts overlap
TEMPER = 0.5  # [E] exponent of the likelihood
MOST_NIS = 25.0  # [E] of one measurement: each can take a factor of 500 at most
LEAST = 1e-9  # weight below which a member is given up
CLOSE = np.radians(
    30.0
)  # [E] members further from the best one than that, and than 4 sigma, are another answer
OTHERS = 1e-4  # [E] weight that other answers may have
NARROW = np.radians(12.0)  # [E] sigma of the mixture's attitude at which it is settled, each axis
APART = 2.0  # factor by which blocks of a covariance grow when the ties between two of them are cut


KNOWN = BG.stop  # errors that the mixture knows


class Part(NamedTuple):
    """What one of the filters starts from."""

    alignment: Alignment
    weight: float


class Member(NamedTuple):
    """A filter; its weight stands in the Bank, under its number."""

    nav: fusion.Filter
    number: int


def wide_angles(alignment):
    """How many angles of an attitude are too little known for one filter: 0 to 3. `split` takes one."""
    rounding = 1.0 + 1e-9
    return int(np.sum(np.linalg.eigvalsh(alignment.P_theta_b) > rounding * WIDE**2))


def is_wide(alignment):
    """Whether an attitude is too little known for one filter."""
    return wide_angles(alignment) > 0


def split(alignment):
    """Parts of an Alignment along the angle that is known least. ValueError if a second one is not known."""
    if wide_angles(alignment) > 1:
        raise ValueError("two angles of the attitude are not known")
    variances, axes = np.linalg.eigh(alignment.P_theta_b)
    u, sigma = axes[:, 2], float(np.sqrt(variances[2]))
    step = 2.0 * np.pi / MEMBERS
    if sigma >= 0.9 * UNKNOWN:
        places = np.arange(MEMBERS) * step
        weights = np.full(MEMBERS, 1.0 / MEMBERS)
    else:
        most = min(int(np.ceil(3.0 * sigma / step)), MEMBERS // 2 - 1)
        places = np.arange(-most, most + 1) * step
        weights = exp(-0.5 * (places / sigma) ** 2)
    own = WIDER * step / np.sqrt(12.0)
    known = _known_better(alignment, u, own**2 / variances[2])
    return [
        Part(_rotated(known, angle * u), weight / weights.sum())
        for angle, weight in zip(places, weights, strict=True)
    ]


def _known_better(alignment, u, share):
    """Alignment of which a `share` of the variance along u is left, a principal axis of it.

    What the biases are, given the attitude, stays as it was.
    """
    less = (share - 1.0) * np.outer(u, u)
    P_theta_b, P = alignment.P_theta_b + less @ alignment.P_theta_b, alignment.P_with_biases.copy()
    if len(P):
        P[:3] += less @ P[:3]
        P[3:, :3] = P[:3, 3:].T
    return alignment._replace(P_theta_b=0.5 * (P_theta_b + P_theta_b.T), P_with_biases=P)


def _rotated(alignment, turn_b):
    """Alignment turned by (3,) rad in body axes; its covariance is given in the axes before."""
    C = rotation.dcm_from_rotvec(turn_b)
    q_ib = rotation.quat_multiply(alignment.q_ib, rotation.quat_from_rotvec(turn_b))
    P = alignment.P_with_biases
    if len(P):  # the biases are alike in all axes: what ties them to the attitude turns with it
        C_3 = np.kron(np.eye(3), C)
        P = C_3.T @ P @ C_3
    return alignment._replace(q_ib=q_ib, P_theta_b=C.T @ alignment.P_theta_b @ C, P_with_biases=P)


def start(params, alignment, earth):
    """Filter of the best member, and the Bank; a filter of its own and None where one is enough.

    NavParams, Alignment, EarthRotation -> fusion.Filter, Bank or None
    """
    if not is_wide(alignment):
        return fusion.start(params, alignment, earth), None
    bank = Bank(params, alignment, earth)
    return bank.best, bank


class Bank:
    """Filters from the parts of one alignment; changed in place.

    members : list of Member, those that have weight
    logs : (n,) logarithms of the weights of all parts, but for a constant
    """

    def __init__(self, params, alignment, earth):
        parts, blind = split(alignment), {aid.name for aid in params.aids if not aid.sees_attitude}
        self.logs = log([part.weight for part in parts])
        self.members = [
            Member(fusion.start(params, part.alignment, earth, judged=self._judge(k, blind)), k)
            for k, part in enumerate(parts)
        ]

    def _judge(self, k, blind):
        def judged(name, S, nis):
            if name not in blind:
                self.logs[k] -= 0.5 * TEMPER * (min(nis, MOST_NIS) + float(np.linalg.slogdet(S)[1]))

        return judged

    @property
    def weights(self):
        """(m,) of the members, their sum is one."""
        logs = self.logs[[member.number for member in self.members]]
        weights = exp(logs - logs.max())
        return weights / weights.sum()

    @property
    def best_member(self):
        """The Member with most weight."""
        return self.members[int(np.argmax(self.weights))]

    @property
    def best(self):
        """Its fusion.Filter."""
        return self.best_member.nav

    def prune(self):
        """Give up the members that have no weight left."""
        self.members = [
            member for member, weight in zip(self.members, self.weights, strict=True) if weight > LEAST
        ]

    def advance(self, blocks, k):
        """One tick on with all filters. blocks : ImuBlock of arrays, of which row k is meant"""
        for member in self.members:
            ticks.advance(member.nav, blocks, k, k + 1)

    def fuse(self, arrived):
        """Give all filters what has arrived. -> list of GateResult of the one that is best afterwards"""
        results = {member.number: fusion.take(member.nav, arrived) for member in self.members}
        self.prune()
        return results[self.best_member.number]

    def settled(self):
        """Filter that goes on where the filters agree; None if they do not."""
        mixture, best = self.mixture(), self.best
        return fusion.start(best.params, mixture.alignment(), best.earth) if mixture.is_settled else None

    def mixed_filter(self):
        """Filter that holds the mixture at the last tick, to be told of; not to be advanced."""
        best = self.best
        tick = best.history[-1]
        P = tick.P.copy()
        P[:KNOWN] = 0.0
        P[:, :KNOWN] = 0.0
        P[:KNOWN, :KNOWN] = self.mixture().about_best
        driving = best.history.drives.shape[2]
        return best._replace(history=History(Tick(tick.t_s, tick.x, P, tick.imu), driving=driving))

    def mixture(self):
        """Mean and covariance of the members at their last tick: Mixture."""
        weights = self.weights
        best = self.members[int(np.argmax(weights))].nav.history
        d = np.array([_difference(best.x, member.nav.history.x) for member in self.members])
        mean = weights @ d
        P = np.zeros((KNOWN, KNOWN))
        for weight, away, member in zip(weights, d - mean, self.members, strict=True):
            P += weight * (member.nav.history.P[:KNOWN, :KNOWN] + np.outer(away, away))
        far = np.linalg.norm(d[:, ATT], axis=1)
        own = np.sqrt([np.linalg.eigvalsh(member.nav.history.P[ATT, ATT])[-1] for member in self.members])
        others = float(weights[far > np.maximum(CLOSE, 4.0 * own)].sum())
        return Mixture(float(best.ends_s[-1]), best.x.copy(), mean, P, others)


class Mixture(NamedTuple):
    """Mean and covariance of several filters."""

    t_s: float
    x: np.ndarray  # packed values of the member with most weight
    mean: np.ndarray  # (12,) error of that: position, velocity, attitude, gyro bias
    P: np.ndarray  # (12, 12)
    others: float  # weight of members that are another answer

    @property
    def about_best(self):
        """Mean square of the error of the best member, ties included: (12, 12)."""
        return self.P + np.outer(self.mean, self.mean)

    @property
    def sigma(self):
        """Largest sigma of the attitude [rad]."""
        return float(np.sqrt(np.linalg.eigvalsh(self.P[ATT, ATT])[-1]))

    @property
    def is_settled(self):
        """Whether one filter can go on from it."""
        return self.others < OTHERS and self.sigma < NARROW

    def alignment(self):
        """Alignment for one filter. It has no ties between attitude and gyro bias, so both count for more."""
        q_ib = rotation.quat_multiply(self.x[X_Q], rotation.quat_from_rotvec(self.mean[ATT]))
        sigma_r, sigma_v, sigma_g = (
            float(np.sqrt(np.linalg.eigvalsh(self.P[block, block])[-1])) for block in (POS, VEL, BG)
        )
        grown = np.sqrt(APART)
        return Alignment(
            self.t_s,
            self.x[X_R] + self.mean[POS],
            self.x[X_V] + self.mean[VEL],
            q_ib,
            grown * sigma_r,
            grown * sigma_v,
            APART * self.P[ATT, ATT],
            self.x[X_BG : X_BG + 3] + self.mean[BG],
            grown * sigma_g,
        )


def _difference(x, other):
    """Error of packed values x if others were true: position, velocity, attitude, gyro bias. -> (12,)"""
    out = np.empty(KNOWN)
    out[POS], out[VEL] = other[X_R] - x[X_R], other[X_V] - x[X_V]
    q = rotation.quat_multiply(rotation.quat_conjugate(x[X_Q]), other[X_Q])
    out[ATT] = rotation.rotvec_from_quat(q)
    out[BG] = other[X_BG : X_BG + 3] - x[X_BG : X_BG + 3]
    return out
