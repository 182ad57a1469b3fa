"""`shefex-nav repeat`: one run of a campaign again, exactly.

Exit codes: 0 it came out as it was kept, with --keep: it is kept now; 1 it differs; 2 bad input.
"""

from pathlib import Path

import typer

from shefex_nav.commands.flights import kept as kept_log
from shefex_nav.commands.options import Json, argument, option
from shefex_nav.commands.output_files import check_file
from shefex_nav.commands.printing import print_json, say, say_result


def repeat(
    folder: argument(Path, "Folder of a campaign.", metavar="DIR"),
    run: argument(int, "Number of the run.", min=0),
    log: option(Path | None, "Write the log of the run (MCAP).") = None,
    force: option(bool, "Overwrite the file given with --log.", "--force") = False,
    keep: option(
        bool, "Keep it in the place of one that a disk has spoilt, or that failed.", "--keep"
    ) = False,
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
