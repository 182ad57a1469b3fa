"""Text of the files that make up a scenario."""

import difflib
import os
import stat

from shefex_nav.files import irregular
from shefex_nav.scenario import kind

# bytes: of a scenario, of a table in it, of recorded data
LARGEST, LARGEST_TABLE, LARGEST_DATA = 2 << 20, 4 << 20, 1 << 30
ALIKE = 0.6  # of difflib: names that may be meant for each other


class Unreadable(Exception):
    """A file that cannot be read; the text says why."""


def read_text(path, expected, largest=LARGEST, errors="strict"):
    """Text of the UTF-8 file at `path`; Unreadable otherwise.

    expected : says what it should have been;  largest : bytes;  errors : of what is no UTF-8, as of open
    """
    try:
        found = os.stat(path)
        is_pipe = stat.S_ISFIFO(found.st_mode)
        if (what := irregular(found)) and not is_pipe:  # of which there may be no end
            raise Unreadable(f"is {what}, expected a file")
        if found.st_size > largest:
            words = f"has {found.st_size / 1e6:.3g} MB; {expected} has {largest / 1e6:.3g} MB at most"
            other = kind.of_bytes(path)
            raise Unreadable(_instead(other, expected) if other else words)
        if is_pipe:
            return _poured(path, expected, largest, errors)
        with open(path, encoding="utf-8-sig", errors=errors) as stream:
            return stream.read()
    except FileNotFoundError:
        words = f"there is no such file{alike(path)}"
    except IsADirectoryError:
        words = _instead(kind.of_folder(path), expected)
    except UnicodeDecodeError as error:
        words = f"is not UTF-8 text (byte {error.start}); save it as UTF-8"
        if other := kind.of_bytes(path):
            words = _instead(other, expected)
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        words = f"cannot be read: {getattr(error, 'strerror', None) or error}"
    raise Unreadable(words)


def _poured(path, expected, largest, errors):
    """Text of a pipe, such as `shefex-nav check <(make_scenario)`; not waited for is one nobody writes to."""
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as pipe:
        os.set_blocking(pipe.fileno(), True)
        content = pipe.read(largest + 1)
    if len(content) > largest:
        raise Unreadable(f"is larger than {largest / 1e6:.3g} MB, more than {expected} has")
    if not content:
        raise Unreadable(f"is a pipe into which nobody writes anything; expected {expected}")
    return content.decode("utf-8-sig", errors)


def alike(path):
    """`; did you mean 'motor.eng'?` if a file of the same kind beside a missing one has a name like it."""
    folder, name = os.path.split(os.fspath(path))
    try:
        beside = os.listdir(folder or ".")
    except OSError:
        is_home = any(part.startswith("~") for part in folder.split(os.sep))
        more = "; ~ is not read as the home folder here, write it out" if is_home else ""
        return f"; there is no folder '{folder}'{more}"
    stem, ending = os.path.splitext(name)
    known = dict(map(os.path.splitext, (one for one in beside if one.endswith(ending))))
    found = difflib.get_close_matches(stem, known, n=1, cutoff=ALIKE)
    return f"; did you mean '{found[0]}{known[found[0]]}'?" if found else ""


def _instead(found, expected):
    """`is a log, expected a scenario file; ...`: what is there, what was expected, what takes it."""
    what, semicolon, more = found.partition(";")
    return f"{what}, expected {expected}{semicolon}{more}"
