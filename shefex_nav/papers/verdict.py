"""What is said of a measured figure: its class, the tolerance, the reason, and the run that explains it.

A published figure and a measured one are the same if they differ by no more than the tolerance: the sampling
error of both (half of the 95 % interval, towards the other) and half a unit of the last digit that the paper
prints. It is taken in both directions: a figure that is better than the paper's has not reproduced it either.
A sentence of a paper ('most', 'faster') and a goal of our own have a side that is right.
"""

from enum import StrEnum
from math import hypot, inf, isfinite
from typing import NamedTuple

POINTS = 0.10  # of a share: what counts as the same, and the interval that is narrow enough to say so
LEAST = 20  # values below which an interval that comes from their scatter is not believed
TOO_FEW_WORDS = (
    "too few samples: the interval holds values that agree and values that do not, and is wider than the "
    "tolerance; a larger --samples narrows it"
)
NO_FIGURE = "these samples give no figure: what is asked for did not occur among them"
NOT_EXPLAINED = "not explained"


class Verdict(StrEnum):
    """Class of a row."""

    INPUT = "input"  # taken from the paper: it says that the experiment was set up, and nothing else
    CALIBRATED = "calibrated"  # an assumption was chosen so that it comes out
    REPRODUCED = "reproduced"
    BETTER = "better"
    EXPLAINED = "differs, explained"  # a run that is named reaches the figure with what it has otherwise
    OPEN = "differs, open"
    TOO_FEW = "too few"  # the sample cannot tell
    GOAL_MET = "own goal met"
    GOAL_MISSED = "own goal missed"
    NONE = "not judged"  # nothing published, or one step of a scan


DIFFERS = (Verdict.EXPLAINED, Verdict.OPEN)


class Judgement(NamedTuple):
    """The last four columns of a Row."""

    verdict: Verdict
    tolerance: float | None = None  # in the unit of the figure
    why: str = ""
    run: str = ""  # experiment/variant, of EXPLAINED


def reach(value, interval, other):
    """Half of an interval on the side of the other value, the longer one if equal; infinite without one."""
    if interval is None:
        return inf
    low, high = (abs(value - end) if isfinite(end) else inf for end in interval)
    if other == value:
        return max(low, high)
    return low if other < value else high


def compare(published, measured, ci95, n, *, resolves, rounding=0.0, of_paper=None, better=""):
    """Judge a figure against a published one, in both directions.

    Parameters
    ----------
    published, measured : float
    ci95 : (low, high) of the measured one, or None where there were too few values for one
    n : int, values that it comes from
    resolves : float, greatest tolerance with which two figures are said to be the same
    rounding : float, half a unit of the last digit that is published, or what a drawing can be read to
    of_paper : (low, high) of the published one; None: its sample is not known, no error is allowed for
    better : 'more', 'less' or '': what would be better than published

    Returns
    -------
    Judgement
    """
    if not isfinite(measured):
        return Judgement(Verdict.TOO_FEW, None, NO_FIGURE)
    theirs = 0.0 if of_paper is None else reach(published, of_paper, measured)
    tolerance = rounding + hypot(reach(measured, ci95, published), theirs)
    stated = tolerance if isfinite(tolerance) else None
    difference = measured - published
    if n < LEAST or stated is None:
        return Judgement(Verdict.TOO_FEW, stated, TOO_FEW_WORDS)
    if abs(difference) <= tolerance:
        if tolerance > resolves + rounding:
            return Judgement(Verdict.TOO_FEW, stated, TOO_FEW_WORDS)
        return Judgement(Verdict.REPRODUCED, stated)
    if better and (difference > 0.0) == (better == "more"):
        return Judgement(Verdict.BETTER, stated)
    return Judgement(Verdict.OPEN, stated, NOT_EXPLAINED)


def judgement(measured, ci95, why, *, least=-inf, most=inf, resolves, refuted=False):
    """Judge one figure against a range.

    A sample judges where its interval lies on one side of the criterion, or where the interval reaches no
    further than the tolerance of the criterion to either side. In the latter case the figure itself decides,
    as that of a paper does, which is a sample too. Otherwise the verdict is left open.

    Parameters
    ----------
    measured : float
    ci95 : (low, high), or None where there were too few values for one
    why : str, the reason if it disagrees
    least, most : float, the range that agrees
    resolves : float, greatest half width of an interval across a criterion that still judges
    refuted : bool, disagree only where the whole interval lies outside of the range

    Returns
    -------
    agrees : bool, or None where the sample cannot tell
    why : str, empty where it agrees
    """
    if not isfinite(measured):
        return None, NO_FIGURE
    low, high = (-inf, inf) if ci95 is None else ci95
    low, high = low if isfinite(low) else -inf, high if isfinite(high) else inf
    touches, leaves = high >= least and low <= most, low < least or high > most
    if touches and leaves and 0.5 * (high - low) > resolves:
        return None, TOO_FEW_WORDS
    agrees = bool(touches if refuted else least <= measured <= most)
    return agrees, "" if agrees else why


STATEMENT = {True: Verdict.REPRODUCED, False: Verdict.OPEN, None: Verdict.TOO_FEW}
GOAL = {True: Verdict.GOAL_MET, False: Verdict.GOAL_MISSED, None: Verdict.TOO_FEW}


def ranged(verdicts, n, measured, ci95, why, **criterion):
    """Judgement of `judgement`, in the words of STATEMENT or GOAL; none below LEAST values."""
    if n < LEAST:
        return Judgement(Verdict.TOO_FEW, None, TOO_FEW_WORDS)
    agrees, reason = judgement(measured, ci95, why or NOT_EXPLAINED, **criterion)
    return Judgement(verdicts[agrees], None, reason)
