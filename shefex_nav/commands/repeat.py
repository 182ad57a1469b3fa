"""`shefex-nav repeat`: one run of a campaign again, exactly.

Exit codes: 0 it came out as it was kept, with --keep: it is kept now; 1 it differs; 2 bad input.
"""

from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.commands.flights import kept as kept_log
from shefex_nav.commands.options import Json
from shefex_nav.commands.output_files import check_file
from shefex_nav.commands.printing import print_json, say, say_result


def repeat(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a campaign.")],
    run: Annotated[int, typer.Argument(min=0, help="Number of the run.")],
    log: Annotated[Path | None, typer.Option(help="Write the log of the run (MCAP).")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file given with --log.")] = False,
    keep: Annotated[
        bool,
        typer.Option("--keep", help="Keep it in the place of one that a disk has spoilt, or that failed."),
    ] = False,
    json: Json = False,
):
    """Fly one run of a campaign again, exactly, and compare it with what was kept (exit code 1: differs)."""
    from shefex_nav.campaign import repeating, running

    if log is not None:
        check_file(log, "--log", force=force)
    repeating.read_head(folder, run)  # refuses before anything is said
    say(f"{folder}, run {run}")
    with kept_log(log, "flown"):
        repeated, kept = (
            running.mend(folder, run, log) if keep else (repeating.repeat(folder, run, log), False)
        )
    for line in repeated.notes:
        say(line)
    if keep:
        say(f"run {run} is {'kept' if kept else 'left as it was: now it comes out otherwise'}")
    if json:
        print_json(repeated.result() | ({"kept": kept} if keep else {}))
    else:
        say_result(repeated.words())
    raise typer.Exit(0 if repeated.same or kept else 1)
