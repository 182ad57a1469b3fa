"""`shefex-nav campaign`: fly a scenario many times, each time with draws and sensor seeds of its own.

Exit codes: 0 all runs flew to their end, 1 a run failed (a row of the table says why), 2 bad input,
130 interrupted; the same command goes on.
"""

import json as json_module
from pathlib import Path
from typing import Annotated

import typer


def campaign(
    scenario: Annotated[Path, typer.Argument(help="Scenario YAML, e.g. scenarios/campaign.yaml.")],
    runs: Annotated[int, typer.Option(min=1, help="How many runs.")],
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one a core.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Root of all randomness.")] = 1,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results; default campaigns/<scenario>-seed<seed>.")
    ] = None,
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Override one value, e.g. --set star_tracker.rate='5 Hz'."
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
):
    """Fly a scenario many times; the same command goes on with a campaign that was interrupted."""
    from shefex_nav.campaign import engine, running
    from shefex_nav.campaign.store import Store, StoreError
    from shefex_nav.scenario import load

    loaded = load.load(scenario, overrides or ())
    plan = running.plan_of(loaded, seed, runs)
    folder = out or Path("campaigns") / f"{loaded.mission.name}-seed{seed}"
    try:
        with Store(folder) as store:
            store.begin(plan, {})
            _say(f"{plan.name}, {runs} runs, seed {seed} -> {folder}")
            result = running.run(loaded, plan, store, workers, _say)
    except (StoreError, engine.EngineError) as error:
        raise typer.BadParameter(str(error)) from None
    if json:
        typer.echo(json_module.dumps(result, allow_nan=False))
    raise typer.Exit(1 if result["failed"] else 0)


def _say(text):
    typer.echo(text, err=True)
