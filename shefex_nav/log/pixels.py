"""The pixels of the star camera's frames, read from a log when they are asked for.

A log holds a frame as read out (`/star_tracker/image_full`), with the background of its sky set to zero
(`/star_tracker/image`), both, or neither: the scenario says which (`log.frames`).
"""

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from shefex_nav.files import named, opened
from shefex_nav.log.mcap_file import ends_well
from shefex_nav.log.reader import cut_errors, readable

FULL, THRESHOLDED = "/star_tracker/image_full", "/star_tracker/image"
TYPES = {"mono8": "u1", "mono16": "<u2"}  # encoding of a picture: type of its grey values


class Pixels(NamedTuple):
    """Grey values of one frame."""

    ns: int  # log time of the frame, UTC since 1970
    image_dn: np.ndarray  # (rows, columns) uint8, or uint16 of a detector with more bits
    is_full: bool  # as read out; otherwise without the background of the sky


def at(path, ns):
    """Pixels of the frame with log time `ns`, as read out if there are such; None if none were kept."""
    found = list(between(path, ns, ns + 1))
    return max(found, key=lambda pixels: pixels.is_full, default=None)


def between(path, begin_ns=None, end_ns=None):
    """Pixels of the frames from begin_ns to before end_ns in the order of the log.

    Of a log whose writer was killed, those it has. A frame that was kept both ways comes twice.
    All frames without the two times. Raises LogError where the log is damaged.
    """
    from mcap.reader import NonSeekingReader, SeekingReader

    decoders = {}
    with opened(path) as file, named(path):
        # without an index at its end a file is read from the front, up to where its writer was killed
        reader = (SeekingReader if ends_well(file) else NonSeekingReader)(file)
        wanted = {"starting_at": begin_ns, "ending_before": end_ns, "log_time_order": False}
        messages = reader.iter_messages([FULL, THRESHOLDED], **wanted)
        with readable(path, "a picture"), suppress(*cut_errors()):
            for schema, channel, message in messages:
                image = message_class(decoders, schema).FromString(message.data)
                yield Pixels(message.log_time, _grey_values(image), channel.topic == FULL)


def message_class(decoders, schema):
    """Message class of a schema of the file, made once."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    if schema.id not in decoders:
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            pool.Add(file)
        decoders[schema.id] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return decoders[schema.id]


def wrong(image):
    """What is impossible in a decoded picture: words, or ''."""
    if image.encoding not in TYPES:
        return f"encoding: got {image.encoding!r}, expected {' or '.join(TYPES)}"
    row = image.width * np.dtype(TYPES[image.encoding]).itemsize
    if image.step != row:
        return f"step: got {image.step} bytes a row, expected {row} of {image.width} pixels, {image.encoding}"
    size = image.height * row
    if not size or len(image.data) != size:
        words = f"data: got {len(image.data)} bytes"
        return f"{words}, expected {size} of {image.width} x {image.height} pixels, {image.encoding}"
    return ""


def _grey_values(image):
    if words := wrong(image):
        raise ValueError(words)
    dtype = np.dtype(TYPES[image.encoding])
    return np.frombuffer(image.data, dtype).reshape(image.height, image.width).astype(dtype.newbyteorder("="))
