"""How commands print: results on stdout, messages and progress on stderr."""

import json
import sys
from contextlib import contextmanager

import typer

from shefex_nav import __version__
from shefex_nav.commands.terminal import visible
from shefex_nav.progress import bar


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
