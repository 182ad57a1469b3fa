"""One record at a time to the bytes of its protobuf message and back, as a program gets it each tick.

The messages are those of `log.wire`, which handles columns of them. What is None is not sent; what does not
come has the record's default, or is zero or empty, as in protobuf. Wire format:
https://protobuf.dev/programming-guides/encoding
"""

import struct
from operator import attrgetter

import numpy as np

from shefex_nav.log import wire

_DOUBLE, _INT32 = struct.Struct("<d"), struct.Struct("<i")
_VARINT, _EIGHT, _LENGTH, _FOUR = 0, 1, 2, 5  # wire types
_TYPES = {"double": "<f8", "sfixed32": "<i4"}


class Codec:
    """Of the messages of one fields.Topic."""

    def __init__(self, topic):
        self.topic = wire.with_rows(topic, -1)
        self._writers = [
            (attrgetter(field.source), _writer(number, field))
            for number, field in enumerate(self.topic.fields, start=2)  # 1: the time stamp
        ]
        self._readers = {number: _reader(field) for number, field in enumerate(self.topic.fields, start=2)}
        self._arrays = {number for number, field in enumerate(self.topic.fields, start=2) if field.shape}
        self._nothing = {field.source: _nothing(field) for field in self.topic.fields}
        self._nothing |= topic.record._field_defaults
        self._made = wire.assembler(topic.record, self._nothing)

    def encode(self, record):
        """The message of a record."""
        return b"".join([write(value) for get, write in self._writers if (value := get(record)) is not None])

    def decode(self, body):
        """The record of a message; ValueError if it is none."""
        values, pieces, at, end = self._nothing.copy(), {}, 0, len(body)
        try:
            while at < end:
                tag, at = _varint(body, at)
                kind = tag & 7
                if kind == _VARINT:
                    value, at = _varint(body, at)
                else:
                    size, at = _varint(body, at) if kind == _LENGTH else (8 if kind == _EIGHT else 4, at)
                    value, at = body[at : at + size], at + size
                number = tag >> 3
                if number in self._arrays:  # in one piece or several, or each number by itself
                    pieces.setdefault(number, []).append(value)
                elif (reader := self._readers.get(number)) is not None:
                    source, read = reader
                    values[source] = read(value)
            if at > end:
                raise ValueError("a field that goes on beyond the end")
            for number, data in pieces.items():
                source, read = self._readers[number]
                values[source] = read(b"".join(data))
        except (IndexError, struct.error, TypeError, ValueError) as error:
            raise ValueError(f"not a message {self.topic.schema}") from error
        return self._made(values)


def _nothing(field):
    """What a field is that does not come."""
    if field.shape:
        return np.empty((0, *field.shape[1:])) if -1 in field.shape else None
    return {"double": 0.0, "bool": False, "string": "", "bytes": b""}.get(field.kind, 0)


def _writer(number, field):
    """Function that makes the bytes of a field of a value."""
    kind = field.kind if isinstance(field.kind, str) else "enum"
    if field.shape:
        head, dtype = wire.varint(number << 3 | _LENGTH), _TYPES[kind]

        def write_array(value):
            data = np.asarray(value, dtype=dtype).tobytes()
            return b"".join((head, wire.varint(len(data)), data))

        return write_array
    wire_type = {"double": _EIGHT, "sfixed32": _FOUR, "string": _LENGTH, "bytes": _LENGTH}.get(kind, _VARINT)
    head = wire.varint(number << 3 | wire_type)
    if kind == "double":
        return lambda value: head + _DOUBLE.pack(value)
    if kind == "sfixed32":
        return lambda value: head + _INT32.pack(value)
    if kind == "string":
        return lambda value: b"".join((head, wire.varint(len(data := value.encode("utf-8"))), data))
    if kind == "bytes":
        return lambda value: b"".join((head, wire.varint(len(value)), value))
    return lambda value: head + wire.varint(int(value))


def _reader(field):
    """Attribute, and function that makes its value of the bytes, or of the number, that a field holds."""
    kind = field.kind if isinstance(field.kind, str) else "enum"
    if field.shape:
        dtype, wanted = _TYPES[kind], None if kind == "double" else np.int64
        return field.source, lambda data: np.frombuffer(data, dtype).reshape(field.shape).astype(wanted)
    reads = {
        "double": lambda data: _DOUBLE.unpack(data)[0],
        "sfixed32": lambda data: _INT32.unpack(data)[0],
        "string": lambda data: data.decode("utf-8"),
        "bytes": bytes,
        "bool": bool,
    }
    return field.source, reads.get(kind, int)


def _varint(data, at):
    """Number that begins at a place of some bytes, and where it ends."""
    value, shift = data[at], 7
    if value < 0x80:
        return value, at + 1
    value &= 0x7F
    while True:
        at += 1
        byte = data[at]
        if shift > 63:
            raise ValueError("a number of more than 64 bits")
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at + 1
        shift += 7
