"""Files that are whole or not there, also after a power failure."""

import os
from contextlib import contextmanager


@contextmanager
def whole(path):
    """Path to write to; what is there at the end of the `with` is on the disk, and becomes `path`."""
    part = path.with_name(path.name + ".part")
    yield part
    with open(part, "rb+") as file:
        os.fsync(file.fileno())  # before its name is: else a power failure may leave the name alone
    os.replace(part, path)


def put(path, content):
    """Write bytes or text to a file. Its name is safe on the disk after `settle` of its folder."""
    with whole(path) as part:
        part.write_bytes(content.encode() if isinstance(content, str) else content)


def settle(folder):
    """Bring the names of a folder to the disk."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except OSError:  # Windows opens no folder, and keeps its names by itself
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
