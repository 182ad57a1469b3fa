"""What other filters say of a logged flight: topics /nav/NAME/solution and /nav/NAME/covariance in its log.

The log of a flight stays as it is; they are written into a copy of it.
"""

import re
from pathlib import Path
from typing import NamedTuple

from shefex_nav.files import named, opened, whole
from shefex_nav.log import topics, wire
from shefex_nav.log.run_data import stack
from shefex_nav.log.topics import LogError, check_folder
from shefex_nav.records import NavCovariance, NavSolution, row

KINDS = {"solution": NavSolution, "covariance": NavCovariance}
TOPIC = re.compile(r"/nav/([a-z][a-z0-9_]*)/(solution|covariance)")
NAME = "lower-case letters, digits and _, a letter first"


class Other(NamedTuple):
    """Another solution of a flight."""

    nav: NavSolution  # arrays
    covariance: NavCovariance  # arrays; empty where the filter gives none


def check_name(name):
    """ValueError unless a solution may have this name."""
    if not isinstance(name, str) or TOPIC.fullmatch(f"/nav/{name}/solution") is None:
        raise ValueError(f"name {name!r}: expected {NAME}")


def read(raw):
    """{name: Other} of a reader's raw content: of its topics that are such."""
    found = {}
    for channel in raw.channels.values():
        if (match := TOPIC.fullmatch(channel.topic)) is None:
            continue
        name, kind = match.groups()
        topic = wire.as_stored(raw.schemas[channel.schema_id].data, topics.of_record(KINDS[kind]))
        if topic is None:
            continue
        decoded = wire.codec(topic).decode(raw.messages.get(channel.topic, []))
        arrays = stack(KINDS[kind], decoded) if isinstance(decoded, list) else decoded
        found.setdefault(name, {kind: stack(of, []) for kind, of in KINDS.items()})[kind] = arrays
    return {
        name: Other(*(one[kind] for kind in KINDS)) for name, one in found.items() if len(one["solution"].t_s)
    }


def write(source, path, mission, others):
    """Copy a log to a path with other solutions in it; those of the same name are replaced.

    source, path : files;  mission : Mission of the log;  others : {name: Other}
    Raises LogError where `path` exists or cannot be written, ValueError for a name that no reader would find.
    """
    from mcap.writer import Writer

    for name in others:
        check_name(name)
    path = Path(path)
    if path.exists():
        raise LogError(f"{path}: exists already; choose another name")
    check_folder(path)
    with whole(path) as part, part.open("wb") as file:
        writer = Writer(file)
        writer.start()
        _copy(source, writer, others)
        for name, other in others.items():
            for kind, arrays in zip(KINDS, other, strict=True):
                _add(writer, f"/nav/{name}/{kind}", arrays, mission)
        writer.finish()


def _copy(source, writer, others):
    """All records of a log but the solutions that are replaced."""
    from mcap.reader import NonSeekingReader

    schemas, channels = {}, {}
    with opened(source) as file, named(source):
        reader = NonSeekingReader(file)
        for record in reader.iter_metadata():
            writer.add_metadata(record.name, record.metadata)
        file.seek(0)
        for one in NonSeekingReader(file).iter_attachments():
            writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
        file.seek(0)
        for schema, channel, message in NonSeekingReader(file).iter_messages(log_time_order=False):
            match = TOPIC.fullmatch(channel.topic)
            if match is not None and match[1] in others:
                continue
            if channel.id not in channels:
                if schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            times = message.log_time, message.data, message.publish_time, message.sequence
            writer.add_message(channels[channel.id], *times)


def _add(writer, name, arrays, mission):
    """Messages of a topic of one of KINDS, of a record of arrays."""
    if not len(arrays.t_s):
        return
    topic = topics.of_record(type(arrays))
    schema = writer.register_schema(f"{wire.PACKAGE}.{topic.schema}", "protobuf", wire.schema_bytes(topic))
    channel = writer.register_channel(name, "protobuf", schema)
    ns = topics.log_time_ns(topics.epoch_ns(mission.epoch_utc), arrays.t_s)
    records = [row(arrays, k) for k in range(len(arrays.t_s))]
    for data, time in zip(wire.codec(topic).encode(records, ns), ns.tolist(), strict=True):
        writer.add_message(channel, time, data, time)
