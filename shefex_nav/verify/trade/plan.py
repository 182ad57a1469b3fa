"""All combinations of some settings, predicted in worker processes and put in order."""

import math
from itertools import pairwise
from typing import NamedTuple

from shefex_nav import workers as machine
from shefex_nav.compiled.target import ONE_THREAD
from shefex_nav.errors import UserError
from shefex_nav.scenario import load, software, sweeps
from shefex_nav.verify.trade import judge, predict

MOST = 2000  # combinations
CHUNK = 12  # combinations at least for each worker: what they share is made in each


class TradeError(UserError):
    """A trade that cannot be made; the message says why."""


class Asked(NamedTuple):
    """What to compare."""

    scenario: str  # as `load` takes it
    axes: tuple  # of sweeps.Axis
    overrides: tuple = ()
    seed: int = 1
    workers: int | None = None
    costs: dict = {}  # noqa: RUF012 a default is not changed; key -> {value: cost}


class Combination(NamedTuple):
    """One set of settings and what is predicted of it."""

    settings: dict
    prediction: object  # predict.Prediction; None: there is none
    refused: str  # why there is none
    judged: tuple  # of judge.Judged
    cost: float | None

    @property
    def met(self):
        """Whether all requirements are met that can be predicted; None without any."""
        return all(one.met for one in self.judged) if self.judged else None

    @property
    def good(self):
        """Whether they are, and nothing is known that makes the prediction doubtful."""
        return bool(self.met) and not self.prediction.doubtful

    @property
    def used(self):
        """Largest share of a limit that is used up; without requirements, the attitude's sigma at the end."""
        if self.judged:
            return max(one.used for one in self.judged)
        return float(self.prediction.errors[-1].attitude_b.trace()) ** 0.5


class Study(NamedTuple):
    """All combinations, the best first."""

    name: str  # of the scenario
    probability: float
    combinations: tuple
    cheapest: Combination | None  # of those that are `good`
    idle: tuple  # keys whose values change nothing that is predicted
    unpredicted: tuple  # names of requirements


def checked(asked):
    """(Scenario, list of combinations) of what is asked; ScenarioError, SweepError, TradeError."""
    chosen = sweeps.combinations(asked.axes, MOST)
    for one in asked.axes:
        if one.key.split(".")[0] == "requirements":
            raise TradeError(f"--sweep {one.key}: combinations are judged by one requirement; use --set")
    base = load.load(asked.scenario, asked.overrides)
    software.refuse_own(base, "the linear model")
    _check_values(asked, chosen)
    for key in asked.costs:
        _check_costs(asked, key)
    return base, chosen


def study(asked, base, chosen):
    """Study of what is asked, with what `checked` gave; TradeError where nothing can be predicted."""
    model, cost = load.star_statistics_of(asked.scenario, asked.overrides), asked.costs
    found = [one for each in _predicted(asked, chosen, model) for one in each]
    whole = [
        Combination(chosen[k], *result, sum(cost[key][chosen[k][key]] for key in cost) if cost else None)
        for k, result in sorted(found, key=lambda one: one[0])
    ]
    if all(one.prediction is None for one in whole):
        first = whole[0]
        raise TradeError(f"nothing can be predicted; {sweeps.named(first.settings)}: {first.refused}")
    return ordered(base.mission.name, base.requirements, asked.axes, whole, bool(cost))


def ordered(name, requirements, axes, whole, priced):
    """Study of combinations, given in the order of the axes.

    name, requirements : of the scenario;  axes : as of Asked;  whole : list of Combination
    priced : whether all have a cost
    """
    found = sorted(whole, key=_rank)
    good = [one for one in found if one.good]
    cheapest = min(good, key=lambda one: one.cost) if priced and good else None
    unpredicted = tuple(judge.unpredicted(requirements))
    return Study(
        name, requirements.probability, tuple(found), cheapest, tuple(idle(axes, whole)), unpredicted
    )


def costs(texts):
    """{key: {value: cost}} of texts KEY=VALUE:COST,...; TradeError"""
    found = {}
    for text in texts:
        key, _, given = text.partition("=")
        prices = [_cost(text, part) for part in sweeps.parts(given)]
        key = sweeps.key_of(key.strip())
        if key in found or len(dict(prices)) < len(prices):
            raise TradeError(f"--cost {text}: one cost is given twice")
        found[key] = dict(prices)
    return found


def _cost(text, part):
    """(value, cost) of VALUE:COST; TradeError. text : the whole of which it is a part"""
    value, _, number = part.strip().rpartition(":")
    try:
        cost = float(number)
    except ValueError:
        cost = math.nan
    if not (value and 0.0 <= cost < math.inf):
        raise TradeError(f"--cost {text}: expected KEY=VALUE:COST,..., such as imu=stim300:8000,bmi088:20")
    return value, cost


def _check_costs(asked, key):
    """TradeError unless all values of a key that are tried have a cost, and no others."""
    axis, given = next((one for one in asked.axes if one.key == key), None), asked.costs[key]
    if axis is None:
        raise TradeError(f"--cost {key}: is not tried; add --sweep {key}=...")
    for value in axis.values:
        if value not in given:
            raise TradeError(f"--cost {key}: does not say what {value} costs")
    for value in given:
        if value not in axis.values:
            raise TradeError(f"--cost {key}: {value} is not tried; --sweep has {', '.join(axis.values)}")


def _check_values(asked, chosen):
    """ScenarioError of a value that the scenario takes neither alone nor in any of the combinations."""
    for one in asked.axes:
        for value in one.values:
            alone = {one.key: value}
            try:
                _load(asked, alone)
            except UserError:
                if any(_loads(asked, settings) for settings in chosen if alone.items() <= settings.items()):
                    continue
                with sweeps.about(alone):
                    raise


def _load(asked, settings):
    """Scenario of a combination."""
    return load.load(asked.scenario, (*asked.overrides, *sweeps.overrides(settings)))


def _loads(asked, settings):
    """Whether a combination is a scenario."""
    try:
        _load(asked, settings)
    except UserError:
        return False
    return True


def _predicted(asked, chosen, model):
    """Lists of (index, (Prediction or None, why none, tuple of Judged)), as they come."""
    most = min(asked.workers or machine.cores(), max(1, len(chosen) // CHUNK))
    ordered = in_order(asked.axes, chosen)
    shares = {
        k: (asked.scenario, asked.overrides, asked.seed, model, ordered[begin:end])
        for k, (begin, end) in enumerate(_parts(len(chosen), most))
    }
    if most == 1:
        yield work(*shares[0])
        return
    with machine.environment(dict.fromkeys(ONE_THREAD, "1")):
        for _, found in machine.each(work, shares, most):
            yield found


def in_order(axes, chosen):
    """list of (index, settings) of combinations, those with most in common one after the other.

    Whoever predicts some of them in a row flies once, and looks at the stars once for each camera.
    """
    ranked = sorted(axes, key=lambda one: predict.cost_rank(one.key.split(".")[0]))
    places = [(one.key, {value: n for n, value in enumerate(one.values)}) for one in ranked]
    return sorted(enumerate(chosen), key=lambda one: [place[one[1][key]] for key, place in places])


def _parts(n, parts):
    """(begin, end) of so many nearly equal parts of n."""
    ends = [round(k * n / parts) for k in range(parts + 1)]
    return list(pairwise(ends))


def work(scenario, overrides, seed, model, chosen):
    """Predict some combinations, in a worker. chosen : list of (index, {key: value})"""
    shared, loaded, found = predict.Shared(model, seed), [], []
    for k, settings in chosen:
        try:
            loaded.append((k, load.load(scenario, (*overrides, *sweeps.overrides(settings)))))
        except UserError as error:
            found.append((k, (None, _first(error), ())))
    loaded.sort(key=lambda one: predict.flight_key(one[1]))  # those of one flight one after the other
    for k, one in loaded:
        try:
            prediction = predict.predict(one, shared)
        except UserError as error:
            found.append((k, (None, _first(error), ())))
            continue
        found.append((k, (prediction, "", tuple(judge.judge(one.requirements, prediction)))))
    return found


def _first(error):
    """The first line of what an error says."""
    return str(error).strip().splitlines()[0]


def _rank(one):
    """Those that meet all first, those in doubt behind, without a prediction last; by shares of limits."""
    if one.prediction is None:
        return 3, 0.0
    kind = 2 if one.met is False else int(one.prediction.doubtful)
    return kind, one.used


def idle(axes, whole):
    """Keys whose values change nothing that is predicted: list. whole : list of Combination, of all axes"""
    found = []
    for one in axes:
        groups = {}
        for each in whole:
            others = tuple(value for key, value in each.settings.items() if key != one.key)
            groups.setdefault(others, set()).add(_numbers(each))
        if all(len(group) == 1 for group in groups.values()):
            found.append(one.key)
    return found


def _numbers(one):
    """What is predicted, as something that can be compared."""
    if one.prediction is None:
        return one.refused
    found = (*one.prediction.errors, *one.prediction.largest)
    return tuple(P.tobytes() for errors in found for P in errors[2:])
