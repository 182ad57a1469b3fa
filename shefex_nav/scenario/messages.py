"""What pydantic found wrong -> one plain line per error: the place in the file, what would be right."""

import difflib
import re
from typing import get_args, get_origin

from pydantic import BaseModel

from shefex_nav.scenario.document import Mark, dotted
from shefex_nav.scenario.quantity import NumberSpec, QuantitySpec, describe, quoted


class Places:
    """Where each key and value of a merged scenario was written."""

    def __init__(self, root):
        self.keys = {(): root}
        self.values = {(): root}

    def key(self, path):
        """Mark of the key at `path`, or of the nearest section around it."""
        return self._nearest(self.keys, path)

    def value(self, path):
        """Mark of the value at `path`, or of the nearest section around it."""
        return self.values[path] if path in self.values else self._nearest(self.keys, path)

    def put(self, path, keys, values):
        """Replace everything known at and below `path`; `keys` and `values` are relative to it."""
        for marks in (self.keys, self.values):
            for old in [known for known in marks if known[: len(path)] == path and known != ()]:
                del marks[old]
        self.keys.update({(*path, *inner): mark for inner, mark in keys.items()})
        self.values.update({(*path, *inner): mark for inner, mark in values.items()})

    @staticmethod
    def _nearest(marks, path):
        while path not in marks:
            path = path[:-1]
        return marks[path]


def _meant(model, path):
    """The key that was meant by an unknown one: list of one or none."""
    known = model_in(field_at(model, path[:-1])[0]).model_fields
    return difflib.get_close_matches(str(path[-1]), list(known), n=1, cutoff=0.6)


def field_at(model, path):
    """(annotation, metadata) of the field at `path` inside `model`, (None, ()) if there is none."""
    annotation, metadata = model, ()
    for part in path:
        inner = model_in(annotation)
        if isinstance(part, str) and inner is not None and part in inner.model_fields:
            field = inner.model_fields[part]
            annotation, metadata = field.annotation, field.metadata
        elif isinstance(part, int) and get_origin(annotation) in (list, tuple):
            annotation = get_args(annotation)[0]
        else:
            return None, ()
    return annotation, metadata


def model_in(annotation):
    """The model that an annotation names, alone or as an option; None if it names none."""
    candidates = (annotation, *get_args(annotation)) if get_origin(annotation) not in (list, tuple) else ()
    return next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), None)


def lines(model, validation_error, places):
    """(Mark, text) of each error in a pydantic ValidationError about `model`."""
    found = []
    errors = validation_error.errors(include_url=False)
    misspelt = {error["loc"][:-1]: set() for error in errors}
    for error in errors:
        if error["type"] == "extra_forbidden":
            misspelt[error["loc"][:-1]] |= set(_meant(model, error["loc"]))
    for error in errors:
        path = error["loc"]
        if error["type"] == "missing" and path[-1] in misspelt[path[:-1]]:
            continue  # the message about the misspelt key says it
        if error["type"] == "missing" and isinstance(path[-1], int):
            path = path[:-1]
            if any(text.startswith(f"{dotted(path)}:") for _, text in found):
                continue  # one message for a list that lacks several values
        mark, words = _explain(model, error, path, places)
        found.append((mark, f"{dotted(path)}: {words}"))
    return found


def _explain(model, error, path, places) -> tuple[Mark, str]:
    kind, value = error["type"], error["input"]
    if kind == "missing" and path == error["loc"]:
        return places.key(path[:-1]), f"is missing{_example(model, path)}"
    if kind == "extra_forbidden":
        meant = _meant(model, path)
        known = model_in(field_at(model, path[:-1])[0]).model_fields
        hint = f"did you mean '{meant[0]}'?" if meant else f"known here: {', '.join(known)}"
        return places.key(path), f"unknown key; {hint}"
    mark = places.value(path)
    if kind in ("missing", "too_short", "too_long", "tuple_type", "list_type"):
        return mark, f"expected {_list_words(model, path)}, got {_length(value)}"
    if kind in ("model_type", "model_attributes_type", "dict_type"):
        return mark, f"expected a section with keys of its own, got {describe(value)}"
    if kind == "literal_error":
        options = re.findall(r"'([^']*)'", error["ctx"]["expected"])
        close = difflib.get_close_matches(str(value), options, n=1, cutoff=0.6)
        hint = f"; did you mean '{close[0]}'?" if close else ""
        return mark, f"{describe(value)} is not known; choose from: {', '.join(options)}{hint}"
    if kind == "string_type":
        return mark, f"expected a text, got {describe(value)}"
    if kind == "string_too_short":
        return mark, "must not be empty"
    if kind == "string_pattern_mismatch":
        return mark, f"{quoted(value)} must be one word of letters, digits, '.', '-' and '_'"
    if kind == "bool_type":
        return mark, f"expected true or false, got {describe(value)}"
    return mark, error["msg"]


def _example(model, path):
    """`; expected for example '10 Hz'` for a field that is missing."""
    annotation, metadata = field_at(model, path)
    spec = next((m for m in metadata if isinstance(m, QuantitySpec | NumberSpec)), None)
    if spec is not None:
        return f"; expected for example '{path[-1]}: {spec.example}'"
    if model_in(annotation) is not None:
        return "; this section is required"
    return ""


def _list_words(model, path):
    annotation, _ = field_at(model, path)
    arguments = get_args(annotation)
    if get_origin(annotation) is tuple and arguments and arguments[-1] is not Ellipsis:
        return f"a list of {len(arguments)} values"
    return "a list"


def _length(value):
    return f"{len(value)} values" if isinstance(value, list | tuple) else describe(value)
