"""Classes of settings -> sections of a scenario, and the values of a section -> settings."""

import types
from functools import cache
from importlib import import_module
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import Field, StrictBool, create_model
from pydantic_core import PydanticUndefined

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Count, Number, Quantity
from shefex_nav.settings import REQUIRED, Settings, declared


class Section(Block):
    """A section of a scenario that follows from a class of settings."""


@cache
def section(cls):
    """Section of a class of settings: a Block with the same keys, units, bounds and defaults."""
    fields = {name: _field(annotation, setting) for name, (annotation, setting) in declared(cls).items()}
    made = create_model(cls.__name__, __base__=Section, __module__=__name__, __doc__=cls.__doc__, **fields)
    made.__qualname__ = f"{cls.__module__}:{cls.__qualname__}".replace(".", "/")
    return made


def __getattr__(name):
    """Section by its qualified name, as pickle asks for it in another process."""
    module, colon, cls = name.replace("/", ".").partition(":")
    if not colon:
        raise AttributeError(name)
    return section(getattr(import_module(module), cls))


def settings(cls, block):
    """Settings with the values of a section that has been read."""
    values = {}
    for name, (annotation, _) in declared(cls).items():
        value, kind = getattr(block, name), _without_none(annotation)
        is_section = isinstance(kind, type) and issubclass(kind, Settings)
        if isinstance(value, list):
            value = tuple(value)
        values[name] = settings(kind, value) if is_section and value is not None else value
    return cls(**values)


def _field(annotation, setting):
    """Type and FieldInfo of a field of a section."""
    kind, given = _without_none(annotation), setting.default
    default = PydanticUndefined if given is REQUIRED else given
    if setting.kind == "section":
        factory = section(kind) if given == {} else None
        how = {"default_factory": factory} if factory else {"default": default, "validate_default": True}
        return _optional(section(kind), annotation), Field(description=setting.help or None, **how)
    if setting.kind in ("choice", "switch"):
        own = StrictBool if setting.kind == "switch" else kind
        return own, Field(default=default, description=setting.help)
    limits = dict(setting.limits)
    fewest = limits.pop("fewest", None)
    if setting.kind == "quantity":
        one = Quantity(setting.unit, setting.example, setting.help, **limits)
    else:
        one = (Number if setting.kind == "number" else Count)(setting.example, setting.help, **limits)
    return _optional(_several(kind, one), annotation), Field(default=default, min_length=fewest)


def _several(kind, one):
    """Type of a field of single values: one, a list, or a tuple of so many."""
    if get_origin(kind) is not tuple:
        return one
    items = get_args(kind)
    return list[one] if items[-1] is Ellipsis else tuple[(one,) * len(items)]


def _optional(own, annotation):
    return own | None if _without_none(annotation) is not annotation else own


def _without_none(annotation: Any):
    """A type without `| None`."""
    if get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if get_origin(annotation) not in (Union, types.UnionType):
        return annotation
    return next(one for one in get_args(annotation) if one is not type(None))
