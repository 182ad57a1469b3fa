"""Sections of a scenario about the vehicle: payload, stages, devices.

Stations are distances behind the nose tip. Values are floats in SI and radians once loaded.
"""

from pydantic import Field

from shefex_nav.scenario.aerodynamics import Aerodynamics
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.motor import Motor, Propellant
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.programme import Name
from shefex_nav.scenario.quantity import Number, Quantity, Time, Vector
from shefex_nav.world.flight import parts, settings


class Payload(section(parts.Payload)):
    """What is left when every stage is gone, and in what the whole vehicle is not symmetric."""

    aerodynamics: Aerodynamics | None = Field(
        default=None, description="of the payload alone; needed where no stage stays attached"
    )


class Spent(Block):
    """Drag of a stage that falls empty after its separation, for where it lands."""

    area: Quantity("m2", "0.8 m2", "reference area", positive=True)
    mach: list[Number("1.05", "", non_negative=True)] = Field(
        min_length=2, description="Mach numbers, increasing; constant beyond their ends"
    )
    drag: list[Number("1.1", non_negative=True)] = Field(
        description="drag coefficient at these, as the stage tumbles or flies"
    )


class Stage(Block):
    """A stage with a solid motor."""

    ignition: Time("0 s", "when its motor is lit")
    separation: section(parts.Separation) | None = Field(default=None, description="none: it stays attached")
    dry: section(parts.RigidPart)
    propellant: Propellant
    motor: Motor
    aerodynamics: Aerodynamics = Field(description="of the vehicle while this is the lowest stage attached")
    spent: Spent | None = Field(default=None, description="needed where it shall be followed to the ground")


class Vehicle(Block):
    """What flies: payload, stages in the order in which they burn, devices."""

    imu: Vector(
        "m", "-2 m", "IMU from the nose tip, body axes (x to the nose)", at_least="-1 km", at_most="1 km"
    )
    payload: Payload
    stages: dict[Name, Stage] = Field(description="by name, in the order in which they burn; may be {}")
    spin_motors: section(settings.SpinMotors) | None = None
    yo_yo: section(settings.YoYo) | None = None
    cold_gas: section(settings.ColdGas) | None = None
    parachute: section(settings.Parachute) | None = None
