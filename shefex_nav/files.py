"""Files that are whole or not there, also after a power failure."""

import os
from contextlib import contextmanager


def part(path):
    """Where the file `path` is written until it is whole: beside its place, on the same disk. -> Path"""
    return path.with_name(path.name + ".part")


def finish(path):
    """What has been written to `part(path)` is on the disk, and becomes `path`."""
    with open(part(path), "rb+") as file:
        os.fsync(file.fileno())  # before its name is: else a power failure may leave the name alone
    os.replace(part(path), path)


@contextmanager
def whole(path):
    """Path to write to, which becomes `path` at the end of the `with`; nothing of it is left by a failure."""
    half = part(path)
    try:
        yield half
        finish(path)
    finally:
        half.unlink(missing_ok=True)


def put(path, content):
    """Write bytes or text to a file. Its name is safe on the disk after `settle` of its folder."""
    with whole(path) as half:
        half.write_bytes(content.encode() if isinstance(content, str) else content)


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
