"""Parts of a campaign's report as tables of rich, for terminals and notebooks."""

from typing import NamedTuple

from shefex_nav.report import columns


class Bold(str):
    """A text that wants attention."""


class Command(str):
    """A line to be copied into a terminal."""


class Part(NamedTuple):
    """One piece of a report: a table, then lines."""

    title: str
    heads: tuple = ()  # names of the columns; one that begins with '>' is of numbers
    rows: tuple = ()  # of tuples of texts
    lines: tuple = ()  # of texts


def tables(parts):
    """rich Group of list of Part."""
    from rich.console import Group
    from rich.jupyter import JupyterMixin

    class Tables(Group, JupyterMixin):
        """A Group that notebooks show."""

    return Tables(*(shown for part in parts for shown in _shown(part)))


def _shown(part):
    """What a Part looks like: rich objects."""
    from rich import box
    from rich.text import Text

    if part.rows:
        heads, look = part.heads or [""] * len(part.rows[0]), {"title_style": "bold", "box": box.SIMPLE_HEAD}
        rows = (map(_cell, row) for row in part.rows)
        yield columns.table(part.title, heads, rows, show_header=bool(part.heads), **look)
    else:
        yield Text(part.title, style="bold")
    for line in part.lines:
        if isinstance(line, Command):  # not broken, so that it can be copied
            yield Text(f"    {line}", style="cyan", no_wrap=True, overflow="ignore")
        else:
            yield Text(f"  {line}")
    if part.lines:
        yield ""


def _cell(cell):
    from rich.text import Text

    return Text(str(cell), style="bold yellow" if isinstance(cell, Bold) else "")
