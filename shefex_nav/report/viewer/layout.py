"""What the viewer shows where."""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import wgs84
from shefex_nav.report import metrics
from shefex_nav.report.viewer.sender import TIMELINE

FRAME_SHOWN_S = 0.15  # a picture disappears this long after the last one
SMALLEST_SCENE_M = 20e3  # of a vehicle that stands still
AXES = 0.075  # drawn body axes, by the size of the scene: true to scale they would be invisible
FRUSTUM = 0.11  # drawn field of view of the star camera likewise
MOST_NIS = 10.0  # by its limit, where marks of refused measurements end
NEES_SHOWN = 40.0  # of 9 degrees of freedom
NAME = 0.09  # least distance of two events that are named


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


class Content(NamedTuple):
    """What a log has to show; a panel without data is not laid out."""

    pictures: tuple  # entities of the pictures, those with their background at zero first
    stars: bool  # frames of the star camera were searched
    frames: bool  # there were pictures, with exposure and gain
    timed: bool  # it is known how long a frame took
    imu: bool
    gps: bool
    control: bool
    covariance: bool
    protection: bool


def content(data, pictures):
    """Content of a RunData and the kinds of pictures in its log."""
    return Content(
        tuple(pictures),
        bool(data.star_fixes),
        bool(len(data.frames.t_valid_s)),
        bool(len(data.compute_times.t_s)),
        bool(len(data.imu.t_valid_s)),
        bool(data.gps),
        bool(len(data.control.t_s)),
        bool(len(data.covariance.t_s)),
        bool(np.isfinite(data.nav.protection_b).any()),
    )


def blueprint(data, seen, has, *, page=OVERVIEW):
    """rerun blueprint of the recording of `recording.build`: a tab for each of PAGES, one of them open.

    data : RunData;  seen : Scene;  has : Content
    """
    import rerun.blueprint as rrb

    makers = {OVERVIEW: _overview, MISSION: _mission, STARS: _star_tracker, NAVIGATION: _navigation}
    makers[SENSORS] = _sensors
    pages = {name: make(data, seen, has) for name, make in makers.items()}
    pages = {name: made for name, made in pages.items() if made is not None}
    active = list(pages).index(page) if page in pages else 0
    return rrb.Blueprint(
        rrb.Tabs(*pages.values(), active_tab=active),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        collapse_panels=False,
    )


def _overview(data, seen, has):
    import rerun.blueprint as rrb

    upper = rrb.Horizontal(_cameras(has), _trajectory(seen), _side(data), column_shares=[5, 6, 4])
    lower = rrb.Tabs(_errors(data), _flight_curves(data, has), active_tab=0)
    return rrb.Vertical(upper, lower, row_shares=[9, 10], name=OVERVIEW)


def _mission(data, seen, has):
    import rerun.blueprint as rrb

    side = rrb.Vertical(_lanes(data), _texts(), row_shares=[2, 5])
    upper = rrb.Horizontal(_trajectory(seen), side, column_shares=[7, 3])
    curves = [_plot(data, f"plots/{entity}", title) for entity, title in _flight_plots(has)]
    return rrb.Vertical(upper, rrb.Horizontal(*curves), row_shares=[3, 1], name=MISSION)


def _star_tracker(data, seen, has):
    import rerun.blueprint as rrb

    if not has.stars:
        return None
    curves = [
        _plot(data, "plots/stars", "Stars in the frame", legend=True),
        _plot(data, "plots/residual", "Residual of the identified stars [px]"),
    ]
    if has.frames:
        title = "Exposure [ms], gain [dB], mean grey value"
        curves.insert(1, _plot(data, "plots/exposure", title, legend=True))
    if has.timed:
        curves.append(_plot(data, "plots/chain_time", "Time for a frame [ms]"))
    sky = rrb.Spatial2DView(
        origin="sky",
        name="Sky around the camera [deg], north up, east left",
        background=[6, 8, 16],
        visual_bounds=rrb.VisualBounds2D(x_range=[-50.0, 50.0], y_range=[-40.0, 40.0]),
    )
    side = rrb.Vertical(sky, _lanes(data), row_shares=[5, 2])
    upper = rrb.Horizontal(_cameras(has), side, column_shares=[5, 4])
    return rrb.Vertical(upper, rrb.Horizontal(*curves), row_shares=[5, 2], name=STARS)


def _navigation(data, seen, has):
    import rerun.blueprint as rrb

    nees = _plot(data, "plots/nees", "NEES of position, velocity, attitude", top=NEES_SHOWN)
    nis = _plot(data, "plots/nis", "NIS by its limit: refused above 1", legend=True)
    level = _plot(data, "plots/protection", "Protection level and error [deg]", legend=True)
    tests = [*([nees] * has.covariance), nis, *([level] * has.protection)]
    tabs = [_errors(data)]
    if has.covariance:
        views = [
            _plot(data, f"plots/biases/{name}_{axis}", f"{word} bias {axis} [{unit}]")
            for name, word, unit in (("gyro_bias", "gyro", "deg/h"), ("accel_bias", "accelerometer", "mg"))
            for axis in "xyz"
        ]
        tabs.append(rrb.Grid(*views, grid_columns=3, name="Biases as estimated (blue) with 3 sigma (red)"))
    right = rrb.Vertical(*tests, _lanes(data), row_shares=[*([3] * len(tests)), 3])
    return rrb.Horizontal(rrb.Tabs(*tabs), right, column_shares=[3, 2], name=NAVIGATION)


def _sensors(data, seen, has):
    import rerun.blueprint as rrb

    views = []
    if has.imu:
        views += [
            _plot(data, "plots/imu/rate", "Rate [deg/s]", legend=True),
            _plot(data, "plots/imu/force", "Specific force [g]", legend=True),
            _plot(
                data, "plots/imu/vibration", "Scatter of the specific force within a second [g]", legend=True
            ),
        ]
    if has.gps:
        views.append(_plot(data, "plots/gps", "GPS: satellites, dilution of precision", legend=True))
    if has.gps or has.stars:
        views.append(_plot(data, "plots/age", "Age of a measurement when it is there [ms]", legend=True))
    if not views:
        return None
    return rrb.Grid(*views, _lanes(data), grid_columns=2, name=SENSORS)


def _plot(data, entity, title, *, legend=False, top=None):
    """A plot over the whole flight, of values from zero to `top` where that is known."""
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=entity,
        name=title,
        axis_x=_whole_flight(data),
        axis_y=rrb.ScalarAxis(range=(0.0, top)) if top else None,
        plot_legend=rrb.PlotLegend(visible=legend, corner=rrb.Corner2D.LeftTop),
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


def _cameras(has):
    """A tab for each kind of pictures; without any the marks alone, and a name that says so."""
    import rerun.blueprint as rrb

    names = {"star_tracker/image": "Star camera", "star_tracker/image_full": "Star camera, as read out"}
    views = [_star_camera(entity, name) for entity, name in names.items() if entity in has.pictures]
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

    return rrb.Vertical(_lanes(data), _texts(), row_shares=[3, 4])


def _lanes(data):
    import rerun.blueprint as rrb

    return rrb.StateTimelineView(origin="states", name="States", time_view=_whole_flight(data))


def _texts():
    """What happened, and the closing figures."""
    import rerun.blueprint as rrb

    events = rrb.TextLogView(
        origin="log",
        name="Events",
        columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
        rows=rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "ERROR", "CRITICAL"]),
    )
    return rrb.Tabs(events, rrb.TextDocumentView(origin="summary", name="Figures"), active_tab=0)


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


def _flight_plots(has):
    """(entity, title) of the plots of the flight."""
    plots = [
        ("height", "Height [km]"),
        ("speed", "Speed against the Earth [m/s]"),
        ("roll_rate", "Roll rate [1/s]"),
    ]
    if has.control:
        plots += [("pointing", "Pointing error [deg]"), ("gas", "Cold gas used [kg]")]
    return plots


def _flight_curves(data, has):
    import rerun.blueprint as rrb

    plots = _flight_plots(has) + [("stars", "Stars in the frame")] * has.stars
    views = [_plot(data, f"plots/{entity}", title) for entity, title in plots]
    return rrb.Grid(*views, grid_columns=-(-len(plots) // 2), name="Flight and stars")
