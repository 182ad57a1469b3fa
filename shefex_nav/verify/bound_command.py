"""`shefex-nav verify bound`: the errors of a mission's filter over the posterior Cramer-Rao bound.

Exit codes: 0 done, 2 bad input. A study of many seeds in parallel is `benchmarks/consistency.py`.
"""

import json as json_module
import sys
from pathlib import Path
from typing import Annotated

import typer

COLUMNS = ("position, m", "velocity, m/s", "attitude, deg")


def bound(
    scenario: Annotated[
        str, typer.Argument(help="Scenario: a YAML file, or the name of a shipped one, e.g. shefex2_andoya.")
    ],
    seeds: Annotated[int, typer.Option(min=1, help="How many runs; a ratio of one run says little.")] = 5,
    first: Annotated[int, typer.Option(min=0, help="Seed of the first; the others follow.")] = 0,
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override one value.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Draw the curves into a new .png or .svg file.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Fly a scenario with some seeds and compare the errors with what is possible at best."""
    if out is not None:
        from shefex_nav.verify.command import writable

        writable(out)
    from shefex_nav.scenario import load

    loaded = load.load(scenario, overrides or ())
    from shefex_nav.verify import over_bound

    if over_bound.left_out(loaded):
        words = f"{scenario} has errors that the bound does not know: {over_bound.left_out(loaded)}"
        raise typer.BadParameter(words, param_hint="SCENARIO")
    from shefex_nav import warmup
    from shefex_nav.scenario.choices import choices

    warmup.get_ready({"command=run", *choices(loaded)})
    found = over_bound.curves(*_flights(loaded, range(first, first + seeds)))
    ratios = over_bound.ratios(found)
    if json:
        typer.echo(json_module.dumps(as_numbers(loaded, first, seeds, ratios), allow_nan=False))
    else:
        _show(ratios, seeds)
    if out is not None:
        from shefex_nav.verify import consistency_figures

        consistency_figures.draw_bound({"filter": found}, out, runs=seeds)
        _say(f"wrote {out}")


def _flights(scenario, seeds):
    """Runs and bounds of some seeds. -> list of flown.Run, list of `over_bound.bounds`"""
    from shefex_nav import prepare
    from shefex_nav.verify import flown, over_bound

    runs, pairs = [], []
    for seed in seeds:
        _say(f"seed {seed}")
        world = prepare.build_world(scenario, seed)
        fixes = flown.fly(scenario, seed)
        runs.append(flown.filter_run(scenario, seed, fixes, world=world))
        pairs.append(over_bound.bounds(scenario, world, fixes))
    return runs, pairs


def as_numbers(scenario, first, seeds, ratios):
    """Plain dict for JSON."""
    phases = {name: {key: column.tolist() for key, column in one.items()} for name, one in ratios.items()}
    return {
        "scenario": scenario.mission.name,
        "first_seed": first,
        "seeds": seeds,
        "order": ["position_m", "velocity_m_s", "attitude_rad"],
        "phases": phases,
    }


def _say(text):
    typer.echo(text, err=True)


def _show(ratios, seeds):
    from math import degrees

    from rich.console import Console
    from rich.table import Table

    title = f"rms error of {seeds} runs and the posterior Cramer-Rao bound, 3D"
    table = Table(title=title, title_justify="left")
    for name in ("phase", "", "error", "reported sigma", "bound", "error/bound", "gravity known"):
        table.add_column(name, justify="left" if name in ("phase", "") else "right", no_wrap=True)
    for phase, values in ratios.items():
        for q, quantity in enumerate(COLUMNS):
            sizes = [float(values[key][q]) for key in ("error", "sigma", "bound")]
            sizes = [degrees(size) for size in sizes] if q == 2 else sizes
            shares = [f"{values[key][q]:.2f}" for key in ("ratio", "ratio_known")]
            table.add_row(phase if q == 0 else "", quantity, *(f"{size:.3g}" for size in sizes), *shares)
        table.add_section()
    Console(width=None if sys.stdout.isatty() else 130).print(table)
