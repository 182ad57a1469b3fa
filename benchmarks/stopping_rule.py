"""How often campaigns that fly until verified are wrong, and how many runs they take.

    python benchmarks/stopping_rule.py [--procedures 100000] [--probability 0.99865] [--confidence 0.9]

Procedures of Bernoulli runs for several true probabilities, by the looks of `campaign --until-verified`, up
to --runs at most; beside them the fixed plan without a failure, and a campaign that is flown on from one such
number to the next until it passes.
"""

import argparse

import numpy as np

from shefex_nav.campaign import looks, tolerance
from shefex_nav.report import intervals

RATES = (0.0, 0.1, 0.25, 0.5, 0.999, 1.001, 2.0, 4.0, 10.0, 100.0)  # of the share that is just allowed
NAIVE = 20  # failures that are let through at most


def procedures(plan, share, n, rng):
    """Share that passes, that fails, and mean runs of n procedures. plan : list of Look"""
    missed, verdict = np.zeros(n, int), np.zeros(n, int)
    stopped, before = np.full(n, plan[-1].runs), 0
    for look in plan:
        missed += rng.binomial(look.runs - before, share, n)
        before = look.runs
        now = np.zeros(n, int)
        if look.fails is not None:
            now[missed >= look.fails] = -1
        if look.passes is not None:
            now[missed <= look.passes] = 1
        new = (verdict == 0) & (now != 0)
        verdict[new], stopped[new] = now[new], look.runs
    return int((verdict > 0).sum()), int((verdict < 0).sum()), float(stopped.mean())


def naive(stated, share, n, rng):
    """How many of n campaigns pass at one of the numbers of runs that let 0, 1, 2, ... failures through."""
    missed, passed, before = np.zeros(n, int), np.zeros(n, bool), 0
    for failures in range(NAIVE):
        runs = tolerance.needed(failures, *stated)
        missed += rng.binomial(runs - before, share, n)
        before = runs
        passed |= missed <= failures
    return int(passed.sum())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--procedures", type=int, default=100_000)
    parser.add_argument("--probability", type=float, default=0.99865)
    parser.add_argument("--confidence", type=float, default=0.9)
    parser.add_argument("--runs", type=int, default=50_000)
    given = parser.parse_args()
    stated, rng, n = (given.probability, given.confidence), np.random.default_rng(1), given.procedures
    plan = looks.until(*stated, given.runs)
    if not plan:
        parser.error(f"--runs is {given.runs}; too few to look even once")
    print("looks:", *(f"{one.runs} (<= {one.passes} pass, >= {one.fails} fail)" for one in plan), sep="\n  ")
    fixed = tolerance.needed(0, *stated)
    heads = ("missed by", 12), ("pass", 8), ("(99 % interval)", 20), ("fail", 8), ("runs", 8)
    print(*(f"{name:>{width}}" for name, width in (*heads, (f"pass of {fixed}", 14))))
    for rate in RATES:
        share = rate * (1.0 - given.probability)
        if share > 1.0:
            continue
        passed, failed, runs = procedures(plan, share, n, rng)
        low, high = intervals.proportion(passed, n, 0.99)
        of_fixed = (1.0 - share) ** fixed
        print(
            f"{100 * share:>10.5f} % {passed / n:>8.4f} {f'{low:.4f} to {high:.4f}':>20} {failed / n:>8.4f} "
            f"{runs:>8.0f} {of_fixed:>14.3f}"
        )
    share = 1.001 * (1.0 - given.probability)
    passed = naive(stated, share, n, rng)
    words = f"{NAIVE} of the numbers that let 0, 1, 2, ... failures through"
    print(f"flown on over {words}, missed by {100 * share:.5f} %: {passed / n:.3f} pass")


if __name__ == "__main__":
    main()
