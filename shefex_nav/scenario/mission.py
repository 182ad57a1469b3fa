"""Sections of a scenario about the mission: when, from where, on which Earth, through which air.

Values are floats in SI and radians once loaded. All times count from lift-off.
"""

from datetime import datetime, timedelta
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.quantity import Count, Number, Quantity, Time, quoted, refuse
from shefex_nav.world.flight import settings

EPOCH_EXAMPLE = "2012-06-22T19:18:00Z"


def _read_epoch(value):
    """ISO 8601 text of an instant in UTC, without its zone."""
    try:
        when = datetime.fromisoformat(value)
    except (TypeError, ValueError):
        raise refuse(
            f"cannot read {quoted(value)} as a date and time; write UTC such as {EPOCH_EXAMPLE}"
        ) from None
    if when.tzinfo is None or when.utcoffset() != timedelta(0):
        raise refuse(f"{quoted(value)} is not marked as UTC; end it with Z, such as {EPOCH_EXAMPLE}")
    if when.year < 1973:
        raise refuse(f"{value!r} is before 1973, from when on the orientation of the Earth is tabulated")
    return when.replace(tzinfo=None).isoformat()


Epoch = Annotated[
    str,
    BeforeValidator(_read_epoch),
    WithJsonSchema(
        {"type": "string", "description": "UTC of lift-off, ISO 8601", "examples": [EPOCH_EXAMPLE]}
    ),
]


class Mission(Block):
    """What is flown and when."""

    name: str = Field(min_length=1, pattern=r"^[\w.-]+$", description="one word, used for file names")
    description: str = Field(description="for people")
    epoch: Epoch
    start: Time("-10 s", "start of the simulation, on the pad", at_most="0 s", at_least="-1 h")
    time_limit: Time("600 s", "a rocket must be on the ground by then", positive=True, at_most="12 h")


class Earth(Block):
    """The Earth on the day of the flight, pinned so that a newer table never changes a result."""

    ut1_minus_utc: Quantity("s", "-0.58479 s", "UT1-UTC (IERS)", at_least="-0.9 s", at_most="0.9 s")
    pole_x: Quantity("rad", "0.0787 arcsec", "polar motion (IERS)", at_least="-2 arcsec", at_most="2 arcsec")
    pole_y: Quantity("rad", "0.4084 arcsec", "polar motion (IERS)", at_least="-2 arcsec", at_most="2 arcsec")
    gravity: Literal["egm96", "j2", "point"] = Field(description="gravity that the vehicle flies in")
    gravity_degree: Count("12", "degree and order of egm96", at_least=2, at_most=36) = 12


class Msis(Block):
    """What the Sun does to the upper air, for NRLMSIS."""

    f107: Number("97.7", "solar flux at 10.7 cm of the day before, in sfu", positive=True, at_most=500)
    f107_average: Number("127.3", "its mean over 81 days, in sfu", positive=True, at_most=500)
    ap: Number("4", "daily geomagnetic index", non_negative=True, at_most=400)


class Atmosphere(Block):
    """The air."""

    model: Literal["us76", "msis"] = Field(
        default="us76", description="US Standard Atmosphere 1976 or NRLMSIS 2"
    )
    density: Quantity("", "100 %", "of the density of the model", positive=True, at_most="1000 %") = "100 %"
    msis: Msis | None = Field(default=None, description="needed by msis")


class WindTable(Block):
    """Wind over the height above the ellipsoid; constant below the first and above the last height."""

    height: list[Quantity("m", "500 m", "")] = Field(min_length=1, description="increasing")
    speed: list[Quantity("m/s", "12 m/s", "", non_negative=True)] = Field(description="at these heights")
    direction: list[Quantity("rad", "270 deg", "", at_least="-360 deg", at_most="360 deg")] = Field(
        alias="from", description="where it blows from, north over east"
    )


class WindFile(Block):
    """Wind in a file."""

    file: str = Field(
        min_length=1, description="CSV with the columns height_m, speed_m_s, from_deg; relative to this file"
    )


def _wind_form(value: Any):
    if isinstance(value, str):
        return "<none>"
    return (
        "<file>"
        if isinstance(value, WindFile) or (isinstance(value, dict) and "file" in value)
        else "<height>"
    )


Wind = tagged(_wind_form, {"none": Literal["none"], "file": WindFile, "height": WindTable})


Launch, Ground, Orbit = (section(one) for one in (settings.Launch, settings.Ground, settings.Orbit))
