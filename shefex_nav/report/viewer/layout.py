"""What there is to lay out in the viewer: names of the pages, the scene, what a log has to show."""

from typing import NamedTuple

import numpy as np

FRAME_SHOWN_S = 0.15  # a picture disappears this long after the last one
SMALLEST_SCENE_M = 20e3  # of a vehicle that stands still
AXES = 0.075  # drawn body axes, by the size of the scene: true to scale they would be invisible
FRUSTUM = 0.11  # drawn field of view of the star camera likewise
MOST_NIS = 10.0  # by its limit, where marks of refused measurements end
NAME = 0.12  # least distance of two events that are named

OVERVIEW, MISSION, STARS, NAVIGATION, SENSORS = PAGES = (
    "Overview",
    "Mission",
    "Star tracker",
    "Navigation",
    "Sensors",
)


class ErrorPlot(NamedTuple):
    """One plot of an error inside its sigmas."""

    entity: str
    title: str


ERROR_PLOTS = tuple(  # order of NavCovariance.P
    ErrorPlot(f"plots/errors/{quantity}_{axis}", f"{quantity} error {which}{axis} [{unit}]")
    for quantity, which, unit in (
        ("position", "along inertial ", "m"),
        ("velocity", "along inertial ", "m/s"),
        ("attitude", "about body ", "deg"),
    )
    for axis in "xyz"
)


class Scene(NamedTuple):
    """Where the flown path lies, launch axes."""

    middle: np.ndarray  # (3,) m
    size: float  # m, greatest extent
    along: np.ndarray  # (3,) horizontal unit vector from the first point to the last


def scene(path):
    """Scene of a path (N, 3) m in launch axes."""
    low, high = path.min(axis=0), path.max(axis=0)
    along = (path[-1] - path[0]) * np.array([1.0, 1.0, 0.0])
    length = np.linalg.norm(along)
    along = along / length if length > 1.0 else np.array([0.0, 1.0, 0.0])
    return Scene(0.5 * (low + high), max(float((high - low).max()), SMALLEST_SCENE_M), along)


def start_time(data):
    """Mission time worth looking at first: the middle of the star fixes, else of the flight."""
    t_s = np.array([fix.t_valid_s for fix in data.star_fixes])
    t_s = t_s if len(t_s) else data.truth.t_s
    return float(t_s[len(t_s) // 2]) if len(t_s) else 0.0


class Content(NamedTuple):
    """What a log has to show; a panel without data is not laid out."""

    pictures: tuple  # entities of the pictures, those with their background at zero first
    stars: bool  # frames of the star camera were searched
    frames: bool  # there were pictures, with exposure and gain
    timed: bool  # it is known how long a frame took
    imu: bool
    gps: bool
    control: bool
    covariance: bool  # with numbers in it: software of a user's own may give none
    protection: bool
    instruments: tuple = ()  # names of those of which there are readings
    errors: bool = True  # there is a truth that they can be told by
    biases: bool = True  # as estimated
    gates: bool = True  # measurements were judged by what was expected of them
    satellites: bool = True  # of the fixes, their number is known


def knows_satellites(fixes):
    """Whether any of the GPS fixes says how many satellites it was made of: recorded data need not."""
    return any(fix.n_satellites > 0 for fix in fixes)


def content(data, pictures, errors=True):
    """Content of a RunData, the kinds of pictures in its log, and whether it has a truth."""
    from shefex_nav.report import trust

    return Content(
        tuple(pictures),
        bool(data.star_fixes),
        bool(len(data.frames.t_valid_s)),
        bool(len(data.compute_times.t_s)),
        bool(len(data.imu.t_valid_s)),
        bool(data.gps),
        bool(len(data.control.t_s)),
        bool(np.isfinite(data.covariance.P).any()),
        trust.has_levels(data.nav),
        tuple(name for name, said in data.readings.items() if len(said.t_valid_s)),
        errors,
        any(np.isfinite(one).any() for one in (data.covariance.gyro_bias, data.covariance.accel_bias)),
        bool(data.gates),
        knows_satellites(data.gps),
    )
