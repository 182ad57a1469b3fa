"""Text of the files that make up a scenario."""


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
        words = f"is a directory, expected {expected}"
    except UnicodeDecodeError as error:
        words = f"is not UTF-8 text (byte {error.start}); save it as UTF-8"
        if str(path).endswith(".mcap"):
            words = f"is a log, expected {expected}"
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        words = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    raise Unreadable(words)
