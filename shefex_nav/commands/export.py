"""`shefex-nav export`: a run for other people and other tools.

Exit codes: 0 done, 2 a log that cannot be read, or an output that would be lost or cannot be written.
"""

from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.commands.flights import tell_if_cut, tell_of_plugins
from shefex_nav.commands.options import Log
from shefex_nav.commands.output_files import check_file
from shefex_nav.commands.printing import say


def export(
    log: Log,
    csv: Annotated[Path | None, typer.Option(help="Folder for tables as CSV, one a topic.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Folder for the same tables as Parquet.")] = None,
    kml: Annotated[Path | None, typer.Option(help="File for the ground track and the events as KML.")] = None,
    geojson: Annotated[Path | None, typer.Option(help="File for the same as GeoJSON.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
):
    """Write a log as tables (CSV, Parquet) or as a ground track (KML, GeoJSON)."""
    folders = {kind: path for kind, path in (("csv", csv), ("parquet", parquet)) if path is not None}
    maps = {kind: path for kind, path in (("kml", kml), ("geojson", geojson)) if path is not None}
    if not folders and not maps:
        raise typer.BadParameter(
            "nothing to write: name at least one of --csv DIR, --parquet DIR, --kml FILE, --geojson FILE"
        )
    for kind, path in folders.items():
        _check_folder(path, f"--{kind}", force=force)
    for kind, path in maps.items():
        check_file(path, f"--{kind}", force=force, given=[log])
    from shefex_nav.log import reader

    data = reader.read(log)
    tell_if_cut(log, data)
    tell_of_plugins(log, data.mission.plugins)
    from shefex_nav.report import export as tables
    from shefex_nav.report import geography

    for kind, path in folders.items():
        path.mkdir(exist_ok=True)
        written = tables.write(data, path, kind)
        say(f"wrote {len(written) - 1} tables and {tables.COLUMNS} into {path}")
    for kind, path in maps.items():
        path.write_text(getattr(geography, kind)(data), encoding="utf-8")
        say(f"wrote {path}")


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
