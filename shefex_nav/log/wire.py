"""Protobuf messages of the table in `topics`: schemas, encoding, decoding.

A message all of whose fields have a fixed length has a fixed layout in protobuf's wire format too: tags
and lengths are the same bytes every time, doubles stand between them. Such a message is one element of a
NumPy structured array: encoding and decoding handle a whole column of messages at a time instead of one
value. The others go through google.protobuf.

Wire format: https://protobuf.dev/programming-guides/encoding
"""

from enum import IntEnum
from math import prod
from operator import attrgetter

import numpy as np

from shefex_nav.fields import EQUAL, Field
from shefex_nav.log.topics import LogError
from shefex_nav.records import row, rows

PACKAGE = "shefex"
_TIMESTAMP = Field("timestamp_ns", "", "sfixed64", (), "UTC, since 1970 [ns]")
_KINDS = {  # protobuf type number, wire type of a single value, NumPy type
    "double": (1, 1, "<f8"),
    "sfixed64": (16, 1, "<i8"),
    "sfixed32": (15, 5, "<i4"),
    "bool": (8, 0, "?"),
    "enum": (14, 0, "u1"),  # one byte: values below 128
    "string": (9, 2, None),
    "bytes": (12, 2, None),
}
_LENGTH_DELIMITED = 2


def _kind(field):
    return field.kind if isinstance(field.kind, str) else "enum"


def all_fields(topic):
    """Fields of the message in the order of their numbers, 1 first."""
    return (_TIMESTAMP, *topic.fields)


def is_fixed(topic):
    """All fields have one length."""
    return all(field.kind not in ("string", "bytes") and -1 not in field.shape for field in topic.fields)


def file_descriptor(topic):
    """FileDescriptorProto with the message, its enumerations and the comments of its fields."""
    from google.protobuf import descriptor_pb2

    file = descriptor_pb2.FileDescriptorProto(
        name=f"{PACKAGE}/{topic.schema}.proto", package=PACKAGE, syntax="proto3"
    )
    message = file.message_type.add(name=topic.schema)
    info = file.source_code_info
    info.location.add(path=[4, 0], span=[0, 0, 0], leading_comments=topic.comment)
    for k, field in enumerate(all_fields(topic)):
        added = message.field.add(name=field.name, number=k + 1, type=_KINDS[_kind(field)][0])
        added.label = added.LABEL_REPEATED if field.shape else added.LABEL_OPTIONAL
        if _kind(field) == "enum":
            added.type_name = f".{PACKAGE}.{topic.schema}.{field.kind.__name__}"
            if field.kind.__name__ not in [enum.name for enum in message.enum_type]:
                enum = message.enum_type.add(name=field.kind.__name__)
                for member in field.kind:
                    enum.value.add(name=member.name, number=member.value)
        info.location.add(path=[4, 0, 2, k], span=[k + 1, 0, 0], leading_comments=field.comment)
    return file


def schema_bytes(topic):
    """FileDescriptorSet as an MCAP file stores it."""
    from google.protobuf import descriptor_pb2

    descriptors = descriptor_pb2.FileDescriptorSet(file=[file_descriptor(topic)])
    return descriptors.SerializeToString(deterministic=True)


def is_same_schema(data, topic):
    """Whether a stored FileDescriptorSet describes the topic's message; comments do not count."""
    from google.protobuf import descriptor_pb2

    stored = descriptor_pb2.FileDescriptorSet.FromString(data)
    ours = descriptor_pb2.FileDescriptorSet(file=[file_descriptor(topic)])
    for file in (*stored.file, *ours.file):
        file.ClearField("source_code_info")
    return stored == ours


def as_stored(data, topic):
    """The topic with the fields that a stored FileDescriptorSet has; None where the two contradict.

    A log of an older version may lack the last fields of a message, if the record has defaults for them.
    """
    from google.protobuf import descriptor_pb2

    stored = descriptor_pb2.FileDescriptorSet.FromString(data)
    messages = [message for file in stored.file for message in file.message_type]
    n = len(messages[0].field) - 1 if messages else 0  # without the time stamp
    missing = topic.fields[n:]
    older = topic._replace(fields=topic.fields[:n])
    if any(field.source.partition(".")[0] not in topic.record._field_defaults for field in missing):
        return None
    return older if is_same_schema(data, older) else None


def message_class(topic):
    """google.protobuf class of the message."""
    from google.protobuf import descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    pool.Add(file_descriptor(topic))
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{PACKAGE}.{topic.schema}"))


def codec(topic):
    """Encoder and decoder of one topic."""
    if any(EQUAL in field.shape for field in topic.fields):
        return EqualCodec(topic)
    return FixedCodec(topic) if is_fixed(topic) else VariableCodec(topic)


def with_rows(topic, n):
    """The topic with n rows where every message of a log has the same number."""
    fields = tuple(
        field._replace(shape=tuple(n if size == EQUAL else size for size in field.shape))
        for field in topic.fields
    )
    return topic._replace(fields=fields)


class FixedCodec:
    """Messages of fixed layout: many records at once, to bytes and back into a record of arrays."""

    def __init__(self, topic, texts=None):
        """texts : {source: text} where the library encodes all else, None: there is none (`_layout`)"""
        self.topic = topic
        layout, self._constants = _layout(topic, texts)
        self._dtype = np.dtype(layout)
        template = np.zeros((), self._dtype)
        for name, data in self._constants:
            template[name] = np.frombuffer(data, "u1")
        self._template = template.tobytes()
        self.size = self._dtype.itemsize  # bytes of a message
        self._sources = []  # field, position of its attribute in the record, rest of a dotted name
        for field in topic.fields:
            if field.name not in self._dtype.names:
                continue
            name, _, nested = field.source.partition(".")
            getter = attrgetter(nested) if nested else None
            self._sources.append((field, topic.record._fields.index(name), getter))

    def encode(self, records, timestamps_ns):
        """List of n records, (n,) int64 -> list of n messages."""
        array = self._blank(timestamps_ns)
        columns = list(zip(*records, strict=True))
        for field, position, getter in self._sources:
            values = columns[position] if getter is None else [getter(v) for v in columns[position]]
            array[field.name] = values
        return _apart(array)

    def encode_columns(self, arrays, timestamps_ns):
        """Record of arrays over n, (n,) int64 -> list of n messages: as of its rows."""
        array = self._blank(timestamps_ns)
        for field, position, getter in self._sources:
            array[field.name] = arrays[position] if getter is None else getter(arrays[position])
        return _apart(array)

    def _blank(self, timestamps_ns):
        """Messages that have nothing but a time stamp yet: structured array."""
        array = np.frombuffer(bytearray(self._template * len(timestamps_ns)), self._dtype)
        array["timestamp_ns"] = timestamps_ns
        return array

    def decode(self, messages):
        """List of n messages -> the topic's record type, each field an array over n."""
        data = b"".join(messages)
        if len(data) != len(messages) * self._dtype.itemsize:
            self._refuse_length(messages)
        array = np.frombuffer(data, self._dtype)
        for name, constant in self._constants:
            if not np.all(array[name] == np.frombuffer(constant, "u1")):
                raise LogError(f"topic {self.topic.topic}: message of an unexpected layout")
        defaults = self.topic.record._field_defaults
        values = {name: np.full((len(array), *np.shape(value)), value) for name, value in defaults.items()}
        for field in self.topic.fields:
            column = np.ascontiguousarray(array[field.name])
            values[field.source] = column.astype(np.int64) if _is_integer(field) else column
        return assemble(self.topic.record, values)

    def _refuse_length(self, messages):
        """LogError of the first message that is longer or shorter than all are to be."""
        size = self._dtype.itemsize
        k, one = next((k, one) for k, one in enumerate(messages) if len(one) != size)
        place = f"topic {self.topic.topic}: message {k + 1}"
        raise LogError(f"{place}: got {len(one)} bytes, expected {size}: {_odd(self.topic, one, size)}")


class EqualCodec:
    """Messages of a layout that is fixed once the first has shown how many rows it has."""

    def __init__(self, topic):
        self.topic, self._codec, self._rows = topic, None, 0
        self._sources = [field.source for field in topic.fields if EQUAL in field.shape]

    def encode(self, records, timestamps_ns):
        """As FixedCodec; LogError if a record has another number of rows than those before."""
        for record in records:
            self._expect({len(getattr(record, source)) for source in self._sources})
        return self._codec.encode(records, timestamps_ns) if records else []

    def encode_columns(self, arrays, timestamps_ns):
        """As FixedCodec; LogError likewise."""
        if not len(timestamps_ns):
            return []
        self._expect({getattr(arrays, source).shape[1] for source in self._sources})
        return self._codec.encode_columns(arrays, timestamps_ns)

    def _expect(self, rows):
        """LogError unless a record has the number of rows that all have. rows : set, of each of its fields"""
        if self._codec is None and len(rows) == 1:
            self._use(*rows)
        if rows != {self._rows}:
            raise LogError(
                f"topic {self.topic.topic}: a message of {sorted(rows)} rows in a log whose others have "
                f"{self._rows}"
            )

    def decode(self, messages):
        """As FixedCodec; the number of rows follows from the length of the first message."""
        if not messages:
            return FixedCodec(with_rows(self.topic, 0)).decode(messages)
        rows = 0
        while FixedCodec(with_rows(self.topic, rows)).size < len(messages[0]):
            rows += 1
        self._use(rows)
        return self._codec.decode(messages)

    def _use(self, rows):
        self._codec, self._rows = FixedCodec(with_rows(self.topic, rows)), rows


class VariableCodec:
    """Messages with text or lists of any length: list of records to list of messages and back."""

    def __init__(self, topic):
        self.topic = topic
        self._class = message_class(topic)
        self._slots = [(field, attrgetter(field.source)) for field in topic.fields]
        self._defaults = dict(topic.record._field_defaults)
        kinds = (np.int64 if _is_integer(field) else np.float64 for field in topic.fields)
        self._reads = [(f.name, f.source, f.shape, kind) for f, kind in zip(topic.fields, kinds, strict=True)]
        self._made = assembler(topic.record, {*self._defaults, *(field.source for field in topic.fields)})
        self._fixed = {}  # (texts, lengths) of columns -> FixedCodec

    def encode(self, records, timestamps_ns):
        """List of n records, (n,) int64 -> list of n messages."""
        return [self._message(*pair) for pair in zip(records, timestamps_ns.tolist(), strict=True)]

    def encode_columns(self, arrays, timestamps_ns):
        """Record of arrays over n without nested ones, (n,) int64 -> list of n messages: as of its rows.

        Where all rows have the same texts, their messages have one layout; but the library leaves out single
        values that are zero (not -0.0), so it encodes the rows that have one.
        """
        fields = [(field, getattr(arrays, field.source)) for field in self.topic.fields]
        texts = {field.source: set(column.tolist()) for field, column in fields if field.kind == "string"}
        if not len(timestamps_ns):
            return []
        if any(len(different) > 1 for different in texts.values()):
            return self.encode(rows(arrays), timestamps_ns)
        texts = {source: only for source, (only,) in texts.items()}
        shapes = [column.shape[1:] for _, column in fields]
        key = *texts.values(), *shapes
        if key not in self._fixed:
            pairs = zip(self.topic.fields, shapes, strict=True)
            shaped = self.topic._replace(fields=tuple(one._replace(shape=shape) for one, shape in pairs))
            self._fixed[key] = FixedCodec(shaped, texts)
        messages = self._fixed[key].encode_columns(arrays, timestamps_ns)
        single = [column for field, column in fields if column.ndim == 1 and field.kind != "string"]
        for k in np.flatnonzero(np.any([_is_left_out(column) for column in single], axis=0)).tolist():
            messages[k] = self._message(row(arrays, k), timestamps_ns[k].item())
        return messages

    def _message(self, record, timestamp_ns):
        message = self._class(timestamp_ns=timestamp_ns)
        for field, getter in self._slots:
            value = getter(record)
            if field.shape:
                getattr(message, field.name).extend(np.ravel(value).tolist())
            elif isinstance(value, str):
                setattr(message, field.name, value)
            else:
                setattr(message, field.name, _PYTHON[_kind(field)](value))
        return message.SerializeToString(deterministic=True)

    def decode(self, messages):
        """List of messages -> list of records."""
        return [self._record(self._class.FromString(data)) for data in messages]

    def _record(self, message):
        values = self._defaults.copy()
        for name, source, shape, dtype in self._reads:
            value = getattr(message, name)
            values[source] = np.array(value, dtype).reshape(shape) if shape else value
        return self._made(values)


_PYTHON = {"double": float, "sfixed32": int, "bool": bool, "enum": int}


def assemble(record, values):
    """Record from values by (dotted) attribute; an attribute without a value becomes None."""
    return assembler(record, values)(values)


def assembler(record, names, prefix=""):
    """Function that makes the record of values with these names, as `assemble`."""
    parts = [
        assembler(kind, names, f"{prefix}{name}.")
        if any(one.startswith(f"{prefix}{name}.") for one in names)
        else f"{prefix}{name}"
        for name, kind in record.__annotations__.items()
    ]

    def made(values):
        return record(*[values.get(one) if type(one) is str else one(values) for one in parts])

    return made


def varint(value):
    """Base-128 encoding, least significant group first."""
    out = bytearray()
    while value >= 0x80:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes(out) + bytes([value])


def _odd(topic, data, size):
    """Words about a message that is not of the `size` which all of its topic have, bytes."""
    from google.protobuf.message import DecodeError

    try:
        message = message_class(topic).FromString(data)
    except DecodeError:
        return f"it is no whole message {topic.schema}"
    for field in topic.fields:
        n, wanted = len(getattr(message, field.name)) if field.shape else 1, prod(field.shape)
        if n != wanted:
            return f"{field.name} has {n} numbers, expected {wanted}"
    if len(data) > size:
        return "another program wrote it in another form"
    return "another program wrote it and left out the fields that are zero; this reader wants all of them"


def _apart(array):
    """Messages of a structured array: list of bytes."""
    data, size = array.tobytes(), array.itemsize
    return [data[begin : begin + size] for begin in range(0, len(data), size)]


def _is_left_out(column):
    """Which values proto3 leaves out of a message: those whose bits are zero. (n,) -> (n,) bool"""
    return (column.view(np.int64) if column.dtype == np.float64 else column) == 0


def _layout(topic, texts=None):
    """NumPy structured type of a fixed message, and the (name, bytes) of its constant parts.

    texts : {source: text} of the fields that are texts; None: there is none, and the message has its arrays
        even if they are empty, which the library leaves out
    """
    layout, constants = [], []
    for number, field in enumerate(all_fields(topic), start=1):
        _, wire_type, dtype = _KINDS[_kind(field)]
        if field.kind == "string" or (texts is not None and 0 in field.shape):
            if data := (texts[field.source] if field.kind == "string" else "").encode():
                head = varint(number << 3 | wire_type) + varint(len(data)) + data
                constants.append((f"_{number}", head))
                layout.append((f"_{number}", "u1", (len(head),)))
            continue
        if field.shape:
            size = prod(field.shape) * np.dtype(dtype).itemsize
            head = varint(number << 3 | _LENGTH_DELIMITED) + varint(size)
        else:
            head = varint(number << 3 | wire_type)
        constants.append((f"_{number}", head))
        layout += [(f"_{number}", "u1", (len(head),)), (field.name, dtype, field.shape)]
    return layout, constants


def _is_integer(field):
    return field.kind == "sfixed32" or (isinstance(field.kind, type) and issubclass(field.kind, IntEnum))
