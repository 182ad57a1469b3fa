"""Watch over the inertial measurement unit: what its readings alone betray, and what is done about it.

- **No samples**, or the last block again, to the last count: the unit is silent.
- **Stuck**: an axis repeats one reading more often in a row than its noise and its quantum allow, and twice
  as often as any axis of its triad has done before and gone on.
- **Saturated**: a reading at the end of the range, or the unit says so.

An axis that is silent or stuck is given the mean that it had before (over `MEAN_S`, which vibration does not
disturb), a saturated one keeps its reading. Either way the rate is wrong by an unknown amount, so the filter
is told: white noise of such a density that the variance of the integrated error grows as that of the error
itself. Of a saturated axis only the time counts that its readings spend at the end of the range; an
accelerometer that has nothing else in a block may be off by all of that range, as a fault leaves it: each
block adds what V(t) grows by with its own sigma.
An error of sigma s that keeps its sign for a time T (first-order Gauss-Markov) integrates to

    V(t) = 2 s^2 T^2 (t/T - 1 + exp(-t/T)),                     s^2 t^2 at first,

and a held reading, from which the truth runs away at the rate c, to (c (tau + t/2) t)^2 before that: what is
held is a mean that is tau = `MEAN_S` old. When the axis is read again, it shows how far the truth has run
away, which may be more: a despin takes 2000 deg/s^2 off the roll rate. A fault is seen later than it begins;
the variance of the time before is made up for at once. Once a fix has said where the integral was at an
instant, the error counts from there, V(t) <= s^2 t^2 with t since the fix: less than noise that knows of no
bound on the rate would add.

Faults that follow each other, as blocks lost now and then, err to one side (`integrity_unread`).

An axis that is wrong but looks alive is seen by stars and GPS alone, which then contradict the strapdown.
"""

from math import inf
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel, rows
from shefex_nav.onboard.navigation import integrity_unread
from shefex_nav.onboard.navigation.integrity_readings import (
    END,
    GOOD,
    MEAN_S,
    REPEATED,
    SATURATED,
    SILENT,
    STUCK,
    at_range,
    at_range_throughout,
    limit_of_run,
    of_block,
    read_axis,
)
from shefex_nav.onboard.navigation.integrity_unread import FORCE, ROLL, SIGN_S
from shefex_nav.records import NavHealth

CALM_S = 1.0  # [E] an axis that vibrates into the end of its range has left it after so long without
NAMES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz")
WORDS = {
    STUCK: "stuck: the same reading again and again",
    SATURATED: "at the end of its range",
    SILENT: "no samples",
    REPEATED: "the same block of samples again",
}


class ImuRules(NamedTuple):
    """What is expected of readings, and how wrong one may be that is not trusted; gyros, accelerometers."""

    repeats: np.ndarray  # (2,) equal readings in a row that a healthy axis does not give; inf: never look
    range: np.ndarray  # (2,) rad/s, m/s^2; inf: unknown
    wrong: np.ndarray  # (2,) rad/s, m/s^2, sigma of the error of a reading that means nothing
    change: np.ndarray  # (2,) rad/s^2, m/s^3, how fast the truth runs away from a reading that is held
    missed: np.ndarray  # (2,) rad/s, m/s^2, sigma of what a reading at the end of the range leaves out
    again: np.ndarray = np.full(2, inf)  # `integrity_readings.evidence` of a reading like the one before,
    further: np.ndarray = np.full(2, inf)  # and of each that follows and is the same


NO_RULES = ImuRules(
    np.full(2, inf), np.full(2, inf), np.array([1.0, 50.0]), np.array([0.5, 50.0]), np.array([1.0, 50.0])
)


AXIS = rows(
    [
        ("run", float),  # equal readings in a row
        ("longest", float),  # of the runs that ended by themselves
        ("mean_rate", float),  # of its readings, rad/s or m/s^2; NaN before the first block
        ("before", float),  # that mean when the reading last changed
        ("since_s", float),  # when the present fault began; NaN: there is none
        ("seen_s", float),  # when it was last seen
        ("charged", float),  # rad^2 or m^2/s^2, variance that the filter has been given for it
        ("at_end_s", float),  # time at the end of its range, in all or since a fix
        ("fixed_s", float),  # when a fix last said what the integral was; NaN: not since it began
        ("missed", float),  # rad or m/s, S of `integrity_unread`
        ("lately", float),  # the same of the last second
        ("given", float),  # rad^2 or m^2/s^2, V of it
        ("ended_s", float),  # when the last fault was over
        ("state", int),  # GOOD ...
    ]
)


class ImuWatch(NamedTuple):
    """Memory of the watch, changed in place."""

    rules: np.ndarray  # (6, 2) the ImuRules
    last: np.ndarray  # (n, 6) the block before, as it was read; NaN at the start
    axes: np.ndarray  # (6,) of AXIS, gyros first
    forces: np.ndarray  # (3,) of `integrity_unread.FORCE`, of the accelerometers
    sensed: float  # rad/s per m/s^2, sigma of the g-sensitivity of the gyros
    alike: np.ndarray  # (2,) of `integrity_readings.of_block`

    @property
    def state(self):
        """(6,) int, GOOD ..."""
        return self.axes["state"]


def start(rules, n, sensed=0.0):
    """ImuWatch for blocks of n samples. ImuRules, int, rad/s per m/s^2 -> ImuWatch"""
    axes = np.zeros(6, dtype=AXIS)
    axes["run"] = 1.0
    for name in ("mean_rate", "before", "since_s", "seen_s", "fixed_s"):
        axes[name] = np.nan
    axes["ended_s"] = -np.inf
    forces = np.zeros(3, dtype=FORCE)
    return ImuWatch(np.array(rules), np.full((n, 6), np.nan), axes, forces, sensed, np.zeros(2))


def screen(watch, block, readings, densities):
    """What of a block can be used, and how far.

    Parameters
    ----------
    watch : ImuWatch, brought up to date
    block : ImuBlock
    readings : (n, 6), written: its increments [rad, m/s], with others on axes that cannot be used
    densities : (3, 3), written: white noise on top of that of a healthy unit, body axes: rad^2/s and m^2/s^3
        of axes that are not read, rad^2/s of gyros that answer to a force that is not read

    Returns
    -------
    list of NavHealth, one for each axis whose state has changed
    """
    changed = screen_packed(watch, block, readings, densities)
    return health(block.t_valid_s, changed, watch.state) if changed else []


def fixed(watch, sensor, t_valid_s, now_s):
    """A fix of t_valid_s has been used that says what the readings of a triad add up to.

    watch : ImuWatch;  sensor : 0 the gyros, 1 the accelerometers;  now_s : of the last block
    """
    _, _, wrong, change, missed, *_ = watch.rules
    for axis in watch.axes[3 * sensor : 3 * sensor + 3]:
        if axis["state"] != GOOD and t_valid_s > axis["since_s"]:
            axis["fixed_s"], age_s, sigma = t_valid_s, max(now_s - t_valid_s, 0.0), wrong[sensor]
            if axis["state"] == SATURATED:
                age_s = axis["at_end_s"] = min(age_s, axis["at_end_s"])
                sigma = missed[sensor]
            axis["charged"] = integrated_variance(sigma, change[sensor], age_s, False)


def turned(watch, t_valid_s, now_s):
    """A star fix of t_valid_s has been used: what a force that is not read has turned counts from there."""
    for axis, force in zip(watch.axes[3:], watch.forces, strict=True):
        if axis["state"] != GOOD and t_valid_s > axis["since_s"]:
            age_s = max(now_s - t_valid_s, 0.0) + integrity_unread.FOLLOWED_S
            force["lasting_s"] = min(age_s, force["lasting_s"])
            seen_s = age_s - force["lasting_s"]  # of that time GPS has shown the rest
            force["shown"] = min(force["shown"], force["before"] * seen_s) if seen_s > 0.0 else 0.0


def pushed(watch, speed, t_valid_s, now_s):
    """A GPS velocity of t_valid_s has been used: along the roll axis it shows the force that was not read.

    speed : m/s, by what the velocity was corrected along it since the GPS velocity before
    """
    axis, force = watch.axes[3 + ROLL], watch.forces[ROLL]
    if axis["state"] == GOOD or not (t_valid_s > axis["since_s"] and force["lasting_s"] > 0.0):
        return
    age_s, shown = min(max(now_s - t_valid_s, 0.0), force["lasting_s"]), abs(speed)
    force["owed"] += (2.0 * force["shown"] + shown) * shown
    force["shown"] += shown
    since_s = force["known_s"] - age_s
    if force["before"] < inf:
        force["before"] *= max(1.0 - since_s / MEAN_S, 0.0)
        force["before"] += shown / max(since_s, MEAN_S)
    elif since_s > 0.0:
        force["before"] = shown / since_s
    force["lasting_s"] = force["known_s"] = age_s


def replaced(state):
    """Whether readings are given to axes. (6,) int, of an ImuWatch -> bool"""
    return bool(((state != GOOD) & (state != SATURATED)).any())


def health(t_s, changed, state):
    """NavHealth of every axis that has changed (bits of an int), or one for the unit if all have.

    The list of `screen`, of what `screen_packed` gives; state : (6,) int, of an ImuWatch
    """
    axes = [k for k in range(len(NAMES)) if changed >> k & 1]
    if len(axes) == len(NAMES) and len(set(state.tolist())) == 1:
        return [NavHealth(t_s, "imu", bool(state[0] == GOOD), WORDS.get(int(state[0]), ""))]
    return [NavHealth(t_s, NAMES[k], bool(state[k] == GOOD), WORDS.get(int(state[k]), "")) for k in axes]


@kernel(forceinline=True)
def integrated_variance(wrong, change, age_s, held):
    """Variance of the integral of an unknown error after `age_s`: V(t) of the module's text.

    wrong : sigma of the error;  change : per second;  held : whether the reading was right at first.
    """
    x = age_s / SIGN_S
    variance = 2.0 * wrong**2 * SIGN_S**2 * (x - 1.0 + np.exp(-x))
    if x < 1e-3:  # the difference above loses its digits
        variance = wrong**2 * age_s**2
    if held:
        variance = min(variance, (change * (MEAN_S + 0.5 * age_s) * age_s) ** 2)
    return variance


@kernel(forceinline=True)
def screen_packed(watch, block, readings, densities):
    """`screen`, compiled. -> int, bit k: the state of axis k has changed"""
    rules, last, axes, t_end_s, dt_s = watch.rules, watch.last, watch.axes, block.t_valid_s, block.dt_s
    n, changed, u2 = block.dtheta_b.shape[0], 0, 0.0
    whole, anywhere = of_block(block, readings, rules, last, watch.alike), _anywhere(readings, rules, dt_s)
    for k in range(6):
        axis, code, end = axes[k], whole, rules[1, k // 3] * dt_s
        age_s = max(watch.alike[0], 1.0) * n * dt_s
        # if the unit does not say which axis is at the end of its range, it may be any
        at_end = at_range(readings, k, end) or (block.saturated and not anywhere)
        kept = _kept(axis)
        integrity_unread.fade(axis, n * dt_s)
        if whole == GOOD:
            limit = limit_of_run(rules[0, k // 3], axes, k // 3)
            code, age_s = read_axis(readings, last[n - 1, k], axis, k, limit, END * end, dt_s)
            calm = axis.state == SATURATED and t_end_s - axis.seen_s > CALM_S
            if at_end or (code == GOOD and axis.state == SATURATED and not calm):
                code = SATURATED
        if code != axis.state:
            changed |= 1 << k
        if code == GOOD:
            if k >= 3 and axis.state != GOOD:
                u2 += integrity_unread.paid(watch.forces[k - 3])
            owed = _ran_away(axis, kept, last[:, k], readings[:, k], dt_s, t_end_s)
            densities[k // 3, k % 3] = owed / (n * dt_s)
            _found(axis)
            continue
        unseen, unread_s = _turns_bad(watch, k, code, readings[n - 1, k] / dt_s, age_s, t_end_s, n * dt_s)
        if code != SATURATED or at_end:
            axis.seen_s = t_end_s
        axis.state = code
        throughout = at_end and (not anywhere or at_range_throughout(readings, k, end))
        if code == SATURATED:
            missed = integrity_unread.largest(rules, True) if throughout and k >= 3 else rules[4, k // 3]
            added = _charge_at_end(missed, axis, n * dt_s) if at_end else 0.0
        else:
            added = _charge(rules[2, k // 3], rules[3, k // 3], axis, t_end_s) + unseen
        densities[k // 3, k % 3] = added / (n * dt_s)
        if k >= 3:
            u2 += integrity_unread.paid(watch.forces[k - 3]) + unseen
            if code != SATURATED or throughout:
                most = integrity_unread.largest(rules, code == SATURATED)
                u2 += integrity_unread.added(watch.forces[k - 3], most, rules[3, 1], unread_s)
    densities[2, :] = watch.sensed**2 * u2 / (n * dt_s)
    if whole == GOOD:
        last[:] = readings
    _hold(readings, axes, dt_s)
    return changed


@inner(forceinline=True)
def _turns_bad(watch, k, code, reading, age_s, t_end_s, tick_s):
    """What axis k of an IMU owes where it is no longer read, or in another way than before.

    reading : the last, rad/s or m/s^2;  age_s : since when
    -> what was not noticed so far, rad^2 or m^2/s^2; for how long the force was not counted so far
    """
    axis = watch.axes[k]
    if axis.state == GOOD:
        if k >= 3:
            integrity_unread.begin(watch.forces[k - 3], code != SATURATED and np.isfinite(axis.mean_rate))
        return _lost(axis, code, reading, age_s, t_end_s), max(age_s, tick_s)
    if axis.state == SATURATED and code != SATURATED:  # what is held was not right, and counts anew
        axis.fixed_s, axis.charged = t_end_s - age_s, 0.0
        return 0.0, max(age_s, tick_s)
    return 0.0, tick_s


@inner(forceinline=True)
def _anywhere(readings, rules, dt_s):
    """Whether any axis is at the end of its range."""
    for k in range(6):
        if at_range(readings, k, rules[1, k // 3] * dt_s):
            return True
    return False


@inner(forceinline=True)
def _lost(axis, code, rate, age_s, t_end_s):
    """An axis is not read any more, since age_s. Variance of what it has added until it was called stuck."""
    axis.since_s = t_end_s - age_s
    if code == STUCK and np.isfinite(axis.before):
        return ((rate - axis.before) * age_s) ** 2
    return 0.0


@inner(forceinline=True)
def _ran_away(axis, kept, last, now, dt_s, t_end_s):
    """What an axis that is read again turns out to owe, rad^2 or m^2/s^2 beyond what is charged.

    The truth went from the last reading to the present one: what was held is off by the larger of their
    differences from it at most, for as long as no fix has said otherwise.

    With it comes what it owes together with the faults before (`integrity_unread`).

    kept : what was held;  last, now : (n,) increments of the block before the fault and of the present one
    """
    if axis.state == GOOD or axis.state == SATURATED or not np.isfinite(kept):
        return 0.0
    block_s = now.shape[0] * dt_s
    before, after = last.sum() / block_s - kept, now.sum() / block_s - kept
    since_s = max(axis.since_s, axis.fixed_s) if np.isfinite(axis.fixed_s) else axis.since_s
    unread_s = max(t_end_s - block_s - since_s, 0.0)
    own = max((max(abs(before), abs(after)) * unread_s) ** 2, axis.charged)
    if not np.isfinite(own):
        return 0.0
    more = integrity_unread.closed(axis, 0.5 * (before + after) * unread_s, own, t_end_s - block_s)
    return own - axis.charged + more


@inner(forceinline=True)
def _found(axis):
    """An axis is read again; changed in place."""
    axis.since_s, axis.charged, axis.fixed_s, axis.at_end_s, axis.state = np.nan, 0.0, np.nan, 0.0, GOOD


@inner(forceinline=True)
def _charge(wrong, change, axis, t_end_s):
    """Variance that the error of a reading which cannot be used has added since the last block."""
    held = np.isfinite(axis.mean_rate)  # without a mean there is nothing to hold
    begin_s = axis.since_s
    if axis.fixed_s > begin_s:  # what is held was right at the beginning, not at the fix
        begin_s, held = axis.fixed_s, False
    variance = integrated_variance(wrong, change, t_end_s - begin_s, held)
    added = max(variance - axis.charged, 0.0)
    axis.charged = max(variance, axis.charged)
    return added


@inner(forceinline=True)
def _charge_at_end(missed, axis, duration_s):
    """Variance that a reading at the end of its range has added in a block, of sigma `missed` in it."""
    before = integrated_variance(missed, 0.0, axis.at_end_s, False)
    axis.at_end_s += duration_s
    return integrated_variance(missed, 0.0, axis.at_end_s, False) - before


@inner(forceinline=True)
def _kept(axis):
    """What an axis that is not read is taken to read, rad/s or m/s^2."""
    return axis.before if axis.state == STUCK else axis.mean_rate


@inner(forceinline=True)
def _hold(readings, axes, dt_s):
    """Give the axes that are silent or stuck the mean that they had."""
    for k in range(6):
        code = axes[k].state
        if code != GOOD and code != SATURATED:
            kept = _kept(axes[k])
            for m in range(readings.shape[0]):
                readings[m, k] = kept * dt_s if np.isfinite(kept) else 0.0
