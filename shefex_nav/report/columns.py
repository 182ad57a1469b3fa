"""Tables of rich, all of one look."""

from itertools import groupby
from operator import itemgetter


def table(title, heads, rows=(), *, no_wrap=False, **look):
    """rich Table with its title on the left.

    heads : names of the columns; one that begins with '>' is of numbers, set to the right
    rows : of texts, a list for each row
    no_wrap : whether no cell is broken into lines
    """
    from rich.table import Table

    made = Table(title=title, title_justify="left", **look)
    for name in heads:
        side = "right" if name.startswith(">") else "left"
        made.add_column(name.removeprefix(">"), justify=side, no_wrap=no_wrap)
    for row in rows:
        made.add_row(*row)
    return made


def sections(title, rows, *, widest=None):
    """rich Table of (section, name, value); the name of a section stands once, with a line below its rows.

    rows : of texts;  widest : letters of the first column before it is broken; None: it is not
    """
    from rich.table import Table

    made = Table(title=title, show_header=False, title_justify="left")
    made.add_column(style="bold", no_wrap=widest is None, overflow="fold", max_width=widest)
    made.add_column(no_wrap=True)
    made.add_column(overflow="fold")  # of a long path nothing is left out
    for section, held in groupby(rows, key=itemgetter(0)):
        for k, (_, name, value) in enumerate(held):
            made.add_row("" if k else section, name, value)
        made.add_section()
    return made
