"""Section `trajectory` of a scenario: a file of others along which the vehicle flies.

The formats are told apart by the word under `format`. Columns of a CSV are described as in replay scenarios;
exports of other programs have their columns by name. Once the file has been seen, the section has its
content (SHA-256): a log tells which one was flown, and another one is refused.
"""

import hashlib
import os
from typing import Annotated, Literal

from pydantic import Field, model_validator

from shefex_nav.files import opened
from shefex_nav.scenario.block import Block, forms, kinds
from shefex_nav.scenario.columns import SIDES, Axis, Names, Unit, check_right_handed, named_twice
from shefex_nav.scenario.quantity import Quantity, Time

SECTION, FILE, HASH = "trajectory", "file", "sha256"
ATTITUDE, AEM = "attitude", "aem"
FRAMES = ("ned", "enu", "launch_enu", "ecef", "inertial")
LEVEL = "ned, enu: at the vehicle; launch_enu: at the origin; ecef: relative to the Earth; inertial: GCRS"
Frame = Literal[FRAMES]
Sha256 = Annotated[
    str | None,
    Field(pattern=r"^[0-9a-f]{64}$", description="of the file; another content is refused"),
]


class Origin(Block):
    """Where the coordinates of the file are zero."""

    latitude: Quantity("rad", "67.89 deg", "geodetic, WGS 84", at_least="-90 deg", at_most="90 deg")
    longitude: Quantity("rad", "21.10 deg", "east of Greenwich", at_least="-180 deg", at_most="360 deg")
    height: Quantity("m", "360 m", "above the ellipsoid", at_least="-500 m", at_most="9 km") = "0 m"


class _InTheFile(Block):
    axes: tuple[Axis, Axis, Axis] = Field(
        default=SIDES, description="axes of the file's body that point forward, right and down"
    )

    @model_validator(mode="after")
    def _right_handed(self):
        check_right_handed(self.axes)
        return self


class QuaternionColumns(_InTheFile):
    """Attitude in four columns."""

    quaternion: tuple[str, str, str, str] = Field(description="columns of w, x, y, z: the scalar first")
    sense: Literal["body_to_frame", "frame_to_body"] = Field(
        description="body_to_frame: it turns components in the body into those in the frame"
    )
    frame: Frame = Field(description=LEVEL)


class EulerColumns(_InTheFile):
    """Attitude in three columns."""

    euler: Names = Field(description="columns of roll, pitch and heading, of forward, right and down")
    angle_unit: Unit("deg", "rad") = Field(default="deg", description="of these angles")
    frame: Literal["ned"] = Field(default="ned", description="level at the vehicle")


class AemFile(_InTheFile):
    """Attitude in a file of its own."""

    aem: str = Field(min_length=1, description="CCSDS AEM, KVN, quaternions; relative to this file")
    sha256: Sha256 = None


class AlongVelocity(Block):
    """Attitude that the file does not have: forward along the velocity relative to the Earth."""

    along: Literal["velocity"] = Field(description="where forward points; at rest, where it moves first")
    roll_rate: Quantity("rad/s", "2 Hz", "about forward, since it moves", turns=True) = "0 deg/s"


Columns = forms(("along", AlongVelocity), quaternion=QuaternionColumns, euler=EulerColumns, aem=AemFile)


class TrajectoryBase(Block):
    """What all formats have."""

    file: str = Field(min_length=1, description="relative to this file")
    sha256: Sha256 = None
    pad: Time(
        "60 s",
        "it stands at its first place for so long before its first row",
        non_negative=True,
        at_most="24 h",
    ) = "0 s"
    separations: list[Time("65 s", "", non_negative=True)] = Field(
        default=[], description="when stages are left behind: from each on the next of vibration.boost holds"
    )


class Timed(TrajectoryBase):
    lift_off: Quantity("s", "12.5 s", "time of the file at which the mission time is zero") = "0 s"


class Csv(Timed):
    """A CSV whose columns are named here."""

    format: Literal["csv"]
    time: str = Field(description="column of the time")
    time_unit: Unit("s", "s") = "s"
    position: Names = Field(description="columns: latitude, longitude, height, or x, y, z; east, north, up")
    position_frame: Literal["geodetic", "ecef", "launch_enu", "inertial"] = Field(
        description="launch_enu: from the origin along its east, north, up; inertial: GCRS"
    )
    position_unit: Unit("m", "m") = Field(default="m", description="of lengths")
    angle_unit: Unit("deg", "rad") = Field(default="deg", description="of latitude and longitude")
    velocity: Names | None = Field(default=None, description="columns; else by the positions")
    velocity_frame: Frame | None = Field(default=None, description=LEVEL)
    velocity_unit: Unit("m/s", "m/s") = "m/s"
    acceleration: Names | None = Field(default=None, description="columns of the change of these velocities")
    acceleration_unit: Unit("m/s2", "m/s2") = "m/s2"
    origin: Origin | None = Field(default=None, description="needed by launch_enu")
    attitude: Columns = Field(description="in which columns it is, or how it is made")


class Rocketpy(Timed):
    """An export of RocketPy: x, y, z, vx, vy, vz and e0 to e3."""

    format: Literal["rocketpy"]
    origin: Origin = Field(description="the place of the launch, at the height where the file's Z is zero")
    attitude: AlongVelocity | None = Field(default=None, description="else that of the file, e0 to e3")


class Openrocket(Timed):
    """A CSV of OpenRocket: time, altitude, positions east and north of launch."""

    format: Literal["openrocket"]
    origin: Origin = Field(description="the place of the launch")
    attitude: AlongVelocity = Field(description="the file has none")


class Rasaero(Timed):
    """A CSV of RASAero II: time, altitude, distance, Vel-V and Vel-H."""

    format: Literal["rasaero"]
    origin: Origin = Field(description="the place of the launch")
    azimuth: Quantity("rad", "352 deg", "in which it flies", at_least="-360 deg", at_most="360 deg")
    attitude: AlongVelocity = Field(description="the file has none")


class Oem(TrajectoryBase):
    """A CCSDS OEM (KVN), in EME2000, ICRF, GCRF, ITRF or TEME."""

    format: Literal["oem"]
    attitude: forms(("along", AlongVelocity), aem=AemFile) = Field(
        description="a file of its own, or how it is made"
    )


class Log(TrajectoryBase):
    """A log of this program: its truth, with its phases and events."""

    format: Literal["log"]


KINDS = (Csv, Rocketpy, Openrocket, Rasaero, Oem, Log)
Trajectory = kinds("format", *KINDS)


def relative_to(tree, folder):
    """Let the files that a scenario's own `tree` names be looked for in `folder`."""
    for section, key, _ in _named(tree):
        section[key] = os.path.join(folder, section[key])


def pin(tree, places):
    """Look at the files of a tree; they stand there with their content then. -> list of (Mark, text)"""
    found = []
    for section, key, path in _named(tree):
        if section.get(HASH) is not None:
            continue
        try:
            section[HASH] = content(section[key])
            section[key] = os.path.abspath(section[key])
        except OSError as error:
            words = "there is no such file" if isinstance(error, FileNotFoundError) else error.strerror
            found.append(places.wrong(path, f"'{section[key]}' {words}"))
    return found


def content(path):
    """SHA-256 of a file; OSError."""
    with opened(path) as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _named(tree):
    """(section, key, path of it) of each file that is named."""
    section = tree.get(SECTION)
    if not isinstance(section, dict):
        return
    attitude = section.get(ATTITUDE)
    for part, key, path in ((section, FILE, (SECTION, FILE)), (attitude, AEM, (SECTION, ATTITUDE, AEM))):
        if isinstance(part, dict) and isinstance(part.get(key), str) and part[key]:
            yield part, key, path


def contradictions(scenario):
    """(path of the field, text for people) of what does not go together."""
    given = scenario.trajectory
    if given is None:
        return
    hint = "null takes away what an extended file gives"
    for name in ("vehicle", "programme"):
        if getattr(scenario, name) is not None and (name == "vehicle" or scenario.programme):
            yield (name,), f"a flight along a trajectory does not use it; {hint}"
    if scenario.attitude != "flown":
        yield ("attitude",), f"the attitude is that of the trajectory; {hint}"
    if scenario.wind != "none":
        yield ("wind",), f"the wind has done its work on the trajectory already; {hint}"
    for before, (k, at) in zip(given.separations, enumerate(given.separations[1:], 1), strict=False):
        if at <= before:
            yield (SECTION, "separations", k), f"times must increase: {at:g} s follows {before:g} s"
    if isinstance(given, Csv):
        yield from _csv(given)
        yield from _columns_once(given)


def _columns_once(given):
    """A column of a file for each quantity of it."""
    columns = {
        (SECTION, key): getattr(given, key) for key in ("time", "position", "velocity", "acceleration")
    }
    for key in ("quaternion", "euler"):
        columns[SECTION, ATTITUDE, key] = getattr(given.attitude, key, None)
    yield from named_twice(columns)


def _csv(given):
    if given.origin is None:
        for key in ("position_frame", "velocity_frame"):
            if getattr(given, key) == "launch_enu":
                words = "is missing; launch_enu needs it, for example "
                yield (SECTION, "origin"), f"{words}'origin: {{latitude: 67.89 deg, longitude: 21.1 deg}}'"
                return
        if getattr(given.attitude, "frame", None) == "launch_enu":
            yield (SECTION, "origin"), "is missing; the frame launch_enu of the attitude needs it"
    if given.velocity is not None and given.velocity_frame is None:
        yield (SECTION, "velocity_frame"), f"is missing; choose from: {', '.join(FRAMES)}"
    if given.acceleration is not None and given.velocity is None:
        yield (SECTION, "acceleration"), "is the change of the velocity, which is not given"
    elif given.acceleration is not None and given.velocity_frame in ("ned", "enu"):
        words = "in axes that turn with the place of the vehicle it is not the change of the velocity"
        yield (SECTION, "acceleration"), f"{words}; leave it out, or give both in another frame"
