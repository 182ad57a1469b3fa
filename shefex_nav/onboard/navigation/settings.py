"""Settings of the navigation filter, section `navigation` of a scenario.

`states` and `told` are of the scenario alone (`scenario.onboard`): which blocks there are, and what of the
sensors may be told, depends on what is aboard.
"""

from typing import Literal

from shefex_nav.settings import Settings, choice, count, number, quantity, section


class SensorOverrides(Settings):
    """What the filter assumes of the sensors; a value left out is taken from the section of the sensor."""

    gyro_bias: float | None = quantity("rad/s", "0.5 deg/h", "initial uncertainty", None, positive=True)
    gyro_random_walk: float | None = quantity(
        "rad/sqrt(s)", "0.02 deg/sqrt(h)", "angular random walk", None, positive=True
    )
    gyro_scale_factor_roll: float | None = quantity("", "30 ppm", "initial uncertainty", None, positive=True)
    gyro_misalignment: float | None = quantity(
        "rad", "0.1 mrad", "initial uncertainty", None, positive=True, at_most="180 deg"
    )
    accelerometer_bias: float | None = quantity(
        "m/s2", "0.3 mgee", "initial uncertainty", None, positive=True
    )
    accelerometer_random_walk: float | None = quantity(
        "m/s(3/2)", "0.03 m/s/sqrt(h)", "velocity random walk", None, positive=True
    )
    camera_mounting: float | None = quantity(
        "rad", "0.02 deg", "initial uncertainty", None, positive=True, at_most="180 deg"
    )
    lever_arm: tuple[float, float, float] | None = quantity(
        "m", "0.3 m", "IMU to GPS antenna in body axes", None, at_least="-1 km", at_most="1 km"
    )
    lever_arm_error: float = quantity(
        "m", "2 cm", "of the lever arm, each axis, if estimated", "2 cm", positive=True, at_most="1 km"
    )
    gps_latency_error: float = quantity(
        "s", "1 ms", "fixes are older than they say by so much", "1 ms", positive=True, at_most="100 s"
    )
    clock_bias: float | None = quantity(
        "m",
        "300 km",
        "of the GPS receiver, unknown at the start; left out: 300 km, or its clock's where that is larger",
        None,
        positive=True,
        at_most="1000000 km",
    )
    clock_drift: float | None = quantity(
        "m/s", "300 m/s", "likewise; left out: 300 m/s, 1 ppm, or its clock's", None, positive=True
    )
    clock_white_frequency: float | None = quantity(
        "m/sqrt(s)", "0.1 m/sqrt(s)", "noise of the clock", None, positive=True
    )
    clock_random_walk: float | None = quantity(
        "m/s(3/2)", "0.2 m/s/sqrt(s)", "of its frequency", None, positive=True
    )
    range_bias: float | None = quantity(
        "m", "3 m", "error of a range that lasts", None, positive=True, at_most="10000 km"
    )
    range_bias_time: float = quantity("s", "300 s", "correlation time of it", "300 s", positive=True)


class Release(Settings):
    """When a sensor that contradicts the filter is believed after all."""

    rejections: int = count("3", "one after the other, that agree with each other", at_least=2)
    duration: float = quantity(
        "s", "2 s", "from the first to the last of them", non_negative=True, at_most="24 h"
    )


class Releases(Settings):
    """Release rules of the sensors."""

    gps: Release = section("")
    first_star_fix: Release = section("")
    star_fix: Release = section("")


class Integrity(Settings):
    """How faults of the sensors are noticed; how wrong the solution may be, `requirements` say."""

    wrong_star_fix: float = quantity(
        "rad",
        "0.5 deg",
        "smallest error that makes a star fix wrong",
        "0.5 deg",
        positive=True,
        at_most="180 deg",
    )
    gps_jump: Release = section(
        "when a GPS position that contradicts the filter while its velocity does not is believed",
        {"rejections": 30, "duration": "29 s"},
    )
    angular_acceleration: float = quantity(
        "rad/s2", "20 deg/s2", "how fast the rate leaves a gyro reading that is held", "20 deg/s2",
        positive=True,
    )  # fmt: skip
    thrust_change: float = quantity(
        "m/s3", "3 gee/s", "how fast specific force leaves a reading that is held", "3 gee/s", positive=True
    )


class Navigation(Settings):
    """Error-state Kalman filter: position, velocity, attitude, biases of the IMU, and blocks of choice."""

    sensors: SensorOverrides = section("what the filter assumes of the sensors", {})
    gps: Literal["loose", "tight"] = choice(
        "how GPS is used: its fixes, or the ranges of its channels (needs state clock)", "loose"
    )
    stars: Literal["attitude", "vectors"] = choice(
        "how stars are used: the attitude that they show together, or each by itself, one or two "
        "as well (needs star_tracker.identification.tracking)",
        "attitude",
    )
    gate_probability: float = number("1e-4", "of rejecting a good measurement", positive=True, at_most=0.1)
    star_fix_floor: float = quantity(
        "rad", "10 arcsec", "errors of a fix that it does not know", non_negative=True, at_most="180 deg"
    )
    release: Releases = section("")
    gps_agreement: float = quantity(
        "m/s", "10 m/s", "difference allowed between two fixes, per second", positive=True
    )
    integrity: Integrity = section("faults of the sensors", {})
    history: float = quantity(
        "s", "0.5 s", "how far back a measurement may lie, at least", positive=True, at_most="5 s"
    )
    thrust_threshold: float = quantity(
        "m/s2", "15 m/s2", "specific force above which a motor burns", positive=True
    )
    thrust_memory: float = quantity(
        "s", "30 s", "for how long errors that go with thrust keep their sign", positive=True
    )
    manoeuvre_angle: float = quantity(
        "rad", "1 rad", "by which the roll axis is turned at a time", positive=True
    )
    gravity_error: float = quantity("m/s2", "30 ugee", "what gravity with J2 leaves out", non_negative=True)
    gravity_memory: float = quantity(
        "s", "50 s", "how long that acts before GPS corrects for it, where it is no state", positive=True
    )
    saturated_rate: float = quantity("rad/s", "50 deg/s", "gyro error at the end of its range", positive=True)
    saturated_acceleration: float = quantity("m/s2", "5 gee", "accelerometer error likewise", positive=True)
