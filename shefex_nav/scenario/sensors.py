"""Sections of a scenario about the sensors: IMU, alignment on the pad, star camera, GPS, and what goes wrong.

`use` names an instrument whose values a section takes. It belongs to files, not to what is read of them:
`layers` puts the instrument's values in its place. Each fault says what it is (`fault`), `from` when and
`until` when, from lift-off; without any nothing goes wrong: the sections describe healthy sensors.
"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, get_args

from pydantic import Field

from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.messages import bare
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.partial import of_each
from shefex_nav.scenario.quantity import Count, Number, Quantity, QuantitySpec, Reader, describe, refuse
from shefex_nav.world import camera_settings, fault_settings, gps_settings, settings

USE = "use"
OF_IMU = (
    "name of an instrument, or of its file, whose gyro and accelerometer these are; "
    "what stands beside it comes on top"
)
Gyro, Accelerometer, Vibration, PadAlignment = (
    section(one) for one in (settings.Gyro, settings.Accelerometer, settings.Vibration, settings.PadAlignment)
)


@dataclass(frozen=True)
class Instrument(Reader):
    """Type of the key: whatever is still there once files have been read had no file to be read from."""

    example: str = "ln_200s"

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any):
        return {"type": "string", "examples": [self.example]}

    def read(self, value):
        """None, as nothing is left of the key."""
        if value is None:
            return None
        raise refuse(f"names an instrument, which only a scenario file or --set can, got {describe(value)}")


Use = Annotated[Any, Instrument()]  # of an IMU


class StarCamera(section(camera_settings.StarCamera)):
    """Star camera, in the world."""

    use: Annotated[Any, Instrument("prosilica_ec655")] = Field(
        None,
        description="name of an instrument, or of its file, whose optics and detector these are; "
        "what stands beside it comes on top",
    )


class Imu(section(settings.Imu)):
    """Strapdown inertial measurement unit, 400 samples a second of integrated rate and specific force."""

    use: Use = Field(None, description=OF_IMU)


class Almanac(Block):
    """Elements of satellites in a YUMA file; one value for each."""

    prn: list[Count("5", "number", positive=True, at_most=gps_settings.MOST)]
    health: list[Count("0", "0: good", non_negative=True)]
    eccentricity: list[Number("0.01", "of the orbit", non_negative=True, at_most=0.5)]
    time: list[Quantity("s", "319488 s", "of the week, for which the elements hold", non_negative=True)]
    inclination: list[Quantity("rad", "0.96 rad", "of the orbit")]
    node_rate: list[Quantity("rad/s", "-8e-9 rad/s", "of the right ascension of the node")]
    root_semi_major_axis: list[Number("5153.6", "root of metres", positive=True)]
    node: list[Quantity("rad", "1 rad", "longitude of the ascending node at the start of the week")]
    perigee: list[Quantity("rad", "1 rad", "argument of perigee")]
    anomaly: list[Quantity("rad", "1 rad", "mean anomaly")]
    week: list[Count("669", "of GPS, modulo 1024 or in full", non_negative=True)]


ALMANAC_UNITS = {
    name: spec.unit
    for name, field in Almanac.model_fields.items()
    for spec in bare(get_args(field.annotation)[0])[1]
    if isinstance(spec, QuantitySpec)
}


def _almanac_form(value):
    return "<name>" if isinstance(value, str) else "<prn>"


Satellites = tagged(_almanac_form, {"name": str, "prn": Almanac})


class Gps(section(gps_settings.Gps)):
    """GPS receiver: fixes of position and velocity, and the ranges of which they are made."""

    use: Annotated[Any, Instrument("max_m10s")] = Field(
        None,
        description="name of an instrument, or of its file, whose rate, noise, latency, limits, clock and "
        "reacquisition these are; what stands beside it comes on top",
    )
    almanac: Satellites | None = Field(
        default=None, description="satellites: name of a YUMA file, or its elements; else the nominal 24"
    )


class Faults(section(fault_settings.Faults)):
    """What goes wrong; `aboard.complete` adds a list for each instrument."""

    NAME: ClassVar[str] = "Faults"


def contradictions(scenario):
    """(path of the field, text for people) of faults that make no sense."""
    limit = scenario.mission.time_limit
    for device in type(scenario.faults).model_fields:
        several = getattr(scenario.faults, device, ())  # one that is no list is complained about already
        yield from of_each(several, partial(_of_fault, device, limit))


def _of_fault(device, limit, k, fault):
    """What is wrong with fault k of a device. limit : of the mission, s"""
    path = ("faults", device, k)
    if fault.start > limit:
        yield (*path, "from"), f"{fault.start:g} s is after mission.time_limit, {limit:g} s"
    if fault.end <= fault.start:
        yield (*path, "until"), f"{fault.end:g} s must be later than from, {fault.start:g} s"
    if fault.fault == "wrong_fixes" and fault.largest < fault.smallest:
        yield (*path, "smallest"), "must not exceed largest"
