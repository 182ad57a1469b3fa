"""Settings of faults: what is wrong with a sensor, from when on and until when.

`name` and `words` of a fault are those of its event in the log.
"""

from math import degrees
from typing import Literal

from shefex_nav.clock import SAME_S
from shefex_nav.settings import Settings, choice, count, quantity, section, switch

AXES = "xyz"


class Fault(Settings):
    """Something wrong from one time until another."""

    start: float = quantity("s", "300 s", "when it begins", key="from")
    end: float = quantity("s", "310 s", "and ends", key="until")
    words = ""

    @property
    def name(self):
        """Of the event."""
        return self.fault


class AxisFault(Fault):
    """Something wrong with one axis of the IMU: a reading of `sensor`, gyro or accelerometer."""

    axis: Literal["x", "y", "z"] = choice("which axis")

    @property
    def k(self):
        """Number of the axis."""
        return AXES.index(self.axis)

    @property
    def name(self):
        """Of the event."""
        return f"{self.sensor}_{self.axis}_{self.fault.removeprefix(f'{self.sensor}_')}"


class Stuck(AxisFault):
    """One axis repeats its last reading."""

    fault: Literal["stuck"] = choice()
    sensor: Literal["gyro", "accelerometer"] = choice("which triad")


class Dead(AxisFault):
    """One axis reads exactly zero."""

    fault: Literal["dead"] = choice()
    sensor: Literal["gyro", "accelerometer"] = choice("which triad")


class GyroBias(AxisFault):
    """The bias of one gyro is another than before."""

    sensor = "gyro"
    fault: Literal["gyro_bias"] = choice()
    rate: float = quantity("rad/s", "0.1 deg/s", "that is added to what it reads")

    @property
    def words(self):
        """Of the event."""
        return f"{degrees(self.rate):g} deg/s"


class GyroScale(AxisFault):
    """The scale factor of one gyro is another than before."""

    sensor = "gyro"
    fault: Literal["gyro_scale"] = choice()
    factor: float = quantity("", "1 %", "by which it reads more")

    @property
    def words(self):
        """Of the event."""
        return f"{1e6 * self.factor:g} ppm"


class AccelerometerBias(AxisFault):
    """The bias of one accelerometer is another than before."""

    sensor = "accelerometer"
    fault: Literal["accelerometer_bias"] = choice()
    acceleration: float = quantity("m/s2", "5 mgee", "that is added to what it reads")

    @property
    def words(self):
        """Of the event."""
        return f"{self.acceleration:g} m/s^2"


class AccelerometerScale(AxisFault):
    """The scale factor of one accelerometer is another than before."""

    sensor = "accelerometer"
    fault: Literal["accelerometer_scale"] = choice()
    factor: float = quantity("", "1 %", "by which it reads more")
    words = GyroScale.words


class Dropout(Fault):
    """The unit does not answer."""

    fault: Literal["dropout"] = choice()


class Repeat(Fault):
    """The unit sends its last block of samples again and again."""

    fault: Literal["repeat"] = choice()


class Outage(Fault):
    """No solution."""

    fault: Literal["outage"] = choice()


class Freeze(Fault):
    """The receiver repeats its last position and velocity, whatever it receives."""

    fault: Literal["freeze"] = choice()
    time: Literal["runs", "stands"] = choice("whether the time of the fix goes on", "runs")


class Jump(Fault):
    """The position is off by a constant vector; the ranges are those of an antenna there."""

    fault: Literal["jump"] = choice()
    position: tuple[float, float, float] = quantity(
        "m", "300 m", "north, east, down", at_least="-1000000 km", at_most="1000000 km"
    )

    @property
    def words(self):
        """Of the event."""
        return f"{_three(self.position)} m north, east, down"


class Drift(Fault):
    """The position runs away; the ranges are those of an antenna that does."""

    fault: Literal["drift"] = choice()
    rate: tuple[float, float, float] = quantity("m/s", "2 m/s", "north, east, down")
    velocity_too: bool = switch("the reported velocity and the range rates contain the drift", default=False)

    @property
    def words(self):
        """Of the event."""
        return f"{_three(self.rate)} m/s north, east, down"


class Delay(Fault):
    """Fixes and ranges arrive later than usual."""

    fault: Literal["delay"] = choice()
    by: float = quantity("s", "0.5 s", "on top of the latency", positive=True, at_most="60 s")
    time: Literal["right", "late"] = choice(
        "whether the time of the fix is that of its instant or late by as much", "right"
    )

    @property
    def words(self):
        """Of the event."""
        return f"{self.by:g} s{', stamped late' if self.time == 'late' else ''}"


class Bias(Fault):
    """Every star fix is turned by the same angles."""

    fault: Literal["bias"] = choice()
    angles: tuple[float, float, float] = quantity(
        "rad", "0.1 deg", "about the axes of the camera: right, down, boresight"
    )

    @property
    def words(self):
        """Of the event."""
        return f"{_three([degrees(angle) for angle in self.angles])} deg, camera axes"


class WrongFixes(Fault):
    """Star fixes that are good but for their attitude: the first, and one in `every` after it."""

    fault: Literal["wrong_fixes"] = choice()
    every: int = count("10", "of the solved frames; 1: all of them", positive=True)
    smallest: float = quantity("rad", "0.5 deg", "by which a fix is wrong", positive=True, at_most="180 deg")
    largest: float = quantity(
        "rad", "180 deg", "likewise; angles are drawn evenly by their logarithm", positive=True,
        at_most="180 deg",
    )  # fmt: skip

    @property
    def words(self):
        """Of the event."""
        angles = f"{degrees(self.smallest):g} to {degrees(self.largest):g} deg"
        return f"every {self.every}th fix by {angles}"


class Blinded(Fault):
    """Light falls into the star camera: every picture is white."""

    fault: Literal["blinded"] = choice()


Imu = Stuck | Dead | Dropout | Repeat | GyroBias | GyroScale | AccelerometerBias | AccelerometerScale
Gps = Outage | Freeze | Jump | Drift | Delay
Stars = Bias | WrongFixes | Blinded


class Faults(Settings):
    """What goes wrong."""

    imu: tuple[Imu, ...] = section("faults of the inertial measurement unit", [], by="fault")
    gps: tuple[Gps, ...] = section("faults of the GPS receiver", [], by="fault")
    star_tracker: tuple[Stars, ...] = section("faults of star camera and star tracker", [], by="fault")


def _three(numbers):
    return ", ".join(f"{number:g}" for number in numbers)


def within(fault, t_s):
    """Whether a fault acts at t_s; its end does not belong to it."""
    return (t_s > fault.start - SAME_S) & (t_s < fault.end - SAME_S)


def in_turn(faults):
    """Faults as they begin, those that begin together as they are listed: list.

    What repeats, repeats what was sent before it, with the faults that had begun by then.
    """
    return sorted(faults, key=lambda fault: fault.start)


def with_fault(fault, records, change, is_good):
    """Records of a sensor with one fault: list.

    Parameters
    ----------
    fault : its settings
    records : in the order of their instants; another fault may have given them stamps in another one
    change : function of the fault, a record within it and the last good one before that in the list, or None
        -> record
    is_good : function of a record: whether it is one that a faulty sensor may repeat
    """
    changed, last = [], None
    for one in records:
        acts = within(fault, one.t_valid_s)
        if not acts and is_good(one):
            last = one
        changed.append(change(fault, one, last) if acts else one)
    return changed
