"""`shefex-nav trade`: which settings would do, by covariance alone, for all combinations of settings.

Exit codes: 0 done, 1 nothing can be predicted of some combination, 2 bad input.
"""

from enum import StrEnum
from pathlib import Path

import typer

from shefex_nav.commands.options import Json, Overrides, OverwriteFigure, Scenario, Seed, Workers, option
from shefex_nav.commands.output_files import check_picture
from shefex_nav.commands.printing import print_json, say, stdout

Sweep = option(
    list[str],
    "Values to try. Several times: all combinations. imu=stim300,adis16505_1 means instruments.",
    metavar="KEY=A,B,C",
)
Cost = option(
    list[str] | None,
    "Cost of each value. The cheapest combination that meets all requirements is marked.",
    metavar="KEY=A:1,B:2",
)


class Quantity(StrEnum):
    """What a map can show."""

    ATTITUDE = "attitude"
    POSITION = "position"
    VELOCITY = "velocity"


def trade(
    scenario: Scenario,
    sweep: Sweep,
    cost: Cost = None,
    overrides: Overrides = None,
    seed: Seed = 1,
    workers: Workers = None,
    figure: option(Path | None, "Draw a map over the first two settings into a .png or .svg file.") = None,
    show: option(Quantity, "Error that the map shows.") = Quantity.ATTITUDE,
    force: OverwriteFigure = False,
    json: Json = False,
):
    """Rank combinations of settings by the errors that a linear model predicts; no filter is flown.

    The errors are 1 sigma of the best possible filter, at entry and at the end of the flight.
    `campaign SCENARIO --sweep` answers the same with flights.
    """
    if figure is not None:
        check_picture(figure, "--figure", force=force)
    from shefex_nav import runs
    from shefex_nav.scenario import sweeps
    from shefex_nav.verify.trade import plan

    axes = tuple(sweeps.axis(text) for text in sweep)
    asked = plan.Asked(scenario, axes, tuple(overrides or ()), seed, workers, plan.costs(cost or ()))
    base, chosen = plan.checked(asked)
    runs.get_ready(base)  # kernels are compiled before workers start
    say(f"{len(chosen)} combinations")
    study = plan.study(asked, base, chosen)
    _show(study, asked, json)
    if figure is not None:
        from shefex_nav.verify.trade import picture

        picture.draw(study, asked, figure, show.value)
        say(f"wrote {figure}")
    raise typer.Exit(1 if any(one.prediction is None for one in study.combinations) else 0)


def _show(study, asked, as_json):
    """The study on stdout."""
    from shefex_nav.verify.trade import table

    if as_json:
        print_json(table.as_numbers(study, asked))
        return
    console = stdout(170, highlight=False)
    drawn, lines = table.tables(study, asked)
    for one in drawn:
        console.print(one)
    for line in lines:
        console.print(line)
