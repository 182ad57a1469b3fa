"""What readings of the inertial measurement unit betray by themselves: silent, repeated, stuck, at the end.

A block is silent or the one before it again; an axis repeats one reading more often than its noise and its
quantum allow, or is at the end of its range. What follows of that is in `integrity_imu`.
"""

from math import ceil, erf, inf, log, pi, sqrt

import numpy as np

from shefex_nav.compiled import inner

MEAN_S = 0.1  # [E] time constant of the mean that is held: two periods of the slowest vibration
END = 0.999  # share of the range from which on a reading is at its end
FEWEST_REPEATS = 20  # [E] readings; a driver may well send one sample twice
AGAIN = 2.0  # [E] times the longest run of a triad that ended by itself
BY_ITSELF = 4.0  # [E] times the limit: a longer run was a fault; so was one of more than NATURAL_S
NATURAL_S = 1.0  # [E]
ONCE = 1e-9  # probability, per reading, of calling a healthy axis stuck
ALIKE = -log(ONCE)
GOOD, STUCK, SATURATED, SILENT, REPEATED = range(5)


def repeats(sigma, quantum, carried=False):
    """Equal readings in a row that a healthy axis gives once in a thousand million readings at most.

    A reading is the noisy increment, sigma (of one sample), rounded to quanta q. No count is more frequent
    than one in the middle of the noise, p = erf(q/(2 sqrt(2) sigma)), and n of them in a row have p^n.

    carried : what rounding leaves is counted in the next sample, as by a unit that counts whole angles. While
        it repeats itself the sum of what is left, a random walk, stays within one quantum, which n steps do
        with 4/pi exp(-n (pi sigma/L)^2/2), L = q + 1.165 sigma as it is looked at once a sample (Siegmund,
        Advances in Applied Probability 11, 1979); a rate between two counts, or one that changes, leaves it
        sooner.
    """
    if sigma <= 0.0:
        return inf
    most, p = inf, erf(quantum / (2.0 * sqrt(2.0) * sigma))
    if p < 1.0:
        most = ceil(log(ONCE) / log(p)) if p > 0.0 else 0.0
    if carried:
        width = (quantum / sigma + 1.165) / pi
        steps = 2.0 * log(4.0 / (pi * ONCE)) * (width * width)
        most = min(most, ceil(steps) if steps < inf else inf)  # inf: noise too small for its square
    return float(max(FEWEST_REPEATS, most))


def evidence(sigma, quantum):
    """What readings that equal those before say for a unit that repeats itself: -log of their chance.

    The counts of a reading have probabilities p_k, of which none is above p = erf(q/(2 sqrt(2) sigma)). Two
    are equal with the sum of p_k^2, at most erf(q/(4 sigma)), or what it is of a reading in the middle of a
    count; each that follows is the same again with p at most. This is so whatever the rate.

    sigma, quantum : of a reading -> of the first that is equal, of each one more
    """
    if sigma <= 0.0:
        return 0.0, 0.0
    ratio = quantum / sigma
    most = erf(ratio / sqrt(8.0))
    beside = 0.5 * (erf(3.0 * ratio / sqrt(8.0)) - most)
    both = max(erf(0.25 * ratio), most**2 + 2.0 * beside**2)
    return tuple(-log(p) if p > 0.0 else inf for p in (both, most))


@inner(forceinline=True)
def of_block(block, readings, rules, last, alike):
    """What a whole block is: GOOD, SILENT or REPEATED; its readings are put side by side.

    alike : (2,) how many blocks in a row have been the same as the one before, and what they say for a unit
        that repeats itself (`evidence`)
    """
    for m in range(readings.shape[0]):
        for i in range(3):
            readings[m, i], readings[m, 3 + i] = block.dtheta_b[m, i], block.dv_b[m, i]
    if not block.valid or not np.isfinite(readings).all():
        return SILENT
    if not (np.isfinite(rules[0, 0] + rules[0, 1]) and _same(readings, last)):
        alike[:] = 0.0
        return GOOD
    alike[0] += 1.0
    rule = 5 if alike[0] == 1.0 else 6
    alike[1] += 3.0 * readings.shape[0] * (rules[rule, 0] + rules[rule, 1])
    return REPEATED if alike[1] >= ALIKE else GOOD


@inner(forceinline=True)
def _same(readings, last):
    """Whether two blocks are the same to the last bit."""
    for m in range(last.shape[0]):
        for k in range(6):
            if readings[m, k] != last[m, k]:
                return False
    return True


@inner(forceinline=True)
def at_range(readings, k, limit):
    """Whether a reading of axis k is at the end of the range, to a part in a thousand."""
    for m in range(readings.shape[0]):
        if abs(readings[m, k]) >= END * limit:
            return True
    return False


@inner(forceinline=True)
def at_range_throughout(readings, k, limit):
    """Whether all readings of axis k are at the end of the range: it has not been a peak of vibration."""
    for m in range(readings.shape[0]):
        if abs(readings[m, k]) < END * limit:
            return False
    return True


@inner(forceinline=True)
def limit_of_run(told, axes, triad):
    """Equal readings in a row that are too many: by what was told, or by what the triad has shown."""
    for k in range(3 * triad, 3 * triad + 3):
        told = max(told, AGAIN * axes[k].longest)
    return told


@inner(forceinline=True)
def read_axis(readings, previous, axis, k, repeats, end, dt_s):
    """Run length and mean of one axis with a new block, `end` the largest reading within its range.

    A unit whose noise is told too large repeats itself more often than that allows. A run that is too long
    and yet ends soon was no fault, and longer ones are allowed from then on.

    -> GOOD or STUCK, age of the fault s: of all of the block at least, which is given the mean
    """
    n, total, longest, begins = readings.shape[0], 0.0, 0.0, 0.0
    for m in range(n):
        value = readings[m, k]
        if value == previous:
            axis.run += 1.0
        else:
            if longest < repeats and axis.run < repeats:  # runs that were no fault
                axis.before = axis.mean_rate
            if axis.run < min(BY_ITSELF * repeats, NATURAL_S / dt_s) and abs(previous) < end:
                axis.longest = max(axis.longest, axis.run)
            axis.run = 1.0
        longest = max(longest, axis.run)
        if axis.run >= repeats:
            begins = min(begins, m + 1.0 - axis.run)
        previous, total = value, total + value
    rate = total / (n * dt_s)
    if longest >= repeats:
        axis.mean_rate = axis.before  # it has taken in repeated readings until they were too many
        return STUCK, (n - begins) * dt_s
    if not np.isfinite(axis.mean_rate):
        axis.mean_rate = axis.before = rate
    else:
        axis.mean_rate += min(1.0, n * dt_s / MEAN_S) * (rate - axis.mean_rate)
    return GOOD, n * dt_s
