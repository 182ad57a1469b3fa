"""`shefex-nav budget`: where the errors of a filter come from, by flights without each error of the world.

Exit codes: 0 done, 1 runs failed or were lost, 2 bad input, 130 interrupted; the same command goes on.
"""

from pathlib import Path

import typer

from shefex_nav.campaign import MOST_RUNS
from shefex_nav.commands.options import Json, Overrides, RootSeed, Scenario, Workers, bad, option
from shefex_nav.commands.printing import print_json, say, stdout

RUNS = 20
Software = option(
    str | None,
    "Navigation software in the place of the scenario's: also package.module:Class, "
    "'command:./my_fsw', or built-in.",
    metavar="FILE.py:CLASS",
)
Sources = option(
    list[str] | None,
    "An error to look at, e.g. gyro_bias (several times); another word is answered with all.",
    metavar="NAME",
)


def budget(
    scenario: Scenario,
    software: Software = None,
    source: Sources = None,
    runs: option(int, "Flights with and without each error.", min=1, max=MOST_RUNS) = RUNS,
    seed: RootSeed = 1,
    workers: Workers = None,
    out: option(Path | None, "Folder of what is flown; default logs/budgets/<scenario>-seed<seed>.") = None,
    overrides: Overrides = None,
    json: Json = False,
):
    """Say which errors of the sensors make up the errors of a filter at entry and at the end.

    The same seeds are flown again without each error, one at a time; the computer is told the same. Star
    tracker by statistics. The same command goes on where it was interrupted.
    """
    from shefex_nav.campaign import budget as making
    from shefex_nav.campaign import tables
    from shefex_nav.campaign.compare import flying
    from shefex_nav.commands.compare import fly

    how = flying.How(scenario, tuple(overrides or ()), runs, seed, workers, out)
    _check_software(software)
    whole, flights = making.planned(how, software, tuple(source or ()))
    say(f"{len(flights)} errors, {(len(flights) + 1) * runs} flights")
    lost, interrupted = fly([whole, *flights.values()], how)
    if interrupted:
        raise typer.Exit(130)
    found = making.budget(whole, flights)
    if json:
        print_json(making.as_numbers(found, whole.scenario, seed))
    else:
        stdout(170, highlight=False).print(tables.tables(making.parts(found, whole.scenario)))
    raise typer.Exit(1 if lost or found.notes or found.runs < runs else 0)


def _check_software(text):
    """CompareError, or BadParameter, for a word that names no software."""
    from shefex_nav.campaign.compare import given

    if text is not None and given.read(text).kind != given.SOFTWARE:
        raise bad(
            "--software",
            f"{text}: is no software; expected FILE.py:CLASS, package.module:Class, 'command:./my_fsw' or "
            "built-in",
        )
