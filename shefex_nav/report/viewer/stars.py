"""What the viewer shows of the star tracker: marks over the picture, counts, exposure, the sky around it."""

import math

import numpy as np

from shefex_nav.geometry import distortion
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.records import Reason
from shefex_nav.report.viewer import layout, world
from shefex_nav.report.viewer.drawings import PICTURES
from shefex_nav.report.viewer.sender import BLUE, GREEN, GREY, ORANGE, WHITE, YELLOW

_MARK = 0.0106  # half a side, by the width of the picture
# The picture and its marks have a frame of their own. In that of the calibration the viewer looks from the
# focal length away, and with some (6363.6 px) picture and lowest marks round to one depth: these are hidden.
PLANE = "star_camera_picture"
_SKY_MAGNITUDE = 5.0  # faintest star of the map
_MARKS = tuple(f"stars/{name}" for name in ("identified", "names", "unidentified", "true_places"))
_LANE = "states/star_tracker"
_STATES = {reason.name.lower(): ORANGE for reason in Reason} | {"solved": GREEN, "off": GREY}
SKY_RADIUS = math.radians(50.0)  # of the map


def send(sender, data):
    """Everything of one run."""
    marks(sender, data)
    settings(sender, data)
    status(sender, data)
    if data.star_fixes:
        switched_off(sender, data.star_fixes[-1].t_valid_s, data)
    sky(sender, data)


def marks(sender, data):
    """Centroids over the picture, with Hipparcos numbers if identified; where catalogue stars truly are."""
    import rerun as rr

    camera = data.mission.camera
    outline = rr.Boxes2D(
        array=[0, 0, camera.width_px, camera.height_px], array_format=rr.Box2DFormat.XYWH, colors=[70, 70, 70]
    )
    plane = rr.CoordinateFrame(PLANE)
    for entity in (
        "stars/outline",
        *_MARKS,
        *PICTURES,
    ):  # static: the clearing at the end would take away those of the log
        sender.static(entity, plane)
    sender.static("stars/outline", outline)
    fixes = data.star_fixes
    if not fixes:
        return
    t_s = [fix.t_valid_s for fix in fixes]
    known = [np.asarray(fix.hip) > 0 for fix in fixes]
    half_px = _MARK * camera.width_px
    _squares(sender, "stars/identified", t_s, fixes, known, GREEN, half_px)
    _names(sender, "stars/names", t_s, fixes, known, GREEN, half_px)
    _squares(sender, "stars/unidentified", t_s, fixes, [~k for k in known], ORANGE, half_px)
    _true_places(sender, data.frame_truths)
    sender.curve("plots/stars/detected", t_s, [float(len(k)) for k in known], ORANGE, "detected")
    sender.curve("plots/stars/identified", t_s, [float(k.sum()) for k in known], GREEN, "identified")


def switched_off(sender, t_s, data):
    """Picture and marks are gone a little after the last frame, which was at t_s."""
    end_s = t_s + layout.FRAME_SHOWN_S
    for entity in (*_MARKS, *PICTURES):
        sender.clear(entity, end_s)
    sender.lane(_LANE, [end_s], ["off"], _STATES, world.time_span(data))


def _squares(sender, entity, t_s, fixes, chosen, colour, half_px):
    """A square around each chosen detection, half_px half a side."""
    import rerun as rr

    centres, counts = _centres(fixes, chosen)
    sender.static(entity, rr.Boxes2D.from_fields(radii=[-0.8], colors=[colour]))
    columns = rr.Boxes2D.columns(centers=centres, half_sizes=np.full_like(centres, half_px))
    sender.columns(entity, t_s, columns.partition(counts))


def _names(sender, entity, t_s, fixes, chosen, colour, half_px):
    """The Hipparcos number below the square of each chosen detection."""
    import rerun as rr

    centres, counts = _centres(fixes, chosen)
    names = [f"HIP {hip}" for fix, c in zip(fixes, chosen, strict=True) for hip in fix.hip[c]]
    sender.static(entity, rr.Points2D.from_fields(radii=[0.0], colors=[colour], show_labels=True))
    columns = rr.Points2D.columns(positions=centres + np.array([0.0, half_px]), labels=names)
    sender.columns(entity, t_s, columns.partition(counts))


def _true_places(sender, truths):
    """A dot where each bright catalogue star on the detector truly is, found or not."""
    import rerun as rr

    if not truths:
        return
    places = [truth.xy_px + 0.5 for truth in truths]
    sender.static("stars/true_places", rr.Points2D.from_fields(radii=[-1.5], colors=[BLUE]))
    columns = rr.Points2D.columns(positions=np.concatenate(places))
    times = [truth.t_valid_s for truth in truths]
    sender.columns("stars/true_places", times, columns.partition([len(xy) for xy in places]))


def _centres(fixes, chosen):
    """Positions of all chosen detections, how many each fix has; rerun counts from the corner of pixel 0."""
    xy_px = [fix.detections.xy_px[c] + 0.5 for fix, c in zip(fixes, chosen, strict=True)]
    return np.concatenate(xy_px), [len(xy) for xy in xy_px]


def settings(sender, data):
    """Exposure and gain of the frames, their background, how well the stars fit, the time it took."""
    frames, fixes, clock = data.frames, data.star_fixes, data.compute_times
    times = [fix.t_valid_s for fix in fixes]
    if fixes:
        sender.curve("plots/residual", times, [f.residual_px for f in fixes], GREEN, "residual [px]")
    if len(frames.t_valid_s):
        t_s, full_dn = frames.t_valid_s, 2.0 ** float(frames.bits[0]) - 1.0
        percent = [100.0 * f.background_dn / full_dn for f in fixes]  # with milliseconds and dB on one scale
        sender.curve("plots/exposure/exposure", t_s, 1e3 * frames.exposure_s, YELLOW, "exposure [ms]")
        sender.curve("plots/exposure/gain", t_s, frames.gain_db, BLUE, "gain [dB]")
        sender.curve("plots/exposure/background", times, percent, GREY, "mean grey value [%]")
    if len(clock.t_s):
        sender.curve("plots/chain_time", clock.t_s, 1e3 * clock.chain_s, WHITE, "chain [ms]")


def status(sender, data):
    """Solved, or why not, as a coloured lane."""
    fixes = data.star_fixes
    if not fixes:
        return
    states = ["solved" if f.reason == Reason.NONE else Reason(f.reason).name.lower() for f in fixes]
    sender.lane(_LANE, [f.t_valid_s for f in fixes], states, _STATES, world.time_span(data))


def sky(sender, data):
    """The stars around the camera, and where it looks: degrees, north up, east left."""
    import rerun as rr

    if not data.frame_truths:
        return
    looks_i = boresights(data.frame_truths)
    C_ms = map_axes(looks_i.mean(axis=0))
    star_map(sender, C_ms, data.mission)
    path, seen = on_map(C_ms, looks_i)
    sender.static("sky/path", rr.LineStrips2D([path[seen]], colors=[GREY], radii=[-1.0]))
    field(sender, C_ms, data)


def boresights(truths):
    """Where the camera truly looks, inertial axes. list of FrameTruth -> (n, 3)"""
    return np.array([dcm_from_quat(truth.q_ic)[:, 2] for truth in truths])


def star_map(sender, C_ms, mission):
    """The stars of the map. C_ms : as of `map_axes`"""
    import rerun as rr

    from shefex_nav.environment import stars

    catalogue = stars.load_catalogue(_SKY_MAGNITUDE)
    xy, near = on_map(C_ms, stars.at_epoch(catalogue, float(mission.epoch_utc[:4])).u_i)
    size = 0.9 * (_SKY_MAGNITUDE + 0.6 - catalogue.vmag[near]) / _SKY_MAGNITUDE
    sender.static("sky/stars", rr.Points2D(xy[near], radii=size.clip(0.12), colors=[(220, 220, 255)]))


def field(sender, C_ms, data):
    """The field of the camera on the map. C_ms : as of `map_axes`"""
    import rerun as rr

    truths, mission = data.frame_truths, data.mission
    border = distortion.border(mission.camera, mission.distortion)
    corners = np.column_stack([border, np.ones(len(border))])
    strips = [on_map(C_ms, (dcm_from_quat(truth.q_ic) @ corners.T).T)[0] for truth in truths]
    columns = rr.LineStrips2D.columns(strips=strips)
    sender.static("sky/field", rr.LineStrips2D.from_fields(colors=[GREEN], radii=[-1.5]))
    sender.columns("sky/field", [truth.t_valid_s for truth in truths], columns.partition([1] * len(strips)))


def map_axes(middle_i):
    """Axes of the map as rows: east, north, and its middle. (3,) direction -> (3, 3)."""
    z = middle_i / np.linalg.norm(middle_i)
    pole = np.array([0.0, 0.0, 1.0]) if abs(z[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    east = np.cross(pole, z)
    east = east / np.linalg.norm(east)
    return np.array([east, np.cross(z, east), z])


def on_map(C_ms, u_i):
    """Azimuthal equidistant places [deg], x to the west, y to the south; which of them are near.

    (3, 3), (n, 3) -> (n, 2), (n,) bool
    """
    east, north, toward = C_ms @ (np.asarray(u_i) / np.linalg.norm(u_i, axis=1, keepdims=True)).T
    angle = np.arccos(np.clip(toward, -1.0, 1.0))
    scale = np.degrees(angle) / np.maximum(np.hypot(east, north), 1e-12)
    return np.column_stack([-east * scale, -north * scale]), angle < SKY_RADIUS
