"""The Foxglove messages of a log (pictures, poses, events) as rerun decodes them, on both timelines."""

import numpy as np

from shefex_nav.clock import TICK_HZ
from shefex_nav.log import drawn
from shefex_nav.log.drawings import POSE_TICKS
from shefex_nav.log.topics import LogError, epoch_ns, log_time_ns
from shefex_nav.report.viewer import pictures
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
    if pictures.is_wide(batch):
        batch = pictures.narrowed(batch, grey)
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
    first = next((batch for batch in batches if pictures.is_wide(batch)), None)
    if first is None:
        return pictures.grey_of_bits(int(data.frames.bits[0]))
    return pictures.grey_of_sky(pictures.values(first.slice(0, 1)))
