"""Watch over the GPS receiver: fixes that it repeats, and positions that run away slowly.

**Repeated fixes.** A measurement has noise, so two fixes that agree to the last bit are one fix sent twice,
unless the last bit is coarse. Stale: valid at the instant of one that was here before. Frozen: the position
of one that was here before, with a new time, although the vehicle has moved meanwhile further than a fix is
uncertain, or faster; or likewise its velocity. Whether it has moved, the inertial sensors say alone: repeated
fixes would hold a filter that believes them. So it is the path on which the filter would have gone on from
any instant without later corrections (`history.Corrections`),

    r_raw(t) = r(t) - sum of (dr_k + (t - t_k) dv_k),   v_raw(t) = v(t) - sum of dv_k

over the corrections dr_k, dv_k of position and velocity at the instants t_k, inertial axes. Only differences
of it mean something. What gravity changes along a path that is corrected is left out: 1.5e-6/s^2 of a
correction. To the uncertainty of a fix comes what the inertial sensors may be wrong by since: 3 sigma of
their velocity and of the acceleration that follows from them. Neither reaches the gate, so a frozen receiver
neither corrects the filter nor counts as contradiction. A coarse receiver at rest may well repeat itself.

**Slow drift.** A position that runs away slowly takes the filter with it and passes every gate; but the
filter lags behind, being held back by inertial sensors and GPS velocity, so the innovations keep their sign.
Their mean over the last fixes, exponentially weighted, is compared with what white innovations would have::

    m <- (1 - a) m + a w,   v <- (1 - a)^2 v + a^2,   |m|^2 / v ~ chi-square with 3 degrees of freedom

w being the whitened innovation, L^-1 z with S = L L^T. Averaging innovations over several times is due to
Diesel and Luu (GPS IAIM: calculation of thresholds and protection radius, ION GPS 1995). So that small errors
with a memory, which every receiver has, are not taken for a drift, the mean must also exceed `LEAST` sigma of
one innovation. Where errors are known to last, a share s of the variance of a fix, the filter does not follow
them (`measurements.lasting_factor`), so they stay in the mean, which has then up to s more variance::

    |m|^2 / (v + s) ~ chi-square with 3 degrees of freedom

What this cannot see: drifts so slow that the lag stays below that, and those which the reported velocity
confirms, until the accelerometers contradict them.
"""

from collections import deque
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation.measurements import level_axes
from shefex_nav.onboard.navigation.state import ATT, BA, VEL, X_R, X_V
from shefex_nav.onboard.navigation.strapdown import sensed_packed
from shefex_nav.records import GpsFix, GpsRanges

SAYS = {  # sensor and field of where and how fast, and what the first is called
    GpsFix: (("gps_position", "r_ea_e"), ("gps_velocity", "v_ea_e"), "position"),
    GpsRanges: (("gps_range", "pseudorange"), ("gps_range_rate", "range_rate"), "ranges"),
}
MEMORY = 8  # fixes that a new one is compared with
WINDOWS = (10.0, 30.0)  # fixes, of the means
DRIFT_PROBABILITY = 1e-7  # of calling white innovations a drift, per fix and window
LEAST = 2.0  # [E] sigma of one innovation, norm of the mean of a drift
CALM = 0.5  # [E] share of the squared mean that chance explains at most, below which a drift is over
OVER = 1.0  # [E] sigma of one innovation, norm of the mean: likewise, where that is more


class Drift(NamedTuple):
    """Means of the innovations of one sensor."""

    mean: np.ndarray  # (windows, 3) of the whitened innovations
    variance: np.ndarray  # (windows,) of each, if they are white
    suspected: bool


QUIET = Drift(np.zeros((len(WINDOWS), 3)), np.zeros(len(WINDOWS)), False)


class InertialState(NamedTuple):
    """The vehicle by its inertial sensors alone, and how far these can be trusted from here on."""

    t_s: float
    r_e: np.ndarray  # (3,) m
    v_e: np.ndarray  # (3,) m/s
    sigma_v: float  # m/s, of the norm of the velocity
    sigma_a: float  # m/s^2, of the norm of the acceleration


def inertial_state(t_s, memory, place, sums, earth):
    """InertialState at the end of a tick.

    memory, place : prediction.Memory and where the tick stands in it;  sums : history.Corrected until its end
    earth : EarthRotation
    """
    return InertialState(t_s, *_inertial_state(t_s, memory, place, sums.dr, sums.dv, earth))


@kernel
def _inertial_state(t_s, memory, place, dr, dv, earth):
    """`inertial_state` without its time; dr, dv : of Corrected."""
    x, numbers = memory.xs[place], memory.numbers[place]
    r_e, v_e = frames.ecef_from_inertial(earth, t_s, x[X_R] - dr - t_s * dv, x[X_V] - dv)
    n, dt_s, drive = int(numbers[2]), numbers[1], memory.drives[place]
    sensed = sensed_packed(x, memory.increments[place], n, dt_s, numbers[3], drive, numbers[2] * dt_s)
    sigma_v, sigma_a = sigmas(memory.Ps[place], sensed[3:])
    return r_e, v_e, sigma_v, sigma_a


@inner
def sigmas(P, f_b):
    """Standard deviations of velocity and acceleration, of their norms; the latter is -f x theta - bias."""
    J, velocity, acceleration = np.zeros((3, 6)), 0.0, 0.0
    J[:, :3] = -rotation.skew(f_b)
    for i in range(3):
        J[i, 3 + i] = -1.0
        velocity += P[VEL.start + i, VEL.start + i]
    for i in range(3):
        for j in range(6):
            for k in range(6):
                row = ATT.start + j if j < 3 else BA.start + j - 3
                column = ATT.start + k if k < 3 else BA.start + k - 3
                acceleration += J[i, j] * P[row, column] * J[i, k]
    return np.sqrt(velocity), np.sqrt(max(acceleration, 0.0))


class Kept(NamedTuple):
    """A fix that was here."""

    fix: GpsFix | GpsRanges  # the last of those that say the same
    place: list  # its position or ranges
    velocity: list  # and their rates
    there: InertialState  # of the vehicle at the first of them
    times: int  # how often its position has been said again by a receiver at rest


def memory():
    """What is remembered of the fixes: Kept, oldest first; changed in place."""
    return deque(maxlen=MEMORY)


def repeated(earlier, fix, here):
    """What of a valid fix repeats one that was here.

    Parameters
    ----------
    earlier : `memory`, which takes the fix in if it is new
    fix : GpsFix or GpsRanges
    here : InertialState at that instant

    Returns
    -------
    reasons : {sensor: reason} for those of its sensors that are not to be used
    fix : the same, but that of a receiver that rightly says the same again: nothing new, so the k-th of them
        counts with k times the variance of position, and all of them as ln(k) fixes; likewise its velocity,
        if that is the same again
    """
    where, how_fast, what = SAYS[type(fix)]
    # as lists, which compare in a tenth of the time of arrays; a NaN is equal to none
    place, velocity = getattr(fix, where[1]).tolist(), getattr(fix, how_fast[1]).tolist()
    for k, kept in enumerate(earlier):
        old = kept.fix
        if type(old) is not type(fix):
            continue
        if abs(old.t_valid_s - fix.t_valid_s) < 1e-9:
            words = f"stale: of T{old.t_valid_s:+.1f} s, as one before"
            return {where[0]: words, how_fast[0]: words}, fix
        if kept.place == place:
            if _rests(fix, kept, here):
                earlier[k] = kept._replace(fix=fix, velocity=velocity, times=kept.times + 1)
                again, same = kept.times + 2, kept.velocity == velocity
                return {}, fix._replace(R_r_e=again * fix.R_r_e, R_v_e=(again if same else 1) * fix.R_v_e)
            words = f"frozen: {what} of T{old.t_valid_s:+.1f} s"
            return {where[0]: words, how_fast[0]: words}, fix
        if any(velocity) and kept.velocity == velocity:
            if type(fix) is GpsFix and _is_as_fast(fix, kept, here):
                continue
            return {how_fast[0]: f"frozen: velocity of T{old.t_valid_s:+.1f} s"}, fix
    earlier.append(Kept(fix, place, velocity, here, 0))
    return {}, fix


def _rests(fix, kept, here):
    """Whether nothing has moved since a fix; ranges change always, with the satellites."""
    if type(fix) is not GpsFix or not _is_as_fast(fix, kept, here):
        return False
    since_s = here.t_s - kept.there.t_s
    strayed = kept.there.sigma_v * since_s, 0.5 * kept.there.sigma_a * since_s**2
    moved = here.r_e - kept.there.r_e
    if fix.horizontal:
        moved = level_axes(fix).T @ moved
    return _within(moved, fix.R_r_e, *strayed)


def _is_as_fast(fix, kept, here):
    """Whether the velocity is what it was at a fix; a receiver that reports none says nothing against it."""
    strayed = kept.there.sigma_a * (here.t_s - kept.there.t_s)
    return np.isnan(fix.R_v_e[0, 0]) or _within(here.v_e - kept.there.v_e, fix.R_v_e, strayed)


def _within(d, R, *strayed):
    """Whether a change (3,) is within the noise of a fix, (3, 3), and 3 sigma of what adds to it."""
    return bool(d @ d < np.trace(R) + 9.0 * sum(sigma**2 for sigma in strayed))


def follow(drift, z, S, limit, lasting=0.0):
    """Take an innovation into the means.

    Parameters
    ----------
    drift : Drift
    z, S : (3,), (3, 3), innovation and its covariance; (2,), (2, 2) of a fix without height
    limit : chi-square, 3 degrees of freedom, `DRIFT_PROBABILITY`
    lasting : share of the variance of a fix that is of errors which last

    Returns
    -------
    Drift
    """
    if len(z) < 3:  # of a fix without height: nothing is said along a third axis
        z, full = np.append(z, 0.0), np.eye(3)
        full[:2, :2] = S
        S = full
    return Drift(*_follow(drift.mean, drift.variance, drift.suspected, z, S, limit, lasting))


@kernel
def _follow(mean, variance, suspected, z, S, limit, lasting):
    """`follow` with the fields of its tuple, and those of the next one."""
    w = np.linalg.solve(np.linalg.cholesky(S), z)
    after, variance_after, found = np.empty_like(mean), np.empty_like(variance), False
    for k, window in enumerate(WINDOWS):
        a = 1.0 / window
        after[k] = (1.0 - a) * mean[k] + a * w
        variance_after[k] = (1.0 - a) ** 2 * variance[k] + a**2
        norm2, bound = (after[k] ** 2).sum(), limit * (variance_after[k] + lasting)
        if not suspected:  # the mean of few is short: |w| (1 - (1 - a)^n) of n alike
            found |= norm2 > max(bound, LEAST**2)
        elif k == 0:
            found = norm2 > max(CALM * bound, OVER**2)
    return after, variance_after, found


def followed(drift, S):
    """Standard deviation, of each axis, by which a drift may have misled the state.

    While the filter lags behind by the mean innovation m, it takes over a share of m with every fix; over
    the longest window that adds up to no more than the window's length times m, if every share were one. A
    share of a tenth is typical of a position that velocity holds back, hence

    sigma = |m| sqrt(max eig S) (1 + windows/10)

    drift : Drift;  S : (3, 3) -> float, in the unit of sqrt(S)
    """
    largest = np.sqrt(np.max(np.linalg.eigvalsh(S)))
    return float(np.sqrt((drift.mean**2).sum(axis=1)).max() * largest * (1.0 + 0.1 * WINDOWS[-1]))
