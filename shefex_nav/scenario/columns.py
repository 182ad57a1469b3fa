"""How a scenario describes columns of a file: their names, their unit, the axes of their vectors."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

from pydantic_core import PydanticCustomError

from shefex_nav.scenario.document import dotted
from shefex_nav.scenario.quantity import QuantitySpec, Reader, describe, quoted, refuse

SIDES = ("x", "y", "z")
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Names = tuple[str, str, str]


class Scale(NamedTuple):
    """A unit of a column: what it measures, and its size in SI."""

    kind: str  # 'rate' or 'increment' for inertial sensors, otherwise ''
    factor: float


@dataclass(frozen=True)
class UnitSpec(Reader):
    """How a field reads the unit of a column; `kinds` are (kind, SI unit) of which one must fit."""

    example: str
    kinds: tuple[tuple[str, str], ...]

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any):
        return {"type": "string", "description": "unit of the columns", "examples": [self.example]}

    def read(self, value):
        """Scale of a unit."""
        if isinstance(value, Scale):
            return value
        if not isinstance(value, str) or not value.strip():
            raise refuse(f"expected a unit such as '{self.example}', got {describe(value)}")
        for kind, unit in self.kinds:
            try:
                return Scale(kind, QuantitySpec(unit, f"1 {self.example}").read(f"1 {value}"))
            except PydanticCustomError as error:
                problem = error
        if len(self.kinds) > 1:
            words = f"{quoted(value)} is no unit of these columns"
            raise refuse(f"{words}; expected one such as '{self.example}'")
        raise problem


def Unit(example, *units, **kinds):
    """Type of a field that is the unit of columns: of `units`, or of one of several kinds."""
    return Annotated[Any, UnitSpec(example, tuple((kinds or {"": units[0]}).items()))]


def check_right_handed(axes):
    """Refuse axes of a file, forward, right and down, that are not three, or left-handed."""
    sides = [SIDES.index(axis[-1]) for axis in axes]
    if len(set(sides)) < 3:
        raise refuse(f"axes: {', '.join(axes)} name one axis twice; expected such as [x, -y, -z]")
    turns = 1 if sides in ([0, 1, 2], [1, 2, 0], [2, 0, 1]) else -1
    for axis in axes:
        turns *= -1 if axis[0] == "-" else 1
    if turns < 0:
        raise refuse(f"axes: {', '.join(axes)} are left-handed; expected such as [x, -y, -z]")


def named_twice(given):
    """(path, words) of each field that names a column which another field has, or names one twice.

    given : {path of a field: names of its columns, a str, or None of what is not given}
    """
    taken = {}
    for path, names in given.items():
        own = [names] if isinstance(names, str) else list(names or ())
        twice = next((name for k, name in enumerate(own) if name in own[:k]), None)
        shared = next((name for name in own if name in taken), None)
        if twice is not None:
            words = f"{', '.join(own)} name the column {quoted(twice)} {own.count(twice)} times"
            yield path, f"{words}; expected {len(own)} different ones"
        elif shared is not None:
            yield path, f"the column {quoted(shared)} is that of {taken[shared]}; expected another one"
        taken |= dict.fromkeys(own, dotted(path))
