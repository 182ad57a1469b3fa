"""Tables of rich, all of one look."""


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
