"""`shefex-nav report LOG --html FILE` and `shefex-nav export LOG`: a run for other people and other tools.

Exit codes: 0 done, 2 a log that cannot be read, or an output that cannot be written.
"""

import typer


def check_file(path, option, *, force):
    """Refuse an output file that would be lost or cannot be written, before anything is computed."""
    if path.is_dir():
        raise typer.BadParameter(f"{path} is a folder; give the name of a file", param_hint=option)
    if path.exists() and not force:
        raise typer.BadParameter(
            f"{path} exists already; choose another name or add --force", param_hint=option
        )
    if not path.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {path.parent}", param_hint=option)


def write_page(path, data, log):
    """Write the HTML page of a RunData and say so."""
    from shefex_nav.report import page

    typer.echo("Drawing; the first page on a machine takes longer.", err=True)
    page.write(path, data, log)
    typer.echo(f"wrote {path}", err=True)
