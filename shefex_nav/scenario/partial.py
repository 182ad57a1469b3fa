"""What is good of a scenario that has mistakes, so that the rest of it can be checked as well.

A value that is wrong, missing, or perhaps given under a misspelt key is not there: to read it is an
AttributeError, with which a check of values against each other ends (`known`). No other AttributeError is
caught. Items of a list are judged one by one (`of_each`): what is wrong with one hides nothing of the next.
"""

from functools import lru_cache
from typing import Annotated, NamedTuple, get_args, get_origin

from pydantic import TypeAdapter, ValidationError

from shefex_nav.scenario import messages
from shefex_nav.scenario.block import Block, UnknownKind
from shefex_nav.scenario.fields import chosen_form


class _Unknown(Exception):
    """A value that is wrong."""


class _Bad(NamedTuple):
    """Paths of what is not good."""

    at: set
    around: set  # of those, and of all sections around them


def validated(model, tree, bad):
    """Instance of a model with the good values of a tree.

    bad : paths of keys and values that are not good, those of unknown keys too
    """
    at = {tuple(path) for path in bad}
    return _value(model, (), tree, (), _Bad(at, {path[:n] for path in at for n in range(len(path) + 1)}))


def known(complaints):
    """Those complaints of a generator that come before it needs what is not there: list."""
    found = []
    try:
        for one in complaints:
            found.append(one)
    except AttributeError as error:
        if not _left_out(error.obj, error.name):  # a mistake of the check itself
            raise
    return found


def of_each(items, check):
    """Complaints of a check about the items of a list, each as far as it is known.

    check : function of the number of an item and the item that yields complaints
    """
    for k, item in enumerate(items):
        yield from known(check(k, item))


def _left_out(section, name):
    """Whether a section has a field of this name and no value for it, or nobody knows which kind it is."""
    return isinstance(section, UnknownKind) or (
        isinstance(section, Block) and name in type(section).model_fields
    )


def _value(annotation, metadata, value, path, bad):
    """The validated value; one with good and bad ones in it has the good ones. _Unknown if it is bad."""
    if path in bad.at and path:
        raise _Unknown
    if path not in bad.around:
        try:
            return _adapter(annotation, metadata).validate_python(value)
        except ValidationError:
            raise _Unknown from None
    annotation, metadata = chosen_form(*messages.bare(annotation, metadata), value)
    if messages.is_model(annotation) and isinstance(value, dict):
        return _section(annotation, value, path, bad)
    if get_origin(annotation) is list and isinstance(value, list):
        return _items(get_args(annotation)[0], value, path, bad)
    if get_origin(annotation) is dict and isinstance(value, dict):
        inner = get_args(annotation)[1]
        return {key: _value(inner, (), one, (*path, key), bad) for key, one in value.items()}
    raise _Unknown


@lru_cache(maxsize=4096)  # to make one takes ten times as long as to use it
def _adapter(annotation, metadata):
    """What validates a value. metadata : tuple"""
    return TypeAdapter(Annotated[annotation, *metadata] if metadata else annotation)


def _items(annotation, values, path, bad):
    """A list of sections with the good values of each; _Unknown if it is one of anything else."""
    found = []
    if not messages.is_section(annotation):
        raise _Unknown
    for k, value in enumerate(values):
        if not isinstance(value, dict):
            raise _Unknown
        try:
            found.append(_value(annotation, (), value, (*path, k), bad))
        except _Unknown:
            found.append(UnknownKind())
    return found


def _section(model, tree, path, bad):
    """A section without what is not good; an unknown key may be any that is not given."""
    misspelt = set(tree) - set(model.keys())
    values = {}
    for name, field in model.model_fields.items():
        key = field.alias or name
        if (*path, key) in bad.at or (key not in tree and (misspelt or field.is_required())):
            continue
        if key not in tree and model.NEEDED_UNLESS.get(name, name) not in (name, *values):
            continue  # nobody knows whether it is missing
        given = tree[key] if key in tree else field.get_default(call_default_factory=True)
        try:
            values[name] = _value(field.annotation, tuple(field.metadata), given, (*path, key), bad)
        except _Unknown:
            continue
    section = model.model_construct()
    section.__dict__.clear()
    section.__dict__.update(values)
    return section
