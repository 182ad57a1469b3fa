"""Subset simulation: the probability of a rare event as a product of probabilities that are not small.

S.-K. Au, J. L. Beck, Estimation of small failure probabilities in high dimensions by subset simulation,
Probabilistic Engineering Mechanics 16, 2001. In: a function of what is drawn, which is beyond a limit in the
event. Level 0 is plain Monte Carlo. The tenth of its samples that is nearest to the limit gives a threshold;
from these samples Markov chains draw more samples beyond it, which are level 1, and so on, until a tenth of a
level is beyond the limit.

What is drawn is a State: independent standard normal numbers and seeds. A step of a chain proposes

    v' = sqrt(1 - s^2) v + s xi     of each normal number (Papaioannou, Betz, Zwirglmaier, Straub,
                                    Probabilistic Engineering Mechanics 41, 2015, section 3.3)
    another seed                    with probability REDRAWN, shared by the seeds

and is accepted if the result is beyond the threshold. Both moves are reversible with respect to what is
drawn, so that this is all that Metropolis asks for. s is the standard deviation of the number over the first
samples of the chains times a factor, at most 1; the factor changes from one group of chains to the next so
that WANTED of the steps are accepted (there, section 5.3). What changes a chain never follows from itself.

Random numbers follow from the root seed, the level and the number of the chain: not from who computes it.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError

SHARE = 0.1  # of a level that is beyond its threshold, p0
WANTED = 0.44  # of the steps that are accepted
GROUPS = 10  # of chains in a level, between which the factor changes
FACTOR = 0.6  # of the first group
REDRAWN = 0.5  # probability that a step redraws a seed, if there is something else to draw
STREAM = 2**32 + 1  # in place of the number of a run: the streams of the chains
TIED = 0.5  # of a level with one and the same value: no threshold tells its samples apart
BETWEEN = 0.25  # correlation of the errors of two levels; 0.0 to 0.4 in the closed forms of the tests
NORMAL_95 = 1.959963984540054


class SubsetError(UserError):
    """A probability that cannot be had so; the message says why."""


class State(NamedTuple):
    """What is drawn."""

    normal: np.ndarray  # (n,) independent standard normal numbers
    seeds: tuple = ()  # of int, each as probable as another


class Sample(NamedTuple):
    """A state and what came of it."""

    state: State
    value: float  # the event is: greater than the limit; inf: always in it


class Chain(NamedTuple):
    """A chain that is to be walked."""

    key: tuple  # of its random numbers: root seed, level, number
    first: Sample
    threshold: float  # no sample is below it
    spread: np.ndarray  # (n,) s
    steps: int


class Walked(NamedTuple):
    """A chain that has been walked."""

    samples: tuple  # of Sample: the first, and one after each step
    steps: int  # that left the seeds alone
    accepted: int  # of these
    redrawn: int  # steps that redrew a seed
    redrawn_accepted: int  # of these


class Level(NamedTuple):
    """A level, when all its samples are there."""

    threshold: float  # of the next level; of the last one the limit, if it was reached
    share: float  # of its samples beyond it
    probability: float  # of being beyond it
    variation: float  # coefficient of variation of the share
    accepted: float | None  # share of the steps that left the seeds alone; None: there was none
    redrawn_accepted: float | None  # of those that redrew a seed
    evaluated: int  # calls of the function


class Estimate(NamedTuple):
    """What came out."""

    levels: tuple  # of Level
    reached: bool  # whether the limit was; else the probability is that of the last threshold
    samples: tuple  # of Sample of the last level that are beyond its threshold

    @property
    def probability(self):
        """Of the event, or of the last threshold, which is nearer."""
        return self.levels[-1].probability

    @property
    def variation(self):
        """Coefficient of variation: between that of independent levels (Au and Beck, equation 31) and that of
        levels whose errors are one and the same (equation 30).
        """
        each = [level.variation for level in self.levels]
        apart, together = sum(one**2 for one in each), sum(each) ** 2
        return math.sqrt((1.0 - BETWEEN) * apart + BETWEEN * together)

    @property
    def interval(self):
        """95 %: of one level, which is plain Monte Carlo, that of Clopper and Pearson; else of a log-normal
        distribution about the probability, which ends at 1.
        """
        if len(self.levels) == 1:
            from shefex_nav.report import intervals

            n = self.evaluated
            return intervals.proportion(round(self.probability * n), n)
        factor = math.exp(NORMAL_95 * math.sqrt(math.log1p(self.variation**2)))
        return self.probability / factor, min(1.0, self.probability * factor)

    @property
    def evaluated(self):
        """Calls of the function."""
        return sum(level.evaluated for level in self.levels)

    @property
    def plain(self):
        """Samples of plain Monte Carlo that have the same coefficient of variation; inf if it is 0."""
        square = self.variation**2
        return (1.0 - self.probability) / (self.probability * square) if square else math.inf


def draw(function, states):
    """tuple of Sample of states that are given."""
    return tuple(Sample(state, function(state)) for state in states)


def walk(function, chain):
    """Walk a chain. function : of a State, the value -> Walked"""
    root, *rest = chain.key
    rng = np.random.default_rng(np.random.SeedSequence(root, spawn_key=(STREAM, *rest)))
    counts, samples = np.zeros((2, 2), int), [chain.first]  # [redrawn][accepted]
    for _ in range(chain.steps):
        state = proposed(samples[-1].state, chain.spread, rng)
        value = function(state)
        accepted = value >= chain.threshold
        counts[int(state.seeds != samples[-1].state.seeds), int(accepted)] += 1
        samples.append(Sample(state, value) if accepted else samples[-1])
    (lost, kept), (redrawn_lost, redrawn_kept) = counts.tolist()
    return Walked(tuple(samples), lost + kept, kept, redrawn_lost + redrawn_kept, redrawn_kept)


def proposed(state, spread, rng):
    """State that a step proposes. spread : (n,) s;  rng : numpy Generator"""
    normal = np.sqrt(1.0 - spread**2) * state.normal + spread * rng.standard_normal(len(spread))
    alone = len(spread) == 0 and len(state.seeds) == 1
    chance = 1.0 if alone else REDRAWN / max(len(state.seeds), 1)
    fresh = [int(seed) for seed in rng.integers(2**53, size=len(state.seeds))]
    redrawn = rng.random(len(state.seeds)) < chance
    seeds = tuple(new if other else old for old, new, other in zip(state.seeds, fresh, redrawn, strict=True))
    return State(normal, seeds)


def estimate(first, limit, smallest, root, work, tell=lambda level: None):
    """Probability that a value is greater than a limit: Estimate.

    Parameters
    ----------
    first : list of State, drawn independently; as many samples has each level
    limit : float
    smallest : probability at which, or within some per cent of it, the search ends without the limit
    root : seed of all chains
    work : function of `draw` or `walk`, and of a list of lists of states, or of chains; gives what the
        function with the problem before it makes of each of them, in their order
    tell : called with each Level
    """
    levels, factor = [], FACTOR
    samples, chains = [one for part in work(draw, _parts(first)) for one in part], None
    while True:
        level, beyond = _level(samples, chains, limit, levels[-1].probability if levels else 1.0)
        levels.append(level)
        tell(level)
        reached = all(one.value > limit for one in beyond)
        if reached or len(levels) == _deepest(smallest):
            return Estimate(tuple(levels), reached, tuple(beyond))
        key = root, len(levels)
        chains, factor = _walked(key, beyond, level.threshold, len(samples), factor, work)
        samples = [one for chain in chains for one in chain.samples]


def most(size, smallest):
    """Calls of the function, if the limit is not reached: int. size, smallest : as of `estimate`"""
    return size + (_deepest(smallest) - 1) * (size - math.ceil(SHARE * size))


def _deepest(smallest):
    """Number of levels after which a probability is reached, but for equal samples at the thresholds."""
    return max(1, math.ceil(round(math.log(smallest) / math.log(SHARE), 9)))


def _parts(first):
    """The states of level 0 in small parts, which take workers about as long as a chain."""
    size = max(1, round(1.0 / SHARE) - 1)
    return [first[k : k + size] for k in range(0, len(first), size)]


def _level(samples, chains, limit, before):
    """(Level, its samples beyond its threshold). before : probability of being in the level"""
    values = np.array([one.value for one in samples])
    least = math.ceil(SHARE * len(values))
    if np.count_nonzero(values > limit) >= least:
        threshold, inside = limit, values > limit
    else:
        threshold = float(np.sort(values)[-least])
        inside = values >= threshold
        if np.count_nonzero(values == threshold) > TIED * len(values):
            raise SubsetError(
                f"{np.count_nonzero(values == threshold)} of {len(values)} samples have one and the same "
                "value: no threshold tells them apart"
            )
    share = float(np.mean(inside))
    beyond = [one for one, is_in in zip(samples, inside, strict=True) if is_in]
    if chains is None:
        variation, evaluated = math.sqrt((1.0 - share) / share / len(values)), len(values)
        accepted = redrawn = None
    else:
        variation = correlated(inside, [len(chain.samples) for chain in chains])
        steps, kept, others, others_kept = np.sum([chain[1:] for chain in chains], axis=0).tolist()
        evaluated, accepted, redrawn = steps + others, _ratio(kept, steps), _ratio(others_kept, others)
    return Level(threshold, share, before * share, variation, accepted, redrawn, evaluated), beyond


def _ratio(part, whole):
    return part / whole if whole else None


def correlated(inside, lengths):
    """Coefficient of variation of the share of samples that lie inside (Au and Beck, equations 27 to 29).

    inside : (N,) bool, chain by chain;  lengths : of the chains
    """
    inside, n = np.asarray(inside, float), len(inside)
    share, longest = inside.mean(), max(lengths)
    padded = np.full((len(lengths), longest), np.nan)
    padded[np.arange(longest) < np.array(lengths)[:, None]] = inside - share
    gamma, variance = 0.0, share * (1.0 - share)
    for lag in range(1, longest if variance > 0.0 else 0):
        products = padded[:, lag:] * padded[:, :-lag]
        pairs = int(np.isfinite(products).sum())
        gamma += 2.0 * (pairs / n) * float(np.nanmean(products)) / variance
    return math.sqrt((1.0 - share) / (share * n) * max(1.0 + gamma, 0.0))


def _walked(key, seeds, threshold, size, factor, work):
    """(list of Walked of a new level, factor for the level after it).

    key : root seed and number of the level;  seeds : list of Sample, the first of each chain
    size : samples of the level;  factor : of the spread
    """
    normals = np.array([one.state.normal for one in seeds])
    deviation, chains = normals.std(axis=0), []
    deviation[deviation == 0.0] = 1.0  # all chains begin with one and the same sample
    lengths = [size // len(seeds) + (k < size % len(seeds)) for k in range(len(seeds))]
    groups = np.array_split(np.arange(len(seeds)), min(GROUPS, len(seeds)))
    for number, group in enumerate(groups, start=1):
        spread = np.minimum(factor * deviation, 1.0)
        calls = [Chain((*key, k), seeds[k], threshold, spread, lengths[k] - 1) for k in group.tolist()]
        done = work(walk, calls)
        chains += done
        steps, accepted = (sum(getattr(one, name) for one in done) for name in ("steps", "accepted"))
        if steps:
            factor *= math.exp((accepted / steps - WANTED) / math.sqrt(number))
    return chains, factor
