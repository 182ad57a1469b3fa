"""`shefex-nav reproduce`: the papers' experiments, published against measured.

Exit codes: 0 done, also where a figure disagrees (the table says so and why), 2 bad input.
"""

import json as json_module
import sys
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.reproduce import registry

OUT = Path("logs/reproduce")


class ListingCommand(typer.core.TyperCommand):
    """A command whose help ends with the list of experiments."""

    def format_help(self, ctx, formatter):
        """The usual help, then the experiments."""
        super().format_help(ctx, formatter)
        formatter.write(f"Experiments:\n{registry.listing()}\n")


def reproduce(
    name: Annotated[str | None, typer.Argument(help="Experiment, or all; none lists them.")] = None,
    samples: Annotated[int | None, typer.Option(help="Sample size; default as in the paper.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all randomness.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for the figures (PNG).")] = OUT,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Run an experiment of the papers again and compare with what was published."""
    if name is None:
        typer.echo(f"Experiments, each of them or 'all':\n{registry.listing()}")
        return
    names = list(registry.EXPERIMENTS) if name == "all" else [name]
    if names[0] not in registry.EXPERIMENTS:
        known = ", ".join(["all", *registry.EXPERIMENTS])
        raise typer.BadParameter(f"there is no experiment {name!r}; choose from: {known}", param_hint="NAME")
    if samples is not None and samples < 1:
        raise typer.BadParameter(f"{samples} is not possible; at least 1", param_hint="--samples")
    _writable(out)
    done = []
    for one in names:
        outcome = _run(one, samples, seed, out, show=not json)
        done.append((one, outcome))
    if json:
        from shefex_nav.reproduce.table import as_numbers

        objects = [as_numbers(one, outcome) for one, outcome in done]
        result = {"experiments": objects} if name == "all" else objects[0]
        typer.echo(json_module.dumps(result, allow_nan=False))


def _run(name, samples, seed, out, show):
    """One experiment: measure, draw, and show the table if wanted. Outcome."""
    from rich.console import Console

    from shefex_nav.reproduce import engine, picture, table

    experiment = registry.load(name)
    samples = samples or experiment.samples
    _say(f"{name}: {samples} {experiment.unit}, seed {seed}; the first run on a machine compiles")
    outcome = _watched(engine, experiment, samples, seed)
    if show:
        console = Console(width=None if sys.stdout.isatty() else 130)
        console.print(table.experiment_table(name, experiment, outcome))
    path = out / f"{name}.png"
    picture.draw(experiment, outcome, path)
    _say(f"wrote {path}")
    return outcome


def _watched(engine, experiment, samples, seed):
    """Run with a progress bar on stderr."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("measure", total=samples)
        return engine.run(
            experiment, samples=samples, seed=seed, progress=lambda n: progress.advance(task, n)
        )


def _writable(out):
    """Refuse a folder that cannot take the figures, before anything is computed."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise typer.BadParameter(
            f"cannot write into the folder {out}: {error.strerror}", param_hint="--out"
        ) from None


def _say(text):
    typer.echo(text, err=True)
