"""`shefex-nav export`: a run for other people and other tools.

Exit codes: 0 done, 2 a log or a scenario that cannot be read or has no frames, or an output that would be
lost or cannot be written.
"""

import math
from pathlib import Path
from typing import NamedTuple

import typer

from shefex_nav.commands.flights import about, say_if_cut, say_missing_plugins
from shefex_nav.commands.options import Overrides, argument, bad, mission_time, option
from shefex_nav.commands.output_files import check_apart, check_file, check_writable
from shefex_nav.commands.printing import say
from shefex_nav.log.mcap_file import is_log
from shefex_nav.progress import bar
from shefex_nav.stopping import wishes

FIRST_SEED, PNG = 1, "png"  # the seed as of `shefex-nav run`
TABLES, MAPS = ("csv", "parquet", "replay"), ("kml", "geojson")
IN_FOLDERS = {  # endings of what is written into each
    "--csv": (".csv",),
    "--parquet": (".parquet", ".csv"),
    "--replay": (".csv", ".yaml"),
    "--frames": (".png", ".fits", ".csv", ".yaml"),
}


class _Frames(NamedTuple):
    """What the options say of frames, as the user wrote it."""

    folder: object  # Path or None
    format: str | None
    from_: str | None
    until: str | None
    every: int
    seed: int | None
    overrides: tuple


Source = argument(
    str, "Log of a run (MCAP), of a killed run too. For --frames also a scenario.", metavar="LOG"
)


def export(
    source: Source,
    csv: option(Path | None, "Folder for tables as CSV, one for each topic.") = None,
    parquet: option(Path | None, "Folder for the same tables as Parquet.") = None,
    replay: option(
        Path | None, "Folder for the measurements of IMU, GPS and others, as `replay` reads them."
    ) = None,
    kml: option(Path | None, "File for the ground track and the events as KML.") = None,
    geojson: option(Path | None, "File for the same as GeoJSON.") = None,
    frames: option(
        Path | None, "Folder for the star camera's whole frames, with truth.csv and camera.yaml."
    ) = None,
    format: option(str | None, "Format of the frames: png (default) or fits.") = None,
    from_: option(
        str | None, "Frames from this mission time on, e.g. 240s.", "--from", metavar="TIME"
    ) = None,
    until: option(str | None, "Frames until this mission time.", metavar="TIME") = None,
    every: option(int, "Write every N-th frame.", min=1) = 1,
    seed: option(int | None, "Seed of the flight, if a scenario is given. Default: 1.", min=0) = None,
    overrides: Overrides = None,
    force: option(bool, "Overwrite existing files.", "--force") = False,
):
    """Write a log as tables (CSV, Parquet), as a ground track (KML, GeoJSON), or its frames as pictures.

    A log keeps most frames without their background: for --frames its flight is flown again.
    A scenario is flown for its frames alone.
    """
    told = zip((*TABLES, *MAPS, "frames"), (csv, parquet, replay, kml, geojson, frames), strict=True)
    outputs = {kind: path for kind, path in told if path is not None}
    folders = {kind: path for kind, path in outputs.items() if kind in TABLES}
    maps = {kind: path for kind, path in outputs.items() if kind in MAPS}
    if not outputs:
        raise typer.BadParameter(
            "nothing to write: name at least one of --csv DIR, --parquet DIR, --replay DIR, --kml FILE, "
            "--geojson FILE, --frames DIR"
        )
    _check_outputs(outputs, source, force=force)
    wanted = _Frames(frames, format, from_, until, every, seed, tuple(overrides or ()))
    of_log = frames is None or is_log(Path(source))
    _check_frames(wanted, of_log=of_log, alone=not folders and not maps)
    if folders or maps:
        _write_tables(Path(source), folders, maps)
    if frames is not None:
        _write_frames(source, wanted, of_log=of_log)


def _write_tables(log, folders, maps):
    """Write the log as tables into folders, and as maps: {kind: path} of both."""
    from shefex_nav.files import put
    from shefex_nav.log import reader

    data = reader.read(log)
    say_if_cut(log, data)
    say_missing_plugins(log, data.mission.plugins)
    from shefex_nav.report import export as tables
    from shefex_nav.report import geography

    if "replay" in folders:
        _write_replay(log, data, folders.pop("replay"))
    for kind, path in folders.items():
        path.mkdir(exist_ok=True)
        written = tables.write(data, path, kind)
        say(f"wrote {len(written) - 1} tables and {tables.COLUMNS} into {path}")
    for kind, path in maps.items():
        put(path, getattr(geography, kind)(data))
        say(f"wrote {path}")


def _write_replay(log, data, folder):
    """Write what the instruments of a flight measured, and the file by which `replay` reads it."""
    from shefex_nav.replay import written

    try:
        names = written.write(data, folder)
    except written.NoDataError as error:
        raise written.NoDataError(f"{log}: {error}") from None
    for words in written.remarks(data):
        say(f"{log}: {words}")
    say(f"wrote {', '.join(names)} into {folder}; shefex-nav replay {folder / names[-1]}")


def _check_outputs(outputs, source, *, force):
    """Refuse outputs {kind: path} of which two are one, or one would be lost or cannot be written."""
    check_apart({f"--{kind}": path for kind, path in outputs.items()}, IN_FOLDERS)
    for kind, path in outputs.items():
        if kind in MAPS:
            check_file(path, f"--{kind}", force=force, given=[source])
        else:
            _check_folder(path, f"--{kind}", force=force)


def _check_folder(path, option, *, force):
    """Refuse a folder that has something in it, or cannot be made."""
    if path.exists() and not path.is_dir():
        raise bad(option, f"{path} is a file; give the name of a folder")
    if not path.exists() and not path.parent.is_dir():
        raise bad(option, f"there is no folder {path.parent}")
    if path.is_dir() and any(path.iterdir()) and not force:
        raise bad(option, f"{path} is not empty; choose another folder or add --force")
    check_writable(path, option)


def _check_frames(wanted, *, of_log, alone):
    """Refuse options that do not go together. of_log : the source is a log; alone : nothing else is wanted"""
    from shefex_nav.frames.export import FORMATS

    if wanted.format is not None and wanted.format not in FORMATS:
        raise bad("--format", f"expected one of {', '.join(FORMATS)}, got {wanted.format!r}")
    given = {"--format": wanted.format, "--from": wanted.from_, "--until": wanted.until}
    given |= {"--seed": wanted.seed}
    given |= {"--every": None if wanted.every == 1 else wanted.every, "--set": wanted.overrides or None}
    for flag, value in given.items():
        if value is not None and wanted.folder is None:
            raise bad(flag, "goes with --frames DIR")
        if value is not None and of_log and flag in ("--seed", "--set"):
            raise bad(flag, "a log has its own; give the scenario in its place")
    from_s, until_s = _between(wanted)
    if not from_s <= until_s:
        raise bad("--until", f"{wanted.until} is before --from {wanted.from_}")
    if not of_log and not alone:
        raise typer.BadParameter("a scenario is flown for its frames alone; tables need a log: run it first")


def _between(wanted):
    """Mission times [s] from and until which frames are wanted."""
    from_s = -math.inf if wanted.from_ is None else mission_time(wanted.from_, "--from", "240s")
    until_s = math.inf if wanted.until is None else mission_time(wanted.until, "--until", "300s")
    return from_s, until_s


def _write_frames(source, wanted, *, of_log):
    """Fly, and write the frames; a bar on stderr shows how far that is."""
    from shefex_nav.frames import export, flown
    from shefex_nav.scenario import load

    from_s, until_s = _between(wanted)
    try:
        with about(source):
            if of_log:
                flight = flown.of_log(source)
                say_missing_plugins(source, flight.known.mission.plugins)
            else:
                flight = flown.of_scenario(
                    load.load(source, wanted.overrides), FIRST_SEED if wanted.seed is None else wanted.seed
                )
    except flown.FramesError as error:
        raise flown.FramesError(f"{source}: {error}") from None
    shots = flown.shots(flight, source, from_s, until_s, wanted.every)
    wanted.folder.mkdir(exist_ok=True)
    n, written = 0, export.write(wanted.folder, flight, shots, wanted.format or PNG)
    with wishes() as asked:
        for _ in _watched(written, flight, from_s, until_s):
            n += 1
            if asked:
                say(f"{wanted.folder}: {n} frames until now")
                raise KeyboardInterrupt
    if not n:
        if not any(wanted.folder.iterdir()):
            wanted.folder.rmdir()
        on_s, off_s = flight.scenario.star_tracker.on, min(flight.scenario.star_tracker.off, flight.until_s)
        words = f"there is no frame between these times; there are some from T{on_s:+g} to {off_s:+g} s"
        raise flown.FramesError(f"{source}: {words}")
    say(f"wrote {n} frames, {export.TRUTH}, {export.TOLD} and {export.TRUE} into {wanted.folder}")


def _watched(shots, flight, from_s, until_s):
    """The same shots; shows mission time and number on stderr while they pass."""
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn

    tracker = flight.scenario.star_tracker
    begin_s, end_s = max(from_s, tracker.on), min(until_s, flight.until_s, tracker.off)
    words = "T{task.fields[t_s]:+8.1f} s  frame {task.fields[number]}"
    with bar(BarColumn(), TextColumn(words), TimeRemainingColumn()) as progress:
        total = max(end_s - begin_s, 0.0)
        task = progress.add_task("frames", total=total, t_s=begin_s, number=0)
        for shot in shots:
            t_s = shot.frame.t_valid_s
            progress.update(task, completed=t_s - begin_s, t_s=t_s, number=shot.frame.number)
            yield shot
