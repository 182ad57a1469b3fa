"""Rows of the tables: shares, counts, medians, and figures that are held against what was published."""

import numpy as np

from shefex_nav.papers.experiment import Row
from shefex_nav.papers.verdict import judgement
from shefex_nav.report import intervals


def share(quantity, condition, k, n, published=None):
    """Row of k of n samples, with its interval, without a verdict."""
    return Row(quantity, condition, published, k / n, intervals.proportion(int(k), int(n)))


def median(quantity, condition, values):
    """Row of the median of values (n,), with its interval, that has nothing published beside it."""
    return Row(quantity, condition, None, float(np.median(values)), intervals.percentile(values, 50.0))


def count(quantity, condition, published, measured, why, tolerance=0.0):
    """Row of a count, which has no sampling error.

    why : the reason if it differs by more than the share `tolerance` of the published one
    """
    agrees = bool(abs(measured - published) <= tolerance * published)
    return Row(quantity, condition, published, measured, None, agrees, "" if agrees else why)


def judged(quantity, condition, published, measured, ci95, why, **criterion):
    """Row with the verdict of `judgement`, which `why` and the criterion are for."""
    return Row(quantity, condition, published, measured, ci95, *judgement(measured, ci95, why, **criterion))


def near(quantity, condition, published, measured, ci95, why, margin):
    """The same of a figure that agrees within a margin about the published one."""
    criterion = {"least": published - margin, "most": published + margin, "resolves": margin}
    return judged(quantity, condition, published, measured, ci95, why, **criterion)


def judged_share(quantity, condition, published, k, n, why, **criterion):
    """The same of k of n samples, with its interval."""
    return judged(quantity, condition, published, k / n, intervals.proportion(k, n), why, **criterion)
