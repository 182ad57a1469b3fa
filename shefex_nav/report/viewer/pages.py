"""The pages of the viewer: which view stands where, and what each shows.

This file imports rerun; who wants to know what there is to show asks `layout`.
"""

import numpy as np
import rerun.blueprint as rrb

from shefex_nav.geometry import wgs84
from shefex_nav.instruments import TABLE
from shefex_nav.records import protected
from shefex_nav.report import trust
from shefex_nav.report.figures import series
from shefex_nav.report.navigation_errors import navigation_errors, normalised_errors
from shefex_nav.report.viewer import legend, world
from shefex_nav.report.viewer.layout import (
    ERROR_PLOTS,
    MISSION,
    MOST_NIS,
    NAVIGATION,
    OVERVIEW,
    SENSORS,
    STARS,
)
from shefex_nav.report.viewer.sender import TIMELINE

NEES_SHOWN = 40.0  # of 9 degrees of freedom
STARS_MARGIN_S = 5.0  # shown before the first and after the last star fix
WINDOW_S = 60.0  # of the curves of a log that grows
COLUMNS = 3  # of plots: in narrower ones rerun writes no more than one time below the axis
BETTER_PART, ABOVE = 60, 2.5  # percent of the bounds, and how far above these a scale ends
NO_ROLL = 1e-3  # deg/s
_ERRORS = "Errors (blue) against 3 sigma (red)"


def blueprint(data, seen, has, *, page=OVERVIEW):
    """rerun blueprint of the recording of `recording.build`: a tab for each of PAGES, one of them open.

    data : RunData;  seen : Scene;  has : Content
    """
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


def following(made):
    """The blueprint of a log that grows: the time goes on with it, curves keep the last minute in sight."""
    boundary = rrb.TimeRangeBoundary.cursor_relative
    minute = rrb.TimeRange(start=boundary(seconds=-WINDOW_S), end=boundary(seconds=0.0))
    titles = {plot.entity: plot.title for plot in ERROR_PLOTS}  # nothing is cut off
    for view in _views(made.root_container):
        if isinstance(view, rrb.TimeSeriesView | rrb.StateTimelineView):
            view.properties = {**view.properties, "TimeAxis": rrb.TimeAxis(view_range=minute)}
            view.properties.pop("ScalarAxis", None)  # nobody knows yet how much it will be
            view.name = titles.get(view.origin, view.name)
    made.time_panel = rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="following")
    return made


def _views(container):
    """All views in a container."""
    for one in container.contents:
        yield from _views(one) if isinstance(one, rrb.Container) else [one]


def _grid(views, name=None):
    """Views in rows of COLUMNS, four of them in rows of two: no more than one cell stays empty."""
    columns = 2 if len(views) == 4 else min(len(views), COLUMNS)
    return rrb.Grid(*views, grid_columns=columns, name=name)


def _overview(data, seen, has):
    side = rrb.Vertical(_lanes(data), _texts(OVERVIEW), row_shares=[12, 9])
    cameras = [_cameras(data, has)] if has.stars or has.pictures else []
    upper = rrb.Horizontal(*cameras, _trajectory(seen, has), side, column_shares=[*[5] * len(cameras), 6, 4])
    if not has.errors:
        return rrb.Vertical(upper, _flight_curves(data, has), row_shares=[2, 1], name=OVERVIEW)
    lower = rrb.Tabs(_grid(_errors(data), _ERRORS), _flight_curves(data, has))
    return rrb.Vertical(upper, lower, row_shares=[9, 10], name=OVERVIEW)


def _mission(data, seen, has):
    side = rrb.Vertical(_lanes(data), _texts(MISSION), row_shares=[6, 7])
    upper = rrb.Horizontal(_trajectory(seen, has), side, column_shares=[2, 1])
    return rrb.Vertical(upper, _grid(_flight_views(data, has)), row_shares=[3, 2], name=MISSION)


def _star_tracker(data, seen, has):
    if not has.stars:
        return None
    plots = [
        ("stars", _stars_title(data), None),
        ("residual", "Residual of the identified stars [px]", None),
    ]
    if has.frames:
        title = "Exposure [ms] yellow, gain [dB] blue, sky [% of full] grey"
        plots.insert(1, ("exposure", title, None))
    if has.timed:
        plots.append(("chain_time", "Time for a frame [ms]", None))
    span = _star_time(data)
    curves = [_plot(data, f"plots/{entity}", title, span=span, top=top) for entity, title, top in plots]
    sky = rrb.Spatial2DView(
        origin="sky",
        name="Sky around the camera [deg], north up, east left",
        background=[6, 8, 16],
        visual_bounds=rrb.VisualBounds2D(x_range=[-50.0, 50.0], y_range=[-40.0, 40.0]),
    )
    side = rrb.Vertical(sky, _lanes(data), row_shares=[5, 4])
    upper = rrb.Horizontal(_cameras(data, has), side, _legend(STARS), column_shares=[6, 5, 4])
    return rrb.Vertical(upper, rrb.Horizontal(*curves), row_shares=[5, 2], name=STARS)


def _stars_title(data):
    """Of the plot of the stars; it says at which number the table of detections was full."""
    words = "Stars: detected (orange), identified (green)"
    limit = legend.limit_of(data)
    return f"{words}; {limit.most} at most" if limit and limit.reached else words


def _navigation(data, seen, has):
    nees = _plot(data, "plots/nees", "NEES; 95 % between the red lines", top=NEES_SHOWN)
    nis = _plot(
        data, "plots/nis", "NIS over its limit; dot: used, cross: refused or held", top=_nis_shown(data)
    )
    position, velocity, *attitude = _levels(data, has) or (None, None)
    if has.errors:
        tests, name = [*_errors(data), *([nees] * has.covariance)], f"{_ERRORS}, consistency"
    else:
        tests, name = [], "Consistency"
    tests += [*([nis] * has.gates), *attitude]
    lower = _lanes(data), _legend(NAVIGATION)
    if has.protection and has.errors:  # a row of five leaves no room for numbers
        lower = rrb.Horizontal(rrb.Tabs(*lower, active_tab=0), position, velocity)
    else:
        tests += [position, velocity] * has.protection
        lower = rrb.Horizontal(*lower, column_shares=[3, 2])
    tabs = [_grid(tests, name)] if tests else []
    if has.biases:
        views = [
            _plot(data, f"plots/biases/{name}_{axis}", f"{word} bias {axis}, body [{unit}]")
            for name, word, unit in (("gyro_bias", "gyro", "deg/h"), ("accel_bias", "accelerometer", "mgee"))
            for axis in "xyz"
        ]
        tabs.append(_grid(views, "Biases as estimated (blue), 3 sigma (red)"))
    upper = [rrb.Tabs(*tabs, active_tab=0)] if tabs else []
    return rrb.Vertical(*upper, lower, row_shares=[7, 3] if upper else None, name=NAVIGATION)


def _levels(data, has):
    """A plot of the protection levels of each quantity; its title says what its scale cuts off."""
    white = "; error white" if has.errors else ""
    plots = []
    for quantity, (unit, factor) in trust.SHOWN.items() if has.protection else ():
        levels = factor * protected(data.nav, quantity).level
        most = np.where(np.isfinite(levels), levels, 0.0).max(axis=1)
        top, cut = _better_part(most, float(most.max()))
        plots.append(
            _plot(data, f"plots/protection/{quantity}", f"Level, {quantity}{white} [{unit}]{cut}", top=top)
        )
    return plots


def _better_part(sizes, largest):
    """Upper end of a scale that suits the better part of sizes (n,), and words about what it cuts off."""
    known = sizes[sizes > 0.0]
    if not len(known):
        return None, ""
    limit = _readable(ABOVE * np.percentile(known, BETTER_PART))
    return (limit, _cut_off(largest)) if largest > limit else (None, "")


def _cut_off(largest):
    """Words about what a scale cuts off."""
    return f"; peak {largest:.0f} is cut off" if largest > 99.5 else f"; peak {largest:.2g} is cut off"


def _nis_shown(data):
    """Upper end of the scale of NIS over its limit: above one, up to MOST_NIS."""
    shares = [gate.nis / gate.limit for gate in data.gates if gate.limit]
    return max(1.2, _largest(np.minimum(shares, MOST_NIS)))


def _sensors(data, seen, has):
    views = []
    if has.imu:
        for entity, title in (
            ("rate", "Rate about body x, y, z [deg/s]"),
            ("force", "Specific force along body x, y, z [gee]"),
            ("vibration", "Scatter of the specific force within a second, body axes [gee]"),
        ):
            views.append(_plot(data, f"plots/imu/{entity}", title, legend="RightTop"))
    if has.satellites:
        views.append(_plot(data, "plots/gps", "GPS: satellites, dilution of precision", legend="LeftTop"))
    for name in has.instruments:
        for plot in TABLE[name].plots:
            title = f"{plot.title} [{plot.unit}]" if plot.unit else plot.title
            views.append(_plot(data, f"plots/{name}/{plot.name}", title, legend="LeftTop"))
    if has.gps or has.stars:
        views.append(
            _plot(data, "plots/age", "Age of a measurement when it is there [ms]", legend="LeftBottom")
        )
    if not views:
        return None
    side = rrb.Tabs(_lanes(data), _legend(SENSORS), active_tab=0)
    return rrb.Grid(*views, side, grid_columns=2, name=SENSORS)


def _plot(data, entity, title, *, legend=None, top=None, bottom=0.0, span=None):
    """A plot over the whole flight or the times `span`, of values up to `top` where that is known."""
    return rrb.TimeSeriesView(
        origin=entity,
        name=title,
        axis_x=_time_axis(data, span),
        axis_y=rrb.ScalarAxis(range=(bottom, top)) if top else None,
        plot_legend=rrb.PlotLegend(visible=legend is not None, corner=legend),
    )


def _time_axis(data, span=None):
    """Time axis over the times `span` (first, last) s, or over the whole log."""
    if not len(data.truth.t_s):
        return None
    start, end = world.time_span(data) if span is None else span
    boundary = rrb.TimeRangeBoundary.absolute
    return rrb.TimeAxis(
        view_range=rrb.TimeRange(start=boundary(seconds=start), end=boundary(seconds=end)),
    )


def _star_time(data):
    """(first, last) s in which the star tracker works."""
    t_s = [fix.t_valid_s for fix in data.star_fixes]
    if not t_s:
        return None
    return t_s[0] - STARS_MARGIN_S, t_s[-1] + STARS_MARGIN_S


def _cameras(data, has):
    """A tab for each kind of pictures; without any the marks alone, and a name that says so."""
    marks = "green identified, orange not"
    names = {"star_tracker/image": f"Star camera: {marks}", "star_tracker/image_full": "As read out"}
    views = [_star_camera(data, entity, name) for entity, name in names.items() if entity in has.pictures]
    return rrb.Tabs(
        *(views or [_star_camera(data, "stars", f"Detections, no pictures: {marks}")]), active_tab=0
    )


def _star_camera(data, entity, name):
    size = data.mission.camera.width_px, data.mission.camera.height_px
    x, y = ([-0.01 * most, 1.01 * most] for most in size)
    bounds = rrb.VisualBounds2D(x_range=x, y_range=y)
    return rrb.Spatial2DView(origin=entity, contents=["$origin", "stars/**"], name=name, visual_bounds=bounds)


def _trajectory(seen, has):
    """The flight, seen from its right, behind and above."""
    right = np.array([seen.along[1], -seen.along[0], 0.0])
    away = 0.85 * right - 0.33 * seen.along + np.array([0.0, 0.0, 0.4])
    is_round = seen.size > wgs84.A  # around the Earth: there is as much above and below as along
    eye = seen.middle + seen.size * (1.4 if is_round else 1.0) * away
    return rrb.Spatial3DView(
        origin="/",
        contents=["world/**", "tf", *(["star_tracker/calibration"] if has.stars or has.pictures else [])],
        name="Flight, axes east, north, up at the start",
        background=[10, 13, 18],
        line_grid=False,
        spatial_information=rrb.SpatialInformation(target_frame="launch"),
        eye_controls=rrb.EyeControls3D(
            position=eye.tolist(), look_target=seen.middle.tolist(), eye_up=[0.0, 0.0, 1.0]
        ),
    )


def _lanes(data):
    return rrb.StateTimelineView(origin="states", name="States", time_view=_time_axis(data))


def _legend(page):
    return rrb.TextDocumentView(origin=legend.entity(page), name="How to read this page")


def _texts(page):
    """What happened, the closing figures, and what the page shows."""
    events = rrb.TextLogView(
        origin="log",
        name="Events",
        columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
        rows=rrb.TextLogRows(filter_by_log_level=["INFO", "WARN", "ERROR", "CRITICAL"]),
    )
    figures = rrb.TextDocumentView(origin="summary", name="Figures")
    return rrb.Tabs(events, figures, _legend(page), active_tab=0)


def _errors(data):
    """A plot for each of ERROR_PLOTS; its title says what its scale cuts off."""
    return [
        _plot(data, plot.entity, plot.title + cut, top=limit, bottom=-limit if limit else 0.0)
        for plot, (limit, cut) in zip(ERROR_PLOTS, _error_limits(data), strict=True)
    ]


def _error_limits(data):
    """Half height of each error plot, and words about what lies beyond it: nine (limit or None, text).

    The better part of the flight is to be seen well, spikes are cut off.
    """
    errors = navigation_errors(data)
    t_s, _, sigma = normalised_errors(data, errors)
    if not np.any(t_s > 0.0):
        return [(None, "")] * len(ERROR_PLOTS)
    sizes = np.abs(np.hstack([errors.position_i, errors.velocity_i, errors.attitude_b]))
    limits = ABOVE * np.percentile(3.0 * sigma[t_s > 0.0], BETTER_PART, axis=0)
    largest = sizes.max(axis=0)
    unknown = np.isnan(limits)  # of software that says no sigmas
    limits[unknown] = series.ROOM * np.percentile(sizes[:, unknown], series.BETTER_PART, axis=0)
    limits[6:], largest[6:] = np.degrees(limits[6:]), np.degrees(largest[6:])
    shown = [_readable(limit) for limit in limits]
    return [
        (limit, _cut_off(most) if most > limit else "") for limit, most in zip(shown, largest, strict=True)
    ]


def _readable(value):
    """Nearest of 1.2, 2.4, 12 ...: rerun numbers powers of ten and their multiples, just inside these."""
    power = 10.0 ** np.floor(np.log10(value))
    steps = power * np.array([1.2, 2.4, 12.0])
    return float(steps[np.argmin(np.abs(np.log(steps / value)))])


def _flight_views(data, has):
    """The plots of the flight, and how many stars there were."""
    rate = _roll_shown(data)
    views = [
        _plot(data, "plots/height", "Height [km]"),
        _plot(data, "plots/speed", "Speed against the Earth [m/s]"),
        _plot(data, "plots/roll_rate", "Roll rate [deg/s]", top=rate, bottom=-rate if rate else 0.0),
    ]
    if has.control:
        most = _largest(np.degrees(data.control.pointing_error))
        title = "Pointing error about body x, y, z [deg]"
        views.append(_plot(data, "plots/pointing", title, top=most, bottom=-most))
        views.append(_plot(data, "plots/gas", "Cold gas used [kg]", top=_gas_shown(data)))
    if has.stars:
        views.append(_plot(data, "plots/stars", _stars_title(data)))
    return views


def _roll_shown(data):
    """Half height of the scale of the roll rate of a body that hardly rolls, else None: the viewer's own.

    Of less than a part of NO_ROLL the viewer writes no number at its axis.
    """
    rate = np.abs(np.degrees(data.truth.omega_ib_b[:, 0]))
    known = rate[np.isfinite(rate)]
    return 1.2 * NO_ROLL if len(known) and known.max() < NO_ROLL else None


def _gas_shown(data):
    """Upper end of the scale of the gas, with room above: the viewer's own cuts the last of it."""
    used = data.control.propellant_kg
    return 1.05 * float(np.nanmax(used)) or None if len(used) else None


def _largest(values):
    """A limit that rerun numbers well and no value exceeds."""
    known = np.abs(values[np.isfinite(values)])
    power = 10.0 ** np.floor(np.log10(max(known.max(initial=0.0), 1e-6)))
    steps = power * np.array([1.2, 2.4, 6.0, 12.0])
    return float(steps[np.searchsorted(steps, known.max(initial=0.0))])


def _flight_curves(data, has):
    return _grid(_flight_views(data, has), "Flight and stars")
