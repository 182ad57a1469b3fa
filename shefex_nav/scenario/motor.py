"""Sections of a scenario about a motor: what it pushes, how its propellant lies and goes.

Values are floats in SI and radians once loaded.
"""

from typing import Literal

from pydantic import Field

from shefex_nav.scenario.block import Block, forms
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.quantity import Number, Quantity
from shefex_nav.world.flight import parts

MassType = Quantity("kg", "814 kg", "at ignition", positive=True)


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


class Nozzle(section(parts.Nozzle)):
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
