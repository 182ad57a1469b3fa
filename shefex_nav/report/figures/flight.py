"""Figures of the flight: path, history, ground track, attitude control."""

import numpy as np

from shefex_nav import event_words
from shefex_nav.clock import SAME_S
from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.geometry import wgs84
from shefex_nav.records import Phase
from shefex_nav.report import coast
from shefex_nav.report.figures import flown, labels, style
from shefex_nav.report.flight import MOVES
from shefex_nav.report.local_level import is_replay
from shefex_nav.report.track import earth_fixed

_ROUND = np.radians(60.0)  # a track that reaches farther is drawn on a map of the whole Earth
_ABOUT = 0.18  # shown around a track, over its size
_FINE = np.radians(10.0)  # half width of a map below which its coast is the fine one
_LAND = "#8a6d3b"
_SMALLEST = 20e3  # m, of a map
_GRID_DEG = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0, 30.0)
_PRINCIPAL = ("lift_off", "apogee", "entry", "impact", "landing")  # named first
_DOT = 4.0  # points, of an event
SLOWEST = 5.0  # m/s; below it the air comes from anywhere


@style.styled
def trajectory(data):
    """Height against the distance along the ground, coloured by phase, with the events. RunData -> Figure

    None for a log without a path, or of what never leaves its place.
    """
    path = flown.path(data)
    if path is None:
        return None
    still = MOVES if path.name == "estimate" else None
    distance_km, height_km = flown.along_ground(path.track, still) / 1e3, path.track.height / 1e3
    if not _moves(path.track):
        return None
    words = f"Flight path ({path.name}): height against distance, and what happened on it"
    figure, axes = style.single(4.9, words)
    _by_phase(axes, data, path, distance_km, height_km)
    axes.set_xlabel("distance along the ground track [km]")
    axes.set_ylabel("height above the ellipsoid [km]")
    axes.margins(x=0.03)
    top = max(float(height_km.max()), 0.1)
    axes.set_ylim(min(-0.03 * top, float(height_km.min()) - 0.05 * top), 1.25 * top)
    style.legend(axes, loc="upper right", ncols=2)
    _name_events(axes, data, path, distance_km, height_km)
    return figure


def _moves(track):
    """Whether a track is more than a place."""
    return float(np.ptp(track.r_e, axis=0).max(initial=0.0)) > 10.0


def _by_phase(axes, data, path, x, y):
    """A line in the colour of each phase; in one colour where the log does not say."""
    if path.name != "truth" or is_replay(data):
        axes.plot(x, y, color=style.BLUE, lw=2.2)
        return
    named = set()
    for phase, rows in flown.by_phase(path, data.truth):
        name = None if phase in named else phase.name.lower()
        named.add(phase)
        axes.plot(x[rows], y[rows], color=style.PHASES[phase], lw=2.6, label=name, solid_capstyle="butt")


def _name_events(axes, data, path, x, y):
    """A dot at each event, and its name; the principal ones find room first."""
    events = flown.event_names(e for e in data.events if path.t_s[0] - SAME_S <= e.t_s <= path.t_s[-1] + 0.5)
    if not events:
        return
    xy = np.array([(np.interp(t, path.t_s, x), np.interp(t, path.t_s, y)) for t, _, _ in events])
    axes.plot(*xy.T, "o", color=style.BLACK, ms=_DOT, zorder=3)
    groups = labels.together(axes, xy, _DOT)
    names = [", ".join(events[k][2] for k in group) for group in groups]
    first = {event_words.in_words(name) for name in _PRINCIPAL}
    order = sorted(range(len(groups)), key=lambda k: first.isdisjoint(names[k].split(", ")))
    at = xy[[group[0] for group in groups]]
    labels.place(axes, at[order], [names[k] for k in order], avoid=np.column_stack([x, y])[::8])


@style.styled
def history(data):
    """Height, speed, force and rates over time. RunData -> Figure; None without a path."""
    path = flown.path(data, most=6000)
    if path is None:
        return None
    has_motion = path.name == "truth" and np.isfinite(data.truth.f_b).any()  # recorded data have none
    figure, rows = style.panels(
        data, 5 if has_motion else 2, f"The flight over time ({path.name})", height=1.4
    )
    style.curve(rows[0, 0], path.t_s, path.track.height / 1e3, color=style.BLUE)
    rows[0, 0].set_ylabel("height [km]")
    style.no_narrower(rows[0, 0], style.STILL_KM)
    style.curve(rows[1, 0], path.t_s, np.linalg.norm(path.track.v_e, axis=1), color=style.BLUE)
    rows[1, 0].set_ylabel("speed [m/s]")
    for axes in rows[:, 0]:
        style.event_lines(axes, data)
    if not has_motion:
        return figure
    truth = data.truth
    style.curve(rows[2, 0], truth.t_s, np.linalg.norm(truth.f_b, axis=1) / STANDARD_GRAVITY, color=style.BLUE)
    rows[2, 0].set_ylabel("specific\nforce [gee]")
    rate_deg_s = np.degrees(truth.omega_ib_b)
    style.curve(rows[3, 0], truth.t_s, np.abs(rate_deg_s[:, 0]), color=style.BLUE, label="roll")
    across = np.hypot(rate_deg_s[:, 1], rate_deg_s[:, 2])
    style.curve(rows[3, 0], truth.t_s, across, color=style.RED, ls="--", label="across", lw=1.0)
    style.log_scale(rows[3, 0], bottom=1e-3)
    rows[3, 0].set_ylabel("body rate\n[deg/s]")
    style.legend_above(rows[3, 0])
    slow = np.linalg.norm(earth_fixed(data.mission.earth, truth).v_e, axis=1) < SLOWEST
    angle_deg = np.where(slow, np.nan, np.degrees(truth.angle_of_attack))
    style.curve(rows[4, 0], truth.t_s, angle_deg, color=style.BLUE)
    rows[4, 0].set_ylabel("angle of\nattack [deg]")
    return figure


@style.styled
def ground_track(data):
    """Map of the ground track, truth and estimate. RunData -> Figure; None without a path."""
    path = flown.path(data)
    if path is None or not _moves(path.track):
        return None
    track = path.track
    middle = middle_of(track.latitude, track.longitude)
    reach = _angle(_unit(track.latitude, track.longitude), middle).max()
    words = f"Ground track ({path.name}), with coast lines"
    height, below = (5.9, 0.7) if reach > _ROUND else (6.4, 0.9)
    figure, axes = style.single(height, words, below)
    if reach > _ROUND:
        _whole_earth(axes, path)
    else:
        _region(axes, data, path, middle)
    return figure


def middle_of(latitude, longitude):
    """(3,) unit vector of the middle of places on the sphere, rad."""
    middle = _unit(latitude, longitude).mean(axis=0)
    return middle / max(np.linalg.norm(middle), 1e-12)


def _unit(latitude, longitude):
    """Unit vectors (n, 3) on the sphere of geodetic coordinates, rad."""
    latitude, longitude = np.broadcast_arrays(latitude, longitude)
    c = np.cos(latitude)
    return np.stack([c * np.cos(longitude), c * np.sin(longitude), np.sin(latitude)], axis=-1)


def _angle(u, v):
    return np.arccos(np.clip(u @ v, -1.0, 1.0))


def equidistant(latitude, longitude, middle):
    """Azimuthal equidistant map about a point: km east and north of it, (..., 2).

    The sphere of the Earth's semi-major axis; middle : (3,) unit vector (Snyder, Map Projections,
    1987, 25-2).
    """
    east = np.array([-middle[1], middle[0], 0.0]) / max(np.hypot(middle[0], middle[1]), 1e-12)
    north = np.cross(middle, east)
    u = _unit(latitude, longitude)
    across = np.stack([u @ east, u @ north], axis=-1)
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.arctan2(length, (u @ middle)[..., None])
    scale = np.divide(angle, length, out=np.ones_like(angle), where=length > 1e-12)
    return wgs84.A / 1e3 * scale * across


def _region(axes, data, path, middle):
    """Map about the middle of the track, in km."""
    track = path.track
    xy = equidistant(track.latitude, track.longitude, middle)
    base_map(axes, middle, xy)
    _by_phase(axes, data, path, *xy.T)
    _estimated(axes, data, path, lambda lat, lon: equidistant(lat, lon, middle))
    axes.set_xlabel("east of the middle of the track [km]")
    axes.set_ylabel("north [km]")
    legend_below(axes)
    _name_events(axes, data, path, *xy.T)


def base_map(axes, middle, xy):
    """Limits around places (n, 2) km of `equidistant` about `middle`, coast lines, graticule."""
    low, high = xy.min(axis=0), xy.max(axis=0)
    size = max(float((high - low).max()), _SMALLEST / 1e3)
    centre = 0.5 * (low + high)
    half = np.array([1.0, 0.5]) * max(size * (0.5 + _ABOUT), float((high - low)[1]) * (0.5 + _ABOUT) * 1.0)
    half[1] = max(half[1], 0.5 * float((high - low)[1]) + _ABOUT * size)
    half[0] = max(half[0], 1.75 * half[1])
    axes.set_aspect("equal")
    axes.set(xlim=(centre[0] - half[0], centre[0] + half[0]), ylim=(centre[1] - half[1], centre[1] + half[1]))
    axes.grid(False)
    far = 1.5 * float(np.hypot(*half)) / (wgs84.A / 1e3)
    _coast(axes, middle, far)
    _graticule(axes, middle, far)


def _coast(axes, middle, far):
    """Coast lines within an angle [rad] of the middle of a map, with words about them for its legend."""
    fine = far < _FINE
    lon, lat = np.radians(coast.broken(fine)).T
    near = _unit(lat, lon) @ middle > np.cos(min(far + 0.2, 2.5))  # not at the breaks, which are NaN
    shown = near | np.isnan(lat)
    drawn = np.where(near[:, None], equidistant(lat, lon, middle), np.nan)[shown]
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    x, y = drawn.T
    inside = np.any((x > x0) & (x < x1) & (y > y0) & (y < y1))
    words = f"coast: {coast.WORDS[fine]}" if inside else f"no coast here, by {coast.WORDS[fine]}"
    axes.plot(x, y, color=_LAND, lw=0.9, label=words)


def legend_below(axes):
    """Legend of a map, where it covers nothing of it."""
    style.legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=3, fontsize=9, frameon=False)


def _estimated(axes, data, path, project):
    """The estimated track over the true one."""
    if path.name != "truth":
        return
    guess = flown.estimate(data)
    if guess is not None:
        xy = project(guess.track.latitude, guess.track.longitude)
        axes.plot(*xy.T, color=style.BLACK, lw=0.9, ls=(0, (5, 4)), label="estimate")


def _graticule(axes, middle, far):
    """Meridians and parallels of a regional map, named at its right and lower edge."""
    reach_deg = np.degrees(far)
    latitude = np.degrees(np.arcsin(np.clip(middle[2], -1.0, 1.0)))
    longitude = np.degrees(np.arctan2(middle[1], middle[0]))
    step = next((s for s in _GRID_DEG if reach_deg / s < 5.0), _GRID_DEG[-1])
    widest = min(180.0, reach_deg / max(np.cos(np.radians(min(abs(latitude) + reach_deg, 89.0))), 0.05))
    step_lon = next((s for s in _GRID_DEG if widest / s < 7.0), _GRID_DEG[-1])
    south, north = max(latitude - reach_deg, -89.9), min(latitude + reach_deg, 89.9)
    parallels = np.arange(np.ceil(south / step), np.floor(north / step) + 1) * step
    west, east = longitude - widest, longitude + widest
    meridians = np.arange(np.ceil(west / step_lon), np.floor(east / step_lon) + 1) * step_lon
    for value in parallels:
        line = equidistant(np.radians(value), np.radians(np.linspace(west, east, 200)), middle)
        _grid_line(axes, line, f"{abs(value):g}°{'N' if value >= 0 else 'S'}", edge="right")
    for value in meridians:
        line = equidistant(np.radians(np.linspace(south, north, 200)), np.radians(value), middle)
        shown = (value + 180.0) % 360.0 - 180.0
        _grid_line(axes, line, f"{abs(shown):g}°{'E' if shown >= 0 else 'W'}", edge="bottom")


def _grid_line(axes, line, name, *, edge):
    """A line, and its name where it enters at an edge."""
    axes.plot(*line.T, color="#cccccc", lw=0.6, zorder=0)
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    inside = (line[:, 0] >= x0) & (line[:, 0] <= x1) & (line[:, 1] >= y0) & (line[:, 1] <= y1)
    if not inside.any():
        return
    k = np.flatnonzero(inside)
    right = edge == "right"
    k = k[np.argmax(line[k, 0])] if right else k[np.argmin(line[k, 1])]
    at_edge = x1 - line[k, 0] < 0.03 * (x1 - x0) if right else line[k, 1] - y0 < 0.05 * (y1 - y0)
    at_edge &= right or line[k, 0] < x1 - 0.06 * (x1 - x0)  # its name has room
    if at_edge:
        axes.annotate(
            name, line[k], (-3 if right else 3, 3), textcoords="offset points", fontsize=9, color=style.GREY,
            ha="right" if right else "left",
        )  # fmt: skip


def _whole_earth(axes, path):
    """The track over longitude and latitude, broken where it crosses the antimeridian."""
    for line in coast.lines():
        axes.plot(*line.T, color=_LAND, lw=0.7)
    axes.plot([], [], color=_LAND, lw=0.7, label=f"coast: {coast.WORDS[False]}")
    longitude, latitude = np.degrees(path.track.longitude), np.degrees(path.track.latitude)
    jumps = np.flatnonzero(np.abs(np.diff(longitude)) > 180.0) + 1
    broken = np.insert(longitude, jumps, np.nan), np.insert(latitude, jumps, np.nan)
    axes.plot(*broken, color=style.BLUE, lw=1.8, label=path.name)
    axes.plot(longitude[0], latitude[0], "o", color=style.BLACK, label="start")
    axes.plot(longitude[-1], latitude[-1], "s", color=style.RED, label="end")
    axes.set(xlim=(-180, 180), ylim=(-90, 90), xlabel="longitude [deg]", ylabel="latitude [deg]")
    axes.set_xticks(range(-180, 181, 30))
    axes.set_yticks(range(-90, 91, 30))
    axes.set_aspect("equal")
    legend_below(axes)


@style.styled
def attitude_control(data):
    """Pointing error about each axis and the gas used. RunData -> Figure; None without attitude control."""
    control = data.control
    if not len(control.t_s):
        return None
    figure, rows = style.panels(
        data, 2, "Attitude control: true against wanted attitude, and the gas it took"
    )
    error_deg = np.degrees(control.pointing_error)
    for k, axis in enumerate("xyz"):
        style.curve(
            rows[0, 0], control.t_s, error_deg[:, k], color=style.AXES[axis], ls=style.DASHES[axis],
            label=f"about {axis}",
        )  # fmt: skip
    rows[0, 0].set_ylabel("error [deg]")
    style.limits(rows[0, 0], [error_deg], margin=0.15)
    style.legend_above(rows[0, 0])
    style.curve(rows[1, 0], control.t_s, control.propellant_kg, color=style.BLUE)
    rows[1, 0].set_ylabel("gas used [kg]")
    for start, length in style.spans(data.truth.t_s, data.truth.phase == Phase.POINTING):
        rows[0, 0].axvspan(start, start + length, color=style.GREEN, alpha=0.12, lw=0)
    return figure
