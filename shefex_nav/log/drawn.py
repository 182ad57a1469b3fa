"""The messages of a log that viewers decode by themselves (`log.drawings`), looked at before one is opened.

A viewer may wait without end for a message that it cannot decode.
"""

from collections.abc import Sequence

from shefex_nav.fields import LARGEST
from shefex_nav.log import pixels
from shefex_nav.log.reader import messages_of, readable
from shefex_nav.log.topics import LogError

KINDS = {  # topic: schema of its messages
    "/tf": "foxglove.FrameTransforms",
    "/gps/location": "foxglove.LocationFix",
    "/log": "foxglove.Log",
    "/star_tracker/calibration": "foxglove.CameraCalibration",
    pixels.FULL: "foxglove.RawImage",
    pixels.THRESHOLDED: "foxglove.RawImage",
}
LAST_NS = 1 << 63  # of log times that are numbers with a sign elsewhere
LAST_S = LAST_NS // 1_000_000_000
MATRICES = {"K": 9, "R": 9, "P": 12}  # of a calibration: numbers
INSTANTS = "google.protobuf.Timestamp", "google.protobuf.Duration"


def check(path):
    """LogError with topic and message unless a log's drawings are what their topics say. path : of the log"""
    from google.protobuf.unknown_fields import UnknownFieldSet

    decoders, counts = {}, dict.fromkeys(KINDS, 0)
    for schema, topic, ns, data in messages_of(path, KINDS):
        counts[topic] += 1
        if schema is None or schema.name != KINDS[topic]:
            got = "nothing" if schema is None else schema.name
            raise LogError(f"{path}: {topic}: is described as {got}, expected {KINDS[topic]}")
        with readable(path, f"a message of {topic}"):
            decoded = pixels.message_class(decoders, schema).FromString(data)
        words = "has fields of something else" if len(UnknownFieldSet(decoded)) else ""
        if words := words or _wrong(topic, decoded, ns):
            raise LogError(f"{path}: {topic}: message {counts[topic]}: {words}")


def _wrong(topic, message, log_time_ns):
    """What a decoded message says that cannot be drawn: words, or ''."""
    if log_time_ns >= LAST_NS:
        return f"log time: got {log_time_ns} ns, expected less than 2^63"
    if topic == "/tf":
        if not message.transforms:
            return "transforms: got none, expected at least one"
        if not all(one.parent_frame_id and one.child_frame_id for one in message.transforms):
            return "transforms: expected the names of two frames"
    if topic == "/star_tracker/calibration":
        for name, size in MATRICES.items():
            if len(held := getattr(message, name)) != size:
                return f"{name}: got {len(held)} numbers, expected {size}"
    if KINDS[topic] == "foxglove.RawImage" and (words := pixels.wrong(message)):
        return words
    return _odd_value(message)


def _odd_value(message):
    """Words about a value that is no number, no instant or no word of its list, also in messages within."""
    if message.DESCRIPTOR.full_name in INSTANTS:
        good = abs(message.seconds) < LAST_S and 0 <= message.nanos < 1_000_000_000
        return "" if good else f"got {message.seconds} s and {message.nanos} ns, expected a time"
    for field, held in message.ListFields():
        kind = field.cpp_type
        for value in held if isinstance(held, Sequence) and not isinstance(held, str | bytes) else (held,):
            words = ""
            if kind == field.CPPTYPE_MESSAGE:
                words = _odd_value(value)
            elif kind == field.CPPTYPE_DOUBLE and abs(value) >= LARGEST:  # NaN: not known
                words = f"got {value:g}, expected a number below {LARGEST:g}"
            elif kind == field.CPPTYPE_ENUM and value not in field.enum_type.values_by_number:
                words = (
                    f"got {value}, expected one of {', '.join(map(str, field.enum_type.values_by_number))}"
                )
            if words:
                return f"{field.name}: {words}"
    return ""
