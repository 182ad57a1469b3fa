"""`shefex-nav report DIR`: what a campaign says, also of one that is not finished."""

import json as json_module
import sys

import typer

WIDTH = 160  # of the tables where there is no terminal


def report(folder, *, json=False, html=None, figures=None):
    """Print the results of a campaign's folder.

    json : one object instead of tables;  html : file of a page to hand over, or None;  figures : folder for
    pictures that is there, or None. A folder that is no campaign is bad input.
    """
    from shefex_nav.campaign.results import open_campaign
    from shefex_nav.campaign.store import StoreError

    try:
        campaign = open_campaign(folder)
    except StoreError as error:
        raise typer.BadParameter(str(error), param_hint="LOG") from None
    from shefex_nav.campaign import over_time, summary

    wanted = html is not None or figures is not None or not json
    series = over_time.read(campaign) if wanted else None
    if json:
        typer.echo(json_module.dumps(summary.summary_object(campaign), allow_nan=False))
    else:
        show(campaign, series)
    if html is not None:
        from shefex_nav.campaign import page

        page.write(html, campaign, series)
        typer.echo(f"wrote {html}", err=True)
    if figures is not None:
        from shefex_nav.campaign import figures as pictures

        for path in pictures.save_all(campaign, series, figures):
            typer.echo(f"wrote {path}", err=True)


def show(campaign, series):
    """Print the tables. Campaign, over_time.Series or None"""
    from rich.console import Console

    from shefex_nav.campaign.parts import parts

    Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False).print(
        tables(parts(campaign, series))
    )


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
    from rich.table import Table
    from rich.text import Text

    from shefex_nav.campaign.parts import Command

    if part.rows:
        table = Table(
            title=part.title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD,
            show_header=bool(part.heads),
        )  # fmt: skip
        for name in part.heads or [""] * len(part.rows[0]):
            table.add_column(name.lstrip(">"), justify="right" if name.startswith(">") else "left")
        for row in part.rows:
            table.add_row(*(_cell(cell) for cell in row))
        yield table
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

    from shefex_nav.campaign.parts import Loud

    return Text(str(cell), style="bold yellow" if isinstance(cell, Loud) else "")
