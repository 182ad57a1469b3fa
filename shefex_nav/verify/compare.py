"""A flight against the trajectories of the simulators: differences, the simulators' own spread, the verdict.

In: a `History`, the `Series` of the simulators. Out: a `Comparison` per quantity.

A quantity is good when it differs from no simulator by more than they differ among themselves, plus its
tolerance: that stated for its case, or else a floor. To a stated tolerance it has to keep against one
simulator at least. No more can be asked: in case 03 some simulators damp the rates relative to the Earth, as
the model has it, others the inertial ones, and end 0.09 deg apart.
"""

import math
from itertools import combinations
from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.verify.data import on_grid
from shefex_nav.verify.daveml import FOOT, SLUG

DEG = math.pi / 180.0
POUND = 0.45359237 * STANDARD_GRAVITY  # N, pound-force
TABLES_END_M = 86.0e3  # above it, simulators go on with air of their own


class Quantity(NamedTuple):
    """What is compared, and how it stands in the trajectory files."""

    column: str
    unit: str
    si: float  # of one such unit
    floor: float  # in that unit
    angle: bool = False  # differs by the shorter way round
    air: bool = False  # compared below TABLES_END_M only


class Tolerance(NamedTuple):
    """What a difference may be."""

    value: float  # in the unit of the quantity; of the value itself where it is relative
    relative: bool = False
    at_s: tuple = ()  # at these instants; empty: always


class Comparison(NamedTuple):
    """One quantity of one case."""

    quantity: Quantity
    t_s: np.ndarray  # (n,)
    differences: dict  # simulator -> (n,) in the unit of the quantity; NaN where it has no row
    apart: np.ndarray  # (n,) largest difference between two simulators; NaN for one
    tolerance: Tolerance
    allowed: np.ndarray  # (n,) what the tolerance is at each instant; NaN where it does not count
    ok: bool

    @property
    def against(self):
        """Largest difference from each simulator: {simulator: number}."""
        return {name: float(np.nanmax(np.abs(d))) for name, d in self.differences.items()}

    @property
    def spread(self):
        """Largest difference between two simulators; None for one."""
        return None if np.all(np.isnan(self.apart)) else float(np.nanmax(self.apart))


QUANTITIES = {
    "altitude": Quantity("altitudeMsl_ft", "ft", FOOT, 0.02),
    "latitude": Quantity("latitude_deg", "deg", DEG, 1e-7),
    "longitude": Quantity("longitude_deg", "deg", DEG, 1e-7, angle=True),
    "yaw": Quantity("eulerAngle_deg_Yaw", "deg", DEG, 0.01, angle=True),
    "pitch": Quantity("eulerAngle_deg_Pitch", "deg", DEG, 0.01),
    "roll": Quantity("eulerAngle_deg_Roll", "deg", DEG, 0.01, angle=True),
    "roll_rate": Quantity("bodyAngularRateWrtEi_deg_s_Roll", "deg/s", DEG, 0.005),
    "pitch_rate": Quantity("bodyAngularRateWrtEi_deg_s_Pitch", "deg/s", DEG, 0.005),
    "yaw_rate": Quantity("bodyAngularRateWrtEi_deg_s_Yaw", "deg/s", DEG, 0.005),
    "velocity_north": Quantity("feVelocity_ft_s_X", "ft/s", FOOT, 0.002),
    "velocity_east": Quantity("feVelocity_ft_s_Y", "ft/s", FOOT, 0.002),
    "velocity_down": Quantity("feVelocity_ft_s_Z", "ft/s", FOOT, 0.002),
    "gravity": Quantity("localGravity_ft_s2", "ft/s^2", FOOT, 1e-6),
    "density": Quantity("airDensity_slug_ft3", "slug/ft^3", SLUG / FOOT**3, 5e-8, air=True),
    "pressure": Quantity("ambientPressure_lbf_ft2", "lbf/ft^2", POUND / FOOT**2, 0.05, air=True),
    "temperature": Quantity("ambientTemperature_dgR", "deg R", 5.0 / 9.0, 0.005, air=True),
    "speed_of_sound": Quantity("speedOfSound_ft_s", "ft/s", FOOT, 0.005, air=True),
    "mach": Quantity("mach", "", 1.0, 1e-5, air=True),
    "dynamic_pressure": Quantity("dynamicPressure_lbf_ft2", "lbf/ft^2", POUND / FOOT**2, 0.05, air=True),
}


def compare(case, history, simulators):
    """{quantity: Comparison} of a case. simulators: {name: Series}."""
    result = {}
    for name, quantity in QUANTITIES.items():
        ours = history.values[name] / quantity.si
        if not np.all(np.isfinite(ours)):
            raise ArithmeticError(f"case {case}: the flight has no finite {name}")
        theirs = {s: on_grid(series, history.t_s, quantity.column) for s, series in simulators.items()}
        low = history.height_m <= TABLES_END_M if quantity.air else np.full(ours.size, True)
        theirs = {s: np.where(low, column, np.nan) for s, column in theirs.items() if column is not None}
        theirs = {s: column for s, column in theirs.items() if not np.all(np.isnan(column))}
        if theirs:
            result[name] = _comparison(STATED.get((case, name)), quantity, history.t_s, ours, theirs)
    return result


def _comparison(stated, quantity, t_s, ours, theirs):
    differences = {s: _less(ours, column, quantity) for s, column in theirs.items()}
    pairs = [np.abs(_less(theirs[a], theirs[b], quantity)) for a, b in combinations(theirs, 2)]
    apart = np.fmax.reduce(pairs) if pairs else np.full(t_s.size, np.nan)
    tolerance = stated or Tolerance(quantity.floor)
    allowed = _allowed(tolerance, ours, t_s)
    wide = allowed + (np.nan_to_num(apart) if pairs else 0.0)
    near = stated is None or any(_keeps(d, allowed) for d in differences.values())
    ok = near and all(_keeps(d, wide) for d in differences.values())
    return Comparison(quantity, t_s, differences, apart, tolerance, allowed, ok)


def _allowed(tolerance, ours, t_s):
    """What a difference may be at each instant: (n,); NaN where it may be anything."""
    allowed = tolerance.value * np.abs(ours) if tolerance.relative else np.full(ours.size, tolerance.value)
    if tolerance.at_s:
        near = np.min(np.abs(t_s[:, None] - np.array(tolerance.at_s)), axis=1) < SAME_S
        allowed = np.where(near, allowed, np.nan)
    return allowed


def _keeps(difference, allowed):
    """True when a difference stays within what is allowed; at single instants it also has to be there."""
    counts = ~np.isnan(allowed)
    there = counts & ~np.isnan(difference)
    enough = there.any() and (counts.all() or np.array_equal(there, counts))
    return bool(enough and np.all(np.abs(difference[there]) <= allowed[there]))


def _less(a, b, quantity):
    """a - b; of angles in degrees, within +-180."""
    return (a - b + 180.0) % 360.0 - 180.0 if quantity.angle else a - b


_MOMENTS = (50.0, 100.0, 150.0, 200.0)
_ROCKET = {  # 0.1 % of the largest value in the flight, or what 0.1 % of the final altitude makes of it
    "longitude": 5e-3,
    "pitch_rate": 0.02,
    "velocity_east": 26.0,
    "velocity_down": 26.0,
    "gravity": 2.5e-3,
    "density": 2.4e-6,
    "pressure": 2.1,
    "temperature": 0.5,
    "speed_of_sound": 1.1,
    "mach": 0.01,
    "dynamic_pressure": 20.0,
}
STATED = {
    ("01", "altitude"): Tolerance(1e-5),
    **{("02", angle): Tolerance(0.01) for angle in ("yaw", "pitch", "roll")},
    **{("03", angle): Tolerance(0.05) for angle in ("yaw", "pitch", "roll")},
    **{(case, "altitude"): Tolerance(0.02) for case in ("04", "05", "06", "07", "08")},
    **{(case, "altitude"): Tolerance(0.5) for case in ("09", "10")},
    ("17", "altitude"): Tolerance(1e-3, relative=True, at_s=_MOMENTS),
    ("17", "pitch"): Tolerance(0.1, at_s=_MOMENTS),
    **{("17", name): Tolerance(value) for name, value in _ROCKET.items()},
}
