"""Foxglove messages of the records that viewers can draw: poses, the GPS track, camera pictures, text.

Frames of the drawings: `launch` (east, north, up at the launch site, or below the first point of an orbit,
turning with the Earth), `body` (truth), `body_estimate` (navigation), `star_camera` (camera axes at the
nominal mounting on `body`).
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from foxglove import messages as fox

from shefex_nav.clock import TICK_HZ
from shefex_nav.compiled import kernel
from shefex_nav.geometry.frames import dcm_ie
from shefex_nav.geometry.rotation import quat_from_dcm, quat_multiply
from shefex_nav.geometry.wgs84 import dcm_el, ecef_from_geodetic, geodetic_from_ecef
from shefex_nav.log.pose_columns import PoseMessages, Poses
from shefex_nav.records import Reason

POSE_TICKS = 5  # between two drawn poses at least: 20 Hz is smooth to the eye
LAUNCH, BODY, ESTIMATE, CAMERA = "launch", "body", "body_estimate", "star_camera"
CHANNELS = {  # topic -> message of Foxglove's
    "/tf": "FrameTransforms",
    "/truth/pose": "PoseInFrame",
    "/nav/pose": "PoseInFrame",
    "/gps/location": "LocationFix",
    "/star_tracker/calibration": "CameraCalibration",
    "/star_tracker/annotations": "ImageAnnotations",
    "/star_tracker/image": "RawImage",
    "/star_tracker/image_full": "RawImage",
    "/log": "Log",
}
_GREEN = fox.Color(r=0.25, g=1.0, b=0.35, a=1.0)
_ORANGE = fox.Color(r=1.0, g=0.55, b=0.1, a=1.0)
_NO_BACKGROUND = fox.Color(r=0.0, g=0.0, b=0.0, a=0.0)


class FramePolicy(NamedTuple):
    """Which pixels of the star camera's frames are kept."""

    full_every: int  # every n-th frame as read out, 0 = never
    otherwise: str  # every frame: 'thresholded' (sky background set to zero) or 'none'
    threshold_sigma: float  # above the background, in its standard deviations


def _timestamp(ns):
    return fox.Timestamp(ns // 10**9, ns % 10**9)


def _quaternion(q):
    w, x, y, z = q.tolist()
    return fox.Quaternion(x=x, y=y, z=z, w=w)


def _vector(r):
    x, y, z = r.tolist()
    return fox.Vector3(x=x, y=y, z=z)


def _transform(parent, child, ns, translation, rotation):
    return fox.FrameTransform(
        timestamp=_timestamp(ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=translation,
        rotation=rotation,
    )


class Drawings:
    """Turns records into (topic, message) pairs; remembers what was last said of star tracker and gates."""

    def __init__(self, mission, policy):
        self._mission = mission
        self._policy = policy
        C_el = dcm_el(mission.launch_latitude, mission.launch_longitude)
        self._C_le = np.ascontiguousarray(C_el.T)
        self._r_le_e = ecef_from_geodetic(
            mission.launch_latitude, mission.launch_longitude, mission.launch_height
        )
        self._q_bc = _quaternion(quat_from_dcm(mission.C_bc))
        self._no_shift = fox.Vector3()
        for dtype in (np.uint8, np.uint16):  # loaded now, not during the run
            thresholded(np.zeros((1, 1), dtype), policy.threshold_sigma)
        self._moved = {one: PoseMessages(partial(self._transforms, one)) for one in (BODY, ESTIMATE)}
        self._posed = PoseMessages(self._pose)
        self._last_reason = None
        self._last_notes = {}  # by sensor

    def calibration(self, mission, ns):
        """The camera model, once."""
        k = mission.camera
        f, cx, cy = float(k.focal_length_px), float(k.cx_px), float(k.cy_px)
        yield (
            "/star_tracker/calibration",
            fox.CameraCalibration(
                timestamp=_timestamp(ns),
                frame_id=CAMERA,
                width=int(k.width_px),
                height=int(k.height_px),
                distortion_model="plumb_bob" if mission.distortion else "",
                D=list(mission.distortion),
                K=[f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0],
                R=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
                P=[f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
            ),
        )

    def truth(self, record, ns):
        return self._pose_messages("/truth/pose", BODY, record, ns)

    def navigation(self, record, ns):
        return self._pose_messages("/nav/pose", ESTIMATE, record, ns)

    def _pose_messages(self, topic, child, record, ns):
        """A body with r_i and q_ib in launch axes, as a frame and as a pose; of some ticks alone."""
        if not self._has_pose(record.t_s):
            return ()
        pose = launch_pose(self._mission.earth, self._C_le, self._r_le_e, record.t_s, record.r_i, record.q_ib)
        return ("/tf", self._transforms(child, ns, *pose)), (topic, self._pose(ns, *pose))

    def truth_columns(self, arrays, ns):
        """As `truth`, of TruthSample of arrays over n. -> list of (topic, (m,) rows, list of m bytes)"""
        return self._pose_columns("/truth/pose", BODY, arrays, ns)

    def navigation_columns(self, arrays, ns):
        """As `truth_columns`, of NavSolution of arrays."""
        return self._pose_columns("/nav/pose", ESTIMATE, arrays, ns)

    def _pose_columns(self, topic, child, arrays, ns):
        k = np.flatnonzero(self._has_pose(arrays.t_s))
        parts = (np.ascontiguousarray(column[k]) for column in (arrays.t_s, arrays.r_i, arrays.q_ib))
        poses = Poses(ns[k], *launch_poses(self._mission.earth, self._C_le, self._r_le_e, *parts))
        return [
            ("/tf", k, self._moved[child].encode(poses)),
            (topic, k, self._posed.encode(poses)),
        ]

    def _has_pose(self, t_s):
        """Whether a pose is drawn at a tick, counted from the start as in a thinned log. s, scalar or (n,)"""
        return np.rint((t_s - self._mission.start_s) * TICK_HZ) % POSE_TICKS == 0

    def _transforms(self, child, ns, r_l, q_lb):
        """A body as a frame in launch axes, and the camera on it. s, (3,) m, (4,) -> FrameTransforms"""
        found = [_transform(LAUNCH, child, ns, _vector(r_l), _quaternion(q_lb))]
        if child == BODY:
            found.append(_transform(BODY, CAMERA, ns, self._no_shift, self._q_bc))
        return fox.FrameTransforms(transforms=found)

    def _pose(self, ns, r_l, q_lb):
        """A pose in launch axes. int, (3,) m, (4,) -> PoseInFrame"""
        pose = fox.Pose(position=_vector(r_l), orientation=_quaternion(q_lb))
        return fox.PoseInFrame(timestamp=_timestamp(ns), frame_id=LAUNCH, pose=pose)

    def gps(self, record, ns):
        if not record.valid:
            return
        latitude, longitude, height = geodetic_from_ecef(np.asarray(record.r_ea_e, np.float64))
        C_le = dcm_el(latitude, longitude).T
        yield (
            "/gps/location",
            fox.LocationFix(
                timestamp=_timestamp(ns),
                frame_id="gps_antenna",
                latitude=np.degrees(latitude),
                longitude=np.degrees(longitude),
                altitude=math.nan if record.horizontal else height,
                position_covariance=(C_le @ record.R_r_e @ C_le.T).ravel().tolist(),  # east, north, up
                position_covariance_type=fox.LocationFixPositionCovarianceType.Known,
            ),
        )

    def frame(self, record, ns):
        policy = self._policy
        if policy.full_every and record.number % policy.full_every == 0:
            yield "/star_tracker/image_full", _image(record.image_dn, ns)
        if policy.otherwise == "thresholded":
            yield "/star_tracker/image", _image(thresholded(record.image_dn, policy.threshold_sigma), ns)

    def star_fix(self, record, ns):
        """Centroids with Hipparcos numbers, and a line of text when the status changes."""
        stamp = _timestamp(ns)
        corner_xy = np.round(record.detections.xy_px, 2) + 0.5  # the corner, not the centre, of pixel 0
        points = [fox.Point2(x=x, y=y) for x, y in corner_xy.tolist()]
        is_known = [hip > 0 for hip in record.hip]
        named = [
            fox.TextAnnotation(
                timestamp=stamp,
                position=point,
                text=f"HIP {hip}",
                font_size=10.0,
                text_color=_GREEN,
                background_color=_NO_BACKGROUND,
            )
            for point, hip in zip(points, record.hip, strict=True)
            if hip > 0
        ]
        marked = fox.PointsAnnotation(
            timestamp=stamp,
            type=fox.PointsAnnotationType.Points,
            points=points,
            outline_colors=[_GREEN if known else _ORANGE for known in is_known],
            thickness=6.0,
        )
        yield (
            "/star_tracker/annotations",
            fox.ImageAnnotations(timestamp=stamp, points=[marked] if points else [], texts=named),
        )
        if record.reason != self._last_reason:
            self._last_reason = record.reason
            status = Reason(record.reason).name.lower().replace("_", " ")
            text = "attitude found" if record.reason == Reason.NONE else f"no attitude: {status}"
            yield "/log", _line(ns, fox.LogLevel.Debug, "star_tracker", f"star tracker: {text}")

    def gate(self, record, ns):
        """A line of text when the filter has something new to say of a sensor."""
        if record.note == self._last_notes.get(record.sensor, ""):
            return
        self._last_notes[record.sensor] = record.note
        if record.note:
            numbers = f" (NIS {record.nis:.1f}, limit {record.limit:.1f})" if np.isfinite(record.nis) else ""
            text = f"{record.sensor.replace('_', ' ')}: {record.note}{numbers}"
            yield "/log", _line(ns, fox.LogLevel.Warning, "navigation", text)

    def event(self, record, ns):
        detail = f": {record.detail}" if record.detail else ""
        name = record.name.replace("_", " ")
        text = f"T{record.t_s:+.1f} s  {name}, {record.altitude_m / 1e3:.1f} km{detail}"
        yield "/log", _line(ns, fox.LogLevel.Info, "mission", text)


@kernel
def launch_pose(earth, C_le, r_le_e, t_s, r_i, q_ib):
    """Position [m] and attitude (q_lb) in launch axes of a body given in inertial axes.

    C_le: Earth-fixed to launch axes, r_le_e: launch site from the centre of the Earth, Earth-fixed axes [m].
    """
    C_li = C_le @ np.ascontiguousarray(dcm_ie(earth, t_s).T)
    return C_li @ r_i - C_le @ r_le_e, quat_multiply(quat_from_dcm(C_li), q_ib)


@kernel
def launch_poses(earth, C_le, r_le_e, t_s, r_i, q_ib):
    """`launch_pose` of n instants. t_s (n,); r_i (n, 3); q_ib (n, 4) -> (n, 3) m, (n, 4)"""
    r_l, q_lb = np.empty(r_i.shape), np.empty(q_ib.shape)
    for k in range(len(t_s)):
        r_l[k], q_lb[k] = launch_pose(earth, C_le, r_le_e, t_s[k], r_i[k], q_ib[k])
    return r_l, q_lb


def _line(ns, level, name, message):
    return fox.Log(timestamp=_timestamp(ns), level=level, name=name, message=message)


def _image(image_dn, ns):
    """A picture with its grey values as measured: mono16 is not shifted up to 16 bits.

    Whoever reads the log finds the camera's numbers, and how many bits they have in /star_tracker/frame.
    Foxglove's image panel lets the range that it draws be set (least and greatest value); our viewer makes
    12-bit pictures bright by itself (`report.viewer.drawings`).
    """
    rows, columns = image_dn.shape
    return fox.RawImage(
        timestamp=_timestamp(ns),
        frame_id=CAMERA,
        width=columns,
        height=rows,
        encoding="mono8" if image_dn.dtype == np.uint8 else "mono16",
        step=columns * image_dn.itemsize,
        data=image_dn.astype(image_dn.dtype.newbyteorder("<"), copy=False).tobytes(),
    )


@kernel
def thresholded(image_dn, threshold_sigma):
    """The frame with everything below mean + threshold_sigma * standard deviation of its background at zero.

    The background is what lies within 4 standard deviations of the median, found by clipping the histogram of
    every sixteenth row three times. (rows, columns) uint8 or uint16 -> the same.
    """
    narrow = image_dn.dtype.type
    largest = 256**image_dn.itemsize - 1
    counts = np.zeros(largest + 1, dtype=np.int64)
    for r in range(0, image_dn.shape[0], 16):
        for value in image_dn[r]:
            counts[value] += 1
    half, below, median = 0.5 * counts.sum(), counts[0], 0
    while below < half:
        median += 1
        below += counts[median]
    low, high = 0.0, 2.0 * median + 4.0  # stars are bright: nothing of the sky is above twice its median
    mean, sigma = 0.0, 0.0
    for _ in range(3):
        n, total, squares = 0, 0, 0
        for level in range(max(0, int(np.ceil(low))), min(largest, int(np.floor(high))) + 1):
            n += counts[level]
            total += counts[level] * level
            squares += counts[level] * level * level  # whole numbers: nothing is rounded
        mean = total / n
        sigma = np.sqrt(max(squares / n - mean * mean, 0.0))
        low, high = mean - 4.0 * sigma - 1.0, mean + 4.0 * sigma + 1.0
    threshold = narrow(min(float(largest), np.ceil(mean + threshold_sigma * sigma)))
    kept = np.empty_like(image_dn)
    for r in range(image_dn.shape[0]):
        row, kept_row = image_dn[r], kept[r]  # of one row, the compiler takes many pixels at a time
        for c in range(image_dn.shape[1]):
            kept_row[c] = row[c] if row[c] >= threshold else narrow(0)
    return kept
