"""Sections of a scenario about the vehicle: payload, stages, devices.

Stations are distances behind the nose tip. Values are floats in SI and radians once loaded.
"""

from pydantic import Field

from shefex_nav.scenario.aerodynamics import Aerodynamics
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.motor import Motor, Propellant
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.programme import Name
from shefex_nav.scenario.quantity import Time, Vector
from shefex_nav.world.flight import parts, settings


class Payload(section(parts.Payload)):
    """What is left when every stage is gone, and in what the whole vehicle is not symmetric."""

    aerodynamics: Aerodynamics | None = Field(
        default=None, description="of the payload alone; needed where no stage stays attached"
    )


class Stage(Block):
    """A stage with a solid motor."""

    ignition: Time("0 s", "when its motor is lit")
    separation: section(parts.Separation) | None = Field(default=None, description="none: it stays attached")
    dry: section(parts.RigidPart)
    propellant: Propellant
    motor: Motor
    aerodynamics: Aerodynamics = Field(description="of the vehicle while this is the lowest stage attached")


class Vehicle(Block):
    """What flies: payload, stages in the order in which they burn, devices."""

    imu: Vector("m", "-2 m", "IMU from the nose tip, body axes (x to the nose)")
    payload: Payload
    stages: dict[Name, Stage] = Field(description="by name, in the order in which they burn; may be {}")
    spin_motors: section(settings.SpinMotors) | None = None
    yo_yo: section(settings.YoYo) | None = None
    cold_gas: section(settings.ColdGas) | None = None
    parachute: section(settings.Parachute) | None = None
