"""What the viewer shows where."""

from typing import NamedTuple

import numpy as np

from shefex_nav.report import metrics

TIMELINE = "mission_time"
FRAME_SHOWN_S = 0.15  # a picture disappears this long after the last one
AXES_M = 60e3  # drawn body axes: 60 m would be invisible next to 800 km
FRUSTUM_M = 90e3  # drawn field of view of the star camera


class ErrorPlot(NamedTuple):
    """One plot of an error inside its sigmas."""

    entity: str
    title: str


ERROR_PLOTS = tuple(  # order of NavCovariance.P
    ErrorPlot(f"plots/errors/{quantity}_{axis}", f"{quantity} error {axis} [{unit}]")
    for quantity, unit in (("position", "m"), ("velocity", "m/s"), ("attitude", "deg"))
    for axis in "xyz"
)


def start_time(data):
    """Mission time worth looking at first: the middle of the star fixes, else of the flight."""
    t_s = np.array([fix.t_valid_s for fix in data.star_fixes])
    t_s = t_s if len(t_s) else data.truth.t_s
    return float(t_s[len(t_s) // 2]) if len(t_s) else 0.0


def blueprint(data, *, has_thresholded):
    """rerun blueprint of the recording of `viewer.build_recording`.

    `has_thresholded`: the log has every frame with its background at zero; else the frames as read out
    come first.
    """
    import rerun.blueprint as rrb

    pictures = rrb.Tabs(
        _star_camera("image", "Star camera"),
        _star_camera("image_full", "Star camera, as read out"),
        active_tab=0 if has_thresholded else 1,
    )
    upper = rrb.Horizontal(pictures, _trajectory(), _side(data), column_shares=[5, 6, 4])
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


def _star_camera(picture, name):
    import rerun.blueprint as rrb

    return rrb.Spatial2DView(origin=f"star_tracker/{picture}", contents=["$origin", "stars/**"], name=name)


def _trajectory():
    import rerun.blueprint as rrb

    return rrb.Spatial3DView(
        origin="/",
        contents=["world/**", "tf", "star_tracker/calibration"],
        name="Flight, launch axes east-north-up",
        background=[10, 13, 18],
        line_grid=False,
        spatial_information=rrb.SpatialInformation(target_frame="launch"),
        eye_controls=rrb.EyeControls3D(
            position=[620e3, 120e3, 330e3], look_target=[-60e3, 385e3, 10e3], eye_up=[0.0, 0.0, 1.0]
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

    views = [
        rrb.TimeSeriesView(origin=f"plots/{entity}", name=title, axis_x=_whole_flight(data))
        for entity, title in (
            ("height", "Height [km]"),
            ("speed", "Speed against the Earth [m/s]"),
            ("roll_rate", "Roll rate [1/s]"),
            ("stars", "Stars in the frame"),
        )
    ]
    return rrb.Grid(*views, grid_columns=2, name="Flight and stars")
