"""Section of a scenario about the GPS receiver, its antenna, the satellites and the errors of ranges."""

from typing import Literal

from pydantic import Field

from shefex_nav.scenario.block import Block, tagged
from shefex_nav.scenario.quantity import Count, Number, Quantity, Time, Vector

MOST = 63  # the highest number of a satellite
_COEFFICIENT = Number("0.2e-7", "of the navigation message")
Coefficients = tuple[_COEFFICIENT, _COEFFICIENT, _COEFFICIENT, _COEFFICIENT]


class Spin(Block):
    """What a rolling vehicle does to GPS reception."""

    threshold: Quantity(
        "rad/s", "0.3 Hz", "roll rate from which reception suffers", positive=True, turns=True
    )
    loss: Quantity("", "25 %", "chance per fix that a satellite is lost", non_negative=True, at_most="100 %")
    noise_factor: Number("2.0", "on the noise of range and range rate", at_least=1.0)


class Antenna(Block):
    """Where the GPS antenna sits and where it cannot hear."""

    lever_arm: Vector("m", "0.3 m", "IMU to antenna in body axes")
    blind_nose: Quantity(
        "rad", "20 deg", "half angle of the deaf cone about the nose", at_least="0 deg", at_most="90 deg"
    )
    blind_tail: Quantity(
        "rad", "40 deg", "half angle of the deaf cone about the tail", at_least="0 deg", at_most="90 deg"
    )


class GpsOutage(Block):
    """No GPS solution for a time after an event of the flight."""

    event: str = Field(
        description="event of the flight at which the receiver loses its satellites, such as lift_off, "
        "burn_out_1, separation_1, ignition_2 or the start of a task, <task>_start"
    )
    shortest: Quantity("s", "3 s", "shortest duration", non_negative=True)
    longest: Quantity("s", "20 s", "longest duration; each run draws one in between", non_negative=True)


class Clock(Block):
    """Oscillator of the receiver; without effect on fixes, which solve for it."""

    bias: Quantity("s", "1 us", "at the start, 1 sigma", non_negative=True) = "1 us"
    drift: Quantity("", "0.1 ppm", "at the start, 1 sigma", non_negative=True) = "0.1 ppm"
    h_0: Quantity("s", "2e-19 s", "white frequency noise, Allan variance h_0", non_negative=True) = "2e-19 s"
    h_minus_2: Quantity(
        "1/s", "2e-20 1/s", "random walk of the frequency, Allan variance h_-2", non_negative=True
    ) = "2e-20 1/s"


class SatelliteErrors(Block):
    """Clock and orbit of each satellite against what it broadcasts."""

    range: Quantity("m", "1 m", "constant, 1 sigma", non_negative=True) = "0 m"
    rate: Quantity("m/s", "1 mm/s", "change of that, 1 sigma", non_negative=True) = "0 m/s"


class Ionosphere(Block):
    """Free electrons; the coefficients are those of the navigation message, IS-GPS-200, 20.3.3.5.2.5."""

    alpha: Coefficients = Field(description="amplitude: s, s/semicircle, s/semicircle^2, s/semicircle^3")
    beta: Coefficients = Field(description="period: s, s/semicircle, s/semicircle^2, s/semicircle^3")
    residual: Quantity(
        "", "30 %", "left by the receiver's correction, 1 sigma", non_negative=True, at_most="100 %"
    )


class Troposphere(Block):
    """Neutral air."""

    residual: Quantity(
        "", "5 %", "left by the receiver's correction, 1 sigma", non_negative=True, at_most="100 %"
    )


class Multipath(Block):
    """Error of each range that wanders, first-order Gauss-Markov."""

    range: Quantity("m", "0.5 m", "1 sigma", non_negative=True)
    time: Quantity("s", "30 s", "correlation time", positive=True)


class RangeErrors(Block):
    """Errors of ranges that last; what is left out is none."""

    satellite: SatelliteErrors | None = None
    ionosphere: Ionosphere | None = None
    troposphere: Troposphere | None = None
    multipath: Multipath | None = None


class Only(Block):
    """No more than some satellites for a time, `satellites` or `prn`."""

    start: Time("100 s", "first epoch") = Field(alias="from")
    end: Time("400 s", "and from here on all again") = Field(alias="until")
    satellites: Count("2", "how many: far apart, of those tracked longest", non_negative=True) | None = None
    prn: list[Count("5", "number of a satellite", positive=True, at_most=MOST)] | None = Field(
        default=None, description="which ones: numbers, 1 to 24 for the nominal satellites"
    )


class Reacquisition(Block):
    """How long a satellite must be in view after an outage or behind Earth or antenna to be tracked again."""

    shortest: Quantity("s", "1 s", "shortest time", non_negative=True)
    longest: Quantity("s", "10 s", "longest time; each satellite draws one in between", non_negative=True)


class Almanac(Block):
    """Elements of satellites, as in a YUMA file; one value for each."""

    prn: list[Count("5", "number", positive=True, at_most=MOST)]
    health: list[Count("0", "0: good", non_negative=True)]
    eccentricity: list[Number("0.01", "of the orbit", non_negative=True, at_most=0.5)]
    time: list[Quantity("s", "319488 s", "of the week, for which the elements hold", non_negative=True)]
    inclination: list[Quantity("rad", "0.96 rad", "of the orbit")]
    node_rate: list[Quantity("rad/s", "-8e-9 rad/s", "of the right ascension of the node")]
    root_semi_major_axis: list[Number("5153.6", "root of metres", positive=True)]
    node: list[Quantity("rad", "1 rad", "longitude of the ascending node at the start of the week")]
    perigee: list[Quantity("rad", "1 rad", "argument of perigee")]
    anomaly: list[Quantity("rad", "1 rad", "mean anomaly")]
    week: list[Count("669", "of GPS, modulo 1024 or in full", non_negative=True)]


def _almanac_form(value):
    return "<name>" if isinstance(value, str) else "<prn>"


Satellites = tagged(_almanac_form, {"name": str, "prn": Almanac})


class Gps(Block):
    """GPS receiver: fixes of position and velocity, and the ranges of which they are made."""

    rate: Quantity("Hz", "1 Hz", "fixes a second; must divide 100 Hz", positive=True, at_most="50 Hz") = (
        "1 Hz"
    )
    fix: Literal["full", "position", "horizontal"] = Field(
        "full", description="position and velocity; position alone; or latitude and longitude alone"
    )
    latency: Quantity(
        "s", "0.2 s", "from the instant measured to the fix on board", non_negative=True, at_most="1 s"
    )
    clock_offset: Quantity(
        "s", "5 ms", "fixes are stamped so much later than they are", at_least="-1 s", at_most="1 s"
    ) = "0 s"
    range_noise: Quantity("m", "3 m", "range to one satellite, 1 sigma, white in time", positive=True)
    range_rate_noise: Quantity("m/s", "0.1 m/s", "range rate, 1 sigma", positive=True)
    elevation_mask: Quantity("rad", "5 deg", "lowest elevation", at_least="-30 deg", at_most="80 deg")
    lowest_ray_height: Quantity(
        "m", "50 km", "signals below the mask must pass above this height", non_negative=True
    )
    max_pdop: Number("10.0", "no fix above it", positive=True)
    antenna: Antenna
    spin: Spin
    outages: list[GpsOutage]
    almanac: Satellites | None = Field(
        default=None, description="satellites: name of a YUMA file, or its elements; else the nominal 24"
    )
    clock: Clock = Field(default_factory=Clock, description="oscillator of the receiver")
    errors: RangeErrors = Field(default_factory=RangeErrors, description="errors of ranges that last")
    only: list[Only] = Field(default=[], description="fewer satellites for a time")
    reacquisition: Reacquisition | None = Field(
        default=None, description="how long it takes to track a satellite again; left out: no time"
    )
