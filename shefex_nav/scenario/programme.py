"""Section of a scenario about the attitude programme: tasks, one after the other, each with its name.

Values are floats in SI and radians once loaded. All times count from lift-off.
"""

from typing import Annotated, Literal

from pydantic import Field

from shefex_nav.scenario.block import Block, kinds
from shefex_nav.scenario.quantity import Quantity, Time

Name = Annotated[str, Field(pattern=r"^[\w-]+$", description="one word")]


def _level(example, description):
    """Type of a field that is an elevation above the horizontal."""
    return Quantity("rad", example, description, at_least="-90 deg", at_most="90 deg")


class Task(Block):
    """Something that the attitude control does from one time until another."""

    start: Time("70 s", "begin of the task") = Field(alias="from")
    end: Time("145 s", "its end") = Field(alias="until")


class Damp(Task):
    """Take away the rates across the roll axis and leave the spin alone."""

    task: Literal["damp"]


class Turn(Task):
    """Turn the roll axis to a direction."""

    task: Literal["turn"]
    azimuth: Quantity("rad", "352 deg", "of the roll axis, north over east")
    elevation: _level("8.2 deg", "of the roll axis above the horizontal")
    at: Time("149.2 s", "the horizontal is that below the vehicle then; as a rule at the end") | None = None


class AlignVelocity(Task):
    """Turn the roll axis along the air-relative velocity that the vehicle will have."""

    task: Literal["align_velocity"]
    at: Time("405 s", "the velocity is that of this time")


class SpinTo(Task):
    """Bring the spin about the roll axis to a rate."""

    task: Literal["spin"]
    rate: Quantity("rad/s", "1 Hz", "roll rate at the end", turns=True)


class Point(Task):
    """Turn the boresight of the star camera to a direction."""

    task: Literal["point"]
    azimuth: Quantity("rad", "100 deg", "of the boresight at the end, north over east")
    elevation: _level("50 deg", "above the horizontal below the vehicle at the end")
    roll: Quantity("rad", "0 deg", "about the boresight; 0: camera x as near to the roll axis as it gets")


class Dwell(Task):
    """Hold an attitude in which the star camera works, but for rates that are asked for."""

    task: Literal["dwell"]
    boresight_rate: Quantity("rad/s", "0.1 deg/s", "constant, about the boresight") = "0 deg/s"
    cross_rate: Quantity("rad/s", "0.2 deg/s", "across it; its axis turns", non_negative=True) = "0 deg/s"
    cross_period: Quantity("s", "40 s", "of that turning", positive=True) | None = None
    cross_phase: Quantity("rad", "0 deg", "of that turning at the start") = "0 deg"
    ramp: Quantity("s", "5 s", "in which the rates fade in and out", positive=True) | None = None


class Hold(Task):
    """Hold the attitude, or the direction of the roll axis of a spinning vehicle."""

    task: Literal["hold"]


AnyTask = kinds("task", Damp, Turn, AlignVelocity, SpinTo, Point, Dwell, Hold)
Programme = dict[Name, AnyTask]
