"""`shefex-nav report DIR`: what a campaign says, also of one that is not finished."""

import json as json_module
import sys

import typer

WIDTH = 150  # of the tables where there is no terminal


def report(folder, *, json=False, figures=None):
    """Print the results of a campaign's folder; with `figures`, a folder, write pictures there.

    A folder that is no campaign is bad input.
    """
    from shefex_nav.campaign.results import open_campaign
    from shefex_nav.campaign.store import StoreError

    try:
        campaign = open_campaign(folder)
    except StoreError as error:
        raise typer.BadParameter(str(error), param_hint="LOG") from None
    if figures is not None:
        _folder_for(figures)
    from shefex_nav.campaign import over_time, summary

    series = over_time.read(campaign) if figures is not None or not json else None
    if json:
        typer.echo(json_module.dumps(summary.summary_object(campaign), allow_nan=False))
    else:
        show(campaign, series)
    if figures is not None:
        from shefex_nav.campaign import figures as pictures

        for path in pictures.write(campaign, series, figures):
            typer.echo(f"wrote {path}", err=True)


def show(campaign, series):
    """Print the tables."""
    from rich.console import Console

    from shefex_nav.campaign import summary

    Console(width=None if sys.stdout.isatty() else WIDTH, highlight=False).print(
        summary.tables(campaign, series)
    )


def _folder_for(path):
    """Refuse a folder that cannot take pictures before anything is computed."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise typer.BadParameter(
            f"cannot make the folder {path}: {error.strerror}", param_hint="--figures"
        ) from None
