"""Sections of a scenario about the vehicle: payload, stages, devices.

Stations are distances behind the nose tip. Values are floats in SI and radians once loaded.
"""

from pydantic import Field

from shefex_nav.scenario.aerodynamics import Aerodynamics
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.motor import Motor, Propellant
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.programme import Name
from shefex_nav.scenario.quantity import Quantity, Time, Vector
from shefex_nav.world.flight import settings


class RigidPart(Block):
    """A rigid part: the payload, or a stage without its propellant."""

    mass: Quantity("kg", "480 kg", "mass", positive=True)
    station: Quantity("m", "2.1 m", "centre of mass, behind the nose tip", non_negative=True)
    inertia_roll: Quantity("kg m2", "55 kg m2", "about the roll axis", positive=True)
    inertia_pitch: Quantity("kg m2", "700 kg m2", "across, about its own centre of mass", positive=True)


class Payload(RigidPart):
    """What is left when every stage is gone, and in what the whole vehicle is not symmetric."""

    centre_of_mass_offset: tuple[
        Quantity("m", "1 mm", "of the vehicle off the roll axis in body y"),
        Quantity("m", "1 mm", "in body z"),
    ] = ("0 m", "0 m")
    principal_axis_tilt: tuple[
        Quantity("rad", "0.1 deg", "of the vehicle about body y", at_least="-10 deg", at_most="10 deg"),
        Quantity("rad", "0.1 deg", "about body z", at_least="-10 deg", at_most="10 deg"),
    ] = ("0 deg", "0 deg")
    aerodynamics: Aerodynamics | None = Field(
        default=None, description="of the payload alone; needed where no stage stays attached"
    )


class Separation(Block):
    """How a stage is dropped."""

    at: Time("65 s", "when", positive=True)
    impulse: Quantity("N s", "200 N s", "on what flies on, towards the nose", non_negative=True) = "0 N s"
    tip_off: tuple[
        Quantity("rad/s", "0.5 deg/s", "given to what flies on, about body y"),
        Quantity("rad/s", "0.5 deg/s", "about body z"),
    ] = ("0 deg/s", "0 deg/s")


class Stage(Block):
    """A stage with a solid motor."""

    ignition: Time("0 s", "when its motor is lit")
    separation: Separation | None = Field(default=None, description="none: it stays attached")
    dry: RigidPart
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
