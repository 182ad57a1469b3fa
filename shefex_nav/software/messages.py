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
from typing import NamedTuple, get_type_hints

import numpy as np

from shefex_nav.fields import T_S, Topic, data, fields_of, flag, integer, matrix, text, vector
from shefex_nav.instruments import TABLE
from shefex_nav.log import topics, wire
from shefex_nav.onboard import own_navigation, own_tracker
from shefex_nav.onboard.startracker import tracker
from shefex_nav.software.codec import Codec
from shefex_nav.software.mission import MissionData

FORMAT = 1  # of these messages; another is refused
HEAD = struct.Struct("<IB")


JSON = {  # what of MissionData goes as a text
    "sheets": text("data sheets of the sensors, SI"),
    "settings": text("what the scenario gives under software.settings"),
}


class Estimate(NamedTuple):
    """own_navigation.Estimate; None: not said."""

    r_i: vector("m", "position of the IMU, inertial axes")
    v_i: vector("m/s", "velocity, inertial axes")
    q_ib: vector("", "attitude, body to inertial axes, Hamilton, scalar first", 4)
    P: matrix("", "covariance: position i [m], velocity i [m/s], attitude b [rad]", 9) = None
    omega_ib_b: vector("rad/s", "rate, body axes") = None
    gyro_bias: vector("rad/s", "that has been taken out") = None
    accel_bias: vector("m/s^2", "likewise") = None
    star_aided: flag("a star fix has been used since the start") = False
    do_not_use_position: flag("the position must not be used") = False
    do_not_use_velocity: flag("the velocity must not be used") = False
    do_not_use_attitude: flag("the attitude must not be used") = False
    levels_of_P: flag("make protection levels of P, k sigma by requirements.integrity_risk") = False


def _message(record, comment, **fields):
    """Topic of a message. record : its type, or the name of one that has these fields, {name: annotation}"""
    if isinstance(record, str):
        record = NamedTuple(record, list(fields.items()))
    time = next((name for name in ("t_s", "start_s") if name in record._fields), "")
    return Topic(record, "", record.__name__, None, time, comment, fields_of(record))


OWN = (
    _message(
        "Start",
        "What software is told before the flight.",
        format=integer("of these messages"),
        **{
            f"{name}_json" if name in JSON else name: JSON.get(name, hint)
            for name, hint in get_type_hints(MissionData, include_extras=True).items()
        },
    ),
    _message("Begin", "All has been said that there is before the first tick.", t_s=T_S),
    _message("Ready", "The software has started.", gives_context=flag("it answers a Query")),
    _message("Tick", "All that belongs to a tick has been sent.", t_s=T_S, number=integer("from 1 on")),
    _message(
        "Query",
        "What is known of the picture whose FrameInfo came before?",
        sun_i=vector("", "unit vector to the Sun"),
        earth_velocity_i=vector("m/s", "of the Earth relative to the solar-system barycentre"),
        predicts=flag("whether attitude and rate are wanted"),
        rows=integer("of the picture"),
    ),
    _message(tracker.Context, "What the navigation knows of a picture; what is not known is not sent."),
    _message(
        "Pixels",
        "The picture whose FrameInfo came before.",
        rows=integer("of the picture"),
        columns=integer("of the picture"),
        grey_values=data("row by row, a byte each; two, little endian, of a camera with over 8 bits"),
    ),
    _message("Solve", "The attitude of the picture that came before is wanted.", t_s=T_S),
    _message(
        own_tracker.Solved, "What came out of a picture; what is not sent is not known, or stays as it was."
    ),
    _message("Done", "The answer is whole.", t_s=T_S),
    _message("Failed", "The software has failed.", words=text("why")),
    _message("End", "There are no more ticks.", t_s=T_S),
    _message(Estimate, "What navigation software knows at the end of a tick; None is not sent."),
)

Start, Begin, Ready, Tick, Query, Pixels, Solve, Done, Failed, End = (
    next(one.record for one in OWN if one.schema == name)
    for name in ("Start", "Begin", "Ready", "Tick", "Query", "Pixels", "Solve", "Done", "Failed", "End")
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
        yield data[begin : begin + n].decode("ascii", "replace"), data[begin + n : at + 4 + length]
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
    *known, usable, levels_of_P = estimate
    return Estimate(*known, *(not one for one in usable), bool(levels_of_P))


def estimate_received(sent):
    """own_navigation.Estimate of a messages.Estimate."""
    *known, position, velocity, attitude, levels_of_P = sent
    return own_navigation.Estimate(*known, (not position, not velocity, not attitude), levels_of_P)


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
