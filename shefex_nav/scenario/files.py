"""Text of the files that make up a scenario."""

from shefex_nav.scenario import kind


class Unreadable(Exception):
    """A file that cannot be read; the text says why."""


def read_text(path, expected):
    """Text of the UTF-8 file at `path`; Unreadable otherwise. `expected` says what it should have been."""
    try:
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
