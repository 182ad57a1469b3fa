"""Logs whose pictures are damaged: each is refused in words."""

import pytest
from mcap.writer import CompressionType, Writer

from shefex_nav.log import pixels
from shefex_nav.log.reader import LogError


def written(path):
    """Bytes of a log with one message that is no picture, not compressed."""
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_crcs=False)
        writer.start()
        schema = writer.register_schema("foxglove.RawImage", "protobuf", b"")
        channel = writer.register_channel(pixels.FULL, "protobuf", schema)
        writer.add_message(channel, 1, b"no picture", 1)
        writer.finish()
    return path.read_bytes()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"", b""),  # its schema describes nothing
        (pixels.FULL.encode(), b"\xff" * len(pixels.FULL)),  # a topic that is no text
        (b"foxglove.RawImage", b"\xd0" * 17),
    ],
)
def test_a_damaged_picture_is_refused(tmp_path, old, new):
    path = tmp_path / "log.mcap"
    path.write_bytes(written(path).replace(old, new))
    with pytest.raises(LogError, match="damaged: a picture cannot be read"):
        list(pixels.between(path))
