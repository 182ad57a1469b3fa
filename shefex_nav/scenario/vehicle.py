"""Sections of a scenario about the vehicle: coefficients of the air, motors, payload, stages, devices.

Stations are distances behind the nose tip. Values are floats in SI and radians once loaded.
"""

from typing import Any, Literal

from pydantic import Field

from shefex_nav.scenario.block import Block, forms, tagged
from shefex_nav.scenario.mission import Name
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.quantity import Number, Quantity, Time, Vector
from shefex_nav.world.flight import settings

LARGEST = 1e4  # [E] of a coefficient: a parachute to the area of a slim rocket has some hundreds
MassType = Quantity("kg", "814 kg", "at ignition", positive=True)


def _row_or_rows(value: Any):
    return "<rows>" if isinstance(value, list) and value and isinstance(value[0], list) else "<row>"


def column(item):
    """Type of a coefficient: a list over the Mach numbers, or one such list for each angle of attack."""
    return tagged(_row_or_rows, {"row": list[item], "rows": list[list[item]]})


class CoefficientBase(Block):
    """To what the coefficients count, and those that depend on the Mach number alone."""

    area: Quantity("m2", "0.8 m2", "reference area", positive=True)
    diameter: Quantity("m", "1.01 m", "reference diameter", positive=True, at_most="1 km")
    fin_cant: Quantity(
        "rad", "0.4 deg", "angle of the fins that spins the vehicle up", at_least="-5 deg", at_most="5 deg"
    ) = "0 deg"
    damping_mach: list[Number("1.05", "", non_negative=True)] | None = Field(
        default=None,
        min_length=2,
        description="Mach numbers of the damping coefficients, where they are not those of the others",
    )
    pitch_damping: list[Number("-80", at_most=0.0)] = Field(
        description="for pitch rate times diameter over 2 V; negative damps"
    )
    roll_damping: list[Number("-5", at_most=0.0)] = Field(
        description="for roll rate times diameter over 2 V; negative damps"
    )
    roll_by_cant: list[Number("5")] | None = Field(
        default=None, description="rolling moment per radian of fin cant; none without fins"
    )
    axial_factor: Quantity("", "100 %", "of the axial force", positive=True, at_most="1000 %") = "100 %"
    normal_factor: Quantity("", "100 %", "of the normal force", positive=True, at_most="1000 %") = "100 %"


class Coefficients(CoefficientBase):
    """Coefficients of one configuration, to one reference area and diameter."""

    mach: list[Number("1.05", "", non_negative=True, at_most=100.0)] = Field(
        min_length=2, description="Mach numbers, increasing"
    )
    angle_of_attack: list[Quantity("rad", "4 deg", "", non_negative=True, at_most="180 deg")] | None = Field(
        default=None,
        min_length=2,
        description="total angles of attack, increasing from 0 deg; axial, normal_slope, pressure_station "
        "and drag are then one list for each angle; beyond the last the axial force turns round as without "
        "angles, the others hold",
    )
    axial: column(Number("0.62", at_least=-LARGEST, at_most=LARGEST)) = Field(
        description="axial force; without angles of attack that at zero, which goes with the cosine squared"
    )
    normal_slope: column(Number("2.5", at_least=-LARGEST, at_most=LARGEST)) = Field(
        description="normal force over the sine of the angle of attack, per radian"
    )
    pressure_station: column(Quantity("m", "6.5 m", "", at_least="-1 km", at_most="1 km")) = Field(
        description="centre of pressure"
    )
    drag: column(Number("2.2", non_negative=True, at_most=LARGEST)) | None = Field(
        default=None, description="force against the air velocity, on top of the others"
    )


class CoefficientFile(CoefficientBase):
    """Coefficients of one configuration; those over the angle of attack in a file."""

    file: str = Field(
        min_length=1,
        description="CSV with the columns mach, alpha_deg, axial, normal_slope, pressure_station_m and, if "
        "there is any, drag; one row for each Mach number and angle of attack; relative to this file",
    )


Aerodynamics = forms(("mach", Coefficients), file=CoefficientFile)


class Grain(Block):
    """Solid propellant: a hollow cylinder that burns outwards."""

    mass: MassType
    station: Quantity("m", "5 m", "middle of the grain", non_negative=True)
    length: Quantity("m", "1.1 m", "length", positive=True, at_most="1 km")
    outer_radius: Quantity("m", "0.48 m", "outer radius", positive=True, at_most="1 km")
    inner_radius: Quantity("m", "0.15 m", "inner radius before ignition", positive=True, at_most="1 km")


class GrainTable(Block):
    """What is left of the propellant by the share that has burnt; linear in between."""

    burnt: list[Quantity("", "50 %", "", non_negative=True, at_most="100 %")] = Field(
        min_length=2, description="share of the mass, from 0 % to 100 %, increasing"
    )
    station: list[Quantity("m", "5 m", "", non_negative=True)] = Field(description="its centre of mass")
    inertia_roll: list[Quantity("kg m2", "90 kg m2", "", non_negative=True)] = Field(
        description="about the roll axis"
    )
    inertia_pitch: list[Quantity("kg m2", "120 kg m2", "", non_negative=True)] = Field(
        description="across, about its own centre of mass"
    )


class TabulatedPropellant(Block):
    """Propellant of any shape, by a table."""

    mass: MassType
    table: GrainTable


class PropellantFile(Block):
    """Propellant of any shape, by a table in a file."""

    mass: MassType
    file: str = Field(
        min_length=1,
        description="CSV with the columns burnt_percent, station_m, inertia_roll_kg_m2, "
        "inertia_pitch_kg_m2; relative to this file",
    )


Propellant = forms(("length", Grain), file=PropellantFile, table=TabulatedPropellant)


class Nozzle(section(settings.Nozzle)):
    """What every motor has: a nozzle, and what is not perfect about its thrust."""

    thrust_factor: Quantity(
        "",
        "100 %",
        "of the thrust; the same propellant gives so much more or less impulse",
        positive=True,
        at_most="1000 %",
    ) = "100 %"


class ShapedMotor(Nozzle):
    """Thrust: a rise, a slow decline, a tail-off; their area is propellant mass times exhaust speed."""

    specific_impulse: Quantity("s", "282 s", "in vacuum", positive=True, at_most="10000 s")
    burn_time: Quantity(
        "s", "68 s", "from ignition to the end of the tail-off", positive=True, at_most="24 h"
    )
    rise: Quantity("s", "0.3 s", "thrust from zero to its first level", positive=True, at_most="24 h")
    tail_off: Quantity("s", "4 s", "thrust to zero, at the end of the burn", positive=True, at_most="24 h")
    level_ratio: Number("0.89", "thrust before the tail-off over thrust after the rise", positive=True)


class ThrustTable(Block):
    """Thrust over the time since ignition, a broken line that ends with zero."""

    time: list[Quantity("s", "0.1 s", "", non_negative=True, at_most="24 h")] = Field(
        min_length=2, description="since ignition, from 0 s, increasing"
    )
    force: list[Quantity("N", "12 kN", "", non_negative=True)] = Field(description="at these times")


class MeasuredMotor(Nozzle):
    """Thrust by a table, in vacuum or as measured on a test stand at sea level."""

    thrust: ThrustTable
    measured_at: Literal["vacuum", "sea_level"] = Field(default="vacuum", description="of the table")
    specific_impulse: (
        Quantity(
            "s",
            "282 s",
            "in vacuum; without it that which impulse and propellant give",
            positive=True,
            at_most="10000 s",
        )
        | None
    ) = None


class MotorFile(Nozzle):
    """Thrust by a RASP file."""

    file: str = Field(min_length=1, description="RASP motor file (.eng) of one motor; relative to this file")
    measured_at: Literal["vacuum", "sea_level"] = Field(default="sea_level", description="of the file")
    specific_impulse: (
        Quantity(
            "s",
            "200 s",
            "in vacuum; without it that which impulse and propellant give",
            positive=True,
            at_most="10000 s",
        )
        | None
    ) = None


Motor = forms(("burn_time", ShapedMotor), file=MotorFile, thrust=MeasuredMotor)


class Payload(section(settings.Payload)):
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
    separation: section(settings.Separation) | None = Field(
        default=None, description="none: it stays attached"
    )
    dry: section(settings.RigidPart)
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
