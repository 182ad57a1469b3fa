"""What was drawn -> the values that stand in the scenario of a run; whether any run could fly with them.

A draw that a run would refuse is the run's affair, as long as others fly: fields that are good by themselves
may contradict each other. Where all draws are refused (`refused`), the dispersion is wrong.
"""

import copy
import random
import re
from datetime import datetime, timedelta

from shefex_nav.scenario import fields
from shefex_nav.scenario.dispersions import Group
from shefex_nav.scenario.laws import ChoiceLaw, TableLaw
from shefex_nav.scenario.quantity import NumberSpec, QuantitySpec, split

TRIES = 8
SHARE = QuantitySpec("", "5 %")  # what a value is scaled with


def applied(dispersed, drawn):
    """What stands in the scenario of a run that has drawn a value: text, number, or a list of them."""
    if dispersed.path == fields.EPOCH:
        return _later(dispersed.nominal, fields.SINCE_EPOCH.convert(f"{drawn!r} {dispersed.unit}"))
    return _each(dispersed.nominal, dispersed, drawn)


def _each(nominal, dispersed, drawn):
    if dispersed.apply == "replace":
        is_number = isinstance(drawn, int | float) and not isinstance(drawn, bool)
        if isinstance(dispersed.spec, QuantitySpec) and is_number and not isinstance(nominal, list):
            return _written(drawn, dispersed.unit)
        return _whole(drawn, dispersed.spec) if is_number else drawn
    if isinstance(nominal, list):
        return [_each(item, dispersed, drawn) for item in nominal]
    if dispersed.apply == "add":
        return _sum(nominal, dispersed, drawn)
    factor = drawn if dispersed.apply == "factor" else 1.0 + SHARE.convert(_written(drawn, dispersed.unit))
    if isinstance(dispersed.spec, NumberSpec):
        return _whole(nominal * factor, dispersed.spec)
    number, unit = split(nominal)
    return _written(number * factor, unit)


def _sum(nominal, dispersed, drawn):
    spec = dispersed.spec
    if isinstance(spec, NumberSpec):
        return _whole(nominal + drawn, spec)
    number, unit = split(nominal)
    if unit == dispersed.unit:
        return _written(number + drawn, unit)
    return _written(spec.convert(nominal) + spec.convert(_written(drawn, dispersed.unit)), spec.unit)


def _written(number, unit):
    """A quantity as text that reads as the same number; a ratio without unit in percent."""
    return f"{number!r} {unit}" if unit else f"{100.0 * number!r} %"


def _whole(number, spec):
    return round(number) if isinstance(spec, NumberSpec) and spec.whole else number


def _later(epoch, seconds):
    """An epoch so many seconds later, as text."""
    begin = datetime.fromisoformat(re.sub(r"Z$", "+00:00", epoch))
    return (begin + timedelta(seconds=seconds)).isoformat().replace("+00:00", "Z")


def refused(model, tree, section, dispersed, complaint):
    """(path of the field, text for people) of dispersions that every run would refuse: list.

    Parameters
    ----------
    model, tree, section : as of `disperse.resolve`
    dispersed : what that gives, all good
    complaint : function of a tree that says what a run would say of it, '' if it would fly
    """
    if not dispersed or not _complaint(model, tree, dispersed, complaint):
        return []
    found = []
    for name, one in section.items():
        names = one.paths if isinstance(one, Group) else [name]
        alone = [one for one in dispersed if one.name in names]
        if words := _complaint(model, tree, alone, complaint):
            found.append((("dispersions", name), f"every run would refuse what is drawn: {words}"))
    return found


def _complaint(model, tree, dispersed, complaint):
    """What runs say that draw these values and no others; '' if one of them would fly."""
    words = ""
    for k in range(TRIES):
        tried, rng = copy.deepcopy(tree), random.Random(k)
        for one in dispersed:
            fields.fill(model, tried, one.path)
            fields.put(tried, one.path, applied(one, _draw(one.law, k, rng)))
        if not (said := complaint(tried)):
            return ""
        words = words or said
    return words


def _draw(law, k, rng):
    """A value that run k may draw."""
    reach = law.reach()
    if isinstance(law, ChoiceLaw | TableLaw):
        return reach[k % len(reach)]
    low, high = reach
    return low + rng.random() * (high - low)
