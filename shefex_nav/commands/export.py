"""`shefex-nav export`: a run for other people and other tools.

Exit codes: 0 done, 2 a log or a scenario that cannot be read or has no frames, or an output that would be
lost or cannot be written.
"""

from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.commands import export_frames
from shefex_nav.commands.flights import tell_if_cut, tell_of_plugins
from shefex_nav.commands.options import Overrides, is_log
from shefex_nav.commands.output_files import check_file
from shefex_nav.commands.printing import say


def export(
    source: Annotated[
        str,
        typer.Argument(
            metavar="LOG", help="Log of a run (MCAP), of a killed one too; a scenario will do for --frames."
        ),
    ],
    csv: Annotated[Path | None, typer.Option(help="Folder for tables as CSV, one a topic.")] = None,
    parquet: Annotated[Path | None, typer.Option(help="Folder for the same tables as Parquet.")] = None,
    kml: Annotated[Path | None, typer.Option(help="File for the ground track and the events as KML.")] = None,
    geojson: Annotated[Path | None, typer.Option(help="File for the same as GeoJSON.")] = None,
    frames: Annotated[
        Path | None,
        typer.Option(help="Folder for the star camera's frames, whole, with truth.csv and camera.yaml."),
    ] = None,
    format: Annotated[str, typer.Option(help="Of the frames: png (8 or 16 bits) or fits.")] = "png",
    from_: Annotated[
        str | None,
        typer.Option("--from", metavar="TIME", help="Frames from this mission time on, e.g. 240s."),
    ] = None,
    until: Annotated[str | None, typer.Option(metavar="TIME", help="Frames until this mission time.")] = None,
    every: Annotated[int, typer.Option(min=1, help="Every so many-th of the frames.")] = 1,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of a scenario that is flown for its frames; default 1.")
    ] = None,
    overrides: Overrides = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
):
    """Write a log as tables (CSV, Parquet), as a ground track (KML, GeoJSON), or its frames as pictures.

    A log keeps most pictures without their background: its flight is flown again for them. A scenario is
    flown for its frames alone.
    """
    folders = {kind: path for kind, path in (("csv", csv), ("parquet", parquet)) if path is not None}
    maps = {kind: path for kind, path in (("kml", kml), ("geojson", geojson)) if path is not None}
    if not folders and not maps and frames is None:
        raise typer.BadParameter(
            "nothing to write: name at least one of --csv DIR, --parquet DIR, --kml FILE, --geojson FILE, "
            "--frames DIR"
        )
    for kind, path in (*folders.items(), *([("frames", frames)] if frames else ())):
        _check_folder(path, f"--{kind}", force=force)
    for kind, path in maps.items():
        check_file(path, f"--{kind}", force=force, given=[source])
    wanted = export_frames.Wanted(frames, format, from_, until, every, seed, tuple(overrides or ()))
    of_log = frames is None or is_log(Path(source))
    export_frames.check(wanted, of_log=of_log, alone=not folders and not maps)
    if folders or maps:
        _write_tables(Path(source), folders, maps)
    if frames is not None:
        export_frames.write(source, wanted, of_log=of_log)


def _write_tables(log, folders, maps):
    """Write the log as tables into folders, and as maps: {kind: path} of both."""
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
