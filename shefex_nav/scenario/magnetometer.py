"""Sections of a scenario about the magnetometer: the sensor, and how the filter uses it.

Values are floats in SI once loaded. The filter takes from the section of the sensor what it assumes of it.
"""

from typing import Literal

from pydantic import Field, StrictBool

from shefex_nav.scenario.barometer import Release
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Quantity
from shefex_nav.scenario.sensors import OFF


class Magnetometer(Block):
    """Magnetometer on board: the Earth's field along the three body axes."""

    rate: Quantity("Hz", "10 Hz", "readings a second; must divide 100 Hz", positive=True, at_most="100 Hz")
    latency: Quantity(
        "s", "10 ms", "from the instant measured to the reading on board", non_negative=True, at_most="1 s"
    ) = "0 s"
    hard_iron: Quantity("T", "500 nT", "constant field of the vehicle, each axis, 1 sigma", non_negative=True)
    soft_iron: Quantity(
        "",
        "0.5 %",
        "scale, misalignment and soft iron, each element, 1 sigma",
        non_negative=True,
        at_most="50 %",
    ) = "0 %"
    noise: Quantity("T", "50 nT", "of one reading, each axis, 1 sigma, white", positive=True)
    quantum: Quantity("T", "15 nT", "field of one count", positive=True, words=OFF) = "off"
    range: Quantity("T", "200 uT", "largest field on an axis", positive=True) = "200 uT"


class MagnetometerUse(Block):
    """How the filter uses the magnetometer."""

    used: StrictBool = Field(default=True, description="false: the filter does without it")
    rows: Literal["field", "heading"] = Field(
        "field", description="the three axes, or the heading alone where only that is to be trusted"
    )
    model_error: Quantity(
        "", "0.5 %", "of the field, besides what its model states", non_negative=True, at_most="50 %"
    ) = "0 %"
    memory: Quantity(
        "s", "100 s", "for how long soft iron and errors of the model keep their sign", positive=True
    ) = "100 s"
    release: Release = Field(
        {"rejections": 50, "duration": "5 s"},
        validate_default=True,
        description="when readings that contradict the filter are a new hard iron",
    )


def contradictions(scenario):
    """(path, words) of contradictions in the sections of the magnetometer of a mission."""
    yield from of_sensor(scenario)
    section = scenario.magnetometer
    if section is not None and abs(100.0 / section.rate - round(100.0 / section.rate)) > 1e-6:
        words = (
            f"{section.rate:g} Hz does not divide the on-board clock, 100 Hz; take such as 1, 10, 20 or 50 Hz"
        )
        yield ("magnetometer", "rate"), words


def of_sensor(scenario):
    """(path, words) of what missions and replays have in common."""
    section, states = scenario.magnetometer, scenario.navigation.states
    if section is None:
        if "hard_iron" in states:
            words = "'hard_iron' is of a magnetometer: give section magnetometer, or leave it out"
            yield ("navigation", "states", states.index("hard_iron")), words
        return
    if scenario.navigation.magnetometer.used and "hard_iron" not in states:
        words = (
            f"a magnetometer needs the state of its hard iron; write [{', '.join([*states, 'hard_iron'])}]"
        )
        yield ("navigation", "states"), words
    from shefex_nav.environment import magnetic_field

    outside = magnetic_field.years_outside(magnetic_field.decimal_year(scenario.mission.epoch))
    if outside > magnetic_field.MOST_OUTSIDE:
        words = f"the magnetic field is not known {outside:.0f} years outside its models, 2010 to 2030"
        yield ("mission", "epoch"), words
