"""When a campaign that flies on until its requirements are verified looks at them, and what it decides.

Whoever looks after every run and stops at the first pass is wrong more often than he says. Here the looks,
and the numbers of failures that decide at each, are settled beforehand by probability and confidence alone:
not by what was found, not by the longest that somebody wants to fly. The risk of a false pass, 1 -
confidence, is spent over the looks at which a requirement can pass: half of it at the first, a quarter at the
second, and so on (a spending function as of Lan and DeMets 1983). The first lets no failure through, the next
ones 1, 2, 4, 8, ...; each comes after the fewest runs that keep within the risk. Of the risk of a false fail
at most the share n / (n + n1) is spent after n runs, n1 the first look at which a requirement can pass. Looks
at n1/2, n1/4, ... (not below FEWEST runs) find early what fails often.

The risks are exact: probabilities are those of the number of failures in all campaigns that have not passed
(or failed) before, with the stated probability as the true one. With any smaller one a false pass is rarer,
because fewer runs without failure come. That a requirement which has failed is not looked at again makes a
pass still rarer, and likewise the other way round.
"""

from collections.abc import Iterator
from functools import cache
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from scipy.stats import binom

from shefex_nav.campaign import tolerance
from shefex_nav.campaign.tolerance import TIE

FEWEST = 20  # runs before the first look
TINY = 1e-16  # probability of numbers of failures that are left out at a look


class Look(NamedTuple):
    """What decides after so many runs."""

    runs: int
    passes: int | None  # most failures of a requirement that passes; None: none can
    fails: int | None  # fewest failures of one that fails; None: none can


class _Open:
    """Campaigns that have not stopped: how probable each number of failures is after so many runs."""

    def __init__(self, share):
        """share : probability of a failure."""
        self._share = share
        self.runs, self._first, self._mass = 0, 0, np.ones(1)

    def after(self, runs):
        """(failures, probability of each), (M,) arrays."""
        more = runs - self.runs
        low, high = (int(end(TINY, more, self._share)) for end in (binom.ppf, binom.isf))
        mass = np.convolve(self._mass, binom.pmf(np.arange(max(low, 0), high + 1), more, self._share))
        return self._first + max(low, 0) + np.arange(len(mass)), mass

    def at_most(self, failures, runs):
        """Probability of at most so many failures after so many runs, without having stopped."""
        left = failures - self._first - np.arange(len(self._mass))
        return float(self._mass @ binom.cdf(left, runs - self.runs, self._share))

    def stop(self, runs, stops=lambda failures: False):
        """Go on to so many runs and take those out that stop there. stops : of the numbers of failures"""
        failures, mass = self.after(runs)
        mass = np.where(stops(failures), 0.0, mass)
        known = np.flatnonzero(mass > TINY)
        self.runs, self._first = runs, int(failures[known[0]])
        self._mass = mass[known[0] : known[-1] + 1]


def until(probability, confidence, runs):
    """Looks at up to so many runs: list."""
    return list(takewhile(lambda look: look.runs <= runs, each(probability, confidence)))


def first_pass(probability, confidence):
    """Fewest runs after which a requirement can pass."""
    return next(look.runs for look in each(probability, confidence) if look.passes is not None)


def each(probability, confidence):
    """Looks, without end: iterator of Look."""
    known = _known(probability, confidence)
    k = 0
    while True:
        if k == len(known.found):
            known.found.append(next(known.rest))
        yield known.found[k]
        k += 1


class _Known(NamedTuple):
    """Looks as far as they were asked for."""

    found: list
    rest: Iterator


@cache
def _known(probability, confidence):
    return _Known([], _looks(1.0 - probability, 1.0 - confidence))


def _looks(share, risk):
    """The same, made. share : probability of a failure that is just allowed, risk : of each false verdict"""
    passing = _passing(share, risk)
    first = next(passing)
    open_ones, spent = _Open(share), 0.0
    for runs, passes in _all(first, passing):
        failures, mass = open_ones.after(runs)
        tails = np.cumsum(mass[::-1])[::-1]  # of so many failures or more
        may = TIE * tails < risk * runs / (runs + first[0]) - spent
        fails = int(failures[may.argmax()]) if may.any() else None
        if fails is not None:
            spent += float(tails[may.argmax()])
            open_ones.stop(runs, lambda failures, least=fails: failures >= least)
        else:
            open_ones.stop(runs)
        yield Look(runs, passes, fails)


def _all(first, passing):
    """(runs, most failures of one that passes) of looks before the first that lets one pass, and of these."""
    early = first[0]
    before = []
    while (early := -(-early // 2)) >= FEWEST:
        before.append((early, None))
    yield from reversed(before)
    yield first
    yield from passing


def _passing(share, risk):
    """(runs, most failures) of the looks at which a requirement can pass: iterator without end."""
    open_ones, allowed, spent, k = _Open(share), 0, 0.0, 1
    while True:
        left = risk * (1.0 - 0.5**k) - spent
        runs = tolerance.first(
            lambda n, least=allowed, most=left: open_ones.at_most(least, n) <= TIE * most, open_ones.runs
        )
        spent += open_ones.at_most(allowed, runs)
        yield runs, allowed
        open_ones.stop(runs, lambda failures, most=allowed: failures <= most)
        allowed, k = max(1, 2 * allowed), k + 1
