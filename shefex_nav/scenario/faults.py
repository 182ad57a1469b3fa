"""Section of a scenario about what goes wrong with the sensors, and when. Without it nothing does.

Each fault says what it is (`fault`), `from` when and `until` when; times count from lift-off. The sections of
the sensors describe healthy ones.
"""

from typing import Literal

from pydantic import Field, StrictBool

from shefex_nav.scenario.block import Block, kinds
from shefex_nav.scenario.quantity import Count, Quantity, Time, Vector

Axis = Literal["x", "y", "z"]
Triad = Literal["gyro", "accelerometer"]


class Fault(Block):
    """Something wrong from one time until another."""

    start: Time("300 s", "when it begins") = Field(alias="from")
    end: Time("310 s", "and ends") = Field(alias="until")


class Stuck(Fault):
    """One axis repeats its last reading."""

    fault: Literal["stuck"]
    sensor: Triad = Field(description="which triad")
    axis: Axis = Field(description="which of its axes")


class Dead(Fault):
    """One axis reads exactly zero."""

    fault: Literal["dead"]
    sensor: Triad = Field(description="which triad")
    axis: Axis = Field(description="which of its axes")


class GyroBias(Fault):
    """The bias of one gyro is another than before."""

    fault: Literal["gyro_bias"]
    axis: Axis = Field(description="which axis")
    rate: Quantity("rad/s", "0.1 deg/s", "that is added to what it reads")


class GyroScale(Fault):
    """The scale factor of one gyro is another than before."""

    fault: Literal["gyro_scale"]
    axis: Axis = Field(description="which axis")
    factor: Quantity("", "1 %", "by which it reads more")


class AccelerometerBias(Fault):
    """The bias of one accelerometer is another than before."""

    fault: Literal["accelerometer_bias"]
    axis: Axis = Field(description="which axis")
    acceleration: Quantity("m/s2", "5 mgee", "that is added to what it reads")


class AccelerometerScale(Fault):
    """The scale factor of one accelerometer is another than before."""

    fault: Literal["accelerometer_scale"]
    axis: Axis = Field(description="which axis")
    factor: Quantity("", "1 %", "by which it reads more")


class Dropout(Fault):
    """The unit does not answer."""

    fault: Literal["dropout"]


class Repeat(Fault):
    """The unit sends its last block of samples again and again."""

    fault: Literal["repeat"]


class Outage(Fault):
    """No solution."""

    fault: Literal["outage"]


class Freeze(Fault):
    """The receiver repeats its last position and velocity, whatever it receives."""

    fault: Literal["freeze"]
    time: Literal["runs", "stands"] = Field("runs", description="whether the time of the fix goes on")


class Jump(Fault):
    """The position is off by a constant vector; the ranges are those of an antenna there."""

    fault: Literal["jump"]
    position: Vector("m", "300 m", "north, east, down")


class Drift(Fault):
    """The position runs away; the ranges are those of an antenna that does."""

    fault: Literal["drift"]
    rate: Vector("m/s", "2 m/s", "north, east, down")
    velocity_too: StrictBool = Field(
        False, description="the reported velocity and the range rates contain the drift"
    )


class Delay(Fault):
    """Fixes and ranges arrive later than usual."""

    fault: Literal["delay"]
    by: Quantity("s", "0.5 s", "on top of the latency", positive=True, at_most="60 s")
    time: Literal["right", "late"] = Field(
        "right", description="whether the time of the fix is that of its instant or late by as much"
    )


class Bias(Fault):
    """Every star fix is turned by the same angles."""

    fault: Literal["bias"]
    angles: Vector("rad", "0.1 deg", "about the axes of the camera: right, down, boresight")


class WrongFixes(Fault):
    """Star fixes that are good but for their attitude: the first, and every so-manieth after it."""

    fault: Literal["wrong_fixes"]
    every: Count("10", "of the solved frames; 1: all of them", positive=True)
    smallest: Quantity("rad", "0.5 deg", "by which a fix is wrong", positive=True, at_most="180 deg")
    largest: Quantity("rad", "180 deg", "likewise; angles are drawn evenly by their logarithm", positive=True,
                      at_most="180 deg")  # fmt: skip


class Blinded(Fault):
    """Light falls into the star camera: every picture is white."""

    fault: Literal["blinded"]


ImuFault = kinds(
    "fault", Stuck, Dead, Dropout, Repeat, GyroBias, GyroScale, AccelerometerBias, AccelerometerScale
)
GpsFault = kinds("fault", Outage, Freeze, Jump, Drift, Delay)
StarFault = kinds("fault", Bias, WrongFixes, Blinded)


class Faults(Block):
    """What goes wrong."""

    imu: list[ImuFault] = Field([], description="faults of the inertial measurement unit")
    gps: list[GpsFault] = Field([], description="faults of the GPS receiver")
    star_tracker: list[StarFault] = Field([], description="faults of star camera and star tracker")


def contradictions(scenario):
    """(path of the field, text for people) of faults that make no sense."""
    limit = scenario.mission.time_limit
    for device in ("imu", "gps", "star_tracker"):
        for k, fault in enumerate(getattr(scenario.faults, device)):
            path = ("faults", device, k)
            if fault.end <= fault.start:
                yield (*path, "until"), f"{fault.end:g} s must be later than from, {fault.start:g} s"
            if fault.start > limit:
                yield (*path, "from"), f"{fault.start:g} s is after mission.time_limit, {limit:g} s"
            if isinstance(fault, WrongFixes) and fault.largest < fault.smallest:
                yield (*path, "smallest"), "must not exceed largest"
