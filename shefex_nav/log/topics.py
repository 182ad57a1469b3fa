"""The table of the log: which record goes to which topic, under which schema, how often.

Every message is protobuf. Where Foxglove has a schema that viewers draw, the record also goes there
(`log.drawings`); its full content goes to a schema of our own, package `shefex`, whose fields are those that
the record's annotations tell (`shefex_nav.fields`). New fields go to the end of their record, with a default:
an older log, which lacks them, is read with the default.

Rates are those of a log in full; `log.thinning` says which of them a scenario may lower.

`timestamp_ns` is UTC since 1970: epoch of the scenario (t = 0) plus the time of the record, which is also
its log time: `t_s`, or for a measurement `t_valid_s`, so that what belongs together stands together.
"""

import math
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.fields import (
    T_AVAILABLE,
    T_S,
    T_VALID,
    Topic,
    field,
    fields_of,
    integer,
    matrix,
    number,
    vector,
)
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.instruments import TABLE
from shefex_nav.records import (
    Alignment,
    CameraCommand,
    ControlSample,
    Event,
    Frame,
    FrameTruth,
    GateResult,
    GpsFix,
    GpsRanges,
    ImuBlock,
    NavCovariance,
    NavHealth,
    NavSolution,
    StarFix,
    TruthSample,
)

FORMAT = "3"  # of this table; a reader refuses others
METADATA = "shefex_nav"  # name of the metadata record
ATTACHMENT = "scenario.yaml"
SMOOTHED = "{} (smoothed)"  # of the scenario's name, so that nobody takes such a log for that of the flight
FAILED = "software_failed"  # name of the Event that ends the log of a flight whose software failed


class LogError(UserError):
    """A log cannot be written or read; the message says why and is for people."""


class LogExists(LogError):
    """A log would be overwritten, and nobody has said that it may be."""


def check_folder(path):
    """LogError where there is no folder for a log of this path. Path"""
    if not path.parent.is_dir():
        raise LogError(f"{path}: cannot be written: no folder {path.parent}")


class Mission(NamedTuple):
    """What one run is, and what a reader of its log must know to make sense of it."""

    scenario: str  # name
    scenario_text: str  # YAML
    seed: int
    version: str
    epoch_utc: str  # ISO 8601, t = 0
    start_s: number("s", "mission time of the first record")  # mission time at which the simulation starts
    earth: EarthRotation
    # geodetic, below the vehicle at the start; origin of the launch axes
    launch_latitude: number("rad", "of the origin of the launch axes, geodetic")
    launch_longitude: number("rad", "likewise")
    launch_height: number("m", "likewise, above the ellipsoid")  # where it stands; 0 below an orbit
    camera: Pinhole  # as the on-board computer knows it
    C_bc: matrix("", "nominal mounting, camera to body axes")
    sun_i: vector("", "direction of the Sun from the Earth at t = 0 without aberration, inertial axes") = (
        np.full(3, np.nan)
    )
    sun_exclusion: number("rad", "that the camera must keep from the Sun") = math.nan
    limb_exclusion: number("rad", "that it must keep from the Earth's limb") = math.nan
    plugins: tuple = ()  # of (file or name of a package, SHA-256 of its source)
    software: tuple = ()  # of a user's own on board: (section of the scenario, name, SHA-256)
    distortion: tuple = ()  # (k1, k2, p1, p2, k3) of the camera, `geometry.distortion`; (): a pinhole


class RunSummary(NamedTuple):
    """How long the run took."""

    t_s: float  # mission time at the end
    wall_s: float  # the mission, without setting up
    setup_s: float  # catalogue, compilation, trajectory
    until_s: float = math.nan  # where looking was ended before the mission did; NaN: it was seen to its end


class Timing(NamedTuple):
    """Content of the one topic that differs between two equal runs."""

    t_s: T_S
    frame_number: integer("star camera frame; -1 in the closing message")
    chain_s: number("s", "star tracker chain of that frame")
    wall_s: number("s", "closing message: the whole mission")  # NaN but in the closing message
    setup_s: number("s", "closing message: setting up")
    until_s: number(
        "s", "closing message: mission time at which looking ended before the mission did; or NaN"
    ) = math.nan


def timing(record):
    """Timing of a records.ComputeTime or of the RunSummary."""
    if isinstance(record, RunSummary):
        return Timing(record.t_s, -1, math.nan, record.wall_s, record.setup_s, record.until_s)
    return Timing(*record, math.nan, math.nan)


def _topic(record, topic, schema, rate_hz, time, comment):
    return Topic(record, topic, schema, rate_hz, time, comment, fields_of(record))


OWN = (
    _topic(TruthSample, "/truth/state", "Truth", 100, "t_s", "What happens, at every tick."),
    _topic(
        ControlSample,
        "/truth/attitude_control",
        "AttitudeControl",
        10,
        "t_s",
        "The cold-gas system, while it steers.",
    ),
    _topic(ImuBlock, "/imu", "ImuBlock", 100, "t_valid_s", "The IMU samples of a tick, oldest first."),
    _topic(GpsFix, "/gps/fix", "GpsFix", 1, "t_valid_s", "Position and velocity of the GPS antenna a."),
    _topic(GpsRanges, "/gps/ranges", "GpsRanges", 1, "t_valid_s", "What the channels of the receiver say."),
    _topic(Alignment, "/nav/alignment", "Alignment", None, "t_valid_s", "What the navigation starts from."),
    _topic(NavSolution, "/nav/solution", "NavSolution", 100, "t_s", "The navigation's output."),
    _topic(NavCovariance, "/nav/covariance", "NavCovariance", 10, "t_s", "Covariance, calibration states."),
    _topic(GateResult, "/nav/gates", "Gate", None, "t_s", "Fate of one measurement in the filter."),
    _topic(NavHealth, "/nav/health", "NavHealth", None, "t_s", "What the navigation thinks of a sensor."),
    _topic(Frame, "/star_tracker/frame", "FrameInfo", 10, "t_valid_s", "One picture, without its pixels."),
    _topic(StarFix, "/star_tracker/fix", "StarFix", 10, "t_valid_s", "What came out of one frame."),
    _topic(CameraCommand, "/star_tracker/command", "CameraCommand", 10, "t_s", "Asked of the camera next."),
    _topic(FrameTruth, "/truth/frame", "FrameTruth", 10, "t_valid_s", "What the camera really looked at."),
    _topic(Event, "/events", "Event", None, "t_s", "Something that happened in the mission."),
    _topic(Timing, "/timing", "ComputeTime", None, "t_s", "Measured durations; differ from run to run."),
    _topic(Mission, "/mission", "Mission", None, "start_s", "Constants of this run."),
)


def topics():
    """The whole table: that of the program, and a topic for each instrument that is known now."""
    return (*OWN, *(_of_instrument(one) for one in TABLE.values()))


def of_record(record):
    """Topic of a type of record."""
    return next(topic for topic in topics() if topic.record is record)


@cache
def _of_instrument(one):
    """Topic of the readings of an Instrument: names carry the unit, comments too."""
    times = field("t_valid_s", T_VALID), field("t_available_s", T_AVAILABLE)
    schema = "".join(part.title() for part in one.name.split("_"))
    comment = (one.record.__doc__ or "").strip().partition("\n")[0]
    return Topic(
        one.record, f"/{one.name}", schema, None, "t_valid_s", comment, times + fields_of(one.record)
    )


def epoch_ns(epoch_utc):
    """Nanoseconds since 1970 of an ISO 8601 instant; UTC when it names no zone."""
    instant = datetime.fromisoformat(epoch_utc)
    if instant.tzinfo is None:
        instant = instant.replace(tzinfo=UTC)
    return (instant - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


def log_time_ns(epoch, t_s):
    """Log time of mission times t_s, `epoch` in nanoseconds since 1970. int, (n,) -> (n,) int64."""
    return epoch + np.rint(t_s * 1e9).astype(np.int64)
