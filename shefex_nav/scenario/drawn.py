"""What was drawn -> the values that stand in the scenario of a run."""

import re
from datetime import datetime, timedelta

from shefex_nav.scenario import fields
from shefex_nav.scenario.quantity import NumberSpec, QuantitySpec, split

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
