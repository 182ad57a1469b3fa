"""Every section of a scenario file, in the order of a mission; `load` makes a Scenario of them.

The models check single values; `checks` compares values with each other, `params` turns sections into the
parameters of the stages. Once loaded, a quantity is a float in SI and radians.
"""

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo
from pydantic_core import PydanticKnownError

from shefex_nav.environment.models import BUILT_IN
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.dispersions import Campaign, Dispersions
from shefex_nav.scenario.mission import Atmosphere, Earth, Ground, Launch, Mission, Orbit, Programme, Wind
from shefex_nav.scenario.onboard import Computer, Log, Navigation, StarTracker
from shefex_nav.scenario.plugged import PLUGINS, Plugins
from shefex_nav.scenario.requirements import Requirements
from shefex_nav.scenario.sensors import Faults, Gps, Imu, PadAlignment, StarCamera
from shefex_nav.scenario.trajectory import Trajectory
from shefex_nav.scenario.vehicle import Vehicle
from shefex_nav.world import absent


def _unless_given(value: Any, info: ValidationInfo):
    """What is needed to fly a vehicle, which one that flies along a trajectory is not."""
    given = info.data or {}
    if value is None and "trajectory" in given and given["trajectory"] is None:
        raise PydanticKnownError("missing")
    return value


NEEDED = BeforeValidator(_unless_given)


class Sections(Block):
    """A mission to simulate; it starts from one of launch, orbit and ground, or follows a trajectory."""

    NAME: ClassVar[str] = "Scenario"
    EXAMPLE: ClassVar[str] = "shefex2_andoya.yaml"
    NEEDED_UNLESS: ClassVar[dict] = {"vehicle": "trajectory", "programme": "trajectory"}
    MODELS: ClassVar[dict] = BUILT_IN  # that gravity, air and wind are chosen from: class -> by name

    plugins: Plugins = Field(default=(), description=PLUGINS)
    mission: Mission
    earth: Earth
    atmosphere: Atmosphere = Field(default_factory=Atmosphere)
    wind: Wind = Field(default="none", description="wind over the height, or 'none'")
    launch: Launch | None = None
    orbit: Orbit | None = None
    ground: Ground | None = None
    trajectory: Trajectory | None = Field(default=None, description="a file of others along which it flies")
    vehicle: Annotated[Vehicle | None, NEEDED] = Field(
        default=None, description="needed unless there is a trajectory"
    )
    attitude: Literal["flown", "prescribed"] = Field(
        default="flown", description="by the cold-gas system, or exactly as the programme says"
    )
    programme: Annotated[Programme | None, NEEDED] = Field(
        default=None, description="tasks of the attitude control, by name; may be {}; not with a trajectory"
    )
    imu: Imu
    gps: Gps
    pad_alignment: PadAlignment
    star_camera: StarCamera
    star_tracker: StarTracker
    navigation: Navigation
    computer: Computer = Field(default_factory=Computer, description="what runs both")
    log: Log
    faults: Faults = Field(default_factory=Faults, description="what goes wrong with the sensors")
    without: tuple[Literal[absent.NAMES], ...] = Field(
        default=(),
        description="errors of the sensors that do not happen, although all on board counts with them as if "
        "they did; `budget` finds out by it what each of them does",
    )
    requirements: Requirements = Field(
        default_factory=Requirements, description="what a run has to achieve; a campaign counts how often"
    )

    campaign: Campaign = Field(default_factory=Campaign, description="how runs of a campaign are made")
    dispersions: Dispersions = Field(
        default_factory=dict, description="what differs from run to run: path of a field, and how it is drawn"
    )

    _source: Any = PrivateAttr("")
    _files: tuple[tuple[str, str], ...] = PrivateAttr(())
    _dropped: tuple = PrivateAttr(())
    _line: Any = PrivateAttr(None)
    _place: Any = PrivateAttr(None)

    def __eq__(self, other):
        """Whether another scenario holds the same values, wherever they were written."""
        return type(other) is type(self) and other.__dict__ == self.__dict__

    def __hash__(self):
        return hash(self.mission.name)

    def __repr__(self):
        file = self.files[0][0] if self.files else ""
        return f"<Scenario {self.mission.name}{file and f', from {file}'}>"

    __str__ = __repr__

    def model_copy(self, *, update=None, deep=False):
        """The same scenario; TypeError with an `update`, of which its text and the log would know nothing."""
        if update:
            raise TypeError(
                "a scenario is changed where it is loaded, so that its text says so too: "
                "Scenario.load(path, {'imu.gyro.random_walk': '0.09 deg/sqrt(h)'})"
            )
        return super().model_copy(deep=deep)

    def copy(self, **wanted):
        """As `model_copy`, which has taken its place in pydantic."""
        return self.model_copy(**wanted)

    @property
    def source(self):
        """YAML text with `extends`, overrides and tables in it; it loads to the same scenario."""
        if callable(self._source):
            self._source = self._source()
        return self._source

    @property
    def files(self):
        """(name, text) of each file it was read from, as it was written; the file itself first."""
        return self._files

    @property
    def dropped(self):
        """overriding.Gone of what the file puts on top of instruments that others took the place of."""
        return self._dropped

    @property
    def tasks(self):
        """(name, task) of the programme in order of time."""
        return sorted((self.programme or {}).items(), key=lambda item: item[1].start)

    def keep_text(self, source, files):
        """Remember where the scenario came from; `source` is its text, or a function that gives it."""
        self._source, self._files = source, tuple(files.items())

    def keep_dropped(self, dropped):
        """Remember what is gone; `dropped` : as the property."""
        self._dropped = tuple(dropped)

    def keep_places(self, line, place):
        """Remember where its values were written.

        line, place : functions of the path of a field and words, and of a path alone, that give text
        """
        self._line, self._place = line, place

    def place(self, field):
        """`file:line:col` of a field, given as a path; "" if none is known."""
        return "" if self._place is None else self._place(field)

    def line_about(self, field, words):
        """`file:line:col: field: words` about a field, given as a path; without a place if none is known."""
        return f"{'.'.join(map(str, field))}: {words}" if self._line is None else self._line(field, words)
