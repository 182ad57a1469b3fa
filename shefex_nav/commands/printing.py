"""How commands print: results on stdout, messages and progress on stderr.

What a terminal is given is text that gives it no commands. Results are elsewhere when standard error is full,
so the exit code must stay; standard output is the result.
"""

import errno
import json
import os
import re
import sys
from contextlib import contextmanager
from io import BufferedWriter, FileIO, TextIOBase, TextIOWrapper

import typer

from shefex_nav import __version__
from shefex_nav.progress import bar

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


def say(text):
    """A line for people, on stderr."""
    typer.echo(visible(text), err=True)


def say_result(text):
    """A line of a result, on stdout."""
    typer.echo(visible(text))


def print_json(found):
    """Print an object of plain values on stdout, as one line, with the program's version; NaN is a fault."""
    typer.echo(json.dumps({"version": __version__} | found, allow_nan=False))


def stdout(width, **more):
    """rich Console of stdout, as wide as the terminal or, where there is none, `width` characters.

    Names and paths of users are shown as they are: brackets in them are no markup, and what a terminal would
    obey is written out.
    """
    from rich.console import Console
    from rich.segment import Segment

    class Plain(Console):
        def render(self, renderable, options=None):
            for one in super().render(renderable, options):
                yield one if one.control else Segment(visible(one.text), one.style)

        def on_broken_pipe(self):  # rich would end with 1, which says no
            raise

    return Plain(width=None if sys.stdout.isatty() else width, markup=False, **more)


@contextmanager
def counter(total, tell, done=0):
    """Gives a function of words that counts one more: on a bar on stderr, or by `tell` where that is no
    terminal.

    tell : function of how many are done, and of the words
    """
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    columns = BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn()
    with bar(*columns) as progress:
        task = progress.add_task("", total=total, completed=done)

        def count(words):
            nonlocal done
            done += 1
            progress.update(task, completed=done, description=words)
            if progress.disable:
                tell(done, words)

        yield count
