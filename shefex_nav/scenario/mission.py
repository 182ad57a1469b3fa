"""Sections of a scenario about the mission: when, from where, on which Earth, in which air, what is done.

Values are floats in SI and radians once loaded. All times count from lift-off.
"""

from datetime import datetime, timedelta
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from shefex_nav.environment import models
from shefex_nav.environment.models import BUILT_IN, Gravity, Msis
from shefex_nav.scenario.block import Block, by_kind, kinds, tagged
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.quantity import Count, Quantity, Time, quoted, refuse
from shefex_nav.world.flight import settings, tasks

EPOCH_EXAMPLE = "2012-06-22T19:18:00Z"
LAST_YEAR, LONGEST_NAME = 2100, 100


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
    if when.year > LAST_YEAR:
        raise refuse(f"{value!r} is after {LAST_YEAR}, to which logs and ephemerides reach")
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

    name: str = Field(
        min_length=1,
        max_length=LONGEST_NAME,
        pattern=r"^[\w.-]+$",
        description="one word, used for file names",
    )
    description: str = Field(description="for people")
    epoch: Epoch
    start: Time("-10 s", "start of the simulation, on the pad", at_most="0 s", at_least="-1 h")
    time_limit: Time("600 s", "a rocket must be on the ground by then", positive=True, at_most="12 h")


class Earth(Block):
    """The Earth on the day of the flight, pinned so that a newer table never changes a result."""

    ut1_minus_utc: Quantity("s", "-0.58479 s", "UT1-UTC (IERS)", at_least="-0.9 s", at_most="0.9 s")
    pole_x: Quantity("rad", "0.0787 arcsec", "polar motion (IERS)", at_least="-2 arcsec", at_most="2 arcsec")
    pole_y: Quantity("rad", "0.4084 arcsec", "polar motion (IERS)", at_least="-2 arcsec", at_most="2 arcsec")
    gravity: Literal[tuple(BUILT_IN[Gravity])] = Field(description="gravity that the vehicle flies in")
    gravity_degree: Count("12", "degree and order of egm96", at_least=2, at_most=36) = 12


class Atmosphere(Block):
    """The air."""

    model: Literal[tuple(BUILT_IN[models.Atmosphere])] = Field(
        default="us76", description="US Standard Atmosphere 1976 or NRLMSIS 2"
    )
    density: Quantity("", "100 %", "of the density of the model", positive=True, at_most="1000 %") = "100 %"
    msis: section(Msis) | None = Field(default=None, description="needed by msis")


class WindTable(Block):
    """Wind over the height above the ellipsoid; constant below the first and above the last height."""

    height: list[Quantity("m", "500 m", "", at_least="-10 km", at_most="10000 km")] = Field(
        min_length=1, description="increasing"
    )
    speed: list[Quantity("m/s", "12 m/s", "", non_negative=True)] = Field(description="at these heights")
    direction: list[Quantity("rad", "270 deg", "", at_least="-360 deg", at_most="360 deg")] = Field(
        alias="from", description="where it blows from, north over east"
    )


class WindFile(Block):
    """Wind in a file."""

    file: str = Field(
        min_length=1, description="CSV with the columns height_m, speed_m_s, from_deg; relative to this file"
    )


def wind_type(names, *named):
    """Type of the wind: a name, a table, or a section with the name as its `model`.

    names : that may stand alone; named : models of such sections
    """
    choose, kinds = by_kind("model", *named) if named else (None, {})

    def form(value: Any):
        if isinstance(value, str):
            return "<none>"
        keys = value if isinstance(value, dict) else getattr(type(value), "model_fields", ())
        if named and "model" in keys and "file" not in keys:
            return choose(value)
        return "<file>" if "file" in keys else "<height>"

    return tagged(form, {"none": Literal[names], "file": WindFile, "height": WindTable, **kinds})


Wind = wind_type(tuple(BUILT_IN[models.Wind]))

Launch, Ground, Orbit = (section(one) for one in (settings.Launch, settings.Ground, settings.Orbit))

Name = Annotated[str, Field(pattern=r"^[\w-]+$", description="one word")]
Programme = dict[Name, kinds("task", *map(section, tasks.KINDS))]  # of the attitude, by name
