"""Text of the files that make up a scenario."""

import os
import stat

from shefex_nav.scenario import kind

LARGEST, LARGEST_DATA = 2 << 20, 1 << 30  # bytes of a part of a scenario, and of recorded data
DEVICES = (
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"),
)


class Unreadable(Exception):
    """A file that cannot be read; the text says why."""


def read_text(path, expected, largest=LARGEST):
    """Text of the UTF-8 file at `path`; Unreadable otherwise.

    expected : says what it should have been;  largest : bytes
    """
    try:
        found = os.stat(path)
        for is_one, what in DEVICES:  # of which there may be no end
            if is_one(found.st_mode):
                raise Unreadable(f"is {what}, expected a file")
        if found.st_size > largest:
            words = f"has {found.st_size / 1e6:.3g} MB; {expected} has {largest / 1e6:.3g} MB at most"
            raise Unreadable(words)
        with open(path, encoding="utf-8-sig") as stream:
            return stream.read()
    except FileNotFoundError:
        words = "there is no such file"
    except IsADirectoryError:
        words = _instead(kind.of_folder(path), expected)
    except UnicodeDecodeError as error:
        words = f"is not UTF-8 text (byte {error.start}); save it as UTF-8"
        if other := kind.of_bytes(path):
            words = _instead(other, expected)
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        words = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    raise Unreadable(words)


def _instead(found, expected):
    """`is a log, expected a scenario file; ...`: what is there, what was expected, what takes it."""
    what, semicolon, more = found.partition(";")
    return f"{what}, expected {expected}{semicolon}{more}"
