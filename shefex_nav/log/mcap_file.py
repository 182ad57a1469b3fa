"""Which files are MCAP files, and which of them are whole."""

from shefex_nav.files import opened

MAGIC = b"\x89MCAP0\r\n"  # first bytes of one


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
