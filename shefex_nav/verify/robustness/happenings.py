"""What happens in a cell, and when: faults of the sensors for some seconds of a phase of the flight."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from shefex_nav.records import Doubt

IMU, GPS, STARS = "imu", "gps", "star_tracker"
SOURCES = {IMU: ("imu", "gyro", "accelerometer"), GPS: ("gps",), STARS: ("star_tracker", "star_vectors")}
DOUBTS = {  # that say what is wrong, besides a health that names the sensor
    IMU: (int(Doubt.IMU), int(Doubt.CONTRADICTED)),
    GPS: (int(Doubt.CONTRADICTED),),
    STARS: (int(Doubt.CONTRADICTED),),
}
AT_ONCE, REPEATS, REPEATED_FIX = "at once", "repeated readings", "a repeated fix"
SPREAD, INNOVATIONS = "spread of readings", "innovations"


class Happening(NamedTuple):
    """Something that goes wrong for a while."""

    words: str
    device: str  # IMU, GPS or STARS; empty: nothing
    # of Scenario and Generator: dict of the scenario's fault, without times; None: see `shakes`, `late_s`
    fault: Callable | None = None
    lasts_s: tuple[float, float] = (5.0, 20.0)  # drawn evenly in between
    shows: str = INNOVATIONS  # what tells it, besides the innovations
    shakes: float = 1.0  # vibration of the whole flight, over what is told
    late_s: float = 0.0  # fixes say what was true so long before


class Window(NamedTuple):
    """When something happens."""

    start_s: float
    end_s: float


def any_axis(rng):
    """Letter of an axis."""
    return "xyz"[int(rng.integers(3))]


def _sign(rng):
    return 1.0 if rng.random() < 0.5 else -1.0


def along(rng, size, unit):
    """Vector of a length, in a random direction, as a scenario has it."""
    u = rng.standard_normal(3)
    return "[" + ", ".join(f"{value:.9g} {unit}" for value in size * u / np.linalg.norm(u)) + "]"


def _beyond_range(triad, unit):
    """A reading that stays at the end of its range: something adds one and a half times that."""
    key, name = ("rate", "gyro") if triad == "gyro" else ("acceleration", "accelerometer")

    def fault(scenario, rng):
        most = getattr(scenario.imu, name).range
        if not np.isfinite(most):
            most = np.radians(2000.0) if name == "gyro" else 400.0
        size = f"{_sign(rng) * 2.5 * most:.9g} {unit}"
        return {"fault": f"{name}_bias", "axis": any_axis(rng), key: size}

    return fault


def _stuck(rng, kind, sensor):
    return {"fault": kind, "sensor": sensor, "axis": any_axis(rng)}


def _biased(scenario, rng, sensor, sigmas):
    """Another bias, by so many sigmas of what is told of it."""
    triad, key = getattr(scenario.imu, sensor), "rate" if sensor == "gyro" else "acceleration"
    size = _sign(rng) * sigmas * float(np.hypot(triad.bias, triad.in_run_bias))
    unit = "rad/s" if sensor == "gyro" else "m/s2"
    return {"fault": f"{sensor}_bias", "axis": any_axis(rng), key: f"{size:.9g} {unit}"}


def _scaled(scenario, rng, sigmas):
    size = _sign(rng) * sigmas * scenario.imu.gyro.scale_factor_roll
    return {"fault": "gyro_scale", "axis": "x", "factor": f"{100.0 * size:.9g} %"}


def _drift(rng, rate, velocity_too):
    row = {"fault": "drift", "rate": along(rng, rate, "m/s")}
    return row | ({"velocity_too": True} if velocity_too else {})


def _jump(rng, size):
    return {"fault": "jump", "position": along(rng, size, "m")}


def _turned_stars(rng):
    return {"fault": "bias", "angles": along(rng, 0.2, "deg")}


LONG, SHORT = (10.0, 30.0), (0.05, 0.05)
HAPPENS = {
    "nothing": Happening("nothing", ""),
    "gyro_saturated": Happening(
        "a gyro at the end of its range", IMU, _beyond_range("gyro", "rad/s"), (0.5, 3.0), AT_ONCE
    ),
    "accelerometer_saturated": Happening(
        "an accelerometer at the end of its range", IMU, _beyond_range("accelerometer", "m/s2"), (0.5, 3.0),
        AT_ONCE,
    ),
    "gyro_stuck": Happening("a gyro stuck", IMU, lambda s, r: _stuck(r, "stuck", "gyro"), shows=REPEATS),
    "accelerometer_dead": Happening(
        "an accelerometer that reads zero", IMU, lambda s, r: _stuck(r, "dead", "accelerometer"),
        shows=REPEATS,
    ),
    "gyro_bias": Happening(
        "the bias of a gyro off by 30 sigma", IMU, lambda s, r: _biased(s, r, "gyro", 30.0), LONG
    ),
    "accelerometer_bias": Happening(
        "the bias of an accelerometer off by 30 sigma", IMU,
        lambda s, r: _biased(s, r, "accelerometer", 30.0), LONG,
    ),
    "gyro_scale": Happening(
        "the scale factor of the roll gyro off by 30 sigma", IMU, lambda s, r: _scaled(s, r, 30.0), LONG
    ),
    "imu_gap": Happening("no IMU samples for 50 ms", IMU, lambda s, r: {"fault": "dropout"}, SHORT, AT_ONCE),
    "imu_repeat": Happening(
        "the same IMU samples for 50 ms", IMU, lambda s, r: {"fault": "repeat"}, SHORT, AT_ONCE
    ),
    "gps_frozen": Happening(
        "a receiver that repeats itself", GPS, lambda s, r: {"fault": "freeze"}, LONG, REPEATED_FIX
    ),
    "gps_delayed": Happening("fixes of half a second before", GPS, lasts_s=LONG, late_s=0.5),
    "gps_drift": Happening("position drifts at 2 m/s", GPS, lambda s, r: _drift(r, 2.0, False), (15.0, 40.0)),
    "gps_drift_velocity": Happening(
        "position and velocity drift at 2 m/s", GPS, lambda s, r: _drift(r, 2.0, True), (15.0, 40.0)
    ),
    "gps_jump_30m": Happening("position jumps by 30 m", GPS, lambda s, r: _jump(r, 30.0), LONG),
    "gps_jump_300m": Happening("position jumps by 300 m", GPS, lambda s, r: _jump(r, 300.0), LONG),
    "tracker_blinded": Happening(
        "star camera blinded", STARS, lambda s, r: {"fault": "blinded"}, LONG, AT_ONCE
    ),
    "wrong_star_fixes": Happening(
        "every tenth star fix wrong by 0.5 deg or more", STARS,
        lambda s, r: {"fault": "wrong_fixes", "every": 10, "smallest": "0.5 deg", "largest": "180 deg"}, LONG,
    ),
    "star_bias": Happening("star fixes turned by 0.2 deg", STARS, lambda s, r: _turned_stars(r), LONG),
    "vibration_5x": Happening("vibration five times the told", IMU, shows=SPREAD, shakes=5.0),
}  # fmt: skip

PHASES = ("pad", "boost", "coast", "quiet", "descent")


def phases(events, start_s, end_s, star_window=None):
    """Windows of the phases of a flight.

    Parameters
    ----------
    events : list of Event
    start_s, end_s : of what is flown
    star_window : (from, until) of the star tracker, s; None without

    Returns
    -------
    dict, name -> Window; of a flight without burn-out or apogee, thirds stand for what it lacks
    """
    at = {event.name: event.t_s for event in reversed(events)}  # the first of each name
    lift_off = at.get("lift_off", start_s + 0.1 * (end_s - start_s))
    burn_out = at.get("burn_out_1", lift_off + 0.2 * (end_s - lift_off))
    apogee = at.get("apogee", 0.5 * (burn_out + end_s))
    quiet = star_window or (apogee - 0.3 * (apogee - burn_out), apogee + 0.3 * (end_s - apogee))
    quiet = max(quiet[0], burn_out), min(quiet[1], end_s - 10.0)
    down = at.get("entry", at.get("altitude_60km", apogee + 0.6 * (end_s - apogee)))
    found = {
        "pad": (start_s + 1.0, lift_off),
        "boost": (lift_off, burn_out),
        "coast": (burn_out, quiet[0]),
        "quiet": quiet,
        "descent": (down - 20.0, min(down + 20.0, end_s - 5.0)),
    }
    return {name: Window(*pair) for name, pair in found.items()}


def drawn(happening, phase, rng):
    """When a happening begins and ends, evenly over a phase. -> Window"""
    lasts_s = rng.uniform(*happening.lasts_s)
    start_s = rng.uniform(phase.start_s, max(phase.start_s, phase.end_s - min(lasts_s, 5.0)))
    return Window(round(start_s, 2), round(start_s + lasts_s, 2))


def settings(happening, scenario, window, rng):
    """KEY=VALUE of the world in which it happens: list of str."""
    from shefex_nav.verify.robustness import factors

    if happening.shakes != 1.0:
        return factors.shaken(scenario, happening.shakes)
    if happening.fault is None:
        return []
    return [f"faults.{happening.device}=[{flow(happening.fault(scenario, rng), window)}]"]


def flow(fault, window):
    """A fault of a scenario as flow YAML."""
    row = fault | {"from": f"{window.start_s:.9g} s", "until": f"{window.end_s:.9g} s"}
    return "{" + ", ".join(f"{key}: {_plain(value)}" for key, value in row.items()) + "}"


def _plain(value):
    return str(value).lower() if isinstance(value, bool) else value
