"""Rendered runs -> the parameters of the statistics.

Every part is the simplest that the judgement on other runs passes: variances of centroids as a sum of four
physical terms, detection as a normal distribution over the height above the threshold, identification as
shares by the number of stars, clutter as Poisson numbers.
"""

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.records import Reason
from shefex_nav.statistical import IdentificationModel
from shefex_nav.world.camera.sightings import SightingModel, broken

CLIP = 4.5  # sigmas; a centroid further off is another object's light
GROSS = 2.0  # times a reported sigma; what is more uncertain is two stars in one
ROUNDS = 6  # of the weights of a fit of variances
PRIOR = 1e-3  # of a source that is found, or not, for no reason of its light
SURE_Q = 20.0  # contrast at which only the border or a neighbour hides a star
NEAR_PX = 8.0  # of the border; further in, it hides nothing
ROW_SEARCHES = 50  # searches that make a row of the table of identification
FEW = 10  # first searches of a row; with fewer, those with more stars speak too
REACH = 1.05  # of the highest rate seen
LATE = 0.95  # of the highest rate that the tracker takes; seen so far, all has been seen
MOST_WRONG = 100  # rotation vectors that are kept
WHITE_DN = 0.9  # of the largest grey value; frames above tell nothing of the mean


class FitError(UserError):
    """Runs that cannot be fitted; the message says why."""


def joined(parts):
    """Records of arrays, one after the other. list of NamedTuple -> NamedTuple"""
    return type(parts[0])(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def sightings(runs, max_rate, full_dn):
    """SightingModel of rendered runs: list of Collected, rad/s, DN."""
    sources = joined([run.sources for run in runs])
    slow = of_sources(runs, np.concatenate([run.frames.rate for run in runs]) <= max_rate)
    frames = joined([run.frames for run in runs])
    dark = frames.level_dn < WHITE_DN * full_dn
    sources = sources._replace(clear=sources.clear & of_sources(runs, dark))
    border_px = border(sources)
    inside = sources.border_px > border_px
    seen = sources.clear & inside
    detection = chances(sources.features[seen], sources.found[seen])
    chosen = slow & inside & sources.clear & sources.found & (sources.hip > 0)
    if chosen.sum() < 100:
        raise FitError(
            f"the runs show {chosen.sum()} stars of the catalogue at rates that the star tracker takes; "
            "at least 100 are needed"
        )
    return SightingModel(
        detection=detection,
        clutter=clutter(frames.strangers[dark], frames.length_px[dark]),
        border_px=border_px,
        noise=variance(sources, chosen & ~sources.saturated, sources.error**2, clip=CLIP),
        reported=variance(sources, chosen & ~sources.saturated, sources.reported, clip=GROSS),
        saturation_electrons=threshold(sources.peak[sources.found], sources.saturated[sources.found]),
        mean_offset_dn=float(np.median(frames.mean_dn[dark])) if dark.any() else 0.0,
    )


def of_sources(runs, values):
    """Values of all frames of the runs, for each of their sources."""
    begins = np.cumsum([0] + [len(run.frames.t_s) for run in runs[:-1]])
    rows = [begin + run.sources.frame for begin, run in zip(begins, runs, strict=True)]
    return values[np.concatenate(rows)]


def chances(x, found):
    """d of the probability Phi(x . d) that a source is found: probit regression by Fisher's scoring.

    One source in a thousand is found, or not, for no reason of its light, so that no single one drags the
    fit; an ideal detection, d = (0, 1, 0), with a standard deviation of 10, where the data say nothing.

    (N, 3) of `sightings.features`, (N,) bool -> (3,)
    """
    from scipy.special import ndtr

    if not found.any() or found.all():
        raise FitError("the runs show no limit of detection: all sources are found, or none")
    ideal = np.array([0.0, 1.0, 0.0])
    d = ideal
    for _ in range(100):  # a dozen are usual
        t = x @ d
        p = PRIOR + (1.0 - 2.0 * PRIOR) * ndtr(t)
        slope = (1.0 - 2.0 * PRIOR) * np.exp(-0.5 * t**2) / np.sqrt(2.0 * np.pi)
        weight = slope / (p * (1.0 - p))
        curvature = (x * (weight * slope)[:, None]).T @ x + 0.01 * np.eye(3)
        step = np.linalg.solve(curvature, x.T @ (weight * (found - p)) + 0.01 * (ideal - d))
        step *= min(1.0, 0.5 / np.abs(step).max())
        d = d + step
        if np.abs(step).max() < 1e-8:
            break
    return d


def clutter(strangers, length_px):
    """(c0, c1) >= 0 of the mean number of objects that are no source: c0 + c1 broken(length_px).

    Least squares with the weights of Poisson numbers. (M,), (M,) -> (2,)
    """
    from scipy.optimize import nnls

    if not len(strangers):
        return np.zeros(2)
    terms = np.column_stack([np.ones(len(strangers)), broken(length_px)])
    c = np.array([1.0, 1.0])
    for _ in range(ROUNDS):
        root = np.sqrt(np.maximum(terms @ c, 1e-3))
        c = nnls(terms / root[:, None], strangers / root)[0]
    return c


def threshold(value, above):
    """The limit of `value` that tells best which are `above`; infinite if none is. Arrays (n,) -> float"""
    if not above.any():
        return np.inf
    order = np.argsort(value)
    sorted_above = above[order]
    missed = np.concatenate([[0], np.cumsum(sorted_above)])  # above, but below the limit
    false = np.concatenate([[(~sorted_above).sum()], (~sorted_above).sum() - np.cumsum(~sorted_above)])
    k = int(np.argmin(missed + false))
    edges = np.concatenate([[value[order[0]]], value[order], [value[order[-1]]]])
    return float(0.5 * (edges[k] + edges[k + 1]))


def border(sources):
    """How near to the border even a bright source is not found [px]."""
    near = sources.clear & (sources.q > SURE_Q) & ~sources.saturated & (sources.border_px < NEAR_PX)
    if sources.found[near].all():
        return 0.0
    if not sources.found[near].any():
        raise FitError(f"no bright source nearer to the border than {NEAR_PX:g} pix is found")
    return max(0.0, threshold(sources.border_px[near], sources.found[near]))


def variance(sources, chosen, values, *, clip):
    """c (4,) >= 0 of variance = c . terms, along and across the streak alike.

    Least squares of the squared errors, or of the reported variances, each relative to what is expected of
    it; weights follow the fit.

    sources : Sources; chosen : (N,) bool; values : (N, 2) px^2; clip : sigmas of an error that is left out
    """
    from scipy.optimize import nnls

    terms = np.concatenate([sources.along[chosen], sources.across[chosen]])
    values = np.concatenate([values[chosen, 0], values[chosen, 1]])
    c = np.array([1e-4, 1.0, 1.0, 1e-2])
    for _ in range(ROUNDS):
        expected = terms @ c
        used = values < clip**2 * expected
        c = nnls(terms[used] / expected[used, None], values[used] / expected[used])[0]
    return c


def identification(runs, max_rate, limit_wrong):
    """IdentificationModel of rendered runs.

    Parameters
    ----------
    runs : list of Collected
    max_rate : float, rad/s, above which the star tracker gives no attitude
    limit_wrong : float, rad, an attitude further off is wrong
    """
    frames = joined([run.frames for run in runs])
    sources = joined([run.sources for run in runs])
    good = frames.reason == Reason.NONE
    if not good.any():
        raise FitError("no frame of the runs gave an attitude")
    tracked = of_sources(runs, good) & sources.found & (sources.hip > 0)
    searches = joined([run.searches for run in runs])
    wrong = searches.good & (np.linalg.norm(searches.error, axis=1) > limit_wrong)
    fastest = float(frames.rate[good].max())
    stars, first, later, misled = table(searches, wrong)
    return IdentificationModel(
        stars=stars,
        first=first,
        later=later,
        wrong=misled,
        wrong_turns=searches.error[wrong][:MOST_WRONG],
        named=float(sources.named[tracked].mean()),
        fastest=max_rate if fastest > LATE * max_rate else REACH * fastest,
    )


def table(searches, wrong):
    """Shares by the number of stars of the catalogue among the objects.

    Numbers of stars are put together, from the largest down, until a row has ROW_SEARCHES searches after a
    fix; the rest goes to the last. A row without FEW first searches takes the share of all rows above.

    Parameters
    ----------
    searches : Searches
    wrong : (K,) bool, gave a wrong attitude

    Returns
    -------
    (k,) int, the smallest number of each row, ascending
    (k,) share that is identified, without a fix before; (k,) soon after one
    (k,) share of these attitudes that is wrong
    """
    numbers, of_first, of_later, of_wrong = [], [], [], []
    last = None  # largest number of the row
    for number in np.unique(searches.stars)[::-1]:
        last = number if last is None else last
        row = (searches.stars >= number) & (searches.stars <= last)
        if (row & ~searches.first).sum() < ROW_SEARCHES and number > searches.stars.min():
            continue
        last = None
        later, early, more = row & ~searches.first, row & searches.first, searches.stars >= number
        early = early if early.sum() >= FEW else more & searches.first
        early = early if early.any() else later
        numbers.append(number)
        of_later.append(searches.matched[later if later.any() else early].mean())
        of_first.append(searches.matched[early].mean())
        of_wrong.append(wrong[row].sum() / max(searches.good[row].sum(), 1))
    ascending = [np.array(column)[::-1] for column in (numbers, of_first, of_later, of_wrong)]
    return ascending[0].astype(np.int64), *ascending[1:]
