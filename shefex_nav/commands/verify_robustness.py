"""`shefex-nav verify robustness`: does a navigation stay honest when it is told wrongly and sensors fail?

Exit codes: 0 every requirement is met, 1 one is not, 2 bad input, 130 interrupted.
"""

from pathlib import Path

import typer

from shefex_nav.commands.options import Json, StudyOverrides, Workers, argument, bad, option
from shefex_nav.commands.output_files import check_writable
from shefex_nav.commands.printing import counter, print_json, say, stdout

FLIGHTS = 25  # of each cell


def robustness(
    scenarios: argument(list[str], "Scenarios, files or names of shipped ones.", metavar="SCENARIO..."),
    flights: option(int | None, f"How many flights of each cell; default {FLIGHTS}.", min=1) = None,
    cells: option(str | None, "Cells of the design, e.g. 0-19,35; default all.", metavar="LIST") = None,
    seed: option(int, "Root of all random numbers.", min=0) = 0,
    jobs: Workers = None,
    random_faults: option(int, "Instead: N missions with one or two random faults.", min=0, metavar="N") = 0,
    overrides: StudyOverrides = None,
    out: option(Path | None, "Keep flights, and draw robustness.html.", metavar="FOLDER") = None,
    resume: option(bool, "Go on with the flights that --out FOLDER has already.", "--resume") = False,
    json: Json = False,
):
    """Fly the stress matrix: told wrongly, sensors that fail, every phase, grade of IMU and rocket."""
    if resume and out is None:
        raise bad("--resume", "needs --out FOLDER, where the flights are")
    _without_cells(random_faults, {"--cells": cells, "--flights": flights})
    chosen = _cells(cells)
    from shefex_nav.verify.robustness import running, store

    if out is not None:
        check_writable(out, "--out")
    request = running.request(scenarios, overrides or (), flights or FLIGHTS, chosen, seed, random_faults)
    waiting, head = running.jobs(request), store.head(request)
    with store.Store(out, head, resume) as kept:
        interrupted = _fly(waiting, jobs, kept)
        records = kept.of(waiting)
    if not records:
        say("interrupted before the first flight was over")
        raise typer.Exit(130)
    found = _result(head, records, out, json)
    if interrupted:
        _say_interrupted(len(records), len(waiting), out)
        raise typer.Exit(130)
    if not found["ok"]:
        for one in found["requirements"]:
            if one["good"] is False:
                say(f"not met: {one['words']}: {one['found']}")
        raise typer.Exit(1)


def _without_cells(random_faults, given):
    """Refuse options {name: value, or None} that are of cells where faults are drawn at random."""
    for flag, value in given.items():
        if random_faults and value is not None:
            raise bad(flag, "random faults have no cells of the design")


def _cells(text):
    """Numbers of cells of a text such as 0-19,35: frozenset, None of None."""
    if text is None:
        return None
    from shefex_nav.verify.robustness import design

    most, found = len(design.cells()) - 1, set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not (first.isdecimal() and (last.isdecimal() or not dash)):
            words = f"{part.strip()!r} is no number and no range of cells such as 0-19"
            raise bad("--cells", words)
        low, high = int(first), int(last or first)
        if not low <= high <= most:
            words = f"{part.strip()}: expected cells from 0 to {most}, the smaller number first"
            raise bad("--cells", words)
        found |= set(range(low, high + 1))
    return frozenset(found)


def _fly(waiting, workers, kept):
    """Fly what is missing, with a bar on stderr or lines where that is no terminal. -> whether interrupted

    waiting : list of flight.Job, those among them whose flights the store.Store `kept` has as well
    """
    from shefex_nav.verify.robustness import require, running

    missing, total = kept.missing(waiting), len(waiting)
    if not missing:
        return False
    running.warm_up(missing)
    said = 0

    def tell(done, _):
        nonlocal said
        if done * 20 // total > said:
            said = done * 20 // total
            say(f"{done} of {require.counted(total, 'flight')} done")

    with counter(total, tell, total - len(missing)) as count:

        def take(record):
            kept.keep(record)
            count(f"cell {record['cell']}")

        try:
            running.fly(missing, workers, take)
        except KeyboardInterrupt:
            return True
    return False


def _result(head, records, out, as_json):
    """Print what came out, and draw the page if there is a folder for it. -> what --json prints"""
    from shefex_nav.verify.robustness import show, store

    found = show.as_numbers(head, records)
    if as_json:
        print_json(found)
    else:
        _show(records)
    if out is not None:
        from shefex_nav.verify.robustness import page

        page.write(out / store.PAGE, head, records)
        say(f"wrote {out / store.PAGE}")
    return found


def _show(records):
    """The result as people read it."""
    from shefex_nav.verify.robustness import require, show

    console = stdout(200)
    for table in show.tables(records):
        console.print(table)
        console.print()
    cpu_s = sum(record["cpu_s"] for record in records)
    flights = require.counted(len(records), "flight")
    typer.echo(f"{flights}, each with its twin; {cpu_s / len(records):.1f} s of a processor each")


def _say_interrupted(flown, total, out):
    """How to go on."""
    from shefex_nav.verify.robustness import require

    how = "the same command with --resume goes on" if out else "nothing is kept, --out FOLDER would"
    say(f"interrupted after {flown} of {require.counted(total, 'flight')}; {how}")
