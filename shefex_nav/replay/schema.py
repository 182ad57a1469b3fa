"""The replay scenario: a small YAML that says what data of others are and what the filter assumes of them.

Values carry their units as in missions, and `imu:`, `navigation:` and the alignment have the names that
missions use. Once loaded, a quantity is a float in SI and radians. Times count from the first IMU sample.
"""

from functools import cache
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, PrivateAttr, create_model

from shefex_nav.clock import SAMPLES_PER_TICK
from shefex_nav.onboard.navigation import settings
from shefex_nav.onboard.navigation.blocks import STATES
from shefex_nav.replay.schema_data import formats
from shefex_nav.scenario import aboard
from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.messages import close
from shefex_nav.scenario.mission import LONGEST_NAME, Epoch
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.onboard import Navigation
from shefex_nav.scenario.plugged import PLUGINS, Plugins
from shefex_nav.scenario.quantity import (
    Count,
    Number,
    Quantity,
    Time,
    Vector,
    describe,
    refuse,
)
from shefex_nav.scenario.requirements import ReplayRequirements
from shefex_nav.scenario.sensors import OF_IMU, Accelerometer, Gyro, Use, Vibration
from shefex_nav.world.settings import NOT_KNOWN, OFF, UNLIMITED

NED = Field(description="noise, 1 sigma, north, east, down; takes the place of what the file says")
FIND = (("find", float("inf")),)


class FromReference(Block):
    """Position, velocity and attitude are those of the truth, and known as well as is said here (1 sigma)."""

    method: Literal["reference"]
    level: Quantity("rad", "1 deg", "about north and about east", positive=True, at_most="20 deg")
    azimuth: Quantity("rad", "2 deg", "about the vertical", positive=True, at_most="180 deg")
    position: Quantity("m", "5 m", "each axis", positive=True, at_most="10000 km")
    velocity: Quantity("m/s", "0.1 m/s", "each axis", positive=True)


class Static(Block):
    """The vehicle stands still at first: level by the accelerometers, heading by the gyros or as given."""

    method: Literal["static"]
    duration: Time("30 s", "for which it stands still, from mission.start", at_least="1 s", at_most="24 h")
    heading: (
        Quantity(
            "rad",
            "85 deg",
            "of the forward axis; without it the gyros look for north",
            words=NOT_KNOWN,
            at_least="-360 deg",
            at_most="360 deg",
        )
        | None
    ) = None
    azimuth: (
        Quantity("rad", "1 deg", "how well the heading is known, 1 sigma", positive=True, at_most="180 deg")
        | None
    ) = None
    disturbance: Quantity(
        "rad", "0.02 deg", "swaying of the vehicle, 1 sigma", positive=True, at_most="180 deg"
    ) = "0.01 deg"
    velocity: Quantity("m/s", "0.01 m/s", "what is left of standing still, 1 sigma", positive=True) = (
        "0.01 m/s"
    )
    gyro_bias: Literal["as_stated", "at_rest"] = Field(
        default="as_stated",
        description="known as imu.gyro.bias says, or from the mean rate at rest; this needs a heading",
    )


class Rail(Block):
    """A rocket stands on its rail at first: it points as the rail does, gravity shows its roll if it can."""

    method: Literal["rail"]
    duration: Time("30 s", "for which it stands still, from mission.start", at_least="0.2 s", at_most="24 h")
    elevation: Quantity("rad", "84 deg", "of the rail", at_least="20 deg", at_most="90 deg")
    elevation_error: Quantity("rad", "0.5 deg", "1 sigma", positive=True, at_most="180 deg")
    azimuth: Quantity(
        "rad",
        "135 deg",
        "to which the rail leans, from north over east",
        at_least="-360 deg",
        at_most="360 deg",
    )
    azimuth_error: Quantity("rad", "2 deg", "1 sigma", positive=True, at_most="180 deg")
    disturbance: Quantity(
        "rad", "0.02 deg", "swaying of the rocket, 1 sigma", positive=True, at_most="180 deg"
    ) = "0.05 deg"
    velocity: Quantity("m/s", "0.01 m/s", "what is left of standing still, 1 sigma", positive=True) = (
        "0.01 m/s"
    )


class Course(Block):
    """The vehicle moves: it points where it goes over the ground, level by the specific force."""

    method: Literal["course"]
    speed: Quantity("m/s", "5 m/s", "over the ground, from which on the course is taken", positive=True) = (
        "3 m/s"
    )
    sideslip: Quantity(
        "rad", "5 deg", "between its heading and its course, 1 sigma", positive=True, at_most="180 deg"
    ) = "3 deg"


ALIGNMENTS = {"reference": FromReference, "static": Static, "rail": Rail, "course": Course}


class ReplayMission(Block):
    """What is replayed, and when."""

    name: str = Field(
        min_length=1,
        max_length=LONGEST_NAME,
        pattern=r"^[\w.-]+$",
        description="one word, for tables and logs",
    )
    description: str = Field(default="", description="for people")
    epoch: Epoch
    start: Time("10 s", "of the navigation, after the first IMU sample", non_negative=True) = "0 s"
    end: Time("300 s", "of the navigation", positive=True) | None = None


class ReplayEarth(Block):
    """Orientation of the Earth; it matters to star trackers alone."""

    ut1_minus_utc: Quantity("s", "-0.58 s", "UT1-UTC (IERS)", at_least="-0.9 s", at_most="0.9 s") = "0 s"
    pole_x: Quantity("rad", "0.08 arcsec", "", at_least="-2 arcsec", at_most="2 arcsec") = "0 arcsec"
    pole_y: Quantity("rad", "0.41 arcsec", "", at_least="-2 arcsec", at_most="2 arcsec") = "0 arcsec"


def form(key, models):
    """Type of a section in several forms, told apart by the word under `key`: {word: Block}."""

    def word(value):
        found = value.get(key) if isinstance(value, dict) else getattr(value, key, None)
        return found if isinstance(found, str) else ""

    def check(value: Any):
        if isinstance(value, dict) and word(value) not in models:
            got = f"{describe(value[key])} is not known" if key in value else "is missing"
            raise refuse(f"{key}: {got}; choose from: {', '.join(models)}{close(word(value), models)}")
        return value

    def choose(value: Any):
        return f"<{word(value) if word(value) in models else next(iter(models))}>"

    return Annotated[tagged(choose, models), BeforeValidator(check)]


class ReplayGnss(Block):
    """What is made of the fixes."""

    lever_arm: Vector(
        "m", "0.3 m", "IMU to antenna, forward, right, down", at_least="-1 km", at_most="1 km"
    ) = ("0 m", "0 m", "0 m")
    latency: Quantity(
        "s", "0.2 s", "from the instant measured to the fix on board", non_negative=True, at_most="10 s"
    ) = "0 s"
    clock_offset: Quantity(
        "s", "0.35 s", "fixes are stamped so much later than they are, by the clock of the IMU", words=FIND
    ) = "0 s"
    every: Time("1 s", "take one fix in this time only", positive=True) | None = None
    first: Time("0.2 s", "the first of them", non_negative=True) = "0 s"
    fewest_satellites: Count("5", "with which a fix counts, where data.gnss.satellites says", at_least=0) = 4
    position_noise: Annotated[Vector("m", "5 m", "", positive=True, at_most="10000 km") | None, NED] = None
    velocity_noise: Annotated[Vector("m/s", "0.1 m/s", "", positive=True) | None, NED] = None
    lasting_share: Quantity(
        "", "50 %", "of the variance of positions, of errors that last", non_negative=True, at_most="100 %"
    ) = "0 %"
    lasting_time: Quantity("s", "300 s", "correlation time of them", positive=True) = "300 s"


class ReplayGyro(Gyro):
    """Gyro triad; what is not given is zero."""

    scale_factor_roll: Quantity("", "30 ppm", "of the forward axis", non_negative=True, at_most="100 %") = (
        "0 ppm"
    )
    scale_factor: Quantity("", "100 ppm", "of the others", non_negative=True, at_most="100 %") = "0 ppm"
    misalignment: Quantity(
        "rad", "0.1 mrad", "each axis towards each other", non_negative=True, at_most="1 rad"
    ) = "0 rad"
    g_sensitivity: Quantity("rad s/m", "0.5 deg/h/gee", "", non_negative=True) = "0 deg/h/gee"
    vibration_rectification: Quantity("rad s3/m2", "0.03 deg/h/gee2", "", non_negative=True) = "0 deg/h/gee2"
    range: Quantity("rad/s", "1000 deg/s", "", positive=True, words=UNLIMITED) = "unlimited"
    quantum: Quantity("rad", "0.1 arcsec", "", positive=True, words=OFF) = "off"


class ReplayAccelerometer(Accelerometer):
    """Accelerometer triad; what is not given is zero."""

    scale_factor: Quantity("", "300 ppm", "", non_negative=True, at_most="100 %") = "0 ppm"
    misalignment: Quantity("rad", "0.1 mrad", "", non_negative=True, at_most="1 rad") = "0 rad"
    vibration_rectification: Quantity("s2/m", "20 ugee/gee2", "", non_negative=True) = "0 ugee/gee2"
    range: Quantity("m/s2", "20 gee", "", positive=True, words=UNLIMITED) = "unlimited"
    quantum: Quantity("m/s", "0.1 mm/s", "", positive=True, words=OFF) = "off"


class ReplayVibration(Vibration):
    """Vibration at the IMU; of several motors the strongest counts in every burn."""

    boost: list[Quantity("m/s2", "7 gee", "while a motor burns", non_negative=True)] = []  # noqa: RUF012
    coast: Quantity("m/s2", "0.02 gee", "at all other times", non_negative=True) = "0 gee"
    angular: Quantity("rad s/m", "0.1 deg/s/gee", "rms rate per rms acceleration", non_negative=True) = (
        "0 deg/s/gee"
    )
    lowest_frequency: Quantity("Hz", "20 Hz", "lower end of the flat spectrum", positive=True) = "20 Hz"
    highest_frequency: Quantity("Hz", "2 kHz", "upper end of the flat spectrum", positive=True) = "2 kHz"


class ReplayImu(Block):
    """What the filter assumes of the inertial sensors."""

    use: Use = Field(None, description=OF_IMU)
    gyro: ReplayGyro
    accelerometer: ReplayAccelerometer
    vibration: ReplayVibration = ReplayVibration()


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
    star_fix_floor: Quantity("rad", "10 arcsec", "", non_negative=True, at_most="180 deg") = "0 arcsec"
    release: Releases = Releases(gps=RELEASE, first_star_fix=RELEASE, star_fix=RELEASE)
    gps_agreement: Quantity("m/s", "10 m/s", "", positive=True) = "10 m/s"
    history: Quantity("s", "0.5 s", "", positive=True, at_most="5 s") = "0.6 s"
    thrust_threshold: Quantity("m/s2", "15 m/s2", "", positive=True) = "15 m/s2"
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


def __getattr__(name):
    """A model by its qualified name, as pickle asks for it in another process."""
    return aboard.made(__name__, name)


ReplayScenario = model()
