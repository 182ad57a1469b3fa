"""Reads a log back as arrays, finished or not.

The file is read from front to back, chunk by chunk, so that one whose writer was killed needs no other
way: reading stops at the first record that is not complete.
"""

import shlex
import struct
import zlib
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

from shefex_nav import plugins
from shefex_nav.files import named, opened
from shefex_nav.log import checked, other_solutions, topics, wire
from shefex_nav.log.mcap_file import CHANNEL_OF, HEAD, MAGIC, Op, parts
from shefex_nav.log.run_data import LISTS, gather, kept_as_arrays, stack
from shefex_nav.log.topics import LogError, Mission
from shefex_nav.records import Alignment

_LONGEST = 4 << 30  # bytes of a record; what claims more is no record
_LARGEST_CHUNK = 1 << 28  # bytes unpacked; what claims more is not unpacked,
_SMALL_CHUNK, _TIMES = 1 << 24, 500  # nor what claims so many times its size beyond that
_CHECKSUM = struct.Struct("<I")  # CRC-32; 0: there is none
_MESSAGE_HEAD = struct.Struct("<HIQQ")  # channel, sequence number, log time, publish time


class _Raw(NamedTuple):
    """Content of a file before decoding; filled while reading."""

    messages: dict  # topic -> list of bytes; empty unless it is one of our own
    schemas: dict  # schema number -> mcap Schema
    channels: dict  # channel number -> mcap Channel
    metadata: dict
    attachments: dict  # name -> bytes


def read(path):
    """RunData of a log; LogError with the reason when that is impossible."""
    raw, is_complete = _read_file(Path(path))
    arrays, lists, single, steady = {}, {}, {}, kept_as_arrays()
    for topic in _stored_topics(path, raw):
        with readable(path, f"a message of {topic.topic}"):
            decoded = wire.codec(topic).decode(raw.messages.pop(topic.topic, []))  # not kept twice
            if topic.record in steady and isinstance(decoded, list):
                decoded = stack(topic.record, decoded)
        checked.check(path, topic.topic, topic.record, decoded)
        if topic.record in steady:
            arrays[topic.record] = decoded
        elif topic.record in LISTS:
            lists[topic.record] = decoded
        else:
            single[topic.record] = _last(decoded)
    if single[Mission] is None:
        raise LogError(f"{path}: the log ends before its first record")
    mission = checked.mission(path, single[Mission], raw)
    data = gather(mission, arrays, lists, single[Alignment], ended_early=not is_complete)
    with readable(path, "another solution"):
        others = other_solutions.read(raw)
    for name, other in others.items():
        for record in (other.nav, other.covariance):
            checked.check(path, f"solution '{name}'", type(record), record)
    # a flight that was interrupted, or failed, closes its file, but has no last record
    return data._replace(others=others, ended_early=data.ended_early or data.summary is None)


@contextmanager
def readable(path, what):
    """LogError where `what` of a log cannot be decoded."""
    from google.protobuf.message import DecodeError

    try:
        yield
    except LogError as error:
        raise LogError(f"{path}: {error}") from error
    except (DecodeError, LookupError, OverflowError, TypeError, struct.error, *_damage_errors()) as error:
        raise LogError(f"{path}: damaged: {what} cannot be read: {error}") from error


def _stored_topics(path, raw):
    """The topics of the table, with the fields that the log has."""
    found = raw.metadata.get("format")
    if found is None:
        raise LogError(f"{path}: an MCAP file, but not a log of shefex_nav (no metadata '{topics.METADATA}')")
    if found != topics.FORMAT:
        raise LogError(f"{path}: the log has format {found}, this version reads format {topics.FORMAT}")
    stored = {topic.topic: topic for topic in topics.topics()}
    for channel in raw.channels.values():
        if channel.topic not in stored:
            continue
        with readable(path, f"the description of {channel.topic}"):
            schema = raw.schemas[channel.schema_id]
            stored[channel.topic] = wire.as_stored(schema.data, stored[channel.topic])
        if stored[channel.topic] is None:
            version = raw.metadata.get("version", "another one")
            raise LogError(
                f"{path}: {channel.topic} has other fields than this version knows; {version} wrote it"
            )
    return stored.values()


def _last(decoded):
    """The last message of a topic that is sent once, or None."""
    if isinstance(decoded, list):
        return decoded[-1] if decoded else None
    return _row(decoded) if len(decoded[-1]) else None


def _row(arrays):
    """Last row of a record of arrays, nested records included."""
    return type(arrays)(*(_last_value(value) for value in arrays))


def _last_value(value):
    if value is None:
        return None
    if isinstance(value, tuple):
        return _row(value)
    return value[-1].item() if value.ndim == 1 else value[-1]


def _unreadable(path, error):
    """Why a log cannot be opened."""
    if not path.is_dir():
        return f"cannot be read: {error.strerror}"
    if (path / "campaign.json").is_file():
        words = "is the folder of a campaign, expected a log; `shefex-nav report` reads the folder"
        logs = sorted((path / "logs").glob("*.mcap"))
        return f"{words}, and the log of a run is such as {logs[0]}" if logs else words
    return "cannot be read: is a directory, expected a log (.mcap)"


def _other(path):
    """What a file is that is no log, as far as that can be told."""
    if path.suffix in (".yaml", ".yml"):
        return "; `shefex-nav run` flies a scenario and writes a log"
    return "; it is empty" if not path.stat().st_size else ""


def _read_file(path):
    """(_Raw, whether the file was closed properly)."""
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import EndOfFile, InvalidMagic
    from mcap.stream_reader import read_magic

    raw = _Raw({}, {}, {}, {}, {})
    try:
        file = opened(path)
    except OSError as error:
        raise LogError(f"{path}: {_unreadable(path, error)}") from error
    with file, named(path):
        try:
            read_magic(ReadDataStream(file))
        except (InvalidMagic, EndOfFile, struct.error) as error:
            raise LogError(f"{path}: not an MCAP file{_other(path)}") from error
        try:
            for opcode, content in records(file):
                _take(path, opcode, content, raw)
            if more := path.stat().st_size - file.tell():
                raise LogError(f"{path}: {_following(file, more)}")
        except cut_errors():
            return raw, False  # the writer was killed in the middle of this record
        except _damage_errors() as error:
            if file.read(1):
                raise LogError(f"{path}: damaged at byte {file.tell()}: {error}") from error
            return raw, False
    return raw, True


def _following(file, more):
    """Words about the bytes that follow the end of a log. file : at its end;  more : number of bytes"""
    end, start = file.tell(), file.read(len(MAGIC))
    what = (
        "another log begins there: two were put one after the other"
        if start == MAGIC
        else "nothing may follow"
    )
    cut = f"`head -c {end} {shlex.quote(file.name)} > FILE.mcap` keeps the log alone"
    return f"the log ends at byte {end}, {more} bytes follow; {what}; {cut}"


def records(file):
    """(opcode, content) of each record up to the end of the file that its writer closed.

    Without the indices of the messages, a sixth of the time of mcap's own reader.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import EndOfFile, RecordLengthLimitExceeded
    from mcap.stream_reader import read_magic

    opcode, checksum = None, zlib.crc32(MAGIC)
    while opcode != Op.FOOTER:
        head = file.read(HEAD.size)
        if len(head) < HEAD.size:
            raise EndOfFile
        opcode, length = HEAD.unpack(head)
        if length > _LONGEST:
            raise RecordLengthLimitExceeded(opcode, length, _LONGEST)
        content = file.read(length)
        if len(content) < length:
            raise EndOfFile
        if opcode == Op.DATA_END:
            _check(checksum, content, "of all before it")
        checksum = zlib.crc32(content, zlib.crc32(head, checksum))
        if opcode != Op.MESSAGE_INDEX:
            yield opcode, content
    read_magic(ReadDataStream(file))


def _check(checksum, stored, of):
    """ValueError if a checksum is not the one that the last four bytes of `stored` hold."""
    (expected,) = _CHECKSUM.unpack(stored[-_CHECKSUM.size :])
    if expected not in (0, checksum):
        raise ValueError(f"the checksum {of} is wrong")


def cut_errors():
    """What mcap raises where a file ends in the middle of a record."""
    from mcap.exceptions import EndOfFile, InvalidMagic, RecordLengthLimitExceeded

    return EndOfFile, InvalidMagic, RecordLengthLimitExceeded, struct.error


def _damage_errors():
    """What mcap raises on a record whose content is cut off or wrong."""
    from mcap.exceptions import McapError
    from zstandard import ZstdError

    return ZstdError, ValueError, McapError


def _take(path, opcode, content, raw):
    """Take what is wanted of a record."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Attachment, Channel, Chunk, Metadata, Schema

    stream = ReadDataStream(BytesIO(content))
    if opcode == Op.CHUNK:
        _take_chunk(path, _unpacked(Chunk.read(stream)), raw)
    elif opcode == Op.SCHEMA:
        schema = Schema.read(stream)
        raw.schemas[schema.id] = schema
    elif opcode == Op.CHANNEL:
        channel = Channel.read(stream)
        raw.channels[channel.id] = channel
        raw.messages.setdefault(channel.topic, [])
    elif opcode == Op.METADATA:
        record = Metadata.read(stream)
        if record.name == topics.METADATA:
            raw.metadata.update(record.metadata)
            _load_plugins(path, raw.metadata)
    elif opcode == Op.ATTACHMENT:
        record = Attachment.read(stream)
        _check(zlib.crc32(content[: -_CHECKSUM.size]), content, f"of the attachment {record.name}")
        raw.attachments[record.name] = record.data


def _unpacked(chunk):
    """Bytes of the records in a mcap Chunk."""
    from mcap.stream_reader import get_chunk_data_stream

    if (size := _unpacked_size(chunk)) > min(_LARGEST_CHUNK, _SMALL_CHUNK + _TIMES * len(chunk.data)):
        raise ValueError(f"a chunk of {len(chunk.data)} bytes claims {size} unpacked")
    unpacked, length = get_chunk_data_stream(chunk, validate_crc=True)
    return unpacked.read(length)


def _unpacked_size(chunk):
    """How large a mcap Chunk will be, by what it says and what its compression says: bytes."""
    from zstandard import frame_content_size

    if chunk.compression != "zstd":
        return chunk.uncompressed_size
    return max(chunk.uncompressed_size, frame_content_size(chunk.data))


def _load_plugins(path, metadata):
    """Load the plug-ins with which a log was flown, before its messages come.

    What one of them has logged is passed over where that cannot be done: a log may be looked at without
    running somebody's code.
    """
    for _ in plugins.left_out(checked.own(path, metadata, "plugins")):
        pass  # the one who looks is told (`commands.flights`)


def _take_chunk(path, data, raw):
    """Sort the messages of an unpacked chunk by topic; mcap's own loop is ten times slower."""
    lists = _lists(raw)
    for opcode, start, end in parts(data):
        if opcode == Op.MESSAGE:
            number = CHANNEL_OF.unpack_from(data, start)[0]
            if number not in lists:
                raise ValueError(f"a message of channel {number}, which there is not")
            messages = lists[number]
            if messages is not None:
                messages.append(data[start + _MESSAGE_HEAD.size : end])
        elif opcode in (Op.SCHEMA, Op.CHANNEL):
            _take(path, opcode, data[start:end], raw)
            lists = _lists(raw)


def messages_of(path, topics):
    """(mcap Schema or None, topic, log time [ns], bytes) of each message of some topics."""
    from mcap.data_stream import ReadDataStream
    from mcap.records import Chunk
    from mcap.stream_reader import read_magic

    raw = _Raw({}, {}, {}, {}, {})
    with opened(path) as file, named(path), readable(path, "a message that is drawn"):
        read_magic(ReadDataStream(file))
        with suppress(*cut_errors()):
            for opcode, content in records(file):
                if opcode in (Op.SCHEMA, Op.CHANNEL):
                    _take(path, opcode, content, raw)
                elif opcode == Op.CHUNK:
                    yield from _chosen(
                        path, _unpacked(Chunk.read(ReadDataStream(BytesIO(content)))), raw, topics
                    )


def _chosen(path, data, raw, topics):
    """The same of an unpacked chunk."""
    for opcode, start, end in parts(data):
        if opcode == Op.MESSAGE:
            number, _, ns, _ = _MESSAGE_HEAD.unpack_from(data, start)
            channel = raw.channels[number]
            if channel.topic in topics:
                schema = raw.schemas.get(channel.schema_id)
                yield schema, channel.topic, ns, data[start + _MESSAGE_HEAD.size : end]
        elif opcode in (Op.SCHEMA, Op.CHANNEL):
            _take(path, opcode, data[start:end], raw)


def _lists(raw):
    """{channel number: where its messages go, None for topics of others}."""
    ours = {topic.topic for topic in topics.topics()}
    return {
        n: raw.messages[c.topic] if c.topic in ours or other_solutions.TOPIC.fullmatch(c.topic) else None
        for n, c in raw.channels.items()
    }
