"""Figures of a run that are compared: those of its summary (`report.metrics`), and which way is better."""

import math
from typing import NamedTuple

from shefex_nav.clock import TICK_HZ
from shefex_nav.report import innovations, requirements, sensor_use
from shefex_nav.report.navigation_errors import NEES_DOF

SMALLER, LARGER, NEARER, NEITHER = "smaller", "larger", "nearer", "neither"


class Quantity(NamedTuple):
    """One figure of a run."""

    name: str
    unit: str
    figure: (
        object  # function of `get`, which gives the value at a dotted path of the summary -> float or None
    )
    better: str = SMALLER  # or NEITHER: it has no verdict
    target: float = NEES_DOF  # of what should be near it
    timed: bool = False  # of the whole simulation: not compared where one wrote a log and one did not
    wall: bool = False  # measured in wall time, in which two sides are not flown at once: no verdict
    spoken: bool = False  # over the ticks that have a solution: no verdict where one side has fewer

    def compared(self, value):
        """The number whose difference is told: the value, or how far it is from what it should be."""
        if self.better == NEARER:
            return abs(math.log(value / self.target)) if value > 0.0 else math.inf
        return value


def _at(path, factor=1.0):
    def figure(get):
        value = get(path)
        return None if value is None else factor * value

    return figure


def _star_fixes(get):
    solved, frames = get("star_tracker.solved"), get("star_tracker.in_window")
    return 100.0 * solved / frames if frames else None


def _tick_ms(get):
    """Wall time of the whole simulation over its ticks."""
    wall_s, simulated_s = get("wall_s"), get("simulated_s")
    return 1e3 * wall_s / (simulated_s * TICK_HZ) if wall_s and simulated_s else None


_NAV = "navigation."
_AIDED = _NAV + "star_aided."
SOLUTION_SHARE = _NAV + "solution_share"
NEES = Quantity(f"NEES, stars to entry, {NEES_DOF} expected", "", _at(_NAV + "nees.mean"), NEARER)
QUANTITIES = (
    Quantity("position at entry", "m", _at(_NAV + "at_entry.position_error_m")),
    Quantity("velocity at entry", "m/s", _at(_NAV + "at_entry.velocity_error_m_s")),
    Quantity("attitude at entry, size", "deg", requirements.together(_NAV + "at_entry.attitude_error_deg")),
    Quantity("position, rms of the star phase", "m", _at(_NAV + "star_phase.position_rms_m"), spoken=True),
    Quantity(
        "velocity, rms of the star phase", "m/s", _at(_NAV + "star_phase.velocity_rms_m_s"), spoken=True
    ),
    Quantity(
        "attitude, rms of the star phase", "deg", _at(_NAV + "star_phase.attitude_rms_deg"), spoken=True
    ),
    Quantity("position, rms after two star fixes", "m", _at(_AIDED + "position_m.rms"), spoken=True),
    Quantity("velocity, rms after two star fixes", "m/s", _at(_AIDED + "velocity_m_s.rms"), spoken=True),
    Quantity("attitude, rms after two star fixes", "deg", _at(_AIDED + "attitude_deg.rms"), spoken=True),
    Quantity("position, rms of the run", "m", _at(_NAV + "position_error_m.rms"), spoken=True),
    Quantity("velocity, rms of the run", "m/s", _at(_NAV + "velocity_error_m_s.rms"), spoken=True),
    Quantity("attitude, rms of the run", "deg", _at(_NAV + "attitude_error_deg.rms"), spoken=True),
    Quantity("position, largest", "m", _at(_NAV + "position_error_m.max"), spoken=True),
    Quantity("velocity, largest", "m/s", _at(_NAV + "velocity_error_m_s.max"), spoken=True),
    Quantity("attitude, largest", "deg", _at(_NAV + "attitude_error_deg.max"), spoken=True),
    NEES,
    Quantity("ticks with a solution", "%", _at(SOLUTION_SHARE, 100.0), LARGER),
    Quantity("usable, of the time", "%", _at(_NAV + "integrity.usable_share", 100.0), LARGER),
    Quantity("misleading, of the time", "%", _at(_NAV + "integrity.misleading_share", 100.0)),
    Quantity(
        "star fixes across the boresight, rms", "arcsec", _at("star_tracker.error_arcsec.cross_axis_rms")
    ),
    Quantity("star fixes of the window", "%", _star_fixes, LARGER),
    Quantity("wrong star fixes", "", _at("star_tracker.wrong")),
    Quantity("time per star frame", "ms", _at("star_tracker.chain_ms.median"), wall=True),
    Quantity("time per tick, with the simulator", "ms", _tick_ms, timed=True, wall=True),
)


def _used(sensor):
    return lambda get: sensor_use.fate(get, sensor)[0]


def _refused(sensor):
    def figure(get):
        share = sensor_use.refused_share(get, sensor)
        return None if share is None else 100.0 * share

    return figure


def of_sensor(sensor, lasting=()):
    """Quantities of what became of the measurements of a sensor, and of their NIS.

    lasting : names of sensors whose errors last in the scenarios that are compared
    """
    name, lasts = sensor_use.named(sensor), innovations.errors_last(sensor) or sensor in lasting
    yield Quantity(f"{name}, used", "", _used(sensor), NEITHER)
    yield Quantity(f"{name}, refused", "%", _refused(sensor), NEITHER)
    yield Quantity(
        f"NIS, {name}, {'below 1' if lasts else '1'} expected",
        "",
        _at(f"{_NAV}nis.{sensor}.per_dof"),
        NEITHER if lasts else NEARER,
        target=1.0,
    )
