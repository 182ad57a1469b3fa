"""Standard error that may be full or closed: results are elsewhere, and the exit code must stay."""

import os
import sys
from io import BufferedWriter, FileIO, TextIOWrapper


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


def tell(words):
    """Print on stderr; where nothing can be written to it, the exit code has to say it alone."""
    try:
        print(words, file=sys.stderr, flush=True)
    except OSError:
        sys.stderr = open(os.devnull, "w")  # Python would try again at its end, and end with another code
