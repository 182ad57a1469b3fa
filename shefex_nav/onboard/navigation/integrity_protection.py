"""Protection levels: how wrong position, velocity and attitude may be without anyone on board noticing.

For each axis of `protected`

    level = k sigma + w

k sigma is what the known errors do. The mission states an integrity risk per hour; an hour has
INDEPENDENT_PER_HOUR errors that know nothing of each other, so each of them, shared out among the axes of a
quantity, may exceed k sigma with the probability risk / INDEPENDENT_PER_HOUR / axes. In the horizontal plane
the error is a distance: exp(-k^2/2) (Rayleigh, with the sigma of the worst direction a bound).

w is what a single wrong fix could do that the gate lets through: an innovation z passes if
z^T S^-1 z <= T^2, it moves the state by K z, and the worst of them moves axis j by

    w_j = T sqrt((K S K^T)_jj) = T sqrt(P_jj(before) - P_jj(after)),

the slope of the error over the test statistic times the limit of the test, as in receiver autonomous
integrity monitoring (Brown and Chin 1998; for Kalman filters Joerger and Pervan, JGCD 36 (2013)). Of
satellites and stars, judged given the others, it is that of the worst one (`integrity_rows`). Later fixes
take the wrong one out again at the rate at which they reduce errors, so w is the worst over all fixes so far
of what is left of each. What a star fix has misled is what star fixes measure, attitude and mounting
together, and goes as H P H^T; what another sensor has done goes as P. A fix that has been confirmed by others
can only be wrong by what that comparison lets through: a star fix that agrees with a second one through the
gyros by T sqrt(2 R), a sensor that is believed against the filter, because its rejected fixes agree with each
other, by T sqrt(2 K R K^T) <= T sqrt(2 P(after)). And a fix that passes the gate, which is right if an
earlier one was wrong, bounds what that can have done to what this one measures: had it been more than
2 T sqrt(S), the gate's T and as much for noise that hides it, the fix would not have passed. Star fixes so
bound what other sensors have done to the attitude, fixes with three rows of position or velocity what any has
done to that.

Between fixes what a wrong one did grows. An error e with e^T P^-1 e = c^2 stays one of c sigma at most,
however errors grow, (F e)^T (F P F^T + Q)^-1 (F e) <= e^T P^-1 e; so w of the velocity grows as its sigma
does [E: as if it were all of e], and w of the position by that of the velocity times the time. That of the
attitude stays: gyros hold it, and the axes that it is about turn with the body.

What an instrument that drifts may have done, in all of its readings, is of `integrity_drift`. Two faults at
once, and one that is common to all fixes (a star camera that has moved by less than the gate notices), are
beyond this.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry.elementary import log
from shefex_nav.late_packages import special
from shefex_nav.onboard.navigation import integrity_rows, protected, quantity
from shefex_nav.onboard.navigation.eskf import Grown
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.protected import (
    ATTITUDE,
    BODY,
    N_FOLLOWED,
    N_TOLD,
    P_NED,
    POSITION,
    V_NED,
    VELOCITY,
)
from shefex_nav.onboard.navigation.state import ATT, MOUNTING, POS, VEL
from shefex_nav.records import Doubt

NO_DOUBT, TOO_HIGH = int(Doubt.NONE), int(Doubt.LEVEL)  # for kernels
# [E] errors in an hour that know nothing of each other: one a second, since GPS fixes, the quickest to renew
# all three, come once a second, and an error counts if it lasts for longer (report.trust)
INDEPENDENT_PER_HOUR = 3600.0
AXES_S = 1.0  # for which the axes of a place are kept


class Requirement(NamedTuple):
    """What the mission asks."""

    limits: np.ndarray  # (3,) m, m/s, rad: position and velocity as a whole, attitude about each axis
    k: np.ndarray  # (7,) sigmas of each axis of `protected`


class Level(NamedTuple):
    """Running slopes w, at an instant, along the nine axes that are followed."""

    w: np.ndarray  # (3, 9) m, m/s, rad: what star fixes have done, other sensors, instruments that drift
    sigma: np.ndarray  # (9,) that there was then; infinite before the first fix
    t_s: float


STARS, OTHERS, DRIFTS = 0, 1, 2
NO_FIX = Level(np.zeros((3, N_FOLLOWED)), np.full(N_FOLLOWED, np.inf), 0.0)


def requirement(position, velocity, attitude, risk):
    """Requirement of limits [m], [m/s], [rad] and of an integrity risk per hour."""
    k = np.empty(N_TOLD)
    for axes in (POSITION, VELOCITY, ATTITUDE):
        share = min(risk / INDEPENDENT_PER_HOUR / (axes.stop - axes.start), 1.0)
        k[axes] = -special().ndtri(0.5 * share)
        if axes is not ATTITUDE:
            k[axes.start] = np.sqrt(-2.0 * log(share))
    return Requirement(np.array([position, velocity, attitude]), k)


class Slope(NamedTuple):
    """What a wrong fix could have done, and what this fix has left of older errors."""

    stars: bool  # of a star fix
    table: np.ndarray  # (6, 9), its rows are the following


WORST = 0  # at the instant of the fix
BEFORE = 1  # sigma before it, and before anything was forgotten for its sake
AFTER = 2  # sigma after it
LEFT = 3  # share of older errors of other sensors
LEFT_STARS = 4  # share of those of star fixes
MOST = 5  # that an older error can have been, of the attitude one of other sensors


@kernel
def _slope(P_before, P_after, limit, confirmed, axes):
    """Table of a `Slope` whose rows were gated together, of a sensor that is no star tracker.

    P_before, P_after : (n, n) of the filter, at the instant of the fix;  limit : of its gate, chi-square
    confirmed : whether other fixes agree with it: then it was believed against the filter
    axes : (4, 3) of `protected.level_axes`
    """
    out = np.empty((6, N_FOLLOWED))
    before, after = np.empty(N_FOLLOWED), np.empty(N_FOLLOWED)
    protected.variances(P_before, axes, before)
    protected.variances(P_after, axes, after)
    for j in range(N_FOLLOWED):
        worst = max(before[j] - after[j], 0.0)
        if confirmed:
            worst = min(worst, 2.0 * after[j])
        out[WORST, j], out[BEFORE, j] = np.sqrt(limit * worst), np.sqrt(before[j])
        out[AFTER, j] = np.sqrt(after[j])
        out[LEFT, j] = out[LEFT_STARS, j] = min(after[j] / before[j], 1.0)
        out[MOST, j] = np.inf
        if j >= BODY.start:
            out[LEFT_STARS, j] = 1.0
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


def bound(found, P, H, R, limit, first, axes):
    """What a fix that passed says of older errors of what it measures goes into its Slope.

    found : Slope;  P : (n, n) before it;  H, R : (3, n), (3, 3);  limit : of its gate, chi-square
    first : POS.start or VEL.start, the first of the errors that its rows are of
    """
    H_block = np.ascontiguousarray(H[:, first : first + 3])
    _bound(found.table, P, H, R, H_block, limit, first, axes)


@kernel
def _bound(table, P, H, R, H_block, limit, first, axes):
    S = H @ (P @ H.T) + R
    seen = np.linalg.solve(H_block.T.copy(), axes[:3].T.copy())  # column j is axis j by the innovation
    for j in range(3):
        a = np.ascontiguousarray(seen[:, j])
        table[MOST, first + j] = 2.0 * np.sqrt(limit * (a @ (S @ a)))


@kernel
def _slope_of_stars(P_before, P_after, limit, H, R, confirmed, axes):
    """Table of a `Slope` of a star fix, whose three rows, H (3, n) and R (3, 3), are about the body axes."""
    out = _slope(P_before, P_after, limit, confirmed, axes)
    for i in range(3):
        before, j = _seen(P_before, H[i]), BODY.start + i
        if confirmed:
            k = ATT.start + i
            moved = max(P_before[k, k] - P_after[k, k], 0.0)
            out[WORST, j] = np.sqrt(limit * min(moved, 2.0 * R[i, i]))
        out[LEFT_STARS, j] = min(_seen(P_after, H[i]) / before, 1.0)
        out[MOST, j] = 2.0 * np.sqrt(limit * (before + R[i, i]))
    return out


@kernel
def _slope_of_vectors(P_before, P_after, limit, H, R, mounting, axes):
    """Table of a `Slope` of stars gated one by one, two rows each; mounting: its first error, or -1."""
    out, row = _slope(P_before, P_after, limit, False, axes), np.empty(P_before.shape[0])
    integrity_rows.worst_of(P_before, H, R, limit, 2, axes, out[WORST])
    for i in range(3):  # what stars have misled is attitude and mounting together
        row[:] = 0.0
        row[ATT.start + i] = 1.0
        if mounting >= 0:
            row[mounting + i] = 1.0
        out[LEFT_STARS, BODY.start + i] = min(_seen(P_after, row) / _seen(P_before, row), 1.0)
    return out


@kernel
def _slope_of_rows(P_before, P_after, limit, H, R, size, confirmed, axes):
    """Table of a `Slope` of rows that were gated in groups of `size`, such as one a satellite."""
    out = _slope(P_before, P_after, limit, confirmed, axes)
    worst = np.empty(N_FOLLOWED)
    integrity_rows.worst_of(P_before, H, R, limit, size, axes, worst)
    out[WORST] = np.minimum(worst, out[WORST]) if confirmed else worst
    return out


def of_measurement(nav, now, measurement, P, prior, H, R, confirmed):
    """Slope of a measurement that has just been used: by how its sensor is gated, not by which it is.

    Those of the attitude are apart, for what they mislead is attitude and mounting together.

    nav : Filter;  now : Moment, after it;  measurement : as decided
    P, prior : (n, n) before it, and after a reset forgot, or the same
    H, R : (m, n), (m, m) of the rows used;  confirmed : whether another fix agrees with it
    """
    name, sensor = measurement.sensor, nav.sensors[measurement.sensor]
    limit = nav.limits[len(R), sensor.gate_probability]
    rows, axes = sensor.rows, nav.watch.protection.axes(nav.earth, now.t_s, now.x)
    of_stars = quantity.about(name) is quantity.ATTITUDE
    if rows:  # perhaps some of many
        H, R = np.ascontiguousarray(H), np.ascontiguousarray(R)
    grown = isinstance(measurement.admitted, Grown)  # no fix has confirmed it
    agreed = confirmed or (measurement.fate == Fate.RESET and not grown)  # `judge`: its rejected fixes agree
    if of_stars and rows:
        mounting = int(nav.layout.at[MOUNTING])
        found = Slope(True, _slope_of_vectors(prior, now.P, nav.limits[2], H, R, mounting, axes))
    elif of_stars:
        found = Slope(True, _slope_of_stars(prior, now.P, limit, H, R, confirmed, axes))
    elif rows:
        found = Slope(False, _slope_of_rows(prior, now.P, nav.limits[rows], H, R, rows, agreed, axes))
    else:
        found = Slope(False, _slope(prior, now.P, limit, agreed, axes))
        block = nav.layout.places.get(nav.sensors[name].block)
        if len(R) == 3 and block in (POS, VEL) and prior is P:
            bound(found, P, H, R, limit, block.start, axes)
    if prior is not P:
        found.table[BEFORE] = protected.sigmas(P, axes)
    return found


class Protection:
    """Memory of the protection levels, changed in place.

    level : Level, at the instant of the last fix that was used
    """

    def __init__(self):
        self.level = NO_FIX
        self._used = []  # (s, Slope) of each fix used in this tick
        self._axes, self._axes_s = None, -np.inf

    def axes(self, earth, t_s, x):
        """`protected.level_axes`, kept for AXES_S: in a second they turn by 1e-3 rad, also in orbit."""
        if not abs(t_s - self._axes_s) <= AXES_S:
            self._axes_s, self._axes = t_s, protected.level_axes(earth, t_s, x)
        return self._axes

    def used(self, nav, now, *given):
        """A measurement has just been used; arguments as of `of_measurement`."""
        self._used.append((now.t_s, of_measurement(nav, now, *given)))

    def update(self, earth, history, drifts=()):
        """Bring the level up to date with the fixes used in this tick. drifts : of integrity_drift.Drift"""
        if self._used:
            axes = self.axes(earth, history.ends_s[-1], history.x)
            self.level = after_fixes(self.level, self._used)
            self.level.w[DRIFTS] = 0.0
            for drift in drifts:
                self.level.w[DRIFTS] = np.maximum(self.level.w[DRIFTS], drift.worst(axes))
            self._used.clear()


def after_fixes(level, found):
    """Level at the instant of the last of the fixes that have been used.

    There it stays until the next: a fix arrives late, and if the time until now were gone through with each,
    that of 0.2 s would count five times between fixes of 25 Hz. A fix older than one before, of another
    sensor, takes the level back to its instant: that time counts twice. What later fixes, used already, have
    taken out of its error is not looked for.

    level : Level;  found : list of (s, Slope), in their order -> Level
    """
    w, before, before_s = level.w.copy(), level.sigma, level.t_s
    for t_s, one in found:
        _after_fix(w, before, max(t_s - before_s, 0.0), one.stars, one.table)
        before, before_s = one.table[AFTER], t_s
    return Level(w, before, before_s)


@inner
def _grow(w, before, now, dt_s):
    """What wrong fixes did, (3, 9), from an instant with sigmas (9,) to one dt_s later with others."""
    for row in range(w.shape[0]):
        for j in range(3):
            w[row, V_NED.start + j] *= max(now[V_NED.start + j] / before[V_NED.start + j], 1.0)
            w[row, P_NED.start + j] += w[row, V_NED.start + j] * dt_s


@kernel
def _after_fix(w, before, dt_s, of_stars, table):
    """w (3, 9) after a fix, dt_s after an instant with sigmas `before`, in place."""
    _grow(w, before, table[BEFORE], dt_s)
    fixed = STARS if of_stars else OTHERS
    for j in range(N_FOLLOWED):
        if j < BODY.start:
            w[STARS, j] = min(w[STARS, j], table[MOST, j])
        w[STARS, j] *= table[LEFT_STARS, j]
        w[OTHERS, j] = min(w[OTHERS, j], table[MOST, j]) * table[LEFT, j]
        w[fixed, j] = max(w[fixed, j], table[WORST, j])


@inner
def levels(w, before, dt_s, k, known, sigma, out):
    """Protection levels: out (7,) is written. What is not a number stays none.

    w, before : of a Level, dt_s before;  k : of the Requirement
    known : (9,) sigmas of the filter, which wrong fixes grow with
    sigma : (7,) those of the solution, which swings with vibration besides
    """
    for row in range(w.shape[0]):
        for i in range(3):  # as `_grow`; north and east are put together
            v = V_NED.start + i
            velocity = w[row, v] * max(known[v] / before[v], 1.0)
            position = w[row, i] + velocity * dt_s
            if i == 0:
                north_r, north_v = position, velocity
            elif i == 1:
                _level(row, POSITION.start, np.sqrt(north_r**2 + position**2), k, sigma, out)
                _level(row, VELOCITY.start, np.sqrt(north_v**2 + velocity**2), k, sigma, out)
            else:
                _level(row, POSITION.start + 1, position, k, sigma, out)
                _level(row, VELOCITY.start + 1, velocity, k, sigma, out)
            _level(row, ATTITUDE.start + i, w[row, BODY.start + i], k, sigma, out)


@inner(forceinline=True)
def _level(row, j, worst, k, sigma, out):
    """Level of an axis that is told: the largest of all kinds of faults."""
    level = k[j] * sigma[j] + worst
    if row == 0 or level > out[j] or level != level:
        out[j] = level


@inner
def doubts(levels, limits, graver, out):
    """Doubt about position, velocity and attitude: out (3,) is written.

    levels : (7,);  limits : (3,) of the Requirement;  graver : (3,) Doubt that there is in any case, or NONE

    The limits of position and velocity are of the whole error, horizontal and vertical together.
    """
    whole = np.sqrt(levels[0] ** 2 + levels[1] ** 2), np.sqrt(levels[2] ** 2 + levels[3] ** 2)
    out[0] = NO_DOUBT if whole[0] <= limits[0] else TOO_HIGH  # a level that is not a number must not pass
    out[1] = NO_DOUBT if whole[1] <= limits[1] else TOO_HIGH
    out[2] = NO_DOUBT
    for j in range(ATTITUDE.start, ATTITUDE.stop):
        if not levels[j] <= limits[2]:
            out[2] = TOO_HIGH
    for i in range(3):
        if graver[i] != NO_DOUBT:
            out[i] = graver[i]
