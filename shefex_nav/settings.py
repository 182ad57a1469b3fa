"""Settings declared once, where they are used.

    class Gyro(Settings):
        "Gyro triad."

        bias: float = quantity("rad/s", "0.5 deg/h", "turn-on bias, each axis, 1 sigma", non_negative=True)
        scale_factor: float = quantity("", "100 ppm", "1 sigma", default="0 ppm")

A class of settings says of each value its unit, an example and, if it may be left out, its default, both as
people write them, its bounds, and one line of help. The section of a scenario with its messages, its JSON
Schema and its page of the reference follow from that (`scenario.of_settings`). An instance holds values as
programs use them: floats in SI and radians under the same names; it is immutable.
"""

import re
from dataclasses import FrozenInstanceError, dataclass, field, fields, replace
from typing import Any, NamedTuple, dataclass_transform, get_type_hints

REQUIRED = object()  # in the place of a default
SI = {  # what a unit may be made of, with the units of pictures, which have no other
    *("m", "s", "kg", "rad", "K", "A", "Hz", "N", "Pa", "J", "W", "C", "V", "T", "sr", "mol", "cd", "sqrt"),
    *("pix", "electron", "DN", "mag", "dB"),
}
_KEY = "setting"


class Setting(NamedTuple):
    """How one value is written in a scenario."""

    kind: str  # quantity, number, count, choice, switch, text, section
    help: Any  # text; of a tuple one for each item, too
    default: Any  # as people write it; REQUIRED: it must be given
    unit: str = ""  # SI, of a quantity
    example: str = ""
    limits: tuple = ()  # (name, value) of bounds and the like, as `scenario.quantity` takes them
    key: str | None = None  # in the scenario, where the name of the attribute is a word of Python


@dataclass_transform(frozen_default=True, kw_only_default=True)
class Settings:
    """Base of classes of settings; values are keyword arguments, in SI.

    What an instance does stands here: `dataclass` would compile it for each class anew, at every start.
    """

    def __init_subclass__(cls):
        dataclass(cls, init=False, repr=False, eq=False)

    def __init__(self, **values):
        wanted = type(self).__dataclass_fields__
        if wrong := sorted(wanted.keys() ^ values.keys()):
            what = ", ".join(f"{name} is {'missing' if name in wanted else 'unknown'}" for name in wrong)
            raise TypeError(f"{type(self).__name__}: {what}")
        vars(self).update((name, values[name]) for name in wanted)

    def __setattr__(self, name, value):
        raise FrozenInstanceError(f"cannot assign to field {name!r}")

    def __delattr__(self, name):
        raise FrozenInstanceError(f"cannot delete field {name!r}")

    def __eq__(self, other):
        return vars(self) == vars(other) if type(other) is type(self) else NotImplemented

    def __hash__(self):
        return hash(tuple(vars(self).values()))

    def __repr__(self):
        return f"{type(self).__qualname__}({', '.join(f'{k}={v!r}' for k, v in vars(self).items())})"


def changed(settings, values):
    """Settings with other values. values : {"gyro.bias": float in SI, ...}, keys of inner settings dotted"""
    own, inner = {}, {}
    for key, value in values.items():
        name, dot, rest = key.partition(".")
        if dot:
            inner.setdefault(name, {})[rest] = value
        else:
            own[name] = value
    return replace(
        settings, **own, **{name: changed(getattr(settings, name), more) for name, more in inner.items()}
    )


def declared(cls):
    """Settings of a class: {name: (type, Setting)}, in the order in which they stand."""
    types = get_type_hints(cls, include_extras=True)
    return {one.name: (types[one.name], one.metadata[_KEY]) for one in fields(cls)}


def quantity(unit, example, help, default=REQUIRED, *, key=None, **limits):
    """A value with a unit, or a tuple of such: a float in `unit`, which is SI; ValueError if it is not.

    limits : positive, non_negative, at_least, at_most (as written), words: ((word, value), ...) that may
        stand in the place of a quantity, fewest: so many items at least
    """
    others = [word for word in re.findall(r"[A-Za-z%]+", unit) if word not in SI]
    if others:
        is_ratio = others[0] in ("ratio", "share", "percent", "%")
        meant = "; a ratio or a share has the unit ''" if is_ratio else ""
        raise ValueError(
            f"unit '{unit}': '{others[0]}' is not SI; people may write it, programs count in SI{meant}"
        )
    return _field(Setting("quantity", help, default, unit, example, tuple(limits.items()), key))


def number(example, help, default=REQUIRED, **limits):
    """A number without a unit, or a tuple of such, with one example or one for each; limits are numbers."""
    return _field(Setting("number", help, default, "", example, tuple(limits.items())))


def count(example, help, default=REQUIRED, **limits):
    """A whole number."""
    return _field(Setting("count", help, default, "", example, tuple(limits.items())))


def choice(help="", default=REQUIRED):
    """One of the words of its Literal type."""
    return _field(Setting("choice", help, default))


def switch(help, default=REQUIRED):
    """True or false."""
    return _field(Setting("switch", help, default))


def text(help, default=REQUIRED):
    """Any text."""
    return _field(Setting("text", help, default))


def section(help="", default=REQUIRED, *, by=None):
    """Settings of their own, or a tuple of such; {} as the default: theirs, None: left out if not given.

    by : name of the choice that tells several classes of settings apart, `tuple[Jump | Drift, ...]`
    """
    return _field(Setting("section", help, default, limits=(("by", by),) if by else ()))


def _field(setting):
    return field(metadata={_KEY: setting})
