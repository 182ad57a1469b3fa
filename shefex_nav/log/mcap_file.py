"""Which files are MCAP files."""

MAGIC = b"\x89MCAP0\r\n"  # first bytes of one


def is_log(path):
    """Whether a file is an MCAP file, or is called one; whoever reads it says what is wrong. Path"""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC or path.suffix == ".mcap"
    except OSError:
        return path.suffix == ".mcap"
