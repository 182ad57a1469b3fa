"""What a scenario chooses in words: from this follows which kernels its flight needs."""

from typing import Literal, get_args, get_origin

from pydantic import BaseModel


def choices(model, place=""):
    """'gps.mode=tight', 'launch' and the like, for all sections of a scenario: frozenset of str."""
    found = set()
    for name, field in type(model).model_fields.items():
        value, here = getattr(model, name), f"{place}{name}"
        if isinstance(value, BaseModel):
            found |= {here, *choices(value, f"{here}.")}
        elif isinstance(value, bool) or (isinstance(value, str) and value in _words(field.annotation)):
            found.add(f"{here}={value}")
        elif isinstance(value, dict | list | tuple) and value:
            found |= {here, *_inside(value, here)}
    return frozenset(found)


def _inside(values, place):
    """Choices of sections in a list, whatever their order."""
    values = values.values() if isinstance(values, dict) else values
    return {one for value in values if isinstance(value, BaseModel) for one in choices(value, f"{place}.")}


def _words(annotation):
    """The words of all Literals in an annotation: set."""
    if get_origin(annotation) is Literal:
        return {one for one in get_args(annotation) if isinstance(one, str)}
    return set().union(*(_words(one) for one in get_args(annotation)))
