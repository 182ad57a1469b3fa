"""What a line of the log's table says: a field of a message, and how its name follows from the record.

A field is named as the attribute of the record that it holds, with the unit behind it, `r_i` in m as `r_i_m`;
its comment, which the stored schema has, ends with the unit. Only where a message needs another name it is
written down.
"""

from typing import NamedTuple

EQUAL = -2


class Field(NamedTuple):
    """One field of a message."""

    name: str
    source: str  # attribute of the record, dotted where nested
    kind: str  # double, bool, sfixed32, string, bytes (not in a log), or an IntEnum
    shape: (
        tuple  # of the array, row-major; () = scalar, -1 = any number of rows, EQUAL = any, the same in a log
    )
    comment: str


class Topic(NamedTuple):
    """One line of the log's table of contents."""

    record: type
    topic: str
    schema: str
    rate_hz: float | None  # nominal; None = as it happens
    time: str  # attribute of the record that is its log time
    comment: str
    fields: tuple[Field, ...]


def field(source, unit, words, kind="double", shape=(), name=None):
    """Field of the attribute `source`.

    unit : such as m/s^2, '' without;  words : what it is, and in which frame;  name : None: as attribute and
    unit say
    """
    own, suffix = (
        source.rpartition(".")[2],
        unit.lower().translate({ord("/"): "_", ord(" "): "_", ord("^"): ""}),
    )
    if suffix and not own.endswith(f"_{suffix}"):
        own = f"{own}_{suffix}"
    return Field(name or own, source, kind, shape, f"{words} [{unit}]".strip() if unit else words)


def number(source, unit, words, shape=(), name=None):
    """A float, or an array of floats."""
    return field(source, unit, words, "double", shape, name)


def vector(source, unit, words, n=3, name=None):
    """n floats."""
    return field(source, unit, words, "double", (n,), name)


def matrix(source, unit, words, n=3, name=None):
    """n x n floats."""
    made = field(source, unit, words, "double", (n, n), name)
    return made._replace(comment=f"{made.comment}, {n} x {n} row by row")


def integer(source, words, shape=(), name=None):
    """A whole number, or an array of them."""
    return field(source, "", words, "sfixed32", shape, name)


def flag(source, words):
    """True or false."""
    return field(source, "", words, "bool")


def text(source, words):
    """A text."""
    return field(source, "", words, "string")


def data(source, words):
    """Bytes."""
    return field(source, "", words, "bytes")


def member(source, enum, words):
    """A member of an IntEnum."""
    return field(source, "", words, enum)
