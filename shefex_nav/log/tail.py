"""A log while it is written: what is new in it, as a log of its own.

A slice has the head of the log (metadata, scenario, the description of its topics, the constants of the
mission) and the chunks that have come since the last one. Like the log of a killed run it has no end, and
whatever reads such a log reads a slice.
"""

import os
import struct
import zlib
from io import BytesIO
from pathlib import Path

from shefex_nav.files import refuse_irregular
from shefex_nav.log import topics
from shefex_nav.log.mcap_file import CHANNEL_OF, HEAD, MAGIC, Op, parts
from shefex_nav.log.topics import LogError, Mission

_MESSAGE_OF = struct.Struct("<HIQ")  # channel, sequence number, log time
_INDEX_OF = struct.Struct("<HI")  # channel, bytes of the places
_PLACE = struct.Struct("<QQ")  # log time, from the begin of the chunk
_CHUNK_OF = struct.Struct("<QQQIIQ")  # first and last time, size, CRC, length of "" (no compression), size


class Tail:
    """The end of a log that somebody writes.

    with Tail(path) as tail:
        while not tail.is_complete:
            if tail.write_slice(part):
                ...

    path : of the log, which may not be there yet
    old_ns : when a file that will be overwritten was changed last, since 1970; 0: there is none
    """

    def __init__(self, path, old_ns=0):
        self._path, self._old_ns = Path(path), old_ns
        self._at = 0  # bytes of the file that have been taken
        self._file = None
        self._top = []  # records of the head
        self._described = {}  # (opcode, number) -> record of a schema or channel
        self._constants = b""  # the message with the Mission
        self.is_complete = False  # the log has been closed by its writer

    def write_slice(self, path):
        """Write what has come since the last call, as a log. -> whether there was anything; LogError"""
        chunks = self._new_chunks()
        if not chunks:
            return False
        with Path(path).open("wb") as file:
            file.write(MAGIC + b"".join(self._top) + self._description() + b"".join(chunks))
        return True

    def __enter__(self):
        return self

    def __exit__(self, *exc_info):
        if self._file is not None:
            self._file.close()

    def _new_chunks(self):
        """List of the chunks (records) that have come whole."""
        if self._file is None and not self._open():
            return []
        size = os.fstat(self._file.fileno()).st_size
        chunks = []
        while not self.is_complete and self._at + HEAD.size <= size:
            self._file.seek(self._at)
            head = self._file.read(HEAD.size)
            opcode, length = HEAD.unpack(head)
            if self._at + HEAD.size + length > size:
                break  # the writer says how long a chunk is when it is whole; too much until then
            self._take(opcode, head + self._file.read(length), chunks)
            self._at += HEAD.size + length
        return chunks

    def _open(self):
        """Whether there is a log yet."""
        try:
            if self._path.stat().st_mtime_ns == self._old_ns:
                return False
            refuse_irregular(self._path)
            file = self._path.open("rb", buffering=0)  # what has been read may have changed
        except FileNotFoundError:
            return False
        except OSError as error:
            raise LogError(f"{self._path}: cannot be read: {error.strerror}") from error
        found = file.read(len(MAGIC))
        if not MAGIC.startswith(found):
            file.close()
            raise LogError(f"{self._path}: not an MCAP file")
        if len(found) < len(MAGIC):
            file.close()
            return False
        self._file, self._at = file, len(MAGIC)
        return True

    def _take(self, opcode, record, chunks):
        """Take one record of the file."""
        if opcode == Op.FOOTER:
            self.is_complete = True
        elif opcode in (Op.HEADER, Op.ATTACHMENT, Op.METADATA):
            self._top.append(record)
        elif opcode == Op.CHUNK:
            chunks.append(record + _index(self._learn(record)))

    def _learn(self, chunk):
        """Keep the descriptions and the constants that a chunk has. -> its records"""
        from mcap.data_stream import ReadDataStream
        from mcap.records import Chunk
        from mcap.stream_reader import get_chunk_data_stream

        stream, size = get_chunk_data_stream(Chunk.read(ReadDataStream(BytesIO(chunk[HEAD.size :]))))
        data = stream.read(size)
        constants = topics.of_record(Mission).topic.encode()
        for opcode, begin, end in parts(data):
            number = CHANNEL_OF.unpack_from(data, begin)[0]
            if opcode in (Op.SCHEMA, Op.CHANNEL):
                self._described[opcode, number] = data[begin - HEAD.size : end]
            elif not self._constants and constants in self._described.get((Op.CHANNEL, number), b""):
                self._constants = data[begin - HEAD.size : end]
        return data

    def _description(self):
        """A chunk with what every slice begins with."""
        data = b"".join(self._described[key] for key in sorted(self._described)) + self._constants
        content = _CHUNK_OF.pack(0, 0, len(data), zlib.crc32(data), 0, len(data)) + data
        return HEAD.pack(Op.CHUNK, len(content)) + content + _index(data)


def _index(data):
    """The records that say where the messages of an unpacked chunk are; some readers want them."""
    places = {}
    for opcode, begin, _ in parts(data):
        if opcode == Op.MESSAGE:
            number, _, log_ns = _MESSAGE_OF.unpack_from(data, begin)
            places.setdefault(number, []).append(_PLACE.pack(log_ns, begin - HEAD.size))
    contents = (_INDEX_OF.pack(n, len(found) * _PLACE.size) + b"".join(found) for n, found in places.items())
    return b"".join(HEAD.pack(Op.MESSAGE_INDEX, len(content)) + content for content in contents)
