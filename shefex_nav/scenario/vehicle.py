"""Sections of a scenario about the vehicle: payload, stages, aerodynamics.

Stations are distances behind the nose tip. Values are floats in SI and radians once loaded.
"""

from pydantic import Field

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Number, Quantity, Vector


class RigidPart(Block):
    """A rigid part: the payload, or a stage without its propellant."""

    mass: Quantity("kg", "480 kg", "mass", positive=True)
    station: Quantity("m", "2.1 m", "centre of mass, behind the nose tip", non_negative=True)
    inertia_roll: Quantity("kg m2", "55 kg m2", "about the roll axis", positive=True)
    inertia_pitch: Quantity("kg m2", "700 kg m2", "across, about its own centre of mass", positive=True)


class Grain(Block):
    """Solid propellant: a hollow cylinder that burns outwards."""

    mass: Quantity("kg", "814 kg", "at ignition", positive=True)
    station: Quantity("m", "5 m", "middle of the grain", non_negative=True)
    length: Quantity("m", "1.1 m", "length", positive=True)
    outer_radius: Quantity("m", "0.48 m", "outer radius", positive=True)
    inner_radius: Quantity("m", "0.15 m", "inner radius before ignition", positive=True)


class Motor(Block):
    """Thrust: a rise, a slow decline, a tail-off; their area is propellant mass times exhaust speed."""

    specific_impulse: Quantity("s", "282 s", "in vacuum", positive=True)
    burn_time: Quantity("s", "68 s", "from ignition to the end of the tail-off", positive=True)
    rise: Quantity("s", "0.3 s", "thrust from zero to its first level", positive=True)
    tail_off: Quantity("s", "4 s", "thrust to zero, at the end of the burn", positive=True)
    level_ratio: Number("0.89", "thrust before the tail-off over thrust after the rise", positive=True)
    exit_area: Quantity("m2", "0.45 m2", "nozzle exit", positive=True)
    exit_station: Quantity("m", "12.6 m", "nozzle exit", positive=True)


class StageBlock(Block):
    """A stage with a solid motor."""

    name: str = Field(min_length=1, description="name of the motor")
    dry: RigidPart
    propellant: Grain
    motor: Motor


class AerodynamicsBlock(Block):
    """Coefficients of one configuration over the Mach number, to one reference area and diameter."""

    area: Quantity("m2", "0.8 m2", "reference area", positive=True)
    diameter: Quantity("m", "1.01 m", "reference diameter", positive=True)
    fin_cant: Quantity(
        "rad", "0.4 deg", "angle of the fins that spins the vehicle up", at_least="-5 deg", at_most="5 deg"
    )
    mach: list[Number("1.05", "", non_negative=True)] = Field(
        min_length=2, description="Mach numbers, increasing"
    )
    axial: list[Number("0.62", "", non_negative=True)] = Field(
        description="axial force, at zero angle of attack"
    )
    normal_slope: list[Number("2.5")] = Field(description="slope of the normal force, per radian")
    pressure_station: list[Quantity("m", "6.5 m", "", non_negative=True)] = Field(
        description="centre of pressure"
    )
    pitch_damping: list[Number("-80")] = Field(
        description="for pitch rate times diameter over 2 V; negative damps"
    )
    roll_damping: list[Number("-5")] = Field(
        description="for roll rate times diameter over 2 V; negative damps"
    )
    roll_by_cant: list[Number("5")] = Field(description="rolling moment per radian of fin cant")


class AerodynamicsPair(Block):
    """Coefficients before and after the first stage is dropped."""

    stack: AerodynamicsBlock
    upper: AerodynamicsBlock


class Vehicle(Block):
    """The rocket: payload and two stages, lit one after the other."""

    imu: Vector("m", "-2 m", "IMU from the nose tip, body axes (x to the nose)")
    payload: RigidPart
    stages: tuple[StageBlock, StageBlock] = Field(description="first and second stage")
    aerodynamics: AerodynamicsPair
