"""`shefex-nav campaign`: fly a scenario many times, each time with draws and sensor seeds of its own.

Exit codes: 0 all runs flew to their end, 1 a run failed (its row in the table says why) or was lost (the same
command flies it), 2 bad input or no workers, 130 interrupted; the same command goes on.
"""

import json as json_module
from pathlib import Path
from typing import Annotated

import typer

OUT = Path("logs/campaigns")
MOST_LOST = 5  # that are named

Scenario = Annotated[
    str, typer.Argument(help="Scenario: a YAML file, or the name of a shipped one, e.g. campaign.")
]
Runs = Annotated[int, typer.Option(min=1, help="How many runs.")]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes on this machine; default one a core.")]
Engine = Annotated[
    str | None,
    typer.Option("--engine", metavar="dask://HOST:PORT", help="Fly on a Dask cluster: its scheduler."),
]
Seed = Annotated[int, typer.Option(min=0, help="Root of all randomness.")]
Out = Annotated[
    Path | None, typer.Option(help="Folder of the results; default logs/campaigns/<scenario>-seed<seed>.")
]
Kept = Annotated[
    list[str] | None,
    typer.Option(
        metavar="worst:K|failed|none",
        help="Runs that are flown again at the end with a log each (several times: all of these).",
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Override one value, e.g. --set star_tracker.rate='5 Hz'."
    ),
]
DryRun = Annotated[
    bool, typer.Option("--dry-run", help="Print what each run would draw, as CSV or JSON; fly nothing.")
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")]


def campaign(
    scenario: Scenario,
    runs: Runs,
    workers: Workers = None,
    cluster: Engine = None,
    seed: Seed = 1,
    out: Out = None,
    keep: Kept = None,
    overrides: Overrides = None,
    dry_run: DryRun = False,
    json: Json = False,
):
    """Fly a scenario many times; the same command goes on with a campaign that was interrupted."""
    from shefex_nav.campaign import running
    from shefex_nav.scenario import load

    address = _told("--engine", running.address, cluster)
    kept = _told("--keep", running.kept, keep or ())
    loaded = load.load(scenario, overrides or ())
    request = running.checked(running.Request(loaded, runs, seed, workers, address, kept))
    folder = out or OUT / f"{loaded.mission.name}-seed{seed}"
    if dry_run:
        _print_draws(running.prepared(loaded, runs, seed)[1], runs, json)
        return
    ended = _fly(request, folder)
    raise typer.Exit(_result(ended, folder, runs, json))


def _fly(request, folder):
    """Ended of a campaign."""
    from shefex_nav.campaign import running
    from shefex_nav.campaign.progress import show
    from shefex_nav.campaign.stopping import stopping
    from shefex_nav.campaign.store import Store

    with Store(folder) as store, stopping() as stop:
        name = request.scenario.mission.name
        _say(f"{name}, {request.runs} runs, seed {request.seed} -> {folder}")
        return running.fly(request, store, show(_say), stop)


def _result(ended, folder, runs, as_json):
    """What came out, on stdout; the exit code."""
    for one in ended.lost[:MOST_LOST]:
        _say(f"run {one.run} was lost: {one.reason}")
    if ended.lost:
        _say(f"{len(ended.lost)} of {runs} runs were lost: no fault of theirs is known, and the same command "
             "flies them")  # fmt: skip
    for one in ended.unlogged[:MOST_LOST]:
        _say(f"run {one.run} has no log: {one.reason}")
    if ended.interrupted:
        _say(f"interrupted; {len(ended.rows)} of {runs} runs are kept, the same command goes on from there")
        return 130
    if ended.rows or as_json:
        _show(folder, ended, as_json)
    failed = sum(row["status"] == "failed" for row in ended.rows)
    return 1 if failed or ended.lost else 0


def repeat(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a campaign.")],
    run: Annotated[int, typer.Argument(min=0, help="Number of the run.")],
    log: Annotated[Path | None, typer.Option(help="Write the log of the run (MCAP).")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file given with --log.")] = False,
    json: Json = False,
):
    """Fly one run of a campaign again, exactly, and compare it with what was kept (exit code 1: differs)."""
    from shefex_nav.campaign import repeating
    from shefex_nav.report.export_command import check_file

    if log is not None:
        check_file(log, "--log", force=force)
    repeating.read_head(folder, run)  # refuses before anything is said
    _say(f"{folder}, run {run}; the first run on a machine compiles, which takes a few minutes.")
    repeated = repeating.repeat(folder, run, log)
    for line in repeated.notes:
        _say(line)
    if json:
        typer.echo(json_module.dumps(repeated.result(), allow_nan=False))
    else:
        typer.echo(repeated.words())
    raise typer.Exit(0 if repeated.same else 1)


def _told(option, parse, value):
    """What the value of an option means, which is refused under its name."""
    from shefex_nav.campaign.running import BadCampaign

    try:
        return parse(value)
    except BadCampaign as error:
        raise typer.BadParameter(str(error), param_hint=option) from None


def _print_draws(sampler, runs, as_json):
    """Draws of all runs on stdout."""
    if as_json:
        from shefex_nav.campaign.plan import writable

        jobs = [sampler.job(run) for run in range(runs)]
        found = [{"run": job.run, "seed": job.seed, "draws": writable(job.draws)} for job in jobs]
        typer.echo(json_module.dumps(found, allow_nan=False))
        return
    import csv
    import sys

    from shefex_nav.campaign.table import of_draw

    writer = csv.writer(sys.stdout, lineterminator="\n")
    heads = {name: one.measure for one in sampler.dispersed for name in _columns(one)}
    writer.writerow(["run", "seed", *(f"{name} [{unit}]" if unit else name for name, unit in heads.items())])
    for run in range(runs):
        job = sampler.job(run)
        drawn = dict(scalar for path, value in job.draws.items() for scalar in of_draw(path, value))
        writer.writerow([run, job.seed, *(drawn.get(name) for name in heads)])


def _columns(dispersed):
    """Names of the columns that draws of a Dispersed come in, as in the table: several of a list."""
    from shefex_nav.campaign.table import of_draw

    return dict.fromkeys(
        name for value in dispersed.law.reach() for name, _ in of_draw(dispersed.name, value)
    )


def _show(folder, ended, as_json):
    """The results on stdout."""
    from shefex_nav.campaign import over_time, report_command, store, summary
    from shefex_nav.campaign.results import open_campaign

    if not ended.rows:
        nothing = summary.of_nothing(store.read_head(folder), len(ended.lost), ended.digest)
        typer.echo(json_module.dumps(nothing, allow_nan=False))
        return
    done = open_campaign(folder)
    if as_json:
        typer.echo(json_module.dumps(summary.summary_object(done), allow_nan=False))
    else:
        report_command.show(done, over_time.read(done))
        _say(f"results {folder / 'results.parquet'}")


def _say(text):
    typer.echo(text, err=True)
