"""What is wrong with the readings of a plug-in's instrument: as its record declares them, or as they come.

A log keeps of a reading what its fields declare; what does not fit is told before the flight.
"""

import re
from enum import IntEnum
from typing import get_type_hints

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.errors import CodeError, shown
from shefex_nav.fields import column_of, fields_of

TIMES = ("t_valid_s", "t_available_s")
OF_THE_LOG = ("timestamp_ns", "t_s")  # columns that each message, each table has by itself
LARGEST = 2**31 - 1  # of a whole number in a log
_WORDS = {
    "double": "numbers",
    "bool": "True or False",
    "string": "text",
    "bytes": "bytes",
    "sfixed32": f"whole numbers up to {LARGEST}; a float has 53 bits",
}


def problem(record):
    """What is wrong with a type of readings; '' if nothing is."""
    if getattr(record, "_fields", ())[:2] != TIMES:
        return f"its record must be a NamedTuple that begins with {' and '.join(TIMES)}"
    for field in record._fields[len(TIMES) :]:
        hint = get_type_hints(record, include_extras=True)[field]
        column = column_of(hint)
        if column is None:
            return (
                f"field {field} of its record needs a Column, `{field}: Annotated[float, Column(unit, help)]`"
            )
        if hint.__origin__ is np.ndarray and not column.shape:
            return f"field {field} of its record is an array: give its shape, Column(unit, help, (3,))"
    return _problem_of_names(fields_of(record))


def _problem_of_names(fields):
    """What is wrong with the names of columns, which field and unit make; '' if nothing is."""
    taken = set(OF_THE_LOG)
    for field in fields:
        words = f"field {field.source} of its record: its column is '{field.name}'"
        if not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", field.name):
            return f"{words}, which ends in the unit; write that of letters, digits, / and ^, such as degC"
        if field.name in taken:
            return f"{words}, and there is one of that name already; take another"
        taken.add(field.name)
    return ""


def checked(words, record, readings):
    """CodeError unless these are readings of a record that a log can keep. words : whose they are"""
    if not isinstance(readings, list | tuple):
        raise CodeError(f"{words}: readings must be a list, got {shown(readings)}")
    if not all(type(reading) is record for reading in readings):
        raise CodeError(f"{words} must give readings of {record.__name__}")
    _check_times(words, readings)
    for field in fields_of(record):
        column = [getattr(reading, field.source) for reading in readings]
        if -1 not in field.shape and _fits(field, column, (len(column), *field.shape)):
            continue
        for reading, value in zip(readings, column, strict=True):
            if not _fits(field, value, field.shape):
                what = _WORDS.get(field.kind) or f"of {field.kind.__name__}"
                shape = f", shape {field.shape}" if field.shape else ""
                when = f"T{reading.t_valid_s:+.3f} s: {field.source}"
                raise CodeError(f"{words}, {when} must be {what}{shape}, got {shown(value)}")


def _check_times(words, readings):
    """CodeError unless they come in order, and none before it is measured."""
    times = np.array([reading[:2] for reading in readings]).reshape(-1, 2)
    if times.size and times.dtype.kind not in "fiu":
        raise CodeError(f"{words}: times of its readings must be numbers, got {shown(readings[0][:2])}")
    if not np.isfinite(times).all() or (np.diff(times, axis=0) < 0.0).any():
        raise CodeError(f"{words}: times of its readings must be numbers in ascending order")
    if (early := times[:, 1] < times[:, 0] - SAME_S).any():
        valid_s, available_s = times[np.argmax(early)]
        late = f"the reading of T{valid_s:+.3f} s is there at T{available_s:+.3f} s, before it is measured"
        raise CodeError(f"{words}: {late}")


def _fits(field, value, shape):
    """Whether a log keeps a value, or a column of them, as it is. shape : wanted, -1 of any number of rows"""
    try:
        array = np.asarray(value)
    except (ValueError, OverflowError):
        return False
    if array.ndim != len(shape) or any(n not in (m, -1) for m, n in zip(array.shape, shape, strict=True)):
        return False
    kind = array.dtype.kind
    if field.kind == "string":
        return all(map(_is_text, value if shape else [value]))
    if field.kind in ("bool", "double"):
        return not array.size or kind in {"bool": "b", "double": "fiu"}[field.kind]
    if isinstance(field.kind, type) and issubclass(field.kind, IntEnum):
        return not array.size or (kind in "iu" and set(np.unique(array).tolist()) <= set(field.kind))
    whole = not array.size or kind in "iu" or (kind == "f" and bool((array == np.rint(array)).all()))
    return whole and (not array.size or bool((np.abs(array.astype(float)) <= LARGEST).all()))


def _is_text(value):
    """Whether a value is a text that can be written: half of a pair of surrogates cannot."""
    return isinstance(value, str) and value == value.encode(errors="ignore").decode()
