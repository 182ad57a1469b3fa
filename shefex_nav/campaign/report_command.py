"""`shefex-nav report DIR`: what a campaign says, also of one that is not finished."""

import json as json_module
import sys

import typer

WIDTH = 160  # of the tables where there is no terminal


def report(folder, *, json=False, html=None, figures=None):
    """Print the results of a campaign's folder.

    json : one object instead of tables;  html : file of a page to hand over, or None;  figures : folder for
    pictures, made if it is not there, or None. A folder that is no campaign is bad input.
    """
    from shefex_nav.campaign import over_time, summary
    from shefex_nav.campaign.results import open_campaign
    from shefex_nav.report import export_command

    campaign = open_campaign(folder)
    if figures is not None:
        export_command.folder_for(figures, "--figures")
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
    from shefex_nav.campaign.tables import tables

    Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False).print(
        tables(parts(campaign, series))
    )
