"""Which dispersion explains the results: rank correlation, a standardised regression, and what fails.

An error about zero (attitude about an axis) follows a draw with its sign. The size of an error does not: it
grows to both sides of the nominal value, which no correlation with the draw itself shows. So each draw counts
twice, as it is and by its distance from the median of the draws (`|path|`). A draw of words becomes one
feature of 0 and 1 for each word but the most frequent.
"""

from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy import stats

from shefex_nav.campaign import r_squared, spearman, table
from shefex_nav.campaign.over_time import holm, with_holm
from shefex_nav.campaign.statistics import ATTITUDE, ENTRY

MOST_RUNS = 10_000  # the first ones, as random as any: more would show what is too small to matter
RUNS_PER_FEATURE = 5  # a regression on fewer finds what is not there
CONFIDENCE = 0.95
FEWEST = 8  # runs of which a correlation is worth a test
SIGNIFICANT = 0.05
ALONE = 1e-6  # of a run's residual, if the run alone decides a coefficient: it is nearly zero then, too
SAME = 1e-10  # share of a feature's variance that the others leave, below which it is one of them again
OUTCOMES = (  # name, columns (their norm if several), keeps its sign
    *((f"attitude {axis} at entry", (column,)) for axis, column in zip("xyz", ATTITUDE, strict=True)),
    ("attitude at entry, size", ATTITUDE),
    ("position at entry, size", (f"{ENTRY}.position_error_m",)),
    ("velocity at entry, size", (f"{ENTRY}.velocity_error_m_s",)),
    ("attitude, rms of the run", ("summary.navigation.attitude_error_deg.rms",)),
    ("position, rms of the run", ("summary.navigation.position_error_m.rms",)),
    ("star fixes", ("summary.star_tracker.solved",)),
    ("apogee", ("summary.flight.apogee_km",)),
)


class Feature(NamedTuple):
    """A draw as a number."""

    name: str
    values: np.ndarray  # (N,)


class Rank(NamedTuple):
    """Spearman's correlation of an outcome with a feature."""

    outcome: str
    feature: str
    rho: float
    p: float
    p_holm: float  # corrected for all outcomes and features
    samples: int


class Effect(NamedTuple):
    """Standardised coefficient of a regression: sigmas of the outcome per sigma of the feature."""

    feature: str
    value: float
    low: float
    high: float


class Regression(NamedTuple):
    """Linear regression of an outcome on all features."""

    outcome: str
    samples: int
    r2: float  # adjusted: what the draws explain, not the fit to these runs (`r_squared`)
    r2_low: float
    r2_high: float
    effects: tuple  # of Effect of the features that others do not determine, the largest first
    distances: bool = True  # whether they are among them


class Separation(NamedTuple):
    """How the draws of failed runs differ from the others' (Mann and Whitney)."""

    feature: str
    effect: float  # rank-biserial: 1 if every failed run drew more than every other, -1 if less
    p_holm: float
    failed_from: float
    failed_to: float
    others_from: float
    others_to: float


def features(draws, *, spread=True):
    """Features of draws {path: (N,)}; constant ones are none. -> list of Feature"""
    result = []
    for path, values in draws.items():
        if values.dtype == object:
            result += _of_words(path, values)
            continue
        values = values.astype(float)
        known = values[np.isfinite(values)]
        if not len(known) or np.ptp(known) == 0.0:
            continue
        result.append(Feature(path, values))
        distance = np.abs(values - np.median(known))
        if spread and len(np.unique(distance[np.isfinite(distance)])) > 2:  # of two values it is a constant
            result.append(Feature(f"|{path}|", distance))
    return result


def _of_words(path, values):
    """One feature for each word but the most frequent."""
    words, counts = np.unique([str(value) for value in values], return_counts=True)
    others = np.delete(words, np.argmax(counts)).tolist()
    return [Feature(f"{path} = {word}", (values.astype(str) == word).astype(float)) for word in others]


def drawn(campaign):
    """Draws of the first MOST_RUNS runs: {path: (N,)}."""
    return {path: values[:MOST_RUNS] for path, values in campaign.draws.first(MOST_RUNS).items()}


def outcomes(campaign):
    """What is to be explained, of the first MOST_RUNS runs: dict name -> (N,), NaN of runs without it."""
    result, used = {}, min(len(campaign), MOST_RUNS)
    first = campaign.columns.first(used)
    for name, columns in OUTCOMES:
        values = np.array([table.numbers(first, column, used) for column in columns])
        one = values[0] if len(columns) == 1 else np.linalg.norm(values, axis=0)
        one = np.where(campaign.succeeded[:used], one, np.nan)
        known = one[np.isfinite(one)]
        if len(known) >= FEWEST and np.ptp(known) > 0.0:
            result[name] = one
    return result


def ranks(found, features):
    """Spearman's correlation of every outcome with every feature, the surest first: list of Rank.

    found : dict name -> (N,);  features : list of Feature
    """
    result, ranked = [], {}  # features are ranked once for all results of the same runs
    for name, values in found.items():
        for k, feature in enumerate(features):
            known = np.isfinite(values) & np.isfinite(feature.values)
            n = int(known.sum())
            sides = []
            for key, side in ((name, values), (k, feature.values)):
                key = (key, known.tobytes())
                if key not in ranked:
                    usable = n >= FEWEST and np.ptp(side[known]) > 0.0
                    ranked[key] = spearman.ranked(side[known]) if usable else None
                sides.append(ranked[key])
            if all(side is not None for side in sides):
                result.append(Rank(name, feature.name, *spearman.correlation(*sides), 1.0, n))
    return sorted(with_holm(result), key=lambda one: (one.p, -abs(one.rho)))


def regress(outcome, values, features):
    """Standardised linear regression of values (N,) on features; None if there are too few runs for it.

    Intervals of coefficients are those of the delta method with the influence of each run on coefficient and
    standard deviations (robust against errors whose size depends on a draw), its residual as if the run had
    no part in the fit; 95 %. R^2: see `r_squared`.
    """
    columns = np.array([feature.values for feature in features]).T
    known = np.isfinite(values) & np.isfinite(columns).all(axis=1) if len(features) else np.zeros(0, bool)
    n = int(known.sum())
    if n < max(RUNS_PER_FEATURE * (len(features) + 1), FEWEST) or np.ptp(values[known]) == 0.0:
        return None
    y, x = values[known] - values[known].mean(), columns[known] - columns[known].mean(axis=0)
    y_std, x_std = y / y.std(), x / np.where(x.std(axis=0) > 0.0, x.std(axis=0), 1.0)
    kept = _independent(x_std)
    names = [feature.name for feature in features]
    if not kept:
        return None
    effects, fit = _standardised(y_std, x_std[:, kept])
    r2 = r_squared.estimate(fit, y_std - fit, len(kept), CONFIDENCE)
    effects = (Effect(names[j], *row) for j, row in zip(kept, effects, strict=True))
    ordered = tuple(sorted(effects, key=lambda effect: -abs(effect.value)))
    return Regression(outcome, n, *r2, ordered)


def _standardised(y, x):
    """Fit of standardised y (n,) on standardised x (n, m): list of (value, low, high), fitted y (n,)."""
    n, m = x.shape
    gram = x.T @ x / n
    beta = np.linalg.solve(gram, x.T @ y / n)
    fit = x @ beta
    by_each = np.linalg.solve(gram, x.T).T  # (n, m)
    # a run draws the fit towards itself, so that its residual is too small: of few runs by much
    left = (y - fit) / np.maximum(1.0 - (1.0 + np.einsum("nm,nm->n", x, by_each)) / n, ALONE)
    # influence of each run on beta, and on the deviations by which it is standardised
    influence = by_each * left[:, None] + 0.5 * beta * (x**2 - (y**2)[:, None])
    student = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, n - m - 1))
    half = student * influence.std(axis=0) / np.sqrt(n - 1.0)
    return [(float(b), float(b - h), float(b + h)) for b, h in zip(beta, half, strict=True)], fit


def _independent(x):
    """Indices of standardised columns (n, m) that those before them do not determine."""
    kept, basis = [], np.zeros((len(x), 0))
    for j in range(x.shape[1]):
        rest = x[:, j] - basis @ (basis.T @ x[:, j])
        rest = rest - basis @ (basis.T @ rest)
        size = float(rest @ rest)
        if size > SAME * len(x):
            kept.append(j)
            basis = np.column_stack([basis, rest / np.sqrt(size)])
    return kept


def regressions(found, draws):
    """Regression of every outcome: on draws and their distances, or on the draws alone if runs are few."""
    result, every, alone = [], features(draws), features(draws, spread=False)
    for name, values in found.items():
        one = regress(name, values, every)
        if one is None and (one := regress(name, values, alone)) is not None:
            one = one._replace(distances=len(alone) == len(every))
        if one is not None:
            result.append(one)
    return result


def separations(campaign):
    """How draws tell failed runs from the others, the surest first: list of Separation; empty if none can.

    Of the others, those among the first MOST_RUNS runs. Where runs drew the same, p is that of `spearman`:
    the usual one takes a normal distribution, and of the one run that failed in 200, with a word that 5 % of
    the runs drew, makes 1e-5 of one in twenty.
    """
    failed, result = ~campaign.succeeded, []
    if not failed.any() or failed.all():
        return result
    used = failed | (np.arange(len(failed)) < MOST_RUNS)
    failed = failed[used]
    each = (features({path: values[used]}) for path, values in campaign.draws.items())  # one at a time
    for feature in chain.from_iterable(each):
        known = np.isfinite(feature.values)
        bad, good = feature.values[known & failed], feature.values[known & ~failed]
        if not len(bad) or not len(good):
            continue
        u, p = stats.mannwhitneyu(bad, good)
        if len(np.unique(feature.values[known])) < known.sum() >= spearman.FEWEST:
            p = spearman.correlation(*map(spearman.ranked, (failed[known], feature.values[known])))[1]
        effect = 2.0 * float(u) / (len(bad) * len(good)) - 1.0
        ends = (float(end) for end in (bad.min(), bad.max(), good.min(), good.max()))
        result.append(Separation(feature.name, effect, float(p), *ends))
    corrected = holm([one.p_holm for one in result])
    result = [one._replace(p_holm=float(p)) for one, p in zip(result, corrected, strict=True)]
    return sorted(result, key=lambda one: (one.p_holm, -abs(one.effect)))
