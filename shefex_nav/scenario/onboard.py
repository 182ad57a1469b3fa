"""Sections of a scenario about the software that flies: star tracker and navigation filter.

Values are floats in SI and radians once loaded. What the filter assumes of the sensors is taken from their
sections unless it is told otherwise in `navigation`.
"""

from typing import Any, ClassVar, Literal

from pydantic import Field

from shefex_nav.instruments.instrument import Release as ReleaseSettings
from shefex_nav.onboard.startracker import settings as startracker
from shefex_nav.scenario.block import AUTOMATIC, Block, tagged
from shefex_nav.scenario.of_settings import section
from shefex_nav.scenario.quantity import Count, Number, Quantity, Vector
from shefex_nav.scenario.star_statistics import Model
from shefex_nav.scenario.told import Told

Release = section(ReleaseSettings)


class StarTracker(section(startracker.StarTracker)):
    """Star tracker software."""

    frames: Literal["rendered", "statistical"] = Field(
        "rendered",
        description="pictures are drawn and searched; or what would be found follows from statistics, "
        "which takes a tenth of the time",
    )
    model: Model | None = Field(
        None, description="file of `shefex-nav characterise` with the statistics, relative to this one"
    )


class SensorOverrides(Block):
    """What the filter assumes of the sensors; a value left out is taken from the section of the sensor."""

    gyro_bias: Quantity("rad/s", "0.5 deg/h", "initial uncertainty", positive=True) | None = None
    gyro_random_walk: (
        Quantity("rad/sqrt(s)", "0.02 deg/sqrt(h)", "angular random walk", positive=True) | None
    ) = None
    gyro_scale_factor_roll: Quantity("", "30 ppm", "initial uncertainty", positive=True) | None = None
    gyro_misalignment: Quantity("rad", "0.1 mrad", "initial uncertainty", positive=True) | None = None
    accelerometer_bias: Quantity("m/s2", "0.3 mgee", "initial uncertainty", positive=True) | None = None
    accelerometer_random_walk: (
        Quantity("m/s(3/2)", "0.03 m/s/sqrt(h)", "velocity random walk", positive=True) | None
    ) = None
    camera_mounting: Quantity("rad", "0.02 deg", "initial uncertainty", positive=True) | None = None
    lever_arm: Vector("m", "0.3 m", "IMU to GPS antenna in body axes") | None = None
    lever_arm_error: Quantity("m", "2 cm", "of the lever arm, each axis, if estimated", positive=True) = (
        "2 cm"
    )
    gps_latency_error: Quantity("s", "1 ms", "fixes are older than they say by so much", positive=True) = (
        "1 ms"
    )
    clock_bias: Quantity("m", "300 km", "of the GPS receiver, unknown at the start", positive=True) = "300 km"
    clock_drift: Quantity("m/s", "300 m/s", "unknown at the start: 1 ppm", positive=True) = "300 m/s"
    clock_white_frequency: (
        Quantity("m/sqrt(s)", "0.1 m/sqrt(s)", "noise of the clock", positive=True) | None
    ) = None
    clock_random_walk: Quantity("m/s(3/2)", "0.2 m/s/sqrt(s)", "of its frequency", positive=True) | None = (
        None
    )
    range_bias: Quantity("m", "3 m", "error of a range that lasts", positive=True) | None = None
    range_bias_time: Quantity("s", "300 s", "correlation time of it", positive=True) = "300 s"


class Releases(Block):
    """Release rules of the sensors."""

    gps: Release
    first_star_fix: Release
    star_fix: Release


def _states_form(value):
    return f"<{AUTOMATIC}>" if isinstance(value, str) else "<names>"


class Integrity(Block):
    """How faults of the sensors are noticed; how wrong the solution may be, `requirements` say."""

    wrong_star_fix: Quantity(
        "rad", "0.5 deg", "smallest error that makes a star fix wrong", positive=True
    ) = "0.5 deg"
    gps_jump: Release = Field(
        {"rejections": 30, "duration": "29 s"},
        validate_default=True,
        description="when a GPS position that contradicts the filter while its velocity does not is believed",
    )
    angular_acceleration: Quantity(
        "rad/s2", "20 deg/s2", "how fast the rate leaves a gyro reading that is held", positive=True
    ) = "20 deg/s2"
    thrust_change: Quantity(
        "m/s3", "3 gee/s", "how fast specific force leaves a reading that is held", positive=True
    ) = "3 gee/s"


class Navigation(Block):
    """Error-state Kalman filter: position, velocity, attitude, biases of the IMU, and blocks of choice."""

    NAME: ClassVar[str] = "Navigation"

    states: Any = AUTOMATIC  # `states_field`
    sensors: SensorOverrides = Field(
        default_factory=SensorOverrides, description="what the filter assumes of the sensors"
    )
    told: Told = Field(default_factory=Told, description=Told.HELP)
    gps: Literal["loose", "tight"] = Field(
        "loose", description="how GPS is used: its fixes, or the ranges of its channels (needs state clock)"
    )
    stars: Literal["attitude", "vectors"] = Field(
        "attitude",
        description="how stars are used: the attitude that they show together, or each by itself, one or two "
        "as well (needs star_tracker.identification.tracking)",
    )
    gate_probability: Number("1e-4", "of rejecting a good measurement", positive=True, at_most=0.1)
    star_fix_floor: Quantity("rad", "10 arcsec", "errors of a fix that it does not know", non_negative=True)
    release: Releases
    gps_agreement: Quantity(
        "m/s", "10 m/s", "difference allowed between two fixes, per second", positive=True
    )
    integrity: Integrity = Field(default_factory=Integrity, description="faults of the sensors")
    history: Quantity("s", "0.5 s", "how far back a measurement may lie", positive=True, at_most="5 s")
    thrust_threshold: Quantity("m/s2", "15 m/s2", "specific force above which a motor burns", positive=True)
    thrust_memory: Quantity(
        "s", "30 s", "for how long errors that go with thrust keep their sign", positive=True
    )
    manoeuvre_angle: Quantity("rad", "1 rad", "by which the roll axis is turned at a time", positive=True)
    gravity_error: Quantity("m/s2", "30 ugee", "what gravity with J2 leaves out", non_negative=True)
    gravity_memory: Quantity(
        "s", "50 s", "how long that acts before GPS corrects for it, where it is no state", positive=True
    )
    saturated_rate: Quantity("rad/s", "50 deg/s", "gyro error at the end of its range", positive=True)
    saturated_acceleration: Quantity("m/s2", "5 gee", "accelerometer error likewise", positive=True)

    @classmethod
    def states_field(cls, block):
        """Type and FieldInfo of `states`. block : Literal of the names of all blocks"""
        return tagged(_states_form, {AUTOMATIC: Literal["automatic"], "names": list[block]}), Field(
            default=AUTOMATIC,
            description="what is estimated besides: errors of the sensors, each a block of states; "
            "automatic: those that swamp the noise of the sensors in the planned flight",
        )


class FrameLog(Block):
    """Which pictures of the star camera are kept."""

    full_every: Count("100", "every n-th frame in full; 0 = never", non_negative=True)
    otherwise: Literal["thresholded", "none"] = Field(
        description="the other frames: with the sky background set to zero, or not at all"
    )
    threshold_sigma: Number("4", "what counts as sky background", positive=True)


class Log(Block):
    """What is logged."""

    rate: Quantity("Hz", "100 Hz", "of truth, IMU and solution: 10, 20, 50 or 100 Hz", positive=True) = (
        "100 Hz"
    )
    frames: FrameLog
