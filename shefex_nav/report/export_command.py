"""`shefex-nav export LOG`, and `--html` of `report`: a run for other people and other tools.

Exit codes: 0 done, 2 a log that cannot be read, or an output that would be lost or cannot be written.
"""

from pathlib import Path
from typing import Annotated

import typer


def export(
    log: Annotated[Path, typer.Argument(help="Log of a run (MCAP); logs of killed runs are read too.")],
    csv: Annotated[Path | None, typer.Option(help="Folder for tables as CSV, one a topic.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Folder for the same tables as Parquet.")] = None,
    kml: Annotated[Path | None, typer.Option(help="File for the ground track and the events as KML.")] = None,
    geojson: Annotated[Path | None, typer.Option(help="File for the same as GeoJSON.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
):
    """Write a log as tables (CSV, Parquet) or as a ground track (KML, GeoJSON)."""
    folders = {"csv": csv, "parquet": parquet}
    maps = {"kml": kml, "geojson": geojson}
    if not any(path is not None for path in (*folders.values(), *maps.values())):
        raise typer.BadParameter(
            "nothing to write: name at least one of --csv DIR, --parquet DIR, --kml FILE, --geojson FILE"
        )
    for kind, path in folders.items():
        if path is not None:
            _check_folder(path, f"--{kind}", force=force)
    for kind, path in maps.items():
        if path is not None:
            check_file(path, f"--{kind}", force=force, given=[log])
    from shefex_nav.log import reader

    data = reader.read(log)
    if data.ended_early:
        typer.echo(f"{log}: the run ended early, at T{data.last_t_s:+.2f} s; this is what there is", err=True)
    from shefex_nav.report import export as tables
    from shefex_nav.report import geography

    for kind, path in folders.items():
        if path is not None:
            path.mkdir(exist_ok=True)
            written = tables.write(data, path, kind)
            typer.echo(f"wrote {len(written) - 1} tables and {tables.COLUMNS} into {path}", err=True)
    for kind, path in maps.items():
        if path is not None:
            path.write_text(getattr(geography, kind)(data), encoding="utf-8")
            typer.echo(f"wrote {path}", err=True)


def check_pictures(folder, names, option, *, force):
    """Refuse a folder in which one of these pictures (PNG) would be overwritten."""
    there = [name for name in names if (folder / f"{name}.png").exists()]
    if there and not force:
        more = f" and {len(there) - 1} more exist" if there[1:] else " exists"
        raise typer.BadParameter(
            f"{folder / there[0]}.png{more} already; choose another folder or add --force", param_hint=option
        )


def folder_for(path, option):
    """Make a folder for results, or say why not."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise typer.BadParameter(
            f"cannot make the folder {path}: {error.strerror}", param_hint=option
        ) from None


def check_file(path, option, *, force, given=()):
    """Refuse an output file that would be lost or cannot be written, before anything is computed.

    given : paths of what is read, which nothing may overwrite
    """
    if any(path.resolve() == Path(one).resolve() for one in given):
        what = "the log itself" if path.suffix == ".mcap" else "a file that is read here"
        raise typer.BadParameter(f"{path} is {what}; choose another name", param_hint=option)
    if path.is_dir():
        raise typer.BadParameter(f"{path} is a folder; give the name of a file", param_hint=option)
    if path.exists() and not force:
        raise typer.BadParameter(
            f"{path} exists already; choose another name or add --force", param_hint=option
        )
    if not path.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {path.parent}", param_hint=option)


def _check_folder(path, option, *, force):
    """Refuse a folder that has something in it, or cannot be made."""
    if path.exists() and not path.is_dir():
        raise typer.BadParameter(f"{path} is a file; give the name of a folder", param_hint=option)
    if not path.exists() and not path.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {path.parent}", param_hint=option)
    if path.is_dir() and any(path.iterdir()) and not force:
        raise typer.BadParameter(
            f"{path} is not empty; choose another folder or add --force", param_hint=option
        )


def write_page(path, data, log):
    """Write the HTML page of a RunData and say so."""
    from shefex_nav.report import page

    typer.echo("Drawing; the first page on a machine takes longer.", err=True)
    page.write(path, data, log)
    typer.echo(f"wrote {path}", err=True)
