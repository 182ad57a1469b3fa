"""How commands print: results on stdout, messages and progress on stderr."""

import json
import sys
from contextlib import contextmanager

import typer


def say(text):
    """A line for people, on stderr."""
    typer.echo(text, err=True)


def print_json(found):
    """Print an object of plain values on stdout, as one line; NaN is a fault."""
    typer.echo(json.dumps(found, allow_nan=False))


def stdout(width, **more):
    """rich Console of stdout, as wide as the terminal or, where there is none, `width` characters."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else width, **more)


@contextmanager
def progress_bar(*columns):
    """rich Progress on stderr, gone when it is over; nothing is drawn where that is no terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        yield progress


@contextmanager
def counter(total, tell, done=0):
    """Gives a function of words that counts one more: on a bar on stderr, or by `tell` where that is no
    terminal.

    tell : function of how many are done, and of the words
    """
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

    columns = BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn()
    with progress_bar(*columns) as progress:
        task = progress.add_task("", total=total, completed=done)

        def count(words):
            nonlocal done
            done += 1
            progress.update(task, completed=done, description=words)
            if progress.disable:
                tell(done, words)

        yield count
