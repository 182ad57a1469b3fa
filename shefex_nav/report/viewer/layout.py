"""What the viewer shows where."""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import wgs84
from shefex_nav.report import metrics

TIMELINE = "mission_time"
FRAME_SHOWN_S = 0.15  # a picture disappears this long after the last one
SMALLEST_SCENE_M = 20e3  # of a vehicle that stands still
AXES = 0.075  # drawn body axes, by the size of the scene: true to scale they would be invisible
FRUSTUM = 0.11  # drawn field of view of the star camera likewise
NAME = 0.09  # least distance of two events that are named


class ErrorPlot(NamedTuple):
    """One plot of an error inside its sigmas."""

    entity: str
    title: str


ERROR_PLOTS = tuple(  # order of NavCovariance.P
    ErrorPlot(f"plots/errors/{quantity}_{axis}", f"{quantity} error {axis} [{unit}]")
    for quantity, unit in (("position", "m"), ("velocity", "m/s"), ("attitude", "deg"))
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


def blueprint(data, seen, *, pictures):
    """rerun blueprint of the recording of `viewer.build_recording`.

    `seen` is the Scene. `pictures`: entities of the pictures that the log has; those with their background at
    zero, of every frame, come first, then the frames as read out.
    """
    import rerun.blueprint as rrb

    upper = rrb.Horizontal(_cameras(pictures), _trajectory(seen), _side(data), column_shares=[5, 6, 4])
    lower = rrb.Tabs(_errors(data), _curves(data), active_tab=0)
    return rrb.Blueprint(
        rrb.Vertical(upper, lower, row_shares=[9, 10]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        collapse_panels=False,
    )


def _whole_flight(data):
    """Time axis over the whole log."""
    import rerun.blueprint as rrb

    if not len(data.truth.t_s):
        return None
    start, end = data.truth.t_s[[0, -1]].tolist()
    boundary = rrb.TimeRangeBoundary.absolute
    return rrb.TimeAxis(
        view_range=rrb.TimeRange(start=boundary(seconds=start), end=boundary(seconds=end)),
    )


def _cameras(pictures):
    """A tab for each kind of pictures; without any the marks alone, and a name that says so."""
    import rerun.blueprint as rrb

    names = {"star_tracker/image": "Star camera", "star_tracker/image_full": "Star camera, as read out"}
    views = [_star_camera(entity, name) for entity, name in names.items() if entity in pictures]
    return rrb.Tabs(*(views or [_star_camera("stars", "Detections; this log has no pictures")]), active_tab=0)


def _star_camera(entity, name):
    import rerun.blueprint as rrb

    return rrb.Spatial2DView(origin=entity, contents=["$origin", "stars/**"], name=name)


def _trajectory(seen):
    """The flight, seen from its right, behind and above."""
    import rerun.blueprint as rrb

    right = np.array([seen.along[1], -seen.along[0], 0.0])
    away = 0.85 * right - 0.33 * seen.along + np.array([0.0, 0.0, 0.4])
    is_round = seen.size > wgs84.A  # around the Earth: there is as much above and below as along
    eye = seen.middle + seen.size * (1.4 if is_round else 1.0) * away
    return rrb.Spatial3DView(
        origin="/",
        contents=["world/**", "tf", "star_tracker/calibration"],
        name="Flight, launch axes east-north-up",
        background=[10, 13, 18],
        line_grid=False,
        spatial_information=rrb.SpatialInformation(target_frame="launch"),
        eye_controls=rrb.EyeControls3D(
            position=eye.tolist(), look_target=seen.middle.tolist(), eye_up=[0.0, 0.0, 1.0]
        ),
    )


def _side(data):
    import rerun.blueprint as rrb

    return rrb.Vertical(
        rrb.StateTimelineView(origin="states", name="States", time_view=_whole_flight(data)),
        rrb.Tabs(
            rrb.TextLogView(
                origin="log",
                name="Events",
                columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
                rows=rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "ERROR", "CRITICAL"]),
            ),
            rrb.TextDocumentView(origin="summary", name="Figures"),
            active_tab=0,
        ),
        row_shares=[3, 4],
    )


def _errors(data):
    import rerun.blueprint as rrb

    limits = _error_limits(data)
    views = [
        rrb.TimeSeriesView(
            origin=plot.entity,
            name=plot.title,
            axis_x=_whole_flight(data),
            axis_y=rrb.ScalarAxis(range=(-limit, limit)) if limit else None,
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for plot, limit in zip(ERROR_PLOTS, limits, strict=True)
    ]
    return rrb.Grid(*views, grid_columns=3, name="Errors (blue) against 3 sigma (red)")


def _error_limits(data):
    """Half height of each error plot: the better part of the flight is seen well, spikes are cut off. (9,)"""
    errors = metrics.navigation_errors(data)
    t_s, _, sigma = metrics.normalised_errors(data, errors)
    if not np.any(t_s > 0.0):
        return [None] * len(ERROR_PLOTS)
    limits = 2.5 * np.percentile(3.0 * sigma[t_s > 0.0], 60, axis=0)
    limits[6:] = np.degrees(limits[6:])
    return [_readable(limit) for limit in limits]


def _readable(value):
    """Nearest of 1.2, 2.4, 12 ...: rerun numbers powers of ten and their multiples, just inside these."""
    power = 10.0 ** np.floor(np.log10(value))
    steps = power * np.array([1.2, 2.4, 12.0])
    return float(steps[np.argmin(np.abs(np.log(steps / value)))])


def _curves(data):
    import rerun.blueprint as rrb

    plots = [
        ("height", "Height [km]"),
        ("speed", "Speed against the Earth [m/s]"),
        ("roll_rate", "Roll rate [1/s]"),
        ("stars", "Stars in the frame"),
    ]
    if len(data.control.t_s):
        plots += [("pointing", "Pointing error [deg]"), ("gas", "Cold gas used [kg]")]
    views = [
        rrb.TimeSeriesView(origin=f"plots/{entity}", name=title, axis_x=_whole_flight(data))
        for entity, title in plots
    ]
    return rrb.Grid(*views, grid_columns=len(plots) // 2, name="Flight and stars")
