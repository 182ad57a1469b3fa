"""Barometer: static pressure of the air at the vehicle.

Its physics are in `world.barometer`, what the filter makes of a reading in `measure_barometer`; here is what
they have in common: settings, record and states.
"""

from functools import partial
from typing import Annotated, NamedTuple

import numpy as np

from shefex_nav.instruments import instrument
from shefex_nav.instruments.instrument import Column, DataColumn, Drawn, Equation, Plot, StateBlock
from shefex_nav.onboard.navigation.aid import Aid, Block, DriftRule, Renewal
from shefex_nav.settings import Settings, number, quantity, section, switch


class Port(Settings):
    """What the flow adds to the static pressure at the port: a coefficient times the dynamic pressure."""

    mach: tuple[float, ...] = number("0.9", "increasing", non_negative=True, fewest=1)
    coefficient: tuple[float, ...] = number(
        "-0.02", "at these Mach numbers, as calibrated; constant beyond their ends", at_least=-2.0,
        at_most=2.0,
    )  # fmt: skip
    error: float = quantity(
        "", "25 %", "of the coefficient, 1 sigma", "25 %", non_negative=True, at_most="100 %"
    )


class Day(Settings):
    """The air of the day against the model of the air; sensed by the barometer, not by the flight."""

    pressure: float = quantity(
        "Pa", "8 hPa", "at sea level, 1 sigma", "8 hPa", non_negative=True, at_most="100 hPa"
    )
    temperature: float = quantity(
        "K", "8 K", "at each height, 1 sigma", "8 K", non_negative=True, at_most="60 K"
    )
    depth: float = quantity(
        "m", "8 km", "over which it goes with itself", "8 km", at_least="500 m", at_most="100 km"
    )


class Barometer(instrument.Sampled):
    """Barometer on board: static pressure."""

    bias: float = quantity("Pa", "100 Pa", "of the sensor, 1 sigma", non_negative=True)
    drift: float = quantity("Pa", "20 Pa", "bias that wanders in flight, 1 sigma", "0 Pa", non_negative=True)
    drift_time: float = quantity("s", "300 s", "correlation time of the drift", "300 s", positive=True)
    noise: float = quantity("Pa", "5 Pa", "of one reading, 1 sigma, white", positive=True)
    lag: float = quantity(
        "s", "20 ms", "time constant of line and sensor", "0 s", non_negative=True, at_most="10 s"
    )
    quantum: float = quantity(
        "Pa", "1 Pa", "pressure of one count", "off", positive=True, words=(("off", 0.0),)
    )
    lowest: float = quantity("Pa", "10 hPa", "end of the range", "0 Pa", non_negative=True)
    highest: float = quantity("Pa", "1200 hPa", "end of the range", "1200 hPa", positive=True)
    port: Port | None = section("error with the flow; left out: none", None)
    day: Day = section("the air of the day against the model", {})


class DriftWatch(Settings):
    """How a drift is looked for that is a fault, and which one the protection levels cover."""

    chance: float = number(
        "1e-9", "that a reading of a healthy barometer is called a drift", 1e-9, at_least=1e-15,
        at_most=1e-3,
    )  # fmt: skip
    fastest: float = quantity(
        "Pa/s", "1 Pa/s", "drift of a fault. The protection levels cover it, or the fastest one that cannot "
        "be noticed if that is slower; any: whatever cannot be noticed", "any", non_negative=True,
        words=(("any", np.inf),),
    )  # fmt: skip


class BarometerUse(Settings):
    """How the filter uses the barometer."""

    used: bool = switch("false: the filter does without it", default=True)
    up_to: float = quantity(
        "m", "30 km", "not used above this height", "30 km", positive=True, at_most="80 km"
    )
    unused_mach: tuple[float, float] = number(
        "0.8", "not used between these Mach numbers, where shocks cross the port; equal: always used",
        (0.8, 1.3), non_negative=True,
    )  # fmt: skip
    flow_error: float = number(
        "0.005", "part of the dynamic pressure in every reading, 1 sigma, besides the error that the port is "
        "said to have", 0.005, non_negative=True, at_most=1.0,
    )  # fmt: skip
    flow_memory: float = quantity(
        "s", "20 s", "for how long errors of the port keep their sign", "20 s", positive=True
    )
    lag_error: float = quantity("", "20 %", "of the lag, 1 sigma", "20 %", non_negative=True, at_most="100 %")
    drift: DriftWatch = section("a drift that is a fault", {})
    release: instrument.Release = section(
        "when readings that contradict the filter are a new bias", {"rejections": 50, "duration": "5 s"}
    )


class BarometerReading(NamedTuple):
    """Static pressure at its port."""

    t_valid_s: float
    t_available_s: float
    pressure: Annotated[float, Column("Pa", "as measured")]
    at_limit: Annotated[bool, Column("", "the sensor is at an end of its range")] = False


def measure(settings, truth, rng):
    """Readings along a trajectory. Barometer, Truth, Generator -> Measured"""
    from shefex_nav.world import barometer

    k = instrument.samples(settings.rate, truth.trajectory)
    said, t_s = barometer.measure(settings, truth, k, rng), truth.trajectory.t_s[k]
    sensed = instrument.readings(BarometerReading, settings, t_s, said.sensed)
    return instrument.sent(limited, settings, sensed, said.errors)


def equation(settings, truth):
    """What a reading is. Barometer, Truth -> Equation"""
    from shefex_nav.world import barometer

    drawn = tuple(Drawn(*one) for one in barometer.drawn(settings))
    R = np.array([[settings.noise**2 + settings.quantum**2 / 12.0]])
    modes = barometer.modes_of_warmth(settings.day, truth.air)
    read = partial(barometer.sensed_pressure, settings, truth, modes)
    return Equation(drawn, read, R, lambda reading: not reading.at_limit)


def limited(settings, reading):
    """A reading in whole quanta and within the range."""
    counted = instrument.counted(reading.pressure, settings.quantum)
    pressure = min(max(counted, settings.lowest), settings.highest)
    return reading._replace(pressure=float(pressure), at_limit=bool(at_limit(settings, counted)))


def aid(settings, use, known):
    """Aid of a filter. Barometer, BarometerUse, Known"""
    from shefex_nav.onboard.navigation import measure_barometer

    day, release = settings.day, use.release
    layers = measure_barometer.of_layers(day)
    model = measure_barometer.Model(settings, use, layers)
    metres = day.pressure / measure_barometer.SURFACE_WEIGHT
    bias = np.diag([np.hypot(settings.bias, settings.drift) ** 2, metres**2])
    walk = np.array([settings.drift * np.sqrt(2.0 / settings.drift_time), 0.0])  # as which a drift starts out
    blocks = Block("baro_bias", bias, walk), Block("baro_scale", layers, np.zeros(len(layers)))
    return Aid(
        BAROMETER.name,
        BarometerReading,
        partial(measure_barometer.expect, model),
        blocks,
        unfit=partial(measure_barometer.unfit, model),
        renewal=Renewal("baro_bias", 1e4, release.rejections, release.duration, "new bias"),
        sees_attitude=False,
        drift=DriftRule(use.drift.chance, use.drift.fastest, "Pa", bend_of),
    )


def check(settings, use, year):
    """(path, words) of contradictions."""
    if settings.lowest >= settings.highest:
        words = f"{settings.lowest:g} Pa must be below highest, {settings.highest:g} Pa"
        yield ("barometer", "lowest"), words
    low, high = use.unused_mach
    if low > high:
        yield ("navigation", "barometer", "unused_mach"), f"{low:g} is above {high:g}; the lower comes first"
    if settings.port is None:
        return
    mach, coefficient = settings.port.mach, settings.port.coefficient
    if len(mach) != len(coefficient):
        words = f"{len(coefficient)} values for {len(mach)} Mach numbers; give one for each"
        yield ("barometer", "port", "coefficient"), words
    falls = [k for k in range(1, len(mach)) if mach[k] <= mach[k - 1]]
    if falls:
        words = f"{mach[falls[0]]:g} does not follow on {mach[falls[0] - 1]:g}; they must increase"
        yield ("barometer", "port", "mach", falls[0]), words


def bend_of(reading):
    """1/Pa, of DriftRule: where the temperature is one, p'' = p'^2 / p."""
    return 1.0 / reading.pressure


def at_limit(settings, pressure):
    """Whether readings are at an end of the range. (N,) Pa -> (N,) bool"""
    return (pressure <= settings.lowest) | (pressure >= settings.highest)


def of_heights(heights):
    """Pressures of the standard atmosphere at (geopotential) pressure altitudes. (N,) m -> (N,) Pa"""
    from shefex_nav.environment import atmosphere

    radius = atmosphere.EARTH_RADIUS
    geometric = [radius * h / (radius - h) if h < radius else np.nan for h in heights.tolist()]
    return np.array([atmosphere.us76(height)[1] for height in geometric])


def pressure_altitude(read):
    """Height at which the standard atmosphere has the pressures of readings. -> (N,) km"""
    from shefex_nav.environment import atmosphere

    return 1e-3 * atmosphere.pressure_height(read.pressure)


def _positive(pressure):
    return (pressure > 0.0) & (pressure < MOST_PA)


MOST_PA = 1e9  # [E] static pressure that no vehicle meets
STATIC = "a static pressure is greater than zero and below 1e9 Pa"
BAROMETER = instrument.Instrument(
    name="barometer",
    settings=Barometer,
    record=BarometerReading,
    measure=measure,
    aid=aid,
    use=BarometerUse,
    states=(
        StateBlock("baro_bias", 2, "Pa", "a barometer needs the state of its bias"),
        StateBlock("baro_scale", 8, "m", "the day is warmer than the standard", needed=False),
    ),
    check=check,
    equation=equation,
    limited=limited,
    told=("bias", "drift", "drift_time", "noise", "lag", "quantum", "port", "day"),
    stream=10,
    data=(
        DataColumn("pressure", "pressure", "Pa", "Pa", "column of the static pressure", is_valid=_positive,
                   wanted=STATIC),
        DataColumn("height", "pressure", "m", "m",
                   "column of the pressure altitude (of the standard atmosphere)", convert=of_heights,
                   is_valid=_positive, wanted=STATIC),
    ),
    at_limit=at_limit,
    plots=(Plot("altitude", "Pressure altitude", "km", pressure_altitude),),
    figure="sensors.barometer",
    caption="Height at which the standard atmosphere has the pressure that was read. What a day adds to it "
    "grows with height; the lower panel is scaled to what was used.",
    errors_last=True,
)  # fmt: skip
