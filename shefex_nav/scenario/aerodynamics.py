"""Section of a scenario about aerodynamic coefficients, over the Mach number and the angle of attack.

Values are floats in SI and radians once loaded.
"""

from typing import Any

from pydantic import Field

from shefex_nav.scenario.block import Block, forms, tagged
from shefex_nav.scenario.quantity import Number, Quantity

LARGEST = 1e4  # [E] of a coefficient: a parachute to the area of a slim rocket has some hundreds


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
