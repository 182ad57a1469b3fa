"""Section `alignment` of a replay scenario: where the navigation starts from, in several forms."""

from typing import Literal

from pydantic import Field

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Quantity, Time
from shefex_nav.world.settings import NOT_KNOWN


class FromReference(Block):
    """Position, velocity and attitude are those of the truth, and known as well as is said here (1 sigma)."""

    method: Literal["reference"]
    level: Quantity("rad", "1 deg", "about north and about east", positive=True, at_most="20 deg")
    azimuth: Quantity("rad", "2 deg", "about the vertical", positive=True, at_most="180 deg")
    position: Quantity("m", "5 m", "each axis", positive=True, at_most="10000 km")
    velocity: Quantity("m/s", "0.1 m/s", "each axis", positive=True)


class Static(Block):
    """The vehicle stands still at first: level by the accelerometers, heading by the gyros or as given."""

    method: Literal["static"]
    duration: Time("30 s", "for which it stands still, from mission.start", at_least="1 s", at_most="24 h")
    heading: (
        Quantity(
            "rad",
            "85 deg",
            "of the forward axis; without it the gyros look for north",
            words=NOT_KNOWN,
            at_least="-360 deg",
            at_most="360 deg",
        )
        | None
    ) = None
    azimuth: (
        Quantity("rad", "1 deg", "how well the heading is known, 1 sigma", positive=True, at_most="180 deg")
        | None
    ) = None
    disturbance: Quantity(
        "rad", "0.02 deg", "swaying of the vehicle, 1 sigma", positive=True, at_most="180 deg"
    ) = "0.01 deg"
    velocity: Quantity("m/s", "0.01 m/s", "what is left of standing still, 1 sigma", positive=True) = (
        "0.01 m/s"
    )
    gyro_bias: Literal["as_stated", "at_rest"] = Field(
        default="as_stated",
        description="known as imu.gyro.bias says, or from the mean rate at rest; this needs a heading",
    )


class Rail(Block):
    """A rocket stands on its rail at first: it points as the rail does, gravity shows its roll if it can."""

    method: Literal["rail"]
    duration: Time("30 s", "for which it stands still, from mission.start", at_least="0.2 s", at_most="24 h")
    elevation: Quantity("rad", "84 deg", "of the rail", at_least="20 deg", at_most="90 deg")
    elevation_error: Quantity("rad", "0.5 deg", "1 sigma", positive=True, at_most="180 deg")
    azimuth: Quantity(
        "rad",
        "135 deg",
        "to which the rail leans, from north over east",
        at_least="-360 deg",
        at_most="360 deg",
    )
    azimuth_error: Quantity("rad", "2 deg", "1 sigma", positive=True, at_most="180 deg")
    disturbance: Quantity(
        "rad", "0.02 deg", "swaying of the rocket, 1 sigma", positive=True, at_most="180 deg"
    ) = "0.05 deg"
    velocity: Quantity("m/s", "0.01 m/s", "what is left of standing still, 1 sigma", positive=True) = (
        "0.01 m/s"
    )


class Course(Block):
    """The vehicle moves: it points where it goes over the ground, level by the specific force."""

    method: Literal["course"]
    speed: Quantity("m/s", "5 m/s", "over the ground, from which on the course is taken", positive=True) = (
        "3 m/s"
    )
    sideslip: Quantity(
        "rad", "5 deg", "between its heading and its course, 1 sigma", positive=True, at_most="180 deg"
    ) = "3 deg"


ALIGNMENTS = {"reference": FromReference, "static": Static, "rail": Rail, "course": Course}
