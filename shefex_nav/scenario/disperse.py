"""Dispersions of a scenario -> what can be drawn; `drawn` makes of it the values of a run.

Everything that can be known before a run is checked here: that the field is there, that units go together,
that what is drawn lies within the range of the field (of a law without bounds: within three sigma).
"""

import math
from typing import Any, NamedTuple

from pydantic_core import PydanticCustomError

from shefex_nav.scenario import dispersions as sections
from shefex_nav.scenario import fields, laws
from shefex_nav.scenario.drawn import SHARE, applied
from shefex_nav.scenario.quantity import NumberSpec, split

OWN = ("dispersions", "campaign")  # sections that cannot be dispersed
SYMMETRIC = 1e-9
MOST_SINGULAR = -1e-9  # smallest eigenvalue of a matrix of correlations that is one but for rounding


class Dispersed(NamedTuple):
    """One dispersed field."""

    path: tuple
    name: str  # the path as written
    spec: Any  # QuantitySpec, NumberSpec, None
    nominal: Any  # as written in the scenario
    law: Any  # of `laws`
    unit: str  # of what is drawn; '' without
    apply: str  # add, scale, replace, factor
    group: tuple = ()  # names of the paths of the correlated group, and below the factors
    factors: tuple = ()  # (n,) by which independent standard normal numbers of the paths make this one's

    @property
    def measure(self):
        """What a number that is drawn counts, for people: its unit, 'times' of a factor; '' without."""
        return self.unit or ("times" if self.apply == "factor" else "")


class Wrong(Exception):
    """A dispersion that cannot be: (keys below it, text)."""

    def __init__(self, keys, text):
        self.keys, self.text = keys, text
        super().__init__(text)


def resolve(model, tree, section):
    """What can be drawn.

    Parameters
    ----------
    model : of the scenario
    tree : of a scenario that the model has found good
    section : {name: Dispersion}

    Returns
    -------
    dispersed : list of Dispersed in the order of the file
    errors : list of (path of the field, text for people)
    """
    found, errors = [], []
    for name, one in section.items():
        try:
            new = (
                _group(model, tree, one)
                if isinstance(one, sections.Group)
                else [_one(model, tree, name, one)]
            )
            for k, dispersed in enumerate(new):
                _check_apart(dispersed, found)
                _check_named_once(k, new)
                _check_reach(dispersed)
                _check_differs(dispersed)
            found += new
        except Wrong as error:
            errors.append((("dispersions", name, *error.keys), error.text))
    return found, errors


def _target(model, tree, name, keys=()):
    try:
        target = fields.target(model, tree, name)
    except fields.NoField as error:
        raise Wrong(keys, str(error)) from None
    if target.path[0] in OWN:
        raise Wrong(keys, f"{target.path[0]} says how runs differ and cannot differ itself")
    return target


def _one(model, tree, name, one):
    """Dispersed of a dispersion of one field."""
    target = _target(model, tree, name)
    if isinstance(one, sections.LogNormal):
        _scalable(target)
        law = laws.LogNormalLaw(one.log_normal)
        return Dispersed(target.path, name, target.spec, target.nominal, law, "", "factor")
    reader = _Reader(target, one.apply)
    law = _LAWS[type(one)](one, reader)
    return Dispersed(target.path, name, target.spec, target.nominal, law, reader.unit or "", one.apply)


class _Reader:
    """Reads the numbers of one dispersion; the first gives the unit of all."""

    def __init__(self, target, apply):
        self.target, self.apply, self.unit = target, apply, None
        self.spec = SHARE if apply == "scale" else target.spec
        if apply == "replace" and isinstance(target.nominal, list):
            self.spec = None
        elif apply != "replace":
            _scalable(target)
        if target.path == fields.EPOCH and apply != "add":
            raise Wrong(("apply",), "a launch time differs by what is added to it; leave apply out")

    def number(self, value, *keys):
        """A number in the unit of the dispersion."""
        if self.spec is None:
            raise Wrong(keys, f"{self.target_name} holds no number; only a choice can be in its place")
        try:
            si = self.spec.convert(value)
        except PydanticCustomError as error:
            raise Wrong(keys, f"{error.message()}{self._share(value)}") from None
        if isinstance(self.spec, NumberSpec):
            self.unit = ""
            return float(value)
        number, unit = split(value) if isinstance(value, str) else (si, self.spec.unit)
        if self.unit is None:
            self.unit = unit
        return number if unit == self.unit else si / self.spec.convert(f"1 {self.unit}")

    @property
    def target_name(self):
        """The path of the field."""
        return ".".join(map(str, self.target.path))

    def _share(self, value):
        """What to write if a share of the nominal value was meant."""
        if self.apply != "add" or not isinstance(value, str) or not value.rstrip().endswith(("%", "ppm")):
            return ""
        return "; a share of the value of the scenario needs apply: scale"


def _scalable(target):
    """Wrong unless there is a number, or are numbers, that something can be added to."""
    if target.path == fields.EPOCH:
        return
    if target.spec is None:
        words = f"is {fields.in_words(target.nominal)}, which is no number; only a choice can be in its place"
        raise Wrong((), words)
    of_words = [word for word, _ in getattr(target.spec, "words", ())]
    for value in fields.numbers(target.nominal):
        if value in of_words:
            raise Wrong(
                (), f"is '{value}', which is no number; give one, or a dispersion with apply: replace"
            )


def _normal(one, reader):
    sigma = _positive(reader.number(one.normal, "normal"), "normal")
    return laws.NormalLaw(0.0 if one.mean is None else reader.number(one.mean, "mean"), sigma)


def _truncated(one, reader):
    sigma = _positive(reader.number(one.truncated_normal, "truncated_normal"), "truncated_normal")
    mean = 0.0 if one.mean is None else reader.number(one.mean, "mean")
    low = -math.inf if one.low is None else reader.number(one.low, "low")
    high = math.inf if one.high is None else reader.number(one.high, "high")
    if one.low is None and one.high is None:
        raise Wrong((), "needs low, high or both; without them write normal")
    if not low < high:
        raise Wrong(("low",), f"must be below high, got '{one.low}' and '{one.high}'")
    if not (low - mean) / sigma <= laws.FARTHEST or not (mean - high) / sigma <= laws.FARTHEST:
        key = "low" if low > mean else "high"
        words = f"cuts off all but what is more than {laws.FARTHEST:g} standard deviations from the mean"
        raise Wrong((key,), f"'{getattr(one, key)}' {words}; write uniform, or another mean")
    return laws.TruncatedLaw(mean, sigma, low, high)


def _uniform(one, reader):
    low, high = (reader.number(value, "uniform", k) for k, value in enumerate(one.uniform))
    if not low < high:
        raise Wrong(("uniform",), f"the lower bound comes first, got '{one.uniform[0]}', '{one.uniform[1]}'")
    return laws.UniformLaw(low, high)


def _choice(one, reader):
    weights = one.weights or [1.0] * len(one.choice)
    if len(weights) != len(one.choice):
        raise Wrong(("weights",), f"{len(weights)} weights for {len(one.choice)} values; give one for each")
    if not sum(weights) > 0.0:
        raise Wrong(("weights",), "at least one must be greater than zero")
    values = one.choice
    if one.apply != "replace" or (reader.spec is not None and not _has_words(reader, values)):
        values = [reader.number(value, "choice", k) for k, value in enumerate(values)]
    ends, total = [], 0.0
    for weight in weights:
        total += weight
        ends.append(total / math.fsum(weights))
    ends[-1] = max(1.0, ends[-1])
    for k in range(len(ends) - 2, -1, -1):  # what cannot be drawn at the end takes no rounding
        ends[k] = ends[k + 1] if weights[k + 1] == 0.0 else min(ends[k], ends[k + 1])
    return laws.ChoiceLaw(tuple(values), tuple(ends))


def _has_words(reader, values):
    """Whether one of the values is a word that the field takes in place of a quantity."""
    return any(value == word for word, _ in getattr(reader.spec, "words", ()) for value in values)


def _table(one, reader):
    if reader.spec is None:
        return laws.TableLaw(tuple(one.table))
    return laws.TableLaw(tuple(reader.number(value, "table", k) for k, value in enumerate(one.table)))


_LAWS = {
    sections.Normal: _normal,
    sections.Truncated: _truncated,
    sections.Uniform: _uniform,
    sections.Choice: _choice,
    sections.Table: _table,
}


def _positive(value, key):
    if not value > 0.0:
        raise Wrong((key,), f"must be greater than zero, got {value:g}")
    return value


# ---- groups ----------------------------------------------------------------------------------------------


def _group(model, tree, one):
    """list of Dispersed of a correlated group."""
    if one.apply == "replace":
        raise Wrong(("apply",), "of a group is add or scale")
    n = len(one.paths)
    targets = [_target(model, tree, name, ("paths", k)) for k, name in enumerate(one.paths)]
    readers = [_Reader(target, one.apply) for target in targets]
    sigmas, correlation = (_by_sigma if one.covariance is None else _by_covariance)(one, readers, n)
    factors = _cholesky(correlation)
    found = []
    for k, (target, reader) in enumerate(zip(targets, readers, strict=True)):
        law, unit = laws.NormalLaw(0.0, sigmas[k]), reader.unit or ""
        field = (target.path, one.paths[k], target.spec, target.nominal)
        found.append(Dispersed(*field, law, unit, one.apply, tuple(one.paths), tuple(factors[k])))
    return found


def _by_sigma(one, readers, n):
    for key in ("sigma", "correlation"):
        if getattr(one, key) is None:
            raise Wrong((), f"needs {key}; a group has sigma and correlation, or covariance and units")
    if one.units is not None:
        raise Wrong(("units",), "go with a covariance; sigma has its own")
    if len(one.sigma) != n:
        raise Wrong(("sigma",), f"{len(one.sigma)} values for {n} paths; give one for each")
    sigmas = [
        _positive(reader.number(value, "sigma", k), "sigma")
        for k, (reader, value) in enumerate(zip(readers, one.sigma, strict=True))
    ]
    matrix = _matrix(one.correlation, n, "correlation")
    if any(abs(matrix[k][k] - 1.0) > SYMMETRIC for k in range(n)):
        raise Wrong(("correlation",), "has ones on its diagonal")
    _semidefinite(matrix, "correlation")
    return sigmas, matrix


def _by_covariance(one, readers, n):
    for key in ("sigma", "correlation"):
        if getattr(one, key) is not None:
            raise Wrong((key,), "is contained in the covariance; take one of the two away")
    if one.units is None or len(one.units) != n:
        raise Wrong(("covariance",), f"needs units, one for each of the {n} paths")
    matrix = _matrix(one.covariance, n, "covariance")
    if any(not matrix[k][k] > 0.0 for k in range(n)):
        raise Wrong(("covariance",), "must have positive variances on its diagonal")
    sigmas = [math.sqrt(matrix[k][k]) for k in range(n)]
    for k, (reader, unit) in enumerate(zip(readers, one.units, strict=True)):
        reader.number(f"1 {unit}" if unit else 1.0, "units", k)
    correlation = [[matrix[j][k] / (sigmas[j] * sigmas[k]) for k in range(n)] for j in range(n)]
    _semidefinite(correlation, "covariance")
    return sigmas, correlation


def _matrix(rows, n, key):
    if len(rows) != n or any(len(row) != n for row in rows):
        raise Wrong((key,), f"must have {n} rows of {n} numbers, one for each path")
    for j in range(n):
        for k in range(j):
            if abs(rows[j][k] - rows[k][j]) > SYMMETRIC * max(1.0, abs(rows[j][k])):
                raise Wrong((key,), f"must be symmetric, but has {rows[j][k]:g} and {rows[k][j]:g}")
    return rows


def _semidefinite(correlation, key):
    import numpy as np

    smallest = float(np.linalg.eigvalsh(np.array(correlation, dtype=float))[0])
    if smallest < MOST_SINGULAR:
        raise Wrong(
            (key,), f"is impossible: its correlations contradict each other (eigenvalue {smallest:.3g})"
        )


def _cholesky(matrix):
    """Lower triangular L with L L^T = matrix, which may be singular: list of lists."""
    n = len(matrix)
    root = [[0.0] * n for _ in range(n)]
    for j in range(n):
        pivot = matrix[j][j] - sum(root[j][m] ** 2 for m in range(j))
        root[j][j] = math.sqrt(pivot) if pivot > 1e-12 else 0.0
        for i in range(j + 1, n):
            rest = matrix[i][j] - sum(root[i][m] * root[j][m] for m in range(j))
            root[i][j] = rest / root[j][j] if root[j][j] else 0.0
    return root


# ---- checks ----------------------------------------------------------------------------------------------


def _check_apart(dispersed, found):
    """Wrong if two dispersions are about the same value."""
    for other in found:
        if _overlap(other, dispersed):
            raise Wrong((), f"{dispersed.name} is dispersed by '{other.name}' already; keep one of them")


def _check_named_once(k, group):
    """Wrong if path number k of a group is about the same value as one before it."""
    for other in group[:k]:
        if _overlap(other, group[k]):
            words = f"{group[k].name} is in this group already, as '{other.name}'; keep one of them"
            raise Wrong(("paths", k), words)


def _overlap(one, other):
    """Whether two dispersions are about the same value, or one about a part of the other's."""
    short = min(len(one.path), len(other.path))
    return one.path[:short] == other.path[:short]


def _check_reach(dispersed):
    """Wrong if the field would refuse what may be drawn."""
    for value in dispersed.law.reach():
        try:
            for drawn in fields.numbers(applied(dispersed, value)):
                if dispersed.spec is not None and dispersed.path != fields.EPOCH:
                    dispersed.spec.read(drawn)
        except PydanticCustomError as error:
            text = f"{dispersed.name} {error.message()}"
            if isinstance(dispersed.law, laws.NormalLaw | laws.LogNormalLaw):
                text += f", {laws.FAR:g} sigma away; a truncated_normal or uniform distribution has bounds"
            raise Wrong((), text) from None


def _check_differs(dispersed):
    """Wrong if all that may be drawn comes to one value: a share of 0, or less than a whole number."""
    drawn = dispersed.law.reach()
    if len({repr(value) for value in drawn}) < 2:
        return
    values = [list(fields.numbers(applied(dispersed, value))) for value in drawn]
    if dispersed.apply in ("scale", "factor"):
        if not any(dispersed.spec.read(value) for one in values for value in one):
            words = "any share of 0 is 0; write what is to be added"
            raise Wrong((), f"{dispersed.name} would be the same in every run: {words}")
    if isinstance(dispersed.spec, NumberSpec) and dispersed.spec.whole:
        if all(one == values[0] for one in values):
            words = "what may be drawn rounds to one and the same whole number"
            raise Wrong((), f"{dispersed.name} would be the same in every run: {words}")
