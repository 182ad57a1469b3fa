"""The replay scenario: a small YAML that says what data of others are and what the filter assumes of them.

Values carry their units as in missions, and `imu:`, `navigation:` and the alignment have the names that
missions use. Once loaded, a quantity is a float in SI and radians. Times count from the first IMU sample.
"""

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

from pydantic import BeforeValidator, Field, PrivateAttr, create_model, model_validator
from pydantic_core import PydanticCustomError, core_schema

from shefex_nav.clock import SAMPLES_PER_TICK
from shefex_nav.instruments import BUILT_IN
from shefex_nav.instruments.instrument import Instrument
from shefex_nav.onboard.navigation import settings
from shefex_nav.onboard.navigation.blocks import STATES
from shefex_nav.replay.schema_alignment import ALIGNMENTS
from shefex_nav.scenario import aboard
from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.messages import close
from shefex_nav.scenario.mission import Epoch
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.onboard import Navigation
from shefex_nav.scenario.plugged import PLUGINS, Plugins
from shefex_nav.scenario.quantity import (
    Count,
    Number,
    Quantity,
    QuantitySpec,
    Time,
    Vector,
    describe,
    quoted,
    refuse,
)
from shefex_nav.scenario.requirements import AttitudeLimit, IntegrityRisk, PositionLimit, VelocityLimit
from shefex_nav.scenario.sensors import OF_IMU, OFF, UNLIMITED, Accelerometer, Gyro
from shefex_nav.scenario.use import Use

NED = Field(description="noise, 1 sigma, north, east, down; takes the place of what the file says")
SIDES = ("x", "y", "z")
FIND = (("find", float("inf")),)


class Scale(NamedTuple):
    """A unit of a column: what it measures, and its size in SI."""

    kind: str  # 'rate' or 'increment' for inertial sensors, otherwise ''
    factor: float


@dataclass(frozen=True)
class UnitSpec:
    """How a field reads the unit of a column; `kinds` are (kind, SI unit) of which one must fit."""

    example: str
    kinds: tuple[tuple[str, str], ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any):
        return core_schema.no_info_plain_validator_function(self.read)

    def read(self, value):
        """Scale of a unit."""
        if isinstance(value, Scale):
            return value
        if not isinstance(value, str) or not value.strip():
            raise refuse(f"expected a unit such as '{self.example}', got {describe(value)}")
        for kind, unit in self.kinds:
            try:
                return Scale(kind, QuantitySpec(unit, f"1 {self.example}").read(f"1 {value}"))
            except PydanticCustomError as error:
                problem = error
        if len(self.kinds) > 1:
            words = f"{quoted(value)} is no unit of these columns"
            raise refuse(f"{words}; expected one such as '{self.example}'")
        raise problem


def Unit(example, *units, **kinds):
    """Type of a field that is the unit of columns: of `units`, or of one of several kinds."""
    return Annotated[Any, UnitSpec(example, tuple((kinds or {"": units[0]}).items()))]


class ReplayMission(Block):
    """What is replayed, and when."""

    name: str = Field(min_length=1, pattern=r"^[\w.-]+$", description="one word, for tables and logs")
    description: str = Field(default="", description="for people")
    epoch: Epoch
    start: Time("10 s", "of the navigation, after the first IMU sample", non_negative=True) = "0 s"
    end: Time("300 s", "of the navigation", positive=True) | None = None


class ReplayEarth(Block):
    """Orientation of the Earth; it matters to star trackers alone."""

    ut1_minus_utc: Quantity("s", "-0.58 s", "UT1-UTC (IERS)", at_least="-0.9 s", at_most="0.9 s") = "0 s"
    pole_x: Quantity("rad", "0.08 arcsec", "", at_least="-2 arcsec", at_most="2 arcsec") = "0 arcsec"
    pole_y: Quantity("rad", "0.41 arcsec", "", at_least="-2 arcsec", at_most="2 arcsec") = "0 arcsec"


Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
Names = tuple[str, str, str]
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
    height_error: Quantity("m", "10 m", "of that height, 1 sigma", positive=True) = "10 m"
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
        sides = [SIDES.index(axis[-1]) for axis in self.axes]
        if len(set(sides)) < 3:
            raise refuse(f"axes: {', '.join(self.axes)} name one axis twice; expected such as [x, -y, -z]")
        turns = 1 if sides in ([0, 1, 2], [1, 2, 0], [2, 0, 1]) else -1
        for axis in self.axes:
            turns *= -1 if axis[0] == "-" else 1
        if turns < 0:
            raise refuse(f"axes: {', '.join(self.axes)} are left-handed; expected such as [x, -y, -z]")
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


def form(key, models):
    """Type of a section in several forms, told apart by the word under `key`: {word: Block}."""

    def word(value):
        return value.get(key) if isinstance(value, dict) else getattr(value, key, None)

    def check(value: Any):
        if isinstance(value, dict) and word(value) not in models:
            got = f"{describe(word(value))} is not known" if key in value else "is missing"
            raise refuse(f"{key}: {got}; choose from: {', '.join(models)}{close(word(value), models)}")
        return value

    def choose(value: Any):
        return f"<{word(value) if word(value) in models else next(iter(models))}>"

    return Annotated[tagged(choose, models), BeforeValidator(check)]


class ReplayGnss(Block):
    """What is made of the fixes."""

    lever_arm: Vector("m", "0.3 m", "IMU to antenna, forward, right, down") = ("0 m", "0 m", "0 m")
    latency: Quantity("s", "0.2 s", "from the instant measured to the fix on board", non_negative=True) = (
        "0 s"
    )
    clock_offset: Quantity(
        "s", "0.35 s", "fixes are stamped so much later than they are, by the clock of the IMU", words=FIND
    ) = "0 s"
    every: Time("1 s", "take one fix in this time only", positive=True) | None = None
    first: Time("0.2 s", "the first of them", non_negative=True) = "0 s"
    fewest_satellites: Count("5", "with which a fix counts, where data.gnss.satellites says", at_least=0) = 4
    position_noise: Annotated[Vector("m", "5 m", "", positive=True) | None, NED] = None
    velocity_noise: Annotated[Vector("m/s", "0.1 m/s", "", positive=True) | None, NED] = None


class ReplayGyro(Gyro):
    """Gyro triad; what is not given is zero."""

    scale_factor_roll: Quantity("", "30 ppm", "of the forward axis", non_negative=True) = "0 ppm"
    scale_factor: Quantity("", "100 ppm", "of the others", non_negative=True) = "0 ppm"
    misalignment: Quantity("rad", "0.1 mrad", "each axis towards each other", non_negative=True) = "0 rad"
    g_sensitivity: Quantity("rad s/m", "0.5 deg/h/gee", "", non_negative=True) = "0 deg/h/gee"
    vibration_rectification: Quantity("rad s3/m2", "0.03 deg/h/gee2", "", non_negative=True) = "0 deg/h/gee2"
    range: Quantity("rad/s", "1000 deg/s", "", positive=True, words=UNLIMITED) = "unlimited"
    quantum: Quantity("rad", "0.1 arcsec", "", positive=True, words=OFF) = "off"


class ReplayAccelerometer(Accelerometer):
    """Accelerometer triad; what is not given is zero."""

    scale_factor: Quantity("", "300 ppm", "", non_negative=True) = "0 ppm"
    misalignment: Quantity("rad", "0.1 mrad", "", non_negative=True) = "0 rad"
    vibration_rectification: Quantity("s2/m", "20 ugee/gee2", "", non_negative=True) = "0 ugee/gee2"
    range: Quantity("m/s2", "20 gee", "", positive=True, words=UNLIMITED) = "unlimited"
    quantum: Quantity("m/s", "0.1 mm/s", "", positive=True, words=OFF) = "off"


class ReplayImu(Block):
    """What the filter assumes of the inertial sensors."""

    use: Use = Field(None, description=OF_IMU)
    gyro: ReplayGyro
    accelerometer: ReplayAccelerometer


Releases = section(settings.Releases)
RELEASE = section(settings.Release)(rejections=5, duration="4 s")


OF_DATA = tuple(state.name for state in STATES if state.of_data)


class ReplayNavigation(Navigation):
    """The filter; the defaults are for vehicles near the ground."""

    NAME: ClassVar[str] = "ReplayNavigation"

    states: Any = ()  # `states_field`
    gps: Literal["loose"] = Field(default="loose", description="by its fixes")
    stars: Literal["attitude"] = Field(default="attitude", description="there are no stars in these data")
    gate_probability: Number("1e-4", "of rejecting a good measurement", positive=True, at_most=0.1) = 1e-4
    star_fix_floor: Quantity("rad", "10 arcsec", "", non_negative=True) = "0 arcsec"
    release: Releases = Releases(gps=RELEASE, first_star_fix=RELEASE, star_fix=RELEASE)
    gps_agreement: Quantity("m/s", "10 m/s", "", positive=True) = "10 m/s"
    history: Quantity("s", "0.5 s", "", positive=True, at_most="5 s") = "0.6 s"
    thrust_threshold: Quantity("m/s2", "15 m/s2", "", positive=True) = "1000 gee"
    thrust_memory: Quantity("s", "30 s", "", positive=True) = "30 s"
    manoeuvre_angle: Quantity("rad", "1 rad", "", positive=True) = "1 rad"
    gravity_error: Quantity("m/s2", "30 ugee", "", non_negative=True) = "30 ugee"
    gravity_memory: Quantity("s", "50 s", "", positive=True) = "50 s"
    saturated_rate: Quantity("rad/s", "50 deg/s", "", positive=True) = "1 rad/s"
    saturated_acceleration: Quantity("m/s2", "5 gee", "", positive=True) = "5 gee"
    told: None = Field(
        default=None, description="here `imu` and `gnss` are what is told; nobody knows the truth"
    )
    samples_per_tick: Count("4", "samples of the IMU in a step of the filter", at_least=1, at_most=1000) = (
        SAMPLES_PER_TICK
    )

    @classmethod
    def states_field(cls, block):
        """Type and FieldInfo of `states`. block : Literal of the names of all blocks"""
        return list[block], Field(default=[], description="what is estimated besides the fifteen")


class ReplayRequirements(Block):
    """What is required of the solution."""

    position: PositionLimit = PositionLimit()
    velocity: VelocityLimit = VelocityLimit()
    attitude: AttitudeLimit = AttitudeLimit()
    integrity_risk: IntegrityRisk = "1e-5 /h"


class ReplayBase(Block):
    """External data and how to navigate with them."""

    NAME: ClassVar[str] = "ReplayScenario"
    EXAMPLE: ClassVar[str] = "csv_example.yaml"

    plugins: Plugins = Field(default=(), description=PLUGINS)
    mission: ReplayMission
    earth: ReplayEarth = ReplayEarth()
    data: Any  # `form` of `formats`
    gnss: ReplayGnss = ReplayGnss()
    alignment: form("method", ALIGNMENTS)
    imu: ReplayImu
    navigation: ReplayNavigation = ReplayNavigation()
    requirements: ReplayRequirements = ReplayRequirements()

    _source: str = PrivateAttr("")

    @property
    def source(self):
        """YAML text with `extends` and overrides in it."""
        return self._source

    def keep_text(self, source):
        """Remember where it came from."""
        self._source = source


def model(provided=()):
    """ReplayScenario with sections for each instrument. provided : by its plug-ins"""
    whole = aboard.complete(provided, ReplayBase, ReplayNavigation, core=OF_DATA)
    return _with_data(whole, tuple(formats(provided).items()))


@cache
def _with_data(whole, known):
    data = form("format", dict(known))
    how = {"__base__": whole, "__module__": __name__, "__doc__": whole.__doc__}
    return create_model(ReplayBase.NAME, **how, data=(data, ...))


ReplayScenario = model()
