"""What goes between the simulator and a program of somebody's own: the messages of the log, and some more.

On the wire a message is: its length (4 bytes, little endian, of what follows), the length of its name
(1 byte), its name in ASCII, and the message, protobuf of package shefex. `proto` has all of them as text.

    simulator   Start, Alignment, Begin           ->
                                                  <-  Ready
    each tick   ImuBlock, what arrives, Tick      ->
                                                  <-  Estimate or NavSolution ..., Done
    a picture   FrameInfo, Query                  ->      (if Ready says that it gives a context)
                                                  <-  Context, Done

A computer gets pictures among what arrives, FrameInfo and Pixels. A star tracker gets no Alignment, and
    a picture   FrameInfo, Pixels, Context, Solve ->
                                                  <-  Solved, Done
    at the end  End                               ->
"""

import json
import struct
from dataclasses import asdict
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.instruments import TABLE
from shefex_nav.log import topics, wire
from shefex_nav.log.fields import Topic, data, flag, integer, matrix, member, number, text, vector
from shefex_nav.onboard import own_navigation, own_tracker
from shefex_nav.onboard.startracker import tracker
from shefex_nav.records import Reason
from shefex_nav.software.codec import Codec
from shefex_nav.software.mission import MissionData

FORMAT = 1  # of these messages; another is refused
HEAD = struct.Struct("<IB")


class Start(NamedTuple):
    """What software is told before the flight."""

    format: int
    epoch_utc: str
    start_s: float
    earth: EarthRotation
    sun_i: np.ndarray
    earth_velocity_i: np.ndarray
    camera: Pinhole
    C_bc: np.ndarray
    sigma_mounting: float
    l_ba_b: np.ndarray
    sheets_json: str
    settings_json: str
    scenario: str


class Estimate(NamedTuple):
    """own_navigation.Estimate; None: not said."""

    r_i: np.ndarray
    v_i: np.ndarray
    q_ib: np.ndarray
    P: np.ndarray | None = None
    omega_ib_b: np.ndarray | None = None
    gyro_bias: np.ndarray | None = None
    accel_bias: np.ndarray | None = None
    star_aided: bool = False
    do_not_use_position: bool = False
    do_not_use_velocity: bool = False
    do_not_use_attitude: bool = False


def _message(record, comment, *fields):
    """Topic of a message. record : its type, or the name of one that has the fields of the message"""
    if isinstance(record, str):
        record = NamedTuple(record, [(field.source, object) for field in fields])
    time = next((name for name in ("t_s", "start_s") if name in record._fields), "")
    return Topic(record, "", record.__name__, None, time, comment, fields)


OWN = (
    _message(
        Start, "What software is told before the flight.",
        integer("format", "of these messages"),
        text("epoch_utc", "ISO 8601, mission time 0"),
        number("start_s", "s", "mission time at which it is switched on"),
        *topics.EARTH,
        vector("sun_i", "", "unit vector to the Sun, inertial axes"),
        vector("earth_velocity_i", "m/s", "of the Earth relative to the solar-system barycentre"),
        *topics.CAMERA,
        matrix("C_bc", "", "nominal mounting, camera to body axes"),
        number("sigma_mounting", "rad", "of that, each axis"),
        vector("l_ba_b", "m", "IMU to GPS antenna, body axes"),
        text("sheets_json", "data sheets of the sensors, SI"),
        text("settings_json", "what the scenario gives under software.settings"),
        text("scenario", "YAML text of all of it"),
    ),
    _message("Begin", "All has been said that there is before the first tick.", topics.T_S),
    _message("Ready", "The software has started.", flag("gives_context", "it answers a Query")),
    _message("Tick", "All that belongs to a tick has been sent.", topics.T_S, integer("number", "from 1 on")),
    _message(
        "Query", "What is known of the picture whose FrameInfo came before?",
        vector("sun_i", "", "unit vector to the Sun"),
        vector("earth_velocity_i", "m/s", "of the Earth relative to the solar-system barycentre"),
        flag("predicts", "whether attitude and rate are wanted"),
        integer("rows", "of the picture"),
    ),
    _message(
        tracker.Context, "What the navigation knows of a picture; what is not known is not sent.",
        vector("velocity_i", "m/s", "of the vehicle relative to the solar-system barycentre"),
        number("rate", "rad/s", "of the body"),
        number("sun_angle", "rad", "boresight to the Sun"),
        number("limb_angle", "rad", "boresight to the Earth's limb"),
        vector("q_ic", "", "predicted attitude, camera to inertial axes", 4),
        matrix("P_c", "rad^2", "of that, camera axes"),
        vector("omega_c", "rad/s", "mean rate of the exposure, camera axes"),
        matrix("P_omega_c", "", "of that [rad^2/s^2]"),
        number("unsteady_c", "", "s from its instant; turn besides the mean rate [rad], x y z", (-1, 4)),
        number("unsteady_variance", "rad^2", "of the mean of that, each axis"),
    ),
    _message(
        "Pixels", "The picture whose FrameInfo came before.",
        integer("rows", "of the picture"),
        integer("columns", "of the picture"),
        data("grey_values", "row by row, a byte each; two, little endian, of a camera with over 8 bits"),
    ),
    _message("Solve", "The attitude of the picture that came before is wanted.", topics.T_S),
    _message(
        own_tracker.Solved, "What came out of a picture; what is not sent is not known, or stays as it was.",
        vector("q_ic", "", "attitude, camera to inertial axes, at the middle of the exposure", 4),
        matrix("P_c", "rad^2", "covariance of its error, a rotation vector in camera axes"),
        member("reason", Reason, "why there is no attitude"),
        number("exposure_s", "s", "of the next picture"),
        number("gain_db", "dB", "of the next picture"),
        number("xy_px", "px", "objects found, x, y of each", (-1, 2)),
        number("flux_dn", "DN", "their light above the background", (-1,)),
        integer("hip", "their Hipparcos numbers, 0 where unidentified", (-1,)),
        integer("number", "of the picture; a computer says it"),
    ),
    _message("Done", "The answer is whole.", topics.T_S),
    _message("Failed", "The software has failed.", text("words", "why")),
    _message("End", "There are no more ticks.", topics.T_S),
    _message(
        Estimate, "What navigation software knows at the end of a tick; None is not sent.",
        vector("r_i", "m", "position of the IMU, inertial axes"),
        vector("v_i", "m/s", "velocity, inertial axes"),
        vector("q_ib", "", "attitude, body to inertial axes, Hamilton, scalar first", 4),
        matrix("P", "", "covariance: position i [m], velocity i [m/s], attitude b [rad]", 9),
        vector("omega_ib_b", "rad/s", "rate, body axes"),
        vector("gyro_bias", "rad/s", "that has been taken out"),
        vector("accel_bias", "m/s^2", "likewise"),
        flag("star_aided", "a star fix has been used since the start"),
        flag("do_not_use_position", "the position must not be used"),
        flag("do_not_use_velocity", "the velocity must not be used"),
        flag("do_not_use_attitude", "the attitude must not be used"),
    ),
)  # fmt: skip

Begin, Ready, Tick, Query, Pixels, Solve, Done, Failed, End = (
    next(one.record for one in OWN if one.schema == name)
    for name in ("Begin", "Ready", "Tick", "Query", "Pixels", "Solve", "Done", "Failed", "End")
)


def _codecs():
    """{type of record: (head without the length, Codec)}, and {name: Codec}, of the instruments of now."""
    return _codecs_with(tuple(one.record for one in TABLE.values()))


@cache
def _codecs_with(_records):
    made = [Codec(topic) for topic in (*OWN, *topics.topics())]
    heads = {one.topic.record: (one.topic.schema.encode("ascii"), one) for one in made}
    return heads, {one.topic.schema: one for one in made}


def pack(record):
    """A record as the bytes of its message on the wire."""
    name, codec = _codecs()[0][type(record)]
    body = codec.encode(record)
    return b"".join((HEAD.pack(1 + len(name) + len(body), len(name)), name, body))


def unpack(name, body):
    """Record of a message; None if the name is not known. ValueError"""
    codec = _codecs()[1].get(name)
    return None if codec is None else codec.decode(body)


def split(data):
    """Messages in some bytes: iterator of (name, body)."""
    at = 0
    while at < len(data):
        length, n = HEAD.unpack_from(data, at)
        begin = at + HEAD.size
        yield data[begin : begin + n].decode("ascii"), data[begin + n : at + 4 + length]
        at += 4 + length


def start_of(mission):
    """Start of MissionData."""
    sheets = {name: asdict(sheet) for name, sheet in mission.sheets.items()}
    values = mission._asdict() | {"format": FORMAT, "sheets_json": _json(sheets)}
    values["settings_json"] = _json(mission.settings)
    return Start(**{name: values[name] for name in Start._fields})


def mission_of(start):
    """MissionData of a Start; its sheets have attributes as the settings themselves have."""
    values = {name: getattr(start, name) for name in MissionData._fields if name in Start._fields}
    sheets = json.loads(start.sheets_json, object_hook=lambda found: SimpleNamespace(**found))
    return MissionData(**values, sheets=vars(sheets), settings=json.loads(start.settings_json))


def _json(values):
    return json.dumps(values, default=lambda value: getattr(value, "tolist", lambda: str(value))())


def estimate_to_send(estimate):
    """messages.Estimate of an own_navigation.Estimate."""
    *known, usable = estimate
    return Estimate(*known, *(not one for one in usable))


def estimate_received(sent):
    """own_navigation.Estimate of a messages.Estimate."""
    *known, position, velocity, attitude = sent
    return own_navigation.Estimate(*known, (not position, not velocity, not attitude))


def pixels_of(frame):
    """Pixels of a Frame."""
    image = frame.image_dn
    little = image.astype(image.dtype.newbyteorder("<"), copy=False)
    return Pixels(*image.shape, np.ascontiguousarray(little).tobytes())


def with_pixels(frame, pixels):
    """A Frame with the picture of its Pixels."""
    dtype = np.dtype("u1" if frame.bits <= 8 else "<u2")
    return frame._replace(
        image_dn=np.frombuffer(pixels.grey_values, dtype).reshape(pixels.rows, pixels.columns)
    )


def proto():
    """All messages as the text of a .proto file."""
    from google.protobuf import descriptor_pb2

    lines = ['syntax = "proto3";', f"package {wire.PACKAGE};"]
    for topic in (*OWN, *topics.topics()):
        file = wire.file_descriptor(topic)
        lines += ["", *_proto_message(file, descriptor_pb2.FieldDescriptorProto)]
    return "\n".join(lines) + "\n"


def _proto_message(file, kinds):
    """Lines of the one message of a FileDescriptorProto."""
    (message,), comments = file.message_type, file.source_code_info.location
    lines = [f"// {comments[0].leading_comments}", f"message {message.name} {{"]
    for enum in message.enum_type:
        lines.append(f"  enum {enum.name} {{")
        lines += [f"    {value.name} = {value.number};" for value in enum.value]
        lines.append("  }")
    for one, comment in zip(message.field, comments[1:], strict=True):
        kind = one.type_name.rpartition(".")[2] or kinds.Type.Name(one.type).removeprefix("TYPE_").lower()
        repeated = "repeated " if one.label == one.LABEL_REPEATED else ""
        lines.append(f"  {repeated}{kind} {one.name} = {one.number};  // {comment.leading_comments}")
    return [*lines, "}"]
