"""Figures of the vehicle: a drawing to scale of what the scenario describes, and its flight over time."""

from types import SimpleNamespace

import numpy as np

from shefex_nav.report import vehicle
from shefex_nav.report.figures import style

NOT_DESCRIBED = (
    "Nose, body and fins have no shape in the scenario: dashed is a cylinder of the reference diameter, open "
    "where no end is described."
)
_PANEL = 0.62  # inches, least height of a drawing
_LEFT = 0.25


@style.styled
def drawing(looked):
    """Each configuration from the side, to one scale, nose to the left. vehicle.Looked -> Figure"""
    shown = [k for k in range(len(looked.configurations)) if (looked.profile.configuration == k).any()]
    length = max(_reach(looked, k) for k in shown)
    widest = max(looked.configurations[k].aero.diameter for k in shown)
    scale = (style.WIDTH - _LEFT - style.RIGHT) / (1.06 * length)  # inches per metre
    height = max(_PANEL, 1.5 * widest * scale)
    rows, gap, top, below = len(shown), 0.36, 0.78, 1.4
    figure = style.figure(top + rows * height + (rows - 1) * gap + below)
    across = 0.5 * height / scale
    total = figure.get_figheight()
    for row, k in enumerate(shown):
        y = 1.0 - (top + (row + 1) * height + row * gap) / total
        inner = style.WIDTH - _LEFT - style.RIGHT
        axes = figure.add_axes((_LEFT / style.WIDTH, y, inner / style.WIDTH, height / total))
        axes.set(xlim=(-0.03 * length, 1.03 * length), ylim=(-across, across), yticks=[], aspect="equal")
        axes.spines["left"].set_visible(False)
        axes.tick_params(labelbottom=row == rows - 1)
        axes.set_title(_head(looked, k), fontsize=10.5, pad=4)
        _draw(axes, looked, k)
    axes.set_xlabel("station, behind the nose tip [m]")
    handles = {
        label: handle
        for one in figure.axes
        for handle, label in zip(*one.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        handles.values(), handles.keys(), loc="lower left", ncols=4, frameon=False, fontsize=9.5,
        bbox_to_anchor=(0.01, 0.32 / total), borderaxespad=0.0, columnspacing=1.4, handlelength=1.6,
    )  # fmt: skip
    figure.text(0.015, 0.06 / total, NOT_DESCRIBED, fontsize=9, color=style.GREY, va="bottom")
    style.title(figure, f"{looked.scenario.mission.name}: the vehicle to scale")
    return figure


def _head(looked, k):
    part = looked.profile.configuration == k
    first, last = looked.profile.mass[part][[0, -1]]
    begin = looked.profile.t_s[part][0]
    mass = f"{first:,.0f} kg" if abs(first - last) < 0.5 else f"{first:,.0f} to {last:,.0f} kg"
    return f"{vehicle.flying(looked, k)}, from T{begin:+.1f} s: {mass.replace(',', ' ')}"


def _reach(looked, k):
    """The farthest station that is known of a configuration, m."""
    given = looked.scenario.vehicle
    stages = list(given.stages.values())[k:]
    known = [-given.imu[0], given.payload.station, *(one.motor.exit_station for one in stages)]
    known += [one.dry.station for one in stages]
    profile = looked.profile
    part = profile.configuration == k
    stations = np.concatenate([profile.centre[part], profile.pressure[part]])
    return max(*known, float(np.nanmax(stations)))


def _draw(axes, looked, k):
    given, profile = looked.scenario.vehicle, looked.profile
    stages = list(given.stages.items())[k:]
    radius = 0.5 * looked.configurations[k].aero.diameter
    end = stages[0][1].motor.exit_station if stages else _reach(looked, k)
    outline = {"color": style.GREY, "lw": 1.0, "ls": (0, (5, 3))}
    axes.plot([end, 0.0, 0.0, end], [radius, radius, -radius, -radius], label="reference diameter", **outline)
    if stages:  # the length of a payload alone is not described: open
        axes.plot([end, end], [-radius, radius], **outline)
    axes.axhline(0.0, color="#cccccc", lw=0.6, zorder=0)
    for name, stage in stages:
        _stage(axes, name, stage, radius)
    station = given.payload.station
    axes.plot(station, 0.0, "D", color=style.GREEN, ms=7, mec="black", label="payload's centre of mass")
    axes.plot(-given.imu[0], given.imu[1], "s", color=style.SKY, ms=6, mec="black", label="IMU")
    part = profile.configuration == k
    _range(axes, profile.centre[part], 0.5 * radius, style.BLACK, "o", "centre of mass of the whole")
    felt = vehicle.upwards(looked) & part
    _range(axes, profile.pressure[felt], -0.5 * radius, style.RED, "^", "centre of pressure on the way up")


def _stage(axes, name, stage, radius):
    """Propellant, nozzle and empty mass of a stage, as far as they are described; its name at the radius."""
    from matplotlib.patches import Rectangle

    grain, motor = stage.propellant, stage.motor
    if hasattr(grain, "length"):
        begin, thick = grain.station - 0.5 * grain.length, grain.outer_radius - grain.inner_radius
        for y, label in ((grain.inner_radius, "propellant"), (-grain.outer_radius, None)):
            patch = Rectangle(
                (begin, y), grain.length, thick, color=style.ORANGE, alpha=0.55, lw=0, label=label
            )
            axes.add_patch(patch)
        middle = grain.station
    else:
        middle = float(np.mean(grain.table.station))
        axes.plot(
            middle, 0.0, "P", color=style.ORANGE, ms=8, mec="black", label="propellant, without a shape"
        )
    half = float(np.sqrt(motor.exit_area / np.pi))
    label = "nozzle exit"
    axes.plot(
        [motor.exit_station] * 2, [-half, half], color=style.BLUE, lw=3, solid_capstyle="butt", label=label
    )
    label = "empty stage's centre of mass"
    axes.plot(stage.dry.station, 0.0, "X", color=style.PURPLE, ms=8, mec="black", label=label)
    axes.annotate(
        name, (middle, radius), (0, 2), textcoords="offset points", ha="center", va="bottom", fontsize=9
    )


def _range(axes, stations, y, colour, marker, label):
    """Between which stations something lies, and its markers at both ends."""
    stations = stations[np.isfinite(stations)]
    if len(stations):
        ends = [float(stations.min()), float(stations.max())]
        axes.plot(ends, [y, y], marker=marker, color=colour, ms=6, lw=2, label=label)


@style.styled
def over_time(looked):
    """Mass, stations, stability, forces and spin over time, on the way up and over all. Looked -> Figure"""
    profile, flight = looked.profile, looked.flight
    rising = vehicle.upwards(looked)
    t_s = profile.t_s
    spans = [(0.0, 1.02 * float(t_s[rising].max(initial=t_s[1]))), (0.0, float(t_s[-1]))]
    data = SimpleNamespace(truth=profile, events=flight.events)
    name = f"{looked.scenario.mission.name}: the vehicle over time"
    heads = ["on the way up, as long as air is felt", "the whole flight"]
    figure, rows = style.panels(data, 6, name, columns=2, height=1.25, heads=heads, spans_s=spans)
    for column, span in zip(rows.T, spans, strict=True):
        part = (profile.t_s >= span[0]) & (profile.t_s <= span[1])
        _column(column, profile, part)
        for axes in column:
            style.event_lines(axes, data)
    labels = (
        "mass [kg]",
        "station [m]",
        "static margin\n[calibres]",
        "force [kN]",
        "spin [Hz]",
        "dynamic\npressure [kPa]",
    )
    for axes, label in zip(rows[:, 0], labels, strict=True):
        axes.set_ylabel(label)
    for row in (1, 3, 4):
        style.legend_above(rows[row, 1])
    return figure


def _column(column, profile, part):
    t_s = profile.t_s[part]

    def draw(axes, values, **how):
        if np.isfinite(values).any():
            axes.plot(t_s, values, **how)

    mass, stations, margin, force, spin, pressure = column
    draw(mass, profile.mass[part], color=style.BLUE)
    draw(stations, profile.centre[part], color=style.BLACK, label="centre of mass")
    draw(stations, profile.pressure[part], color=style.RED, ls="--", label="centre of pressure")
    stations.invert_yaxis()
    draw(margin, profile.margin[part], color=style.BLUE)
    margin.axhspan(0.0, vehicle.LEAST_MARGIN, color="#f6d5c0", lw=0, zorder=0)
    margin.axhline(0.0, color=style.RED, lw=0.8)
    draw(force, profile.thrust[part] / 1e3, color=style.BLUE, label="thrust")
    draw(force, profile.drag[part] / 1e3, color=style.RED, ls="--", label="drag")
    draw(spin, np.abs(profile.spin[part]) / (2.0 * np.pi), color=style.BLUE, label="spin")
    resonant = profile.resonant[part] / (2.0 * np.pi)
    draw(spin, resonant, color=style.RED, ls="--", label="resonance with the pitch motion")
    draw(pressure, profile.dynamic_pressure[part] / 1e3, color=style.BLUE)
