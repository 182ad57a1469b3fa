"""A covering array of strength two: rows in which every pair of levels of two factors meets, made greedily.

The two factors with the most levels are paired in full, a row for each pair; the other columns of a row are
those of a few hundred random ones that cover the most pairs that are still missing, and which are possible.
The order of the rows is greedy as well: the next one has the most pairs of levels that no row before it had.
"""

from itertools import combinations, product

import numpy as np

TRIES = 300  # random rows, of which the best is taken


def array(factors, possible, rows, seed):
    """Rows that cover all possible pairs.

    Parameters
    ----------
    factors : dict, name -> levels
    possible : function of a dict, some factors -> level, that says whether these levels can meet
    rows : int, how many there are to be
    seed : int

    Returns
    -------
    list of dict, name -> level

    Raises ValueError if so many rows do not suffice.
    """
    rng, names = np.random.default_rng(seed), list(factors)
    missing = pairs(factors, possible)
    large = sorted(names, key=lambda name: -len(factors[name]))[:2]
    table = []
    for levels in product(*(factors[name] for name in large)):
        given = dict(zip(large, levels, strict=True))
        if possible(given):
            table.append(_best(factors, possible, given, missing, rng))
            missing -= of_row(table[-1])
    while len(table) < rows or missing:
        pair = min(missing, default=None)
        table.append(_best(factors, possible, dict(pair or ()), missing, rng))
        missing -= of_row(table[-1])
    if len(table) > rows:
        raise ValueError(f"{len(table)} rows are needed, {rows} were asked for")
    return _ordered(table)


def pairs(factors, possible):
    """All pairs that can meet: set of ((name, level), (name, level))."""
    found = set()
    for one, other in combinations(factors, 2):
        for levels in product(factors[one], factors[other]):
            if possible(dict(zip((one, other), levels, strict=True))):
                found.add(((one, levels[0]), (other, levels[1])))
    return found


def of_row(row):
    """Pairs of a row: set."""
    return set(combinations(row.items(), 2))


def _best(factors, possible, given, missing, rng):
    """Of some random rows with given levels, the one that covers most of what is missing: dict."""
    best, most = None, -1
    for _ in range(TRIES):
        row = {name: given.get(name, levels[rng.integers(len(levels))]) for name, levels in factors.items()}
        if not possible(row):
            continue
        count = len(of_row(row) & missing)
        if count > most:
            best, most = row, count
    if best is None:
        raise ValueError(f"no row is possible with {given}")
    return best


def _ordered(table):
    """The same rows; each has the most pairs that are new, and among equals stands the first."""
    left, seen, found = list(table), set(), []
    while left:
        k = max(range(len(left)), key=lambda k: (len(of_row(left[k]) - seen), -k))
        found.append(left.pop(k))
        seen |= of_row(found[-1])
    return found
