"""`shefex-nav verify robustness`: does a navigation stay honest when it is told wrongly and sensors fail?

Exit codes: 0 every requirement is met, 1 one is not, 2 bad input, 130 interrupted.
"""

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import typer


def robustness(
    scenarios: Annotated[
        list[str], typer.Argument(metavar="SCENARIO...", help="Scenarios, files or names of shipped ones.")
    ],
    flights: Annotated[int, typer.Option(min=1, help="How many flights of each cell.")] = 25,
    cells: Annotated[
        str | None, typer.Option(metavar="LIST", help="Cells of the design, e.g. 0-19,35; default all.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Root of all random numbers.")] = 0,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one a core.")
    ] = None,
    random_faults: Annotated[
        int, typer.Option(min=0, metavar="N", help="Instead: N missions with one or two random faults.")
    ] = 0,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override one value.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Keep flights, and draw robustness.html.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the flights that --out FOLDER has already.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Fly the stress matrix: told wrongly, sensors that fail, every phase, grade of IMU and rocket."""
    if resume and out is None:
        raise typer.BadParameter("needs --out FOLDER, where the flights are", param_hint="--resume")
    if random_faults and cells is not None:
        raise typer.BadParameter("random faults have no cells of the design", param_hint="--cells")
    request = _request(scenarios, overrides, flights, _cells(cells), seed, random_faults)
    from shefex_nav.verify.robustness import require, running, show, store

    waiting, head = running.jobs(request), _head(request)
    with store.Store(out, head, resume) as kept:
        missing = [job for job in waiting if _key(job) not in kept.done]
        interrupted = _fly(missing, len(waiting), jobs, kept)
        wanted = {_key(job) for job in waiting}
        records = [record for key, record in sorted(kept.done.items()) if key in wanted]
    if not records:
        _say("interrupted before the first flight was over")
        raise typer.Exit(130)
    found = show.as_numbers(head, records)
    if json:
        typer.echo(json_module.dumps(found, allow_nan=False))
    else:
        _show(records)
    if out is not None:
        from shefex_nav.verify.robustness import page

        page.write(out / store.PAGE, head, records)
        _say(f"wrote {out / store.PAGE}")
    if interrupted:
        how = "the same command with --resume goes on" if out else "nothing is kept, --out FOLDER would"
        _say(f"interrupted after {len(records)} of {require.counted(len(waiting), 'flight')}; {how}")
        raise typer.Exit(130)
    if not found["ok"]:
        for one in found["requirements"]:
            if one["good"] is False:
                _say(f"not met: {one['words']}: {one['found']}")
        raise typer.Exit(1)


def _request(scenarios, overrides, flights, cells, seed, random_faults):
    """running.Request; a scenario that cannot be flown is refused here."""
    from shefex_nav.scenario import load
    from shefex_nav.verify.robustness import running

    given = []
    for name in dict.fromkeys(scenarios):
        loaded = load.load(name, overrides or ())
        if loaded.navigation.gps != "loose":
            raise running.RobustnessError(
                f"{name}: navigation.gps has to be 'loose', not '{loaded.navigation.gps}': the matrix "
                "changes fixes, not ranges"
            )
        _refuse_without_statistics(name, loaded.mission.name, tuple(overrides or ()))
        given.append((name, loaded.mission.name, bool(loaded.star_tracker.enabled)))
    names = [mission for _, mission, _ in given]
    if len(set(names)) < len(names):
        raise running.RobustnessError(f"two scenarios have the same mission.name: {', '.join(names)}")
    return running.Request(tuple(given), tuple(overrides or ()), flights, cells, seed, random_faults)


def _refuse_without_statistics(name, mission, overrides):
    """Refuse a scenario whose star tracker has no statistics: no cell could be flown."""
    from shefex_nav.scenario.layers import ScenarioError
    from shefex_nav.verify.robustness import design, flight, running

    try:
        flight.scenario_of(name, (*design.ROCKETS.get(mission, ()), *overrides))
    except ScenarioError as error:
        raise running.RobustnessError(
            f"{name}: the matrix flies star trackers by their statistics (star_tracker.frames: statistical), "
            "and those here are not of this scenario; `shefex-nav characterise` makes them, "
            f"--set star_tracker.enabled=false flies without stars\n{error}"
        ) from None


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
            raise typer.BadParameter(words, param_hint="--cells")
        low, high = int(first), int(last or first)
        if not low <= high <= most:
            words = f"{part.strip()}: expected cells from 0 to {most}, the smaller number first"
            raise typer.BadParameter(words, param_hint="--cells")
        found |= set(range(low, high + 1))
    return frozenset(found)


def _head(request):
    """What a folder is of; what may grow, flights and cells, is not in it."""
    from shefex_nav.verify.robustness import store

    return {
        "scenarios": [name for name, *_ in request.scenarios],
        "set": list(request.overrides),
        "seed": request.seed,
        "of": "random faults" if request.random else "design",
        "code": store.code_digest(),
    }


def _key(job):
    return job.cell.rocket, job.cell.number, job.flight


def _fly(missing, total, jobs, kept):
    """Fly what is missing, with a bar on stderr or lines where that is no terminal. -> whether interrupted"""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from shefex_nav.verify.robustness import require, running

    if not missing:
        return False
    _warm_up(missing)
    console, done, said = Console(stderr=True), total - len(missing), 0
    columns = BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=total, completed=done)

        def take(record):
            nonlocal done, said
            kept.keep(record)
            done += 1
            progress.update(task, completed=done, description=f"cell {record['cell']}")
            if not console.is_terminal and done * 20 // total > said:
                said = done * 20 // total
                _say(f"{done} of {require.counted(total, 'flight')} done")

        try:
            running.fly(missing, jobs, take)
        except KeyboardInterrupt:
            return True
    return False


def _warm_up(missing):
    """Compile what is not compiled yet: workers would do so all at once."""
    from shefex_nav import warmup
    from shefex_nav.scenario import load
    from shefex_nav.scenario.choices import choices

    for name in dict.fromkeys(job.scenario for job in missing):
        warmup.get_ready({"command=run", *choices(load.load(name))})


def _show(records):
    from rich.console import Console

    from shefex_nav.verify.robustness import require, show

    console = Console(width=None if sys.stdout.isatty() else 200)
    for table in show.tables(records):
        console.print(table)
        console.print()
    cpu_s = sum(record["cpu_s"] for record in records)
    flights = require.counted(len(records), "flight")
    typer.echo(f"{flights}, each with its twin; {cpu_s / len(records):.1f} s of a processor each")


def _say(text):
    typer.echo(text, err=True)
