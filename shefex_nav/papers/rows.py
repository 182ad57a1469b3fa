"""Rows of the tables: shares, counts, medians, and figures that are held against what was published."""

from math import isfinite

import numpy as np

from shefex_nav.papers import verdict
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.verdict import POINTS, Judgement, Verdict
from shefex_nav.report import intervals


def share(quantity, condition, k, n):
    """Row of k of n samples, with its interval, that has nothing published beside it."""
    return Row(quantity, condition, None, k / n, intervals.proportion(int(k), int(n)))


def together(parts, wholes):
    """Interval of a share of trials that belong together: frames of a direction, rates of an attitude.

    The clusters are what was drawn. Where none of all trials or all of them are meant, nothing tells how much
    those of a cluster have in common, and each cluster counts as one trial. None of a single cluster.

    parts, wholes : (n,) successes and trials of each cluster
    """
    parts, wholes = np.asarray(parts, dtype=float), np.asarray(wholes, dtype=float)
    parts, wholes = parts[wholes > 0.0], wholes[wholes > 0.0]
    n, k = len(wholes), parts.sum()
    if n < 2:
        return None
    if k in (0.0, wholes.sum()):
        return intervals.proportion(n if k else 0, n)
    return intervals.clustered(parts, wholes)


def share_together(quantity, condition, which):
    """As `share`, of trials that belong together. which : (n, ...) bool, the first axis is what was drawn"""
    by_cluster = which.reshape(len(which), -1)
    ends = together(by_cluster.sum(axis=1), np.full(len(which), by_cluster.shape[1]))
    return Row(quantity, condition, None, float(which.mean()), ends)


def median(quantity, condition, values):
    """Row of the median of values (n,), with its interval, that has nothing published beside it."""
    return Row(quantity, condition, None, float(np.median(values)), intervals.percentile(values, 50.0))


def given(quantity, condition, published, measured):
    """Row of a figure that was put in: an input where it is the published one, else open."""
    if abs(measured - published) <= 1e-9 * abs(published):
        return Row(quantity, condition, published, measured, None, *Judgement(Verdict.INPUT, 0.0))
    why = "the experiment is not set up as the paper's"
    return Row(quantity, condition, published, measured, None, *Judgement(Verdict.OPEN, 0.0, why))


def count(quantity, condition, published, measured, why="", tolerance=0.0):
    """Row of a count, which has no sampling error.

    tolerance : float, of what the paper gives as 'about', in the unit of the count
    """
    same = abs(measured - published) <= tolerance
    words = "" if same else why or verdict.NOT_EXPLAINED
    judged = Judgement(Verdict.REPRODUCED if same else Verdict.OPEN, tolerance, words)
    return Row(quantity, condition, published, measured, None, *judged)


def trend(quantity, condition, published, measured, n, why, least=verdict.LEAST):
    """Row of curves or steps that do what the text says of them; n: samples behind each."""
    row = count(quantity, condition, published, measured, why)
    if n < least:
        return row._replace(verdict=Verdict.TOO_FEW, why=verdict.TOO_FEW_WORDS)
    return row._replace(tolerance=None)


def figure(quantity, condition, published, measured, ci95, n, why="", **how):
    """Row of a figure beside a published one, as `verdict.compare` judges it; why: if it differs."""
    judged = verdict.compare(published, measured, ci95, n, **how)
    if why and judged.verdict == Verdict.OPEN:
        judged = judged._replace(why=why)
    return Row(quantity, condition, published, measured, ci95, *judged)


def published_share(quantity, condition, published, k, n, *, n_published=None, **how):
    """The same of k of n samples; n_published: those of the paper, where they are known.

    To be the same, a share must be known to half of itself or of what it lacks to one, and to ten points:
    that none of 300 failed does not reproduce one failure in a hundred. Twice the paper's error is enough.
    """
    measured, of_paper, theirs = k / n, None, 0.0
    if n_published is not None:
        of_paper = intervals.proportion(round(published * n_published), n_published)
        theirs = verdict.reach(published, of_paper, measured)
    resolves = max(min(POINTS, 0.5 * min(published, 1.0 - published)), 2.0 * theirs)
    ci95 = intervals.proportion(int(k), int(n))
    given = quantity, condition, published, measured, ci95, n
    return figure(*given, resolves=resolves, of_paper=of_paper, **how)


def statement(quantity, condition, published, measured, ci95, n, why="", **criterion):
    """Row of what a paper says in words: the criterion is a range, see `verdict.judgement`."""
    judged = verdict.ranged(verdict.STATEMENT, n, measured, ci95, why, **criterion)
    return Row(quantity, condition, published, measured, ci95, *judged)


def goal(quantity, condition, published, measured, ci95, n, why="", **criterion):
    """Row of a goal of our own; the paper's figure may stand beside it."""
    judged = verdict.ranged(verdict.GOAL, n, measured, ci95, why, **criterion)
    return Row(quantity, condition, published, measured, ci95, *judged)


def goal_none(quantity, condition, which):
    """Goal: none of these (n,) bool. One that occurred is one too many, however few there were.

    which : (n,), or (n, m) with m trials of each of the n that were drawn
    """
    if which.ndim == 1:
        ends = intervals.proportion(int(which.sum()), len(which))
        return _none(quantity, condition, int(which.sum()), len(which), (len(which), ends))
    return goal_none_together(quantity, condition, which.sum(axis=1), np.full(len(which), which.shape[1]))


def goal_none_together(quantity, condition, parts, wholes):
    """The same of trials that belong together. parts, wholes : as of `together`"""
    measured = wholes.sum(), together(parts, wholes)
    return _none(quantity, condition, int(parts.sum()), len(parts), measured)


def _none(quantity, condition, k, n, measured):
    """Row of the goal that none of these occurs. k : that did;  n : drawn;  measured : trials, their share"""
    trials, ends = measured
    ci95 = None if ends is None else tuple(float(trials * end) for end in ends)
    if k:
        judged = Judgement(Verdict.GOAL_MISSED, None, verdict.NOT_EXPLAINED)
    else:
        judged = Judgement(Verdict.GOAL_MET if n >= verdict.LEAST else Verdict.TOO_FEW)
        judged = judged._replace(why="" if n >= verdict.LEAST else verdict.TOO_FEW_WORDS)
    return Row(quantity, condition, None, float(k), ci95, *judged)


def calibrated(row):
    """The row as one whose figure an assumption was chosen for. One that differs stays what it is."""
    return row._replace(verdict=Verdict.CALIBRATED) if row.verdict == Verdict.REPRODUCED else row


def variant(row):
    """A row that another is explained by: shown, not counted, unless an assumption was chosen for it."""
    return row if row.verdict == Verdict.CALIBRATED else Row(*row[:5])


def explained(row, other, run, words, passes=False):
    """A row that differs, explained by a run with something otherwise; unchanged where that does not reach.

    A figure that is better than the paper's stays so, and says which run is as the paper.

    Parameters
    ----------
    row, other : Row of one published figure, measured without and with the change
    run : str, experiment/variant
    words : str, what is otherwise in that run, and how many things if it is more than one
    passes : bool, of something continuous: it is enough that the figure lies between the two
    """
    if row.verdict not in (Verdict.OPEN, Verdict.BETTER) or not isfinite(other.measured):
        return row
    reached = other.verdict in (Verdict.REPRODUCED, Verdict.CALIBRATED)
    between = (
        passes
        and other.verdict != Verdict.TOO_FEW
        and ((row.measured - row.published) * (other.measured - other.published) < 0.0)
    )
    if not (reached or between):
        return row
    said = "it is" if reached else "the published figure lies between, it is"
    value = other.measured
    why = f"{words}, {said} {value:.0f} ({run})" if value >= 1e3 else f"{words}, {said} {value:.4g} ({run})"
    differs = Verdict.EXPLAINED if row.verdict == Verdict.OPEN else Verdict.BETTER
    return row._replace(verdict=differs, why=why, run=run)


# Differences that another experiment explains: known once both have run.
# the second has no part in the best case, in which there are no false objects
JOINT = "2 things otherwise, the joint set of assumptions: the spot, and magnitudes of the false objects"
# name -> (the experiment that has something otherwise, what); rows belong together by quantity and condition
EXPLAINED_BY = {
    "impa-images": ("impa-joint", JOINT),
    "impa-attitude": ("impa-joint", JOINT),
}


def linked(outcomes):
    """Outcomes whose rows are explained where another of them reaches the published figure.

    outcomes : dict of name -> Outcome
    """
    made = dict(outcomes)
    for name, (other, words) in EXPLAINED_BY.items():
        if name in outcomes and other in outcomes:
            there = {(row.quantity, row.condition): row for row in outcomes[other].rows}
            found = []
            for row in outcomes[name].rows:
                variant = there.get((row.quantity, row.condition))
                found.append(row if variant is None else explained(row, variant, other, words))
            made[name] = outcomes[name]._replace(rows=found)
    return made
