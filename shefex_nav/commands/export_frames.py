"""`shefex-nav export --frames`: what its options mean, and the export with a bar."""

import math
from typing import NamedTuple

import typer

from shefex_nav.commands.flights import about, tell_of_plugins
from shefex_nav.commands.options import mission_time
from shefex_nav.commands.printing import say
from shefex_nav.progress import bar
from shefex_nav.stopping import wishes

FIRST_SEED = 1  # as of `shefex-nav run`


class Wanted(NamedTuple):
    """What the options say of frames, as the user wrote it."""

    folder: object  # Path or None
    format: str
    from_: str | None
    until: str | None
    every: int
    seed: int | None
    overrides: tuple


def check(wanted, *, of_log, alone):
    """Refuse options that do not go together. of_log : the source is a log; alone : nothing else is wanted"""
    from shefex_nav.frames.picture_files import FORMATS

    if wanted.format not in FORMATS:
        raise typer.BadParameter(
            f"expected one of {', '.join(FORMATS)}, got {wanted.format!r}", param_hint="--format"
        )
    given = {"--from": wanted.from_, "--until": wanted.until, "--seed": wanted.seed}
    given |= {"--every": None if wanted.every == 1 else wanted.every, "--set": wanted.overrides or None}
    for option, value in given.items():
        if value is not None and wanted.folder is None:
            raise typer.BadParameter("goes with --frames DIR", param_hint=option)
        if value is not None and of_log and option in ("--seed", "--set"):
            raise typer.BadParameter("a log has its own; give the scenario in its place", param_hint=option)
    from_s, until_s = between(wanted)
    if not from_s <= until_s:
        raise typer.BadParameter(f"{wanted.until} is before --from {wanted.from_}", param_hint="--until")
    if not of_log and not alone:
        raise typer.BadParameter("a scenario is flown for its frames alone; tables need a log: run it first")


def between(wanted):
    """Mission times [s] from and until which frames are wanted."""
    from_s = -math.inf if wanted.from_ is None else mission_time(wanted.from_, "--from", "240s")
    until_s = math.inf if wanted.until is None else mission_time(wanted.until, "--until", "300s")
    return from_s, until_s


def write(source, wanted, *, of_log):
    """Fly, and write the frames; a bar on stderr shows how far that is."""
    from shefex_nav.frames import export, flown
    from shefex_nav.scenario import load

    from_s, until_s = between(wanted)
    try:
        with about(source):
            if of_log:
                flight = flown.of_log(source)
                tell_of_plugins(source, flight.known.mission.plugins)
            else:
                flight = flown.of_scenario(
                    load.load(source, wanted.overrides), FIRST_SEED if wanted.seed is None else wanted.seed
                )
    except flown.FramesError as error:
        raise flown.FramesError(f"{source}: {error}") from None
    shots = flown.shots(flight, source, from_s, until_s, wanted.every)
    wanted.folder.mkdir(exist_ok=True)
    n = 0
    with wishes() as asked:
        for _ in _watched(export.write(wanted.folder, flight, shots, wanted.format), flight, from_s, until_s):
            n += 1
            if asked:
                raise KeyboardInterrupt
    if not n:
        on, off = flight.scenario.star_tracker.on, flight.scenario.star_tracker.off
        say(
            f"{source}: there is no frame between these times; "
            f"the star tracker is on from T{on:+g} to {off:+g} s"
        )
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
