"""A log as a laid-out rerun recording.

The drawings in the log (pictures, poses, events) are taken from the file as they are; what has to be
computed, the errors against their sigmas above all, comes from the same RunData and functions as the
figures of `metrics`.
Everything is on one timeline, `mission_time`.
"""

import tempfile
from pathlib import Path

import numpy as np

from shefex_nav.log import reader
from shefex_nav.log.topics import epoch_ns
from shefex_nav.records import Phase, Reason, TruthSample
from shefex_nav.report import layout, metrics, pictures, viewer_program, world_view
from shefex_nav.report.layout import TIMELINE
from shefex_nav.report.track import earth_fixed
from shefex_nav.report.viewer_program import ViewerError

APPLICATION = "shefex_nav"
_PICTURES = "star_tracker/image", "star_tracker/image_full"
_DRAWN = "^(/tf|/gps/location|/log|/star_tracker/(calibration|image|image_full))$"
_PLOT_HZ = 10  # points of a curve in a second, where there are as many
_MOST_POINTS = 20_000  # of a curve
_MARK_PX = 7.0  # half a side
_GREEN, _ORANGE, _GREY = (64, 255, 90), (255, 140, 26), (130, 130, 130)
_PHASE_COLOURS = {
    Phase.PAD: (130, 130, 130),
    Phase.BOOST: (255, 90, 60),
    Phase.COAST: (240, 240, 240),
    Phase.MANOEUVRE: (90, 170, 255),
    Phase.POINTING: (64, 255, 90),
    Phase.DESCENT: (190, 120, 255),
    Phase.PARACHUTE: (255, 200, 80),
    Phase.ORBIT: (240, 240, 240),
    Phase.GROUND: (150, 130, 100),
}


def view(log, *, save=None, screenshot=None, at_s=None):
    """Open a log in the viewer and wait until it is closed, or save its recording, or a picture.

    log, save, screenshot: .mcap, .rrd and .png files. The picture shows mission time `at_s`, by default
    the middle of the star fixes. Returns the RunData of the log; its `ended_early` and `last_t_s` are worth
    telling.
    """
    data = _read(log)
    if save is not None:
        build_recording(log, save, data)
    if screenshot is not None:
        at_s = layout.start_time(scene(data)) if at_s is None else at_s
        _check_time(log, data, at_s)
    if save is None or screenshot is not None:
        with tempfile.TemporaryDirectory() as folder:
            recording = Path(folder) / "view.rrd"
            build_recording(log, recording, data)
            if screenshot is None:
                viewer_program.show(recording)
            else:
                reports = viewer_program.take_picture(recording, screenshot, at_s)
                bad = [f"{view}: {text}" for view, texts in reports.items() for text in texts]
                if bad:
                    raise ViewerError(f"{log}: views in error: " + "; ".join(bad))
    return data


def _read(log):
    data = reader.read(log)
    if not len(data.truth.t_s) and not len(data.nav.t_s):
        raise ViewerError(f"{log}: nothing to show, the run ended before its first record")
    return data


def scene(data):
    """A RunData to draw the path of: where there is no truth, that of the navigation stands in for it."""
    if len(data.truth.t_s):
        return data
    nav = data.nav
    unknown = np.full_like(nav.r_i, np.nan)
    phase = np.full(len(nav.t_s), int(Phase.COAST))
    path = TruthSample(
        nav.t_s, phase, nav.r_i, nav.v_i, nav.q_ib, nav.omega_ib_b, unknown, np.full(len(phase), np.nan)
    )
    return data._replace(truth=path)


def _check_time(log, data, at_s):
    first_s, last_s = scene(data).truth.t_s[[0, -1]]
    if not first_s <= at_s <= last_s:
        raise ViewerError(f"{log}: covers {first_s:g} s to {last_s:g} s, not {at_s:g} s")


def build_recording(log_path, rrd_path, data=None):
    """Write the recording of a log with its layout to `rrd_path`."""
    import rerun as rr

    data = _read(log_path) if data is None else data
    stream = rr.RecordingStream(APPLICATION, recording_id=_recording_id(data))
    stream.save(rrd_path, default_blueprint=_layout(log_path, data))
    fill(stream, log_path, data)
    stream.flush()
    stream.disconnect()


def _recording_id(data):
    return f"{data.mission.scenario}-{data.mission.seed}"


def _layout(log_path, data):
    from rerun.chunk import McapReader

    channels = McapReader(log_path, recover=True).info().channels
    counts = {channel.topic: channel.message_count for channel in channels}
    data = scene(data)
    seen = layout.scene(world_view.path(data))
    return layout.blueprint(data, seen, pictures=[one for one in _PICTURES if counts.get(f"/{one}")])


def fill(stream, log_path, data):
    """Send everything to a rerun RecordingStream."""
    stream.send_recording_name(f"{data.mission.scenario}, seed {data.mission.seed}")
    _send_drawings(stream, log_path, data)
    _send_stars(stream, data)
    shown = scene(data)
    world_view.send(stream, shown, _PHASE_COLOURS)
    _send_errors(stream, data)
    _send_flight(stream, shown)
    _send_control(stream, data)
    _send_states(stream, shown)
    _send_summary(stream, data)


def _send_drawings(stream, log_path, data):
    """The Foxglove messages of the log, decoded by rerun, with the mission time added."""
    import pyarrow as pa
    import rerun as rr
    from rerun.chunk import Chunk, McapReader

    epoch, grey = epoch_ns(data.mission.epoch_utc), _grey(log_path, data)

    def with_mission_time(chunk):
        if chunk.is_static or "message_log_time" not in chunk.timeline_names:
            return chunk
        batch = chunk.to_record_batch()
        if pictures.is_wide(batch):
            batch = pictures.narrowed(batch, grey)
        k = batch.schema.get_field_index("message_log_time")
        times = batch.column(k).cast(pa.int64()).to_numpy() - epoch
        metadata = {**(batch.schema.field(k).metadata or {}), b"rerun:index_name": TIMELINE.encode()}
        field = pa.field(TIMELINE, pa.duration("ns"), nullable=False, metadata=metadata)
        column = pa.array(times).cast(pa.duration("ns"))
        return Chunk.from_record_batch(batch.add_column(k + 1, field, column))[0]

    source = McapReader(log_path, recover=True, include_topic_regex=[_DRAWN])
    rr.send_chunks(source.stream().map(with_mission_time), recording=stream)


def _grey(log_path, data):
    """Table of the grey values shown for 16-bit pictures, by the first one as read out, else by the bits."""
    from rerun.chunk import McapReader

    if not len(data.frames.bits) or data.frames.bits[0] <= 8:
        return None
    full = McapReader(log_path, recover=True, include_topic_regex=[f"^/{_PICTURES[1]}$"])
    batches = (chunk.to_record_batch() for chunk in full.stream())
    first = next((batch for batch in batches if pictures.is_wide(batch)), None)
    if first is None:
        return pictures.grey_of_bits(int(data.frames.bits[0]))
    return pictures.grey_of_sky(pictures.values(first.slice(0, 1)))


def _times(t_s):
    import rerun as rr

    return [rr.TimeColumn(TIMELINE, duration=np.asarray(t_s, np.float64))]


def _curve(stream, entity, t_s, values, colour, name, width=1.2):
    """One curve of a plot."""
    import rerun as rr

    style = rr.SeriesLines(
        colors=[colour],
        names=[name],
        widths=[width],
        aggregation_policy="MinMax",  # the default averages and would flatter every error
    )
    stream.log(entity, style, static=True)
    if len(t_s):
        stream.send_columns(entity, indexes=_times(t_s), columns=rr.Scalars.columns(scalars=values))


def _send_stars(stream, data):
    """Centroids over the picture, identified ones with their Hipparcos number, and the counts as curves."""
    import rerun as rr

    camera = data.mission.camera
    outline = rr.Boxes2D(
        array=[0, 0, camera.width_px, camera.height_px], array_format=rr.Box2DFormat.XYWH, colors=[70, 70, 70]
    )
    plane = rr.CoordinateFrame("star_camera_image_plane")
    marks = [f"stars/{name}" for name in ("outline", "identified", "names", "unidentified")]
    for entity in (*marks, *_PICTURES):  # static: the clearing at the end would take away those of the log
        stream.log(entity, plane, static=True)
    stream.log("stars/outline", outline, static=True)
    fixes = data.star_fixes
    if not fixes:
        return
    t_s = [fix.t_valid_s for fix in fixes]
    known = [np.asarray(fix.hip) > 0 for fix in fixes]
    _marks(stream, "stars/identified", t_s, fixes, known, _GREEN)
    _names(stream, "stars/names", t_s, fixes, known, _GREEN)
    _marks(stream, "stars/unidentified", t_s, fixes, [~k for k in known], _ORANGE)
    _curve(stream, "plots/stars/detected", t_s, [float(len(k)) for k in known], _ORANGE, "detected")
    _curve(stream, "plots/stars/identified", t_s, [float(k.sum()) for k in known], _GREEN, "identified")
    stream.set_time(TIMELINE, duration=t_s[-1] + layout.FRAME_SHOWN_S)
    for entity in (*marks[1:], *_PICTURES):
        stream.log(entity, rr.Clear(recursive=False))
    stream.reset_time()


def _marks(stream, entity, t_s, fixes, chosen, colour):
    """A square around each chosen detection."""
    import rerun as rr

    centres, counts = _centres(fixes, chosen)
    stream.log(entity, rr.Boxes2D.from_fields(radii=[-0.8], colors=[colour]), static=True)
    columns = rr.Boxes2D.columns(centers=centres, half_sizes=np.full_like(centres, _MARK_PX))
    stream.send_columns(entity, indexes=_times(t_s), columns=columns.partition(counts))


def _names(stream, entity, t_s, fixes, chosen, colour):
    """The Hipparcos number below each chosen detection."""
    import rerun as rr

    centres, counts = _centres(fixes, chosen)
    names = [f"HIP {hip}" for fix, c in zip(fixes, chosen, strict=True) for hip in fix.hip[c]]
    style = rr.Points2D.from_fields(radii=[0.0], colors=[colour], show_labels=True)
    stream.log(entity, style, static=True)
    columns = rr.Points2D.columns(positions=centres + np.array([0.0, _MARK_PX]), labels=names)
    stream.send_columns(entity, indexes=_times(t_s), columns=columns.partition(counts))


def _centres(fixes, chosen):
    """Positions of all chosen detections, how many each fix has; rerun counts from the corner of pixel 0."""
    xy_px = [fix.detections.xy_px[c] + 0.5 for fix, c in zip(fixes, chosen, strict=True)]
    return np.concatenate(xy_px), [len(xy) for xy in xy_px]


def plot_step(t_s):
    """Every how many samples there is a point of a curve."""
    if len(t_s) < 2:
        return 1
    rate = (len(t_s) - 1) / (t_s[-1] - t_s[0])
    return max(1, round(rate / _PLOT_HZ), -(-len(t_s) // _MOST_POINTS))


def _send_errors(stream, data):
    """Error of every axis inside plus and minus three of its logged standard deviations."""
    errors = metrics.navigation_errors(data)
    sigma_t_s, _, sigma = metrics.normalised_errors(data, errors)
    nine = np.hstack([errors.position_i, errors.velocity_i, np.degrees(errors.attitude_b)])
    sigma = np.hstack([sigma[:, :6], np.degrees(sigma[:, 6:])])
    shown = plot_step(errors.t_s)
    t_s, nine = errors.t_s[::shown], nine[::shown]
    shown = plot_step(sigma_t_s)
    sigma_t_s, sigma = sigma_t_s[::shown], sigma[::shown]
    for k, plot in enumerate(layout.ERROR_PLOTS):
        for sign, name in ((1.0, "+3 sigma"), (-1.0, "-3 sigma")):
            entity = f"{plot.entity}/{'plus' if sign > 0 else 'minus'}"
            _curve(stream, entity, sigma_t_s, sign * 3.0 * sigma[:, k], (255, 90, 80), name)
        _curve(stream, f"{plot.entity}/error", t_s, nine[:, k], (90, 170, 255), "error")


def _send_flight(stream, data):
    """Height and speed."""
    every = world_view.thinned(data.truth, plot_step(data.truth.t_s))
    track = earth_fixed(data.mission.earth, every)
    _curve(stream, "plots/height", every.t_s, track.height / 1e3, (240, 240, 240), "height [km]")
    speed = np.linalg.norm(track.v_e, axis=1)
    _curve(stream, "plots/speed", every.t_s, speed, (255, 200, 80), "speed [m/s]")
    roll_rate = np.degrees(every.omega_ib_b[:, 0]) / 360.0
    known = np.isfinite(roll_rate)  # which the truth of external data does not say
    _curve(stream, "plots/roll_rate", every.t_s[known], roll_rate[known], (150, 200, 255), "roll rate [1/s]")


def _send_control(stream, data):
    """Pointing error about each axis, and the gas."""
    control = data.control
    if not len(control.t_s):
        return
    colours = ((255, 120, 120), (120, 255, 120), (120, 160, 255))
    for k, (axis, colour) in enumerate(zip("xyz", colours, strict=True)):
        error_deg = np.degrees(control.pointing_error[:, k])
        known = np.isfinite(error_deg)
        _curve(
            stream, f"plots/pointing/{axis}", control.t_s[known], error_deg[known], colour, f"about {axis}"
        )
    _curve(stream, "plots/gas", control.t_s, control.propellant_kg, (240, 240, 240), "gas [kg]")


def _send_states(stream, data):
    """Phase of the mission, GPS receiver and star tracker as coloured lanes."""
    phases = {phase.name.lower(): colour for phase, colour in _PHASE_COLOURS.items()}
    _lane(stream, "states/phase", data.truth.t_s, [Phase(p).name.lower() for p in data.truth.phase], phases)
    gps = ["fix" if fix.valid else "no fix" for fix in data.gps]
    _lane(stream, "states/gps", [f.t_valid_s for f in data.gps], gps, {"fix": _GREEN, "no fix": _ORANGE})
    fixes = data.star_fixes
    if fixes:
        colours = {reason.name.lower(): _ORANGE for reason in Reason} | {"solved": _GREEN, "off": _GREY}
        status = ["solved" if f.reason == Reason.NONE else Reason(f.reason).name.lower() for f in fixes]
        t_s = [f.t_valid_s for f in fixes]
        t_s, status = [*t_s, t_s[-1] + layout.FRAME_SHOWN_S], [*status, "off"]
        _lane(stream, "states/star_tracker", t_s, status, colours)


def _lane(stream, entity, t_s, states, colours):
    """A state timeline; only changes are sent."""
    import rerun as rr

    changed = [k for k in range(len(states)) if k == 0 or states[k] != states[k - 1]]
    if not changed:
        return
    labels = [state.replace("_", " ") for state in colours]
    style = rr.StateConfiguration(values=list(colours), labels=labels, colors=list(colours.values()))
    stream.log(entity, style, static=True)
    columns = rr.StateChange.columns(state=[states[k] for k in changed])
    stream.send_columns(entity, indexes=_times([t_s[k] for k in changed]), columns=columns)


def _send_summary(stream, data):
    """The figures of the run as a text."""
    import rerun as rr

    from shefex_nav.report.table import rows

    parts = [f"| {data.mission.scenario}, seed {data.mission.seed} | |", "|---|---|"]
    for section, lines in rows(metrics.summarise(data)):
        parts += [f"| **{section}** | |", *(f"| {name} | {value} |" for name, value in lines)]
    text = rr.TextDocument("\n".join(parts), media_type=rr.MediaType.MARKDOWN)
    stream.log("summary", text, static=True)
