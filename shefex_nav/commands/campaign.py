"""`shefex-nav campaign`: fly a scenario many times, each time with draws and sensor seeds of its own.

Exit codes: 0 all runs flew to their end, 1 a run failed (its row in the table says why) or was lost (the same
command flies it), 2 bad input or no workers, 130 interrupted; the same command goes on.
"""

from pathlib import Path
from typing import Annotated

import typer

from shefex_nav.commands.flights import show_campaign, warn
from shefex_nav.commands.options import DispersedScenario, Json, Overrides, RootSeed, Workers
from shefex_nav.commands.printing import print_json, say, stdout

OUT = Path("logs/campaigns")
MOST_LOST = 5  # that are named
Sweep = Annotated[
    list[str] | None,
    typer.Option(
        metavar="KEY=A,B,C",
        help="Fly a campaign for each of the values, with the same draws, and compare them; several times: "
        "all combinations. imu=stim300,adis16505_1 means instruments.",
    ),
]


def campaign(
    scenario: DispersedScenario,
    runs: Annotated[int, typer.Option(min=1, help="How many runs.")],
    workers: Workers = None,
    cluster: Annotated[
        str | None,
        typer.Option("--engine", metavar="dask://HOST:PORT", help="Fly on a Dask cluster: its scheduler."),
    ] = None,
    seed: RootSeed = 1,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the results; default logs/campaigns/<scenario>-seed<seed>."),
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option(
            metavar="worst:K|failed|none",
            help="Runs that are flown again at the end with a log each (several times: all of these).",
        ),
    ] = None,
    overrides: Overrides = None,
    sweep: Sweep = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print what each run would draw, as CSV or JSON; fly nothing.")
    ] = False,
    json: Json = False,
):
    """Fly a scenario many times; the same command goes on with a campaign that was interrupted."""
    from shefex_nav.campaign import running
    from shefex_nav.scenario import load, software

    if sweep:
        _check_sweep(cluster, keep, dry_run)
        from shefex_nav.campaign.compare import flying

        how = flying.How(scenario, tuple(overrides or ()), runs, seed, workers, out)
        raise typer.Exit(_sweep(how, sweep, json))
    address = _told("--engine", running.address, cluster)
    kept = _told("--keep", running.kept, keep or ())
    loaded = load.load(scenario, overrides or ())
    software.refuse_reached(loaded)
    warn(loaded, loaded.dropped)
    request = running.checked(running.Request(loaded, runs, seed, workers, address, kept))
    folder = out or OUT / f"{loaded.mission.name}-seed{seed}"
    if dry_run:
        _print_draws(running.prepared(loaded, runs, seed)[1], runs, json)
        return
    ended = _fly(request, folder)
    raise typer.Exit(_result(ended, folder, runs, json))


def _check_sweep(cluster, keep, dry_run):
    """Refuse what does not go with --sweep."""
    for option, given in (("--engine", cluster), ("--keep", keep), ("--dry-run", dry_run)):
        if given:
            raise typer.BadParameter("does not go with --sweep", param_hint=option)


def _sweep(how, given, as_json):
    """Fly what is missing and print what came of it. -> exit code, as of a campaign

    how : flying.How;  given : list of KEY=A,B,C
    """
    from shefex_nav.campaign.compare import summary, sweep
    from shefex_nav.commands.compare import fly
    from shefex_nav.scenario import sweeps

    axes = [sweeps.axis(text) for text in given]
    out = how.out or OUT / f"{Path(how.scenario).stem}-seed{how.seed}-sweep"
    flights, settings = zip(*sweep.planned(how.scenario, axes, how.overrides, out), strict=True)
    for words in dict.fromkeys(
        one.scenario.line_about(*gone) for one in flights for gone in one.scenario.dropped
    ):
        say(f"warning: {words}")
    lost = fly(flights, how)
    every, found = sweep.compared(flights)
    if as_json:
        print_json(summary.summary(every, found) | {"combinations": sweep.result(every, settings)})
    else:
        from shefex_nav.campaign import tables

        stdout(160, highlight=False).print(tables.tables(sweep.tables(every, found, settings)))
    failed = any(one.failed for side in every for one in side.runs.values())
    return 1 if lost or failed else 0


def _told(option, parse, value):
    """What the value of an option means, which is refused under its name."""
    from shefex_nav.campaign.running import BadCampaign

    try:
        return parse(value)
    except BadCampaign as error:
        raise typer.BadParameter(str(error), param_hint=option) from None


def _print_draws(sampler, runs, as_json):
    """Draws of all runs on stdout."""
    from shefex_nav.campaign import drawn_table

    if as_json:
        print_json(drawn_table.as_numbers(sampler, runs))
        return
    import csv
    import sys

    csv.writer(sys.stdout, lineterminator="\n").writerows(drawn_table.rows(sampler, runs))


def _fly(request, folder):
    """Ended of a campaign."""
    from shefex_nav.campaign import running
    from shefex_nav.campaign.progress import TerminalShow
    from shefex_nav.campaign.store import Store
    from shefex_nav.stopping import stopping

    with Store(folder) as store, stopping() as stop:
        name = request.scenario.mission.name
        say(f"{name}, {request.runs} runs, seed {request.seed} -> {folder}")
        return running.fly(request, store, TerminalShow(say), stop)


def _result(ended, folder, runs, as_json):
    """What came out, on stdout; the exit code."""
    for one in ended.lost[:MOST_LOST]:
        say(f"run {one.run} was lost: {one.reason}")
    if ended.lost:
        say(
            f"{len(ended.lost)} of {runs} runs were lost: no fault of theirs is known, and the same command "
            "flies them"
        )
    for one in ended.unlogged[:MOST_LOST]:
        say(f"run {one.run} has no log: {one.reason}")
    if ended.interrupted:
        say(f"interrupted; {len(ended.rows)} of {runs} runs are kept, the same command goes on from there")
        return 130
    if ended.rows or as_json:
        _show(folder, ended, as_json)
    failed = sum(row["status"] == "failed" for row in ended.rows)
    return 1 if failed or ended.lost else 0


def _show(folder, ended, as_json):
    """The results on stdout."""
    from shefex_nav.campaign import over_time, store, summary
    from shefex_nav.campaign.results import open_campaign

    if not ended.rows:
        print_json(summary.of_nothing(store.read_head(folder), len(ended.lost), ended.digest))
        return
    done = open_campaign(folder)
    if as_json:
        print_json(summary.summary_object(done))
    else:
        show_campaign(done, over_time.read(done))
        say(f"results {folder / 'results.parquet'}")
