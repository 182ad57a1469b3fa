"""Watch over the inertial measurement unit: what its readings alone betray, and what is done about it.

- **No samples**, or the last block again, to the last count: the unit is silent.
- **Stuck**: an axis repeats one reading more often in a row than its noise and its quantum allow.
- **Saturated**: a reading at the end of the range, or the unit says so.

An axis that is silent or stuck is given the mean that it had before (over `MEAN_S`, which vibration does not
disturb), a saturated one keeps its reading. Either way the rate is wrong by an unknown amount, so the filter
is told: white noise of such a density that the variance of the integrated error grows as that of the error
itself. An error of sigma s that keeps its sign for a time T (first-order Gauss-Markov) integrates to

    V(t) = 2 s^2 T^2 (t/T - 1 + exp(-t/T)),                     s^2 t^2 at first,

and a held reading, from which the truth runs away at the rate c, to (c t^2/2)^2 before that. A fault is seen
later than it begins; the variance of the time before is made up for at once. Once a fix has said where the
integral was at an instant, the error counts from there, V(t) <= s^2 t^2 with t since the fix: that is much
less than the same noise would add that knows nothing of a bound on the rate.

An axis that is wrong in a way that looks alive is not seen here, but by the stars and by GPS, whose fixes
then contradict the strapdown (`integrity`).
"""

from math import erf, inf, log, sqrt
from typing import NamedTuple

import numpy as np
from numba import njit

from shefex_nav.records import NavHealth

MEAN_S = 0.1  # [E] time constant of the mean that is held: two periods of the slowest vibration
CALM_S = 1.0  # [E] an axis that vibrates into the end of its range has left it after so long without
SIGN_S = 10.0  # [E] for how long the error of a sensor that cannot be trusted keeps its sign
FEWEST_REPEATS = 20  # [E] readings; a driver may well send one sample twice
ONCE = 1e-9  # probability, per reading, of calling a healthy axis stuck
NAMES = tuple(f"{sensor} {axis}" for sensor in ("gyro", "accelerometer") for axis in "xyz")
GOOD, STUCK, SATURATED, SILENT, REPEATED = range(5)
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


NO_RULES = ImuRules(np.full(2, inf), np.full(2, inf), np.array([1.0, 50.0]), np.array([0.5, 50.0]))


class ImuWatch(NamedTuple):
    """Memory of the watch, changed in place; six axes, gyros first."""

    rules: ImuRules
    last: np.ndarray  # (n, 6) the block before, as it was read; NaN at the start
    run: np.ndarray  # (6,) equal readings in a row
    mean: np.ndarray  # (6,) mean reading as rate, rad/s and m/s^2; NaN before the first block
    before: np.ndarray  # (6,) that mean when the reading last changed
    since_s: np.ndarray  # (6,) when the present fault began; NaN: there is none
    seen_s: np.ndarray  # (6,) when it was last seen
    charged: np.ndarray  # (6,) rad^2, m^2/s^2, variance that the filter has been given for it
    fixed_s: np.ndarray  # (6,) when a fix last said what the integral was; NaN: not since it began
    state: np.ndarray  # (6,) int, GOOD ...


def repeats(sigma, quantum):
    """Equal readings in a row that a healthy axis gives once in a thousand million readings at most.

    A reading is the noisy increment, sigma (of one sample), rounded to quanta. No count is more frequent than
    one in the middle of the noise, p = erf(q/(2 sqrt(2) sigma)), and n of them in a row have p^n.
    """
    if sigma <= 0.0:
        return inf
    p = erf(quantum / (2.0 * sqrt(2.0) * sigma))
    if p >= 1.0:
        return inf
    return float(max(FEWEST_REPEATS, np.ceil(log(ONCE) / log(p)) if p > 0.0 else 0.0))


def start(rules, n):
    """ImuWatch for blocks of n samples. ImuRules, int -> ImuWatch"""
    last, unknown = np.full((n, 6), np.nan), np.full((5, 6), np.nan)
    good = np.zeros(6, dtype=np.int64)
    return ImuWatch(rules, last, np.ones(6), *unknown[:4], np.zeros(6), unknown[4], good)


def screen(watch, block):
    """What of a block can be used, and how far.

    Parameters
    ----------
    watch : ImuWatch, brought up to date
    block : ImuBlock

    Returns
    -------
    block : ImuBlock, with other readings on axes that cannot be used; `saturated` if a gyro is not trusted
    densities : (2, 3) white noise on top of that of a healthy unit, rad^2/s and m^2/s^3, body axes
    health : list of NavHealth, one for each axis whose state has changed
    """
    state = watch.state.copy()
    out, densities = np.empty((len(block.dtheta_b), 6)), np.zeros((2, 3))
    changed, unhealthy = _screen(
        *watch.rules, *watch[1:], block.t_valid_s, block.dt_s, block.dtheta_b, block.dv_b, block.saturated,
        block.valid, out, densities,
    )  # fmt: skip
    health = _health(block.t_valid_s, state, watch.state) if changed else []
    if not unhealthy:
        return block, densities, health
    doubtful = block.saturated or bool(watch.state[:3].any())
    block = block._replace(dtheta_b=out[:, :3].copy(), dv_b=out[:, 3:].copy(), saturated=doubtful, valid=True)
    return block, densities, health


def fixed(watch, sensor, t_valid_s, now_s):
    """A fix of t_valid_s has been used that says what the readings of a triad add up to.

    watch : ImuWatch;  sensor : 0 the gyros, 1 the accelerometers;  now_s : of the last block
    """
    for k in range(3 * sensor, 3 * sensor + 3):
        if watch.state[k] != GOOD and t_valid_s > watch.since_s[k]:
            watch.fixed_s[k] = t_valid_s
            rules = watch.rules
            watch.charged[k] = integrated_variance(
                rules.wrong[sensor], rules.change[sensor], max(now_s - t_valid_s, 0.0), False
            )


def _health(t_s, before, after):
    """NavHealth of every axis that has changed, or one for the unit if all have."""
    changed = np.flatnonzero(before != after)
    if len(changed) == len(NAMES) and len(set(after.tolist())) == 1:
        return [NavHealth(t_s, "imu", bool(after[0] == GOOD), WORDS.get(int(after[0]), ""))]
    return [
        NavHealth(t_s, NAMES[k], bool(after[k] == GOOD), WORDS.get(int(after[k]), ""))
        for k in changed.tolist()
    ]


@njit(cache=True)
def integrated_variance(wrong, change, age_s, held):
    """Variance of the integral of an unknown error after `age_s`: V(t) of the module's text.

    wrong : sigma of the error;  change : per second;  held : whether the reading was right at first.
    """
    x = age_s / SIGN_S
    variance = 2.0 * wrong**2 * SIGN_S**2 * (x - 1.0 + np.exp(-x))
    if x < 1e-3:  # the difference above loses its digits
        variance = wrong**2 * age_s**2
    if held:
        variance = min(variance, (0.5 * change * age_s**2) ** 2)
    return variance


@njit(cache=True)
def _screen(
    repeats, range_, wrong, change,  # ImuRules
    last, run, mean, before, since_s, seen_s, charged, fixed_s, state,  # ImuWatch
    t_end_s, dt_s, dtheta_b, dv_b, saturated, valid, out, densities,
):  # fmt: skip
    """`screen` with the fields of its tuples; the arrays of the watch are changed in place.

    Written: out (n, 6) rad, m/s, what can be used; densities (2, 3), zero before.
    -> whether the state of an axis has changed, whether there are densities
    """
    n = dtheta_b.shape[0]
    length_s = n * dt_s
    out[:, :3], out[:, 3:] = dtheta_b, dv_b
    same = valid and bool(np.all(out == last)) and np.isfinite(repeats[0]) and np.isfinite(repeats[1])
    whole = SILENT if not valid else (REPEATED if same else GOOD)
    at_range = _at_range(out, range_, dt_s)
    if saturated and not at_range.any():  # the unit does not say which axis
        at_range[:] = True
    changed = unhealthy = False
    for k in range(6):
        sensor = k // 3
        code, age_s = whole, length_s
        if whole == GOOD:
            code, age_s = _read_axis(out, last, run, mean, before, k, repeats[sensor], dt_s)
            calm = state[k] == SATURATED and t_end_s - seen_s[k] > CALM_S
            if at_range[k] or (code == GOOD and state[k] == SATURATED and not calm):
                code = SATURATED
        changed = changed or code != state[k]
        if code == GOOD:
            since_s[k], charged[k], fixed_s[k], state[k] = np.nan, 0.0, np.nan, GOOD
            continue
        if state[k] == GOOD:
            since_s[k] = t_end_s - age_s
        if code != SATURATED or at_range[k]:
            seen_s[k] = t_end_s
        state[k] = code
        held = code != SATURATED
        if held:
            kept = before[k] if code == STUCK else mean[k]
            for m in range(n):
                out[m, k] = kept * dt_s if np.isfinite(kept) else 0.0
        begin_s = since_s[k]
        if fixed_s[k] > begin_s:  # what is held was right at the beginning, not at the fix
            begin_s, held = fixed_s[k], False
        variance = integrated_variance(wrong[sensor], change[sensor], t_end_s - begin_s, held)
        densities[sensor, k % 3] = max(variance - charged[k], 0.0) / length_s
        charged[k] = max(variance, charged[k])
        unhealthy = unhealthy or densities[sensor, k % 3] > 0.0
    if whole == GOOD:
        last[:, :3], last[:, 3:] = dtheta_b, dv_b
    return changed, unhealthy


@njit(cache=True)
def _at_range(readings, range_, dt_s):
    """Axes with a reading at the end of the range, to a part in a thousand. (n, 6), (2,) -> (6,) bool"""
    found = np.zeros(6, dtype=np.bool_)
    for k in range(6):
        limit = 0.999 * range_[k // 3] * dt_s
        for m in range(readings.shape[0]):
            if abs(readings[m, k]) >= limit:
                found[k] = True
    return found


@njit(cache=True)
def _read_axis(readings, last, run, mean, before, k, repeats, dt_s):
    """Run length and mean of one axis with a new block. -> GOOD or STUCK, age of the fault s"""
    n, total, previous = readings.shape[0], 0.0, last[-1, k]
    longest = 0.0
    for m in range(n):
        value = readings[m, k]
        if value == previous:
            run[k] += 1.0
        else:
            if run[k] < repeats:  # a run that was no fault
                before[k] = mean[k]
            run[k] = 1.0
        longest = max(longest, run[k])
        previous, total = value, total + value
    rate = total / (n * dt_s)
    if longest >= repeats:
        mean[k] = before[k]  # it has taken in repeated readings until they were too many
        return STUCK, run[k] * dt_s
    if not np.isfinite(mean[k]):
        mean[k] = before[k] = rate
    else:
        mean[k] += min(1.0, n * dt_s / MEAN_S) * (rate - mean[k])
    return GOOD, n * dt_s
