"""What an MCAP file is made of, which files are such, and which of them are whole."""

import struct

from shefex_nav.files import opened

MAGIC = b"\x89MCAP0\r\n"  # first bytes of one
HEAD = struct.Struct("<BQ")  # of a record: opcode, length
CHANNEL_OF = struct.Struct("<H")  # the first of a channel and of its messages: its number


class Op:
    """Opcodes of its records."""

    HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 1, 2, 3, 4, 5, 6, 7
    ATTACHMENT, METADATA, DATA_END = 9, 12, 15


def is_log(path):
    """Whether a file is an MCAP file, or is called one; whoever reads it says what is wrong. Path"""
    try:
        with opened(path) as file:
            return file.read(len(MAGIC)) == MAGIC or path.suffix == ".mcap"
    except OSError:
        return path.suffix == ".mcap"


def is_closed(path):
    """Whether an MCAP file ends as it should: its writer was not killed. Path"""
    with opened(path) as file:
        return ends_well(file)


def ends_well(file):
    """The same of an open one; it is at its beginning afterwards."""
    file.seek(0)
    magic = file.read(len(MAGIC))
    file.seek(-len(MAGIC), 2)
    ending = file.read()
    file.seek(0)
    return magic == MAGIC == ending


def parts(data):
    """(opcode, begin, end) of the content of each record of an unpacked chunk."""
    end, skip = 0, HEAD.size
    while end < len(data):
        opcode, length = HEAD.unpack_from(data, end)
        begin = end + skip
        end = begin + length
        yield opcode, begin, end
