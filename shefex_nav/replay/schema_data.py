"""The section `data` of a replay scenario: in which columns of which files the data are.

Three formats, told apart by the word under `format`. Of a CSV each column has its unit; once loaded it is a
Scale.
"""

from functools import cache
from typing import Annotated, Literal, Self

from pydantic import Field, create_model, model_validator

from shefex_nav.instruments import BUILT_IN
from shefex_nav.instruments.instrument import Instrument
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.columns import SIDES, Axis, Names, Unit, check_right_handed
from shefex_nav.scenario.quantity import Quantity, Time

PLACE = "columns: latitude, longitude, height, or x, y, z; or latitude and longitude alone"
Level = Annotated[
    tuple[str, ...], Field(min_length=2, max_length=3)
]  # of three columns, the last may be missing


class ImuColumns(Block):
    """A CSV of the IMU."""

    file: str = Field(min_length=1)
    rate: Quantity("Hz", "200 Hz", "samples a second", at_least="20 Hz", at_most="5 kHz")
    time: str = Field(description="column of the time")
    time_unit: Unit("s", "s") = "s"
    gyro: Names = Field(description="columns of angular rate, or of angle within the sample")
    gyro_unit: Unit("deg/s", rate="rad/s", increment="rad") = Field(description="deg/s, rad/s, or deg, rad")
    accelerometer: Names = Field(description="columns of specific force, or of velocity within the sample")
    accelerometer_unit: Unit("m/s2", rate="m/s2", increment="m/s") = Field(description="m/s2, gee, or m/s")


class GnssColumns(Block):
    """A CSV of a GNSS receiver."""

    file: str = Field(min_length=1)
    time: str = Field(description="column of the time")
    time_unit: Unit("s", "s") = "s"
    position: Level = Field(description=PLACE)
    position_frame: Literal["geodetic", "ecef"] = "geodetic"
    height: Quantity("m", "360 m", "of the start above the ellipsoid, where fixes say none",
                     at_least="-500 m", at_most="9 km") | None = None  # fmt: skip
    height_error: Quantity("m", "10 m", "of that height, 1 sigma", positive=True, at_most="10000 km") = "10 m"
    angle_unit: Unit("deg", "rad") = Field(default="deg", description="of latitude and longitude")
    velocity: Names | None = Field(default=None, description="columns")
    velocity_frame: Literal["ned", "enu", "ecef"] = "ned"
    position_sigma: Level | None = Field(
        default=None, description="columns north, east, down, in m; north and east if there is no height"
    )
    velocity_sigma: Names | None = Field(default=None, description="columns north, east, down, in m/s")
    valid: str | None = Field(default=None, description="column; 0 where there is no fix")
    satellites: str | None = Field(default=None, description="column: how many satellites were used")


class ReadingColumns(Block):
    """A CSV of an instrument, vectors in the axes of the IMU's file unless it says others."""

    file: str = Field(min_length=1)
    time: str = Field(description="column of the time")
    time_unit: Unit("s", "s") = "s"
    axes: tuple[Axis, Axis, Axis] | None = Field(
        default=None, description="axes of this file that point forward, right and down; else data.axes"
    )


@cache
def columns_of(instrument):
    """Section of the columns of an instrument: ReadingColumns with those of its DataColumns."""
    fields = {}
    for one in instrument.data:
        kind, alone = Names if one.vector else str, len(instrument.data) == 1
        default = {} if alone else {"default": None}
        fields[one.key] = (kind if alone else kind | None, Field(description=one.help, **default))
        words = f"its unit, such as {one.unit}"
        fields[f"{one.key}_unit"] = (Unit(one.unit, one.si), Field(default=one.unit, description=words))
    name = "".join(part.title() for part in instrument.name.split("_"))
    doc = f"A CSV of a {instrument.name.replace('_', ' ')}."
    return create_model(f"{name}Columns", __base__=ReadingColumns, __doc__=doc, **fields)


class TruthColumns(Block):
    """A CSV of what really happened, or of a better system's solution."""

    file: str = Field(min_length=1)
    time: str = Field(description="column of the time")
    time_unit: Unit("s", "s") = "s"
    position: Names = Field(description="columns: latitude, longitude, height, or x, y, z")
    position_frame: Literal["geodetic", "ecef"] = "geodetic"
    velocity: Names = Field(description="columns")
    velocity_frame: Literal["ned", "enu", "ecef"] = "ned"
    attitude: Names = Field(description="columns of roll, pitch and heading")
    angle_unit: Unit("deg", "rad") = Field(default="deg", description="of all angles")


class DataBlock(Block):
    """Where the files are, and how the instrument sits in the vehicle."""

    folder: str = Field(default="", description="relative to this file; --data takes its place")
    axes: tuple[Axis, Axis, Axis] = Field(
        default=SIDES, description="axes of the file that point forward, right and down, such as [x, -y, -z]"
    )
    samples: Literal["mean", "instant"] = Field(
        default="mean", description="rates are means since the sample before, or hold at their instant"
    )
    longest_gap: Time("0.1 s", "without IMU samples that is bridged", positive=True, at_most="1 s") = "0.1 s"

    @model_validator(mode="after")
    def _right_handed(self) -> Self:
        check_right_handed(self.axes)
        return self


class CsvData(DataBlock):
    """A folder of CSVs."""

    format: Literal["csv"]
    imu: ImuColumns
    gnss: GnssColumns
    truth: TruthColumns | None = None


class KfGinsData(DataBlock):
    """Text files as KF-GINS reads them."""

    format: Literal["kf_gins"]
    imu: str = Field(min_length=1, description="time, increments of angle and of velocity")
    gnss: str = Field(min_length=1, description="time, latitude, longitude, height, sigmas")
    truth: str | None = Field(default=None, description="week, time, position, velocity, attitude")


class NavegoData(DataBlock):
    """Matlab files as NaveGo saves them."""

    format: Literal["navego"]
    imu: str = Field(min_length=1, description="with t, wb, fb")
    gnss: str = Field(min_length=1, description="with t, lat, lon, h, vel, stdm, stdv")
    truth: str | None = Field(default=None, description="with t, lat, lon, h, vel, roll, pitch, yaw")


@cache
def _formats(instruments):
    """{word of `format`: section of data}, where CSVs may be of each of some instruments."""
    columns = {
        one.name: (columns_of(one) | None, Field(default=None, description=f"of section {one.name}"))
        for one in instruments
    }
    own = create_model("CsvData", __base__=CsvData, __module__=__name__, __doc__=CsvData.__doc__, **columns)
    return {"csv": own, "kf_gins": KfGinsData, "navego": NavegoData}


def formats(provided=()):
    """The same for the instruments that data can be of. provided : by plug-ins"""
    own = (one for one in provided if isinstance(one, Instrument))
    return _formats(tuple(one for one in (*BUILT_IN.values(), *own) if one.data))
