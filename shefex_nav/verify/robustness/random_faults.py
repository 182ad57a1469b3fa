"""Missions with one or two faults of any kind that a scenario can inject, at random.

Kinds are drawn evenly, sizes evenly by their logarithm from 1 to 1000 times what the computer is told of that
quantity (1 sigma), begins evenly over the flight, durations evenly by their logarithm.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.verify.robustness import happenings
from shefex_nav.verify.robustness.happenings import (
    AT_ONCE,
    GPS,
    IMU,
    INNOVATIONS,
    REPEATED_FIX,
    REPEATS,
    STARS,
    along,
    any_axis,
)

NAME = "random"  # in the place of the level of what happens
LEVELS = 1.0, 1000.0  # sigma
LASTS_S = 0.05, 60.0
RANDOM_KEY = 11


class Kind(NamedTuple):
    """One kind of fault."""

    device: str
    shows: str
    make: object  # function of Scenario, Generator, size in sigma -> fault without times


def _signed(rng, size):
    return size if rng.random() < 0.5 else -size


def _dead_or_stuck(name):
    def make(scenario, rng, size):
        sensor = ("gyro", "accelerometer")[int(rng.integers(2))]
        return {"fault": name, "sensor": sensor, "axis": any_axis(rng)}

    return make


def _bias(sensor, key, unit):
    def make(scenario, rng, size):
        triad = getattr(scenario.imu, sensor)
        told = float(np.hypot(triad.bias, triad.in_run_bias))
        return {
            "fault": f"{sensor}_bias", "axis": any_axis(rng), key: f"{_signed(rng, size * told):.9g} {unit}"
        }  # fmt: skip

    return make


def _scale(sensor):
    def make(scenario, rng, size):
        axis, triad = any_axis(rng), getattr(scenario.imu, sensor)
        told = triad.scale_factor_roll if sensor == "gyro" and axis == "x" else triad.scale_factor
        return {
            "fault": f"{sensor}_scale",
            "axis": axis,
            "factor": f"{100.0 * _signed(rng, size * told):.9g} %",
        }

    return make


def _jump(scenario, rng, size):
    return {"fault": "jump", "position": along(rng, size * scenario.gps.range_noise, "m")}


def _drift(scenario, rng, size):
    row = {"fault": "drift", "rate": along(rng, size * scenario.gps.range_rate_noise, "m/s")}
    return row | {"velocity_too": bool(rng.random() < 0.5)}


def _wrong(scenario, rng, size):
    angle = min(size * scenario.star_camera.mounting.error, np.pi)
    every = int(rng.integers(1, 21))
    size = f"{angle:.9g} rad"
    return {"fault": "wrong_fixes", "every": every, "smallest": size, "largest": size}


def _turned(scenario, rng, size):
    angle = min(size * scenario.star_camera.mounting.error, np.pi)
    return {"fault": "bias", "angles": along(rng, angle, "rad")}


def _freeze(scenario, rng, size):
    return {"fault": "freeze", "time": ("runs", "stands")[int(rng.integers(2))]}


def _delay(scenario, rng, size):
    """Nothing is told of delays: a sigma stands for a millisecond."""
    return {"fault": "delay", "by": f"{size:.9g} ms", "time": ("right", "late")[int(rng.integers(2))]}


def _plain(name):
    return lambda scenario, rng, size: {"fault": name}


KINDS = {
    "stuck": Kind(IMU, REPEATS, _dead_or_stuck("stuck")),
    "dead": Kind(IMU, REPEATS, _dead_or_stuck("dead")),
    "dropout": Kind(IMU, AT_ONCE, _plain("dropout")),
    "repeat": Kind(IMU, AT_ONCE, _plain("repeat")),
    "gyro_bias": Kind(IMU, INNOVATIONS, _bias("gyro", "rate", "rad/s")),
    "gyro_scale": Kind(IMU, INNOVATIONS, _scale("gyro")),
    "accelerometer_bias": Kind(IMU, INNOVATIONS, _bias("accelerometer", "acceleration", "m/s2")),
    "accelerometer_scale": Kind(IMU, INNOVATIONS, _scale("accelerometer")),
    "outage": Kind(GPS, AT_ONCE, _plain("outage")),
    "freeze": Kind(GPS, REPEATED_FIX, _freeze),
    "jump": Kind(GPS, INNOVATIONS, _jump),
    "drift": Kind(GPS, INNOVATIONS, _drift),
    "delay": Kind(GPS, INNOVATIONS, _delay),
    "bias": Kind(STARS, INNOVATIONS, _turned),
    "wrong_fixes": Kind(STARS, INNOVATIONS, _wrong),
    "blinded": Kind(STARS, AT_ONCE, _plain("blinded")),
}


class Drawn(NamedTuple):
    """One or two faults."""

    kinds: tuple  # names
    sizes: tuple  # sigma
    windows: tuple  # happenings.Window of each
    settings: tuple  # KEY=VALUE
    alone: tuple  # KEY=VALUE of each of them by itself
    happenings: tuple  # happenings.Happening of each, for what shows


def drawn(scenario, start_s, end_s, seed):
    """Drawn of a flight. Scenario, s, s, int"""
    rng = np.random.default_rng([seed, RANDOM_KEY])
    names = [name for name, one in KINDS.items() if one.device != STARS or scenario.star_tracker.enabled]
    kinds, sizes, windows, alone, rows, what = [], [], [], [], {}, []
    for _ in range(int(rng.integers(1, 3))):
        name, kind = (chosen := names[int(rng.integers(len(names)))]), KINDS[chosen]
        size, lasts_s = (float(np.exp(rng.uniform(*np.log(pair)))) for pair in (LEVELS, LASTS_S))
        begin_s = round(float(rng.uniform(start_s, end_s - 1.0)), 3)
        window = happenings.Window(begin_s, round(begin_s + lasts_s, 3))
        fault = kind.make(scenario, rng, size)
        words = happenings.flow(fault, window)
        rows.setdefault(kind.device, []).append(words)
        alone.append((f"faults.{kind.device}=[{words}]",))
        what.append(happenings.Happening(_words(fault), kind.device, shows=kind.shows))
        kinds.append(name)
        sizes.append(round(size, 3))
        windows.append(window)
    settings = tuple(f"faults.{device}=[{', '.join(found)}]" for device, found in rows.items())
    return Drawn(tuple(kinds), tuple(sizes), tuple(windows), settings, tuple(alone), tuple(what))


def _words(fault):
    """Kind and sensor of a fault, which says how often its readings repeat."""
    return " ".join(filter(None, (fault.get("sensor"), fault["fault"])))
