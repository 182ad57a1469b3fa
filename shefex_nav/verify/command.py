"""`shefex-nav verify`: fly check-cases that others have published, and compare; errors over their bound and
over what the filter says of them.

Exit codes: 0 all within their tolerances, 1 a comparison fails, 2 no data or bad input.
"""

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.verify.bound_command import bound  # which imports late
from shefex_nav.verify.consistency_command import consistency  # likewise
from shefex_nav.verify.robustness_command import robustness  # likewise

app = typer.Typer(
    help="Compare flights with published check-cases, and navigation with what is possible.",
    no_args_is_help=True,
)
app.command()(bound)
app.command()(consistency)
app.command()(robustness)


@app.callback()
def verify():
    """Compare flights with published check-cases, and navigation with what is possible."""


@app.command()
def nesc(
    data: Annotated[Path, typer.Option(help="Folder with trajectories and DAVE-ML models, of any layout.")],
    case: Annotated[list[str] | None, typer.Option(help="Fly this case only, e.g. 01; more: 01,17.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Draw the comparison into a new .png or .svg file.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Fly NASA's NESC check-cases (01 to 10 and 17) and compare with its simulators."""
    if out is not None:
        writable(out)
    from shefex_nav.verify.data import search

    files = search(data)
    from shefex_nav import warmup
    from shefex_nav.verify import nesc as cases

    wanted = [number.strip().zfill(2) for item in case or () for number in item.split(",")]
    chosen, others = cases.choose(files, wanted)
    flown = []
    warmup.get_ready({"command=verify nesc"})  # none are listed ahead; it says when one is compiled
    for number in chosen:
        _say(f"case {number}: {cases.CASES[number].title}")
        for note in cases.NOTES.get(number, ()):
            _say(f"  as the published trajectory, which departs from the models: {note}")
        flown.append(cases.run(files, number))
    for why in sorted({cases.why_not(number) for number in others}):
        _say(f"not flown: {', '.join(n for n in others if cases.why_not(n) == why)} ({why})")
    if json:
        typer.echo(json_module.dumps(cases.as_numbers(flown, others), allow_nan=False))
    else:
        _show(flown)
    if out is not None:
        from shefex_nav.verify import picture

        picture.draw(flown, out)
        _say(f"wrote {out}")
    failed = [f"case {one.number}: {', '.join(one.failed)}" for one in flown if one.failed]
    if failed:
        _say("differs by more than is allowed: " + "; ".join(failed))
        raise typer.Exit(1)


def _say(text):
    typer.echo(text, err=True)


def writable(path):
    """Refuse a picture that could not be written or would overwrite a file, before anything is flown."""
    if path.suffix.lower() not in (".png", ".svg"):
        raise typer.BadParameter(f"{path} has to end in .png or .svg", param_hint="--out")
    if path.exists():
        raise typer.BadParameter(f"{path} exists already; choose another name", param_hint="--out")
    if not path.parent.is_dir():
        raise typer.BadParameter(f"there is no folder {path.parent}", param_hint="--out")


def _show(flown):
    from rich.console import Console

    from shefex_nav.verify.table import comparison_table

    Console(width=None if sys.stdout.isatty() else 130).print(comparison_table(flown))
