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
