"""Classes of settings -> sections of a scenario, and the values of a section -> settings."""

import types
from functools import cache
from importlib import import_module
from typing import Annotated, Any, ClassVar, Union, get_args, get_origin

from pydantic import Field, StrictBool, create_model
from pydantic_core import PydanticUndefined

from shefex_nav.scenario.block import Block, kinds
from shefex_nav.scenario.quantity import Count, Number, Quantity
from shefex_nav.settings import REQUIRED, Settings, declared


class Section(Block):
    """A section of a scenario that follows from a class of settings."""

    SETTINGS: ClassVar[type[Settings]]


@cache
def section(cls):
    """Section of a class of settings: a Block with the same keys, units, bounds and defaults."""
    fields = {name: _field(annotation, setting) for name, (annotation, setting) in declared(cls).items()}
    made = create_model(cls.__name__, __base__=Section, __module__=__name__, __doc__=cls.__doc__, **fields)
    made.SETTINGS = cls
    made.__qualname__ = f"{cls.__module__}:{cls.__qualname__}".replace(".", "/")
    return made


def __getattr__(name):
    """Section by its qualified name, as pickle asks for it in another process."""
    module, colon, cls = name.replace("/", ".").partition(":")
    if not colon:
        raise AttributeError(name)
    return section(getattr(import_module(module), cls))


def settings(block):
    """Settings with the values of a section that has been read."""
    values = {}
    for name, (_, setting) in declared(block.SETTINGS).items():
        value = getattr(block, name)
        if setting.kind == "section" and isinstance(value, list):
            value = tuple(settings(one) for one in value)
        elif setting.kind == "section" and value is not None:
            value = settings(value)
        values[name] = tuple(value) if isinstance(value, list) else value
    return block.SETTINGS(**values)


def _field(annotation, setting):
    """Type and FieldInfo of a field of a section."""
    kind, given = _without_none(annotation), setting.default
    default = PydanticUndefined if given is REQUIRED else given
    if setting.kind == "section":
        one = get_args(kind)[0] if get_origin(kind) is tuple else kind
        by = dict(setting.limits).get("by")
        own = kinds(by, *(section(each) for each in get_args(one))) if by else section(one)
        own = list[own] if get_origin(kind) is tuple else own
        how = {"default_factory": own} if given == {} else {"default": default, "validate_default": True}
        return _optional(own, annotation), Field(description=setting.help or None, **how)
    if setting.kind in ("choice", "switch", "text"):
        own = StrictBool if setting.kind == "switch" else kind
        return own, Field(default=default, description=setting.help or None)
    limits = dict(setting.limits)
    fewest = limits.pop("fewest", None)

    def one(example, help):
        if setting.kind == "quantity":
            return Quantity(setting.unit, example, help, **limits)
        return (Number if setting.kind == "number" else Count)(example, help, **limits)

    own = _several(kind, (setting.example, setting.help), one)
    return _optional(own, annotation), Field(default=default, min_length=fewest, alias=setting.key)


def _several(kind, words, one):
    """Type of a field of single values: one, a list, or a tuple of so many.

    words : example and help, of a tuple each for all items or one for each; one : of both gives a type
    """
    if get_origin(kind) is not tuple:
        return one(*words)
    items = get_args(kind)
    if items[-1] is Ellipsis:
        return list[one(*words)]
    each = ((text,) * len(items) if isinstance(text, str) else text for text in words)
    return tuple[tuple(map(one, *each))]


def _optional(own, annotation):
    return own | None if _without_none(annotation) is not annotation else own


def _without_none(annotation: Any):
    """A type without `| None`."""
    if get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if get_origin(annotation) not in (Union, types.UnionType):
        return annotation
    return next(one for one in get_args(annotation) if one is not type(None))
