"""Sections of a scenario about the barometer: sensor, port and day, and how the filter uses it.

Values are floats in SI once loaded. The filter takes from the section of the sensor what it assumes of it.
"""

from pydantic import Field, StrictBool

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Count, Number, Quantity
from shefex_nav.scenario.sensors import OFF


class Release(Block):
    """When a sensor that contradicts the filter is believed after all."""

    rejections: Count("3", "one after the other, that agree with each other", at_least=2)
    duration: Quantity("s", "2 s", "from the first to the last of them", non_negative=True)


class Port(Block):
    """What the flow adds to the static pressure at the port: a coefficient times the dynamic pressure."""

    mach: list[Number("0.9", "", non_negative=True)] = Field(min_length=1, description="increasing")
    coefficient: list[Number("-0.02", at_least=-2.0, at_most=2.0)] = Field(
        min_length=1, description="at these Mach numbers, as calibrated; constant beyond their ends"
    )
    error: Quantity("", "25 %", "of the coefficient, 1 sigma", non_negative=True, at_most="100 %") = "25 %"


class Day(Block):
    """The air of the day against the model of the air; felt by the barometer, not by the flight."""

    pressure: Quantity("Pa", "8 hPa", "at sea level, 1 sigma", non_negative=True, at_most="100 hPa") = "8 hPa"
    temperature: Quantity("K", "8 K", "at each height, 1 sigma", non_negative=True, at_most="60 K") = "8 K"
    depth: Quantity("m", "8 km", "over which it goes with itself", at_least="500 m", at_most="100 km") = (
        "8 km"
    )


class Barometer(Block):
    """Barometer on board: static pressure."""

    rate: Quantity("Hz", "10 Hz", "readings a second; must divide 100 Hz", positive=True, at_most="100 Hz")
    latency: Quantity("s", "10 ms", "from the instant measured to the reading on board", non_negative=True,
                      at_most="1 s") = "0 s"  # fmt: skip
    bias: Quantity("Pa", "100 Pa", "of the sensor, 1 sigma", non_negative=True)
    drift: Quantity("Pa", "20 Pa", "bias that wanders in flight, 1 sigma", non_negative=True) = "0 Pa"
    drift_time: Quantity("s", "300 s", "correlation time of the drift", positive=True) = "300 s"
    noise: Quantity("Pa", "5 Pa", "of one reading, 1 sigma, white", positive=True)
    lag: Quantity("s", "20 ms", "time constant of line and sensor", non_negative=True, at_most="10 s") = "0 s"
    quantum: Quantity("Pa", "1 Pa", "pressure of one count", positive=True, words=OFF) = "off"
    lowest: Quantity("Pa", "10 hPa", "end of the range", non_negative=True) = "0 Pa"
    highest: Quantity("Pa", "1200 hPa", "end of the range", positive=True) = "1200 hPa"
    port: Port | None = Field(default=None, description="error with the flow; left out: none")
    day: Day = Field(default_factory=Day, description="the air of the day against the model")


class BarometerUse(Block):
    """How the filter uses the barometer."""

    used: StrictBool = Field(default=True, description="false: the filter does without it")
    up_to: Quantity("m", "30 km", "not used above this height", positive=True, at_most="80 km") = "30 km"
    unused_mach: tuple[Number("0.8", non_negative=True), Number("1.3", positive=True)] = Field(
        default=(0.8, 1.3),
        description="not used between these Mach numbers, where shocks cross the port; equal: always used",
        validate_default=True,
    )
    flow_error: Number("0.005", "part of the dynamic pressure in every reading, 1 sigma, besides the error "
                       "that the port is said to have", non_negative=True, at_most=1.0) = 0.005  # fmt: skip
    flow_memory: Quantity("s", "20 s", "for how long errors of the port keep their sign", positive=True) = (
        "20 s"
    )
    lag_error: Quantity("", "20 %", "of the lag, 1 sigma", non_negative=True, at_most="100 %") = "20 %"
    layer_error: Quantity("m", "5 m", "left by the layers of state baro_scale, 1 sigma", positive=True) = (
        "5 m"
    )
    release: Release = Field(
        {"rejections": 50, "duration": "5 s"},
        validate_default=True,
        description="when readings that contradict the filter are a new bias (needs state baro_bias)",
    )


def contradictions(scenario):
    """(path, words) of contradictions in the sections of the barometer of a mission."""
    yield from of_sensor(scenario)
    section = scenario.barometer
    if section is not None and abs(100.0 / section.rate - round(100.0 / section.rate)) > 1e-6:
        words = (
            f"{section.rate:g} Hz does not divide the on-board clock, 100 Hz; take such as 1, 10, 20 or 50 Hz"
        )
        yield ("barometer", "rate"), words


def of_sensor(scenario):
    """(path, words) of what missions and replays have in common."""
    section, states = scenario.barometer, scenario.navigation.states
    if section is None:
        for name in ("baro_bias", "baro_scale"):
            if name in states:
                words = f"'{name}' is of a barometer: give section barometer, or leave it out"
                yield ("navigation", "states", states.index(name)), words
        return
    if scenario.navigation.barometer.used and "baro_bias" not in states:
        words = f"a barometer needs the state of its bias; write [{', '.join([*states, 'baro_bias'])}]"
        yield ("navigation", "states"), words
    if section.lowest >= section.highest:
        yield ("barometer", "lowest"), f"{section.lowest:g} Pa must be below highest, {section.highest:g} Pa"
    low, high = scenario.navigation.barometer.unused_mach
    if low > high:
        yield ("navigation", "barometer", "unused_mach"), f"{low:g} is above {high:g}; the lower comes first"
    port = section.port
    if port is None:
        return
    if len(port.mach) != len(port.coefficient):
        words = f"{len(port.coefficient)} values for {len(port.mach)} Mach numbers; give one for each"
        yield ("barometer", "port", "coefficient"), words
    falls = [k for k in range(1, len(port.mach)) if port.mach[k] <= port.mach[k - 1]]
    if falls:
        words = f"{port.mach[falls[0]]:g} does not follow on {port.mach[falls[0] - 1]:g}; they must increase"
        yield ("barometer", "port", "mach", falls[0]), words
