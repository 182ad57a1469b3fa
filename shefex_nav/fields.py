"""What a field of a record holds, said once, in its annotation: what it is, its unit, how a message has it.

`r_i: vector("m", "position of the IMU, inertial axes")` is a field of every message that the record goes to.
It is named as the attribute, with the unit behind it, `r_i_m`; its comment, which the stored schema has, ends
with the unit. Only where a message needs another name it is written down. What has no such annotation is in
no message; of a record in a record its own fields are.
"""

from typing import Annotated, NamedTuple, get_type_hints

import numpy as np

EQUAL = -2
LARGEST = 1e15  # SI; no position, rate, variance or time of a mission is larger
UNIT = 1e-3  # by which the norm of a quaternion that is given may differ from one
_KINDS = {bool: "bool", int: "sfixed32", str: "string", bytes: "bytes"}  # of what is no number


class Column(NamedTuple):
    """What a field of a record holds: `Annotated[float, Column("Pa", "as measured")]`."""

    unit: str  # SI, such as m/s^2; "" of what has none
    help: str  # what it is, and in which frame
    shape: tuple = ()  # of an array, row-major; -1 = any number of rows, EQUAL = any, the same in a log
    kind: object = None  # double, sfixed32 ... (Field), or an IntEnum; None: as the type says
    name: str | None = None  # in a message; None: as attribute and unit say


class Field(NamedTuple):
    """One field of a message."""

    name: str
    source: str  # attribute of the record, dotted where nested
    kind: str  # double, bool, sfixed32, string, bytes (not in a log), or an IntEnum
    shape: tuple  # as of Column; () = scalar
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


def number(unit, words, shape=(), name=None):
    """A float, or an array of floats."""
    return Annotated[np.ndarray if shape else float, Column(unit, words, shape, "double", name)]


def vector(unit, words, n=3, name=None):
    """n floats."""
    return number(unit, words, (n,), name)


def matrix(unit, words, n=3, name=None):
    """n x n floats."""
    return number(unit, words, (n, n), name)


def integer(words, shape=(), name=None):
    """A whole number, or an array of them."""
    return Annotated[np.ndarray if shape else int, Column("", words, shape, "sfixed32", name)]


def flag(words):
    """True or false."""
    return Annotated[bool, Column("", words)]


def text(words):
    """A text."""
    return Annotated[str, Column("", words)]


def data(words):
    """Bytes."""
    return Annotated[bytes, Column("", words)]


def member(enum, words):
    """A member of an IntEnum."""
    return Annotated[int, Column("", words, kind=enum)]


T_S = number("s", "mission time, from lift-off")
T_VALID = number("s", "mission time that is measured")
T_AVAILABLE = number("s", "mission time at which the on-board computer has it")
Q_IB = vector("", "attitude, body to inertial axes, Hamilton, scalar first", 4, name="q_ib_wxyz")


def column_of(hint):
    """Column of an annotation; None where it has none."""
    return next((one for one in getattr(hint, "__metadata__", ()) if isinstance(one, Column)), None)


def fields_of(record, prefix=""):
    """Fields of the message of a record, in the order of its attributes: tuple of Field."""
    found = []
    for source, hint in get_type_hints(record, include_extras=True).items():
        if column_of(hint) is not None:
            found.append(field(f"{prefix}{source}", hint))
        elif hasattr(hint, "_fields"):
            found += fields_of(hint, f"{prefix}{source}.")
    return tuple(found)


def field(source, hint):
    """Field of an attribute and its annotation."""
    column = column_of(hint)
    unit, shape, own = column.unit, column.shape, source.rpartition(".")[2]
    suffix = unit.lower().translate({ord("/"): "_", ord(" "): "_", ord("^"): ""})
    if suffix and not own.endswith(f"_{suffix}"):
        own = f"{own}_{suffix}"
    comment = f"{column.help} [{unit}]".strip() if unit else column.help
    if len(shape) == 2 and min(shape) > 0:
        comment = f"{comment}, {shape[0]} x {shape[1]} row by row"
    kind = column.kind or _KINDS.get(hint.__origin__, "double")
    return Field(column.name or own, source, kind, shape, comment)
