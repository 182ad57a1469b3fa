"""The scene of the viewer: flown path, ground track, events and the globe, in axes of the launch site."""

import numpy as np

from shefex_nav import event_words
from shefex_nav.geometry import wgs84
from shefex_nav.records import Phase
from shefex_nav.report import coast
from shefex_nav.report.local_level import is_replay
from shefex_nav.report.pairing import at_rows, whole_time
from shefex_nav.report.track import earth_fixed
from shefex_nav.report.viewer import layout, vehicle
from shefex_nav.report.viewer.sender import BLUE, GREEN, GREY, VIOLET, WHITE, YELLOW, plot_step

_POINTS = 4000  # of the path, about
_LINE_POINTS = 60  # of a meridian or parallel
COAST_M = 1.5e6  # from the track, of the coasts that are drawn
_EVENT = (255, 220, 120)
FIRST_NAMED = ("lift_off", "apogee", "entry", "impact", "parachute", "burn_out_1", "burn_out_2")
PHASE_COLOURS = {
    Phase.PAD: GREY,
    Phase.BOOST: (255, 90, 60),
    Phase.COAST: WHITE,
    Phase.MANOEUVRE: BLUE,
    Phase.POINTING: GREEN,
    Phase.DESCENT: VIOLET,
    Phase.PARACHUTE: YELLOW,
    Phase.ORBIT: WHITE,
    Phase.GROUND: (150, 130, 100),
}


def path(data):
    """Flown path in launch axes, thinned: (n, 3) m."""
    every = thinned(data.truth, _step(data))
    return _in_launch_axes(data.mission, earth_fixed(data.mission.earth, every).r_e)


def time_span(data):
    """(first, last) s of a RunData."""
    return whole_time(data) or (0.0, 1.0)


def thinned(truth, step):
    """Every so many samples of a TruthSample of arrays."""
    return at_rows(truth, slice(None, None, step))


def _step(data):
    return max(1, len(data.truth.t_s) // _POINTS)


def _in_launch_axes(mission, r_e):
    site = mission.launch_latitude, mission.launch_longitude
    return (np.asarray(r_e) - wgs84.ecef_from_geodetic(*site, mission.launch_height)) @ wgs84.dcm_el(*site)


def send(sender, data):
    """Send the scene of one run."""
    every, flown = scenery(sender, data)
    move(sender, data, every.t_s, flown, layout.scene(flown).size)


def move(sender, data, t_s, flown, size):
    """Send what moves with the vehicle. (n,) s, (n, 3) m in launch axes, size of the scene [m]"""
    step = max(1, round(vehicle.POSE_S / max(np.median(np.diff(t_s)), 1e-3))) if len(flown) > 1 else 1
    vehicle.send(sender, data, (t_s[::step], flown[::step]), size)


def scenery(sender, data):
    """Send what stands in the scene; sent again, it takes the place of the former.

    -> TruthSample of the path as drawn, and its points in launch axes, (n, 3) m
    """
    import rerun as rr

    every = thinned(data.truth, _step(data))
    track = earth_fixed(data.mission.earth, every)
    flown = _in_launch_axes(data.mission, track.r_e)
    ground = _in_launch_axes(data.mission, _on_ground(track.latitude, track.longitude))
    size = layout.scene(flown).size
    frame = rr.CoordinateFrame("launch")

    def log(entity, drawing):
        sender.static(f"world/{entity}", drawing, frame)

    bounds = np.flatnonzero(np.diff(every.phase)) + 1
    pieces = [p for p in np.split(np.arange(len(flown)), bounds) if len(p)]
    strips = [flown[p[0] : p[-1] + 2] for p in pieces]
    colours = [PHASE_COLOURS[Phase(every.phase[p[0]])] for p in pieces]
    log("path", rr.LineStrips3D(strips, colors=colours, radii=[-2.0]))
    log("ground_track", rr.LineStrips3D([ground], colors=[110, 110, 110], radii=[-1.0]))
    _log_earth(log, data.mission, track)
    _log_events(log, data, every.t_s, flown, ground, size)
    pinhole = rr.Pinhole.from_fields(image_plane_distance=layout.FRUSTUM * size)
    sender.static("star_tracker/calibration", pinhole)
    sender.static("tf", rr.TransformAxes3D(layout.AXES * size))
    return every, flown


def send_path(sender, data, mission, name, colour):
    """The path of another run in the launch axes of `mission`."""
    import rerun as rr

    every = thinned(data.truth, _step(data))
    flown = _in_launch_axes(mission, earth_fixed(data.mission.earth, every).r_e)
    drawing = rr.LineStrips3D([flown], colors=[colour], radii=[-1.5], labels=[name.rpartition("/")[2]])
    sender.static(f"world/{name}", drawing, rr.CoordinateFrame("launch"))


def _log_earth(log, mission, track):
    """Meridians, parallels and coasts around the track, or of the whole globe around an orbit."""
    import rerun as rr

    lines, is_round = _graticule(track)
    shades = [(60, 90, 120) if r else (38, 54, 72) for r in is_round]
    lines = [_in_launch_axes(mission, line) for line in lines]
    log("globe", rr.LineStrips3D(lines, colors=shades, radii=[-0.7]))
    coasts = [_in_launch_axes(mission, line) for line in _coasts(track)]
    log("coasts", rr.LineStrips3D(coasts, colors=[(120, 170, 110)], radii=[-0.9]))


def _coasts(track):
    """Coast lines within COAST_M of the track, Earth-fixed; those of the whole globe around an orbit."""
    places = _on_ground(track.latitude[::50], track.longitude[::50])
    whole = np.linalg.norm(places.max(axis=0) - places.min(axis=0)) > wgs84.A
    found = []
    for line in coast.lines():
        longitude, latitude = np.radians(line).T
        points = _on_ground(latitude, longitude)
        if whole:
            found.append(points)
            continue
        near = np.linalg.norm(points[:, None] - places, axis=2).min(axis=1) < COAST_M
        cuts = np.flatnonzero(np.diff(near)) + 1
        parts = zip(np.split(points, cuts), np.split(near, cuts), strict=True)
        found += [part for part, is_near in parts if is_near[0] and len(part) > 1]
    return found


def _log_events(log, data, t_s, flown, ground, size):
    """A pole from the ground to the place of each event, and the names of those that leave room."""
    import rerun as rr

    rows = [int(np.argmin(np.abs(t_s - event.t_s))) for event in data.events]
    poles = [np.array([ground[k], flown[k]]) for k in rows]
    log("heights", rr.LineStrips3D(poles, colors=[90, 90, 110], radii=[-0.7]))
    tops = [pole[1] for pole in poles]
    names = [event_words.in_words(event.name) for event in data.events]
    log("events", rr.Points3D(tops, colors=_EVENT, radii=[-3.0]))
    first = [k for k, event in enumerate(data.events) if event.name in FIRST_NAMED]
    order = [*first, *(k for k in range(len(tops)) if k not in first)]
    named = _far_apart(tops, layout.NAME * size, order)
    labels = rr.Points3D(
        [tops[k] for k in named],
        labels=[names[k] for k in named],
        show_labels=True,
        radii=[0.0],
        colors=_EVENT,
    )
    log("event_names", labels)


def _on_ground(latitude, longitude):
    return np.array([wgs84.ecef_from_geodetic(a, b, 0.0) for a, b in zip(latitude, longitude, strict=True)])


def _far_apart(points, distance, order):
    """Indices of points that leave room for each other's names; those that are first in `order` have it."""
    chosen = []
    for k in order:
        if all(np.linalg.norm(points[k] - points[j]) > distance for j in chosen):
            chosen.append(k)
    return chosen


def _graticule(track):
    """Meridians and parallels around the track: lines of (n, 3) m in frame e; which are at 10 degrees.

    Of a track that leads around the Earth, those of the whole globe.
    """
    longitude = np.degrees(np.unwrap(track.longitude))  # does not jump at 180 degrees
    south, north = np.degrees([track.latitude.min(), track.latitude.max()])
    west, east = longitude.min(), longitude.max()
    if max(east - west, north - south) > 90.0:
        south, north, west, east, step = -80.0, 80.0, 0.0, 360.0, 10.0
        parallels, meridians = np.arange(south, north + 0.5, step), np.arange(west, east - 0.5, step)
    else:
        south, north = max(-89.0, np.floor(south) - 2.0), min(89.0, np.ceil(north) + 2.0)
        west, east = 5.0 * np.floor(west / 5.0) - 5.0, 5.0 * np.ceil(east / 5.0) + 5.0
        parallels, meridians = np.arange(south, north + 0.5, 1.0), np.arange(west, east + 0.5, 2.5)
    along_parallel = np.radians(np.linspace(west, east, _LINE_POINTS))
    along_meridian = np.radians(np.linspace(south, north, _LINE_POINTS))
    lines = [_on_ground(np.full(_LINE_POINTS, np.radians(a)), along_parallel) for a in parallels]
    lines += [_on_ground(along_meridian, np.full(_LINE_POINTS, np.radians(b))) for b in meridians]
    return lines, [bool(x % 10 == 0) for x in (*parallels, *meridians)]


def send_curves(sender, data):
    """Curves of the flight: height, speed, roll, what the attitude control does; the phases as a lane."""
    motion(sender, data)
    control(sender, data)
    if is_replay(data):  # recorded data do not say the phases
        return
    phases = {phase.name.lower(): colour for phase, colour in PHASE_COLOURS.items()}
    states = [Phase(p).name.lower() for p in data.truth.phase]
    sender.lane("states/phase", data.truth.t_s, states, phases, time_span(data))


def motion(sender, data):
    """Height, speed against the Earth, roll rate."""
    every = thinned(data.truth, plot_step(data.truth.t_s))
    track = earth_fixed(data.mission.earth, every)
    sender.curve("plots/height", every.t_s, track.height / 1e3, WHITE, "height [km]")
    speed = np.linalg.norm(track.v_e, axis=1)
    sender.curve("plots/speed", every.t_s, speed, YELLOW, "speed [m/s]")
    roll_rate = np.degrees(every.omega_ib_b[:, 0])  # NaN in the truth of external data
    sender.curve("plots/roll_rate", every.t_s, roll_rate, (150, 200, 255), "roll rate [deg/s]")


def control(sender, data):
    """Pointing error about each axis, and the gas."""
    if len(data.control.t_s):
        sender.axes("plots/pointing", data.control.t_s, np.degrees(data.control.pointing_error))
        sender.curve("plots/gas", data.control.t_s, data.control.propellant_kg, WHITE, "gas [kg]")
