"""What so many runs show of the probability with which a requirement is met: binomial, exact and one-sided.

A run meets a requirement or does not. After f of n runs that do not, the requirement passes at a confidence
if the lower bound of Clopper and Pearson (1934) of the probability is at least the stated one, which is the
order statistic of Wilks (1941): P(F <= f) <= 1 - confidence if it were exactly the stated one. It fails if
the upper bound is below: P(F >= f) < 1 - confidence. Each holds of a number of runs that was settled before.
"""

import math

from scipy.special import betainc

from shefex_nav.report import intervals

TIE = 1.0 + 1e-9  # as often as is stated but for rounding is as often
FAR = 10**7  # runs, beyond which nobody flies: 'at this rate' is not told


def at_most(failures, runs, share):
    """Probability of at most so many failures. share : probability of a failure"""
    return 1.0 if failures >= runs else float(betainc(runs - failures, failures + 1, 1.0 - share))


def at_least(failures, runs, share):
    """Probability of so many failures or more."""
    return 1.0 if failures == 0 else float(betainc(failures, runs - failures + 1, share))


def passes(failures, runs, probability, confidence):
    """Whether a requirement passes."""
    return runs > 0 and at_most(failures, runs, 1.0 - probability) <= TIE * (1.0 - confidence)


def fails(failures, runs, probability, confidence):
    """Whether a requirement fails."""
    return runs > 0 and TIE * at_least(failures, runs, 1.0 - probability) < 1.0 - confidence


def bounds(failures, runs, confidence):
    """One-sided bounds of the probability that a requirement is met, each at the confidence: least, most."""
    return intervals.proportion(runs - failures, runs, 2.0 * confidence - 1.0)


def needed(failures, probability, confidence):
    """Fewest runs with which a requirement passes in spite of so many failures: int."""
    return first(lambda runs: passes(failures, runs, probability, confidence), failures)


def at_rate(failures, runs, probability, confidence):
    """Runs in all until an undecided requirement passes or fails, if it is missed as often as so far.

    -> int; None where that is too near the stated probability to be told (beyond FAR runs)
    """
    rate = failures / runs
    if rate < 1.0 - probability:
        if failures == 0:
            return needed(0, probability, confidence)
        found = first(
            lambda k: k > FAR * rate or rate * needed(k, probability, confidence) <= k, failures - 1
        )  # fmt: skip
        total = needed(found, probability, confidence)
    else:
        found = first(
            lambda k: k > FAR * rate or fails(k, math.ceil(k / rate), probability, confidence), failures
        )
        total = math.ceil(found / rate)
    return total if total <= FAR else None


def first(holds, after):
    """Smallest whole number above `after` for which something holds that holds from there on."""
    step = 1
    while not holds(after + step):
        step *= 2
    low, high = after + step // 2, after + step
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle, high)
    return high
