"""What a terminal is given: text that gives it no commands; standard error and output that take nothing.

Results are elsewhere when standard error is full, so the exit code must stay. Standard output is the result.
"""

import errno
import os
import re
import sys
from io import BufferedWriter, FileIO, TextIOBase, TextIOWrapper

# control characters but for tab and new line, and those that turn the direction of writing
_COMMANDS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def visible(text):
    """A text of whose origin nothing is known: characters that a terminal obeys are written as \\x1b."""
    return _COMMANDS.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


class _Raw(FileIO):
    """What cannot be written is lost, without an error."""

    def write(self, data):
        try:
            return super().write(data)
        except OSError:
            return len(data)


def forgiving(stream):
    """Standard error on which a full disk is no error: results are elsewhere, and the exit code stays."""
    if stream is not sys.__stderr__ or not isinstance(stream, TextIOWrapper):  # one of a test, a notebook
        return stream
    raw = _Raw(stream.fileno(), "w", closefd=False)
    how = {"encoding": stream.encoding, "errors": stream.errors, "write_through": True}
    return TextIOWrapper(BufferedWriter(raw), **how, line_buffering=True)


class Closed(TextIOBase):
    """Standard output that whoever started the program has closed: no result is lost unsaid."""

    def write(self, _text):
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))


def tell(words):
    """Print on stderr; where nothing can be written to it, the exit code has to say it alone."""
    try:
        print(visible(str(words)), file=sys.stderr, flush=True)
    except OSError:
        sys.stderr = open(os.devnull, "w")  # Python would try again at its end, and end with another code
