"""Section of a scenario about the GPS receiver: its settings, and the satellites."""

from typing import Annotated, Any, get_args

from pydantic import Field

from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.messages import bare
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.quantity import Count, Number, Quantity, QuantitySpec
from shefex_nav.scenario.use import Instrument
from shefex_nav.world import gps_settings
from shefex_nav.world.gps_settings import MOST


class Almanac(Block):
    """Elements of satellites in a YUMA file; one value for each."""

    prn: list[Count("5", "number", positive=True, at_most=MOST)]
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
