"""Settings of the GPS receiver, its antenna and the errors of ranges."""

from typing import Literal

import numpy as np

from shefex_nav.environment.constants import SPEED_OF_LIGHT
from shefex_nav.settings import Settings, choice, count, number, quantity, section, text
from shefex_nav.world.settings import UNLIMITED

MOST = 63  # the highest number of a satellite


class Spin(Settings):
    """What a rolling vehicle does to GPS reception."""

    threshold: float = quantity(
        "rad/s", "0.3 Hz", "roll rate from which reception suffers", positive=True, turns=True
    )
    loss: float = quantity(
        "", "25 %", "chance per fix that a satellite is lost", non_negative=True, at_most="100 %"
    )
    noise_factor: float = number("2.0", "on the noise of range and range rate", at_least=1.0)


class Antenna(Settings):
    """Where the GPS antenna sits and where it cannot hear."""

    lever_arm: tuple[float, float, float] = quantity(
        "m", "0.3 m", "IMU to antenna in body axes", at_least="-1 km", at_most="1 km"
    )
    blind_nose: float = quantity(
        "rad", "20 deg", "half angle of the deaf cone about the nose", at_least="0 deg", at_most="90 deg"
    )
    blind_tail: float = quantity(
        "rad", "40 deg", "half angle of the deaf cone about the tail", at_least="0 deg", at_most="90 deg"
    )


class GpsOutage(Settings):
    """No GPS solution for a time after an event of the flight."""

    event: str = text(
        "event of the flight at which the receiver loses its satellites, such as lift_off, burn_out_1, "
        "separation_1, ignition_2 or the start of a task, <task>_start"
    )
    shortest: float = quantity("s", "3 s", "shortest duration", non_negative=True, at_most="24 h")
    longest: float = quantity(
        "s", "20 s", "longest duration; each run draws one in between", non_negative=True, at_most="24 h"
    )


class Clock(Settings):
    """Oscillator of the receiver; without effect on fixes, which solve for it."""

    bias: float = quantity("s", "1 us", "at the start, 1 sigma", "1 us", non_negative=True, at_most="10 s")
    drift: float = quantity("", "0.1 ppm", "at the start, 1 sigma", "0.1 ppm", non_negative=True)
    h_0: float = quantity(
        "s", "2e-19 s", "white frequency noise, Allan variance h_0", "2e-19 s", non_negative=True
    )
    h_minus_2: float = quantity(
        "1/s",
        "2e-20 1/s",
        "random walk of the frequency, Allan variance h_-2",
        "2e-20 1/s",
        non_negative=True,
    )

    @property
    def sigmas(self):
        """Standard deviations of bias, m, and drift, m/s, at the start."""
        return SPEED_OF_LIGHT * self.bias, SPEED_OF_LIGHT * self.drift

    @property
    def densities(self):
        """S_f m^2/s and S_g m^2/s^3 of white frequency and its random walk: c^2 h_0/2 and 2 pi^2 c^2 h_-2."""
        c2 = SPEED_OF_LIGHT**2
        return 0.5 * c2 * self.h_0, 2.0 * np.pi**2 * c2 * self.h_minus_2


class SatelliteErrors(Settings):
    """Clock and orbit of each satellite against what it broadcasts."""

    range: float = quantity("m", "1 m", "at any time, 1 sigma", "0 m", non_negative=True, at_most="10000 km")
    rate: float = quantity("m/s", "1 mm/s", "change of that, 1 sigma: it swings", "0 m/s", non_negative=True)


class Ionosphere(Settings):
    """Free electrons; the coefficients are those of the navigation message, IS-GPS-200, 20.3.3.5.2.5."""

    alpha: tuple[float, float, float, float] = number(
        "0.2e-7", "amplitude: s, s/semicircle, s/semicircle^2, s/semicircle^3"
    )
    beta: tuple[float, float, float, float] = number(
        "0.2e-7", "period: s, s/semicircle, s/semicircle^2, s/semicircle^3"
    )
    residual: float = quantity(
        "", "30 %", "left by the receiver's correction, 1 sigma", non_negative=True, at_most="100 %"
    )


class Troposphere(Settings):
    """Neutral air."""

    residual: float = quantity(
        "", "5 %", "left by the receiver's correction, 1 sigma", non_negative=True, at_most="100 %"
    )


class Multipath(Settings):
    """Error of each range that wanders, first-order Gauss-Markov."""

    range: float = quantity("m", "0.5 m", "1 sigma", non_negative=True, at_most="10000 km")
    time: float = quantity("s", "30 s", "correlation time", positive=True)


class RangeErrors(Settings):
    """Errors of ranges that last; what is left out is none."""

    satellite: SatelliteErrors | None = section(default=None)
    ionosphere: Ionosphere | None = section(default=None)
    troposphere: Troposphere | None = section(default=None)
    multipath: Multipath | None = section(default=None)

    def __bool__(self):
        """Whether there are any."""
        return any((self.satellite, self.ionosphere, self.troposphere, self.multipath))


class Only(Settings):
    """No more than some satellites for a time, `satellites` or `prn`."""

    start: float = quantity("s", "100 s", "first epoch", key="from")
    end: float = quantity("s", "400 s", "and from here on all again", key="until")
    satellites: int | None = count(
        "2", "how many: far apart, of those tracked longest", None, non_negative=True
    )
    prn: tuple[int, ...] | None = count(
        "5", "which ones: numbers, 1 to 24 for the nominal satellites", None, positive=True, at_most=MOST
    )


class Reacquisition(Settings):
    """How long a satellite must be in view after an outage or behind Earth or antenna to be tracked again."""

    shortest: float = quantity("s", "1 s", "shortest time", non_negative=True, at_most="24 h")
    longest: float = quantity(
        "s", "10 s", "longest time; each satellite draws one in between", non_negative=True, at_most="24 h"
    )


class Gps(Settings):
    """GPS receiver: fixes of position and velocity, and the ranges of which they are made."""

    rate: float = quantity(
        "Hz", "1 Hz", "fixes a second; must divide 100 Hz", "1 Hz", positive=True, at_most="50 Hz"
    )
    fix: Literal["full", "position", "horizontal"] = choice(
        "position and velocity; position alone; or latitude and longitude alone", "full"
    )
    latency: float = quantity(
        "s", "0.2 s", "from the instant measured to the fix on board", non_negative=True, at_most="1 s"
    )
    clock_offset: float = quantity(
        "s", "5 ms", "fixes are stamped so much later than they are", "0 s", at_least="-1 s", at_most="1 s"
    )
    range_noise: float = quantity(
        "m", "3 m", "range to one satellite, 1 sigma, white in time", positive=True, at_most="10000 km"
    )
    range_rate_noise: float = quantity("m/s", "0.1 m/s", "range rate, 1 sigma", positive=True)
    elevation_mask: float = quantity("rad", "5 deg", "lowest elevation", at_least="-30 deg", at_most="80 deg")
    lowest_ray_height: float = quantity(
        "m",
        "50 km",
        "signals below the mask must pass above this height",
        non_negative=True,
        at_most="1000000 km",
    )
    max_pdop: float = number("10.0", "no fix above it", positive=True)
    highest_speed: float = quantity(
        "m/s",
        "500 m/s",
        "over the ground; beyond it the receiver is silent",
        "unlimited",
        positive=True,
        words=UNLIMITED,
    )
    highest_height: float = quantity(
        "m",
        "50 km",
        "over the ellipsoid; beyond it the receiver is silent",
        "unlimited",
        positive=True,
        words=UNLIMITED,
        at_most="1000000 km",
    )
    antenna: Antenna = section()
    spin: Spin = section()
    outages: tuple[GpsOutage, ...] = section()
    clock: Clock = section("oscillator of the receiver", {})
    errors: RangeErrors = section("errors of ranges that last", {})
    only: tuple[Only, ...] = section("fewer satellites for a time", [])
    reacquisition: Reacquisition | None = section(
        "how long it takes to track a satellite again; left out: no time", None
    )
