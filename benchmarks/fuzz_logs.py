"""Logs that are whole files with something else in them, for `fuzz`: values, lists, topics, attachments.

`mutations.data` damages the bytes of a file, which mostly spoils a checksum. Here a log is taken apart to its
messages, changed and written again, with the checksums of what is in it now.
"""

import re
import struct
from typing import NamedTuple

import mutations

NUMBERS = float("nan"), float("inf"), -float("inf"), 0.0, -1.0, 1e-308, 1e9, -1e9, 1e14, 1e308
WHOLE = 0, -1, 1, 99, 2**31 - 1, -(2**31)
LONG = 0, -1, 2**63 - 1, -(2**63)  # of 64 bits
TEXTS = "", "[bold]", "\x1b[31m", "x" * 300, "../..", "ü"
SMALL = 2000  # messages: so many of a topic, or fewer, are changed all at once
NO_NUMBER = re.compile(r"(?<![\w.])(NaN|nan|Infinity|inf)(?![\w.])")  # in what a command prints
COMMANDS = (
    "report case.mcap",
    "report case.mcap --json",
    "report case.mcap --html page.html --force",
    "export case.mcap --csv tables --force",
    "export case.mcap --parquet tables --force",
    "export case.mcap --replay recorded --force",
    "export case.mcap --kml track.kml --force",
    "export case.mcap --geojson track.json --force",
    "export case.mcap --frames pictures --force",
    "view case.mcap --save case.rrd --force",
    "compare case.mcap whole.mcap --json",
    "smooth case.mcap --out smoothed.csv --force",
    "replay case.mcap --log again.mcap --force",
)


class Channel(NamedTuple):
    """A topic of a log."""

    topic: str
    schema: object  # mcap Schema
    messages: list  # of mcap Message


class Log(NamedTuple):
    """What a log holds."""

    metadata: list  # of (name, {key: text})
    attachments: list  # of mcap Attachment
    channels: list  # of Channel


def taken_apart(path):
    """Log of a file."""
    from mcap.reader import NonSeekingReader

    found = {}
    with open(path, "rb") as file:
        metadata = [(one.name, one.metadata) for one in NonSeekingReader(file).iter_metadata()]
        file.seek(0)
        attachments = list(NonSeekingReader(file).iter_attachments())
        file.seek(0)
        for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            found.setdefault(channel.id, Channel(channel.topic, schema, [])).messages.append(message)
    return Log(metadata, attachments, list(found.values()))


def put_together(path, log):
    """Write a Log, its messages in the order of their times as they were."""
    from mcap.writer import Writer

    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start()
        for name, content in log.metadata:
            writer.add_metadata(name, content)
        for one in log.attachments:
            writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
        for channel in log.channels:
            schema = channel.schema
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            at = writer.register_channel(channel.topic, "protobuf", number)
            for one in channel.messages:
                writer.add_message(at, one.log_time, one.data, one.publish_time, one.sequence)
        writer.finish()


def spoilt(rng, log):
    """A Log with one to three changes. The one given stays as it is."""
    log = Log(
        [(name, dict(content)) for name, content in log.metadata],
        list(log.attachments),
        [channel._replace(messages=list(channel.messages)) for channel in log.channels],
    )
    for _ in range(min(rng.geometric(0.6), mutations.MOST)):
        way = rng.integers(12)
        if way < 8:
            _spoil_values(rng, _one_of(rng, log.channels))
        elif way == 8:
            _spoil_order(rng, _one_of(rng, log.channels).messages)
        elif way == 9:
            _spoil_topics(rng, log.channels)
        elif way == 10:
            _spoil_attachments(rng, log.attachments)
        else:
            _spoil_metadata(rng, log.metadata)
    return log


def _one_of(rng, many):
    return many[int(rng.integers(len(many)))]


def _spoil_values(rng, channel):
    """The same field of one message of a topic, or of all."""
    messages = channel.messages
    if not messages:
        return
    try:
        kind = message_class(channel.schema)
    except KeyError:  # another change has given the topic the schema of another
        return
    all_of_them = rng.integers(3) == 0 and len(messages) <= SMALL
    start = rng.bit_generator.state
    for k in range(len(messages)) if all_of_them else [int(rng.integers(len(messages)))]:
        if all_of_them:
            rng.bit_generator.state = start  # the same change again
        decoded = kind.FromString(messages[k].data)
        whole = written(decoded) == messages[k].data
        _spoil_field(rng, decoded)
        messages[k] = _with(messages[k], data=written(decoded) if whole else decoded.SerializeToString())


def written(message):
    """Bytes of a message with all fields, zeros too, as numbers of a fixed length are written in a log."""
    found = b""
    for field in message.DESCRIPTOR.fields:
        value, is_list = getattr(message, field.name), field.is_repeated
        parts = [_bytes_of(field, one) for one in (value if is_list else (value,))]
        if is_list and _is_packed(field):
            packed = b"".join(parts)
            found += _varint(field.number << 3 | 2) + _varint(len(packed)) + packed
            continue
        wire = 2 if not _is_packed(field) else {1: 1, 16: 1, 15: 5}.get(field.type, 0)
        found += b"".join(_varint(field.number << 3 | wire) + part for part in parts)
    return found


def _is_packed(field):
    """Whether a list of the field is one run of bytes: of numbers, not of texts, bytes and messages."""
    return field.type not in (field.TYPE_STRING, field.TYPE_BYTES, field.TYPE_MESSAGE)


def _bytes_of(field, value):
    """One value of a field, without its tag."""
    form = {field.TYPE_DOUBLE: "<d", field.TYPE_SFIXED64: "<q", field.TYPE_SFIXED32: "<i"}.get(field.type)
    if form:
        return struct.pack(form, value)
    if _is_packed(field):
        return _varint(int(value))
    text = written(value) if field.type == field.TYPE_MESSAGE else value
    text = text.encode() if isinstance(text, str) else bytes(text)
    return _varint(len(text)) + text


def _varint(value):
    """A whole number in sevens of bits, the lowest first; one below zero has 64 of them."""
    value, found = value & (1 << 64) - 1, []
    while value > 127:
        found.append(value & 127 | 128)
        value >>= 7
    return bytes([*found, value])


def _with(one, **values):
    """A record of mcap with other values."""
    return type(one)(**{**vars(one), **values})


def message_class(schema):
    """Class of the messages of a mcap Schema."""
    from shefex_nav.log import pixels

    return pixels.message_class({}, schema)


def _spoil_field(rng, message):
    """One field of a protobuf message, or of a message in it."""
    field = _one_of(rng, message.DESCRIPTOR.fields)
    many = field.is_repeated if hasattr(field, "is_repeated") else field.label == field.LABEL_REPEATED
    held = getattr(message, field.name)
    if field.type == field.TYPE_MESSAGE:
        if rng.integers(4) == 0 or (many and not held):
            message.ClearField(field.name)
        else:
            _spoil_field(rng, _one_of(rng, held) if many else held)
    elif not many:
        setattr(message, field.name, _odd_value(rng, field))
    elif (way := rng.integers(6)) == 0:
        message.ClearField(field.name)
    elif way == 1:
        held.append(_odd_value(rng, field))
    elif way == 2:
        held.extend(list(held))
    elif way == 3 and held:
        del held[int(rng.integers(len(held))) :]
    elif way == 4:
        held[:] = [_odd_value(rng, field)] * len(held)
    elif held:
        held[int(rng.integers(len(held)))] = _odd_value(rng, field)


def _odd_value(rng, field):
    """A value of the type of a field."""
    if field.type in (field.TYPE_DOUBLE, field.TYPE_FLOAT):
        return _one_of(rng, NUMBERS)
    if field.type == field.TYPE_BOOL:
        return bool(rng.integers(2))
    if field.type == field.TYPE_STRING:
        return _one_of(rng, TEXTS)
    if field.type == field.TYPE_BYTES:
        return bytes(rng.bytes(int(rng.integers(64))))
    value = _one_of(rng, LONG if field.cpp_type in (field.CPPTYPE_INT64, field.CPPTYPE_UINT64) else WHOLE)
    return abs(value) if field.cpp_type in (field.CPPTYPE_UINT32, field.CPPTYPE_UINT64) else value


def _spoil_order(rng, messages):
    """Messages that are missing, come twice, back to front, empty, or with the time of others."""
    if not messages:
        return
    at, way = int(rng.integers(len(messages))), rng.integers(7)
    if way == 0:
        del messages[at:]
    elif way == 1:
        del messages[:at]
    elif way == 2:
        messages.reverse()
    elif way == 3:
        messages[at:at] = messages[at : at + int(rng.integers(1, 50))]
    elif way == 4:
        messages[at] = _with(messages[at], data=b"")
    elif way == 5:
        messages[at] = _with(messages[at], log_time=int(_one_of(rng, (0, 2**63, 2**64 - 1))))
    else:
        messages.clear()


def _spoil_topics(rng, channels):
    """A topic that is missing, comes twice, has the name or the schema of another, or no description."""
    at, other, way = int(rng.integers(len(channels))), _one_of(rng, channels), rng.integers(6)
    one = channels[at]
    if way == 0:
        del channels[at]
    elif way == 1:
        channels.append(one)
    elif way == 2:
        channels[at] = one._replace(topic=other.topic)
    elif way == 3:
        channels[at] = one._replace(schema=other.schema)
    elif way == 4:
        channels[at] = one._replace(schema=_with(one.schema, data=b""))
    else:
        channels[at] = one._replace(messages=other.messages)


def _spoil_attachments(rng, attachments):
    """One that is missing, empty, comes twice, or says something else."""
    if not attachments:
        return
    at, way = int(rng.integers(len(attachments))), rng.integers(4)
    one = attachments[at]
    if way == 0:
        del attachments[at]
    elif way == 1:
        attachments[at] = _with(one, data=b"")
    elif way == 2:
        attachments.append(one)
    else:
        attachments[at] = _with(one, data=mutations.data(rng, one.data))


def _spoil_metadata(rng, metadata):
    """One that is missing, or of which a text is."""
    if not metadata:
        return  # another change has taken it away
    at = int(rng.integers(len(metadata)))
    name, content = metadata[at]
    key, way = _one_of(rng, sorted(content)) if content else "", rng.integers(4)
    if way == 0:
        del metadata[at]
    elif way == 1:
        content.pop(key, None)
    elif way == 2:
        content[key] = _one_of(rng, (*TEXTS, "-1", "1e308", "[]", "[[1]]", "{}", '["a"]', "9" * 30))
    else:
        metadata.append((name, {**content, key: ""}))


def without_number(text):
    """The first line of a text in which NaN or infinity stands, or ''."""
    return next((line for line in text.splitlines() if NO_NUMBER.search(line)), "")
