"""Whole records that somebody's own software gives, looked at before they go anywhere.

What the reader of a log refuses (`possible`) is refused here, in flight and by name: a log that has been
written can be read. NaN says that the software does not say; of a sigma or a protection level infinity says
that nothing is known.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from shefex_nav import possible
from shefex_nav.errors import shown
from shefex_nav.fields import Field, fields_of
from shefex_nav.onboard.navigation.solution import FIELDS
from shefex_nav.onboard.own_software import MOST_WHOLE, covariance_fault
from shefex_nav.records import CameraCommand, GateResult, NavCovariance, NavHealth, NavSolution

UNLIMITED = "sigma", "protection"  # beginnings of what may be infinite, or NaN
KNOWN = {  # numbers that must be finite
    NavSolution: ("t_s", *(name for name in FIELDS if not name.startswith(UNLIMITED))),
    NavCovariance: ("t_s",),
    GateResult: ("t_s", "t_valid_s"),
    NavHealth: ("t_s",),
    CameraCommand: ("t_s", "exposure_s", "gain_db"),
}


class _Asked(NamedTuple):
    """What is asked of a field of a record of KNOWN."""

    field: Field
    what: str  # for messages
    is_known: bool  # its numbers must be finite
    may_be_infinite: bool


def checked(own, now_s, record):
    """A record of KNOWN with arrays of numbers; SoftwareError says what is wrong with it.

    own : OwnSoftware, which gave it
    """
    found = {}
    for asked, value in zip(_asked(type(record)), record, strict=True):
        found[asked.field.source] = _checked(own, now_s, asked, value)
    return record._replace(**found)


@cache
def _asked(kind):
    """_Asked of each field of a type of record."""
    return [
        _Asked(
            one,
            f"{one.source} of its {kind.__name__}",
            one.source in KNOWN[kind],
            one.source.startswith(UNLIMITED),
        )
        for one in fields_of(kind)
    ]


def _checked(own, now_s, asked, value):
    """The value of a field, as an array if it is one."""
    field, what = asked.field, asked.what
    if field.kind == "string":
        return own.text(now_s, what, value)
    if field.kind == "bool" and type(value) is bool:
        return value
    if asked.is_known:
        array = own.numbers(now_s, what, value, *field.shape)
    else:
        array = own.real(now_s, what, value)
        if words := _fault(field, array, asked.may_be_infinite):
            raise own.error(now_s, f"{what} {words}, got {shown(value)}")
    if field.shape:
        return array
    return float(array) if field.kind == "double" else bool(array) if field.kind == "bool" else int(array)


def _fault(field, array, may_be_infinite):
    """What is wrong with the numbers of a field, in words; '' if nothing is."""
    shape = field.shape
    if array.shape != shape and (array.ndim != len(shape) or -1 not in shape):
        return f"must be of shape {shape}".replace("-1", "n")
    if field.kind == "bool":
        return "" if array in (0.0, 1.0) else "must be true or false"
    if field.kind == "double":
        large = np.abs(array) > possible.LARGEST_OTHER
        if large.any() and not (may_be_infinite and np.isposinf(array[large]).all()):
            infinite = ", infinite" if may_be_infinite else ""
            return f"must be below {possible.LARGEST_OTHER:g}{infinite} or NaN"
    elif not ((array == np.floor(array)) & (np.abs(array) <= MOST_WHOLE)).all():
        return f"must be whole, {MOST_WHOLE} at most"
    return _impossible(field, array)


def _impossible(field, array):
    """The same of numbers that may be of their size."""
    if field.source == "P" and np.isfinite(array).all() and (fault := covariance_fault(array)):
        return fault
    wrong, words = possible.rule(field) or (None, "")
    return f"must be {words}" if wrong is not None and wrong(array.reshape(1, -1)).any() else ""
