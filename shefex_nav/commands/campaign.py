"""`shefex-nav campaign`: fly a scenario many times, each time with draws and sensor seeds of its own.

Exit codes: 0 all runs flew to their end, 1 a run failed (its row in the table says why) or was lost (the same
command flies it), 2 bad input or no workers, 130 interrupted; the same command goes on. With --until-verified
0 means that every requirement passes and 1 that one does not, or that a run was lost.
"""

from pathlib import Path

import typer

from shefex_nav.campaign import MOST_RUNS
from shefex_nav.commands.flights import show_campaign, warn
from shefex_nav.commands.options import DispersedScenario, Json, Overrides, RootSeed, Workers, bad, option
from shefex_nav.commands.output_files import check_writable
from shefex_nav.commands.printing import print_json, say, stdout

OUT = Path("logs/campaigns")
MOST_LOST = 5  # that are named
Sweep = option(
    list[str] | None,
    "Fly a campaign for each value, with the same draws, and compare them. Several times: all"
    " combinations. imu=stim300,adis16505_1 means instruments.",
    metavar="KEY=A,B,C",
)
Kept = option(
    list[str] | None,
    "Runs to fly again at the end, with a log each. May be given several times.",
    metavar="worst:K|failed|none",
)
Runs = option(int | None, "Number of runs; with --until-verified the largest number.", min=1, max=MOST_RUNS)
UntilVerified = option(
    bool,
    "Fly until each requirement passes or fails, at requirements.probability and "
    "requirements.confidence, or until --runs are flown.",
    "--until-verified",
)


def campaign(
    scenario: DispersedScenario,
    runs: Runs = None,
    until_verified: UntilVerified = False,
    workers: Workers = None,
    cluster: option(
        str | None, "Fly on the Dask cluster with this scheduler.", "--engine", metavar="dask://HOST:PORT"
    ) = None,
    seed: RootSeed = 1,
    out: option(Path | None, "Folder of the results. Default: logs/campaigns/<scenario>-seed<seed>.") = None,
    keep: Kept = None,
    overrides: Overrides = None,
    sweep: Sweep = None,
    dry_run: option(bool, "Print the draws of each run as CSV or JSON. Fly nothing.", "--dry-run") = False,
    json: Json = False,
):
    """Fly a scenario many times. The same command continues an interrupted campaign."""
    from shefex_nav.campaign import running
    from shefex_nav.scenario import load, software

    if runs is None and (dry_run or not until_verified):
        raise bad("--runs", "is missing; see `shefex-nav campaign --help`")
    if not dry_run:
        check_writable(out or OUT, "--out")
    if sweep:
        _check_sweep(cluster, keep, dry_run, until_verified)
        from shefex_nav.campaign.compare import flying

        how = flying.How(scenario, tuple(overrides or ()), runs, seed, workers, out)
        raise typer.Exit(_sweep(how, sweep, json))
    address = _parsed("--engine", running.address, cluster)
    kept = _parsed("--keep", running.kept, keep or ())
    loaded = load.load(scenario, overrides or ())
    software.refuse_reached(loaded)
    warn(loaded, loaded.dropped)
    request = running.Request(loaded, runs, seed, workers, address, kept)
    folder = out or OUT / f"{loaded.mission.name}-seed{seed}"
    if dry_run:
        _print_draws(running.prepared(loaded, running.checked(request).runs, seed)[1], request, json)
        return
    if until_verified:
        raise typer.Exit(_fly_until_verified(request, folder, json))
    ended = _fly(running.checked(request), folder)
    raise typer.Exit(_result(ended, folder, runs, json))


def _check_sweep(cluster, keep, dry_run, until_verified):
    """Refuse what does not go with --sweep."""
    for flag, given in (("--engine", cluster), ("--keep", keep), ("--dry-run", dry_run)):
        if given:
            raise bad(flag, "does not go with --sweep")
    if until_verified:
        words = "does not go with --sweep, whose combinations are compared run by run; verify the chosen one"
        raise bad("--until-verified", words)


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
    lost, interrupted = fly(flights, how)
    if interrupted:
        return 130
    every, found = sweep.compared(flights)
    if as_json:
        print_json(summary.summary(every, found) | {"combinations": sweep.result(every, settings)})
    else:
        from shefex_nav.campaign import tables

        stdout(160, highlight=False).print(tables.tables(sweep.tables(every, found, settings)))
    failed = any(one.failed for side in every for one in side.runs.values())
    return 1 if lost or failed else 0


def _parsed(option, parse, value):
    """What the value of an option means, which is refused under its name."""
    from shefex_nav.campaign.running import BadCampaign

    try:
        return parse(value)
    except BadCampaign as error:
        raise bad(option, str(error)) from None


def _print_draws(sampler, request, as_json):
    """Draws of all runs on stdout. request : running.Request"""
    from shefex_nav.campaign import draws

    if as_json:
        of = {"scenario": request.scenario.mission.name, "seed": request.seed}
        print_json(of | draws.as_numbers(sampler, request.runs))
        return
    import csv
    import sys

    csv.writer(sys.stdout, lineterminator="\n").writerows(draws.rows(sampler, request.runs))


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


def _fly_until_verified(request, folder, as_json):
    """Fly from look to look and print what came of it. -> exit code"""
    from shefex_nav.campaign import until
    from shefex_nav.campaign.progress import TerminalShow
    from shefex_nav.campaign.store import Store
    from shefex_nav.stopping import stopping

    request = until.checked(request)
    with Store(folder) as store, stopping() as stop:
        most = "" if request.runs is None else f", at most {request.runs} runs"
        say(f"{request.scenario.mission.name} until verified{most}, seed {request.seed} -> {folder}")
        flown = until.fly(request, store, TerminalShow(say), stop)
    code = _result(flown.ended, folder, flown.asked, as_json)
    if flown.ended.interrupted:
        return code
    if flown.next_look is not None and not flown.ended.lost:
        say(f"no look is left within {request.runs} runs; the same command goes on with more")
    return 0 if flown.all_pass and not flown.ended.lost else 1


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
        say(f"interrupted; {ended.done} of {runs} runs are kept, the same command goes on from there")
        return 130
    if ended.done or as_json:
        _show(folder, ended, as_json)
    return 1 if ended.failed or ended.lost else 0


def _show(folder, ended, as_json):
    """The results on stdout."""
    from shefex_nav.campaign import over_time, summary
    from shefex_nav.campaign.head import read_head
    from shefex_nav.campaign.results import open_campaign

    if not ended.done:
        print_json(summary.of_nothing(read_head(folder), len(ended.lost), ended.digest))
        return
    done = open_campaign(folder)
    if as_json:
        print_json(summary.summary_object(done))
    else:
        show_campaign(done, over_time.read(done))
        say(f"results {folder / 'results.parquet'}")
