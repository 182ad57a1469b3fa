"""Instruments that drift: what a slow error does to the solution, and whether it can be noticed.

A barometer that drifts while nothing else measures the height is followed by the filter: each of its readings
can be believed. So a drift of unit rate that began at the time t_k is carried along beside the filter, one
column k for each of some times. Its readings show s_k = t - t_k, and what the filter has made of it already,
B_k, shows no more (separate bias: Friedland, IEEE TAC 14, 1969)::

    B <- Phi B,    h = s - H B,    B <- B + K h

Innovations of a healthy instrument are white with covariance S, so that over its readings

    J_k = sum h_k^2/S,    y_k = sum h_k z/S,    y_k^2/J_k ~ chi-square, one degree of freedom,

a generalised likelihood ratio test for the onset of a drift (Willsky and Jones, IEEE TAC 21, 1976); its rate
is y_k/J_k. Where it exceeds T^2 the instrument drifts against the solution: it is not used any more, and the
covariance grows by what the drift has done, P + d^2 B_k B_k^T with its rate d. A drift that passes the test
is T/sqrt(J_k) per second at most, and has moved axis j by

    w_j = max over k of  T |B_k|_j / sqrt(J_k).

Readings that are used while the IMU is blind are not judged, for their innovations are not white. The gate G
they passed, each of them alone, so that a drift begun then is G sqrt(S)/h per second at most; where none was
judged or gated, it has no bound.

Where a reading is not linear in what it measures, the worst drift goes further than B says: with f'' of the
reading f, and the rate d that just passes, h = s - H B + d (H B)^2 f''/(2 f'^2), a column for each sign of d.
Of H B only the part by position bends; the whole counts, which is what was flown. The response may still be
wrong by LEFT_OUT of the drift. So h* counts, by what h is more than that, in J and y and where it pulls B
back. Readings show all of h: the rate that is told is y / sum(h h*/S), and what the drift has done is counted
at y/J, which is larger.

w is a part of the protection level (`integrity_protection`). It grows while nothing but the instrument says
what it measures; where GPS says it as well, B stays next to nothing. Readings whose errors last count with
the noise by which they correct the state (`aiding`), which is that of independent errors that add up to as
much.

Phi is that of the errors of position, velocity and attitude, to first order over the time between two
measurements, with what the errors of the inertial sensors and of gravity do to them; all else is constant.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation, wgs84
from shefex_nav.geometry.elementary import exp
from shefex_nav.onboard.navigation import calibration, protected
from shefex_nav.onboard.navigation.integrity import HEALTHY, Fate, chi_square_limit
from shefex_nav.onboard.navigation.measurements import counted_covariance
from shefex_nav.onboard.navigation.quantity import POSITION, about, fix_of
from shefex_nav.onboard.navigation.state import ATT, GRAVITY, POS, VEL, X_Q, X_R, X_V, rearranged

EVERY_S = 10.0  # [E] between two times at which a drift may have begun
MOVED = 3.0  # sigmas that a refused reading may move from the first, and still be that of a new bias
LEFT_OUT = 0.03  # [E] share of a drift that h may be wrong by: the response is not quite that of the filter
MOST = 48  # [E] times that are kept: the older, the further apart


class Followed(NamedTuple):
    """What a drift that was noticed may have done to the errors."""

    done: np.ndarray  # (n,)

    def into(self, own, other):
        """The same for the errors of another Layout; nothing was done to those that it has alone."""
        return Followed(rearranged(self.done, own, other, 0.0))


class Refused(NamedTuple):
    """A reading that the gate refused, against the solution."""

    t_s: float
    z: float
    R: float  # variance of its noise, without what lasts
    steep: float  # change of z with the place, a metre


class Motion(NamedTuple):
    """Of the vehicle when the last measurement was taken in."""

    t_s: float
    v_i: np.ndarray  # (3,) m/s
    C_ib: np.ndarray  # (3, 3)


class Drift:
    """Memory of one instrument, changed in place.

    rule : aid.DriftRule
    starts_s : (k,) s, at which a drift may have begun
    sides : signs of its rate, of a column each
    B : (n, m) what one of unit rate has done to the errors; m columns, those of one start after each other
    J, y, J_told : (m,) sums, the last of h h*/S
    gated : (m,) per second, fastest drift that the gate lets through, of readings that were not judged
    refused : Refused, the first of those in a row, or None
    found : '' or words, once it has been noticed: then nothing is followed any more
    is_disputed : whether nothing but the inertial sensors speaks against it since
    """

    def __init__(self, rule):
        self.rule, self.limit = rule, chi_square_limit(rule.chance, 1)
        self.starts_s, self.B = np.empty(0), None
        self.J, self.y, self.J_told, self.gated = (np.empty(0) for _ in range(4))
        self.sides = np.array([0.0] if rule.bend is None else [1.0, -1.0])
        self.motion, self.refused, self.found, self.is_disputed = None, None, "", False

    def carry(self, nav, now):
        """On to the instant of a measurement, and a new time at which a drift may begin."""
        if self.found:
            return
        if self.B is None:
            self.B = np.zeros((nav.layout.n, 0))
        x, motion = now.x, self.motion
        if motion is not None and now.t_s <= motion.t_s:
            return
        if motion is not None:
            gap = now.t_s - motion.t_s, motion.v_i, motion.C_ib
            _carry(nav.layout.at, self.B, x, gap, now.sensed_packed[:3], now.vibration, now.drive)
        self.motion = Motion(now.t_s, x[X_V].copy(), rotation.dcm_from_quat(x[X_Q]))
        if not self.starts_s.size or now.t_s - self.starts_s[-1] >= EVERY_S:
            self._begin(now.t_s)

    def _begin(self, t_s):
        """A drift may begin at t_s; of the times before, the one that is closest to others goes."""
        starts_s, new = np.append(self.starts_s, t_s), np.zeros(len(self.sides))
        kept = np.ones(len(starts_s), dtype=bool)
        if len(starts_s) > MOST:
            between, age = starts_s[2:] - starts_s[:-2], t_s - starts_s[1:-1]
            kept[1 + int(np.argmin(between / age))] = False
        columns = np.repeat(kept, len(new))
        self.starts_s = starts_s[kept]
        sums = self.J, self.y, self.J_told
        self.J, self.y, self.J_told = (np.append(one, new)[columns] for one in sums)
        self.gated = np.append(self.gated, np.full(len(new), np.inf))[columns]
        B = np.column_stack([self.B, np.zeros((len(self.B), len(new)))])
        self.B = np.ascontiguousarray(B[:, columns])

    def shown(self, t_s, H, own, bend=0.0):
        """h (rows, m) of a measurement of t_s with H (rows, n).

        own : whether it is of the instrument;  bend : of its reading, `aid.DriftRule`
        """
        seen = H @ self.B
        if not own:
            return -seen
        h = np.repeat(t_s - self.starts_s, len(self.sides)) - seen
        if bend:
            rate = self._passes()
            rate = np.where(np.isfinite(rate), rate, 0.0)  # where any passes: to first order
            h += 0.5 * bend * np.tile(self.sides, len(self.starts_s)) * rate * seen**2
        return h

    def judge(self, t_s, z, H, S, bend=0.0):
        """A reading of the instrument, z and S (1,), (1, 1). -> Followed if it is found to drift, or None"""
        whole = self.shown(t_s, H, own=True, bend=bend)[0]
        h = self._sure(t_s, whole)
        self.J += h * h / S[0, 0]
        self.J_told += whole * h / S[0, 0]
        self.y += h * z[0] / S[0, 0]
        size = _over(self.y**2, self.J, 0.0)
        k = int(np.argmax(size))
        if size[k] <= self.limit:
            return None
        self._finds(self.y[k] / self.J_told[k], self.starts_s[k // len(self.sides)])
        return Followed(self.y[k] / self.J[k] * self.B[:, k])

    def passes_gate(self, t_s, H, S, limit, bend=0.0):
        """A reading that is used but not judged. H (1, n), S (1, 1);  limit : of the gate, chi-square"""
        h = np.abs(self._sure(t_s, self.shown(t_s, H, own=True, bend=bend)[0]))
        self.gated = np.minimum(self.gated, _over(np.sqrt(limit * S[0, 0]), h, np.inf))

    def judge_refused(self, seen):
        """Readings that the gate refuses, of which one would be believed: whether they go on moving.

        A new bias is there at once and stays. seen : Refused and the variance of its change since the first
        refused one -> Followed or None
        """
        (now, variance), first = seen, self.refused
        moved = now.z - first.z
        by_place = abs(now.z * (now.steep / first.steep - 1.0)) if first.steep else 0.0
        if abs(moved) <= MOVED * np.sqrt(variance) + by_place:
            return None
        rate = moved / (now.t_s - first.t_s)
        self._finds(rate, first.t_s)
        done = self.B * np.minimum(self._passes(), abs(rate))
        return Followed(done[:, int(np.argmax((done[POS] ** 2).sum(axis=0)))])

    def _finds(self, rate, t_s):
        self.found = f"drifts against the solution: by {rate:.3g} {self.rule.unit}/s since T{t_s:+.0f} s"
        self.is_disputed = True

    def learn(self, t_s, P, measured, own, bend=0.0):
        """A measurement has corrected the state. P : (n, n) before it;  measured : H, R of its rows"""
        if self.found:
            return
        H, R = measured
        PH = P @ H.T
        h = self.shown(t_s, H, own, bend)
        if own:  # back towards no error only by what is sure
            back = h * (H[:, POS] @ PH[POS]) * (H[:, POS] @ self.B[POS]) < 0.0
            h = np.where(back, self._sure(t_s, h), h)
        self.B += PH @ np.linalg.solve(H @ PH + R, h)

    def _sure(self, t_s, h):
        """The part of h (..., m) that is more than what it may be wrong by."""
        slack = LEFT_OUT * np.repeat(t_s - self.starts_s, len(self.sides))
        return np.sign(h) * np.maximum(np.abs(h) - slack, 0.0)

    def bend_of(self, reading):
        """`aid.DriftRule` of a reading of the instrument."""
        return 0.0 if self.rule.bend is None else self.rule.bend(reading)

    def _passes(self):
        """Fastest drift that passes, of each time at which it may have begun: (m,), perhaps infinite"""
        fastest = np.sqrt(_over(self.limit, self.J, np.inf))
        return np.minimum(np.minimum(fastest, self.gated), self.rule.fastest)

    def worst(self, axes):
        """What a drift that passes may have done along the nine axes of `protected`: (9,), or infinite."""
        if self.found or self.B is None or not self.B.any():
            return np.zeros(protected.N_FOLLOWED)  # of one that was found the covariance says it
        along = np.abs(_along(self.B, axes))
        return np.multiply(along, self._passes(), out=np.zeros(along.shape), where=along != 0.0).max(axis=1)


def _over(a, b, otherwise):
    """a / b where b (m,) is above zero, else another value: (m,)"""
    return np.divide(a, b, out=np.full(len(b), otherwise), where=b > 0.0)


@kernel
def _along(B, axes):
    """Errors (n, m) along the nine axes: (9, m)."""
    g, out = np.empty((6, 6)), np.empty((protected.N_FOLLOWED, B.shape[1]))
    protected.gradients(axes, g)
    out[:6] = g @ np.ascontiguousarray(B[: VEL.stop])
    out[6:] = B[ATT]
    return out


@kernel
def _carry(at, B, x, gap, omega_b, vibration, drive):
    """B over the time between two measurements, in place.

    gap : s, and velocity (3,) and C_ib (3, 3) at its begin;  x : (X,) packed values at its end
    """
    dt_s, v_i, before_C_ib = gap
    r_i, C_ib = x[X_R].copy(), rotation.dcm_from_quat(x[X_Q])
    pull = wgs84.GM / (r_i @ r_i) ** 1.5
    pushed = x[X_V] - v_i + pull * dt_s * r_i
    f_b = np.ascontiguousarray(C_ib.T) @ pushed / dt_s
    J_omega, J_f = calibration.jacobians_packed(at, B.shape[0], x, omega_b, f_b, vibration, drive)
    turn_i = before_C_ib @ np.ascontiguousarray(B[ATT])
    gained = dt_s * (C_ib @ (J_f @ B)) - rotation.skew(pushed) @ turn_i
    r2 = r_i @ r_i
    for j in range(B.shape[1]):
        along = 0.0
        for i in range(3):
            along += r_i[i] * B[POS.start + i, j]
        for i in range(3):
            gained[i, j] += dt_s * pull * (3.0 * along / r2 * r_i[i] - B[POS.start + i, j])
            if at[GRAVITY] >= 0:
                gained[i, j] += dt_s * B[at[GRAVITY] + i, j]
    turned = np.ascontiguousarray(C_ib.T) @ turn_i + dt_s * (J_omega @ B)
    for j in range(B.shape[1]):
        for i in range(3):
            B[POS.start + i, j] += dt_s * (B[VEL.start + i, j] + 0.5 * gained[i, j])
            B[VEL.start + i, j] += gained[i, j]
            B[ATT.start + i, j] = turned[i, j]


def weigh(nav, now, innovation, measurement, verdict):
    """Verdict on a new measurement, once the drifts of all instruments are there: it may show one.

    nav : fusion.Filter;  now : Moment;  innovation : sensor.Innovation;  verdict : gate.Verdict so far
    """
    name, watch = measurement.sensor, nav.watch
    for drift in watch.drifts.values():
        drift.carry(nav, now)
        if drift.is_disputed and _says_all(name, innovation.z, verdict.rows) and verdict.fate == Fate.USED:
            drift.is_disputed = False  # two of three agree
    drift = watch.drifts.get(name)
    if drift is None or drift.found:
        return verdict
    if len(innovation.z) != 1:
        words = f"{name}: a drift is looked for in readings of one number, not of {len(innovation.z)}"
        raise ValueError(words)
    if watch.imu_blind:
        if verdict.fate == Fate.USED:
            _, H, _, S, _, limit = innovation
            drift.passes_gate(now.t_s, H, S, limit, drift.bend_of(measurement.fix))
        return verdict
    followed = _judged(nav, now, innovation, measurement, verdict, drift)
    if followed is None:
        return verdict
    nav.health[name] = HEALTHY._replace(used=nav.health[name].used)  # it is known what was wrong
    return verdict._replace(fate=Fate.DOUBTED, admitted=followed, note=drift.found)


def _says_all(name, z, rows):
    """Whether a measurement says all of a position: three numbers, or four ranges, one for the clock.

    str, (m,);  rows : (m,) bool, those that are used; None: all
    """
    used = len(z) if rows is None else int(np.count_nonzero(rows))
    return about(name) is POSITION and used >= (3 if fix_of(name) else 4)


def _judged(nav, now, innovation, measurement, verdict, drift):
    """Followed if a reading shows a Drift of its instrument, or None; the other arguments as of `weigh`."""
    name, fix, (z, H, R, *_) = measurement.sensor, measurement.fix, innovation
    if verdict.fate == Fate.USED:
        drift.refused = None
        S = counted_covariance(nav, measurement, innovation)
        return drift.judge(now.t_s, z, H, S, drift.bend_of(fix))
    if verdict.fate not in (Fate.REJECTED, Fate.RESET):
        return None
    seen = nav.sensors[name].apart(nav, now, fix)
    steep = float(np.sqrt(H[0, POS] @ H[0, POS]))
    one = Refused(now.t_s, float(z[0]), float(seen.R[0, 0]), steep)
    drift.refused = drift.refused or one
    dt_s = now.t_s - drift.refused.t_s
    if verdict.fate == Fate.REJECTED:
        rule = nav.sensors[name].trial(nav, now, z, R, fix).rule
        if dt_s < rule.duration or nav.health[name].in_a_row < rule.rejections:
            return None
    lasting = sum(2.0 * v[0, 0] * (1.0 - exp(-dt_s / lasts_s)) for v, lasts_s in seen.lasting)
    moving = dt_s**2 * float(H[0, POS] @ now.P[VEL, VEL] @ H[0, POS])
    followed = drift.judge_refused((one, one.R + drift.refused.R + lasting + moving))
    drift.refused = None if verdict.fate == Fate.RESET else drift.refused
    return followed
