"""`shefex-nav verify consistency`: are a filter's errors as large as it says? NEES, NIS, 3 sigma over seeds.

Exit codes: 0 every statistic is inside its interval, 1 one is outside, 2 bad input, 130 interrupted.
"""

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import typer

from shefex_nav import files

CONTAINED, ONE_FIELD = "3 sigma ", ", one field"  # of `nees.Verdict.what`


def consistency(
    scenario: Annotated[
        str, typer.Argument(help="Scenario: a YAML file, or the name of a shipped one, e.g. shefex2_andoya.")
    ],
    seeds: Annotated[int, typer.Option(min=2, help="How many runs; intervals get narrower with them.")] = 20,
    first: Annotated[int, typer.Option(min=0, help="Seed of the first; the others follow.")] = 0,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override one value.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one a core.")
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(help="Folder for the star fixes of the flights; seeds that it has are not flown again."),
    ] = None,
    turn_field: Annotated[
        bool,
        typer.Option(
            "--turn-field",
            help="Let what the on-board model leaves out of gravity point elsewhere in each run.",
        ),
    ] = False,
    histories: Annotated[
        int, typer.Option(min=100, help="Histories that make the intervals of the NEES.")
    ] = 1000,
    out: Annotated[
        Path | None, typer.Option(help="Draw the NEES over time into a new .png or .svg file.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Fly a scenario with many seeds and hold the filter's errors against its own covariance."""
    from shefex_nav.verify.command import writable

    if out is not None:
        writable(out)
    from shefex_nav.scenario import load

    loaded = load.load(scenario, overrides or ())
    from shefex_nav import warmup
    from shefex_nav.scenario.choices import choices
    from shefex_nav.verify import study

    study.check(loaded)
    folder = _folder(keep)
    warmup.get_ready({"command=run", *choices(loaded)})
    asked = study.of_scenario(loaded, folder, turn_field=turn_field)
    chosen = list(range(first, first + seeds))
    found = _watched(asked, chosen, histories, workers)
    outside = [one.what for one in found.verdicts if not one.good]
    if json:
        typer.echo(json_module.dumps(as_numbers(asked, chosen, histories, found), allow_nan=False))
    else:
        _show(asked, chosen, found)
    if out is not None:
        from shefex_nav.verify import consistency_figures

        consistency_figures.draw_nees(found.runs, out)
        _say(f"wrote {out}")
    if outside:
        _say(f"{len(outside)} of {len(found.verdicts)} statistics outside: " + "; ".join(outside))
        raise typer.Exit(1)


def _folder(keep):
    """The folder of the star fixes, made if it is not there. -> str or None"""
    if keep is None:
        return None
    try:
        keep.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        words = f"cannot make the folder {keep}: {error.strerror}"
        raise typer.BadParameter(words, param_hint="--keep") from None
    return str(keep)


def _watched(asked, chosen, histories, workers):
    """`study.run` with a bar on stderr, or with lines where that is no terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from shefex_nav.verify import study

    console, total, done = Console(stderr=True), len(chosen) + 1, 0
    columns = BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn()
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=total)

        def note(words):
            nonlocal done
            done += 1
            progress.update(task, advance=1, description=words)
            if not console.is_terminal:
                _say(f"{words}, {done} of {total} done")

        try:
            return study.run(asked, chosen, histories=histories, workers=workers, note=note)
        except KeyboardInterrupt:
            _sweep(asked, chosen)
    _say(_interrupted(asked, chosen))  # below the bar, which is gone now
    raise typer.Exit(130)


def _sweep(asked, chosen):
    """Take away what workers have left half written."""
    if asked.folder is not None:
        for seed in chosen:
            files.part(asked.path(seed)).unlink(missing_ok=True)


def _interrupted(asked, chosen):
    """What is left of a study that was stopped: str."""
    if asked.folder is None:
        return "interrupted; nothing is kept, --keep FOLDER would"
    kept = sum(asked.path(seed).exists() for seed in chosen)
    return (
        f"interrupted; the star fixes of {kept} of {len(chosen)} seeds are kept in {asked.folder}, the same "
        "command goes on from there"
    )


def refused(runs):
    """Measurements that the gate refused, and all that met it: dict sensor -> (int, int)."""
    names = sorted({name for run in runs for name in run.nis})
    return {
        name: (
            sum(run.rejected.get(name, 0) for run in runs),
            sum(len(run.nis.get(name, ())) for run in runs),
        )
        for name in names
    }


def as_numbers(asked, chosen, histories, found):
    """Plain dict for JSON."""
    return {
        "scenario": asked.name,
        "first_seed": chosen[0],
        "seeds": len(chosen),
        "turned_field": asked.turn_field,
        "histories": histories,
        "histories_apart": found.apart,
        "star_fixes_by": None if asked.folder is None else _made_by(asked, chosen),
        "ok": all(one.good for one in found.verdicts),
        "statistics": [one._asdict() | {"inside": one.good} for one in found.verdicts],
        "refused": {name: {"refused": n, "met": met} for name, (n, met) in refused(found.runs).items()},
    }


def _made_by(asked, chosen):
    """In words, what made the star fixes that are kept: it may have been another version."""
    from shefex_nav.verify import flown

    return flown.told(asked.path(seed) for seed in chosen)


def rows(verdicts):
    """Verdicts for a table: of containment each that is outside, and the least share of each phase.

    list of nees.Verdict -> list of (words, nees.Verdict)
    """
    shown, phases = [], {}
    for one in verdicts:
        if not one.what.startswith(CONTAINED):
            shown.append((one.what.removesuffix(ONE_FIELD), one))
        else:
            phases.setdefault(one.what.partition(", ")[2], []).append(one)
    for phase, several in phases.items():
        shown += [(one.what, one) for one in several if not one.good]
        words = f"least share inside 3 sigma of {len(several)} errors, {phase}"
        shown.append((words, min(several, key=lambda one: one.value)))
    return shown


def table(title, verdicts):
    """rich Table of Verdicts."""
    from rich.table import Table

    found = Table(title=title, title_justify="left")
    for name in ("statistic", "value", "low", "high", "samples", ""):
        found.add_column(name, justify="left" if name in ("statistic", "") else "right", no_wrap=True)
    for words, one in rows(verdicts):
        numbers = [f"{value:.4f}" for value in (one.value, one.low, one.high)]
        found.add_row(words, *numbers, str(one.samples), "" if one.good else _mark(one))
    return found


def _mark(verdict):
    """What it means to be outside, in words."""
    return "too small" if verdict.value < verdict.low else "too large"


def _show(asked, chosen, found):
    from rich.console import Console

    fields = "another field of gravity in each" if asked.turn_field else "all in the field of the Earth"
    title = f"{asked.name}, seeds {chosen[0]} to {chosen[-1]}, {fields}; NEES, NIS: 1 is expected"
    Console(width=None if sys.stdout.isatty() else 130).print(table(title, found.verdicts))
    for name, (number, met) in refused(found.runs).items():
        typer.echo(f"{name}: {number} of {met} refused by the gate")
    typer.echo(f"variances of the histories within {found.apart:.1%} of the filter's own")
    if asked.folder is not None:
        typer.echo(f"star fixes of flights by {_made_by(asked, chosen)}")


def _say(text):
    typer.echo(text, err=True)
