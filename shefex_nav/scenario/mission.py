"""Sections of a scenario about the mission: when, from where, on which Earth, what the vehicle is told to do.

Values are floats in SI and radians once loaded. All times count from lift-off.
"""

from datetime import datetime, timedelta
from typing import Annotated

from pydantic import BeforeValidator, Field, WithJsonSchema

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Count, Quantity, Time, quoted, refuse

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
    start: Time("-10 s", "the simulation starts on the pad", at_most="0 s", at_least="-1 h")
    time_limit: Time("600 s", "the vehicle must be on the ground by then", positive=True, at_most="1 h")


class Earth(Block):
    """The Earth on the day of the flight, pinned so that a newer table never changes a result."""

    ut1_minus_utc: Quantity("s", "-0.58479 s", "UT1-UTC (IERS)", at_least="-0.9 s", at_most="0.9 s")
    pole_x: Quantity("rad", "0.0787 arcsec", "polar motion (IERS)", at_least="-2 arcsec", at_most="2 arcsec")
    pole_y: Quantity("rad", "0.4084 arcsec", "polar motion (IERS)", at_least="-2 arcsec", at_most="2 arcsec")
    gravity_degree: Count("18", "degree and order of EGM96 that the vehicle flies in", at_least=0, at_most=36)


class Launch(Block):
    """Where the vehicle stands, and the rail."""

    latitude: Quantity("rad", "69.2942 deg", "geodetic, WGS 84", at_least="-90 deg", at_most="90 deg")
    longitude: Quantity("rad", "16.0190 deg", "east of Greenwich", at_least="-180 deg", at_most="360 deg")
    height: Quantity("m", "10 m", "of the IMU above the ellipsoid", at_least="-500 m", at_most="9 km")
    azimuth: Quantity(
        "rad", "352 deg", "of the rail, north over east", at_least="-360 deg", at_most="360 deg"
    )
    elevation: Quantity("rad", "88 deg", "of the rail", at_least="45 deg", at_most="90 deg")
    roll: Quantity(
        "rad", "0 deg", "about the roll axis; 0: body y is horizontal, to the right along the azimuth"
    )
    rail_length: Quantity("m", "12 m", "travel until the vehicle is free", positive=True)


class Pointing(Block):
    """The attitude in which the star camera works."""

    azimuth: Quantity("rad", "100 deg", "of the boresight at the start, north over east")
    elevation: Quantity("rad", "50 deg", "above the local horizontal", at_least="-90 deg", at_most="90 deg")
    roll: Quantity(
        "rad", "0 deg", "about the boresight; 0: camera x as near to the burn's roll axis as it gets"
    )
    boresight_rate: Quantity("rad/s", "0.1 deg/s", "constant rate about the boresight")
    cross_rate: Quantity("rad/s", "0.2 deg/s", "rate across the boresight; its axis turns", non_negative=True)
    cross_period: Quantity("s", "40 s", "of that turning", positive=True)
    cross_phase: Quantity("rad", "0 deg", "of that turning at the start")
    ramp: Quantity("s", "5 s", "in which the rates fade in and out", positive=True)


class Programme(Block):
    """What the vehicle does after the first burn. Its attitude is prescribed from separation to spin-up."""

    separation: Time("65 s", "the first stage is dropped", positive=True)
    precession_start: Time("70 s", "the roll axis starts to turn to the attitude of the second burn")
    precession_end: Time("145 s", "it has arrived")
    burn_azimuth: Quantity("rad", "352 deg", "of the roll axis in the second burn, north over east")
    burn_elevation: Quantity("rad", "8.2 deg", "above the horizontal", at_least="-90 deg", at_most="90 deg")
    ignition_2: Time("149.2 s", "the second stage is lit")
    despin_start: Time("220 s", "the spin starts to go to zero")
    despin_end: Time("235 s", "no spin; the slew to the star camera's attitude starts")
    pointing_start: Time("250 s", "the star camera's attitude is reached")
    pointing: Pointing
    pointing_end: Time("372 s", "the slew of the roll axis to the entry attitude starts")
    entry_slew_end: Time("384 s", "the spin-up starts")
    entry_aim: Time("397 s", "the roll axis points along the air-relative velocity of this instant")
    entry_spin: Quantity("rad/s", "1 Hz", "roll rate at entry", turns=True)
    spin_up_end: Time("394 s", "the attitude is free from here on")
