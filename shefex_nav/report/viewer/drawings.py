"""The Foxglove messages of a log (pictures, poses, events) as rerun decodes them, on both timelines.

The log has the grey values as measured. The viewer takes 16-bit pictures to be bright at 65535, whatever the
camera's range, and can be told of no other; twelve bits of a sky would be black. So their grey values are
mapped to eight bits for the recording: the same ones over the whole recording, that pictures can be compared.
"""

import numpy as np

from shefex_nav.clock import TICK_HZ
from shefex_nav.log import drawn
from shefex_nav.log.drawings import POSE_TICKS
from shefex_nav.log.topics import LogError, epoch_ns, log_time_ns
from shefex_nav.report.viewer.sender import TIMELINE, UTC

PICTURES = "star_tracker/image", "star_tracker/image_full"
_DRAWN = "^(/tf|/gps/location|/log|/star_tracker/(calibration|image|image_full))$"
_LOG_TIME = "message_log_time"
_TEXTS, _FRAMES = "/log", "/tf"
_BETWEEN_POSES = int(1.5e9 / TICK_HZ * POSE_TICKS)  # ns


def send(stream, log_path, data, grey=None):
    """Send them to a rerun RecordingStream. grey : as of `grey_values`, which is asked where there is none"""
    import rerun as rr
    from rerun.chunk import McapReader

    drawn.check(log_path)
    grey = grey_values(log_path, data) if grey is None else grey
    epoch = epoch_ns(data.mission.epoch_utc)
    start = int(log_time_ns(epoch, data.mission.start_s))
    source = McapReader(log_path, recover=True, include_topic_regex=[_DRAWN])
    try:
        rr.send_chunks(source.stream().map(lambda chunk: _timed(chunk, epoch, start, grey)), recording=stream)
    except RuntimeError as error:  # about topics that are not drawn, too
        raise LogError(f"{log_path}: the viewer cannot read it: {error}") from None


def kept_pictures(log_path):
    """Which of PICTURES a log has."""
    from rerun.chunk import McapReader

    channels = McapReader(log_path, recover=True).info().channels
    counts = {channel.topic: channel.message_count for channel in channels}
    return [one for one in PICTURES if counts.get(f"/{one}")]


def _timed(chunk, epoch, start, grey):
    """The chunk with mission time and UTC for the time at which it was logged; its other times go."""
    import pyarrow as pa
    from rerun.chunk import Chunk

    if chunk.is_static or _LOG_TIME not in chunk.timeline_names:
        return chunk
    batch = chunk.to_record_batch()
    if is_wide(batch):
        batch = narrowed(batch, grey)
    k = batch.schema.get_field_index(_LOG_TIME)
    stamps, metadata = batch.column(k).cast(pa.int64()).to_numpy(), batch.schema.field(k).metadata or {}
    if str(chunk.entity_path) == _FRAMES:  # poses are drawn at 20 Hz: the first from the start of the log on
        stamps = np.where(stamps < start + _BETWEEN_POSES, start, stamps)
    since = stamps - epoch
    if str(chunk.entity_path) == _TEXTS:
        since = since // 1_000_000 * 1_000_000  # so that the list has room for them
    for name in (n for n in chunk.timeline_names if n in batch.schema.names):
        batch = batch.remove_column(batch.schema.get_field_index(name))
    for name, kind, values in (
        (UTC, pa.timestamp("ns"), stamps),
        (TIMELINE, pa.duration("ns"), since),
    ):
        field = pa.field(
            name, kind, nullable=False, metadata={**metadata, b"rerun:index_name": name.encode()}
        )
        batch = batch.add_column(1, field, pa.array(values).cast(kind))
    return Chunk.from_record_batch(batch)[0]


def grey_values(log_path, data):
    """Table of the grey values shown for 16-bit pictures, by the first one as read out, else by the bits."""
    from rerun.chunk import McapReader

    if not len(data.frames.bits) or data.frames.bits[0] <= 8:
        return None
    full = McapReader(log_path, recover=True, include_topic_regex=[f"^/{PICTURES[1]}$"])
    batches = (chunk.to_record_batch() for chunk in full.stream())
    first = next((batch for batch in batches if is_wide(batch)), None)
    if first is None:
        return grey_of_bits(int(data.frames.bits[0]))
    return grey_of_sky(values(first.slice(0, 1)))


BELOW_SIGMA, ABOVE_SIGMA = 3.0, 20.0  # of the sky's noise about its level: black and white; streaks are faint
_U16, _U8 = 8, 6  # rerun's numbers of the two kinds of pixels


def grey_of_sky(image_dn):
    """Grey value, 0 to 255, of every 16-bit value: from a little below the sky to well above its noise.

    image_dn : (n,) uint16, pixels of a frame as read out. Returns (65536,) uint8.
    """
    level = float(np.median(image_dn))
    sigma = max(1.4826 * float(np.median(np.abs(image_dn.astype(float) - level))), 1.0)  # normal noise
    return _ramp(level - BELOW_SIGMA * sigma, level + ABOVE_SIGMA * sigma)


def grey_of_bits(bits):
    """The same over the whole range of a camera, where no frame was kept as read out."""
    return _ramp(0.0, 2.0**bits - 1.0)


def _ramp(black, white):
    values = 255.0 * (np.arange(65536) - black) / (white - black)
    return np.rint(np.clip(values, 0.0, 255.0)).astype(np.uint8)


def is_wide(batch):
    """Whether a record batch of rerun holds 16-bit pictures."""
    if "Image:format" not in batch.schema.names:
        return False
    formats = [row[0] for row in batch.column("Image:format").to_pylist() if row]
    return bool(formats) and all(one["channel_datatype"] == _U16 for one in formats)


def values(batch):
    """Pixels of all pictures of a batch, one after the other: (n,) uint16."""
    bytes_ = batch.column("Image:buffer").flatten().flatten().to_numpy(zero_copy_only=False)
    return np.ascontiguousarray(bytes_).view("<u2")


def _offsets(lengths):
    """Where each of some lists begins, and the end of the last one: int32, as Arrow has it."""
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)


def narrowed(batch, grey):
    """The batch with eight bits a pixel by a table of `grey_of_sky` or `grey_of_bits`."""
    import pyarrow as pa

    k = batch.schema.get_field_index("Image:buffer")
    outer = batch.column(k)
    pictures = outer.flatten()
    ends = pa.array(_offsets(pictures.value_lengths().to_numpy() // 2))
    inner = pa.ListArray.from_arrays(ends, pa.array(grey[values(batch)]), type=outer.type.value_type)
    rows = pa.array(_offsets(outer.value_lengths().fill_null(0).to_numpy()))
    batch = batch.set_column(k, batch.schema.field(k), pa.ListArray.from_arrays(rows, inner, type=outer.type))
    k = batch.schema.get_field_index("Image:format")
    formats = [
        None if row is None else [{**one, "channel_datatype": _U8} for one in row]
        for row in batch.column(k).to_pylist()
    ]
    return batch.set_column(k, batch.schema.field(k), pa.array(formats, type=batch.schema.field(k).type))
