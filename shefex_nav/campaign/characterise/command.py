"""`shefex-nav characterise`: fit the statistics of a star tracker to rendered runs.

Exit codes: 0 done and every test within its limits, 1 written, but a test on runs that were not fitted is
outside, or they are too few to say so (the table and the file say which), 2 bad input or no fit, 130
interrupted, nothing written. Single runs that fail, or that no worker brings to an end, are left out and
counted; with --records nothing that was flown is lost in any case.
"""

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import typer


def characterise(
    scenario: Annotated[
        str, typer.Argument(help="Scenario: a YAML file, or the name of a shipped one, e.g. campaign.")
    ],
    runs: Annotated[int, typer.Option(min=6, help="Rendered runs to fly; a part of them judges the fit.")],
    out: Annotated[Path, typer.Option(help="File of the statistics (JSON), for star_tracker.model.")],
    seed: Annotated[int, typer.Option(min=0, help="Root of all randomness.")] = 1,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one a core.")
    ] = None,
    records: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Keep the rendered runs here; what is there is not flown again."),
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override one value, as of shefex-nav run."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file given with --out.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the file's content on stdout.")] = False,
):
    """Fit the statistics of a scenario's star tracker to rendered runs, for frames: statistical."""
    loaded = _loaded(scenario, overrides or ())
    _check_place(out, force)
    if records is not None and not records.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {records.parent}", param_hint="--records")
    _say(f"{loaded.mission.name}, {runs} rendered runs, seed {seed}; the first run on a machine compiles")
    result = _characterised(loaded, runs, seed, workers, records)
    _write(out, result.content)
    if json:
        typer.echo(json_module.dumps(result.content, allow_nan=False))
    else:
        _show(result)
    if result.failed:
        _say(f"{len(result.failed)} of {runs} rendered runs failed and are not in it")
    if result.lost:
        again = "" if records is None else "; the same command with --force flies them"
        _say(f"{len(result.lost)} runs were lost, no worker brought them to an end, and are not in it{again}")
    _say(f"wrote {out}")
    raise typer.Exit(0 if all(test.good for test in result.tests) else 1)


def _loaded(path, overrides):
    """The scenario, with pictures, if there can be statistics of it."""
    from shefex_nav.scenario import load, star_statistics

    # without the model that it may name: one of another format or star tracker is what this is to replace
    loaded = load.load(path, (*overrides, "star_tracker.frames=rendered", "star_tracker.model=null"))
    if wrong := list(star_statistics.fitness(loaded)):
        raise typer.BadParameter(f"{path}: {wrong[0][1]}", param_hint="SCENARIO")
    if not loaded.star_tracker.enabled:
        raise typer.BadParameter(f"{path}: star_tracker.enabled is false", param_hint="SCENARIO")
    return loaded


def _check_place(out, force):
    if out.exists() and not force:
        words = f"{out} exists already; choose another name or add --force"
        raise typer.BadParameter(words, param_hint="--out")
    if not out.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {out.parent}", param_hint="--out")


def _characterised(loaded, runs, seed, workers, folder):
    """running.Result; what goes wrong with the name of the option that it is about."""
    from shefex_nav.campaign.characterise import running
    from shefex_nav.campaign.characterise.records import RecordsError
    from shefex_nav.campaign.engine import EngineError

    try:
        return running.characterise(loaded, runs, seed, workers=workers, folder=folder, done=_say)
    except RecordsError as error:
        raise typer.BadParameter(str(error), param_hint="--records") from None
    except EngineError as error:
        words = f"{error}; if memory is short, try fewer"
        raise typer.BadParameter(words, param_hint="--workers") from None


def _write(out, content):
    """Put the file in its place as a whole."""
    from shefex_nav import files
    from shefex_nav.campaign.characterise import model

    try:
        files.put(out, model.text(content))
        files.settle(out.parent)
    except OSError as error:
        raise typer.BadParameter(f"{out}: {error.strerror or error}", param_hint="--out") from None


def _show(result):
    """Tables of the parameters and of the tests."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 120)
    fitted = Table("parameter", "value", title="Fitted", title_justify="left")
    for part in ("sightings", "identification"):
        for name, value in result.content[part].items():
            fitted.add_row(name, _words(name, value))
    console.print(fitted)
    table = Table(title="On runs that were not fitted", title_justify="left")
    for name, justify in (
        ("figure", "left"),
        ("value", "right"),
        ("+-", "right"),
        ("limits", "right"),
        ("samples", "right"),
        ("", "left"),
    ):
        table.add_column(name, justify=justify)
    for test in result.tests:
        limits = f"{test.low:g} ... {test.high:g}"
        table.add_row(
            test.what, f"{test.value:.3f}", f"{test.error:.3f}", limits, str(test.samples), _verdict(test)
        )
    console.print(table)


def _verdict(test):
    """What a test says, for people; nothing if it is inside."""
    if test.good:
        return ""
    return test.verdict if test.deciding is None else f"{test.verdict}, {test.deciding} would decide"


def _words(name, value):
    """A fitted parameter for people."""
    if name == "table":
        return "\n".join(
            f"{stars:2d} stars: {100 * first:.4g} % of first, {100 * later:.4g} % of later frames, "
            f"{100 * wrong:.3g} % of them wrong"
            for stars, first, later, wrong in value
        )
    return (
        ", ".join(f"{item:g}" if isinstance(item, float) else str(item) for item in value)
        if isinstance(value, list)
        else str(value)
    )


def _say(text):
    typer.echo(text, err=True)
